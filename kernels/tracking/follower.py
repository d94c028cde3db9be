"""One particle of a tracker's cloud for a rarely detected target: motion, decisions, coast.

A particle keeps a great circle at its own speed from an anchor, and acts at random times (`Rules`):
it takes another course and speed, seeks a tracker or hides from it. A particle that reaches the
shore takes another course there.
"""

import taichi as ti

from kernels.maths import doubles, noise
from kernels.step.coast import clearance, first_crossing

Doubles = ti.types.ndarray(dtype=ti.f64, ndim=1)
DoubleTable = ti.types.ndarray(dtype=ti.f64, ndim=2)
IntTable = ti.types.ndarray(dtype=ti.i32, ndim=2)
f64x3 = ti.types.vector(3, ti.f64)

ACTING, SEEKING, HIDING = range(3)  # intentions of a particle

# [rad] arc after which the anchor moves; the series below are accurate to 1e-12 up to twice that
FAR = 0.05
NEVER = 1e300  # [s]
UNIT = 6.283185307179586 / 4294967296.0  # [rad] one binary angle unit
# [rad] arc that is tested against the shore as a straight line in longitude and latitude: 1.3 km,
# error 3 cm at 60 degrees
ALONG = 2e-4
# courses that a particle tries at a place on the shore; then it turns back
TURNS = 16
NOWHERE = 1e-6  # [rad] arc: a particle that moves less between two turns has not left the place


# Each object has a row in a table of floats, and in a table of integers if it has any. The classes
# give the columns; REAL and WHOLE are the numbers of columns. A vector takes three columns.
class Own:
    """Columns of a particle."""

    PLACE = 0  # unit vector of the anchor
    WAY = 3  # unit tangent there
    RATE = 6  # [rad/s]
    SINCE = 7  # [s] when it was at the anchor
    DUE = 8  # [s] when it acts next
    FREE = 9  # [s] time until which its path is known to be clear of the shore
    SCRATCH = 10  # cumulative weight, in the first of three columns; or its present position
    WEIGHT = 13
    REAL = 14

    MODE = 0  # ACTING, SEEKING or HIDING
    SERIAL = 1  # number of particles of its cloud drawn before it: the key of its random numbers
    ACTS = 2  # number of its acts so far
    WHOLE = 3


class Rule:
    """Columns of a rule: the behaviour of particles, and how a cloud is refilled."""

    CHANGE = 0  # probability per act of another course and speed
    SEEK = 1  # of seeking from then on
    HIDE = 2  # of hiding
    LEAVE = 3  # of ending seeking or hiding
    SOONEST = 4  # [s] between acts; NEVER: particles do not act
    LATEST = 5
    SPREAD = 6  # [rad] half of the sector about the reciprocal bearing in which one hides
    FASTEST = 7  # [rad/s]
    PARTIAL = 8  # share of particles below which a cloud is refilled with duplicates
    # share below which the cloud is redrawn from the detection's box, or the track is lost
    BULK = 9
    METHOD = 10  # WEIGHTED, AIMED or COMBINED
    REAL = 11


class Leg:
    """Columns of a leg of a tracker's track; the last leg has no speed."""

    TIME = 0  # [s]
    PLACE = 1  # unit vector of its begin
    WAY = 4  # unit tangent there
    RATE = 7  # [rad/s]
    REAL = 8


Cloud = ti.types.argpack(own_real=DoubleTable, own_whole=IntTable)
Rules = ti.types.argpack(rule_real=DoubleTable)
Legs = ti.types.argpack(leg_real=DoubleTable)


@ti.func
def unit(word: ti.u32) -> ti.f64:
    """Return a uniform number in (0, 1)."""
    return (ti.cast(word, ti.f64) + ti.f64(0.5)) * ti.f64(1 / 4294967296)


@ti.func
def cloud_words(
    seed0: ti.u32, seed1: ti.u32, stream: ti.i32, run: ti.i32, serial: ti.i32, number: ti.i32
):
    """Return four random words for a particle of a run's clouds."""
    return noise.philox(
        ti.cast(serial, ti.u32),
        ti.cast(number, ti.u32),
        ti.cast(stream, ti.u32),
        ti.cast(run, ti.u32),
        seed0,
        seed1,
    )


@ti.func
def vector(table: ti.template(), row: ti.i32, first: ti.template()) -> f64x3:
    """Return three numbers in a row of a table, from a column on, as a vector."""
    return f64x3(table[row, first], table[row, first + 1], table[row, first + 2])


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
    """Return (place, tangent) after an arc [rad] of at most twice FAR from place and tangent."""
    y = angle * angle
    c = ti.f64(1.0) - y * (ti.f64(1 / 2) - y * (ti.f64(1 / 24) - y * ti.f64(1 / 720)))
    s = angle * (ti.f64(1.0) - y * (ti.f64(1 / 6) - y * (ti.f64(1 / 120) - y * ti.f64(1 / 5040))))
    return p * c + u * s, u * c - p * s


@ti.func
def along(p: f64x3, u: f64x3, angle: ti.f64):
    """Return (place, tangent) after an arc of any length [rad], as `turned` does.

    Long arcs occur when there was no sweep for days.
    """
    q, v = turned(p, u, angle)
    if angle > 2 * FAR:
        s, c = doubles.sincos(angle)
        q, v = p * c + u * s, u * c - p * s
    return q, v


@ti.func
def anchor_and_tangent(cloud: ti.template(), i: ti.i32):
    """Return (anchor, tangent) of a particle."""
    return vector(cloud.own_real, i, Own.PLACE), vector(cloud.own_real, i, Own.WAY)


@ti.func
def anchor(cloud: ti.template(), i: ti.i32, p: f64x3, u: f64x3, time: ti.f64):
    """Move the anchor of a particle to a place with a unit tangent, at a time [s]."""
    for d in ti.static(range(3)):
        cloud.own_real[i, Own.PLACE + d] = p[d]
        cloud.own_real[i, Own.WAY + d] = u[d]
    cloud.own_real[i, Own.SINCE] = time


@ti.func
def copied(cloud: ti.template(), i: ti.i32, to: ti.i32):
    """Copy particle i over particle `to`."""
    p, u = anchor_and_tangent(cloud, i)
    anchor(cloud, to, p, u, cloud.own_real[i, Own.SINCE])
    cloud.own_real[to, Own.RATE], cloud.own_real[to, Own.DUE], cloud.own_real[to, Own.WEIGHT] = (
        cloud.own_real[i, Own.RATE],
        cloud.own_real[i, Own.DUE],
        cloud.own_real[i, Own.WEIGHT],
    )
    cloud.own_real[to, Own.FREE] = cloud.own_real[i, Own.FREE]
    (
        cloud.own_whole[to, Own.MODE],
        cloud.own_whole[to, Own.SERIAL],
        cloud.own_whole[to, Own.ACTS],
    ) = (
        cloud.own_whole[i, Own.MODE],
        cloud.own_whole[i, Own.SERIAL],
        cloud.own_whole[i, Own.ACTS],
    )


@ti.func
def headed(north: f64x3, east: f64x3, course: ti.f64) -> f64x3:
    """Return the unit tangent of a course [rad]; north, east: the unit tangents at the place."""
    s, c = doubles.sincos(course)
    return north * c + east * s


@ti.func
def tracker_at(legs: ti.template(), first: ti.i32, last: ti.i32, time: ti.f64):
    """Return (place, tangent, rate) of a tracker at a time [s].

    Before and after its track it is stationary.
    """
    leg = first
    while leg + 1 < last and legs.leg_real[leg + 1, Leg.TIME] <= time:
        leg += 1
    p, u = vector(legs.leg_real, leg, Leg.PLACE), vector(legs.leg_real, leg, Leg.WAY)
    since, rate = time - legs.leg_real[leg, Leg.TIME], legs.leg_real[leg, Leg.RATE]
    if since < 0.0:
        since, rate = ti.f64(0.0), ti.f64(0.0)
    s, c = doubles.sincos(rate * since)
    return p * c + u * s, u * c - p * s, rate


@ti.func
def act(
    cloud: ti.template(),
    rules: ti.template(),
    legs: ti.template(),
    i: ti.i32,
    law: ti.i32,
    first: ti.i32,
    last: ti.i32,
    run: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
):
    """Let a particle act at its due time: keep its course, take another, seek or hide."""
    time = cloud.own_real[i, Own.DUE]
    p0, u0 = anchor_and_tangent(cloud, i)
    p, u = along(p0, u0, cloud.own_real[i, Own.RATE] * (time - cloud.own_real[i, Own.SINCE]))
    cloud.own_whole[i, Own.ACTS] += 1
    drawn = cloud_words(
        seed0,
        seed1,
        noise.STREAM_ACT,
        run,
        cloud.own_whole[i, Own.SERIAL],
        cloud.own_whole[i, Own.ACTS],
    )
    choice, mode = unit(drawn[0]), cloud.own_whole[i, Own.MODE]
    if mode != ACTING:
        mode = ACTING if choice < rules.rule_real[law, Rule.LEAVE] else mode
    elif choice > 1.0 - rules.rule_real[law, Rule.HIDE]:
        mode = HIDING
    elif choice > 1.0 - rules.rule_real[law, Rule.HIDE] - rules.rule_real[law, Rule.SEEK]:
        mode = SEEKING
    east, north = frame(p)
    if mode == ACTING:
        if cloud.own_whole[i, Own.MODE] == ACTING and choice < rules.rule_real[law, Rule.CHANGE]:
            course = unit(drawn[1]) * ti.f64(6.283185307179586)
            u = headed(north, east, course)
            cloud.own_real[i, Own.RATE] = unit(drawn[2]) * rules.rule_real[law, Rule.FASTEST]
    else:
        s, v, rate = tracker_at(legs, first, last, time)
        e, n = s.dot(east), s.dot(north)
        course = doubles.atan2(e, n)
        if mode == HIDING:
            course += (
                ti.f64(3.141592653589793)
                + (2.0 * unit(drawn[1]) - 1.0) * rules.rule_real[law, Rule.SPREAD]
            )
        else:
            # With equal velocities across the line of sight, the bearing stays constant and they
            # meet.
            right = p.cross(s).normalized(ti.f64(1e-15)) * ti.f64(-1.0)
            lead = rate * v.dot(right) / ti.max(cloud.own_real[i, Own.RATE], ti.f64(1e-12))
            recedes = rate * v.dot((s * p.dot(s) - p).normalized(ti.f64(1e-15)))
            if (
                ti.abs(lead) < 1.0
                and cloud.own_real[i, Own.RATE] * ti.sqrt(ti.max(1.0 - lead * lead, ti.f64(0.0)))
                > recedes
            ):
                course += doubles.asin(lead)
        u = headed(north, east, course)
    cloud.own_whole[i, Own.MODE] = mode
    anchor(cloud, i, p, u, time)
    cloud.own_real[i, Own.DUE] = (
        time
        + rules.rule_real[law, Rule.SOONEST]
        + unit(drawn[3]) * (rules.rule_real[law, Rule.LATEST] - rules.rule_real[law, Rule.SOONEST])
    )


@ti.func
def binary(p: f64x3):
    """Return (lon, lat) [binary angle] of a unit vector."""
    lon = doubles.atan2(p[1], p[0]) * ti.f64(1 / UNIT)
    lat = doubles.atan2(p[2], ti.sqrt(p[0] * p[0] + p[1] * p[1])) * ti.f64(1 / UNIT)
    return ti.cast(ti.cast(ti.round(lon), ti.i64), ti.i32), ti.cast(ti.round(lat), ti.i32)


@ti.func
def on_sphere(lon: ti.i32, lat: ti.i32) -> f64x3:
    """Return the unit vector of a position [binary angle]."""
    x, y = ti.cast(lon, ti.f64) * ti.f64(UNIT), ti.cast(lat, ti.f64) * ti.f64(UNIT)
    lon_sine, lon_cosine = doubles.sincos(x)
    lat_sine, lat_cosine = doubles.sincos(y)
    return f64x3(lat_cosine * lon_cosine, lat_cosine * lon_sine, lat_sine)


@ti.func
def keep_off(
    cloud: ti.template(),
    i: ti.i32,
    until: ti.f64,
    fastest: ti.f64,
    run: ti.i32,
    seed0: ti.u32,
    seed1: ti.u32,
    coast: ti.template(),
):
    """Check a particle's path against the shore until a time [s]; at the shore it turns.

    There it takes a random course, at its speed. The look-ahead proceeds in pieces that do not
    depend on `until`, so that additional sweeps do not change where it turns.
    """
    turns, going, back = 0, 1, f64x3(0.0, 0.0, 0.0)
    while going == 1 and cloud.own_real[i, Own.FREE] < until:
        time, rate = cloud.own_real[i, Own.FREE], cloud.own_real[i, Own.RATE]
        p0, u0 = anchor_and_tangent(cloud, i)
        p, _u = along(p0, u0, rate * (time - cloud.own_real[i, Own.SINCE]))
        lon, lat = binary(p)
        far = ti.cast(clearance(lon, lat, coast), ti.f64) * ti.f64(UNIT)
        # times the least cosine of latitude within that distance
        far *= ti.sqrt(p[0] * p[0] + p[1] * p[1]) - far
        if far > ti.f64(ALONG):
            cloud.own_real[i, Own.FREE] = time + far / ti.max(fastest, rate)
        elif rate <= 0.0:
            cloud.own_real[i, Own.FREE] = NEVER
        else:
            then = time + ti.f64(ALONG) / rate
            q, _v = along(p0, u0, rate * (then - cloud.own_real[i, Own.SINCE]))
            to_lon, to_lat = binary(q)
            hit, x, y, share, _edge = first_crossing(lon, lat, to_lon - lon, to_lat - lat, coast)
            met = time + ti.cast(share, ti.f64) * (then - time)
            if hit == 0:
                cloud.own_real[i, Own.FREE] = then
            elif met > until:
                going = 0
            else:
                stop = on_sphere(x, y)
                if turns == 0 or (met - cloud.own_real[i, Own.SINCE]) * rate > ti.f64(NOWHERE):
                    turns, back = 0, (p - stop * p.dot(stop)).normalized(ti.f64(1e-15))
                turns += 1
                cloud.own_whole[i, Own.ACTS] += 1
                drawn = cloud_words(
                    seed0,
                    seed1,
                    noise.STREAM_ACT,
                    run,
                    cloud.own_whole[i, Own.SERIAL],
                    cloud.own_whole[i, Own.ACTS],
                )
                course = unit(drawn[1]) * ti.f64(6.283185307179586)
                east, north = frame(stop)
                onward = headed(north, east, course)
                if turns > TURNS:
                    onward = back
                if turns > TURNS + 1 or onward.norm() < 0.5:
                    # enclosed by land: it stays there until it acts
                    onward, cloud.own_real[i, Own.RATE] = north, 0.0
                anchor(cloud, i, stop, onward, met)
                cloud.own_real[i, Own.FREE] = met


@ti.func
def clock(rules: ti.template(), law: ti.i32, time: ti.f64, word: ti.u32) -> ti.f64:
    """Return when [s] a particle that is new at a time acts first."""
    due = ti.f64(NEVER)
    if rules.rule_real[law, Rule.SOONEST] < NEVER:
        due = (
            time
            + rules.rule_real[law, Rule.SOONEST]
            + unit(word) * (rules.rule_real[law, Rule.LATEST] - rules.rule_real[law, Rule.SOONEST])
        )
    return due
