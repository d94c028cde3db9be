"""Clouds of particles that follow targets which are rarely seen: moved, cut by sweeps of sensors and filled again.

A cloud is what one tracker knows of one target: at most `size` particles, those that count first. Each keeps a great
circle at its own speed from an anchor, and acts at times of its own (`Rules`). A sweep that detected something keeps
the particles in the box of the detection; one that found nothing keeps those outside the sensor's reach. What is left
of too few is filled again by duplicates, by a new draw from the detection's box, or the track is lost.

Where there is a coast particles keep to the water: they are drawn there, and one that comes to the shore takes another course.

The methods are the heuristics of Borovies 2007 (see drift.tracker), no Bayes. One thread takes one cloud, so that no
number depends on how many threads there are.
"""

from typing import Any

import taichi as ti

from kernels import launch, noise
from kernels.coast import Coast, DeviceCoast, clearance, first_crossing, is_wet, open_sea

Doubles = ti.types.ndarray(dtype=ti.f64, ndim=1)
Ints = ti.types.ndarray(dtype=ti.i32, ndim=1)
f64x3 = ti.types.vector(3, ti.f64)

SILENT, DETECTED, MARK = range(3)  # what a sweep came to; MARK: nothing was swept, the estimate is asked for
DUPLICATE, WEIGHTED, AIMED, COMBINED = range(4)  # how a cloud is filled: the last three from a detection's box
ACTING, SEEKING, HIDING = range(3)  # what a particle is about

BLOCK = 512  # turns of a loop that Taichi never parts between threads: one cloud in each
LEAST = 0.1 / 32  # least weight, as a share of the fastest speed: a tenth of a knot where that is 32
FAR = 0.05  # [rad] of way after which the anchor moves on; to twice that the series below hold to 1e-12
NEVER = 1e300  # [s]
UNIT = 6.283185307179586 / 4294967296.0  # [rad] of a binary angle
ALONG = 2e-4  # [rad] of way that is held against the shore as a straight line in longitude and latitude: 1.3 km, 3 cm off at 60 degrees
TURNS = 16  # courses that a particle tries at a place on the shore; then it goes back where it came from
NOWHERE = 1e-6  # [rad] of way: what makes less between two turns has not got away
PLACES = 64  # places drawn for a particle until one is in water; without one it is not there

Cloud = ti.types.argpack(
    own_place=Doubles,  # (3 n,) unit vector of the anchor
    own_way=Doubles,  # (3 n,) unit tangent there
    own_rate=Doubles,  # [rad/s]
    own_since=Doubles,  # [s] when it was at the anchor
    own_due=Doubles,  # [s] when it acts next
    own_weight=Doubles,
    own_mode=Ints,  # ACTING, SEEKING or HIDING
    own_serial=Ints,  # how many of its cloud were drawn before it: the key of its random numbers
    own_acts=Ints,  # how often it has acted
    own_free=Doubles,  # [s] until when its way is known to meet no shore
    own_heap=Doubles,  # scratch: sums of weights
)  # fmt: skip

Tracks = ti.types.argpack(
    track_run=Ints,  # key of the random numbers: clouds of one run share them
    track_rules=Ints,  # row of Rules
    track_first=Ints,  # its sweeps are those from `first` to before `last`
    track_last=Ints,
    track_first_leg=Ints,  # its tracker's legs
    track_last_leg=Ints,
    track_first_row=Ints,  # of the estimates: that of a sweep is this and its `row`
    track_count=Ints,  # particles that count
    track_drawn=Ints,  # particles drawn so far
    track_e_place=Doubles,  # (3 n,) stored estimate: unit vector
    track_e_rate=Doubles,  # [rad/s] its speed; < 0: there is none yet
    track_e_time=Doubles,  # [s]
)  # fmt: skip

Rules = ti.types.argpack(
    rule_change=Doubles,  # probability that a particle which acts takes another course and speed
    rule_seek=Doubles,  # that it seeks from then on
    rule_hide=Doubles,  # that it hides
    rule_leave=Doubles,  # that one which seeks or hides acts freely again
    rule_soonest=Doubles,  # [s] between acts; NEVER: particles do not act
    rule_latest=Doubles,
    rule_spread=Doubles,  # [rad] half of the sector about the reciprocal bearing in which one hides
    rule_fastest=Doubles,  # [rad/s]
    rule_partial=Doubles,  # share of particles below which duplicates are made
    rule_bulk=Doubles,  # share below which the box is drawn from anew, or the track is lost
    rule_method=Ints,  # WEIGHTED, AIMED or COMBINED
)

Sweeps = ti.types.argpack(
    sweep_time=Doubles,  # [s]
    sweep_place=Doubles,  # (3 n,) unit vector of the sensor; at a mark of the target
    sweep_bearing=Doubles,  # [rad] of the detection
    sweep_half=Doubles,  # [rad] its box on either side; pi: all round
    sweep_near=Doubles,  # [rad] its box, or how far a sensor reaches that found nothing
    sweep_far=Doubles,
    sweep_outcome=Ints,  # SILENT, DETECTED or MARK
    sweep_row=Ints,  # of the estimates, or -1
)  # fmt: skip

Legs = ti.types.argpack(  # of each way the last has no speed: there it stays
    leg_time=Doubles,  # [s]
    leg_place=Doubles,  # (3 n,) unit vector of its begin
    leg_way=Doubles,  # (3 n,) unit tangent there
    leg_rate=Doubles,  # [rad/s]
)

# Of an estimate; velocities [rad/s]. level: share of the cloud that lies where it is denser than at the target; NaN: not asked
FIELDS = ("x", "y", "z", "east", "north", "rate", "count", "total", "level")
SAME = 1e-9  # [rad] within which particles are at one place: 6 mm
PICKS = 101  # particles among which the target is ranked by density


@ti.func
def unit(word: ti.u32) -> ti.f64:
    """Return a uniform number in (0, 1)."""
    return (ti.cast(word, ti.f64) + ti.f64(0.5)) * ti.f64(1 / 4294967296)


@ti.func
def words(seed0: ti.u32, seed1: ti.u32, stream: ti.i32, run: ti.i32, serial: ti.i32, number: ti.i32):
    """Return four words for a particle of a run's clouds."""
    return noise.philox(
        ti.cast(serial, ti.u32), ti.cast(number, ti.u32), ti.cast(stream, ti.u32), ti.cast(run, ti.u32), seed0, seed1
    )


@ti.func
def vector(column: ti.template(), i: ti.i32) -> f64x3:
    """Return the vector in row i of a column of three numbers a row."""
    return f64x3(column[3 * i], column[3 * i + 1], column[3 * i + 2])


@ti.func
def frame(p: f64x3):
    """Return the unit vectors (east, north) at a place; at a pole those of longitude 0."""
    across = ti.sqrt(p[0] * p[0] + p[1] * p[1])
    east = f64x3(0.0, 1.0, 0.0)
    if across > ti.f64(1e-12):
        east = f64x3(-p[1] / across, p[0] / across, 0.0)
    return east, p.cross(east)


@ti.func
def turned(p: f64x3, u: f64x3, angle: ti.f64):
    """Return (place, tangent) after a way of an angle [rad], of at most twice FAR, from place and tangent."""
    y = angle * angle
    c = ti.f64(1.0) - y * (ti.f64(1 / 2) - y * (ti.f64(1 / 24) - y * ti.f64(1 / 720)))
    s = angle * (ti.f64(1.0) - y * (ti.f64(1 / 6) - y * (ti.f64(1 / 120) - y * ti.f64(1 / 5040))))
    return p * c + u * s, u * c - p * s


@ti.func
def along(p: f64x3, u: f64x3, angle: ti.f64):
    """Return (place, tangent) after a way of any angle [rad], as `turned` does: nobody may have looked for days."""
    q, v = turned(p, u, angle)
    if angle > 2 * FAR:
        q, v = p * ti.cos(angle) + u * ti.sin(angle), u * ti.cos(angle) - p * ti.sin(angle)
    return q, v


@ti.func
def at(cloud: ti.template(), i: ti.i32):
    """Return (anchor, tangent) of a particle."""
    return vector(cloud.own_place, i), vector(cloud.own_way, i)


@ti.func
def anchor(cloud: ti.template(), i: ti.i32, p: f64x3, u: f64x3, time: ti.f64):
    """Anchor a particle anew, at a place [unit vector] on a way [unit tangent], since a time [s]."""
    for d in ti.static(range(3)):
        cloud.own_place[3 * i + d], cloud.own_way[3 * i + d] = p[d], u[d]
    cloud.own_since[i] = time


@ti.func
def copied(cloud: ti.template(), i: ti.i32, to: ti.i32):
    """Write particle i over another."""
    p, u = at(cloud, i)
    anchor(cloud, to, p, u, cloud.own_since[i])
    cloud.own_rate[to], cloud.own_due[to], cloud.own_weight[to] = (
        cloud.own_rate[i],
        cloud.own_due[i],
        cloud.own_weight[i],
    )
    cloud.own_free[to] = cloud.own_free[i]
    cloud.own_mode[to], cloud.own_serial[to], cloud.own_acts[to] = (
        cloud.own_mode[i],
        cloud.own_serial[i],
        cloud.own_acts[i],
    )


@ti.func
def tracker_at(legs: ti.template(), first: ti.i32, last: ti.i32, time: ti.f64):
    """Return (place, tangent, rate) of a tracker at a time [s]."""
    leg = first
    while leg + 1 < last and legs.leg_time[leg + 1] <= time:
        leg += 1
    p, u = vector(legs.leg_place, leg), vector(legs.leg_way, leg)
    angle = legs.leg_rate[leg] * ti.max(time - legs.leg_time[leg], ti.f64(0.0))
    c, s = ti.cos(angle), ti.sin(angle)
    return p * c + u * s, u * c - p * s, legs.leg_rate[leg]


@ti.func
def act(
    cloud: ti.template(), rules: ti.template(), legs: ti.template(), i: ti.i32, law: ti.i32, first: ti.i32,
    last: ti.i32, run: ti.i32, seed0: ti.u32, seed1: ti.u32,
):  # fmt: skip
    """Have a particle act at its own time: keep its course, take another, seek or hide."""
    time = cloud.own_due[i]
    p0, u0 = at(cloud, i)
    p, u = along(p0, u0, cloud.own_rate[i] * (time - cloud.own_since[i]))
    cloud.own_acts[i] += 1
    drawn = words(seed0, seed1, noise.STREAM_ACT, run, cloud.own_serial[i], cloud.own_acts[i])
    choice, mode = unit(drawn[0]), cloud.own_mode[i]
    if mode != ACTING:
        mode = ACTING if choice < rules.rule_leave[law] else mode
    elif choice > 1.0 - rules.rule_hide[law]:
        mode = HIDING
    elif choice > 1.0 - rules.rule_hide[law] - rules.rule_seek[law]:
        mode = SEEKING
    east, north = frame(p)
    if mode == ACTING:
        if cloud.own_mode[i] == ACTING and choice < rules.rule_change[law]:
            course = unit(drawn[1]) * ti.f64(6.283185307179586)
            u = north * ti.cos(course) + east * ti.sin(course)
            cloud.own_rate[i] = unit(drawn[2]) * rules.rule_fastest[law]
    else:
        s, v, rate = tracker_at(legs, first, last, time)
        e, n = s.dot(east), s.dot(north)
        course = ti.atan2(e, n)
        if mode == HIDING:
            course += ti.f64(3.141592653589793) + (2.0 * unit(drawn[1]) - 1.0) * rules.rule_spread[law]
        else:
            # What is across the line of sight must be the same for both: then the bearing stays and they meet.
            right = p.cross(s).normalized(ti.f64(1e-15)) * ti.f64(-1.0)
            lead = rate * v.dot(right) / ti.max(cloud.own_rate[i], ti.f64(1e-12))
            recedes = rate * v.dot((s * p.dot(s) - p).normalized(ti.f64(1e-15)))
            if ti.abs(lead) < 1.0 and cloud.own_rate[i] * ti.sqrt(ti.max(1.0 - lead * lead, ti.f64(0.0))) > recedes:
                course += ti.asin(lead)
        u = north * ti.cos(course) + east * ti.sin(course)
    cloud.own_mode[i] = mode
    anchor(cloud, i, p, u, time)
    cloud.own_due[i] = (
        time + rules.rule_soonest[law] + unit(drawn[3]) * (rules.rule_latest[law] - rules.rule_soonest[law])
    )


@ti.func
def binary(p: f64x3):
    """Return (lon, lat) [binary angle] of a unit vector."""
    lon = ti.atan2(p[1], p[0]) * ti.f64(1 / UNIT)
    lat = ti.atan2(p[2], ti.sqrt(p[0] * p[0] + p[1] * p[1])) * ti.f64(1 / UNIT)
    return ti.cast(ti.cast(ti.round(lon), ti.i64), ti.i32), ti.cast(ti.round(lat), ti.i32)


@ti.func
def on_sphere(lon: ti.i32, lat: ti.i32) -> f64x3:
    """Return the unit vector of a place [binary angle]."""
    x, y = ti.cast(lon, ti.f64) * ti.f64(UNIT), ti.cast(lat, ti.f64) * ti.f64(UNIT)
    return f64x3(ti.cos(y) * ti.cos(x), ti.cos(y) * ti.sin(x), ti.sin(y))


@ti.func
def keep_off(
    cloud: ti.template(), i: ti.i32, until: ti.f64, fastest: ti.f64, run: ti.i32, seed0: ti.u32, seed1: ti.u32,
    coast: ti.template(),
):  # fmt: skip
    """Hold a particle's way against the shore until a time [s]: where it meets it, it takes any other course, at its speed.

    It is looked ahead in pieces that do not depend on `until`, so that no sweep more or less changes where it turns.
    """
    turns, going, back = 0, 1, f64x3(0.0, 0.0, 0.0)
    while going == 1 and cloud.own_free[i] < until:
        time, rate = cloud.own_free[i], cloud.own_rate[i]
        p0, u0 = at(cloud, i)
        p, _u = along(p0, u0, rate * (time - cloud.own_since[i]))
        lon, lat = binary(p)
        far = ti.cast(clearance(lon, lat, coast), ti.f64) * ti.f64(UNIT)
        far *= ti.sqrt(p[0] * p[0] + p[1] * p[1]) - far  # the least cosine of a latitude that far off
        if far > ti.f64(ALONG):
            cloud.own_free[i] = time + far / ti.max(fastest, rate)
        elif rate <= 0.0:
            cloud.own_free[i] = NEVER
        else:
            then = time + ti.f64(ALONG) / rate
            q, _v = along(p0, u0, rate * (then - cloud.own_since[i]))
            to_lon, to_lat = binary(q)
            hit, x, y, share, _edge = first_crossing(lon, lat, to_lon - lon, to_lat - lat, coast)
            met = time + ti.cast(share, ti.f64) * (then - time)
            if hit == 0:
                cloud.own_free[i] = then
            elif met > until:
                going = 0
            else:
                stop = on_sphere(x, y)
                if turns == 0 or (met - cloud.own_since[i]) * rate > ti.f64(NOWHERE):
                    turns, back = 0, (p - stop * p.dot(stop)).normalized(ti.f64(1e-15))
                turns += 1
                cloud.own_acts[i] += 1
                drawn = words(seed0, seed1, noise.STREAM_ACT, run, cloud.own_serial[i], cloud.own_acts[i])
                course = unit(drawn[1]) * ti.f64(6.283185307179586)
                east, north = frame(stop)
                onward = north * ti.cos(course) + east * ti.sin(course)
                if turns > TURNS:
                    onward = back
                if turns > TURNS + 1 or onward.norm() < 0.5:
                    onward, cloud.own_rate[i] = north, 0.0  # hemmed in: it stays there until it acts
                anchor(cloud, i, stop, onward, met)
                cloud.own_free[i] = met


@ti.func
def clock(rules: ti.template(), law: ti.i32, time: ti.f64, word: ti.u32) -> ti.f64:
    """Return when a particle that is new at a time acts first [s]."""
    due = ti.f64(NEVER)
    if rules.rule_soonest[law] < NEVER:
        due = time + rules.rule_soonest[law] + unit(word) * (rules.rule_latest[law] - rules.rule_soonest[law])
    return due


@ti.func
def cut(
    coastal: ti.template(),
    cloud: ti.template(), rules: ti.template(), sweeps: ti.template(), legs: ti.template(), e: ti.i32, base: ti.i32,
    count: ti.i32, law: ti.i32, first_leg: ti.i32, last_leg: ti.i32, run: ti.i32, seed0: ti.u32, seed1: ti.u32,
    coast: ti.template(),
):  # fmt: skip
    """Have particles act until sweep e, and keep those that it does not contradict, closed up to the front.

    Returns how many are left, the least squared chord from the sensor to any that there was, and the sums over what is
    left: of weights, and by weight of speeds, places and velocities.
    """
    time, outcome, bearing, half = (
        sweeps.sweep_time[e],
        sweeps.sweep_outcome[e],
        sweeps.sweep_bearing[e],
        sweeps.sweep_half[e],
    )
    s = vector(sweeps.sweep_place, e)
    east, north = frame(s)
    ahead = north * ti.cos(bearing) + east * ti.sin(bearing)
    aside = east * ti.cos(bearing) - north * ti.sin(bearing)
    sine, cosine, all_round = ti.sin(half), ti.cos(half), half > ti.f64(3.14159265)
    near, far = chord(sweeps.sweep_near[e]), chord(sweeps.sweep_far[e])
    left, nearest = 0, ti.f64(4.0)
    total, rate = ti.f64(0.0), ti.f64(0.0)
    mean, velocity = f64x3(0.0, 0.0, 0.0), f64x3(0.0, 0.0, 0.0)
    for j in range(count):
        i = base + j
        acting = 1
        while acting == 1:
            acting = ti.cast(cloud.own_due[i] <= time, ti.i32)
            if ti.static(coastal):
                keep_off(cloud, i, ti.min(cloud.own_due[i], time), rules.rule_fastest[law], run, seed0, seed1, coast)
            if acting == 1:
                act(cloud, rules, legs, i, law, first_leg, last_leg, run, seed0, seed1)
                cloud.own_free[i] = cloud.own_since[i]
        p0, u0 = at(cloud, i)
        angle = cloud.own_rate[i] * (time - cloud.own_since[i])
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
                # The angle off the bearing is at most `half`, of 0 to pi, where sin(half - angle) is not negative.
                inside = sine * p.dot(ahead) >= cosine * ti.abs(p.dot(aside))
            keep = inside == (outcome == DETECTED)
        if keep:
            if left < j:
                copied(cloud, i, base + left)
            left += 1
            w = cloud.own_weight[i]
            total += w
            rate += w * cloud.own_rate[i]
            mean += p * w
            velocity += u * (w * cloud.own_rate[i])
    return left, nearest, total, rate, mean, velocity


@ti.func
def chord(angle: ti.f64) -> ti.f64:
    """Return the chord of an arc [rad] of the unit sphere."""
    return ti.sin(angle * 0.5) * 2.0


@ti.func
def drawn_anew(
    coastal: ti.template(),
    cloud: ti.template(), tracks: ti.template(), rules: ti.template(), sweeps: ti.template(), e: ti.i32, k: ti.i32,
    count: ti.i32, size: ti.i32, drawn: ti.i32, seed0: ti.u32, seed1: ti.u32, coast: ti.template(),
):  # fmt: skip
    """Fill a cloud from the box of a detection; return how many particles it has now, and how many it has drawn so far.

    The last estimate tells which of them are likely, or where they come from; without one all are alike.
    """
    law, run, base, time, bearing = (
        tracks.track_rules[k],
        tracks.track_run[k],
        k * size,
        sweeps.sweep_time[e],
        sweeps.sweep_bearing[e],
    )
    s = vector(sweeps.sweep_place, e)
    east, north = frame(s)
    # Of two detections at one time the first tells no speed.
    known, old, pace = (
        tracks.track_e_rate[k] >= 0.0 and time > tracks.track_e_time[k],
        vector(tracks.track_e_place, k),
        tracks.track_e_rate[k],
    )
    elapsed = ti.max(time - tracks.track_e_time[k], ti.f64(1e-9))
    high = rules.rule_fastest[law]
    low, least = 2.0 * pace - high, high * LEAST
    by_place = known and rules.rule_method[law] != AIMED
    by_course = known and rules.rule_method[law] != WEIGHTED
    mean = ti.f64(0.0)
    for j in range(count):
        if by_place:
            cloud.own_weight[base + j] = ti.max(high - pace, least)
        mean += cloud.own_weight[base + j]
    mean = mean / ti.cast(count, ti.f64) if count > 0 else ti.f64(1.0)
    there = count
    for j in range(count, size):
        i, serial = base + there, drawn + j - count
        a = words(seed0, seed1, noise.STREAM_CLOUD, run, serial, 0)
        b = words(seed0, seed1, noise.STREAM_CLOUD, run, serial, 1)
        p, wet, tried = s, 0, 0
        while wet == 0 and tried < PLACES:
            place = a
            if tried > 0:
                place = words(seed0, seed1, noise.STREAM_CLOUD, run, serial, 1 + tried)
            distance = sweeps.sweep_near[e] + unit(place[0]) * (sweeps.sweep_far[e] - sweeps.sweep_near[e])
            way = bearing + (2.0 * unit(place[1]) - 1.0) * sweeps.sweep_half[e]
            p = s * ti.cos(distance) + (north * ti.cos(way) + east * ti.sin(way)) * ti.sin(distance)
            wet = 1
            if ti.static(coastal):
                lon, lat = binary(p)
                wet = is_wet(lon, lat, coast)
            tried += 1
        own_east, own_north = frame(p)
        course, rate = unit(a[2]) * ti.f64(6.283185307179586), unit(a[3]) * high
        u = own_north * ti.cos(course) + own_east * ti.sin(course)
        apart = p - old
        gone = 2.0 * ti.asin(ti.min(0.5 * ti.sqrt(apart.dot(apart)), ti.f64(1.0)))
        need = gone / elapsed
        if by_course and unit(b[0]) < 0.5:
            rate = ti.min(need, high)
            u = (p * ti.cos(gone) - old).normalized(ti.f64(1e-15))
        weight = mean
        if by_place:
            weight = ti.max(need - low if need < pace else high - need, least)
        anchor(cloud, i, p, u, time)
        cloud.own_rate[i], cloud.own_weight[i], cloud.own_mode[i] = rate, weight, ACTING
        cloud.own_serial[i], cloud.own_acts[i], cloud.own_due[i] = serial, 0, clock(rules, law, time, b[1])
        cloud.own_free[i] = time
        there += wet
    return there, drawn + size - count


@ti.func
def duplicated(
    cloud: ti.template(), rules: ti.template(), base: ti.i32, count: ti.i32, size: ti.i32, drawn: ti.i32, law: ti.i32,
    time: ti.f64, run: ti.i32, seed0: ti.u32, seed1: ti.u32,
):  # fmt: skip
    """Fill a cloud with duplicates of what is left, by weight; return how many particles it has drawn so far.

    A duplicate keeps its weight, and neither what it is about nor when it acts.
    """
    total = ti.f64(0.0)
    for j in range(count):
        total += cloud.own_weight[base + j]
        cloud.own_heap[base + j] = total
    for j in range(count, size):
        i, serial = base + j, drawn + j - count
        b = words(seed0, seed1, noise.STREAM_CLOUD, run, serial, 1)
        want, low, high = unit(b[0]) * total, 0, count - 1
        while low < high:
            middle = (low + high) // 2
            if cloud.own_heap[base + middle] < want:
                low = middle + 1
            else:
                high = middle
        copied(cloud, base + low, i)
        cloud.own_mode[i], cloud.own_serial[i], cloud.own_acts[i] = ACTING, serial, 0
        cloud.own_due[i] = clock(rules, law, time, b[1])
    return drawn + size - count


@ti.func
def summed(cloud: ti.template(), base: ti.i32, count: ti.i32, time: ti.f64):
    """Return the sums of a cloud at a time [s]: of weights, and by weight of speeds, places and velocities."""
    total, rate = ti.f64(0.0), ti.f64(0.0)
    mean, velocity = f64x3(0.0, 0.0, 0.0), f64x3(0.0, 0.0, 0.0)
    for j in range(count):
        i = base + j
        p0, u0 = at(cloud, i)
        p, u = turned(p0, u0, cloud.own_rate[i] * (time - cloud.own_since[i]))
        w = cloud.own_weight[i]
        total += w
        rate += w * cloud.own_rate[i]
        mean += p * w
        velocity += u * (w * cloud.own_rate[i])
    return total, rate, mean, velocity


@ti.func
def level(cloud: ti.template(), base: ti.i32, count: ti.i32, time: ti.f64, mean: f64x3, total: ti.f64, target: f64x3):
    """Return the share of a cloud that lies where it is denser than at a place: which of its areas hold that.

    Densities are Epanechnikov's about every particle but the one that asks, with his own share of the spread (Silverman
    1986, Density estimation, table 4.1): of 101 particles and the target none knows which it is.
    """
    squared = ti.f64(0.0)
    for j in range(count):
        p0, u0 = at(cloud, base + j)
        p, u = turned(p0, u0, cloud.own_rate[base + j] * (time - cloud.own_since[base + j]))
        anchor(cloud, base + j, p.normalized(), u.normalized(), time)
        apart, w = p - mean, cloud.own_weight[base + j]
        squared += w * apart.dot(apart)
    picks = ti.min(count, PICKS)
    # Duplicates that have not parted tell no more than one of them: each pick's weight is that of all that are where it is.
    picked, together = ti.f64(0.0), ti.f64(0.0)
    for pick in range(picks):
        i = base + pick * count // picks
        picked += cloud.own_weight[i]
        together += cloud.own_weight[i] * at_one(cloud, base, count, vector(cloud.own_place, i))
    effective = total * picked / together
    reach = ti.f64(2.4 * 2.4) * squared / total * ti.f64(0.5) * ti.pow(effective, ti.f64(-1 / 3))
    there = density(cloud, base, count, target, -1, reach)
    denser = ti.f64(0.0)
    for pick in range(picks):
        i = base + pick * count // picks
        if density(cloud, base, count, vector(cloud.own_place, i), i, reach) > there:
            denser += cloud.own_weight[i]
    return denser / picked


@ti.func
def at_one(cloud: ti.template(), base: ti.i32, count: ti.i32, place: f64x3) -> ti.f64:
    """Return the weight of all particles at a place."""
    found = ti.f64(0.0)
    for j in range(count):
        apart = vector(cloud.own_place, base + j) - place
        if apart.dot(apart) < ti.f64(SAME * SAME):
            found += cloud.own_weight[base + j]
    return found


@ti.func
def density(cloud: ti.template(), base: ti.i32, count: ti.i32, place: f64x3, without: ti.i32, reach: ti.f64) -> ti.f64:
    """Return a cloud's density at a place, but for a factor, by all particles but one; reach: squared [rad2]."""
    found = ti.f64(0.0)
    for j in range(count):
        i = base + j
        apart = vector(cloud.own_place, i) - place
        if i != without:
            found += cloud.own_weight[i] * ti.max(1.0 - apart.dot(apart) / reach, ti.f64(0.0))
    return found


@ti.func
def followed(
    coastal: ti.template(),
    areas: ti.i32,
    k: ti.i32, size: ti.i32, seed0: ti.u32, seed1: ti.u32, cloud: ti.template(), tracks: ti.template(),
    rules: ti.template(), sweeps: ti.template(), legs: ti.template(), estimates: ti.template(),
    coast: ti.template(),
):  # fmt: skip
    """Take cloud k through its sweeps."""
    law, run, base = tracks.track_rules[k], tracks.track_run[k], k * size
    first_leg, last_leg = tracks.track_first_leg[k], tracks.track_last_leg[k]
    count, drawn = tracks.track_count[k], tracks.track_drawn[k]
    quickest = rules.rule_fastest[law]
    for leg in range(first_leg, last_leg):
        quickest = ti.max(quickest, rules.rule_fastest[law] + legs.leg_rate[leg])
    # No particle comes within a chord of `clear` of the tracker before `clear_until`.
    clear, clear_until = ti.f64(0.0), ti.f64(-NEVER)
    for e in range(tracks.track_first[k], tracks.track_last[k]):
        time, outcome, row, far = (
            sweeps.sweep_time[e],
            sweeps.sweep_outcome[e],
            sweeps.sweep_row[e],
            chord(sweeps.sweep_far[e]),
        )
        if outcome == SILENT and row < 0 and far <= clear and time < clear_until:
            continue
        before = count
        count, nearest, total, rate, mean, velocity = cut(
            coastal, cloud, rules, sweeps, legs, e, base, before, law, first_leg, last_leg, run, seed0, seed1, coast
        )
        clear_until = ti.f64(-NEVER)
        if outcome == SILENT and count == before:
            clear = far
            clear_until = time + 0.999 * (ti.sqrt(nearest) - far) / ti.max(quickest, ti.f64(1e-12))
        share = ti.cast(count, ti.f64) / ti.cast(size, ti.f64)
        if outcome == SILENT and count < before and share < rules.rule_bulk[law]:
            count = 0  # the track is lost
        elif outcome == DETECTED and (share < rules.rule_bulk[law] or count == 0):
            count, drawn = drawn_anew(
                coastal, cloud, tracks, rules, sweeps, e, k, count, size, drawn, seed0, seed1, coast
            )
            total, rate, mean, velocity = summed(cloud, base, count, time)
        elif outcome != MARK and count > 0 and share < rules.rule_partial[law]:
            drawn = duplicated(cloud, rules, base, count, size, drawn, law, time, run, seed0, seed1)
            count = size
            total, rate, mean, velocity = summed(cloud, base, count, time)
        if count > 0 and (outcome == DETECTED or row >= 0):
            mean, velocity, rate = mean.normalized(), velocity / total, rate / total
            if outcome == DETECTED:
                for d in ti.static(range(3)):
                    tracks.track_e_place[3 * k + d] = mean[d]
                tracks.track_e_rate[k], tracks.track_e_time[k] = rate, time
            if row >= 0:
                place = (tracks.track_first_row[k] + row) * 9
                own_east, own_north = frame(mean)
                for d in ti.static(range(3)):
                    estimates[place + d] = mean[d]
                estimates[place + 3], estimates[place + 4] = velocity.dot(own_east), velocity.dot(own_north)
                estimates[place + 5], estimates[place + 6], estimates[place + 7] = rate, ti.cast(count, ti.f64), total
                if areas == 1 and outcome == MARK and count > 1:
                    estimates[place + 8] = level(cloud, base, count, time, mean, total, vector(sweeps.sweep_place, e))
    tracks.track_count[k], tracks.track_drawn[k] = count, drawn


@ti.kernel
def _follow(
    coastal: ti.template(),
    areas: ti.i32,
    clouds: ti.i32, size: ti.i32, seed0: ti.u32, seed1: ti.u32, cloud: Cloud, tracks: Tracks, rules: Rules,
    sweeps: Sweeps, legs: Legs, estimates: Doubles, coast: Coast,
):  # fmt: skip
    """Take every cloud through its sweeps, each by a thread of its own."""
    for turn in range(clouds * BLOCK):
        if turn % BLOCK == 0:
            followed(
                coastal, areas, turn // BLOCK, size, seed0, seed1, cloud, tracks, rules, sweeps, legs, estimates, coast
            )


def follow(
    areas: bool, size: int, seed: int, cloud: Any, tracks: Any, rules: Any, sweeps: Any, legs: Any, estimates: Any,
    coast: DeviceCoast | None = None,
) -> None:  # fmt: skip
    """Take clouds through their sweeps.

    areas: whether the level of the target is asked for at marks. size: most particles of a cloud; cloud: columns of Cloud by name, of all clouds (clouds * size,); tracks, rules,
    sweeps, legs: columns of Tracks, Rules, Sweeps and Legs; estimates: (rows * 9,), the FIELDS of each. coast: on whose land
    no particle is, None: anywhere.
    """
    seed0, seed1 = noise.key(seed)
    packs = [
        launch.pack(kind, *(columns[name] for name in kind.members))
        for kind, columns in ((Cloud, cloud), (Tracks, tracks), (Rules, rules), (Sweeps, sweeps), (Legs, legs))
    ]
    sea = (coast or open_sea()).pack
    _follow(coast is not None, areas, tracks["track_count"].shape[0], size, seed0, seed1, *packs, estimates, sea)
