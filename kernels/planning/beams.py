"""Miss probabilities of each beam of a passive sonar over a slot of time, for recorded tracks.

The mathematics is that of the search itself (kernels.evidence.listen, kernels.evidence.jumps).
Sonars and particles move straight between the edges of time bins, as in kernels.planning.stations.
Each bin is divided into parts that are short compared with the range, so that a bearing crosses a
narrow beam in several of them. A slot starts without knowledge of what a beam detected or missed
before it.
"""

from typing import NamedTuple

import numpy as np
import taichi as ti

from kernels.evidence import jumps, listen
from kernels.maths import angles, sphere
from kernels.planning.stations import BESIDE, Sonar, Swarm, Tables
from kernels.runtime import runtime

# longest part of a stretch, as a share of its least range: 3.4 degrees of bearing
NARROW = 0.06
CLOSE = 100.0  # [m] lower bound of a part's length
# standard deviations of the fluctuation below which a target is inaudible, as in
# kernels.evidence.jumps: once in 10^7 draws
NEVER = -5.3

f32x2 = ti.types.vector(2, ti.f32)
HostReals = ti.types.ndarray(dtype=ti.f32, ndim=1)
HostInts = ti.types.ndarray(dtype=ti.i32, ndim=1)
HostBytes = ti.types.ndarray(dtype=ti.u8, ndim=1)


@ti.func
def _without_gain(
    sonar: Sonar,
    losses: ti.template(),
    noise: ti.template(),
    which: ti.template(),
    weight: ti.template(),
    bin_: ti.i32,
    far: ti.f32,
    bearing: ti.f32,
) -> ti.f32:
    """Return minus loss and noise [dB] at a true bearing [rad] and range [m]; -inf out of range."""
    ring = (far - sonar.nearest) / sonar.between
    found = -ti.math.inf
    if ring <= sonar.rings - 1.0:
        ring = ti.max(ring, 0.0)
        k = ti.min(ti.cast(ring, ti.i32), sonar.rings - 2)
        lost = 0.0
        for j in range(BESIDE):
            share = weight[BESIDE * bin_ + j]
            if share > 0.0:
                at = which[BESIDE * bin_ + j] * sonar.rays * sonar.rings + k
                low = listen.round_table(losses, sonar.rays, sonar.rings, at, bearing)
                high = listen.round_table(losses, sonar.rays, sonar.rings, at + 1, bearing)
                lost += share * (low + (ring - k) * (high - low))
        found = -lost - listen.round_table(noise, sonar.winds, 1, bin_ * sonar.winds, bearing)
    return found


@ti.kernel
def _missed(
    sonar: Sonar,
    first: ti.i32,
    last: ti.i32,
    losses: HostReals,
    gains: HostReals,
    rows: HostInts,
    noise: HostReals,
    levels: HostReals,
    paces: HostReals,
    offset: HostReals,
    time: HostReals,
    lon: HostInts,
    lat: HostInts,
    there: HostBytes,
    scenario: HostInts,
    own_lon: HostInts,
    own_lat: HostInts,
    heading: HostReals,
    listens: HostBytes,
    which: HostInts,
    weight: HostReals,
    log: HostReals,
):
    m, edges = scenario.shape[0], time.shape[0]
    beams = log.shape[0] // m
    reach = sonar.nearest + sonar.between * (sonar.rings - 1)
    for i in range(m):
        # Beam -1 finds the few beams that can hear it at all; the others compute one beam each.
        # Each bit stands for every 64th beam.
        can = ti.u64(0)
        for turn in range(beams + 1):
            beam = turn - 1
            silence = jumps.at_first()
            if beam < 0 or (can >> ti.cast(beam % 64, ti.u64)) & ti.u64(1) == ti.u64(1):
                for t in range(first, last):
                    lasting = time[t + 1] - time[t]
                    row = 0 if beam < 0 else rows[beam * (edges - 1) + t]
                    heard = (
                        listens[t] == 1
                        and there[i * edges + t] == 1
                        and there[i * edges + t + 1] == 1
                        and row >= 0
                    )
                    if heard:
                        a = sphere.offset(
                            own_lon[t], own_lat[t], lon[i * edges + t], lat[i * edges + t]
                        )
                        b = sphere.offset(
                            own_lon[t + 1],
                            own_lat[t + 1],
                            lon[i * edges + t + 1],
                            lat[i * edges + t + 1],
                        )
                        d = b - a
                        dd = d.dot(d)
                        nearest = ti.min(ti.max(-a.dot(d) / ti.max(dd, 1e-12), 0.0), 1.0)
                        least = (a + nearest * d).norm()
                        if least > reach:
                            jumps.settle(silence, sonar.rate, lasting)
                        else:
                            speed = 0.0
                            if sonar.paces > 1:
                                gone = sphere.offset(
                                    lon[i * edges + t],
                                    lat[i * edges + t],
                                    lon[i * edges + t + 1],
                                    lat[i * edges + t + 1],
                                )
                                speed = gone.norm() / lasting
                            source = listen.level(levels, paces, scenario[i], speed) + offset[i]
                            part = ti.max(ti.min(sonar.part, NARROW * least), CLOSE)
                            parts = ti.max(ti.cast(ti.ceil(ti.sqrt(dd) / part), ti.i32), 1)
                            for k in range(parts):
                                way = a + (k + 0.5) / parts * d
                                bearing = angles.atan2(way[0], way[1])
                                over = source + _without_gain(
                                    sonar, losses, noise, which, weight, t, way.norm(), bearing
                                )
                                relative = bearing - heading[t]
                                if beam < 0:
                                    for other in range(beams):
                                        of = rows[other * (edges - 1) + t]
                                        if of >= 0:
                                            gain = listen.round_table(
                                                gains, sonar.sides, 1, of * sonar.sides, relative
                                            )
                                            if over + gain > NEVER * sonar.spread:
                                                can |= ti.u64(1) << ti.cast(other % 64, ti.u64)
                                else:
                                    over += listen.round_table(
                                        gains, sonar.sides, 1, row * sonar.sides, relative
                                    )
                                    jumps.hear(
                                        silence, over, sonar.spread, sonar.rate, lasting / parts
                                    )
                    else:
                        jumps.settle(silence, sonar.rate, lasting)
            if beam >= 0:
                log[beam * m + i] = jumps.log_missed(silence)


class Course(NamedTuple):
    """Track and heading of a sonar at the edges of bins (e).

    `which` and `weight` give the places whose losses apply there.
    """

    lon: np.ndarray  # int32 (e,) binary angle
    lat: np.ndarray
    heading: np.ndarray  # float32 (e - 1,) [rad] true, of its array
    listens: np.ndarray  # uint8 (e - 1,)
    which: np.ndarray  # int32 (e - 1, BESIDE) numbers of places
    weight: np.ndarray  # float32 (e - 1, BESIDE), of sum 1


class Beams(NamedTuple):
    """Gains of beams, and when each one listens."""

    gains: np.ndarray  # [dB] float32 (rows, sides) by relative bearing, less threshold
    rows: np.ndarray  # int32 (beams, e - 1) of `gains`; -1: it does not listen


def missed(
    swarm: Swarm,
    tables: Tables,
    course: Course,
    beams: Beams,
    bins: tuple[int, int],
    offset: np.ndarray,
    part: float,
) -> np.ndarray:
    """Return the log miss probability of each particle for each beam, float32 (beams, m).

    Every beam starts as if it had never listened.

    Args:
        swarm: the particles.
        tables: of the sonar; its gains and offsets are not used.
        course: the sonar's track.
        beams: its beams.
        bins: the first bin, and the one after the last.
        offset: [dB] added to each particle's signal excess, (m,).
        part: longest part of a stretch with one value of the signal excess [m].
    """
    m = len(swarm.scenario)
    log = np.zeros(len(beams.rows) * m, np.float32)
    sonar = Sonar(
        rays=tables.losses.shape[1],
        rings=tables.losses.shape[2],
        nearest=tables.nearest,
        between=tables.between,
        sides=beams.gains.shape[1],
        winds=tables.noise.shape[1],
        paces=tables.paces.size,
        spread=tables.spread,
        rate=tables.rate,
        part=part,
    )
    read = (
        *_flat(np.float32, tables.losses, beams.gains),
        *_flat(np.int32, beams.rows),
        *_flat(np.float32, tables.noise, tables.levels, tables.paces, offset, swarm.time),
        *_flat(np.int32, swarm.lon, swarm.lat),
        *_flat(np.uint8, swarm.there),
        *_flat(np.int32, swarm.scenario),
        *_flat(np.int32, course.lon, course.lat),
        *_flat(np.float32, course.heading),
        *_flat(np.uint8, course.listens),
        *_flat(np.int32, course.which),
        *_flat(np.float32, course.weight),
    )
    _missed(sonar, *bins, *runtime.residents(*read), log)
    return log.reshape(-1, m)


def _flat(kind: type, *columns: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.ascontiguousarray(column, kind).reshape(-1) for column in columns)
