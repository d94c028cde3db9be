"""The particles of a map, read part by part: their extent, a suitable cell size, and deposits in
cells.
"""

from dataclasses import dataclass

import numpy as np

from drift.engine.particles.snapshot import Output, Snapshot, mapped, swarm
from drift.engine.particles.status import Status
from drift.forecast import areas, density
from drift.forecast.likeliest import Shown
from drift.forecast.survey import Survey
from geo import cells, mixing, sphere
from geo.array import Array
from geo.cells import Cells
from kernels.step import tally
from kernels.step.tally import Marks, Swarm

GROUPS = 4
SAMPLE = 4096  # particles sampled to choose the cell size


@dataclass(frozen=True)
class Cloud:
    """The particles on the map at one time: their extent and the bandwidth for the cell size."""

    west: int  # extent [binary angle], longitudes relative to the common reference
    east: int
    south: int
    north: int
    spacing: float  # bandwidth [binary angle units]


def extent_of_output(output: Output, known: Survey, centre: int) -> Cloud | None:
    """Return an output's extent and bandwidth; None if no probability is on the map.

    Args:
        output: the particles.
        known: their survey.
        centre: the common reference of longitudes [binary angle].
    """
    if not known.heaviest > 0:
        return None
    sums = known.weight.sums[:, 0, 0]
    begun = np.concatenate([[0.0], np.cumsum(sums)])  # cumulative weight by block of the run
    goals = (np.arange(SAMPLE) + 0.5) / SAMPLE * begun[-1]
    block_of = np.minimum(np.searchsorted(begun[1:], goals), len(sums) - 1)
    edges, total, count = [], 0, 0
    picks: list[Array] = []  # (3, m) of each part: number in the whole run, lon, lat
    for part in output.parts():
        there, blocks = mapped(part), part.blocks
        # int32 subtraction wraps, which gives longitudes relative to the centre in [-180, 180)
        # degrees.
        lon, lat = np.subtract(part.lon, np.int32(centre)), part.lat
        if there.any():
            x, y = lon[there], lat[there]
            edges.append((x.min(), x.max(), y.min(), y.max()))
            total, count = total + int(y.sum(dtype=np.int64)), count + len(y)
        weight, spans, places = np.where(there, part.probability, 0.0), blocks.spans, blocks.places
        for here, number in enumerate(np.searchsorted(known.weight.number, blocks.number).tolist()):
            wanted = goals[slice(*np.searchsorted(block_of, (number, number + 1)))]
            if wanted.size:
                running = begun[number] + np.cumsum(weight[spans[here]])
                slots = (
                    np.unique(np.searchsorted(running, wanted).clip(max=len(running) - 1))
                    + spans[here].start
                )
                picks.append(np.stack([places[slots], lon[slots], lat[slots]]))
    chosen = np.concatenate(picks, axis=1)
    _, lon, lat = chosen[:, np.argsort(chosen[0])]
    shrink = float(np.cos(total / count * sphere.UNIT))
    spacing = density.typical_spacing(lon * shrink, lat.astype(np.float64), known.spread)
    west, east, south, north = zip(*edges, strict=True)
    return Cloud(int(min(west)), int(max(east)), int(min(south)), int(max(north)), spacing)


def deposits(output: Output, known: Survey, window: Cells, shown: Shown) -> areas.Deposits:
    """Return an output's deposits in its own cells, in fixed point: independent of the order of
    summation.
    """
    media, level = 2 if known.ashore else 1, known.lightest == known.heaviest
    medium = (np.arange(len(Status)) == Status.ASHORE).astype(np.int32)
    places = shown.place.astype(np.int32)

    def marked(part: Snapshot) -> tuple[Swarm, Marks]:
        return swarm(part), Marks(
            group(part.blocks.places, output.n), medium, part.scenario, places
        )

    held = tally.held(map(swarm, output.parts()), window)
    heaviest = 0.0 if level else known.heaviest
    whole = tally.laid(
        map(marked, output.parts()), window, held, GROUPS, media, shown.size, heaviest
    )
    mass, squares, by_scenario = (own / cells.ONE for own in whole)
    alone = by_scenario if shown.size > 1 else mass.sum(axis=0)[None]
    return areas.Deposits(held, mass, (mass if level else squares) * known.heaviest, alone)


def group(place: Array, n: int) -> Array:
    """Return the group (0 to GROUPS - 1) of each particle, int32; groups are held out of a map in
    turn.

    place: ascending numbers in the whole run, of n particles. The group is a hash of the number,
    equal within runs of up to 32. Resampling places siblings side by side; they must not be on both
    sides of a check.
    """
    run = min(max(n // 2048, 1), 32)
    code = place // run + 1
    begun = np.flatnonzero(np.diff(code, prepend=0))
    with np.errstate(over="ignore"):
        # the steps of SplitMix64's counter
        words = code[begun].astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    own = (mixing.mixed(words) >> np.uint64(62)).astype(np.int32)
    return np.repeat(own, np.diff(begun, append=len(code)))
