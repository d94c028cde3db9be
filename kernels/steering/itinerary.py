"""Itineraries of steering targets: their phases, and the draw of each next way point.

A target passes timed way points, one after the other. Properties fixed at birth (its start, its
speed, its side of a lane, its destination) are functions of its birth slot, so that copies made by
resampling keep them. Later random choices use the target's own slot as a key, so that copies
diverge.

All phases of all scenarios lie in one `Plan`. Times are whole seconds after the run's start.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import taichi as ti

from kernels.maths import angles, noise, sphere, spreads
from kernels.runtime import launch, runtime
from kernels.step.coast import Ints, Reals, is_wet
from kernels.step.prior import inside_ring

# Row lengths of the tables of a `Plan`.
STORY, STORY_LAW, PHASE, PHASE_LAW, POINT, POINT_LAW = 5, 5, 9, 18, 11, 14
BEHAVIOUR, VERTEX_IN_TIME = 8, 3

WAY, COURSE, LOITER, ACTS = range(4)  # kinds of phases
FREE, SEEKING, HIDING = range(1, 4)  # intentions of a target that acts, stored as its leg
NORMAL, BOX, DISC, RING, ACROSS, ASIDE = range(6)  # distributions of a way point's position
BY_SPEED, AT_TIME, NORMAL_TIME = range(3)  # distributions of its time

AWAY, BETWEEN, RATE, SHARE = range(4)  # distributions of the distress; AWAY: there is none
# bits of the effect of land: way points are drawn in water; a target stops at the shore
WET, STOPPED = 1, 2

NEVER = 2**31 - 1  # [s] later than any time of a run
# candidates of a way point, with a position in water and a feasible time; if none fits, the last
# one is used
TRIES = 256
TIMES = 256  # number of the first random words for times, after those for positions
WORDS = 512  # random words reserved for each piece of path
# [m] distance from the edge of its polygon at which a loitering target turns, so that rounding does
# not put it on the wrong side
INWARD = 10.0

f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)

# Tables of all itineraries: integers in one array, floats in another. `_at`: where a table begins
# in its array. Tables by phase, which are read most often, come first.
Plan = ti.types.argpack(
    # By phase: kind; first way point, number of those that all targets pass, number of destinations
    # to choose from after them; first vertex of a ring, its vertices; end [s], longest duration
    # [s]; earliest start [s], for times of way points; row of its behaviour.
    numbers=Ints,
    # By phase: course [rad] (4), speed [m/s] (4), start after the earliest [s] (4): see
    # spreads.triangle; mean time between changes of course [s], 0: none; mean length of a leg [m];
    # K [m/sqrt(s)], standard deviation of its logarithm; lowest and highest speed made good between
    # way points with times [m/s].
    laws=Reals,
    # Vertices (lon, lat) of rings; this offset counts pairs of numbers.
    vertices_at=ti.i32,
    # By scenario: first phase, the one after its last; bits of the effect of land; distribution of
    # the distress, and its earliest time [s].
    stories_at=ti.i32,
    # By way point: distribution of the position; lon, lat; first vertex of a ring, its vertices;
    # the ring's box (west, south, width, height); distribution of the time, and its begin or mean
    # [s after the start].
    points_at=ti.i32,
    # By vertex of the trackers' tracks: time [s], ascending in each; lon, lat
    tracks_at=ti.i32,
    # By scenario: distress after the earliest time [s], or by share of the voyage (4), see
    # spreads.triangle; its rate [1/s].
    story_laws_at=ti.i32,
    # By way point: major, minor axis [m] and orientation [rad from north] (of a lane: half width,
    # -, bearing of the displacement); distance from the way point before [m]; coefficients of the
    # deviation from the way point before: east of east, east of north, north of east, north of
    # north; time (4), see spreads.triangle, or its standard deviation [s]; largest cos(lat) in the
    # ring; cumulative probability of this destination.
    point_laws_at=ti.i32,
    # By behaviour: shortest and longest time between acts [s]; probabilities to change course, to
    # seek, to hide, and to stop either; half sector of hiding courses [rad]; highest speed [m/s].
    # Its phase's vertices are those of `tracks`.
    behaviours_at=ti.i32,
)
# tables in their order in the arrays
NUMBERS = ("phases", "vertices", "stories", "points", "tracks")
LAWS = ("phase_laws", "story_laws", "point_laws", "behaviours")


def packed(tables: Mapping[str, np.ndarray]) -> Any:
    """Return a `Plan` from named flat tables: int32 those of NUMBERS, float32 those of LAWS.

    `vertices` holds lon, lat of rings.
    """
    whole = {
        **tables,
        "phases": np.append(tables["phases"], np.zeros(tables["phases"].size % 2, np.int32)),
    }
    arrays, begins = [], {}
    for names in (NUMBERS, LAWS):
        ends = np.cumsum([whole[name].size for name in names]).tolist()
        begins |= {f"{name}_at": begin for name, begin in zip(names, [0, *ends], strict=False)}
        arrays.append(runtime.upload(np.concatenate([whole[name] for name in names])))
    begins["vertices_at"] //= 2
    return launch.pack(Plan, *arrays, *(begins[name] for name in list(Plan.members)[2:]))


@ti.dataclass
class Target:
    """A target's dead-reckoned position, its next way point, and how far the current has set it."""

    lon: ti.i32
    lat: ti.i32
    time: ti.i32  # [s]
    phase: ti.i32  # number in the `Plan`
    # number of the next way point; when loitering, see `_loiter`; when acting, FREE, SEEKING or
    # HIDING
    leg: ti.i32
    to_lon: ti.i32
    to_lat: ti.i32
    to_time: ti.i32  # [s] when the way point is reached, or the course is changed
    phase_end: ti.i32  # [s]
    course: ti.f32  # [rad]
    speed: ti.f32  # [m/s]
    over: ti.i32  # 1: it has reached its last way point
    # [binary angle] set by the current at `set_since`; 0 for targets that correct for the current
    set_lon: ti.i32
    set_lat: ti.i32
    rate_lon: ti.f32  # [binary angle/s] velocity of the set
    rate_lat: ti.f32
    set_since: ti.i32  # [s]


@ti.dataclass
class Chance:
    """The key of one target's random numbers."""

    seed0: ti.u32
    seed1: ti.u32
    birth: ti.i32  # birth slot
    slot: ti.i32  # present slot
    step: ti.i32  # number of the lattice step
    count: ti.i32  # number of pieces of its path in the step so far


@ti.func
def settled(key: Chance, phase: ti.i32, number: ti.i32) -> ti.types.vector(4, ti.u32):
    """Return random words for a phase's properties that are fixed at birth.

    number: 0 for speed and destination, 1 for the start and K, 2 for the first course, 3 for the
    side of the lane, 4 for the distress.
    """
    return noise.further(key.seed0, key.seed1, noise.STREAM_BIRTH, key.birth, 8 * phase + number, 0)


@ti.func
def _drawn(key: Chance, number: ti.i32) -> ti.types.vector(4, ti.u32):
    """Return random words for a choice made under way."""
    return noise.further(
        key.seed0, key.seed1, noise.STREAM_AIM, key.slot, key.step, key.count * WORDS + number + 1
    )


@ti.func
def first(key: Chance, phase: ti.i32) -> Chance:
    """Return the key of a phase's first course, which is fixed at birth."""
    own = key
    own.slot, own.step, own.count = key.birth, phase, -1
    return own


@ti.func
def course_of(plan: ti.template(), key: Chance, phase: ti.i32):
    """Return a course [rad], a speed [m/s], and a random word for the time of the next change.

    They are drawn for a phase that keeps courses.
    """
    at = phase * PHASE_LAW
    w, v = _drawn(key, 0), _drawn(key, 1)
    course = spreads.triangle(law(plan.laws, at), noise.uniform(w[0]), noise.uniform(w[1]))
    speed = spreads.triangle(law(plan.laws, at + 4), noise.uniform(v[0]), noise.uniform(v[1]))
    return course, speed, w[2]


@ti.func
def law(table: ti.template(), first: ti.i32) -> f32x4:
    """Return the four parameters of a distribution, see spreads.triangle."""
    return f32x4(table[first], table[first + 1], table[first + 2], table[first + 3])


@ti.func
def _speed_of(plan: ti.template(), phase: ti.i32, words: ti.types.vector(4, ti.u32)) -> ti.f32:
    """Return the speed [m/s] fixed at birth for a phase; words: those of number 0."""
    speeds = law(plan.laws, phase * PHASE_LAW + 4)
    return spreads.triangle(speeds, noise.uniform(words[0]), noise.uniform(words[1]))


@ti.func
def own_speed(plan: ti.template(), key: Chance, phase: ti.i32) -> ti.f32:
    """Return the speed [m/s] fixed at birth for a phase."""
    return _speed_of(plan, phase, settled(key, phase, 0))


@ti.func
def own_start(plan: ti.template(), key: Chance, phase: ti.i32) -> ti.i32:
    """Return the start [s] of a phase's itinerary, from which offsets of its way points count."""
    w = settled(key, phase, 1)
    starts = law(plan.laws, phase * PHASE_LAW + 8)
    after = spreads.triangle(starts, noise.uniform(w[0]), noise.uniform(w[1]))
    return plan.numbers[phase * PHASE + 8] + ti.cast(ti.round(after), ti.i32)


@ti.func
def own_k(plan: ti.template(), key: Chance, phase: ti.i32) -> ti.f32:
    """Return the K [m/sqrt(s)] of a phase's bridges."""
    at = phase * PHASE_LAW + 14
    k, spread = plan.laws[at], plan.laws[at + 1]
    if spread > 0.0:
        w = settled(key, phase, 1)
        k *= ti.exp(spread * noise.normals(w[2], w[3])[0])
    return k


@ti.func
def _destination_of(
    plan: ti.template(), phase: ti.i32, words: ti.types.vector(4, ti.u32)
) -> ti.i32:
    """Return the number of a phase's destination, from 0; words: those of number 0."""
    u = noise.uniform(words[3])
    row = phase * PHASE
    first, many = plan.numbers[row + 1] + plan.numbers[row + 2], plan.numbers[row + 3]
    at = plan.point_laws_at + first * POINT_LAW + 13
    chosen = 0
    while chosen < many - 1 and u > plan.laws[at + chosen * POINT_LAW]:
        chosen += 1
    return chosen


@ti.func
def own_destination(plan: ti.template(), key: Chance, phase: ti.i32) -> ti.i32:
    """Return the number of a phase's destination, from 0."""
    return _destination_of(plan, phase, settled(key, phase, 0))


@ti.func
def _in_ring(
    plan: ti.template(), lon: ti.i32, lat: ti.i32, west: ti.i32, first: ti.i32, many: ti.i32
):
    return inside_ring(lon, lat, west, plan.numbers, plan.vertices_at + first, many)


@ti.func
def draw_waypoint(
    plan: ti.template(),
    key: Chance,
    phase: ti.i32,
    point: ti.i32,
    before: f32x2,
    words: ti.types.vector(4, ti.u32),
):
    """Return (lon, lat, found): a candidate for a way point; found: 0 if it lies outside the ring.

    before: deviation (east, north) [m] of the target from the centre of the way point before.
    """
    n, at = plan.points_at + point * POINT, plan.point_laws_at + point * POINT_LAW
    kind, x, y = plan.numbers[n], plan.numbers[n + 1], plan.numbers[n + 2]
    found = 1
    if kind == RING:
        width, height = ti.cast(plan.numbers[n + 7], ti.u32), ti.cast(plan.numbers[n + 8], ti.u32)
        x = plan.numbers[n + 5] + ti.cast(
            ti.cast(words[0], ti.u64) * ti.cast(width, ti.u64) >> ti.u64(32), ti.i32
        )
        y = plan.numbers[n + 6] + ti.cast(
            ti.cast(words[1], ti.u64) * ti.cast(height, ti.u64) >> ti.u64(32), ti.i32
        )
        found = 0
        if noise.uniform(words[2]) * plan.laws[at + 12] < sphere.cos_lat(y):
            found = _in_ring(
                plan, x, y, plan.numbers[n + 5], plan.numbers[n + 3], plan.numbers[n + 4]
            )
    else:
        major, minor, turn = plan.laws[at], plan.laws[at + 1], plan.laws[at + 2]
        along, across = 0.0, 0.0
        if kind == ACROSS or kind == ASIDE:
            w = settled(key, phase, 3)
            along = major * (2.0 * noise.uniform(w[0]) - 1.0)
            if kind == ASIDE:
                along = major * noise.normals(w[0], w[1])[0]
        elif kind == BOX:
            along, across = (
                major * (2 * noise.uniform(words[0]) - 1),
                minor * (2 * noise.uniform(words[1]) - 1),
            )
        elif kind == DISC:
            r, t = (
                major * ti.sqrt(noise.uniform(words[0])),
                6.283185307179586 * noise.uniform(words[1]),
            )
            s, c = angles.sincos(t)
            along, across = r * c, r * s
        else:
            g = noise.normals(words[0], words[1])
            along, across = major * g[0], minor * g[1]
        s, c = angles.sincos(turn)
        east = (
            along * s + across * c + plan.laws[at + 4] * before[0] + plan.laws[at + 5] * before[1]
        )
        north = (
            along * c - across * s + plan.laws[at + 6] * before[0] + plan.laws[at + 7] * before[1]
        )
        x, y = sphere.exponential(x, y, east, north)
    return x, y, found


@ti.func
def when(plan: ti.template(), point: ti.i32, start: ti.i32, word: ti.u32, other: ti.u32) -> ti.i32:
    """Return a candidate for the time [s] of a way point that has its own time distribution."""
    at = plan.point_laws_at + point * POINT_LAW + 8
    after = 0.0
    if plan.numbers[plan.points_at + point * POINT + 9] == AT_TIME:
        after = spreads.triangle(law(plan.laws, at), noise.uniform(word), noise.uniform(other))
    else:
        after = plan.laws[at] * noise.normals(word, other)[0]
    return (
        start + plan.numbers[plan.points_at + point * POINT + 10] + ti.cast(ti.round(after), ti.i32)
    )


@ti.func
def set_at(target: Target, time: ti.i32):
    """Return (dlon, dlat) [binary angle] by which the current has set a target at a time [s]."""
    lasting = ti.cast(time - target.set_since, ti.f32)
    dlon = target.set_lon + ti.cast(ti.round(target.rate_lon * lasting), ti.i32)
    return dlon, target.set_lat + ti.cast(ti.round(target.rate_lat * lasting), ti.i32)


@ti.func
def on_course(plan: ti.template(), phase: ti.i32) -> ti.i32:
    """Return whether a phase keeps a course from one event to the next: a rhumb line."""
    kind = plan.numbers[phase * PHASE]
    return kind == COURSE or kind == ACTS


@ti.func
def aim(
    coastal: ti.i32,
    plan: ti.template(),
    key: Chance,
    story: ti.i32,
    target: Target,
    coast: ti.template(),
):
    """Return a target that has reached its way point, with the next one drawn.

    Its `over` is 1 if there is none.
    """
    t = target
    t.over = 0
    settling = 1
    while settling == 1:
        settling = 0
        if t.phase >= plan.numbers[plan.stories_at + story * STORY + 1]:
            t.over = 1
            t.to_lon, t.to_lat, t.to_time = t.lon, t.lat, NEVER
        else:
            row = t.phase * PHASE
            kind = plan.numbers[row]
            if t.leg == 0 and kind != WAY:
                lasting, until = plan.numbers[row + 7], plan.numbers[row + 6]
                t.phase_end = until
                if lasting < NEVER - t.time:
                    t.phase_end = ti.min(until, t.time + lasting)
            done = 0
            if kind == WAY:
                many = plan.numbers[row + 2] + ti.min(plan.numbers[row + 3], 1)
                done = ti.cast(t.leg >= many, ti.i32)
            else:
                done = ti.cast(t.time >= t.phase_end, ti.i32)
            if done == 1:
                t.phase, t.leg, settling = t.phase + 1, 0, 1
            elif kind == COURSE:
                t = _course(plan, key, t)
            elif kind == ACTS:
                t = _act(plan, key, t)
            else:
                point = -1
                w = settled(key, t.phase, 0)
                t.speed = _speed_of(plan, t.phase, w)
                if kind == WAY:
                    point = plan.numbers[row + 1] + t.leg
                    if t.leg >= plan.numbers[row + 2]:
                        point = plan.numbers[row + 1] + plan.numbers[row + 2]
                        point += _destination_of(plan, t.phase, w)
                else:
                    t, point = _loiter(plan, key, t)
                if point >= 0:
                    t = _way_point(coastal, plan, key, story, t, point, coast)
    return t


@ti.func
def _way_point(
    coastal: ti.i32,
    plan: ti.template(),
    key: Chance,
    story: ti.i32,
    target: Target,
    point: ti.i32,
    coast: ti.template(),
):
    """Return a target with its next way point drawn.

    The way point belongs to a route, a track or a bridge, or lies inside a polygon.
    """
    t = target
    before = f32x2(0.0)
    if t.leg > 0:
        n = plan.points_at + (plan.numbers[t.phase * PHASE + 1] + t.leg - 1) * POINT
        before = sphere.offset(plan.numbers[n + 1], plan.numbers[n + 2], t.lon, t.lat)
    at = t.phase * PHASE_LAW
    slowest, fastest = plan.laws[at + 16], plan.laws[at + 17]
    by_speed = plan.numbers[plan.points_at + point * POINT + 9] == BY_SPEED
    start = own_start(plan, key, t.phase)
    tries, good = 0, 0
    x, y, time, far = t.lon, t.lat, t.time, 0.0
    while good == 0 and tries < TRIES:
        x, y, good = draw_waypoint(plan, key, t.phase, point, before, _drawn(key, tries))
        if coastal == 1:
            if good == 1 and plan.numbers[plan.stories_at + story * STORY + 2] & WET:
                good = is_wet(x, y, coast)
        way = sphere.offset(t.lon, t.lat, x, y)
        far = ti.sqrt(way[0] * way[0] + way[1] * way[1])
        if not by_speed:
            w = _drawn(key, TIMES + tries)
            time = when(plan, point, start, w[0], w[1])
            lasting = ti.cast(time - t.time, ti.f32)
            if lasting < 1.0 or far > fastest * lasting or far < slowest * lasting:
                good = 0
        tries += 1
    if by_speed:
        length = plan.laws[plan.point_laws_at + point * POINT_LAW + 3]
        if t.leg == 0:
            length = far
        time = t.time + ti.max(ti.cast(ti.round(length / t.speed), ti.i32), 1)
    elif good == 0:  # no candidate is feasible: it arrives as soon as it can
        time = t.time + ti.max(ti.cast(ti.ceil(far / fastest), ti.i32), 1)
    t.to_lon, t.to_lat, t.to_time, t.leg = x, y, time, t.leg + 1
    return t


@ti.func
def _course(plan: ti.template(), key: Chance, target: Target):
    """Return a target with a course, a speed, and the time of the next change drawn."""
    t = target
    rate = plan.laws[t.phase * PHASE_LAW + 12]
    own = key
    if t.leg == 0:
        own = first(key, t.phase)
    t.course, t.speed, word = course_of(plan, own, t.phase)
    t.to_time = t.phase_end
    if rate > 0.0:
        wait = spreads.waiting(rate, noise.uniform(word))
        if wait < ti.cast(t.phase_end - t.time, ti.f32):
            t.to_time = t.time + ti.max(ti.cast(ti.round(wait), ti.i32), 1)
    t.to_lon, t.to_lat, t.leg = t.lon, t.lat, 1
    return t


@ti.func
def _act(plan: ti.template(), key: Chance, target: Target):
    """Return a target after one of its acts, with the time of the next act drawn.

    It keeps its course, takes any other at any speed, or starts to seek or hide. From then on, at
    each act, it aims to intercept the tracker, assuming that the tracker keeps its course, or about
    the reciprocal of the tracker's bearing (Borovies 2007, Naval Postgraduate School,
    hdl.handle.net/10945/3648, figure 50). kernels.tracking.follower does the same for a tracker's
    clouds.
    """
    t = target
    row = plan.behaviours_at + plan.numbers[t.phase * PHASE + 8] * BEHAVIOUR
    w = _drawn(key, 0)
    if t.leg == 0:
        own = first(key, t.phase)
        t.course, t.speed, _word = course_of(plan, own, t.phase)
        t.leg, w = FREE, _drawn(own, 2)
    else:
        was, choice = t.leg, noise.uniform(w[0])
        hide, seek = plan.laws[row + 4], plan.laws[row + 3]
        if was != FREE:
            if choice < plan.laws[row + 5]:
                t.leg = FREE
        elif choice > 1.0 - hide:
            t.leg = HIDING
        elif choice > 1.0 - hide - seek:
            t.leg = SEEKING
        elif choice < plan.laws[row + 2]:
            t.course = 6.283185307179586 * noise.uniform(w[1])
            t.speed = plan.laws[row + 7] * noise.uniform(w[2])
        if t.leg != FREE:
            t.course = _reaction(plan, t, row, noise.uniform(w[1]))
    soonest, latest = plan.laws[row], plan.laws[row + 1]
    wait = soonest + (latest - soonest) * noise.uniform(w[3])
    t.to_time = t.phase_end
    if wait < ti.cast(t.phase_end - t.time, ti.f32):
        t.to_time = t.time + ti.max(ti.cast(ti.round(wait), ti.i32), 1)
    t.to_lon, t.to_lat = t.lon, t.lat
    return t


@ti.func
def _reaction(plan: ti.template(), t: Target, row: ti.i32, uniform: ti.f32) -> ti.f32:
    """Return the course [rad] of a target that seeks or hides from its tracker.

    The tracker's position is the present one.
    """
    tracker = t.phase * PHASE + 4
    x, y, pace = _tracker_at(plan, plan.numbers[tracker], plan.numbers[tracker + 1], t.time)
    dlon, dlat = set_at(t, t.time)
    sight = sphere.offset(t.lon + dlon, t.lat + dlat, x, y)
    course = angles.atan2(sight[0], sight[1])
    if t.leg == HIDING:
        course += 3.141592653589793 + (2.0 * uniform - 1.0) * plan.laws[row + 6]
    else:
        # With equal velocities across the line of sight, the bearing stays constant and they meet.
        back = sphere.offset(x, y, t.lon + dlon, t.lat + dlat)
        far = ti.sqrt(back[0] * back[0] + back[1] * back[1])
        lead = (pace[1] * back[0] - pace[0] * back[1]) / ti.max(far * t.speed, 1e-6)
        recedes = -(pace[0] * back[0] + pace[1] * back[1]) / ti.max(far, 1e-6)
        if ti.abs(lead) < 1.0 and t.speed * ti.sqrt(ti.max(1.0 - lead * lead, 0.0)) > recedes:
            course += angles.asin(lead)
    return course


@ti.func
def _tracker_at(plan: ti.template(), vertex: ti.i32, many: ti.i32, time: ti.i32):
    """Return (lon, lat, velocity east and north [m/s]) of a tracker at a time [s].

    Before and after its track it is stationary.
    """
    low, high = 0, many - 1
    while low < high:
        middle = (low + high) // 2
        if plan.numbers[plan.tracks_at + (vertex + middle) * VERTEX_IN_TIME] > time:
            high = middle
        else:
            low = middle + 1
    # `low` is the first vertex after the time, or the last of all.
    b = plan.tracks_at + (vertex + low) * VERTEX_IN_TIME
    a = b - ti.select(low > 0, VERTEX_IN_TIME, 0)
    x, y, velocity = plan.numbers[b + 1], plan.numbers[b + 2], f32x2(0.0)
    if plan.numbers[b] > time:
        x, y = plan.numbers[a + 1], plan.numbers[a + 2]
        if plan.numbers[a] <= time:
            way = sphere.offset(x, y, plan.numbers[b + 1], plan.numbers[b + 2])
            share = ti.cast(time - plan.numbers[a], ti.f32) / ti.cast(
                plan.numbers[b] - plan.numbers[a], ti.f32
            )
            x, y = sphere.exponential(x, y, share * way[0], share * way[1])
            # Use the farther end: positions are rounded to 9 mm.
            if share < 0.5:
                velocity = sphere.offset(x, y, plan.numbers[b + 1], plan.numbers[b + 2])
                velocity /= ti.cast(plan.numbers[b] - time, ti.f32)
            else:
                velocity = sphere.offset(x, y, plan.numbers[a + 1], plan.numbers[a + 2])
                velocity /= ti.cast(plan.numbers[a] - time, ti.f32)
    return x, y, velocity


@ti.func
def _loiter(plan: ti.template(), key: Chance, target: Target):
    """Return a target with its next leg inside the polygon of its phase, and -1.

    The leg is a great circle of exponential length in a random direction. At the polygon's edge it
    is reflected and its length drawn again, as the exponential distribution has no memory. A
    uniform distribution in the polygon thus stays uniform. leg: 0 at the phase's begin, 1 inside, 2
    + k at edge k.

    A target outside the polygon first goes to a random place in it: the way point whose number is
    returned instead of -1.
    """
    t = target
    row, first = t.phase * PHASE, t.phase * PHASE_LAW
    vertex, many = plan.numbers[row + 4], plan.numbers[row + 5]
    w = _drawn(key, 0)
    if t.leg < 2:
        t.course = 6.283185307179586 * noise.uniform(w[0])
    else:
        a, b = vertex + t.leg - 2, vertex + ti.select(t.leg - 1 < many, t.leg - 1, 0)
        a, b = 2 * (plan.vertices_at + a), 2 * (plan.vertices_at + b)
        edge = sphere.offset(
            plan.numbers[a], plan.numbers[a + 1], plan.numbers[b], plan.numbers[b + 1]
        )
        t.course = 2.0 * angles.atan2(edge[0], edge[1]) - t.course
    length = spreads.waiting(plan.laws[first + 13], noise.uniform(w[1]))
    length = ti.min(length, t.speed * ti.cast(t.phase_end - t.time, ti.f32))
    s, c = angles.sincos(t.course)
    # Great circles are straight in the gnomonic plane of the target, where the tangent of an arc is
    # its length.
    hit, crossed = -1, 0
    reach = angles.tan(ti.min(length * ti.f32(1.0 / sphere.RADIUS), 1.5))
    before = f32x2(0.0)
    for k in range(many + 1):  # start with the last vertex
        q = _gnomonic(plan, t.lon, t.lat, vertex + ti.select(k > 0, k - 1, many - 1))
        ex, ey = q[0] - before[0], q[1] - before[1]
        left, left_before = q[0] * c - q[1] * s > 0.0, before[0] * c - before[1] * s > 0.0
        if k > 0 and left != left_before:
            along = (before[0] * ey - before[1] * ex) / (s * ey - c * ex)
            if along > 0.0:
                crossed += 1
                if along < reach:
                    # the edge from the vertex before to this one
                    reach, hit = along, (k + many - 2) % many
        before = q
    point = -1
    if crossed & 1 == 1:
        t.leg = 1
        if hit >= 0:
            t.leg = 2 + hit
            length = ti.max(angles.atan2(reach, 1.0) * ti.f32(sphere.RADIUS) - INWARD, 0.0)
        t.to_lon, t.to_lat = sphere.exponential(t.lon, t.lat, length * s, length * c)
        t.to_time = t.time + ti.max(ti.cast(ti.round(length / t.speed), ti.i32), 1)
    else:
        point, t.leg = plan.numbers[row + 1], 0  # on arrival its leg is 1
    return t, point


@ti.func
def _gnomonic(plan: ti.template(), lon: ti.i32, lat: ti.i32, vertex: ti.i32) -> f32x2:
    """Return a vertex (east, north) in the gnomonic plane of a position, in radii of the Earth."""
    at = 2 * (plan.vertices_at + vertex)
    way = sphere.offset(lon, lat, plan.numbers[at], plan.numbers[at + 1])
    far = ti.sqrt(way[0] * way[0] + way[1] * way[1])
    scale = ti.f32(1.0 / sphere.RADIUS)
    if far > 1.0:
        scale = angles.tan(ti.min(far * ti.f32(1.0 / sphere.RADIUS), 1.5)) / far
    return way * scale
