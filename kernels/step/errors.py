"""Random terms of a step: correlated errors of the forcing, a random walk, and jibes."""

from typing import NamedTuple

import taichi as ti

from kernels.maths import noise, sphere
from kernels.step import buoys
from kernels.step.coast import Reals
from kernels.step.features import BIAS, DEBRIS, DIFFUSION, ERRORS, GUIDED, JIBE, SHARED, TAIL, WIND

f32x2 = ti.types.vector(2, ti.f32)

# Columns [m/s] in the rows of one array (kernels.runtime.rows): present errors of current and wind,
# the constant bias of the current, and the scale of both errors of the current. The numbers below are
# the rows of each one's east component.
ROWS = (
    *("current_error_east", "current_error_north", "wind_error_east", "wind_error_north"),
    *("current_bias_east", "current_bias_north", "current_scale"),
)
CURRENT_ERROR, WIND_ERROR, CURRENT_BIAS, CURRENT_SCALE = 0, 2, 4, 6
OF_A_STEP = ROWS[:CURRENT_BIAS]  # those that change from step to step
# Scales of a tail beyond this one are drawn again: with 4 degrees of freedom 1 of 8,200, which would
# hold 1.6 % of the variance.
LARGEST_SCALE = 8.0
TRIES = 64  # of a scale; each is taken with a probability of 0.9 at least


class Physics(NamedTuple):
    """Random motion of the objects of one scenario; each term is off at zero."""

    current_std: float = 0.0  # [m/s] standard deviation of a component of the current's error
    current_time: float = 1.0  # [s] its decorrelation time
    wind_std: float = 0.0
    wind_time: float = 1.0
    diffusivity: float = 0.0  # [m2/s]
    jibe_rate: float = 0.0  # [1/s]
    tailed: float = 0.0  # 1: each particle has a scale of its own for the current's errors


@ti.func
def kept(time: ti.f32, dt: ti.f32) -> ti.f32:
    """Return the autocorrelation over dt [s] of an Ornstein-Uhlenbeck process.

    time: its decorrelation time [s].
    """
    return ti.exp(-dt / time)


@ti.func
def transition(old: f32x2, std: ti.f32, keep: ti.f32, normal: f32x2) -> f32x2:
    """Return the next value of an Ornstein-Uhlenbeck process of standard deviation std.

    old: its value before; keep: the autocorrelation over the interval, see `kept`; normal: two
    standard normals. The transition is exact for any interval (Gillespie 1996,
    doi:10.1103/PhysRevE.54.2084, eq. 1.9).
    """
    kick = std * ti.sqrt(1.0 - keep * keep)
    return keep * old + kick * normal


@ti.kernel
def draw_scales(
    first: ti.i32,
    last: ti.i32,
    number: ti.i32,
    error_rows: Reals,
    seed0: ti.u32,
    seed1: ti.u32,
    freedom: ti.f32,
):
    """Draw the scale of each particle's current errors, and multiply its first error and bias by it.

    The scale is s = sqrt((freedom - 2) / chi2), at most LARGEST_SCALE, with chi2 of `freedom` degrees
    of freedom, at least 3. A normal error times s is Student's, of the same variance: the error of any
    time, and every displacement. Chi2 is drawn as in Marsaglia and Tsang 2000,
    doi:10.1145/358407.358414, figure 1.

    Args:
        first: first slot.
        last: slot after the last one.
        number: number of the first slot in the whole run, the key of the noise.
        error_rows: rows ROWS, flat; those of the current are updated.
        seed0: first word of the run's key.
        seed1: second word of it.
        freedom: degrees of freedom.
    """
    for i in range(first, last):
        n = error_rows.shape[0] // ti.static(len(ROWS))
        d = 0.5 * freedom - ti.f32(1.0 / 3.0)
        scale, taken = ti.f32(1.0), 0
        for k in range(TRIES):
            if taken == 0:
                w = noise.noise_words(seed0, seed1, noise.STREAM_TAIL, number + i - first, k)
                x = noise.normals(w[0], w[1])[0]
                v = 1.0 + x / ti.sqrt(9.0 * d)
                if v > 0.0:
                    v = v * v * v
                    half = d * v  # of chi2
                    trial = ti.sqrt((freedom - 2.0) / (2.0 * half))
                    bound = 0.5 * x * x + d - half + d * ti.log(v)
                    if ti.log(noise.uniform(w[2])) < bound and trial <= LARGEST_SCALE:
                        scale, taken = trial, 1
        error_rows[CURRENT_SCALE * n + i] = scale
        for k in ti.static(range(2)):
            error_rows[(CURRENT_ERROR + k) * n + i] *= scale
            error_rows[(CURRENT_BIAS + k) * n + i] *= scale


@ti.func
def jibed(rate: ti.f32, dt: ti.f32, uniform: ti.f32):
    """Return whether an odd number of jibes at a rate [1/s] falls within dt [s].

    The distribution does not depend on how the time is divided into steps. A Poisson number of mean
    m is odd with probability (1 - exp(-2 m)) / 2.
    """
    odd = 0.5 - 0.5 * ti.exp(-2.0 * rate * dt)
    return uniform < odd


@ti.func
def variance(table: ti.template(), story: ti.i32, dt: ti.f32) -> ti.f32:
    """Return the variance 2 D dt [m2] of a component of a scenario's random walk over dt [s]."""
    return 2.0 * table[story * ti.static(len(Physics._fields)) + 4] * dt


@ti.func
def walked(walk: f32x2, c: ti.f32, s: ti.f32) -> f32x2:
    """Return (dlon, dlat) [binary angle units] of a random walk (east, north) [m].

    c, s: cosine and sine of the latitude where it begins. This is the exponential map to second
    order: without its last term a walk drifts poleward by D tan(lat) / R.
    """
    unit = ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))
    dlat = (walk[1] - walk[0] * walk[0] * s / c * ti.f32(0.5 / sphere.RADIUS)) * unit
    return f32x2(walk[0] * unit / c, dlat)


@ti.func
def draw_errors(
    features: ti.template(),
    width: ti.template(),
    held: ti.template(),
    table: ti.template(),
    terms: ti.template(),
    step: ti.i32,
):
    """Draw the random terms of a bundle of particles for the dt [s] in which each moves.

    held: see kernels.step.advance. Read: scenario, slot (the number in the whole run, the key of
    the noise), dt, bias, `shared`, what the normals of the errors have in common with buoys
    (kernels.step.buoys), and `nudge`, which is added to those of guided particles
    (kernels.step.guide). Updated: errors of current and wind, east and north [m/s], and
    the side. Written: `error`, the mean of the errors at begin and end of the step plus the bias,
    and `walk`, east and north [m], of variance 2 D dt [m2]. table: the `Physics` of each scenario;
    terms: see kernels.step.advance.
    """
    wind = ti.static(bool(features & (JIBE | ERRORS) and features & WIND))
    # Calls of library functions have a loop of their own: see kernels.runtime.bundle.
    for j in range(width):
        at, slot, dt = (
            held.story[0, j] * ti.static(len(Physics._fields)),
            held.slot[0, j],
            held.dt[0, j],
        )
        if ti.static(features & (DIFFUSION | ERRORS)):
            w = noise.noise_words(terms.seed0, terms.seed1, noise.STREAM_STEP, slot, step)
            if ti.static(features & ERRORS):
                held.log[1, j], held.word[1, j] = ti.log(noise.uniform(w[2])), w[3]
                held.keep[0, j] = kept(table[at + 1], dt)
            if ti.static(features & DIFFUSION):
                # debris shares only the errors of the forcing with the object
                if ti.static(features & DEBRIS):
                    w = noise.noise_words(
                        terms.seed0, terms.seed1, noise.STREAM_DEBRIS + terms.debris, slot, step
                    )
                held.log[0, j], held.word[0, j] = ti.log(noise.uniform(w[0])), w[1]
        if ti.static(wind):
            w = noise.noise_words(terms.seed0, terms.seed1, noise.STREAM_WIND, slot, step)
            if ti.static(features & ERRORS):
                held.log[2, j], held.word[2, j] = ti.log(noise.uniform(w[0])), w[1]
                held.keep[1, j] = kept(table[at + 3], dt)
            if ti.static(features & JIBE):
                if ti.static(features & DEBRIS):
                    w = noise.noise_words(
                        terms.seed0, terms.seed1, noise.STREAM_DEBRIS + terms.debris, slot, step
                    )
                if jibed(table[at + 5], dt, noise.uniform(w[2])):
                    held.side[0, j] = -held.side[0, j]
    for j in range(width):
        at = held.story[0, j] * ti.static(len(Physics._fields))
        if ti.static(features & DIFFUSION):
            held.variance[0, j] = variance(table, held.story[0, j], held.dt[0, j])
            walk = noise.turned(held.log[0, j], held.word[0, j]) * ti.sqrt(held.variance[0, j])
            held.walk[0, j], held.walk[1, j] = walk[0], walk[1]
        if ti.static(features & ERRORS):
            for k in ti.static(range(2 if wind else 1)):  # the current's, the wind's
                normal = noise.turned(held.log[1 + k, j], held.word[1 + k, j])
                if ti.static(features & SHARED):
                    given = f32x2(held.shared[2 * k, j], held.shared[2 * k + 1, j])
                    normal = given + held.shared[buoys.OWN_CURRENT + k, j] * normal
                if ti.static(features & GUIDED):
                    normal += f32x2(held.nudge[2 * k, j], held.nudge[2 * k + 1, j])
                old = f32x2(held.errors[2 * k, j], held.errors[2 * k + 1, j])
                std = table[at + 2 * k]
                if ti.static(features & TAIL and k == 0):
                    std *= held.scale[0, j]
                new = transition(old, std, held.keep[k, j], normal)
                for m in ti.static(range(2)):
                    held.errors[2 * k + m, j] = new[m]
                    held.error[2 * k + m, j] = 0.5 * (old[m] + new[m])
        if ti.static(features & BIAS):
            held.error[0, j] += held.bias[0, j]
            held.error[1, j] += held.bias[1, j]
