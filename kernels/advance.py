"""One lattice step of all particles: drift through currents, wind and waves, with errors, diffusion and a coast.

A step from position (lon, lat) integrates dlon/dt = u / (R cos lat), dlat/dt = v / R by an explicit Runge-Kutta scheme;
adds a random walk; and ends at its first crossing of the shore, or goes on along it. Positions are integers; within the step everything is
float32 on differences from the position at its begin. Writing of the increment is one rounding of at most 5 mm.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import taichi as ti

from kernels import launch, noise, shore, sphere
from kernels.coast import Bytes, DeviceCoast, Frame, Ints, Reals, first_crossing, is_clear, open_sea
from kernels.sample import Nodes, Tiles, sample

# Features of a step, as bits of a compile-time number: what is not asked for is not compiled.
CURRENT, WIND, STOKES, ERRORS, DIFFUSION, JIBE, COAST, RK4, BIAS, SINK, REFLOAT, SLIDE, DIVERGENCE, DEBRIS = (
    1 << k for k in range(14)
)

FARTHEST = 5.0e8  # [binary angle unit] 42 degrees: a step that is longer, next to a pole, is none
NEVER = 2.0e9  # [s]
ASIDE = 200.0  # [m] across which a divergence is measured, to either side

ADRIFT, ASHORE, OUTSIDE, LEFT, SUNK, PENDING = range(6)  # drift.motion.status.Status

f32x2 = ti.types.vector(2, ti.f32)
f32x3 = ti.types.vector(3, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)
i32x6 = ti.types.vector(6, ti.i32)


@ti.func
def drift(
    features: ti.template(),
    nodes: ti.template(),
    where: ti.template(),
    scale: ti.template(),
    ranges: ti.template(),
    line: f32x4,
    error: f32x4,
    lon: ti.i32,
    lat: ti.i32,
    fraction: ti.f32,
) -> f32x3:
    """Return (east, north, valid) [m/s] of a drifting object: current + Stokes drift + leeway + errors.

    line: slope and offset [m/s] downwind and to the right of downwind (Allen and Plourde 1999; Breivik and Allen 2008,
    doi:10.1016/j.jmarsys.2007.02.010, eq. 1-2); error: of current and wind, east and north [m/s].
    """
    u, v, valid = error[0], error[1], 1.0
    if ti.static(features & CURRENT):
        c = sample(nodes, where, scale, ranges[0], ranges[1], lon, lat, fraction)
        u, v, valid = u + c[0], v + c[1], c[2]
    if ti.static(features & STOKES):
        s = sample(nodes, where, scale, ranges[4], ranges[5], lon, lat, fraction)
        u, v, valid = u + s[0], v + s[1], valid * s[2]
    if ti.static(features & WIND):
        w = sample(nodes, where, scale, ranges[2], ranges[3], lon, lat, fraction)
        wu, wv = w[0] + error[2], w[1] + error[3]
        slowness = 1.0 / (ti.sqrt(wu * wu + wv * wv) + 1e-9)
        along = line[0] + line[1] * slowness  # per m/s of wind
        across = line[2] + line[3] * slowness
        u += wu * along + wv * across
        v += wv * along - wu * across
        valid *= w[2]
    return f32x3(u, v, valid)


@ti.func
def integrate(
    velocity: ti.template(),
    features: ti.template(),
    nodes: ti.template(),
    where: ti.template(),
    scale: ti.template(),
    ranges: ti.template(),
    line: f32x4,
    error: f32x4,
    lon: ti.i32,
    lat: ti.i32,
    c0: ti.f32,
    s0: ti.f32,
    dt: ti.f32,
    begin: ti.f32,
    share: ti.f32,
) -> f32x3:
    """Return (dlon, dlat, valid) [binary angle units] over dt [s, signed], a share of the step from `begin` on.

    c0, s0: cosine and sine of lat.

    Classical Runge-Kutta of order 4, or the midpoint rule of order 2, in the coordinates lon and lat themselves: stages
    of east and north metres, added up and wrapped afterwards, would be of first order. Where a stage finds no forcing,
    valid is 0 and the way is that of the last stage that did: where the coast may still stop it.
    """
    scale_lat = dt * ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))  # m/s -> units of latitude in this step
    dlon, dlat, sum_lon, sum_lat, valid = 0.0, 0.0, 0.0, 0.0, 1.0
    for stage in range(ti.static(4 if features & RK4 else 2)):
        # Where the stage stands in the step, and its part of the sum: 0, 1/2 with 0, 1; or 0, 1/2, 1/2, 1 with
        # 1/6, 1/3, 1/3, 1/6. A loop at run time: unrolled it compiles three times as long and runs no faster.
        at = 0.5 * ti.cast(stage > 0, ti.f32) + 0.5 * ti.cast(stage > 2, ti.f32)
        part = ti.cast(stage, ti.f32)
        if ti.static(features & RK4):
            part = 1.0 / 3.0
            if stage == 0 or stage == 3:
                part = 1.0 / 6.0
        d = at * dlat * ti.f32(sphere.UNIT)
        c = c0 - d * (s0 + d * (0.5 * c0 - d * s0 * (1.0 / 6.0)))  # cos(lat + d), |d| < 0.02: error 7e-9
        r = velocity(
            features,
            nodes,
            where,
            scale,
            ranges,
            line,
            error,
            lon + ti.cast(at * dlon, ti.i32),
            lat + ti.cast(at * dlat, ti.i32),
            begin + at * share,
        )
        valid *= r[2]
        if valid > 0.5:
            dlon, dlat = r[0] * scale_lat / c, r[1] * scale_lat
        sum_lon += part * dlon
        sum_lat += part * dlat
    if valid < 0.5:
        sum_lon, sum_lat = dlon, dlat  # the way that the last valid stage leads
    return f32x3(sum_lon, sum_lat, valid)


@ti.func
def divergence(
    velocity: ti.template(),
    features: ti.template(),
    nodes: ti.template(),
    where: ti.template(),
    scale: ti.template(),
    ranges: ti.template(),
    line: f32x4,
    error: f32x4,
    lon: ti.i32,
    lat: ti.i32,
    fraction: ti.f32,
) -> ti.f32:
    """Return the divergence [1/s] of the drift on the sphere, by central differences; 0 where a side has no forcing."""
    c, s = sphere.cos_lat(lat), sphere.sin_lat(lat)
    dx = ti.cast(ASIDE / (c * ti.f32(sphere.RADIUS * sphere.UNIT)), ti.i32)
    dy = ti.cast(ASIDE / (sphere.RADIUS * sphere.UNIT), ti.i32)
    # east, west, north, south: sides that are left or up count +1
    total, valid, north = 0.0, 1.0, 0.0
    for side in range(4):
        sign = 1 - 2 * (side & 1)
        x, y = lon, lat
        if side < 2:
            x += sign * dx
        else:
            y += sign * dy
        r = velocity(features, nodes, where, scale, ranges, line, error, x, y, fraction)
        total += ti.cast(sign, ti.f32) * (r[0] if side < 2 else r[1])
        north += 0.25 * r[1]
        valid *= r[2]
    return valid * (total * ti.f32(0.5 / ASIDE) - north * s / c * ti.f32(1.0 / sphere.RADIUS))


@ti.kernel
def _advance(
    features: ti.template(),
    velocity: ti.template(),
    first: ti.i32,
    last: ti.i32,
    lon: Ints,
    lat: Ints,
    status: Ints,
    release: Ints,
    ended: Ints,
    edge: Ints,
    log_weight: Reals,
    down_slope: Reals,
    down_offset: Reals,
    right_slope: Reals,
    right_offset: Reals,
    left_slope: Reals,
    left_offset: Reals,
    side: Ints,
    sinks: Ints,
    afloat: Ints,
    current_error_east: Reals,
    current_error_north: Reals,
    wind_error_east: Reals,
    wind_error_north: Reals,
    current_bias_east: Reals,
    current_bias_north: Reals,
    nodes: Nodes,
    where: Ints,
    scale: Reals,
    ranges: i32x6,
    elapsed: ti.i32,
    duration: ti.i32,
    direction: ti.f32,
    step: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    current_std: ti.f32,
    current_time: ti.f32,
    wind_std: ti.f32,
    wind_time: ti.f32,
    diffusivity: ti.f32,
    jibe_rate: ti.f32,
    stay: ti.f32,
    offing: ti.f32,
    debris: ti.i32,
    west: ti.i32,
    south: ti.i32,
    width: ti.u32,
    height: ti.u32,
    cell: Bytes,
    start: Ints,
    edges: Ints,
    edge_id: Ints,
    frame: Frame,
    line_of: Ints,
):
    for i in range(first, last):
        if status[i] == PENDING and release[i] < elapsed + duration:
            status[i] = ADRIFT
        moves = status[i] == ADRIFT
        left = ti.max(elapsed, release[i])  # when in this step it begins to move
        if ti.static(features & REFLOAT):
            if status[i] == ASHORE:
                # The end of its wait is a function of the landing, so that no step draws it anew.
                w = noise.words(seed0, seed1, noise.STREAM_REFLOAT, i, ended[i])
                wait = ti.min(-ti.log(noise.uniform(w[0])) * stay, NEVER)
                due = ended[i] + ti.cast(ti.min(wait, NEVER - ti.cast(ended[i], ti.f32)), ti.i32)
                moves = due < elapsed + duration
                left = ti.max(elapsed, due)
        finish = elapsed + duration
        if ti.static(features & SINK):
            if sinks[i] < finish:
                finish = ti.max(sinks[i], left)
                moves = moves and (finish > left or status[i] == ADRIFT)  # waterlogged on the beach it stays there
            if moves and finish == left:
                status[i], ended[i], moves = SUNK, finish, False
        if moves:
            lasting = finish - left
            dt = ti.cast(lasting, ti.f32)
            begin, share = ti.cast(left - elapsed, ti.f32) / duration, dt / duration

            walk_east, walk_north = 0.0, 0.0
            error = f32x4(0.0)
            if ti.static(features & (DIFFUSION | ERRORS)):
                w = noise.words(seed0, seed1, noise.STREAM_STEP, i, step)
                if ti.static(features & DIFFUSION):
                    n = noise.normals(w[0], w[1]) * ti.sqrt(2.0 * diffusivity * dt)
                    if ti.static(features & DEBRIS):  # shares the errors of the forcing with its object, no more
                        v = noise.words(seed0, seed1, noise.STREAM_DEBRIS + debris, i, step)
                        n = noise.normals(v[0], v[1]) * ti.sqrt(2.0 * diffusivity * dt)
                    walk_east, walk_north = n[0], n[1]
                if ti.static(features & ERRORS):
                    # Exact transition of the process over dt; the step feels the mean of its begin and its end.
                    n = noise.normals(w[2], w[3])
                    keep = ti.exp(-dt / current_time)
                    kick = current_std * ti.sqrt(1.0 - keep * keep)
                    old = f32x2(current_error_east[i], current_error_north[i])
                    new = keep * old + kick * n
                    current_error_east[i], current_error_north[i] = new[0], new[1]
                    error[0], error[1] = 0.5 * (old[0] + new[0]), 0.5 * (old[1] + new[1])
            if ti.static(features & BIAS):
                error[0] += current_bias_east[i]
                error[1] += current_bias_north[i]
            if ti.static(features & (JIBE | ERRORS) and features & WIND):
                w = noise.words(seed0, seed1, noise.STREAM_WIND, i, step)
                if ti.static(features & ERRORS):
                    n = noise.normals(w[0], w[1])
                    keep = ti.exp(-dt / wind_time)
                    kick = wind_std * ti.sqrt(1.0 - keep * keep)
                    old = f32x2(wind_error_east[i], wind_error_north[i])
                    new = keep * old + kick * n
                    wind_error_east[i], wind_error_north[i] = new[0], new[1]
                    error[2], error[3] = 0.5 * (old[0] + new[0]), 0.5 * (old[1] + new[1])
                if ti.static(features & JIBE):
                    # An odd number of jibes at this rate within dt: independent of the length of the step.
                    odd = 0.5 - 0.5 * ti.exp(-2.0 * jibe_rate * dt)
                    if ti.static(features & DEBRIS):
                        w = noise.words(seed0, seed1, noise.STREAM_DEBRIS + debris, i, step)
                    if noise.uniform(w[2]) < odd:
                        side[i] = -side[i]

            line = f32x4(0.0)
            if ti.static(features & WIND):
                line = f32x4(down_slope[i], down_offset[i], right_slope[i], right_offset[i])
                if side[i] < 0:
                    line[2], line[3] = left_slope[i], left_offset[i]

            x, y = lon[i], lat[i]
            c0, s0 = sphere.cos_lat(y), sphere.sin_lat(y)
            held = 0
            if ti.static(features & REFLOAT):
                if status[i] == ASHORE:
                    x, y, nx, ny = shore.leave(x, y, c0, offing, edge[i], cell, start, edges, edge_id, frame, line_of)
                    r = velocity(features, nodes, where, scale, ranges, line, error, x, y, begin)
                    if r[2] < 0.5 or direction * (r[0] * nx + r[1] * ny) <= 0.0:
                        held = 1  # the drift leads onto the beach: it waits for one that leads off it
            if held == 0:
                if ti.static(features & REFLOAT):
                    afloat[i] = left
                r = integrate(
                    velocity,
                    features,
                    nodes,
                    where,
                    scale,
                    ranges,
                    line,
                    error,
                    x,
                    y,
                    c0,
                    s0,
                    direction * dt,
                    begin,
                    share,
                )
                dlon, dlat = r[0], r[1]
                if ti.static(features & DIVERGENCE):
                    x_half, y_half = x + ti.cast(0.5 * dlon, ti.i32), y + ti.cast(0.5 * dlat, ti.i32)
                    middle = begin + 0.5 * share
                    log_weight[i] -= dt * divergence(
                        velocity, features, nodes, where, scale, ranges, line, error, x_half, y_half, middle
                    )
                if ti.static(features & DIFFUSION):
                    # The exponential map to second order: without its last term a walk drifts poleward by D tan(lat) / R.
                    unit = ti.f32(1.0 / (sphere.RADIUS * sphere.UNIT))
                    dlon += walk_east * unit / c0
                    dlat += (walk_north - walk_east * walk_east * s0 / c0 * ti.f32(0.5 / sphere.RADIUS)) * unit
                move_lon, move_lat, known = 0, 0, False
                if ti.max(ti.abs(dlon), ti.abs(dlat)) < FARTHEST:
                    move_lon, move_lat = ti.cast(ti.round(dlon), ti.i32), ti.cast(ti.round(dlat), ti.i32)
                    known = r[2] > 0.5
                x_end, y_end = x + move_lon, y + move_lat
                met, number, part = 0, -1, ti.cast(1.0, ti.f32)
                if ti.static(features & COAST):
                    # Asked first: a stage may have found no forcing just because it lies inland, behind the shore.
                    if ti.static(features & DIFFUSION):
                        variance = 2.0 * diffusivity * dt
                        span = ti.max(ti.abs(move_lon), ti.abs(move_lat))
                        # Beyond 2.9 standard deviations of the walk no bridge comes back with a chance of 2^-24.
                        span += ti.cast(2.9 * ti.sqrt(variance) / (c0 * ti.f32(shore.METRES)), ti.i32) + 1
                        if not is_clear(x, y, span, cell, frame):
                            met, x_end, y_end, part, number = shore.walk(
                                ti.static(bool(features & SLIDE)), x, y, move_lon, move_lat, c0, variance,
                                seed0, seed1, i, step, cell, start, edges, edge_id, frame, line_of,
                            )  # fmt: skip
                    else:
                        met, x_end, y_end, part, number = first_crossing(
                            x, y, move_lon, move_lat, cell, start, edges, edge_id, frame
                        )
                        if ti.static(features & SLIDE):
                            if met == 1:
                                f = shore.facing(x, y, c0, number, line_of)
                                x_end, y_end = shore.slide(
                                    x, y, move_lon, move_lat, c0, f[0], f[1], f[2], 0.0,
                                    cell, start, edges, edge_id, frame, line_of,
                                )  # fmt: skip
                                met = 0
                    if ti.static(features & SLIDE):
                        if x_end != x + move_lon or y_end != y + move_lat:
                            known = True  # it slid: a stage that found no forcing lay inland
                if met == 1:
                    lon[i], lat[i] = x_end, y_end
                    status[i] = ASHORE
                    ended[i] = left + ti.cast(part * dt, ti.i32)
                    edge[i] = number
                elif known:
                    lon[i], lat[i] = x_end, y_end
                    status[i] = ADRIFT
                    if ti.cast(x_end - west, ti.u32) > width or ti.cast(y_end - south, ti.u32) > height:
                        status[i] = LEFT
                        ended[i] = elapsed + duration
                    elif finish < elapsed + duration:
                        status[i] = SUNK
                        ended[i] = finish
                else:
                    status[i] = OUTSIDE
                    ended[i] = left


class Physics(NamedTuple):
    """How the objects of one scenario move, beside the forcing: errors are off at zero, so is each other term."""

    current_std: float = 0.0  # [m/s] of the current's error, a component
    current_time: float = 1.0  # [s] its decorrelation time
    wind_std: float = 0.0
    wind_time: float = 1.0
    diffusivity: float = 0.0  # [m2/s]
    jibe_rate: float = 0.0  # [1/s]


class Beach(NamedTuple):
    """What the coast does to a particle that reaches it: it stays for good, for a while, or slides along."""

    stay: float = 0.0  # [s] mean wait before it is afloat again; 0: for good
    offing: float = 0.0  # [m] off the beach where it is afloat again
    slides: bool = False


class Step(NamedTuple):
    """One step of the lattice clock."""

    number: int  # of the lattice step: the key of its noise
    elapsed: int  # [s] from the run's start to the begin of the step
    duration: int  # [s] > 0
    direction: int  # +1 forward in time, -1 backward


Move = Callable[[Step], None]


class Domain(NamedTuple):
    """The box outside which a particle has left the case [binary angle]."""

    west: int
    south: int
    width: int
    height: int


class Place(NamedTuple):
    """What is the same for all scenarios of a run: where they are, what the coast does, what is asked of a step."""

    domain: Domain
    coast: DeviceCoast | None = None
    beach: Beach = Beach()
    bias: bool = False  # whether particles have an error of the current that lasts
    sinks: bool = False
    divergence: bool = False  # log weights lose the divergence along the track: a backward run's likelihood
    debris: int = (
        0  # number of a class that shares the errors of the forcing, not walk and jibes, slot by slot with the object
    )
    scheme: str = "rk4"


def features(ranges: tuple[int, ...], physics: Physics, place: Place) -> int:
    """Return the compile-time features that a scenario needs."""
    wind = ranges[3] > ranges[2]
    coastal = place.coast is not None
    return (
        CURRENT * (ranges[1] > ranges[0])
        | WIND * wind
        | STOKES * (ranges[5] > ranges[4])
        | ERRORS * (physics.current_std > 0 or (wind and physics.wind_std > 0))
        | DIFFUSION * (physics.diffusivity > 0)
        | JIBE * (wind and physics.jibe_rate > 0)
        | COAST * coastal
        | RK4 * (place.scheme == "rk4")
        | BIAS * place.bias
        | SINK * place.sinks
        | REFLOAT * (coastal and place.beach.stay > 0)
        | SLIDE * (coastal and place.beach.slides)
        | DIVERGENCE * place.divergence
        | DEBRIS * (place.debris > 0)
    )


def advance(
    ensemble: Any,
    slots: tuple[int, int],
    tiles: Tiles,
    ranges: tuple[int, ...],
    physics: Physics,
    step: Step,
    place: Place,
    velocity: Any = drift,
) -> None:
    """Move the slots [first, last) of an ensemble over one lattice step, in place: see `mover`."""
    mover(ensemble, slots, tiles, ranges, physics, place, step.direction, velocity)(step)


def mover(
    ensemble: Any,
    slots: tuple[int, int],
    tiles: Tiles,
    ranges: tuple[int, ...],
    physics: Physics,
    place: Place,
    direction: int,
    velocity: Any = drift,
) -> Move:
    """Return a function that moves the slots [first, last) of an ensemble over one lattice step, in place.

    ensemble: a drift.motion.ensemble.Ensemble. ranges: first and last tile of currents, winds and Stokes drift. direction: of all
    its steps. velocity: a function of the outline of `drift`, so that the order of the scheme can be measured on an analytic flow.
    A particle moves only while adrift, from its release on; it ends ashore, sunk, outside the forcing or the domain.
    """
    e, (seed0, seed1) = ensemble, noise.key(ensemble.seed)
    args = (
        features(ranges, physics, place),
        velocity,
        *slots,
        *(e.lon, e.lat, e.status, e.release, e.ended, e.edge, e.log_weight),
        *(e.down_slope, e.down_offset, e.right_slope, e.right_offset, e.left_slope, e.left_offset),
        *(e.side, e.sinks, e.afloat),
        *(e.current_error_east, e.current_error_north, e.wind_error_east, e.wind_error_north),
        *(e.current_bias_east, e.current_bias_north),
        *(tiles.nodes, tiles.where, tiles.scale, i32x6(ranges)),
        *(0, 1, direction, 0, seed0, seed1),
        *physics,
        *(place.beach.stay, place.beach.offing, place.debris),
        *place.domain,
        *(place.coast or open_sea()),
    )
    move = launch.bind(_advance, args, ("elapsed", "duration", "step"))
    return lambda step: move(step.elapsed, step.duration, step.number)
