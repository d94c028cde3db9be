"""Itineraries: the phases of what steers, and how each draws the next way point when one is
reached.

A target follows way points with times, one after the other. What is settled at its birth (when it
starts, how fast it is, on which side of a lane it keeps, where it goes in the end) is a function of
its birth slot, so that a copy made by resampling keeps it; what chance decides later has the
target's own slot in its key, so that copies part.

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

# Numbers in a row of each table of a `Plan`.
STORY, STORY_LAW, PHASE, PHASE_LAW, POINT, POINT_LAW = 5, 5, 9, 18, 11, 14
BEHAVIOUR, VERTEX_IN_TIME = 8, 3

WAY, COURSE, LOITER, ACTS = range(4)  # kinds of phases
FREE, SEEKING, HIDING = range(1, 4)  # what a target that acts is about: its leg
NORMAL, BOX, DISC, RING, ACROSS, ASIDE = range(6)  # laws of a way point's place
BY_SPEED, AT_TIME, NORMAL_TIME = range(3)  # laws of its time

AWAY, BETWEEN, RATE, SHARE = range(4)  # laws of distress; the first: there is none
# bits of what land means: way points are drawn in water; a target that meets the shore stops there
WET, STOPPED = 1, 2

NEVER = 2**31 - 1  # [s] a time that does not come
TRIES = 256  # candidates of a way point: place in water and time in order; the last one stays
TIMES = 256  # the first number of words for times, after those for places
WORDS = 512  # numbers of words for each piece of way
# [m] before the edge of its polygon at which a loiterer turns, so that rounding puts it on no wrong
# side
INWARD = 10.0

f32x2 = ti.types.vector(2, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)

# The tables of all itineraries, those of whole numbers in one array, the others in another. `_at`:
# where a table begins in its array. Those by phase, which are read most, stand first.
Plan = ti.types.argpack(
    # By phase: kind; first way point, those all targets pass, destinations to choose from after
    # them; first vertex of a ring, its vertices; when it is over [s], how long it lasts at most
    # [s]; when it starts at the earliest [s], for times of way points; row of its behaviour.
    numbers=Ints,
    # By phase: course [rad] (4), speed [m/s] (4), start after the earliest [s] (4): see
    # spreads.triangle; mean time between changes of course [s], 0: none; mean length of a leg [m];
    # K [m/sqrt(s)], standard deviation of its logarithm; lowest and highest speed made good between
    # way points with times [m/s].
    laws=Reals,
    # Vertices (lon, lat) of rings; this one counts in pairs of numbers.
    vertices_at=ti.i32,
    # By scenario: first phase, the one after its last; bits of what land means; law of the
    # distress, and its earliest time [s].
    stories_at=ti.i32,
    # By way point: law of the place; lon, lat; first vertex of a ring, its vertices; the ring's box
    # (west, south, width, height); law of the time, and its beginning or mean [s after the start].
    points_at=ti.i32,
    # By vertex of the trackers' ways: time [s], ascending in each; lon, lat
    tracks_at=ti.i32,
    # By scenario: distress after the earliest time [s], or by share of the voyage (4), see
    # spreads.triangle; its rate [1/s].
    story_laws_at=ti.i32,
    # By way point: major, minor axis [m] and orientation [rad from north] (of a lane: half width,
    # -, bearing of the displacement); distance from the way point before [m]; how much of the
    # deviation from the way point before it has, east of east, east of north, north of east, north
    # of north; time (4), see spreads.triangle, or its standard deviation [s]; largest cos(lat) in
    # the ring; probability of this destination and those before.
    point_laws_at=ti.i32,
    # By behaviour: least and longest time between acts [s]; probability to change, to seek, to hide
    # and to leave that; sector on either side in which one hides [rad]; highest speed [m/s]. Its
    # phase's vertices are those of `tracks`.
    behaviours_at=ti.i32,
)
# tables in the order in which they stand
NUMBERS = ("phases", "vertices", "stories", "points", "tracks")
LAWS = ("phase_laws", "story_laws", "point_laws", "behaviours")


def packed(tables: Mapping[str, np.ndarray]) -> Any:
    """Return a `Plan` of tables by name, flat: int32 those of NUMBERS, float32 those of LAWS.

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
    """Where a target is and where it goes next, by its dead reckoning; and how far the current has
    set it off that.
    """

    lon: ti.i32
    lat: ti.i32
    time: ti.i32  # [s]
    phase: ti.i32  # number in the `Plan`
    # number of the next way point; of a loiter, see `_loiter`; of what acts, FREE, SEEKING or
    # HIDING
    leg: ti.i32
    to_lon: ti.i32
    to_lat: ti.i32
    to_time: ti.i32  # [s] when the way point is reached, or the course is changed
    phase_end: ti.i32  # [s]
    course: ti.f32  # [rad]
    speed: ti.f32  # [m/s]
    over: ti.i32  # 1: it has reached its last way point
    # [binary angle] how far off it was at `set_since`; nothing of what makes good the current
    set_lon: ti.i32
    set_lat: ti.i32
    rate_lon: ti.f32  # [binary angle/s] how fast it is set off
    rate_lat: ti.f32
    set_since: ti.i32  # [s]


@ti.dataclass
class Chance:
    """The key of what chance decides for one target."""

    seed0: ti.u32
    seed1: ti.u32
    birth: ti.i32  # slot in which it was born
    slot: ti.i32  # slot in which it is
    step: ti.i32  # number of the lattice step
    count: ti.i32  # how many pieces of way it has made in the step


@ti.func
def settled(key: Chance, phase: ti.i32, number: ti.i32) -> ti.types.vector(4, ti.u32):
    """Return words of what is settled at birth for a phase.

    number: 0 for speed and destination, 1 for the start and K, 2 for the first course, 3 for the
    side of the way.
    """
    return noise.further(key.seed0, key.seed1, noise.STREAM_BIRTH, key.birth, 8 * phase + number, 0)


@ti.func
def drawn(key: Chance, number: ti.i32) -> ti.types.vector(4, ti.u32):
    """Return words of what is drawn on the way."""
    return noise.further(
        key.seed0, key.seed1, noise.STREAM_AIM, key.slot, key.step, key.count * WORDS + number + 1
    )


@ti.func
def first(key: Chance, phase: ti.i32) -> Chance:
    """Return the key of a phase's first course, which is settled at birth."""
    own = key
    own.slot, own.step, own.count = key.birth, phase, -1
    return own


@ti.func
def course_of(plan: ti.template(), key: Chance, phase: ti.i32):
    """Return a course [rad] and a speed [m/s] of a phase that keeps them, and a word for when it
    changes them.
    """
    at = phase * PHASE_LAW
    w, v = drawn(key, 0), drawn(key, 1)
    course = spreads.triangle(law(plan.laws, at), noise.uniform(w[0]), noise.uniform(w[1]))
    speed = spreads.triangle(law(plan.laws, at + 4), noise.uniform(v[0]), noise.uniform(v[1]))
    return course, speed, w[2]


@ti.func
def law(table: ti.template(), first: ti.i32) -> f32x4:
    return f32x4(table[first], table[first + 1], table[first + 2], table[first + 3])


@ti.func
def speed_of(plan: ti.template(), phase: ti.i32, words: ti.types.vector(4, ti.u32)) -> ti.f32:
    """Return the speed [m/s] that is settled for a phase; words: those of number 0."""
    speeds = law(plan.laws, phase * PHASE_LAW + 4)
    return spreads.triangle(speeds, noise.uniform(words[0]), noise.uniform(words[1]))


@ti.func
def own_speed(plan: ti.template(), key: Chance, phase: ti.i32) -> ti.f32:
    """Return the speed [m/s] that is settled for a phase."""
    return speed_of(plan, phase, settled(key, phase, 0))


@ti.func
def own_start(plan: ti.template(), key: Chance, phase: ti.i32) -> ti.i32:
    """Return when [s] the itinerary of a phase starts: the time that offsets of its way points
    count from.
    """
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
def destination_of(plan: ti.template(), phase: ti.i32, words: ti.types.vector(4, ti.u32)) -> ti.i32:
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
    return destination_of(plan, phase, settled(key, phase, 0))


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
    """Return (lon, lat, found) of a way point: a candidate from its law; found: 0 if it missed the
    ring.

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
    """Return the time [s] of a way point that has one of its own: a candidate from its law."""
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
    """Return (dlon, dlat) [binary angle] by which the current has set a target off its
    dead-reckoned track at a time [s].
    """
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
    """Return a target that has reached its way point with the next one drawn; over: there is none."""
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
                t.speed = speed_of(plan, t.phase, w)
                if kind == WAY:
                    point = plan.numbers[row + 1] + t.leg
                    if t.leg >= plan.numbers[row + 2]:
                        point = plan.numbers[row + 1] + plan.numbers[row + 2]
                        point += destination_of(plan, t.phase, w)
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
    """Return a target with a way point drawn: of a route, a track or a bridge, or one inside a
    polygon.
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
        x, y, good = draw_waypoint(plan, key, t.phase, point, before, drawn(key, tries))
        if coastal == 1:
            if good == 1 and plan.numbers[plan.stories_at + story * STORY + 2] & WET:
                good = is_wet(x, y, coast)
        way = sphere.offset(t.lon, t.lat, x, y)
        far = ti.sqrt(way[0] * way[0] + way[1] * way[1])
        if not by_speed:
            w = drawn(key, TIMES + tries)
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
    elif good == 0:  # no candidate is in order: it arrives as soon as it can
        time = t.time + ti.max(ti.cast(ti.ceil(far / fastest), ti.i32), 1)
    t.to_lon, t.to_lat, t.to_time, t.leg = x, y, time, t.leg + 1
    return t


@ti.func
def _course(plan: ti.template(), key: Chance, target: Target):
    """Return a target with a course and a speed, and when it changes them."""
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
    """Return a target that has acted, and when it acts next.

    It keeps its course, takes any other at any speed, or seeks or hides from then on: at each of
    its acts it aims where it would meet the tracker, who is taken to keep its course, or about the
    reciprocal of the bearing to it (Borovies 2007, Naval Postgraduate School,
    hdl.handle.net/10945/3648, figure 50). kernels.tracking.follower does the same for a tracker's
    clouds.
    """
    t = target
    row = plan.behaviours_at + plan.numbers[t.phase * PHASE + 8] * BEHAVIOUR
    w = drawn(key, 0)
    if t.leg == 0:
        own = first(key, t.phase)
        t.course, t.speed, _word = course_of(plan, own, t.phase)
        t.leg, w = FREE, drawn(own, 2)
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
    """Return the course [rad] of a target that seeks or hides, as it sees its tracker now."""
    tracker = t.phase * PHASE + 4
    x, y, pace = tracker_at(plan, plan.numbers[tracker], plan.numbers[tracker + 1], t.time)
    dlon, dlat = set_at(t, t.time)
    sight = sphere.offset(t.lon + dlon, t.lat + dlat, x, y)
    course = angles.atan2(sight[0], sight[1])
    if t.leg == HIDING:
        course += 3.141592653589793 + (2.0 * uniform - 1.0) * plan.laws[row + 6]
    else:
        # What is across the line of sight must be the same for both: then the bearing stays and
        # they meet.
        back = sphere.offset(x, y, t.lon + dlon, t.lat + dlat)
        far = ti.sqrt(back[0] * back[0] + back[1] * back[1])
        lead = (pace[1] * back[0] - pace[0] * back[1]) / ti.max(far * t.speed, 1e-6)
        recedes = -(pace[0] * back[0] + pace[1] * back[1]) / ti.max(far, 1e-6)
        if ti.abs(lead) < 1.0 and t.speed * ti.sqrt(ti.max(1.0 - lead * lead, 0.0)) > recedes:
            course += angles.asin(lead)
    return course


@ti.func
def tracker_at(plan: ti.template(), vertex: ti.i32, many: ti.i32, time: ti.i32):
    """Return (lon, lat, velocity east and north [m/s]) of a tracker at a time [s]; before and after
    its way it stays.
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
            # By the farther of both ends: positions are whole units of 9 mm.
            if share < 0.5:
                velocity = sphere.offset(x, y, plan.numbers[b + 1], plan.numbers[b + 2])
                velocity /= ti.cast(plan.numbers[b] - time, ti.f32)
            else:
                velocity = sphere.offset(x, y, plan.numbers[a + 1], plan.numbers[a + 2])
                velocity /= ti.cast(plan.numbers[a] - time, ti.f32)
    return x, y, velocity


@ti.func
def _loiter(plan: ti.template(), key: Chance, target: Target):
    """Return a target with the next leg inside the polygon of its phase, and -1.

    The leg is a great circle of exponential length in any direction; at the polygon's edge it is
    reflected, with a length drawn again: an exponential law has no memory. So the law uniform in
    the polygon stays uniform. leg: 0 as the phase begins, 1 inside, 2 + k at edge k.

    A target that comes from outside goes in first, to any place in the polygon: the way point of
    the number returned.
    """
    t = target
    row, first = t.phase * PHASE, t.phase * PHASE_LAW
    vertex, many = plan.numbers[row + 4], plan.numbers[row + 5]
    w = drawn(key, 0)
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
    for k in range(many + 1):  # the last vertex comes first
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
        point, t.leg = plan.numbers[row + 1], 0  # where it arrives, its leg is 1
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
