"""What chance does to a step: errors of the forcing that decorrelate in time, a random walk, and jibes."""

import taichi as ti

from kernels import noise, sphere
from kernels.features import BIAS, DEBRIS, DIFFUSION, ERRORS, JIBE, WIND

f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)


@ti.func
def transition(old: f32x2, std: ti.f32, time: ti.f32, dt: ti.f32, normal: f32x2) -> f32x2:
    """Return an Ornstein-Uhlenbeck process dt [s] after it was `old`.

    Its standard deviation is std, its decorrelation time is `time` [s]. The transition is exact for any dt (Gillespie
    1996, doi:10.1103/PhysRevE.54.2084, eq. 1.9).
    """
    keep = ti.exp(-dt / time)
    kick = std * ti.sqrt(1.0 - keep * keep)
    return keep * old + kick * normal


@ti.func
def jibed(rate: ti.f32, dt: ti.f32, uniform: ti.f32):
    """Return whether an odd number of jibes at a rate [1/s] falls within dt [s].

    The law does not depend on how a time is cut into steps. A Poisson number of mean m is odd with probability
    (1 - exp(-2 m)) / 2.
    """
    odd = 0.5 - 0.5 * ti.exp(-2.0 * rate * dt)
    return uniform < odd


@ti.func
def walked(walk: f32x2, c: ti.f32, s: ti.f32) -> f32x2:
    """Return (dlon, dlat) [binary angle units] of a random walk (east, north) [m].

    c, s: cosine and sine of the latitude where it begins. This is the exponential map to second order: without its last
    term a walk drifts poleward by D tan(lat) / R.
    """
    unit = ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))
    dlat = (walk[1] - walk[0] * walk[0] * s / c * ti.f32(0.5 / sphere.RADIUS)) * unit
    return f32x2(walk[0] * unit / c, dlat)


@ti.func
def draw(
    features: ti.template(),
    own: ti.template(),
    physics: ti.template(),
    terms: ti.template(),
    i: ti.i32,
    slot: ti.i32,
    step: ti.i32,
    dt: ti.f32,
):
    """Return (error, walk) of particle i over dt [s] of a lattice step, and update its errors and its side.

    error: of current and wind, east and north [m/s], the mean of those at begin and end of the step; walk: east and
    north [m]. own, physics, terms: see kernels.advance; slot: the particle's in the whole run, the key of its noise.
    """
    error, walk = f32x4(0.0), f32x2(0.0)
    if ti.static(features & (DIFFUSION | ERRORS)):
        w = noise.words(terms.seed0, terms.seed1, noise.STREAM_STEP, slot, step)
        if ti.static(features & DIFFUSION):
            walk = noise.normals(w[0], w[1]) * ti.sqrt(2.0 * physics.diffusivity * dt)
            if ti.static(features & DEBRIS):  # debris shares only the errors of the forcing with the object
                v = noise.words(terms.seed0, terms.seed1, noise.STREAM_DEBRIS + terms.debris, slot, step)
                walk = noise.normals(v[0], v[1]) * ti.sqrt(2.0 * physics.diffusivity * dt)
        if ti.static(features & ERRORS):
            old = f32x2(own.current_error_east[i], own.current_error_north[i])
            new = transition(old, physics.current_std, physics.current_time, dt, noise.normals(w[2], w[3]))
            own.current_error_east[i], own.current_error_north[i] = new[0], new[1]
            error[0], error[1] = 0.5 * (old[0] + new[0]), 0.5 * (old[1] + new[1])
    if ti.static(features & BIAS):
        error[0] += own.current_bias_east[i]
        error[1] += own.current_bias_north[i]
    if ti.static(features & (JIBE | ERRORS) and features & WIND):
        w = noise.words(terms.seed0, terms.seed1, noise.STREAM_WIND, slot, step)
        if ti.static(features & ERRORS):
            old = f32x2(own.wind_error_east[i], own.wind_error_north[i])
            new = transition(old, physics.wind_std, physics.wind_time, dt, noise.normals(w[0], w[1]))
            own.wind_error_east[i], own.wind_error_north[i] = new[0], new[1]
            error[2], error[3] = 0.5 * (old[0] + new[0]), 0.5 * (old[1] + new[1])
        if ti.static(features & JIBE):
            if ti.static(features & DEBRIS):
                w = noise.words(terms.seed0, terms.seed1, noise.STREAM_DEBRIS + terms.debris, slot, step)
            if jibed(physics.jibe_rate, dt, noise.uniform(w[2])):
                own.side[i] = -own.side[i]
    return error, walk
