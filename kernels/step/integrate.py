"""Explicit Runge-Kutta steps along a velocity field, and the field's divergence.

Steps are taken in lon and lat.

A velocity is a `ti.func` (features, sea, own, lon, lat, fraction) -> (east, north, valid) [m/s], as
`kernels.step.velocity.drift` is. features: compile-time options; sea: kernels.step.sample.Sea; own:
the particle's properties that the velocity depends on; lon, lat [binary angle]; fraction: of the
lattice step.
"""

import taichi as ti

from kernels.maths import sphere
from kernels.step.velocity import Drifter

ASIDE = 200.0  # [m] to either side: step of the central differences of a divergence

# Time and weight of each stage. A stage starts along the velocity of the one before.
MIDPOINT = ((0.0, 1 / 2), (0.0, 1.0))
CLASSICAL = ((0.0, 1 / 2, 1 / 2, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6))

f32x2 = ti.types.vector(2, ti.f32)
f32x3 = ti.types.vector(3, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)


@ti.func
def tableau(scheme: ti.template(), stage: ti.i32) -> f32x2:
    """Return (time, weight) of a stage: its share of the step, and its weight in the sum."""
    at, part = ti.cast(scheme[0][0], ti.f32), ti.cast(scheme[1][0], ti.f32)
    for k in ti.static(range(1, len(scheme[0]))):
        # Compare only where an entry differs from the one before: a comparison for each stage costs
        # 3 % of a step.
        if ti.static(scheme[0][k] != scheme[0][k - 1] or scheme[1][k] != scheme[1][k - 1]):
            if stage >= k:
                at, part = scheme[0][k], scheme[1][k]
    return f32x2(at, part)


@ti.dataclass
class Way:
    """Displacement of a step up to the present stage [binary angle units].

    Before the first stage it is zero with valid = 1.
    """

    # (dlon, dlat) over the whole step at the velocity of the last stage that had forcing
    last: f32x2
    total: f32x2  # the sum of the stages so far
    valid: ti.f32  # 0 once a stage had no forcing
    sets_off: ti.f32  # 0 if the first stage did not lead off the beach


@ti.func
def _sets_off(
    beached: ti.template(), way: ti.template(), entry: f32x2, r: f32x3, off: f32x2
) -> ti.f32:
    """Return 0 if the first stage's drift (east, north, valid) does not lead off the beach.

    Otherwise the value is unchanged.
    """
    sets_off = way.sets_off
    if ti.static(beached):
        first = (entry[0] == 0.0) & ((off[0] != 0.0) | (off[1] != 0.0))
        stays = first & ((r[2] < 0.5) | (r[0] * off[0] + r[1] * off[1] <= 0.0))
        sets_off = ti.select(stays, 0.0, sets_off)
    return sets_off


@ti.func
def lead(
    velocity: ti.template(),
    beached: ti.template(),
    features: ti.template(),
    sea: ti.template(),
    own: ti.template(),
    way: ti.template(),
    lon: ti.i32,
    lat: ti.i32,
    c0: ti.f32,
    s0: ti.f32,
    dt: ti.f32,
    fraction: ti.f32,
    entry: f32x2,
    off: f32x2,
) -> Way:
    """Return the `Way` after one more stage of a step over dt [s, signed] from (lon, lat).

    The scheme is MIDPOINT, of order 2, or CLASSICAL, of order 4 (Kutta 1901), in the coordinates
    lon and lat themselves: summing stages in metres and wrapping afterwards would be of first order
    only. entry: the stage's `tableau`; fraction: its time in the lattice step. c0, s0: cosine and
    sine of lat.

    beached: whether a particle may lie on a beach. Then `off` (east, north) points off the beach,
    and the particle leaves only if the drift of the first stage has a component along it; `off` is
    zero for a particle that is afloat. For a particle that stays, the displacement is meaningless.
    There is no branch: see kernels.runtime.bundle.
    """
    # m/s -> units of latitude in this step
    scale_lat = dt * ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))
    d = entry[0] * way.last[1] * ti.f32(sphere.UNIT)
    # cos(lat + d), |d| < 0.02: error 7e-9
    c = c0 - d * (s0 + d * (0.5 * c0 - d * s0 * (1.0 / 6.0)))
    x, y = (
        lon + ti.cast(entry[0] * way.last[0], ti.i32),
        lat + ti.cast(entry[0] * way.last[1], ti.i32),
    )
    r = velocity(features, sea, own, x, y, fraction)
    sets_off = _sets_off(beached, way, entry, r, off)
    valid = way.valid * r[2]
    dlon = ti.select(valid > 0.5, r[0] * scale_lat / c, way.last[0])
    dlat = ti.select(valid > 0.5, r[1] * scale_lat, way.last[1])
    last = f32x2(dlon, dlat)
    return Way(last=last, total=way.total + entry[1] * last, valid=valid, sets_off=sets_off)


@ti.func
def lead_over_pole(
    velocity: ti.template(),
    beached: ti.template(),
    features: ti.template(),
    sea: ti.template(),
    own: ti.template(),
    way: ti.template(),
    lon: ti.i32,
    lat: ti.i32,
    dt: ti.f32,
    fraction: ti.f32,
    entry: f32x2,
    off: f32x2,
) -> Way:
    """Return the `Way` as `lead` does, near a pole: in the plane tangent at the step's begin.

    Displacements are (east, north) [m] there, and velocities are transported to it along great
    circles. With the exponential map the step is that of the scheme, up to the curvature over one
    step: at most (20 km / R)^2 / 6 of it.
    """
    x, y = sphere.exponential(lon, lat, entry[0] * way.last[0], entry[0] * way.last[1])
    turn = sphere.convergence(lon, lat, x, y)
    current = sphere.carried_on(f32x2(own.error[0], own.error[1]), turn)
    wind = sphere.carried_on(f32x2(own.error[2], own.error[3]), turn)
    error = f32x4(current[0], current[1], wind[0], wind[1])
    there = Drifter(line=own.line, error=error, member=own.member, row=own.row, asks=own.asks)
    r = velocity(features, sea, there, x, y, fraction)
    here = sphere.carried_back(f32x2(r[0], r[1]), turn)
    sets_off = _sets_off(beached, way, entry, f32x3(here[0], here[1], r[2]), off)
    valid = way.valid * r[2]
    last = f32x2(
        ti.select(valid > 0.5, dt * here[0], way.last[0]),
        ti.select(valid > 0.5, dt * here[1], way.last[1]),
    )
    return Way(last=last, total=way.total + entry[1] * last, valid=valid, sets_off=sets_off)


@ti.func
def led(way: ti.template()) -> f32x2:
    """Return (dlon, dlat) [binary angle units] of a whole step.

    If a stage had no forcing, this is the displacement of the last stage that had: the coast may
    still stop the particle on its way.
    """
    known = way.valid >= 0.5
    return f32x2(
        ti.select(known, way.total[0], way.last[0]), ti.select(known, way.total[1], way.last[1])
    )


@ti.func
def divergence(
    velocity: ti.template(),
    features: ti.template(),
    sea: ti.template(),
    own: ti.template(),
    lon: ti.i32,
    lat: ti.i32,
    fraction: ti.f32,
) -> ti.f32:
    """Return the divergence [1/s] of a velocity on the sphere; 0 where a neighbour has no forcing.

    It is computed by central differences.
    """
    c, s = sphere.cos_lat(lat), sphere.sin_lat(lat)
    dx = ti.cast(ti.min(ASIDE / (c * ti.f32(sphere.RADIUS * sphere.UNIT)), 5.0e8), ti.i32)
    dy = ti.cast(ASIDE / (sphere.RADIUS * sphere.UNIT), ti.i32)
    # The sides are east, west, north and south; east and north count +1, the others -1.
    total, valid, north = 0.0, 1.0, 0.0
    for side in range(4):
        sign = 1 - 2 * (side & 1)
        x, y = lon, lat
        if side < 2:
            x += sign * dx
        else:
            y += sign * dy
        r = velocity(features, sea, own, x, y, fraction)
        total += ti.cast(sign, ti.f32) * (r[0] if side < 2 else r[1])
        north += 0.25 * r[1]
        valid *= r[2]
    return valid * (total * ti.f32(0.5 / ASIDE) - north * s / c * ti.f32(1.0 / sphere.RADIUS))
