"""Probability that a target crosses a fixed line, or enters, leaves or stays in a fixed area.

Everything is computed for one *piece* of path, straight or a Brownian bridge between two positions
(kernels.steering.pieces). A drifting particle has one piece per step; a steering target has
several, which are cut to the window in which the sensor watches. `observe` takes a piece and
returns the probability of no change on it: the line or area is not touched, or the target stays in
the area. Given their ends, pieces are independent of each other, so that the probabilities of all
pieces multiply, whatever the time step.

Where the closed form for a straight line does not apply, the piece is halved at a random midpoint
from the bridge's distribution (Levy's construction: the mean of the ends plus a normal deviation of
K sqrt(dt) / 2), and so on. The result is then an unbiased random estimate of the probability, and
weights stay correct.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.evidence import bridge_touch as touch
from kernels.maths import angles, noise, sphere
from kernels.runtime import batch, rows, runtime
from kernels.steering import pieces
from kernels.steering.itinerary import Chance
from kernels.steering.pieces import NONE, Paths, Pieces, Straights
from kernels.step import life, shore
from kernels.step.coast import Ints, Reals

DEPTH = 14  # most halvings of a piece: to parts of K sqrt(dt) / 128
NODES = 1 << (DEPTH + 1)  # random words reserved for each piece of path
CUTS = 64  # windows of a step with random numbers of their own
PARTS = 4.0  # intervals per standard error of the reported time
# largest share of its length by which a piece's great circle leaves its box in longitude and
# latitude
BULGE = 0.05
METRES = sphere.RADIUS * sphere.UNIT

# Events: a line is touched; a box is touched, or left; a disc is touched, or left.
LINE, BOX, IN_BOX, DISC, IN_DISC = range(5)
# What `observe` returns besides: nothing; the fit of the touch with a reported time; the time of
# the first touch.
WHETHER, REPORT, WHEN = range(3)

HostReals = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32x2 = ti.types.vector(2, ti.f32)
f32x3 = ti.types.vector(3, ti.f32)
f32x4 = ti.types.vector(4, ti.f32)
Ends = ti.types.vector(DEPTH + 1, ti.f32)


Sensor = ti.types.struct(
    lon=ti.i32,  # [binary angle] centre of its plane
    lat=ti.i32,
    turn_cos=ti.f32,  # of the rotation of its axes, clockwise from north
    turn_sin=ti.f32,
    half_width=ti.f32,  # [m] half width of a box; radius of a disc
    half_height=ti.f32,
    west=ti.i32,  # [binary angle] its bounding box
    south=ti.i32,
    width=ti.u32,
    height=ti.u32,
    tau=ti.f32,  # [s] time of a report, then the standard deviation of its error
    error=ti.f32,
)


@ti.func
def _place(kind: ti.template(), sensor: ti.template(), lon: ti.i32, lat: ti.i32) -> f32x2:
    """Return a position in the plane of a sensor [m].

    For a box or disc this is the tangent plane at its centre, which keeps distances and bearings
    from there. For a line it is the gnomonic plane, in which great circles are straight.
    """
    way = sphere.offset(sensor.lon, sensor.lat, lon, lat)
    if ti.static(kind == LINE):
        arc = ti.sqrt(way[0] * way[0] + way[1] * way[1]) * ti.f32(1.0 / sphere.RADIUS)
        if arc > 1e-4:
            way *= angles.tan(ti.min(arc, 1.5)) / arc
    c, s = sensor.turn_cos, sensor.turn_sin
    return f32x2(way[0] * c - way[1] * s, way[0] * s + way[1] * c)


@ti.func
def _stretched(kind: ti.template(), a: f32x2) -> ti.f32:
    """Return the factor by which a variance is larger in the plane of a sensor than on the Earth.

    The gnomonic plane stretches by 1 / cos^2 outwards and by 1 / cos across; this is the mean of
    both: for a line 500 km to either side of its middle K is correct to 0.2 %.
    """
    larger = 1.0
    if ti.static(kind == LINE):
        q = 1.0 + (a[0] * a[0] + a[1] * a[1]) * ti.f32(1.0 / sphere.RADIUS / sphere.RADIUS)
        larger = q * ti.sqrt(q)
    return larger


@ti.func
def _near(sensor: ti.template(), piece: ti.template()):
    """Return whether a piece of path may come within the sensor's bounding box."""
    dlon, dlat = piece.to_lon - piece.lon, ti.cast(piece.to_lat - piece.lat, ti.f32)
    c = sphere.cos_lat(ti.max(ti.abs(piece.lat), ti.abs(piece.to_lat)))
    wide = ti.abs(ti.cast(dlon, ti.f32))
    reach = (touch.REACH * piece.k * ti.sqrt(piece.end - piece.begin) + 1.0) * ti.f32(1.0 / METRES)
    reach += BULGE * (wide * c + ti.abs(dlat))
    low = ti.min(ti.cast(piece.lat, ti.f32), ti.cast(piece.to_lat, ti.f32)) - reach
    high = ti.max(ti.cast(piece.lat, ti.f32), ti.cast(piece.to_lat, ti.f32)) + reach
    south = ti.cast(sensor.south, ti.f32)
    near = low <= south + ti.cast(sensor.height, ti.f32) and high >= south
    c = sphere.cos_lat(ti.cast(ti.min(ti.max(ti.abs(low), ti.abs(high)), 1.07e9), ti.i32))
    span = wide + 2.0 * reach / c
    if near and span < 2.0e9:
        begin = piece.lon + ti.min(dlon, 0) - ti.cast(reach / c, ti.i32)
        east, west = ti.cast(sensor.west - begin, ti.u32), ti.cast(begin - sensor.west, ti.u32)
        near = ti.cast(east, ti.f32) <= span or west <= sensor.width
    return near


@ti.func
def _known(
    kind: ti.template(),
    sensor: ti.template(),
    a: f32x2,
    b: f32x2,
    variance: ti.f32,
    corners: ti.template(),
) -> f32x4:
    """Return (state, p, before, after) of a piece from a to b; see kernels.evidence.bridge_touch.polyline.

    p is the probability of a change: a touch, or leaving the area.
    """
    half = f32x2(sensor.half_width, sensor.half_height)
    told = ti.cast(touch.TOLD, ti.f32)
    found = f32x4(told, 1.0, 1.0, -1.0)
    if ti.static(kind == LINE):
        found = touch.polyline(a, b, variance, corners)
    elif ti.static(kind == BOX):
        if touch.within(a, half) == 0 and touch.within(b, half) == 0:
            found = touch.polyline(a, b, variance, corners)
    elif ti.static(kind == IN_BOX):
        found[1] = 1.0 - touch.box(a, b, half, variance)
    else:
        inside_a = a[0] * a[0] + a[1] * a[1] < half[0] * half[0]
        inside_b = b[0] * b[0] + b[1] * b[1] < half[0] * half[0]
        if ti.static(kind == DISC):
            if not inside_a and not inside_b:
                found = touch.disc(a, b, half[0], variance)
        else:
            if inside_a and inside_b:
                found = touch.disc(a, b, half[0], variance)
    return found


@ti.func
def _fit(time: ti.f32, sensor: ti.template()) -> ti.f32:
    """Return the density [1/s] of the sensor's reported time if the touch was at `time`."""
    z = (time - sensor.tau) / sensor.error
    return ti.exp(-0.5 * z * z) * 0.3989422804014327 / sensor.error


@ti.func
def _fits(
    sensor: ti.template(), known: f32x4, variance: ti.f32, begin: ti.f32, lasting: ti.f32
) -> ti.f32:
    """Return the integral of the first touch's density times the report's over a piece [1/s].

    On a straight piece the touch has one possible time. Otherwise the report's density is taken at
    the middle of intervals of a fourth of its standard error; beyond six standard errors it is
    zero.
    """
    before, after = known[2], known[3]
    total = 0.0
    if variance <= 0.0:
        total = known[1] * _fit(
            begin + lasting * ti.abs(before) / ti.max(ti.abs(before - after), 1e-30), sensor
        )
    else:
        low = ti.max((sensor.tau - 6.0 * sensor.error - begin) / lasting, 0.0)
        high = ti.min((sensor.tau + 6.0 * sensor.error - begin) / lasting, 1.0)
        if low < high:
            many = ti.max(
                ti.cast(ti.ceil(PARTS * (high - low) * lasting / sensor.error), ti.i32), 1
            )
            share = (high - low) / many
            past = touch.by(before, after, variance, low)
            for part in range(many):
                gone = touch.by(before, after, variance, low + share * (part + 1))
                total += (gone - past) * _fit(
                    begin + lasting * (low + share * (part + 0.5)), sensor
                )
                past = gone
    return total


@ti.func
def observe(
    kind: ti.template(),
    besides: ti.template(),
    piece: ti.template(),
    sensor: ti.template(),
    corners: ti.template(),
    key,
) -> f32x3:
    """Return (stays, fits, when) of one piece of path.

    kind: the event, LINE to IN_DISC; besides: WHETHER, REPORT or WHEN. piece: a
    kernels.steering.pieces.Piece; sensor: a `Sensor`; corners: of a line or box in its plane, (x,
    y, x, y, ...) [m]. key: of the random numbers, a kernels.steering.itinerary.Chance, whose count
    is the number of the piece in the step.

    stays: the probability of no change on the piece. fits: with REPORT, the integral over the piece
    of the density of the first touch times that of the report given the touch [1/s]. when: with
    WHEN, the time of the first touch, sampled from its distribution; -1: no touch.
    """
    stays, fits, when = 1.0, 0.0, -1.0
    near = _near(sensor, piece)
    if not near:
        if ti.static(kind == IN_BOX or kind == IN_DISC):
            stays = 0.0
    else:
        left = _place(kind, sensor, piece.lon, piece.lat)
        right = _place(kind, sensor, piece.to_lon, piece.to_lat)
        span = ti.max(piece.end - piece.begin, 0.0)
        whole = piece.k * piece.k * span * _stretched(kind, left)
        right_x, right_y = Ends(0.0), Ends(0.0)
        right_x[0], right_y[0] = right[0], right[1]
        node, depth, begin, size = 1, 0, 0.0, 1.0
        while node > 0 and stays > 0.0:
            b = f32x2(right_x[depth], right_y[depth])
            variance = whole * size
            known = _known(kind, sensor, left, b, variance, corners)
            if known[0] == touch.OPEN and depth < DEPTH and variance > 0.0:
                w = _words(key, node)
                n = noise.normals(w[0], w[1]) * (0.5 * ti.sqrt(variance))
                c, s = sensor.turn_cos, sensor.turn_sin
                middle = 0.5 * (left + b) + f32x2(n[0] * c - n[1] * s, n[0] * s + n[1] * c)
                depth, node, size = depth + 1, 2 * node, 0.5 * size
                right_x[depth], right_y[depth] = middle[0], middle[1]
            else:
                if ti.static(besides == REPORT):
                    if known[1] > 0.0:
                        fits += stays * _fits(
                            sensor, known, variance, piece.begin + span * begin, span * size
                        )
                if ti.static(besides == WHEN):
                    if when < 0.0 and known[1] > 0.0:
                        w = _words(key, node)
                        if noise.uniform(w[2]) < known[1]:
                            share = _first(
                                known, variance, noise.normals(w[0], w[1])[0], noise.uniform(w[3])
                            )
                            when = piece.begin + span * (begin + size * share)
                stays *= 1.0 - known[1]
                left, begin = b, begin + size
                while node & 1 == 1 and node > 1:
                    node, depth, size = node >> 1, depth - 1, 2.0 * size
                if node == 1:
                    node = 0
                else:  # go on with the other half of the parent
                    node += 1
                    right_x[depth], right_y[depth] = right_x[depth - 1], right_y[depth - 1]
    return f32x3(stays, fits, when)


@ti.func
def _told_by(
    besides: ti.template(), log_stayed: ti.f32, told: ti.f32, found: f32x3, since: ti.f32
) -> ti.f32:
    """Return the sensor's reading of a path extended by one more piece.

    log_stayed: log of the probability of no change before the piece. told: the reading so far, at
    first 0 (REPORT) or -1 (WHEN). found: result of `observe` for the piece; since: origin of the
    piece's times [s after the run's start].
    """
    now = told
    if ti.static(besides == REPORT):
        now += ti.exp(log_stayed) * found[1]
    if ti.static(besides == WHEN):
        if found[2] >= 0.0 and told < 0.0:
            now = since + found[2]
    return now


@ti.func
def _words(key, node: ti.i32):
    """Return random words for a node of a piece; 1: the whole, 2 n and 2 n + 1: the halves of n."""
    return noise.further(
        key.seed0, key.seed1, noise.STREAM_TOUCH, key.slot, key.step, key.count * NODES + node
    )


@ti.func
def _first(known: f32x4, variance: ti.f32, normal: ti.f32, uniform: ti.f32) -> ti.f32:
    """Sample at which share of a piece a bridge that touches a line does so for the first time."""
    before, after = ti.abs(known[2]), ti.abs(known[3])
    return shore.landing(before / ti.max(before + after, 1e-30), before, variance, normal, uniform)


def _observing(Ways: Any, steers: bool) -> Any:
    """Return the kernel for one kind of path: `Straights` (drifting) or `Pieces` (steering)."""

    @ti.kernel
    def _observe(
        kind: ti.template(),
        besides: ti.template(),
        listed: ti.template(),
        first: ti.i32,
        last: ti.i32,
        slots: Ints,
        shift: Ints,
        scenario: Ints,
        status: Ints,
        status_since: Ints,
        there_since: Ints,
        there_at: ti.i32,
        paths: Ways,
        before_lon: Ints,
        before_lat: Ints,
        after_lon: Ints,
        after_lat: Ints,
        since: ti.i32,
        lasting: ti.i32,
        step: ti.i32,
        count: ti.i32,
        seed0: ti.u32,
        seed1: ti.u32,
        k: ti.f32,
        sensor: Sensor,
        corners: HostReals,
        stayed: Reals,
        told: Reals,
    ):
        for nth in range(first, last):
            i = batch.slot(listed, slots, nth)
            state, log_stayed, stays = status[i], stayed[i], 1.0
            here = pieces.first_piece(steers, paths, i, state, since, 0)
            if ti.static(not steers):
                times = life.behind(
                    state, paths.release[i], status_since[i], paths.moving_since[i], since, lasting
                )
                there = times[3] > times[0]
                if ti.static(kind == IN_BOX or kind == IN_DISC):
                    there = there_since[there_at + i] <= since and times[3] >= since + lasting
                if not there:
                    here = NONE
            if ti.static(kind == IN_BOX or kind == IN_DISC):
                # A target that has gone adrift has no steered path either: it is observed as it
                # drifts. One that is still under way has no straight one.
                elsewhere = state <= life.PENDING
                if ti.static(steers):
                    elsewhere = state == life.PENDING or state == life.LEFT
                if here == NONE and elsewhere:
                    stays = 0.0
            while here != NONE and stays > 0.0 and log_stayed > -ti.math.inf:
                piece = pieces.load_piece(
                    steers, paths, i, here, state, status_since[i], since, lasting, 1
                )
                asked, number = True, count
                if ti.static(steers):
                    whole = ti.cast(lasting, ti.f32)
                    asked, number = (
                        piece.end > 0.0 and piece.begin < whole,
                        paths.piece_count[here] * CUTS + count,
                    )
                    if ti.static(kind == IN_BOX or kind == IN_DISC):
                        if here == i and piece.begin > 0.0:  # it departs after the window's begin
                            stays = 0.0
                    if piece.begin < 0.0:
                        piece.lon, piece.lat, piece.begin = before_lon[i], before_lat[i], 0.0
                    if piece.end > whole:
                        piece.to_lon, piece.to_lat, piece.end = after_lon[i], after_lat[i], whole
                else:
                    piece.k, piece.end = k, ti.max(piece.begin, piece.end)
                if asked and stays > 0.0:
                    slot = i + shift[scenario[i]]
                    key = Chance(seed0, seed1, slot, slot, step, number)
                    found = observe(kind, besides, piece, sensor, corners, key)
                    if ti.static(besides != WHETHER):
                        so_far = log_stayed + ti.log(stays)
                        told[i] = _told_by(besides, so_far, told[i], found, ti.cast(since, ti.f32))
                    stays *= found[0]
                here = pieces.next_piece(steers, paths, here, state, 0)
            if stays < 1.0:
                stayed[i] = log_stayed + ti.log(stays)

    return _observe


_drifting, _steering = _observing(Straights, False), _observing(Pieces, True)


class Shape(NamedTuple):
    """The area or line that a sensor watches, on the host; see `Sensor`."""

    kind: int
    lon: int
    lat: int
    turn_cos: float
    turn_sin: float
    half_width: float
    half_height: float
    box: tuple[int, int, int, int]  # west, south, width, height [binary angle]
    corners: np.ndarray  # float32 (2 m,)


class Window(NamedTuple):
    """A part of a lattice step."""

    step: int  # number of the step, a key of its random numbers
    count: int  # number of the part in the step
    since: int  # [s after the run's start]
    lasting: int  # [s]


def observe_along(
    ensemble: Any,
    paths: Paths,
    before: tuple[Any, Any],
    after: tuple[Any, Any],
    window: Window,
    k: float,
    shape: Shape,
    besides: int,
    report: tuple[float, float],
    stayed: Any,
    told: Any,
) -> None:
    """Add a sensor's reading of particles along their paths, over a part of the last step.

    Args:
        ensemble: a drift.engine.particles.ensemble.Ensemble, after the step.
        paths: paths of some of its particles. Those of drifting particles cover the part only,
            those of steering targets the whole step.
        before: lon, lat [binary angle] at the begin of the part, on the device; paths of steering
            targets are cut there.
        after: lon, lat [binary angle] at its end.
        window: the part.
        k: K of the bridges of drifting particles [m/sqrt(s)].
        shape: what the sensor watches.
        besides: WHETHER, REPORT or WHEN.
        report: time of the report [s after the run's start] and its standard error [s].
        stayed: device (n,), log of the probability of no change; updated.
        told: device (n,), updated: with REPORT the sum of the fits [1/s], with WHEN the time of the
            first touch [s], -1 before it; not used with WHETHER.
    """
    e, kernel = ensemble, _steering if paths.steers else _drifting
    kernel(
        shape.kind,
        besides,
        *paths.own.launched,
        e.scenario,
        e.status,
        e.status_since,
        *rows.located(e.own.get("departure", e.release)),
        paths.pack,
        *before,
        *after,
        window.since,
        window.lasting,
        window.step,
        window.count,
        *noise.key(e.seed),
        float(k),
        sensor(shape, window, report),
        *runtime.residents(shape.corners),
        stayed,
        told,
    )


def sensor(shape: Shape, window: Window, report: tuple[float, float]) -> Any:
    """Return a sensor as kernels take it, with times from the window's begin.

    report: its time and standard error [s].
    """
    west, south, width, height = shape.box
    return Sensor(
        lon=shape.lon,
        lat=shape.lat,
        turn_cos=shape.turn_cos,
        turn_sin=shape.turn_sin,
        half_width=shape.half_width,
        half_height=shape.half_height,
        west=west,
        south=south,
        width=width,
        height=height,
        tau=float(report[0] - window.since),
        error=float(report[1]),
    )
