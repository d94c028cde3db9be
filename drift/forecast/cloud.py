"""The particles of a map, read part by part: their extent, a suitable cell size, and deposits in
cells.

`extent_sums` and `deposit_sums` read some particles of an output; `merge_extents` and
`merge_deposits` make the extent and the deposits of all.
"""

from collections.abc import Sequence
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


@dataclass(frozen=True)
class Goals:
    """A systematic sample of the particles on the map, by cumulative weight; (SAMPLE,) each."""

    wanted: Array  # cumulative weights, ascending
    number: Array  # of the block that reaches each: its first slot in the whole run
    begun: Array  # cumulative weight before this block


@dataclass(frozen=True)
class ExtentSums:
    """What `merge_extents` needs of some particles."""

    edges: Array  # int64 (m, 4): least and largest lon and lat [binary angle]; m is 0 or 1
    total: int  # sum of latitudes
    count: int  # of the particles on the map
    picks: Array  # int64 (3, k): number in the whole run, lon and lat of sampled particles


def goals_of_output(known: Survey) -> Goals:
    """Return which particles of an output to sample, from their survey."""
    sums = known.weight.sums[:, 0, 0]
    begun = np.concatenate([[0.0], np.cumsum(sums)])  # cumulative weight by block of the run
    wanted = (np.arange(SAMPLE) + 0.5) / SAMPLE * begun[-1]
    block = np.minimum(np.searchsorted(begun[1:], wanted), len(sums) - 1)
    return Goals(wanted, known.weight.number[block], begun[block])


def extent_sums(output: Output, goals: Goals, centre: int) -> ExtentSums:
    """Return the extent of an output's particles and those sampled.

    Args:
        output: the particles.
        goals: of the whole output.
        centre: the common reference of longitudes [binary angle].
    """
    edges, total, count = [], 0, 0
    picks: list[Array] = [np.empty((3, 0), np.int64)]
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
        first = np.searchsorted(goals.number, blocks.number)
        last = np.searchsorted(goals.number, blocks.number, "right")
        for here, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            wanted = goals.wanted[begin:end]
            if wanted.size:
                running = goals.begun[begin] + np.cumsum(weight[spans[here]])
                slots = (
                    np.unique(np.searchsorted(running, wanted).clip(max=len(running) - 1))
                    + spans[here].start
                )
                picks.append(np.stack([places[slots], lon[slots], lat[slots]]))
    bounds = np.array(edges, np.int64).reshape(-1, 4)
    if len(bounds):
        least, most = bounds.min(axis=0), bounds.max(axis=0)
        bounds = np.where([True, False, True, False], least, most)[None]
    return ExtentSums(bounds, total, count, np.concatenate(picks, axis=1))


def merge_extents(parts: Sequence[ExtentSums], known: Survey) -> Cloud:
    """Return an output's extent and bandwidth from those of all its parts, and its survey."""
    total, count = sum(part.total for part in parts), sum(part.count for part in parts)
    chosen = np.concatenate([part.picks for part in parts], axis=1)
    _, lon, lat = chosen[:, np.argsort(chosen[0])]
    shrink = float(np.cos(total / count * sphere.UNIT))
    spacing = density.typical_spacing(lon * shrink, lat.astype(np.float64), known.spread)
    west, east, south, north = np.concatenate([part.edges for part in parts]).T
    return Cloud(int(min(west)), int(max(east)), int(min(south)), int(max(north)), spacing)


@dataclass(frozen=True)
class Gridding:
    """The cells of an output's map, and how its particles are deposited in them."""

    window: Cells
    shown: Shown
    n: int  # particles of the whole output
    media: int  # 2: adrift and ashore
    heaviest: float  # largest weight, the unit of the squares; 0: all are equal, and no squares


@dataclass(frozen=True)
class DepositSums:
    """Deposits of some particles in fixed point: independent of the order of summation."""

    cells: Array  # flat indices of the occupied cells, ascending (h,)
    # int64: weights and squares by group and medium, weights by scenario and medium: (.., h); (.., 0)
    # where `gridding` needs none
    amounts: tuple[Array, Array, Array]


def gridding_of_output(known: Survey, window: Cells, shown: Shown, n: int) -> Gridding:
    """Return how the n particles of an output are deposited in its cells, from their survey."""
    level = known.lightest == known.heaviest
    return Gridding(window, shown, n, 2 if known.ashore else 1, 0.0 if level else known.heaviest)


def deposit_sums(output: Output, gridding: Gridding) -> DepositSums:
    """Return the deposits of an output's particles in the cells of its map."""
    window, shown = gridding.window, gridding.shown
    medium = (np.arange(len(Status)) == Status.ASHORE).astype(np.int32)
    places = shown.place.astype(np.int32)

    def marked(part: Snapshot) -> tuple[Swarm, Marks]:
        return swarm(part), Marks(
            group(part.blocks.places, gridding.n), medium, part.scenario, places
        )

    held = tally.held(map(swarm, output.parts()), window)
    sums = tally.laid(
        map(marked, output.parts()),
        window,
        held,
        GROUPS,
        gridding.media,
        shown.size,
        gridding.heaviest,
    )
    needed = True, gridding.heaviest > 0, shown.size > 1
    mass, squares, scenarios = (
        own if kept else own[..., :0] for own, kept in zip(sums, needed, strict=True)
    )
    return DepositSums(held, (mass, squares, scenarios))


def merge_deposits(parts: Sequence[DepositSums], known: Survey, shown: Shown) -> areas.Deposits:
    """Return an output's deposits from those of all its parts, and its survey."""
    held = np.unique(np.concatenate([part.cells for part in parts]))
    # Cells vary slowest in memory, as the kernels lay them: the order of float sums depends on it.
    mass_sums, square_sums, scenario_sums = (
        np.moveaxis(np.zeros((held.size, *own.shape[:-1]), np.int64), 0, -1)
        for own in parts[0].amounts
    )
    whole = mass_sums, square_sums, scenario_sums
    for part in parts:
        here = np.searchsorted(held, part.cells)
        for sums, own in zip(whole, part.amounts, strict=True):
            if own.shape[-1]:
                sums[..., here] += own
    level = known.lightest == known.heaviest
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
