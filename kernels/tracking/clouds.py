"""Clouds: a tracker's particle sets for rarely detected targets, updated by sweeps.

A cloud is one tracker's particle set for one target: at most `size` particles, the valid ones
first; see `kernels.tracking.follower`. A sweep with a detection keeps the particles in the
detection's box; a sweep without one keeps those outside the sensor's reach. When too few remain,
the cloud is refilled by duplicates or by a new draw from the detection's box, or the track is lost.

If there is a coast, particles are drawn in water and stay there.

The methods are the heuristics of Borovies 2007 (see drift.tracking.tracker), not Bayesian updates.
One thread processes one cloud, so that results do not depend on the number of threads.
"""

from typing import Any

import taichi as ti

from geo.errors import UserError
from kernels.maths import doubles, noise
from kernels.runtime import launch, runtime
from kernels.step.coast import Coast, DeviceCoast, is_wet, open_sea
from kernels.tracking.follower import (
    ACTING,
    FAR,
    NEVER,
    Cloud,
    Doubles,
    DoubleTable,
    IntTable,
    Leg,
    Legs,
    Own,
    Rule,
    Rules,
    act,
    along,
    anchor,
    anchor_and_tangent,
    binary,
    clock,
    cloud_words,
    copied,
    f64x3,
    frame,
    headed,
    keep_off,
    turned,
    unit,
    vector,
)
from kernels.tracking.levels import level

# outcomes of a sweep; MARK: no sweep, only an estimate
SILENT, DETECTED, MARK = range(3)
# how a cloud is refilled: the last three from a detection's box
DUPLICATE, WEIGHTED, AIMED, COMBINED = range(4)

BLOCK = 512  # loop iterations that Taichi never splits between threads: one cloud in each
# least weight, as a share of the highest speed: a tenth of a knot if that is 32
LEAST = 0.1 / 32
PLACES = 64  # positions drawn for a particle until one is in water; without one it is dropped


class Track:
    """Columns of the tables of clouds: see kernels.tracking.follower.Own."""

    ESTIMATE = 0  # last estimate: unit vector, speed [rad/s] (< 0: none yet) and time [s]
    LOST = 5  # [s] last loss of the track; NaN: never
    # At the last time with detections: share of the cloud that they kept before the refill, < 0:
    # none; 1 if so few were kept that the cloud was redrawn; that time [s].
    LEFT = 6
    WAY = 9  # mean velocity [1/s] of the last estimate, a vector
    REAL = 12

    RUN = 0  # key of the random numbers: clouds of one run share them
    RULES = 1  # row of Rules
    FIRST = 2  # first of its sweeps; `last`: after its last one
    LAST = 3
    FIRST_LEG = 4  # its tracker's legs
    LAST_LEG = 5
    FIRST_ROW = 6  # first row of its estimates; a sweep's row is this and its `row`
    COUNT = 7  # valid particles
    DRAWN = 8  # particles drawn so far
    WHOLE = 9


class Sweep:
    """Columns of the tables of sweeps."""

    TIME = 0  # [s]
    PLACE = 1  # unit vector of the sensor; at a mark that of the target
    BEARING = 4  # [rad] of the detection
    HALF = 5  # [rad] half width of its box; pi: all round
    NEAR = 6  # [rad] ranges of its box, or the reach of a sensor without detection
    FAR = 7
    REAL = 8

    OUTCOME = 0  # SILENT, DETECTED or MARK
    ROW = 1  # row of the estimates, or -1
    WHOLE = 2


Tracks = ti.types.argpack(track_real=DoubleTable, track_whole=IntTable)
Sweeps = ti.types.argpack(sweep_real=DoubleTable, sweep_whole=IntTable)

# An estimate; velocities [rad/s]. level: share of the cloud in denser places than the target; NaN:
# not computed. lost: last loss of the track [s]; left, anew: see Track. `fix` and `way`: the
# estimate at the last detection, its mean velocity [1/s] as vectors, and `since`, its time [s]; NaN
# before the first. From `lost` on they are written even without a track.
FIELDS = (
    *("x", "y", "z", "east", "north", "rate", "count", "total", "level", "lost", "left", "anew"),
    *("fix_x", "fix_y", "fix_z", "way_x", "way_y", "way_z", "since"),
)
WIDE = len(FIELDS)


@ti.func
def apply_sweep(
    coastal: ti.template(),
    cloud: ti.template(),
    rules: ti.template(),
    sweeps: ti.template(),
    legs: ti.template(),
    e: ti.i32,
    base: ti.i32,
    count: ti.i32,
    law: ti.i32,
    first_leg: ti.i32,
    last_leg: ti.i32,
    run: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    coast: ti.template(),
):
    """Let particles act until sweep e, and keep those consistent with it, moved to the front.

    Returns the number kept, the least squared chord from the sensor to any particle before, the sum
    of weights before, and sums over the particles kept: of weights, and by weight of speeds,
    positions and velocities.
    """
    time, outcome, bearing, half = (
        sweeps.sweep_real[e, Sweep.TIME],
        sweeps.sweep_whole[e, Sweep.OUTCOME],
        sweeps.sweep_real[e, Sweep.BEARING],
        sweeps.sweep_real[e, Sweep.HALF],
    )
    s = vector(sweeps.sweep_real, e, Sweep.PLACE)
    east, north = frame(s)
    bearing_sine, bearing_cosine = doubles.sincos(bearing)
    ahead = north * bearing_cosine + east * bearing_sine
    aside = east * bearing_cosine - north * bearing_sine
    sine, cosine = doubles.sincos(half)
    all_round = half > ti.f64(3.14159265)
    near, far = _chord(sweeps.sweep_real[e, Sweep.NEAR]), _chord(sweeps.sweep_real[e, Sweep.FAR])
    left, nearest = 0, ti.f64(4.0)
    whole, total, rate = ti.f64(0.0), ti.f64(0.0), ti.f64(0.0)
    mean, velocity = f64x3(0.0, 0.0, 0.0), f64x3(0.0, 0.0, 0.0)
    for j in range(count):
        i = base + j
        whole += cloud.own_real[i, Own.WEIGHT]
        acting = 1
        while acting == 1:
            acting = ti.cast(cloud.own_real[i, Own.DUE] <= time, ti.i32)
            if ti.static(coastal):
                keep_off(
                    cloud,
                    i,
                    ti.min(cloud.own_real[i, Own.DUE], time),
                    rules.rule_real[law, Rule.FASTEST],
                    run,
                    seed0,
                    seed1,
                    coast,
                )
            if acting == 1:
                act(cloud, rules, legs, i, law, first_leg, last_leg, run, seed0, seed1)
                cloud.own_real[i, Own.FREE] = cloud.own_real[i, Own.SINCE]
        p0, u0 = anchor_and_tangent(cloud, i)
        angle = cloud.own_real[i, Own.RATE] * (time - cloud.own_real[i, Own.SINCE])
        p, u = turned(p0, u0, angle)
        if angle > FAR:
            p, u = along(p0, u0, angle)
            anchor(cloud, i, p.normalized(), u.normalized(), time)
        keep = True
        if outcome != MARK:
            apart = p - s
            squared = apart.dot(apart)
            inside = squared <= far * far and squared >= near * near
            nearest = ti.min(nearest, squared)
            if inside and not all_round:
                # The angle off the bearing must be at most `half`, of 0 to pi, where sin(half -
                # angle) is not negative.
                inside = sine * p.dot(ahead) >= cosine * ti.abs(p.dot(aside))
            keep = inside == (outcome == DETECTED)
        if keep:
            if left < j:
                copied(cloud, i, base + left)
            left += 1
            w = cloud.own_real[i, Own.WEIGHT]
            total += w
            rate += w * cloud.own_real[i, Own.RATE]
            mean += p * w
            velocity += u * (w * cloud.own_real[i, Own.RATE])
    return left, nearest, whole, total, rate, mean, velocity


@ti.func
def _chord(angle: ti.f64) -> ti.f64:
    """Return the chord of an arc [rad] of the unit sphere."""
    return doubles.sin(angle * 0.5) * 2.0


@ti.func
def _drawn_anew(
    coastal: ti.template(),
    cloud: ti.template(),
    tracks: ti.template(),
    rules: ti.template(),
    sweeps: ti.template(),
    e: ti.i32,
    k: ti.i32,
    count: ti.i32,
    size: ti.i32,
    drawn: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    coast: ti.template(),
):
    """Refill a cloud from a detection's box; return the numbers of valid and of drawn particles.

    The last estimate weights the new particles, or gives their origin; without an estimate all are
    equally likely.
    """
    law, run, base, time, bearing = (
        tracks.track_whole[k, Track.RULES],
        tracks.track_whole[k, Track.RUN],
        k * size,
        sweeps.sweep_real[e, Sweep.TIME],
        sweeps.sweep_real[e, Sweep.BEARING],
    )
    s = vector(sweeps.sweep_real, e, Sweep.PLACE)
    east, north = frame(s)
    # Of two detections at one time, the first gives no speed.
    old = f64x3(
        tracks.track_real[k, Track.ESTIMATE],
        tracks.track_real[k, Track.ESTIMATE + 1],
        tracks.track_real[k, Track.ESTIMATE + 2],
    )
    pace, since = tracks.track_real[k, Track.ESTIMATE + 3], tracks.track_real[k, Track.ESTIMATE + 4]
    known = pace >= 0.0 and time > since
    elapsed = ti.max(time - since, ti.f64(1e-9))
    high = rules.rule_real[law, Rule.FASTEST]
    low, least = 2.0 * pace - high, high * LEAST
    by_place = known and rules.rule_real[law, Rule.METHOD] != AIMED
    by_course = known and rules.rule_real[law, Rule.METHOD] != WEIGHTED
    mean = ti.f64(0.0)
    for j in range(count):
        if by_place:
            cloud.own_real[base + j, Own.WEIGHT] = ti.max(high - pace, least)
        mean += cloud.own_real[base + j, Own.WEIGHT]
    mean = mean / ti.cast(count, ti.f64) if count > 0 else ti.f64(1.0)
    there = count
    for j in range(count, size):
        i, serial = base + there, drawn + j - count
        a = cloud_words(seed0, seed1, noise.STREAM_CLOUD, run, serial, 0)
        b = cloud_words(seed0, seed1, noise.STREAM_CLOUD, run, serial, 1)
        p, wet, tried = s, 0, 0
        while wet == 0 and tried < PLACES:
            place = a
            if tried > 0:
                place = cloud_words(seed0, seed1, noise.STREAM_CLOUD, run, serial, 1 + tried)
            distance = sweeps.sweep_real[e, Sweep.NEAR] + unit(place[0]) * (
                sweeps.sweep_real[e, Sweep.FAR] - sweeps.sweep_real[e, Sweep.NEAR]
            )
            way = bearing + (2.0 * unit(place[1]) - 1.0) * sweeps.sweep_real[e, Sweep.HALF]
            p, _onward = along(s, headed(north, east, way), distance)
            wet = 1
            if ti.static(coastal):
                lon, lat = binary(p)
                wet = is_wet(lon, lat, coast)
            tried += 1
        own_east, own_north = frame(p)
        course, rate = unit(a[2]) * ti.f64(6.283185307179586), unit(a[3]) * high
        u = headed(own_north, own_east, course)
        apart = p - old
        gone = 2.0 * doubles.asin(ti.min(0.5 * ti.sqrt(apart.dot(apart)), ti.f64(1.0)))
        need = gone / elapsed
        if by_course and unit(b[0]) < 0.5:
            rate = ti.min(need, high)
            u = (p * doubles.cos(gone) - old).normalized(ti.f64(1e-15))
        weight = mean
        if by_place:
            weight = ti.max(need - low if need < pace else high - need, least)
        anchor(cloud, i, p, u, time)
        cloud.own_real[i, Own.RATE], cloud.own_real[i, Own.WEIGHT], cloud.own_whole[i, Own.MODE] = (
            rate,
            weight,
            ACTING,
        )
        cloud.own_whole[i, Own.SERIAL], cloud.own_whole[i, Own.ACTS], cloud.own_real[i, Own.DUE] = (
            serial,
            0,
            clock(rules, law, time, b[1]),
        )
        cloud.own_real[i, Own.FREE] = time
        there += wet
    return there, drawn + size - count


@ti.func
def _duplicated(
    cloud: ti.template(),
    rules: ti.template(),
    base: ti.i32,
    count: ti.i32,
    size: ti.i32,
    drawn: ti.i32,
    law: ti.i32,
    time: ti.f64,
    run: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
):
    """Refill a cloud with duplicates, sampled by weight; return how many it has drawn so far.

    A duplicate keeps its weight, but neither its intention nor its time to act.
    """
    total = ti.f64(0.0)
    for j in range(count):
        total += cloud.own_real[base + j, Own.WEIGHT]
        cloud.own_real[base + j, Own.SCRATCH] = total
    for j in range(count, size):
        i, serial = base + j, drawn + j - count
        b = cloud_words(seed0, seed1, noise.STREAM_CLOUD, run, serial, 1)
        want, low, high = unit(b[0]) * total, 0, count - 1
        while low < high:
            middle = (low + high) // 2
            if cloud.own_real[base + middle, Own.SCRATCH] < want:
                low = middle + 1
            else:
                high = middle
        copied(cloud, base + low, i)
        (
            cloud.own_whole[i, Own.MODE],
            cloud.own_whole[i, Own.SERIAL],
            cloud.own_whole[i, Own.ACTS],
        ) = ACTING, serial, 0
        cloud.own_real[i, Own.DUE] = clock(rules, law, time, b[1])
    return drawn + size - count


@ti.func
def _summed(cloud: ti.template(), base: ti.i32, count: ti.i32, time: ti.f64):
    """Return a cloud's sums at a time [s]: (weights, speeds, positions, velocities).

    All but the first are sums by weight.
    """
    total, rate = ti.f64(0.0), ti.f64(0.0)
    mean, velocity = f64x3(0.0, 0.0, 0.0), f64x3(0.0, 0.0, 0.0)
    for j in range(count):
        i = base + j
        p0, u0 = anchor_and_tangent(cloud, i)
        p, u = turned(p0, u0, cloud.own_real[i, Own.RATE] * (time - cloud.own_real[i, Own.SINCE]))
        w = cloud.own_real[i, Own.WEIGHT]
        total += w
        rate += w * cloud.own_real[i, Own.RATE]
        mean += p * w
        velocity += u * (w * cloud.own_real[i, Own.RATE])
    return total, rate, mean, velocity


@ti.func
def _followed(
    coastal: ti.template(),
    areas: ti.i32,
    k: ti.i32,
    size: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    cloud: ti.template(),
    tracks: ti.template(),
    rules: ti.template(),
    sweeps: ti.template(),
    legs: ti.template(),
    estimates: ti.template(),
    coast: ti.template(),
):
    """Process the sweeps of cloud k."""
    law, run, base = tracks.track_whole[k, Track.RULES], tracks.track_whole[k, Track.RUN], k * size
    first_leg, last_leg = (
        tracks.track_whole[k, Track.FIRST_LEG],
        tracks.track_whole[k, Track.LAST_LEG],
    )
    count, drawn = tracks.track_whole[k, Track.COUNT], tracks.track_whole[k, Track.DRAWN]
    quickest = rules.rule_real[law, Rule.FASTEST]
    for leg in range(first_leg, last_leg):
        quickest = ti.max(
            quickest, rules.rule_real[law, Rule.FASTEST] + legs.leg_real[leg, Leg.RATE]
        )
    # No particle comes within a chord of `clear` of the tracker before `clear_until`.
    clear, clear_until = ti.f64(0.0), ti.f64(-NEVER)
    for e in range(tracks.track_whole[k, Track.FIRST], tracks.track_whole[k, Track.LAST]):
        time, outcome, row, far = (
            sweeps.sweep_real[e, Sweep.TIME],
            sweeps.sweep_whole[e, Sweep.OUTCOME],
            sweeps.sweep_whole[e, Sweep.ROW],
            _chord(sweeps.sweep_real[e, Sweep.FAR]),
        )
        if outcome == SILENT and row < 0 and far <= clear and time < clear_until:
            continue
        before = count
        count, nearest, whole, total, rate, mean, velocity = apply_sweep(
            coastal,
            cloud,
            rules,
            sweeps,
            legs,
            e,
            base,
            before,
            law,
            first_leg,
            last_leg,
            run,
            seed0,
            seed1,
            coast,
        )
        clear_until = ti.f64(-NEVER)
        if outcome == SILENT and count == before:
            clear = far
            clear_until = time + 0.999 * (ti.sqrt(nearest) - far) / ti.max(quickest, ti.f64(1e-12))
        share = ti.cast(count, ti.f64) / ti.cast(size, ti.f64)
        few = share < rules.rule_real[law, Rule.BULK] or count == 0
        if outcome == DETECTED:
            if tracks.track_real[k, Track.LEFT + 2] != time:
                tracks.track_real[k, Track.LEFT], tracks.track_real[k, Track.LEFT + 1] = (
                    1.0 if before > 0 else -1.0,
                    0.0,
                )
                tracks.track_real[k, Track.LEFT + 2] = time
            if before > 0 and tracks.track_real[k, Track.LEFT] >= 0.0:
                tracks.track_real[k, Track.LEFT] *= total / whole
                if few:
                    tracks.track_real[k, Track.LEFT + 1] = 1.0
        if outcome == SILENT and count < before and share < rules.rule_real[law, Rule.BULK]:
            count = 0  # the track is lost
        elif outcome == DETECTED and few:
            count, drawn = _drawn_anew(
                coastal, cloud, tracks, rules, sweeps, e, k, count, size, drawn, seed0, seed1, coast
            )
            total, rate, mean, velocity = _summed(cloud, base, count, time)
        elif outcome != MARK and count > 0 and share < rules.rule_real[law, Rule.PARTIAL]:
            drawn = _duplicated(
                cloud, rules, base, count, size, drawn, law, time, run, seed0, seed1
            )
            count = size
            total, rate, mean, velocity = _summed(cloud, base, count, time)
        place = (tracks.track_whole[k, Track.FIRST_ROW] + row) * WIDE
        if before > 0 and count == 0:
            tracks.track_real[k, Track.LOST] = time
        if row >= 0:
            estimates[place + 9] = tracks.track_real[k, Track.LOST]
            estimates[place + 10], estimates[place + 11] = (
                tracks.track_real[k, Track.LEFT],
                tracks.track_real[k, Track.LEFT + 1],
            )
        if count > 0 and (outcome == DETECTED or row >= 0):
            mean, velocity, rate = mean.normalized(), velocity / total, rate / total
            if outcome == DETECTED:
                for d in ti.static(range(3)):
                    tracks.track_real[k, Track.ESTIMATE + d] = mean[d]
                (
                    tracks.track_real[k, Track.ESTIMATE + 3],
                    tracks.track_real[k, Track.ESTIMATE + 4],
                ) = rate, time
                for d in ti.static(range(3)):
                    tracks.track_real[k, Track.WAY + d] = velocity[d]
            if row >= 0:
                own_east, own_north = frame(mean)
                for d in ti.static(range(3)):
                    estimates[place + d] = mean[d]
                estimates[place + 3], estimates[place + 4] = (
                    velocity.dot(own_east),
                    velocity.dot(own_north),
                )
                estimates[place + 5], estimates[place + 6], estimates[place + 7] = (
                    rate,
                    ti.cast(count, ti.f64),
                    total,
                )
                if areas == 1 and outcome == MARK and count > 1:
                    estimates[place + 8] = level(
                        cloud,
                        base,
                        count,
                        time,
                        mean,
                        total,
                        vector(sweeps.sweep_real, e, Sweep.PLACE),
                    )
        if row >= 0 and tracks.track_real[k, Track.ESTIMATE + 3] >= 0.0:
            for d in ti.static(range(3)):
                estimates[place + 12 + d] = tracks.track_real[k, Track.ESTIMATE + d]
                estimates[place + 15 + d] = tracks.track_real[k, Track.WAY + d]
            estimates[place + 18] = tracks.track_real[k, Track.ESTIMATE + 4]
    tracks.track_whole[k, Track.COUNT], tracks.track_whole[k, Track.DRAWN] = count, drawn


@ti.kernel
def _follow(
    coastal: ti.template(),
    areas: ti.i32,
    clouds: ti.i32,
    size: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    cloud: Cloud,
    tracks: Tracks,
    rules: Rules,
    sweeps: Sweeps,
    legs: Legs,
    estimates: Doubles,
    coast: Coast,
):
    """Process the sweeps of every cloud, each by a thread of its own."""
    for turn in range(clouds * BLOCK):
        if turn % BLOCK == 0:
            _followed(
                coastal,
                areas,
                turn // BLOCK,
                size,
                seed0,
                seed1,
                cloud,
                tracks,
                rules,
                sweeps,
                legs,
                estimates,
                coast,
            )


def follow(
    areas: bool,
    size: int,
    seed: int,
    cloud: Any,
    tracks: Any,
    rules: Any,
    sweeps: Any,
    legs: Any,
    estimates: Any,
    coast: DeviceCoast | None = None,
) -> None:
    """Process the sweeps of clouds on the device, in place.

    Args:
        areas: whether to compute the target's level at marks.
        size: most particles of a cloud.
        seed: of the random numbers.
        cloud: device tables by name, the members of Cloud, clouds * size rows.
        tracks: the members of Tracks, a row per cloud.
        rules: the members of Rules.
        sweeps: the members of Sweeps.
        legs: the members of Legs.
        estimates: written, (rows * 19,), the FIELDS of each.
        coast: whose land particles avoid; None: they may be anywhere.

    Raises:
        UserError: on Metal, which lacks float64.
    """
    if runtime.backend() == "metal":
        raise UserError(
            "--backend metal: tracks are followed in float64, which Metal lacks; use --backend cpu"
        )
    seed0, seed1 = noise.key(seed)
    packs = [
        launch.pack(kind, *(columns[name] for name in kind.members))
        for kind, columns in (
            (Cloud, cloud),
            (Tracks, tracks),
            (Rules, rules),
            (Sweeps, sweeps),
            (Legs, legs),
        )
    ]
    sea = (coast or open_sea()).pack
    _follow(
        coast is not None,
        areas,
        tracks["track_whole"].shape[0],
        size,
        seed0,
        seed1,
        *packs,
        estimates,
        sea,
    )
