"""Exposure of particles to a sensor's track, and the update of weights by it.

A stretch of a step is given by nodes: times [s after the stretch's begin] and positions of the
sensor, straight in between. A particle's path consists of pieces (kernels.steering.pieces): a
drifting particle moves straight from its position at the begin of the stretch to that at its end.
Everything is computed relative to the particle, in metres.

On a Brownian bridge a target's track has no finite length, so that a hazard per unit of relative
track would grow without bound as steps shrink. Instead, the hazard is per time, with the speed of
the sensor relative to the mean velocity of the target's leg, at the bridge's position. Where that
position matters, near the sensor or an edge, the piece is halved repeatedly until the bridge's
spread is below a quarter of the range.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.maths import noise, sphere
from kernels.runtime import batch, runtime
from kernels.steering import pieces
from kernels.steering.pieces import DEPTH, MOVES, NONE, Paths, Piece, Pieces, Straights
from kernels.step import curve
from kernels.step.coast import Ints, Reals

METRES = sphere.RADIUS * sphere.UNIT
TINY = 1e-30
STRAY = 0.25  # largest spread of a bridge within a part, as a share of the range
FINE = 0.1  # the same as a share of the sensor's own length scale, however near it is
UNKNOWN = np.zeros(1, np.float32)  # placeholder for a scale that the kernel does not read
NEARS, ADDS = range(2)  # passes over a part of a path: least range; exposure

f32x2 = ti.types.vector(2, ti.f32)
HostReals = ti.types.ndarray(dtype=ti.f32, ndim=1)
HostInts = ti.types.ndarray(dtype=ti.i32, ndim=1)

CUBE, ABEAM, ZONES, INSIDE = range(4)  # kinds of exposure
# Meaning of an exposure: a hazard, a share of time inside, or the log of a miss by factor of W.
HAZARD, SHARE, MISS = range(3)


@ti.func
def relative(
    x: ti.i32, y: ti.i32, at_lon: ti.i32, at_lat: ti.i32, c: ti.f32, bend: ti.f32
) -> f32x2:
    """Return the vector (east, north) [m] from a sensor to a particle, to second order.

    It lies in the particle's tangent plane. c: cosine of the sensor's latitude; bend: half its sine
    times its cosine, per unit of binary angle. Great circles past the particle are straight in this
    plane up to terms of third order: 0.1 m within 20 km.
    """
    dlon, dlat = ti.cast(x - at_lon, ti.f32), ti.cast(y - at_lat, ti.f32)
    return f32x2(dlon * c, dlat - dlon * dlon * bend) * ti.f32(METRES)


@ti.func
def hazard(a: f32x2, b: f32x2, far_a: ti.f32, far_b: ti.f32) -> ti.f32:
    """Return the integral of ds / (2 r^3) [1/m2] along the relative track from a to b.

    far_a, far_b: the lengths of a and b.

    The integral is 1/2 1/x^2 [s / r] between the ends, x the lateral range. Written like the field
    of a straight wire, |b - a| (ra + rb) / (2 ra rb (ra rb + a.b)), it needs no lateral range and
    keeps its digits where that is small.
    """
    d = b - a
    product, dot = far_a * far_b, a[0] * b[0] + a[1] * b[1]
    open_angle = product + dot
    if dot < 0.0:
        cross = a[0] * b[1] - a[1] * b[0]
        open_angle = cross * cross / (product - dot)
    return (
        0.5
        * ti.sqrt(d[0] * d[0] + d[1] * d[1])
        * (far_a + far_b)
        / ti.max(product * open_angle, TINY)
    )


@ti.func
def lateral(a: f32x2, b: f32x2, along_a: ti.f32, along_b: ti.f32) -> ti.f32:
    """Return the lateral range [m] of the relative track from a to b, or -1 without a pass abeam.

    along_a, along_b: distance along the leg's own course from the particle to the sensor. The
    particle is abeam where its sign changes; 0 counts as positive, so that a pass at the joint of
    two pieces counts once.
    """
    x = -1.0
    if (along_a < 0.0) != (along_b < 0.0):
        d = b - a
        x = ti.abs(a[0] * b[1] - a[1] * b[0]) / ti.max(ti.sqrt(d[0] * d[0] + d[1] * d[1]), TINY)
    return x


@ti.func
def within(a: f32x2, b: f32x2, radius: ti.f32) -> ti.f32:
    """Return the share of the segment from a to b that lies within a radius [m] of the origin."""
    d = b - a
    dd, ad, aa = d[0] * d[0] + d[1] * d[1], a[0] * d[0] + a[1] * d[1], a[0] * a[0] + a[1] * a[1]
    share = ti.cast(aa < radius * radius, ti.f32)
    if dd > 0.0:
        share = 0.0
        root = ad * ad - dd * (aa - radius * radius)
        if root > 0.0:
            root = ti.sqrt(root)
            low, high = ti.max((-ad - root) / dd, 0.0), ti.min((-ad + root) / dd, 1.0)
            share = ti.max(high - low, 0.0)
    return share


@ti.func
def inside(a: f32x2, b: f32x2, ring: ti.template()) -> ti.f32:
    """Return the share of the segment from a to b that lies inside a polygon.

    ring: (x, y, x, y, ...) [m], counterclockwise, not closed.
    """
    corners = ring.shape[0] // 2
    d = b - a
    share, within_a = 0.0, 0
    px, py = ring[2 * corners - 2], ring[2 * corners - 1]
    for k in range(corners):
        qx, qy = ring[2 * k], ring[2 * k + 1]
        ex, ey = qx - px, qy - py
        # The parity of crossings of a ray eastward from a tells whether a lies inside.
        if (py > a[1]) != (qy > a[1]):
            if (a[0] - px) < ex * (a[1] - py) / ey:
                within_a = 1 - within_a
        # Where the segment crosses this edge, it enters the ring if it passes to the edge's left.
        side_a, side_b = ex * (a[1] - py) - ey * (a[0] - px), ex * (b[1] - py) - ey * (b[0] - px)
        if (side_a < 0.0) != (side_b < 0.0):
            at = side_a / (side_a - side_b)
            if ti.abs(ex) > ti.abs(ey):
                on = a[0] + at * d[0]
                if (px < on) != (qx < on):
                    share += (1.0 - at) * (1.0 if side_a < 0.0 else -1.0)
            else:
                on = a[1] + at * d[1]
                if (py < on) != (qy < on):
                    share += (1.0 - at) * (1.0 if side_a < 0.0 else -1.0)
        px, py = qx, qy
    return ti.min(ti.max(share + within_a, 0.0), 1.0)


@ti.func
def chance(curve: ti.template(), x: ti.f32) -> ti.f32:
    """Return the detection probability of a lateral range curve at the range x.

    curve: (range, probability, range, probability, ...), linear in between, zero beyond the last
    range.
    """
    last = curve.shape[0] // 2 - 1
    found = 0.0
    if x <= curve[2 * last]:
        k = 1
        while k < last and x > curve[2 * k]:
            k += 1
        low, span = curve[2 * k - 2], curve[2 * k] - curve[2 * k - 2]
        found = curve[2 * k + 1]
        if span > 0.0:
            found = curve[2 * k - 1] + (found - curve[2 * k - 1]) * (x - low) / span
    return found


@ti.func
def _piece(
    kind: ti.template(),
    a: f32x2,
    b: f32x2,
    far_a: ti.f32,
    far_b: ti.f32,
    lasting: ti.f32,
    first: ti.i32,
    last: ti.i32,
    course: ti.template(),
    table: ti.template(),
    scale: ti.template(),
    own: ti.i32,
    scales: ti.i32,
    exposure: ti.template(),
    size: ti.i32,
    i: ti.i32,
) -> ti.f32:
    """Return the exposure of a piece from a to b; passes abeam are written to particle i directly.

    lasting [s]; first, last: indices in `course` of the leg's direction at the piece's begin and
    end. own, scales: index in `scale` of the particle's scenario, and how many numbers it has.
    """
    found = 0.0
    if ti.static(kind == CUBE):
        found = hazard(a, b, far_a, far_b)
    elif ti.static(kind == INSIDE):
        found = scale[own] * lasting * inside(a, b, table)
    elif ti.static(kind == ZONES):
        for z in range(scales):
            found += (
                scale[own + z]
                * lasting
                * (within(a, b, table[2 * z + 1]) - within(a, b, table[2 * z]))
            )
    else:
        along_a = -(a[0] * course[first] + a[1] * course[first + 1])
        along_b = -(b[0] * course[last] + b[1] * course[last + 1])
        far = lateral(a, b, along_a, along_b)
        if far >= 0.0:
            for f in range(scales):
                exposure[f * size + i] += ti.log(1.0 - chance(table, far * scale[own + f]))
    return found


@ti.func
def _at(
    polar: ti.template(),
    x: ti.i32,
    y: ti.i32,
    to_x: ti.i32,
    to_y: ti.i32,
    share: ti.f32,
    node: ti.i32,
    place: ti.template(),
    trig: ti.template(),
) -> f32x2:
    """Return the vector [m] from the sensor at a node to a particle at a share of its path."""
    at_x, at_y = _target(polar, x, y, to_x, to_y, share)
    way = f32x2(0.0)
    if ti.static(polar):
        way = _relative_polar(at_x, at_y, place[2 * node], place[2 * node + 1])
    else:
        way = relative(
            at_x, at_y, place[2 * node], place[2 * node + 1], trig[2 * node], trig[2 * node + 1]
        )
    return way


@ti.func
def _target(polar: ti.template(), x: ti.i32, y: ti.i32, to_x: ti.i32, to_y: ti.i32, share: ti.f32):
    """Return the position of a particle at a share of its path."""
    at_x, at_y = to_x, to_y
    if share < 1.0:
        at_x, at_y = curve.end_of_way(
            polar, x, y, curve.inside(polar, x, y, to_x, to_y, share, f32x2(0.0))
        )
    return at_x, at_y


@ti.func
def _relative_polar(x: ti.i32, y: ti.i32, at_lon: ti.i32, at_lat: ti.i32) -> f32x2:
    """Return `relative` near a pole: along the great circle, rotated to the meridian of 0."""
    return sphere.carried_back(
        sphere.offset_near(at_lon, at_lat, x, y), sphere.meridian(at_lon, at_lat)
    )


@ti.func
def _apart(
    polar: ti.template(),
    x: ti.i32,
    y: ti.i32,
    to_x: ti.i32,
    to_y: ti.i32,
    leaves: ti.f32,
    pace: ti.f32,
    when: ti.f32,
    k: ti.i32,
    time: ti.template(),
    place: ti.template(),
    trig: ti.template(),
) -> f32x2:
    """Return the vector [m] from the sensor to a particle, at a time within piece k of the track.

    The particle starts at the time `leaves`; pace: 1 / the duration of its path [1/s].
    """
    share = ti.min(ti.max((when - leaves) * pace, 0.0), 1.0)
    node = k + ti.cast(when == time[k + 1], ti.i32)
    way = _at(polar, x, y, to_x, to_y, share, node, place, trig)
    # the particle's own times cut the piece: along the great circle, to second order
    if when != time[node]:
        part = (when - time[k]) / (time[k + 1] - time[k])
        at_x, at_y = _target(polar, x, y, to_x, to_y, share)
        if ti.static(polar):
            led = part * sphere.offset_near(
                place[2 * k], place[2 * k + 1], place[2 * k + 2], place[2 * k + 3]
            )
            at_lon, at_lat = sphere.exponential(place[2 * k], place[2 * k + 1], led[0], led[1])
            way = _relative_polar(at_x, at_y, at_lon, at_lat)
        else:
            dlon = ti.cast(place[2 * k + 2] - place[2 * k], ti.f32)
            dlat = ti.cast(place[2 * k + 3] - place[2 * k + 1], ti.f32)
            at_lon = place[2 * k] + ti.cast(part * dlon, ti.i32)
            at_lat = place[2 * k + 1] + ti.cast(
                part * dlat + part * (1.0 - part) * dlon * dlon * trig[2 * k + 1], ti.i32
            )
            way = relative(at_x, at_y, at_lon, at_lat, trig[2 * k], trig[2 * k + 1])
    return way


@ti.func
def _range(
    kind: ti.template(),
    a: f32x2,
    b: f32x2,
    first: ti.i32,
    last: ti.i32,
    course: ti.template(),
    table: ti.template(),
) -> ti.f32:
    """Return the distance [m] that the segment from a to b keeps from where detection changes.

    That place is the sensor itself; for zones their edges; for an area its outline; for a sensor
    that counts passes abeam the line abeam of it, if within range.
    """
    d = b - a
    dd = ti.max(d[0] * d[0] + d[1] * d[1], 1e-12)
    share = ti.min(ti.max(-(a[0] * d[0] + a[1] * d[1]) / dd, 0.0), 1.0)
    at = a + share * d
    near = ti.sqrt(at[0] * at[0] + at[1] * at[1])
    if ti.static(kind == ZONES):
        low, high = near, ti.max(a.norm(), b.norm())
        found = ti.f32(1e30)
        for z in range(table.shape[0]):
            gap = ti.max(low - table[z], table[z] - high)
            if table[z] > 0.0:
                found = ti.min(found, ti.max(gap, 0.0))
        near = found
    elif ti.static(kind == INSIDE):
        corners = table.shape[0] // 2
        found = ti.f32(1e30)
        middle = 0.5 * (a + b)
        p = f32x2(table[2 * corners - 2], table[2 * corners - 1])
        for k in range(corners):
            q = f32x2(table[2 * k], table[2 * k + 1])
            e = q - p
            along = ti.min(ti.max((middle - p).dot(e) / ti.max(e.dot(e), 1e-12), 0.0), 1.0)
            found = ti.min(found, (middle - p - along * e).norm())
            p = q
        near = ti.max(found - 0.5 * d.norm(), 0.0)
    elif ti.static(kind == ABEAM):
        along_a = -(a[0] * course[first] + a[1] * course[first + 1])
        along_b = -(b[0] * course[last] + b[1] * course[last + 1])
        beyond = near - table[table.shape[0] - 2]
        # a pass out of range counts as well: no later pass on the leg does
        near = ti.min(ti.abs(along_a), ti.abs(along_b))
        if (along_a < 0.0) != (along_b < 0.0):
            near = ti.max(beyond, 0.0)
    return near


@ti.func
def _pass(
    a: f32x2,
    b: f32x2,
    first: ti.i32,
    last: ti.i32,
    number: ti.f32,
    course: ti.template(),
    table: ti.template(),
    scale: ti.template(),
    own: ti.i32,
    scales: ti.i32,
    exposure: ti.template(),
    passed: ti.template(),
    size: ti.i32,
    i: ti.i32,
):
    """Write the log miss probability where a part of a bridge first comes abeam of a leg.

    A Brownian bridge crosses the abeam line infinitely often; only the first crossing on each leg
    is counted. number: of the leg; other arguments as in `_piece`.
    """
    along_a = a[0] * course[first] + a[1] * course[first + 1]
    along_b = b[0] * course[last] + b[1] * course[last + 1]
    if (along_a > 0.0) != (along_b > 0.0) and passed[i] != number:
        passed[i] = number
        at = a + along_a / (along_a - along_b) * (b - a)
        for f in range(scales):
            exposure[f * size + i] += ti.log(1.0 - chance(table, at.norm() * scale[own + f]))


@ti.func
def _all_along(
    kind: ti.template(),
    polar: ti.template(),
    way: Piece,
    time: ti.template(),
    place: ti.template(),
    trig: ti.template(),
    course: ti.template(),
    leg: ti.template(),
    table: ti.template(),
    scale: ti.template(),
    own: ti.i32,
    scales: ti.i32,
    exposure: ti.template(),
    size: ti.i32,
    i: ti.i32,
) -> ti.f32:
    """Return the exposure to the whole track of a particle that moves straight throughout.

    This common case is a fifth faster than the general one.
    """
    total, pace = 0.0, 1.0 / ti.max(way.end - way.begin, 1e-6)
    x, y, to_x, to_y = way.lon, way.lat, way.to_lon, way.to_lat
    a = _at(polar, x, y, to_x, to_y, (time[0] - way.begin) * pace, 0, place, trig)
    far_a = ti.sqrt(a[0] * a[0] + a[1] * a[1])
    for k in range(time.shape[0] - 1):
        b = _at(polar, x, y, to_x, to_y, (time[k + 1] - way.begin) * pace, k + 1, place, trig)
        far_b = ti.sqrt(b[0] * b[0] + b[1] * b[1])
        if leg[k] > 0:
            total += _piece(
                kind,
                a,
                b,
                far_a,
                far_b,
                time[k + 1] - time[k],
                4 * k,
                4 * k + 2,
                course,
                table,
                scale,
                own,
                scales,
                exposure,
                size,
                i,
            )
        a, far_a = b, far_b  # the end of a piece is the begin of the next one
    return total


def _exposing(Ways: Any, steers: bool) -> Any:
    """Return the kernel for one kind of path: `Straights` (drifting) or `Pieces` (steering)."""

    @ti.kernel
    def _expose(
        kind: ti.template(),
        polar: ti.template(),
        listed: ti.template(),
        first: ti.i32,
        last: ti.i32,
        slots: Ints,
        shift: Ints,
        scenario: Ints,
        status: Ints,
        status_since: Ints,
        paths: Ways,
        elapsed: ti.i32,
        duration: ti.i32,
        step: ti.i32,
        seed0: ti.u32,
        seed1: ti.u32,
        time: HostReals,
        place: HostInts,
        trig: HostReals,
        course: HostReals,
        leg: HostInts,
        table: HostReals,
        scale: HostReals,
        unit: HostReals,
        stride: ti.i32,
        scales: ti.i32,
        exposure: Reals,
        passed: Reals,
        size: ti.i32,
        shore: ti.i32,
    ):
        for nth in range(first, last):
            i = batch.slot(listed, slots, nth)
            which, state = scenario[i], status[i]
            own = which * stride
            here = pieces.first_piece(steers, paths, i, state, elapsed, shore)
            if ti.static(kind in (CUBE, ABEAM)):
                if scale[own] <= 0.0:
                    here = NONE
            total, nodes = 0.0, time.shape[0] - 1
            if ti.static(not steers):
                if here != NONE:
                    way = pieces.load_piece(
                        steers, paths, i, MOVES, state, status_since[i], elapsed, duration, shore
                    )
                    if way.begin <= time[0] and way.end >= time[nodes]:  # the common case
                        total, here = (
                            _all_along(
                                kind,
                                polar,
                                way,
                                time,
                                place,
                                trig,
                                course,
                                leg,
                                table,
                                scale,
                                own,
                                scales,
                                exposure,
                                size,
                                i,
                            ),
                            NONE,
                        )
            while here != NONE:
                way = pieces.load_piece(
                    steers, paths, i, here, state, status_since[i], elapsed, duration, shore
                )
                part, later = pieces.whole_piece(way), pieces.no_later()
                if ti.static(steers):
                    if way.begin >= time[nodes] or way.end <= time[0]:
                        part.depth = -1
                while part.depth >= 0:
                    x, y, to_x, to_y, begin, end = (
                        part.lon,
                        part.lat,
                        part.to_lon,
                        part.to_lat,
                        part.begin,
                        part.end,
                    )
                    pace = 1.0 / ti.max(end - begin, 1e-6)
                    halve, found = 0, 0.0
                    stage = ADDS
                    if ti.static(steers):
                        stage = NEARS if way.k > 0.0 and part.depth < DEPTH else ADDS
                    for asks in range(stage, ADDS + 1):
                        for k in range(nodes):
                            low, high = ti.max(time[k], begin), ti.min(time[k + 1], end)
                            if leg[k] > 0 and low < high and halve == 0:
                                a = _apart(
                                    polar, x, y, to_x, to_y, begin, pace, low, k, time, place, trig
                                )
                                b = _apart(
                                    polar, x, y, to_x, to_y, begin, pace, high, k, time, place, trig
                                )
                                node, to_node = (
                                    4 * k,
                                    4 * k + 2 * ti.cast(high == time[k + 1], ti.i32),
                                )
                                adds = asks == ADDS
                                if ti.static(steers):
                                    if asks == NEARS:
                                        near = _range(kind, a, b, node, to_node, course, table)
                                        stray = way.k * ti.sqrt(end - begin)
                                        if stray > ti.max(STRAY * near, FINE * unit[which]):
                                            halve = 1
                                    elif way.k > 0.0:
                                        if ti.static(kind == CUBE):
                                            # Passes the middle of the part at the relative speed of
                                            # the leg.
                                            s0 = _apart(
                                                polar,
                                                x,
                                                y,
                                                x,
                                                y,
                                                begin,
                                                0.0,
                                                low,
                                                k,
                                                time,
                                                place,
                                                trig,
                                            )
                                            s1 = _apart(
                                                polar,
                                                x,
                                                y,
                                                x,
                                                y,
                                                begin,
                                                0.0,
                                                high,
                                                k,
                                                time,
                                                place,
                                                trig,
                                            )
                                            v = pieces.leg_velocity(paths, here)
                                            half = 0.5 * (s1 - s0 + v * (high - low))
                                            middle = 0.5 * (a + b)
                                            a, b = middle - half, middle + half
                                        if ti.static(kind == ABEAM):
                                            adds = False
                                            _pass(
                                                a,
                                                b,
                                                node,
                                                to_node,
                                                ti.cast(leg[k], ti.f32),
                                                course,
                                                table,
                                                scale,
                                                own,
                                                scales,
                                                exposure,
                                                passed,
                                                size,
                                                i,
                                            )
                                if adds:
                                    found += _piece(
                                        kind,
                                        a,
                                        b,
                                        a.norm(),
                                        b.norm(),
                                        high - low,
                                        node,
                                        to_node,
                                        course,
                                        table,
                                        scale,
                                        own,
                                        scales,
                                        exposure,
                                        size,
                                        i,
                                    )
                    if halve == 0:
                        total += found
                    if ti.static(steers):
                        if halve == 1:
                            count = paths.piece_count[here]
                            pieces.halve_part(
                                part, later, way, seed0, seed1, i + shift[which], step, count
                            )
                        else:
                            pieces.next_part(part, later, way)
                    else:
                        part.depth = -1
                here = pieces.next_piece(steers, paths, here, state, shore)
            if ti.static(kind != ABEAM):
                exposure[i] += total

    return _expose


_drifting, _steering = _exposing(Straights, False), _exposing(Pieces, True)


class Track(NamedTuple):
    """A sensor's track through a stretch of a step, or a single position, on the host.

    It has k + 1 nodes and k straight pieces.
    """

    time: np.ndarray  # float32 [s after the step's begin], (k + 1,), ascending
    place: np.ndarray  # int32 binary angle, lon and lat of each node, (2 (k + 1),)
    # float32, cosine of latitude and `bend` (see `relative`) of each node, (2 (k + 1),)
    trig: np.ndarray
    # float32, the leg's course (east, north) at begin and end of each piece, (4 k,)
    course: np.ndarray
    searching: np.ndarray  # int32, (k,): 1 where it searches
    leg: np.ndarray  # int32, (k,): number of the leg that it belongs to, from 1


def expose(
    ensemble: Any,
    paths: Paths,
    kind: int,
    track: Track,
    table,
    scale,
    exposure,
    shore: bool = True,
    unit=None,
    passed=None,
) -> None:
    """Add the exposure of particles to a sensor along their paths in the last step, in place.

    Args:
        ensemble: a drift.engine.particles.ensemble.Ensemble, after the step.
        paths: paths of some of its particles; times of the track count from their begin.
        kind: CUBE adds the integral of ds / 2 r^3 [1/m2] where scale is above 0; ABEAM the log of a
            miss at each pass abeam, for each factor of W; ZONES hazards; INSIDE the time inside an
            area, times scale.
        track: the sensor's track.
        table: ABEAM: a lateral range curve; ZONES: radii in pairs [m]; INSIDE: corners of the area
            [m] round the track.
        scale: numbers (m,), or by scenario of the run (scenarios, m). ABEAM: 1 / W by factor [1/m],
            0 for invisible targets; ZONES: rates [1/s].
        exposure: on the device, (n,), for ABEAM (factors * n,).
        shore: whether stranded and grounded particles are visible.
        unit: for steering targets, by scenario: the range [m] below which the sensor resolves
            nothing finer.
        passed: for steering targets and ABEAM, on the device, float32 (n,): number of the leg on
            which each target was last passed.
    """
    e, scale = ensemble, np.asarray(scale, np.float32)
    stride = scale.shape[1] if scale.ndim == 2 else 0
    kernel = _steering if paths.steers else _drifting
    read = runtime.residents(
        *track[:4],
        track.leg * track.searching,
        np.asarray(table, np.float32),
        scale.reshape(-1),
        UNKNOWN if unit is None else np.asarray(unit, np.float32),
    )
    kernel(
        kind,
        paths.polar,
        *paths.own.launched,
        e.scenario,
        e.status,
        e.status_since,
        paths.pack,
        paths.elapsed,
        paths.duration,
        paths.step,
        *noise.key(e.seed),
        *read,
        stride,
        scale.shape[-1],
        exposure,
        exposure if passed is None else passed,
        e.n,
        int(shore),
    )


@ti.func
def _whole(share: ti.f32) -> ti.f32:
    """Return a share of time, set to 1 where only rounding keeps it below 1."""
    return 1.0 if share > 1.0 - 1e-5 else share


@ti.func
def _log_miss(
    meaning: ti.template(),
    both: ti.template(),
    exposure: ti.f32,
    coefficient: ti.f32,
    other: ti.f32,
    other_coefficient: ti.f32,
) -> ti.f32:
    """Return the log miss probability of one particle.

    both: whether the exposure while under way (`other`, `other_coefficient`) counts as well.
    """
    miss = exposure
    if ti.static(meaning == HAZARD):
        miss = -exposure * coefficient
        if ti.static(both):
            miss -= other * other_coefficient
    elif ti.static(meaning == SHARE):
        found = _whole(exposure) * coefficient
        if ti.static(both):
            found += _whole(other) * other_coefficient
        miss = ti.log(ti.max(1.0 - found, 0.0))
    return miss


@ti.func
def _so_far(
    reads: ti.i32,
    sums: ti.i32,
    shared: ti.template(),
    growth: ti.template(),
    f: ti.i32,
    i: ti.i32,
    size: ti.i32,
) -> ti.f32:
    """Return the log of the misses before this one; 0 where none is held (`reads` is 0)."""
    before = 0.0
    if reads == 1:
        if sums == 1:  # noqa: SIM108 - a conditional expression could read beyond the column
            before = -growth[f] * shared[i]
        else:
            before = shared[f * size + i]
    return before


@ti.kernel
def _fail(
    meaning: ti.template(),
    both: ti.template(),
    scenario: Ints,
    exposure: Reals,
    coefficient: HostReals,
    other: Reals,
    other_coefficient: HostReals,
    chances: HostReals,
    growth: HostReals,
    shared: Reals,
    reads: ti.i32,
    keeps: ti.i32,
    sums: ti.i32,
    log_weight: Reals,
    size: ti.i32,
):
    for i in range(size):
        factors = chances.shape[0]
        own = scenario[i] * factors
        most = coefficient[own]
        for f in range(1, factors):
            most = ti.max(most, coefficient[own + f])
        under_way = 0.0
        if ti.static(both):
            under_way = other[i]
            for f in range(factors):
                most = ti.max(most, other_coefficient[own + f])
        if most > 0.0:
            if factors == 1:
                log_weight[i] += _log_miss(
                    meaning, both, exposure[i], coefficient[own], under_way, other_coefficient[own]
                )
            elif log_weight[i] > -ti.math.inf:
                # The weight changes by the ratio of two means over the factor: of the product of
                # all misses so far, with and without this one.
                top_before = top_after = ti.f32(-ti.math.inf)
                mean_before = mean_after = 0.0
                for f in range(factors):
                    top_before = ti.max(
                        top_before, _so_far(reads, sums, shared, growth, f, i, size)
                    )
                for again in ti.static((False, True)):
                    for f in range(factors):
                        before = _so_far(reads, sums, shared, growth, f, i, size)
                        at = i
                        if ti.static(meaning == MISS):
                            at += f * size
                        after = before + _log_miss(
                            meaning,
                            both,
                            exposure[at],
                            coefficient[own + f],
                            under_way,
                            other_coefficient[own + f],
                        )
                        if ti.static(again):
                            mean_after += chances[f] * ti.exp(after - top_after)
                            if keeps == 1:
                                if sums == 0:
                                    shared[f * size + i] = after
                                elif f == factors - 1:  # nothing reads it any more
                                    shared[i] = -after / growth[f]
                        else:
                            mean_before += chances[f] * ti.exp(before - top_before)
                            top_after = ti.max(top_after, after)
                if top_after == -ti.math.inf:
                    log_weight[i] = top_after
                else:
                    log_weight[i] += (
                        top_after + ti.log(mean_after) - top_before - ti.log(mean_before)
                    )


def fail(
    scenario: Any,
    meaning: int,
    exposure: Any,
    coefficient: np.ndarray,
    chances: np.ndarray,
    shared: Any,
    log_weight: Any,
    also: tuple[Any, np.ndarray] | None = None,
    keep: bool = True,
    growth: np.ndarray | None = None,
) -> None:
    """Multiply all weights by the probability that a sortie missed each particle, in place.

    Args:
        scenario: device (n,), the scenario of each slot.
        meaning: of exposure. HAZARD: miss = exp(-exposure * coefficient); SHARE: miss = 1 -
            exposure * coefficient; MISS: the log of the miss itself, one column per factor.
        exposure: device (n,), for MISS (factors * n,).
        coefficient: by scenario and factor of the sweep width, (scenarios, factors); a scenario
            without one above 0 was not searched.
        chances: probability of each factor, (factors,).
        shared: device (factors * n,), logs of the misses so far of all sorties that share the
            unknown factor, or, with `growth`, (n,) the sum of their hazards; None: there were none.
            Used only with several factors: the mean is taken after their product.
        log_weight: device (n,), updated.
        also: exposure while under way and its coefficients, of the same shapes; None: none.
        keep: whether `shared`, if any, takes this miss.
        growth: (factors,), above 0: the coefficients of all these sorties are proportional to it,
            and the meaning of each is HAZARD. None: they are of different forms.
    """
    other, by = also or (exposure, coefficient)
    sums = growth is not None
    coefficients, others, each, grown = runtime.residents(
        *(
            np.asarray(x, np.float32).reshape(-1)
            for x in (coefficient, by, chances, growth if sums else chances)
        )
    )
    _fail(
        meaning,
        also is not None,
        scenario,
        exposure,
        coefficients,
        other,
        others,
        each,
        grown,
        log_weight if shared is None else shared,  # where there is none, the kernel touches none
        int(shared is not None),
        int(shared is not None and keep),
        int(sums),
        log_weight,
        log_weight.shape[0],
    )
