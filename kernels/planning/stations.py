"""Miss probabilities of passive sonars on many candidate tracks, for recorded particle tracks.

The mathematics is that of the search itself (kernels.evidence.listen, kernels.evidence.jumps).
Sonars and particles move straight between the edges of time bins.
"""

from typing import NamedTuple

import numpy as np
import taichi as ti

from kernels.evidence import jumps, listen
from kernels.maths import angles, sphere
from kernels.runtime import bundle, runtime

BESIDE = 3  # number of places whose losses are interpolated

f32x2 = ti.types.vector(2, ti.f32)
HostReals = ti.types.ndarray(dtype=ti.f32, ndim=1)
HostInts = ti.types.ndarray(dtype=ti.i32, ndim=1)
HostBytes = ti.types.ndarray(dtype=ti.u8, ndim=1)

Sonar = ti.types.struct(
    rays=ti.i32,  # bearings of the tables of losses, evenly spaced from north
    rings=ti.i32,  # their ranges, evenly spaced from `nearest`
    nearest=ti.f32,  # [m]
    between=ti.f32,
    sides=ti.i32,  # relative bearings of the table of gains, evenly spaced from ahead
    winds=ti.i32,  # true bearings of the noise, evenly spaced from north
    paces=ti.i32,  # speeds of the table of levels
    spread=ti.f32,  # [dB]
    rate=ti.f32,  # [1/s]
    part=ti.f32,  # [m] longest part of a stretch with one value of the excess
    share=ti.f32,  # share of the least range in a bin that a part may have instead
)


@ti.func
def _excess(
    sonar: Sonar,
    losses: ti.template(),
    gains: ti.template(),
    noise: ti.template(),
    which: ti.template(),
    weight: ti.template(),
    at: ti.i32,
    bin_: ti.i32,
    heading: ti.f32,
    way: f32x2,
) -> ti.f32:
    """Return the signal excess [dB] of a source of 0 dB at (east, north) [m] from a sonar.

    It is -inf out of range.
    """
    far = ti.sqrt(way[0] * way[0] + way[1] * way[1])
    ring = (far - sonar.nearest) / sonar.between
    found = -ti.math.inf
    if ring <= sonar.rings - 1.0:
        ring = ti.max(ring, 0.0)
        bearing = angles.atan2(way[0], way[1])
        k = ti.min(ti.cast(ring, ti.i32), sonar.rings - 2)
        lost = 0.0
        for j in range(BESIDE):
            share = weight[BESIDE * at + j]
            if share > 0.0:
                table = which[BESIDE * at + j] * sonar.rays * sonar.rings
                low = listen.round_table(losses, sonar.rays, sonar.rings, table + k, bearing)
                high = listen.round_table(losses, sonar.rays, sonar.rings, table + k + 1, bearing)
                lost += share * (low + (ring - k) * (high - low))
        found = listen.round_table(gains, sonar.sides, 1, 0, bearing - heading) - lost
        found -= listen.round_table(noise, sonar.winds, 1, bin_ * sonar.winds, bearing)
    return found


@ti.kernel
def _missed(
    sonar: Sonar,
    losses: HostReals,
    gains: HostReals,
    noise: HostReals,
    levels: HostReals,
    paces: HostReals,
    offsets: HostReals,
    time: HostReals,
    lon: HostInts,
    lat: HostInts,
    there: HostBytes,
    scenario: HostInts,
    way_lon: HostInts,
    way_lat: HostInts,
    heading: HostReals,
    listens: HostBytes,
    which: HostInts,
    weight: HostReals,
    log: HostReals,
):
    m, factors, edges = scenario.shape[0], offsets.shape[0], time.shape[0]
    bins = edges - 1
    reach = sonar.nearest + sonar.between * (sonar.rings - 1)
    if ti.static(bundle.threads(448)):
        ti.loop_config(block_dim=448)
    for nth in range(log.shape[0]):
        f = nth % factors
        i = (nth // factors) % m
        c = nth // (factors * m)
        silence = jumps.at_first()
        a, begun = f32x2(0.0), 0
        for t in range(bins):
            lasting = time[t + 1] - time[t]
            heard = (
                listens[c * bins + t] == 1
                and there[i * edges + t] == 1
                and there[i * edges + t + 1] == 1
            )
            if not heard:
                jumps.settle(silence, sonar.rate, lasting)
                begun = 0
            else:
                if begun == 0:
                    a = sphere.offset_near(
                        way_lon[c * edges + t],
                        way_lat[c * edges + t],
                        lon[i * edges + t],
                        lat[i * edges + t],
                    )
                to = t + 1
                b = sphere.offset_near(
                    way_lon[c * edges + to],
                    way_lat[c * edges + to],
                    lon[i * edges + to],
                    lat[i * edges + to],
                )
                d = b - a
                dd = d.dot(d)
                nearest = (a + ti.min(ti.max(-a.dot(d) / ti.max(dd, 1e-12), 0.0), 1.0) * d).norm()
                if nearest > reach:
                    jumps.settle(silence, sonar.rate, lasting)
                else:
                    speed = 0.0
                    if sonar.paces > 1:
                        gone = sphere.offset_near(
                            lon[i * edges + t],
                            lat[i * edges + t],
                            lon[i * edges + to],
                            lat[i * edges + to],
                        )
                        speed = gone.norm() / lasting
                    source = listen.level(levels, paces, scenario[i], speed) + offsets[f]
                    part = ti.max(sonar.part, sonar.share * nearest)
                    parts = ti.max(ti.cast(ti.ceil(ti.sqrt(dd) / part), ti.i32), 1)
                    for k in range(parts):
                        way = a + (k + 0.5) / parts * d
                        over = (
                            _excess(
                                sonar,
                                losses,
                                gains,
                                noise,
                                which,
                                weight,
                                c * bins + t,
                                t,
                                heading[c * bins + t],
                                way,
                            )
                            + source
                        )
                        jumps.hear(silence, over, sonar.spread, sonar.rate, lasting / parts)
                a, begun = b, 1
        log[nth] = jumps.log_missed(silence)


@ti.kernel
def _best(
    sonar: Sonar,
    best: HostReals,
    levels: HostReals,
    paces: HostReals,
    offsets: HostReals,
    time: HostReals,
    lon: HostInts,
    lat: HostInts,
    there: HostBytes,
    scenario: HostInts,
    cell_lon: HostInts,
    cell_lat: HostInts,
    first: HostInts,
    hazard: HostReals,
):
    m, factors, edges = scenario.shape[0], offsets.shape[0], time.shape[0]
    cells = cell_lon.shape[0]
    reach = sonar.nearest + sonar.between * (sonar.rings - 1)
    for nth in range(hazard.shape[0]):
        f = nth % factors
        i = (nth // factors) % m
        c = (nth // (factors * m)) % cells
        slot = nth // (factors * m * cells)
        silence = jumps.at_first()
        for t in range(first[slot], first[slot + 1]):
            lasting = time[t + 1] - time[t]
            if there[i * edges + t] == 1 and there[i * edges + t + 1] == 1:
                a = sphere.offset_near(
                    cell_lon[c], cell_lat[c], lon[i * edges + t], lat[i * edges + t]
                )
                b = sphere.offset_near(
                    cell_lon[c], cell_lat[c], lon[i * edges + t + 1], lat[i * edges + t + 1]
                )
                d = b - a
                dd = d.dot(d)
                nearest = ti.min(ti.max(-a.dot(d) / ti.max(dd, 1e-12), 0.0), 1.0)
                speed = 0.0
                if sonar.paces > 1:
                    gone = sphere.offset_near(
                        lon[i * edges + t],
                        lat[i * edges + t],
                        lon[i * edges + t + 1],
                        lat[i * edges + t + 1],
                    )
                    speed = gone.norm() / lasting
                source = listen.level(levels, paces, scenario[i], speed) + offsets[f]
                if (a + nearest * d).norm() <= reach:
                    parts = ti.max(ti.cast(ti.ceil(ti.sqrt(dd) / sonar.part), ti.i32), 1)
                    for k in range(parts):
                        far = (a + (k + 0.5) / parts * d).norm()
                        ring = ti.max((far - sonar.nearest) / sonar.between, 0.0)
                        if ring <= sonar.rings - 1.0:
                            j = ti.min(ti.cast(ring, ti.i32), sonar.rings - 2)
                            # The higher of both ends is an upper bound in between.
                            over = (
                                ti.max(best[c * sonar.rings + j], best[c * sonar.rings + j + 1])
                                + source
                            )
                            jumps.hear(silence, over, sonar.spread, sonar.rate, lasting / parts)
                        else:
                            jumps.settle(silence, sonar.rate, lasting / parts)
                else:
                    jumps.settle(silence, sonar.rate, lasting)
            else:
                jumps.settle(silence, sonar.rate, lasting)
        hazard[nth] = -jumps.log_missed(silence)


class Swarm(NamedTuple):
    """Particles (m) at the edges of bins (e), straight in between, on the host."""

    time: np.ndarray  # float32 (e,) [s] from the begin
    lon: np.ndarray  # int32 (m, e) binary angle
    lat: np.ndarray
    there: np.ndarray  # uint8 (m, e): whether it can be heard
    scenario: np.ndarray  # int32 (m,)


class Tables(NamedTuple):
    """Tables of a sonar, on the host; see `Sonar`."""

    losses: np.ndarray  # [dB] (places, rays, rings)
    nearest: float  # [m]
    between: float
    gains: np.ndarray  # [dB] (sides,) by relative bearing, less threshold
    noise: np.ndarray  # [dB] (bins, winds)
    levels: np.ndarray  # [dB] (scenarios, speeds)
    paces: np.ndarray  # [m/s] (speeds,)
    spread: float  # [dB]
    rate: float  # [1/s]
    offsets: np.ndarray  # [dB] (factors,)


class Ways(NamedTuple):
    """Tracks of a sonar (c) at the edges of bins (e), and the places whose losses apply there."""

    lon: np.ndarray  # int32 (c, e) binary angle
    lat: np.ndarray
    heading: np.ndarray  # float32 (c, e - 1) [rad] true, of its array
    listens: np.ndarray  # uint8 (c, e - 1)
    which: np.ndarray  # int32 (c, e - 1, BESIDE) numbers of places
    weight: np.ndarray  # float32 (c, e - 1, BESIDE), of sum 1


def _sonar(
    tables: Tables,
    part: float,
    share: float = 0.0,
    rings: int | None = None,
    rays: int | None = None,
):
    return Sonar(
        rays=rays or tables.losses.shape[1],
        rings=rings or tables.losses.shape[2],
        nearest=tables.nearest,
        between=tables.between,
        sides=tables.gains.size,
        winds=tables.noise.shape[1],
        paces=tables.paces.size,
        spread=tables.spread,
        rate=tables.rate,
        part=part,
        share=share,
    )


def _flat(*columns: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.ascontiguousarray(column, np.float32).reshape(-1) for column in columns)


def _particles(swarm: Swarm) -> tuple[np.ndarray, ...]:
    return (
        np.ascontiguousarray(swarm.time, np.float32),
        np.ascontiguousarray(swarm.lon).reshape(-1),
        np.ascontiguousarray(swarm.lat).reshape(-1),
        np.ascontiguousarray(swarm.there, np.uint8).reshape(-1),
        np.ascontiguousarray(swarm.scenario, np.int32),
    )


def missed(swarm: Swarm, tables: Tables, ways: Ways, part: float, share: float = 0.0) -> np.ndarray:
    """Return the log miss probability of each particle for a sonar on each track.

    The result is float32 (c, m, factors). part [m]: longest part of a stretch with one value of the
    signal excess; share: of the least range in the bin, which is used if it is longer.
    """
    many = len(ways.lon)
    log = np.empty(many * len(swarm.scenario) * len(tables.offsets), np.float32)
    read = (
        *_flat(
            tables.losses, tables.gains, tables.noise, tables.levels, tables.paces, tables.offsets
        ),
        *_particles(swarm),
        np.ascontiguousarray(ways.lon).reshape(-1),
        np.ascontiguousarray(ways.lat).reshape(-1),
        *_flat(ways.heading),
        np.ascontiguousarray(ways.listens, np.uint8).reshape(-1),
        np.ascontiguousarray(ways.which, np.int32).reshape(-1),
        *_flat(ways.weight),
    )
    _missed(_sonar(tables, part, share), *runtime.residents(*read), log)
    return log.reshape(many, len(swarm.scenario), -1)


def best(
    swarm: Swarm,
    tables: Tables,
    cells: tuple[np.ndarray, np.ndarray],
    excess: np.ndarray,
    first: np.ndarray,
    part: float,
) -> np.ndarray:
    """Return an upper bound of -log(miss) of each particle for a sonar anywhere in a cell.

    The result is float32 (slots, c, m, factors), by slot of time.

    Args:
        swarm: the particles.
        tables: of the sonar.
        cells: lon, lat [binary angle] of the cells' centres, int32 (c,).
        excess: [dB] by range from there, the highest of a sonar for a source of 0 dB anywhere in
            the cell, (c, rings).
        first: number of each slot's first bin and, last, of all bins, (slots + 1,).
        part: longest part of a stretch with one value of the signal excess [m].
    """
    slots, many = len(first) - 1, len(cells[0])
    hazard = np.empty(slots * many * len(swarm.scenario) * len(tables.offsets), np.float32)
    read = (
        *_flat(excess, tables.levels, tables.paces, tables.offsets),
        *_particles(swarm),
        np.ascontiguousarray(cells[0], np.int32),
        np.ascontiguousarray(cells[1], np.int32),
        np.asarray(first, np.int32),
    )
    _best(_sonar(tables, part, rings=excess.shape[1], rays=1), *runtime.residents(*read), hazard)
    return hazard.reshape(slots, many, len(swarm.scenario), -1)
