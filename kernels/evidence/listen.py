"""Probability that a passive sonar has not detected each particle (kernels.evidence.jumps).

The signal excess depends on bearing and range. Particles and sonar move straight within a step; the
vector from the sonar to a particle is exact at both ends of a stretch, and linear in between. A
stretch is integrated in parts on either side of its closest point of approach, with the excess at
the ends of parts (trapezium rule). `limits` derives the longest allowed parts from the tables.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.evidence import jumps
from kernels.evidence.jumps import STAIRS, Silence
from kernels.maths import sphere
from kernels.runtime import bundle

STEEP = 2.0  # [dB] largest change of losses, and of gains, within a part
HIDDEN = 0.4  # [dB] by which losses may be lower inside a part than at its ends
# [m] parts need not be shorter than this, nor than half the spacing of the table's rings,
FINE = 400.0
# except close to the sonar, where the bound is this share of the least range
NARROW = 0.025
CLOSE = 40.0  # [m] or this, whichever is larger
MOST_PARTS = 256  # most parts of a stretch, which bounds their length as well
# numbers of rings or bearings that a part may pass, tried in this order
AHEAD = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
# ends of parts whose excess is computed before the silence is advanced, so that the processor need
# not wait
NODES = 16
NOTHING = -1e6  # [dB] excess outside the table
MARGIN = 100.0  # [m] safety margin of `reach`
TURN = 6.283185307179586

f32x2 = ti.types.vector(2, ti.f32)
Nodes = ti.types.vector(NODES, ti.f32)
HostReals = ti.types.ndarray(dtype=ti.f32, ndim=1)

# A sensor on a stretch of its track: numbers, and the layout of its tables.
Ear = ti.types.struct(
    lon=ti.i32,  # [binary angle] position at the begin, then at the end of the stretch
    lat=ti.i32,
    to_lon=ti.i32,
    to_lat=ti.i32,
    begin=ti.f32,  # [s after the step's begin]
    end=ti.f32,
    rays=ti.i32,  # bearings of the table of losses, evenly spaced from north
    rings=ti.i32,  # its ranges, evenly spaced from `nearest`
    nearest=ti.f32,  # [m]
    between=ti.f32,  # [m] between rings
    dense=ti.f32,  # [1/m] 1 / between
    paces=ti.i32,  # speeds of the table of levels
    spread=ti.f32,  # [dB] standard deviation of the fluctuation
    unit=ti.f32,  # [1/dB] 1 / spread
    # [1/s] of the fluctuation's jumps; for a table of POD (kernels.evidence.glimpse) 1 / the time
    # of exposure to which the POD refers
    rate=ti.f32,
    turns=ti.i32,  # bearings of the table of gains and limits, evenly spaced from north
    reach=ti.f32,  # [m] beyond which nothing can be heard
    moves=ti.f32,  # [m] upper bound of its movement on the stretch
    # [binary angle] spacing of columns of a table of POD by place, whose middle is at lon, lat
    cell_lon=ti.f32,
    cell_lat=ti.f32,  # spacing of rows
)


@ti.func
def share_of_turn(way: f32x2) -> ti.f32:
    """Return the bearing of (east, north) as a share of a turn in [0, 1); error 1e-5 rad.

    The error is 3 m at 300 km. Abramowitz and Stegun 1964, Handbook of Mathematical Functions, eq.
    4.4.47.
    """
    x, y = ti.abs(way[0]), ti.abs(way[1])
    q = ti.min(x, y) / ti.max(ti.max(x, y), 1e-30)
    z = q * q
    zz = z * z
    p = (0.9998660 - z * 0.3302995) + zz * ((0.1801410 - z * 0.0851330) + zz * 0.0208351)
    turn = q * p * ti.f32(1.0 / TURN)
    turn = ti.select(x > y, 0.25 - turn, turn)
    turn = ti.select(way[1] < 0.0, 0.5 - turn, turn)
    turn = ti.select(way[0] < 0.0, 1.0 - turn, turn)
    return ti.select(turn < 1.0, turn, 0.0)


@ti.func
def between(table: ti.template(), many: ti.i32, stride: ti.i32, at: ti.i32, turn: ti.f32) -> ti.f32:
    """Return a table's value at a share of a turn, linear between entries round the circle."""
    found = table[at]
    if many > 1:
        place = turn * many
        k = ti.min(ti.cast(place, ti.i32), many - 1)
        share = place - k
        after = k + 1
        if after == many:
            after = 0
        low, high = table[k * stride + at], table[after * stride + at]
        found = low + share * (high - low)
    return found


@ti.func
def round_table(
    table: ti.template(), many: ti.i32, stride: ti.i32, at: ti.i32, bearing: ti.f32
) -> ti.f32:
    """Return a table's value at a bearing [rad]: see `between`."""
    turned = bearing * ti.f32(1.0 / TURN)
    return between(table, many, stride, at, turned - ti.floor(turned))


@ti.func
def _excess(
    ear: Ear,
    losses: ti.template(),
    around: ti.template(),
    limits: ti.template(),
    way: f32x2,
    aside: ti.f32,
) -> f32x2:
    """Return (signal excess of a source of 0 dB [dB], longest part [m]) at a relative position.

    way: (east, north) [m] from the sonar. losses: [dB] (rays + 1, rings), the last row repeats the
    first; around: (turns + 1, 2), array gain less noise and threshold [dB] by true bearing, and the
    last part of `limits`. aside: [m] least distance of the particle's straight track from the
    sonar.
    """
    far = ti.sqrt(way[0] * way[0] + way[1] * way[1])
    ring = ti.max((far - ear.nearest) * ear.dense, 0.0)
    k = ti.min(ti.cast(ti.min(ring, 1e9), ti.i32), ear.rings - 2)
    share = ti.min(ring - k, 1.0)
    turn = 0.0
    if ear.turns > 1:
        turn = share_of_turn(way)
    place = turn * ear.turns
    j = ti.min(ti.cast(place, ti.i32), ear.turns - 1)
    found = f32x2(NOTHING, 0.0)
    wide = around[2 * j + 1] * far
    found[1] = ti.min(limits[k], wide * far / (aside + wide + 1e-3))
    if ring <= ear.rings - 1.0:
        gain = around[2 * j] + (place - j) * (around[2 * j + 2] - around[2 * j])
        place = turn * ear.rays
        ray = ti.min(ti.cast(place, ti.i32), ear.rays - 1)
        at = ray * ear.rings + k
        low = losses[at] + share * (losses[at + 1] - losses[at])
        at += ear.rings
        high = losses[at] + share * (losses[at + 1] - losses[at])
        found[0] = ti.max(gain - (low + (place - ray) * (high - low)), NOTHING)
    return found


@ti.func
def level(levels: ti.template(), paces: ti.template(), scenario: ti.i32, speed: ti.f32) -> ti.f32:
    """Return the source level [dB] of a scenario at a speed [m/s].

    levels: [dB] (scenarios * speeds,); paces: [m/s] (speeds,).
    """
    many = paces.shape[0]
    k = 0
    while k < many - 2 and speed > paces[k + 1]:
        k += 1
    found = levels[scenario * many + k]
    if many > 1:
        share = (speed - paces[k]) / (paces[k + 1] - paces[k])
        found += ti.min(ti.max(share, 0.0), 1.0) * (levels[scenario * many + k + 1] - found)
    return found


@ti.func
def audible(ear: Ear, limits: ti.template(), far: ti.f32, source: ti.f32) -> ti.i32:
    """Return 1 if a source [dB] at this distance [m] or farther may be heard, else 0."""
    ring = (far - ear.nearest) * ear.dense
    found = 0
    if ring <= ear.rings - 1.0:
        best = limits[ear.rings + ti.cast(ti.max(ring, 0.0), ti.i32)] + source
        found = ti.cast(best * ear.unit > jumps.QUIET, ti.i32)
    return found


@ti.func
def hear(
    silence: ti.template(),
    quiet: ti.template(),
    ear: Ear,
    losses: ti.template(),
    around: ti.template(),
    limits: ti.template(),
    a: f32x2,
    b: f32x2,
    lasting: ti.f32,
    source: ti.f32,
):
    """Advance a silence along a straight stretch from a to b, (east, north) [m] from the sonar.

    lasting: duration [s]. source: source level plus all other terms of the excess that are constant
    on the stretch [dB]. quiet: inaudible time [s] that the silence has not been advanced by yet;
    updated.
    """
    d = b - a
    dd = d[0] * d[0] + d[1] * d[1]
    nearest = ti.min(ti.max(-(a[0] * d[0] + a[1] * d[1]) / ti.max(dd, 1e-12), 0.0), 1.0)
    at = a + nearest * d
    far, length = at.norm(), ti.max(ti.sqrt(dd), 1.0)
    if audible(ear, limits, far, source) == 0:
        quiet += lasting
    else:
        fine = ti.min(ti.max(0.5 * ear.between, FINE), ti.max(NARROW * far, CLOSE))
        unit = 1.0 / length
        least = ti.max(fine * unit, 1.0 / MOST_PARTS)
        aside = ti.abs(a[1] * d[0] - a[0] * d[1]) * unit
        chances, parts = Nodes(0.0), Nodes(0.0)
        # a graphics card need not wait, and one node fits its registers
        nodes = ti.static(1 if bundle.alone() else NODES)
        here, before = 0.0, 0.0  # shares of the stretch
        while here <= 1.0:
            many = 0
            while many < nodes and here <= 1.0:
                there = _excess(ear, losses, around, limits, a + here * d, aside)
                deviations = (there[0] + source) * ear.unit
                part = ti.max(there[1] * unit, least)
                stop = nearest if here < nearest else 1.0
                then = here + part
                if then > stop - 0.3 * least:
                    part, then = stop - here, ti.select(here < 1.0, stop, 2.0)
                chances[many] = ti.select(deviations > jumps.QUIET, jumps.chance(deviations), 0.0)
                parts[many] = 0.5 * (before + part) * lasting
                before, here = part, then
                many += 1
            for k in range(many):
                if chances[k] > 0.0:
                    jumps.settle(silence, ear.rate, quiet)
                    quiet = 0.0
                    jumps.go_on(silence, chances[k], ear.rate, parts[k])
                else:
                    quiet += parts[k]


@ti.func
def taken(i: ti.i32, size: ti.i32, edges: ti.template(), held: ti.template()) -> Silence:
    """Load the silence of particle i from its columns (see `columns`), with log 0."""
    silence = jumps.at_first()
    edge = edges[i]
    if edge > 0.0:
        silence.edge[0] = edge
        silence.held[0] = held[i]
        many = 1
        # no step lies below an edge of 0, and -1 marks the end
        while many < STAIRS and edge > 0.0:
            edge = edges[many * size + i]
            if edge >= 0.0:
                silence.edge[many], silence.held[many] = edge, held[many * size + i]
                many += 1
        silence.many = many
    return silence


@ti.func
def put(
    silence: ti.template(),
    i: ti.i32,
    size: ti.i32,
    log_missed: ti.template(),
    edges: ti.template(),
    held: ti.template(),
):
    """Store the silence of particle i in its columns and add its log to `log_missed`."""
    log = jumps.log_missed(silence)
    if log < 0.0:
        log_missed[i] += log
    many = silence.many
    if silence.edge[0] != 0.0 or edges[i] != 0.0:
        for j in range(many):
            edges[j * size + i] = silence.edge[j]
            held[j * size + i] = jumps.height(silence, j)
        if many < STAIRS and silence.edge[many - 1] > 0.0:
            edges[many * size + i] = -1.0


@ti.func
def to(ear: Ear, time: ti.f32, lon: ti.i32, lat: ti.i32) -> f32x2:
    """Return the vector (east, north) [m] from the sonar at a time of its stretch to a position."""
    share = (time - ear.begin) / ti.max(ear.end - ear.begin, 1e-6)
    x = ear.lon + ti.cast(ti.round(share * ti.cast(ear.to_lon - ear.lon, ti.f32)), ti.i32)
    y = ear.lat + ti.cast(ti.round(share * ti.cast(ear.to_lat - ear.lat, ti.f32)), ti.i32)
    return sphere.offset_near(x, y, lon, lat)


@ti.func
def out_of_reach(
    ear: Ear, lon: ti.i32, lat: ti.i32, to_lon: ti.i32, to_lat: ti.i32, stray: ti.f32
) -> ti.i32:
    """Return 1 if a path between two positions [binary angle] is surely inaudible throughout.

    stray: [m] by which the path may leave the straight line. 0 means that it may be audible.
    """
    dx, dy = ti.abs(ti.cast(to_lon - lon, ti.f32)), ti.abs(ti.cast(to_lat - lat, ti.f32))
    moves = (dx + dy) * ti.f32(sphere.RADIUS * sphere.UNIT) + ear.moves
    # An arc is at least twice the sine of its half.
    reach = ti.max(ear.reach + moves + stray, 0.0) * ti.f32(0.5 / sphere.RADIUS)
    return ti.cast(sphere.haversine(ear.lon, ear.lat, lon, lat) > reach * reach, ti.i32)


class Tables(NamedTuple):
    """Tables of a sonar on a stretch of its track, on the host; see `_excess` and `level`.

    All arrays are float32.
    """

    # [dB] (rays, rings): bearings evenly spaced from north, ranges evenly spaced from `nearest`
    losses: np.ndarray
    nearest: float  # [m]
    between: float  # [m]
    gains: np.ndarray  # [dB] (sides,)
    levels: np.ndarray  # [dB] (scenarios, speeds)
    paces: np.ndarray  # [m/s] (speeds,)
    spread: float  # [dB]
    rate: float  # [1/s]


class Stretch(NamedTuple):
    """A straight part of a sensor's track within a step."""

    begin: float  # [s after the step's begin]
    end: float
    place: tuple[int, int]  # lon, lat [binary angle] at its begin
    to: tuple[int, int]  # and at its end


def columns(n: int, factors: int) -> dict[str, np.ndarray]:
    """Return the initial state of n particles for a sonar that starts to listen, by column name.

    factors: quadrature nodes of the unknown that the sonar's group shares.
    """
    return {
        "log_missed": np.zeros(n * factors, np.float32),
        "edges": np.zeros(n * factors * STAIRS, np.float32),
        "held": np.zeros(n * factors * STAIRS, np.float32),
    }


def limits(tables: Tables) -> np.ndarray:
    """Return the longest integration sub-step and the largest possible signal excess.

    The array is float32, (2 rings + turns,):

    - rings values: the longest radial distance [m] from between this ring and the next, inwards or
      outwards, on which losses change by at most STEEP and nowhere are lower by more than HIDDEN
      than at both ends, on any bearing;
    - rings values: the highest excess of a source of 0 dB at this ring or farther;
    - turns values: the largest change of bearing [rad] for which the same holds for losses and
      gains.

    They come from the values between entries of the tables. Where that allows no distance at all, a
    part is as short as `hear` permits.
    """
    losses, gains = tables.losses, tables.gains
    rings, turns = losses.shape[1], _turns(tables)
    best = np.maximum.accumulate((-losses.min(axis=0))[::-1])[::-1].astype(np.float64) + gains.max()
    longest = (
        _free(np.pad(losses, ((0, 0), (AHEAD[-1], AHEAD[-1] + 1)), "edge"), rings) * tables.between
    )
    widest = np.full(turns, float(turns))
    for table in (gains[:, None], losses):
        many = len(table)
        if many > 1:
            rows = np.pad(table.T, ((0, 0), (AHEAD[-1], AHEAD[-1] + 1)), "wrap")
            own = _free(rows, many) * (turns / many)
            widest = np.minimum(widest, own[np.arange(turns) * many // turns])
    return np.concatenate([longest, np.maximum(best, NOTHING), widest * (TURN / turns)]).astype(
        np.float32
    )


def _free(rows: np.ndarray, many: int) -> np.ndarray:
    """Return how many entries may be passed from between each and the next, either way, (many,).

    rows: tables side by side, (tables, AHEAD[-1] + many + AHEAD[-1] + 1). See `limits`.
    """
    values, first = rows.astype(np.float64), AHEAD[-1]
    step = np.diff(values, axis=1)
    # Parts that cross one entry: for a part of this share of the spacing, how much is hidden, and
    # how much the value changes.
    before, after = step[:, :-1], step[:, 1:]
    turned = np.where(before * after < 0, 0.5 * np.minimum(np.abs(before), np.abs(after)), 0.0).max(
        axis=0
    )
    steep = np.abs(step).max(axis=0)
    share = 1 / np.maximum(
        1, np.maximum(turned / HIDDEN, np.maximum(steep[:-1], steep[1:]) / STEEP)
    )
    found = np.minimum(share[first - 1 : first - 1 + many], share[first : first + many])
    # Parts that pass several entries.
    up = np.cumsum(np.abs(np.diff(values, axis=1, prepend=values[:, :1])), axis=1)
    good = np.ones(many, bool)
    for ahead in AHEAD:
        span = ahead + 1
        change = np.abs(values[:, span:] - values[:, :-span])
        hidden = 0.5 * (up[:, span:] - up[:, :-span] - change)
        fits = (change.max(axis=0) <= STEEP) & (hidden.max(axis=0) <= HIDDEN)
        good &= fits[first : first + many] & fits[first - ahead : first - ahead + many]
        found[good] = ahead
    return found


def _turns(tables: Tables) -> int:
    """Return the number of bearings of `around`: a multiple of the gains', at least the losses'."""
    sides = len(tables.gains)
    return sides * math.ceil(len(tables.losses) / sides)


class Laid(NamedTuple):
    """A sonar on a stretch of its track, as kernels take it."""

    ear: Any
    # losses, around (see `_excess`), levels, speeds, offsets, limits, all flat
    tables: tuple[np.ndarray, ...]


def laid(stretch: Stretch, tables: Tables, offsets: np.ndarray) -> Laid:
    """Return a sonar on a stretch; offsets: [dB] (factors,), nodes of its group's unknown."""
    rays, rings = tables.losses.shape
    own, turns = limits(tables), _turns(tables)
    gains = np.maximum(np.append(tables.gains, tables.gains[0]), NOTHING)
    gains = np.interp(np.arange(turns + 1) / turns, np.arange(len(gains)) / (len(gains) - 1), gains)
    around = np.stack([gains, np.append(own[2 * rings :], 0.0)], axis=1)
    # Farthest range at which the loudest source is audible, if any.
    best = own[rings : 2 * rings] + float(tables.levels.max()) + float(offsets.max())
    audible = int(np.count_nonzero(best > jumps.QUIET * tables.spread))
    reach = tables.nearest + tables.between * audible + MARGIN if audible else -1e9
    x, y = ((b - a + 2**31) % 2**32 - 2**31 for a, b in zip(stretch.place, stretch.to, strict=True))
    ear = Ear(
        lon=stretch.place[0],
        lat=stretch.place[1],
        to_lon=stretch.to[0],
        to_lat=stretch.to[1],
        begin=stretch.begin,
        end=stretch.end,
        rays=rays,
        rings=rings,
        nearest=tables.nearest,
        between=tables.between,
        dense=1.0 / tables.between,
        paces=len(tables.paces),
        spread=tables.spread,
        unit=1.0 / tables.spread,
        rate=tables.rate,
        turns=turns,
        reach=reach,
        moves=(abs(x) + abs(y)) * sphere.UNIT * sphere.RADIUS,
        cell_lon=1.0,
        cell_lat=1.0,
    )
    losses = np.concatenate([tables.losses, tables.losses[:1]])
    every = losses, around, tables.levels, tables.paces, offsets, own[: 2 * rings]
    return Laid(ear, tuple(np.ascontiguousarray(x, np.float32).reshape(-1) for x in every))
