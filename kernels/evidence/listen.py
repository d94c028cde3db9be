"""What a passive sonar has heard of each particle: nothing, with a probability that grows smaller
(kernels.evidence.jumps).

Its signal excess depends on bearing and range. Particles and sonar go straight within a step; the
vector from the sonar to a particle is exact at both ends of a stretch of way, and straight in
between. A stretch is taken in parts, on either side of its nearest point, with the excess at their
ends (the trapezium rule). How long they may be the tables say: see `limits`.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels.evidence import jumps
from kernels.evidence.jumps import STAIRS, Silence
from kernels.maths import sphere
from kernels.runtime import bundle

STEEP = 2.0  # [dB] by which losses, and gains, may change within a part
HIDDEN = 0.4  # [dB] by which they may be better within a part than at its ends
# [m] but parts need not be shorter than this, nor than half of what the table of losses resolves,
FINE = 400.0
# but for what comes near: they need not be shorter than this share of the least range
NARROW = 0.025
CLOSE = 40.0  # [m] nor than this
MOST_PARTS = 256  # of a stretch; and they need not be shorter than its share
# rings or bearings that a part is tried to pass, one after the other
AHEAD = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
# ends of parts whose excess is taken before the silence is made to go on: so the processor need not
# wait
NODES = 16
NOTHING = -1e6  # [dB] excess of what is beyond the table
MARGIN = 100.0  # [m] by which what is out of reach is farther
TURN = 6.283185307179586

f32x2 = ti.types.vector(2, ti.f32)
Nodes = ti.types.vector(NODES, ti.f32)
HostReals = ti.types.ndarray(dtype=ti.f32, ndim=1)

# What a sonar is like on a stretch of its way: numbers, and where its tables have what.
Ear = ti.types.struct(
    lon=ti.i32,  # [binary angle] where it begins the stretch, and where it ends it
    lat=ti.i32,
    to_lon=ti.i32,
    to_lat=ti.i32,
    begin=ti.f32,  # [s after the step's begin]
    end=ti.f32,
    rays=ti.i32,  # bearings of the table of losses, evenly round from north
    rings=ti.i32,  # its ranges, evenly from `nearest`
    nearest=ti.f32,  # [m]
    between=ti.f32,  # [m] from ring to ring
    dense=ti.f32,  # [1/m] 1 / between
    paces=ti.i32,  # speeds of the table of levels
    spread=ti.f32,  # [dB] standard deviation of the fluctuation
    unit=ti.f32,  # [1/dB] 1 / spread
    # [1/s] of its jumps; of a table of POD (kernels.evidence.glimpse) 1 / the time for which that
    # is there
    rate=ti.f32,
    turns=ti.i32,  # bearings of the table of gains and limits, evenly round from north
    reach=ti.f32,  # [m] beyond which nothing can be heard
    moves=ti.f32,  # [m] as far as it goes on the stretch, or farther
    # [binary angle] from column to column of a table of POD by place, whose middle is at lon, lat
    cell_lon=ti.f32,
    cell_lat=ti.f32,  # from row to row
)


@ti.func
def share_of_turn(way: f32x2) -> ti.f32:
    """Return the bearing of (east, north) as a share of a turn, at least 0 and below 1; error 1e-5
    rad, 3 m at 300 km.

    Abramowitz and Stegun 1964, Handbook of Mathematical Functions, eq. 4.4.47.
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
    """Return what a table has at a share of a turn, straight between its entries, which go round
    the circle.
    """
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
    """Return what a table has at a bearing [rad]: see `between`."""
    turned = bearing * ti.f32(1.0 / TURN)
    return between(table, many, stride, at, turned - ti.floor(turned))


@ti.func
def excess(
    ear: Ear,
    losses: ti.template(),
    around: ti.template(),
    limits: ti.template(),
    way: f32x2,
    aside: ti.f32,
) -> f32x2:
    """Return the signal excess [dB] of a source of 0 dB at (east, north) [m] from a sonar, and how
    long a part may be [m].

    losses: [dB] (rays + 1, rings), the last row as the first; around: (turns + 1, 2), array gain
    less noise and threshold [dB] by true bearing, and the last of `limits`. aside: [m] by which its
    line passes the sonar.
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
    """Return the source level [dB] of a scenario at a speed [m/s]; levels: (scenarios * speeds,),
    paces: (speeds,).
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
    """Return whether a source [dB] as far as this [m] or farther may be heard."""
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
    """Have a silence go on for a stretch of way from a to b (east, north) [m] from the sonar, in so
    many seconds.

    source: its level, and what else the excess of all of it has in common [dB]; quiet: [s] before,
    and then at the end, in which nothing can be heard and of which the silence does not yet know.
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
        # a card need not wait, and holds two numbers in registers
        nodes = ti.static(1 if bundle.alone() else NODES)
        here, before = 0.0, 0.0  # shares of the stretch
        while here <= 1.0:
            many = 0
            while many < nodes and here <= 1.0:
                there = excess(ear, losses, around, limits, a + here * d, aside)
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
    """Return the silence of particle i from its columns, but for its log; see `columns`."""
    silence = jumps.at_first()
    edge = edges[i]
    if edge > 0.0:
        silence.edge[0] = edge
        silence.held[0] = held[i]
        many = 1
        # below an edge of 0 is none, and after the last stands -1
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
    """Write the silence of particle i to its columns, and add its log to that there."""
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
    """Return the vector (east, north) [m] from where a sonar is at a time of its stretch to a place
    [binary angle].
    """
    share = (time - ear.begin) / ti.max(ear.end - ear.begin, 1e-6)
    x = ear.lon + ti.cast(ti.round(share * ti.cast(ear.to_lon - ear.lon, ti.f32)), ti.i32)
    y = ear.lat + ti.cast(ti.round(share * ti.cast(ear.to_lat - ear.lat, ti.f32)), ti.i32)
    return sphere.offset_near(x, y, lon, lat)


@ti.func
def out_of_reach(
    ear: Ear, lon: ti.i32, lat: ti.i32, to_lon: ti.i32, to_lat: ti.i32, stray: ti.f32
) -> ti.i32:
    """Return 1 if nothing can be heard of what goes from one place [binary angle] to another and
    strays [m] from that.

    It may be 0 then, too.
    """
    dx, dy = ti.abs(ti.cast(to_lon - lon, ti.f32)), ti.abs(ti.cast(to_lat - lat, ti.f32))
    moves = (dx + dy) * ti.f32(sphere.RADIUS * sphere.UNIT) + ear.moves
    # An arc is at least twice the sine of its half.
    reach = ti.max(ear.reach + moves + stray, 0.0) * ti.f32(0.5 / sphere.RADIUS)
    return ti.cast(sphere.haversine(ear.lon, ear.lat, lon, lat) > reach * reach, ti.i32)


class Tables(NamedTuple):
    """The tables of a sonar on a stretch of its way, on the host; see `excess` and `level`.

    All float32.
    """

    # [dB] (rays, rings), rays evenly round from north, rings evenly from `nearest`
    losses: np.ndarray
    nearest: float  # [m]
    between: float  # [m]
    gains: np.ndarray  # [dB] (sides,)
    levels: np.ndarray  # [dB] (scenarios, speeds)
    paces: np.ndarray  # [m/s] (speeds,)
    spread: float  # [dB]
    rate: float  # [1/s]


class Stretch(NamedTuple):
    """A stretch of a sonar's way within a step."""

    begin: float  # [s after the step's begin]
    end: float
    place: tuple[int, int]  # lon, lat [binary angle] where it begins
    to: tuple[int, int]  # and where it ends


def columns(n: int, factors: int) -> dict[str, np.ndarray]:
    """Return what a sonar that begins to listen keeps of n particles, for each factor of its
    unknown, by name.
    """
    return {
        "log_missed": np.zeros(n * factors, np.float32),
        "edges": np.zeros(n * factors * STAIRS, np.float32),
        "held": np.zeros(n * factors * STAIRS, np.float32),
    }


def limits(tables: Tables) -> np.ndarray:
    """Return the longest integration sub-step and the largest possible signal excess, float32 (2
    rings + turns,).

    For each ring, as far as one may go from between it and the next [m], in or out, so that losses
    change by no more than STEEP and are nowhere lower by more than HIDDEN than at both ends, on any
    bearing; for each ring, the highest excess of a source of 0 dB from it on; for each bearing, as
    far as one may go round [rad] until the same holds for losses and gains. That goes by what lies
    between entries; where it is nothing, a part is as short as `hear` makes them.
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
    """Return how many entries one may pass from between each and the next, either way, (many,); see
    `limits`.

    rows: tables side by side, (tables, AHEAD[-1] + many + AHEAD[-1] + 1).
    """
    values, first = rows.astype(np.float64), AHEAD[-1]
    step = np.diff(values, axis=1)
    # What crosses one entry: of a way of a share of the distance to the next, so much is hidden,
    # and it changes so much.
    before, after = step[:, :-1], step[:, 1:]
    turned = np.where(before * after < 0, 0.5 * np.minimum(np.abs(before), np.abs(after)), 0.0).max(
        axis=0
    )
    steep = np.abs(step).max(axis=0)
    share = 1 / np.maximum(
        1, np.maximum(turned / HIDDEN, np.maximum(steep[:-1], steep[1:]) / STEEP)
    )
    found = np.minimum(share[first - 1 : first - 1 + many], share[first : first + many])
    # What passes more of them.
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
    """Return how many bearings a table has that holds the gains as they are and is no coarser than
    the losses.
    """
    sides = len(tables.gains)
    return sides * math.ceil(len(tables.losses) / sides)


class Laid(NamedTuple):
    """A sonar on a stretch of its way, as kernels take it."""

    ear: Any
    # losses, around (see `excess`), levels, speeds, offsets, limits, all flat
    tables: tuple[np.ndarray, ...]


def laid(stretch: Stretch, tables: Tables, offsets: np.ndarray) -> Laid:
    """Return a sonar on a stretch; offsets: [dB] (factors,), of the unknown that its group shares."""
    rays, rings = tables.losses.shape
    own, turns = limits(tables), _turns(tables)
    gains = np.maximum(np.append(tables.gains, tables.gains[0]), NOTHING)
    gains = np.interp(np.arange(turns + 1) / turns, np.arange(len(gains)) / (len(gains) - 1), gains)
    around = np.stack([gains, np.append(own[2 * rings :], 0.0)], axis=1)
    # What is audible at its loudest, as far as there is any.
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
