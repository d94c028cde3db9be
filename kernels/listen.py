"""What a passive sonar has heard of each particle: nothing, with a probability that grows smaller (kernels.jumps).

Its signal excess depends on bearing and range. Particles and sonar go straight within a step; the vector from the sonar to
a particle is exact at both ends of a stretch of way, and straight in between. Of the stretch, parts are taken in which the
range changes by no more than half of what the table of losses resolves, with the excess at their ends and at the nearest point.
"""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from kernels import batch, jumps, life, sphere
from kernels.batch import Batch
from kernels.coast import Ints, Reals
from kernels.jumps import STAIRS, Silence

FINE = 400.0  # [m] parts of a stretch of way are not made shorter than this, however fine the table of losses
NARROW = 0.025  # but for what comes near: they are no longer than this share of the least range
CLOSE = 40.0  # [m] and not shorter than this
MOST_PARTS = 256  # of a stretch, on either side of its nearest point
STILL = 1.0  # [m] a shorter way is none
TURN = 6.283185307179586

f32x2 = ti.types.vector(2, ti.f32)
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
    sides=ti.i32,  # bearings of the table of gains, evenly round from north
    paces=ti.i32,  # speeds of the table of levels
    spread=ti.f32,  # [dB] standard deviation of the fluctuation
    rate=ti.f32,  # [1/s] of its jumps; of a table of POD (kernels.glimpse) 1 / the time for which that is there
    cell_lon=ti.f32,  # [binary angle] from column to column of a table of POD by place, whose middle is at lon, lat
    cell_lat=ti.f32,  # from row to row
)


@ti.func
def round_table(table: ti.template(), many: ti.i32, stride: ti.i32, at: ti.i32, bearing: ti.f32) -> ti.f32:
    """Return what a table has at a bearing [rad], straight between its entries, which go round the circle."""
    found = table[at]
    if many > 1:
        turned = bearing * ti.f32(1.0 / TURN)
        place = (turned - ti.floor(turned)) * many
        k = ti.min(ti.cast(place, ti.i32), many - 1)
        share = place - k
        after = k + 1
        if after == many:
            after = 0
        low, high = table[k * stride + at], table[after * stride + at]
        found = low + share * (high - low)
    return found


@ti.func
def excess(ear: Ear, losses: ti.template(), gains: ti.template(), way: f32x2) -> ti.f32:
    """Return the signal excess [dB] of a source of 0 dB at (east, north) [m] from a sonar; -inf out of its range.

    losses: [dB] (rays * rings,); gains: [dB] (sides,), array gain less noise and threshold by true bearing.
    """
    far = ti.sqrt(way[0] * way[0] + way[1] * way[1])
    ring = (far - ear.nearest) / ear.between
    found = -ti.math.inf
    if ring <= ear.rings - 1.0:
        ring = ti.max(ring, 0.0)
        bearing = ti.atan2(way[0], way[1])
        k = ti.min(ti.cast(ring, ti.i32), ear.rings - 2)
        low = round_table(losses, ear.rays, ear.rings, k, bearing)
        high = round_table(losses, ear.rays, ear.rings, k + 1, bearing)
        found = round_table(gains, ear.sides, 1, 0, bearing) - (low + (ring - k) * (high - low))
    return found


@ti.func
def level(levels: ti.template(), paces: ti.template(), scenario: ti.i32, speed: ti.f32) -> ti.f32:
    """Return the source level [dB] of a scenario at a speed [m/s]; levels: (scenarios * speeds,), paces: (speeds,)."""
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
def hear(
    silence: Silence,
    ear: Ear,
    losses: ti.template(),
    gains: ti.template(),
    a: f32x2,
    b: f32x2,
    lasting: ti.f32,
    source: ti.f32,
) -> Silence:
    """Return a silence after a stretch of way from a to b (east, north) [m] from the sonar, in so many seconds.

    source: its level, and what else the excess of all of it has in common [dB].
    """
    d = b - a
    dd = d[0] * d[0] + d[1] * d[1]
    nearest = ti.min(ti.max(-(a[0] * d[0] + a[1] * d[1]) / ti.max(dd, 1e-12), 0.0), 1.0)
    at = a + nearest * d
    far, length = at.norm(), ti.sqrt(dd)
    if far > ear.nearest + ear.between * (ear.rings - 1):
        silence = jumps.settled(silence, ear.rate, lasting)
    elif length < STILL:
        over = excess(ear, losses, gains, a + 0.5 * d) + source
        silence = jumps.heard(silence, over, ear.spread, ear.rate, lasting)
    else:
        fine = ti.min(ti.max(0.5 * ear.between, FINE), ti.max(NARROW * far, CLOSE))
        # The trapezium rule on either side of the nearest point, so that the greatest chances count in full.
        for side in range(2):
            low, share = 0.0, nearest
            if side == 1:
                low, share = nearest, 1.0 - nearest
            if share > 0.0:
                parts = ti.min(ti.max(ti.cast(ti.ceil(share * length / fine), ti.i32), 1), MOST_PARTS)
                part = share * lasting / parts
                for k in range(parts + 1):
                    over = excess(ear, losses, gains, a + (low + share * k / parts) * d) + source
                    whole = part if 0 < k < parts else 0.5 * part
                    silence = jumps.heard(silence, over, ear.spread, ear.rate, whole)
    return silence


@ti.func
def taken(i: ti.i32, size: ti.i32, log_missed: ti.template(), edges: ti.template(), held: ti.template()) -> Silence:
    """Return the silence of particle i from its columns; see `Silent`."""
    silence = jumps.at_first()
    silence.log = log_missed[i]
    if held[i] > 0.0 or edges[i] > 0.0:
        silence.many = 0
        for j in range(STAIRS):
            if edges[j * size + i] >= 0.0 and silence.many == j:
                silence.edge[j], silence.held[j] = edges[j * size + i], held[j * size + i]
                silence.many += 1
    return silence


@ti.func
def put(
    silence: Silence, i: ti.i32, size: ti.i32, log_missed: ti.template(), edges: ti.template(), held: ti.template()
):
    """Write the silence of particle i to its columns."""
    log_missed[i] = silence.log
    for j in range(STAIRS):
        there = j < silence.many
        edges[j * size + i] = silence.edge[j] if there else -1.0
        held[j * size + i] = silence.held[j] if there else 0.0


@ti.func
def to(ear: Ear, time: ti.f32, lon: ti.i32, lat: ti.i32) -> f32x2:
    """Return the vector (east, north) [m] from where a sonar is at a time of its stretch to a place [binary angle]."""
    share = (time - ear.begin) / ti.max(ear.end - ear.begin, 1e-6)
    x = ear.lon + ti.cast(ti.round(share * ti.cast(ear.to_lon - ear.lon, ti.f32)), ti.i32)
    y = ear.lat + ti.cast(ti.round(share * ti.cast(ear.to_lat - ear.lat, ti.f32)), ti.i32)
    return sphere.offset(x, y, lon, lat)


@ti.kernel
def _drifting(
    listed: ti.template(),
    first: ti.i32,
    last: ti.i32,
    slots: Ints,
    scenario: Ints,
    before_lon: Ints,
    before_lat: Ints,
    lon: Ints,
    lat: Ints,
    status: Ints,
    release: Ints,
    status_since: Ints,
    moving_since: Ints,
    elapsed: ti.i32,
    duration: ti.i32,
    ear: Ear,
    losses: HostReals,
    gains: HostReals,
    levels: HostReals,
    paces: HostReals,
    offsets: HostReals,
    log_missed: Reals,
    edges: Reals,
    held: Reals,
):
    many = offsets.shape[0]
    size = log_missed.shape[0] // many
    for nth in range(first * many, last * many):
        i, f = batch.slot(listed, slots, nth // many), nth % many
        if status[i] <= life.PENDING:  # what is under way is heard by kernels.listen_targets
            silence = taken(f * size + i, size * many, log_missed, edges, held)
            now = ear.begin
            if status[i] < life.PENDING:
                times = life.behind(status[i], release[i], status_since[i], moving_since[i], elapsed, duration)
                left, gone = ti.cast(times[1] - elapsed, ti.f32), ti.cast(times[2] - elapsed, ti.f32)
                begin, end = ti.max(ear.begin, left), ti.min(ear.end, gone)
                now = ti.min(ti.max(now, ti.cast(release[i] - elapsed, ti.f32)), ear.end)  # before, it was under way
                if begin < end:
                    silence = jumps.settled(silence, ear.rate, begin - now)
                    x, y = before_lon[i], before_lat[i]
                    dx, dy = ti.cast(lon[i] - x, ti.f32), ti.cast(lat[i] - y, ti.f32)
                    pace = 1.0 / ti.max(gone - left, 1.0)
                    a, b = f32x2(0.0), f32x2(0.0)
                    for side in range(2):
                        when = begin if side == 0 else end
                        share = (when - left) * pace
                        at_x, at_y = (
                            x + ti.cast(ti.round(dx * share), ti.i32),
                            y + ti.cast(ti.round(dy * share), ti.i32),
                        )
                        found = to(ear, when, at_x, at_y)
                        if side == 0:
                            a = found
                        else:
                            b = found
                    c = sphere.cos_lat(y)
                    speed = ti.sqrt(dx * dx * c * c + dy * dy) * ti.f32(sphere.RADIUS * sphere.UNIT) * pace
                    source = level(levels, paces, scenario[i], speed) + offsets[f]
                    silence = hear(silence, ear, losses, gains, a, b, end - begin, source)
                    now = end
            silence = jumps.settled(silence, ear.rate, ear.end - now)
            put(silence, f * size + i, size * many, log_missed, edges, held)


class Tables(NamedTuple):
    """The tables of a sonar on a stretch of its way, on the host; see `excess` and `level`. All float32."""

    losses: np.ndarray  # [dB] (rays, rings), rays evenly round from north, rings evenly from `nearest`
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
    """Return what a sonar that begins to listen keeps of n particles, for each factor of its unknown, by name."""
    return {
        "log_missed": np.zeros(n * factors, np.float32),
        "edges": np.zeros(n * factors * STAIRS, np.float32),
        "held": np.zeros(n * factors * STAIRS, np.float32),
    }


def ear(stretch: Stretch, tables: Tables) -> Any:
    """Return a sonar as kernels take it."""
    rays, rings = tables.losses.shape
    return Ear(
        lon=stretch.place[0], lat=stretch.place[1], to_lon=stretch.to[0], to_lat=stretch.to[1], begin=stretch.begin,
        end=stretch.end, rays=rays, rings=rings, nearest=tables.nearest, between=tables.between,
        sides=len(tables.gains), paces=len(tables.paces), spread=tables.spread, rate=tables.rate, cell_lon=1.0, cell_lat=1.0,
    )  # fmt: skip


def flat(tables: Tables, offsets: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return losses, gains, levels, speeds and offsets as kernels take them."""
    every = tables.losses, tables.gains, tables.levels, tables.paces, offsets
    return tuple(np.ascontiguousarray(x, np.float32).reshape(-1) for x in every)


def drifting(
    ensemble: Any,
    own: Batch,
    before: tuple[Any, Any],
    elapsed: int,
    duration: int,
    stretch: Stretch,
    tables: Tables,
    offsets: np.ndarray,
    kept: tuple[Any, Any, Any],
) -> None:
    """Have a sonar listen for what drifts, of the slots of a batch, on a stretch of the step just made.

    ensemble: a drift.particles.ensemble.Ensemble; before: its lon and lat at the begin of the step, at `elapsed` [s].
    offsets: [dB] (factors,), of the unknown that its group shares. kept: its columns on the device, see `columns`. What lies ashore is not heard.
    """
    e = ensemble
    _drifting(
        own.listed, own.first, own.last, own.slots, e.scenario, *before, e.lon, e.lat, e.status, e.release,
        e.status_since, e.moving_since, elapsed, duration, ear(stretch, tables), *flat(tables, offsets), *kept,
    )  # fmt: skip
