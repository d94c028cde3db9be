"""How much a plan could find at the most: what effort that can be divided at will would find.

Effort f [s] of search by unit, time bin and cell gives every particle i in the cell the coverage W_i v f / area, W that of its own
scenario, v the unit's speed past it. Its chance of being found is b(C_i), C_i all its coverage, b the concave curve above every
mix of the plan's laws (drift.concave): P(f) = sum of w_i b(C_i) is concave. When being found is worth less later, a_i(t), what is
found is sum over i and t of w_i a_i(t) (b(C_i(t)) - b(C_i(t - 1))) = sum of w_i (a_i(t) - a_i(t + 1)) b(C_i(t)): concave too.

No plan exceeds, for any slopes y, sum of w_i b*(y_i) + max over g of sum of w_i y_i C_i(g), b*(y) = max over C of b(C) - y C
(Fenchel; with y = b'(C_i(f)) it is P(f) + max over g of <P'(f), g - f>, the duality gap of Frank and Wolfe 1956). The maximum is
a knapsack: a unit spends its time in the bins whose best cell gains most. f is found by projected gradients with momentum (Beck and
Teboulle 2009, doi:10.1137/080716542), which need tens of steps where Frank and Wolfe's own need thousands.

The bound is one for the laws as laws of coverage: where probability changes within a track spacing, legs laid on particles may
exceed it. It grows with noise: too few particles a cell look like places worth a visit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import concave, quadtree, reach
from drift import tracks as record
from drift.quadtree import Quadtree
from drift.sortie import PlanSpec, Survival, Unit
from drift.tracks import Tracks
from geo import sphere
from kernels import allocate

Array = npt.NDArray[Any]

BINS = 6  # of time at most: more let effort follow the noise of cells that particles pass through
CELLS = 160  # a bin, about twice that in all: on a circular normal 0.3 % too low, where a sharp edge is best 1 %
LEAST = 256.0  # effective particles in a cell before it is divided
PATIENCE = 25  # steps without a better bound
STEPS = 150  # at most
EASE = 0.95  # by which the curvature is tried lower after each step
ENOUGH = 0.001  # by which the bound may exceed the best that was found


@dataclass(frozen=True)
class Budget:
    """What effort may be spent. Arrays by cell and unit, or by bin and unit [s]."""

    start: Array  # int64 (b + 1,) first cell of each bin
    most: Array  # (b, units) in a bin
    total: Array  # (units,) in all
    open: Array  # bool (cells, units): it can be there in that bin


@dataclass(frozen=True)
class Bound:
    """No plan finds more than `value`."""

    value: float
    moved: float  # by how much more it is, on average, for half the particles: by that much noise has raised it
    spread: float  # what the divided effort finds, on the particles that it was found on
    effort: Array  # float64 [s] (cells, units)
    cells: Quadtree


def bound(tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None]) -> Bound:
    """Return the upper bound of what any plan of these units, laws and times finds on these tracks."""
    tracks = record.coarser(record.sort(tracks), BINS)
    x, y = _middles(tracks, record.plane(tracks))
    effective = float(1 / np.sum(tracks.weight**2))
    cells = quadtree.grow(x, y, tracks.weight, max(effective / CELLS, LEAST))
    whole = ascend(*_field(tracks, units, spec, survival, cells), cells)
    half = [again(whole, part, units, spec, survival).value for part in record.halves(tracks)]
    return replace(whole, moved=max(sum(half) / 2 - whole.value, 0.0))


def again(
    found: Bound, tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None]
) -> Bound:
    """Return the bound on other tracks of the same times, in the cells of one that was found, on from its effort."""
    field, budget = _field(record.coarser(record.sort(tracks), BINS), units, spec, survival, found.cells)
    return ascend(field, budget, found.cells, found.effort)


def worth(tracks: Tracks, survival: Sequence[Survival | None], objective: str) -> Array:
    """Return what finding each particle at the bin edges is worth, (b + 1, m): 1, or its chance of being alive."""
    value = np.ones((tracks.bins + 1, tracks.m))
    if objective == "alive":
        for s, life in enumerate(survival):
            if life is not None:
                own = tracks.scenario == s
                value[:, own] = life.alive(np.maximum(tracks.time[:, None] - tracks.release[own], 0.0))
    return value


def ascend(field: allocate.Field, budget: Budget, cells: Quadtree, begin: Array | None = None) -> Bound:
    """Return the bound and the effort that finds most, from `begin` or nothing, by accelerated projected gradients."""
    area = cells.area[:, None]
    curvature = _curvature(field, area)
    best, least = 0.0, 1.0
    effort = ahead = kept = np.zeros((len(area), field.units)) if begin is None else begin
    t, stiff, last = 1.0, 1.0, 0
    for k in range(STEPS):
        value, rest = field.spend(ahead / area)
        slope = field.gain() / area
        most = rest + float(np.sum(_best(slope, budget)[1]))
        if most < least - ENOUGH / 10:
            least, last = most, k
        if least - best < ENOUGH or k - last > PATIENCE:
            break
        while True:
            new = project(ahead + slope / (stiff * curvature), stiff * curvature, budget)
            step = new - ahead
            found, _ = field.spend(new / area)
            expected = value + float(np.sum(slope * step)) - stiff / 2 * float(np.sum(curvature * step**2))
            if found >= expected - 1e-6:
                break
            stiff *= 2
        stiff *= EASE
        if found > best:
            best, kept = found, new
        after = (1 + np.sqrt(1 + 4 * t * t)) / 2
        if np.sum((ahead - new) * curvature * (new - effort)) > 0:  # momentum leads astray: O'Donoghue and Candes 2015
            t, ahead = 1.0, new
        else:
            ahead = _shrink(np.maximum(new + (t - 1) / after * (new - effort), 0.0), budget)
            t = after
        effort = new
    return Bound(least, 0.0, best, kept, cells)


def _middles(tracks: Tracks, plane: record.Plane) -> tuple[Array, Array]:
    """Return (x, y) [m] of the particles in the middle of each bin, (b, m)."""
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    return (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2


def _field(
    tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, survival: Sequence[Survival | None], cells: Quadtree
) -> tuple[allocate.Field, Budget]:
    """Return the particles in the cells, and what may be spent there."""
    plane = record.plane(tracks)
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    length = np.diff(tracks.time)[:, None]
    pace2 = (np.diff(x, axis=0) ** 2 + np.diff(y, axis=0) ** 2) / length**2
    leaf = cells.find((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2)
    leaf[~(tracks.adrift[1:] | tracks.adrift[:-1])] = -1
    value = worth(tracks, survival, spec.objective)[:-1]  # at the bins' begin: later in the bin it is no more
    fall = value - np.concatenate([value[1:], np.zeros((1, tracks.m))])
    groups = {unit.group or unit.name: unit.shape for unit in units}
    shapes: list[float] = list(groups.values())
    curve = concave.curve(list(dict.fromkeys(unit.law for unit in units)), shapes)
    field = allocate.Field(
        leaf, len(cells.code), fall, pace2, tracks.scenario, tracks.weight,
        np.array([[unit.sweep_width[s] * unit.search_speed for unit in units] for s in range(len(units[0].sweep_width))]),
        np.array([unit.search_speed for unit in units]), (curve.value, curve.slope, curve.conjugate), concave.STEP,
    )  # fmt: skip
    return field, _budget(tracks, units, spec, cells, plane)


def _budget(tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, cells: Quadtree, plane: record.Plane) -> Budget:
    lon, lat = plane.round(*cells.centre())
    begin, end = tracks.time[:-1][cells.bin], tracks.time[1:][cells.bin]
    spare = np.zeros((len(lon), len(units)))
    total = np.zeros(len(units))
    for u, unit in enumerate(units):
        can = reach.reach(unit, spec, (plane.lon, plane.lat))
        spare[:, u] = can.within(begin, end, can.arrival(lon, lat))
        total[u] = can.search
    return Budget(cells.start, np.maximum.reduceat(spare, cells.start[:-1], axis=0), total, spare > 0)


def _best(slope: Array, budget: Budget) -> tuple[Array, Array]:
    """Return the best slope of each bin and unit, (b, units), and what each unit can gain by it at most."""
    top = np.maximum.reduceat(np.where(budget.open, slope, 0.0), budget.start[:-1], axis=0)
    gains = np.zeros(top.shape[1])
    for u in range(top.shape[1]):
        at = np.argsort(-top[:, u], kind="stable")
        spent = np.minimum(np.cumsum(budget.most[at, u]), budget.total[u])
        gains[u] = np.sum(np.diff(spent, prepend=0.0) * top[at, u])
    return top, gains


def _shrink(effort: Array, budget: Budget) -> Array:
    """Return effort scaled down to the budget, bin by bin, then in all."""
    used = np.add.reduceat(effort, budget.start[:-1], axis=0)
    share = np.minimum(1, budget.most / np.maximum(used, 1e-9))
    share *= np.minimum(1, budget.total / np.maximum(np.sum(used * share, axis=0), 1e-9))
    return np.asarray(effort * np.repeat(share, np.diff(budget.start), axis=0))


def _curvature(field: allocate.Field, area: Array) -> Array:
    """Return a diagonal that the curvature of -P does not exceed, by cell and unit [1/s2]."""
    field.spend(np.zeros(area.shape) * np.ones(field.units))
    return np.asarray(np.maximum(field.gain(squared=True) / area**2, 1e-30))


def project(effort: Array, stiff: Array, budget: Budget) -> Array:
    """Return the effort within the budget that is nearest to `effort`, squares weighted by `stiff`, (cells, units).

    It is max(0, effort - price / stiff), the price of a bin being the larger of its own and the unit's.
    """
    ease = np.where(budget.open, 1 / stiff, 0.0)
    effort = np.where(budget.open, effort, 0.0)
    first, bins = budget.start[:-1], np.diff(budget.start)

    def spent(price: Array) -> tuple[Array, Array]:
        left = effort - np.repeat(price, bins, axis=0) * ease
        return np.add.reduceat(np.maximum(left, 0), first, axis=0), np.add.reduceat(
            np.where(left > 0, ease, 0), first, axis=0
        )

    price = np.zeros(budget.most.shape)
    for _ in range(12):  # Newton from below on convex falling pieces
        used, slope = spent(price)
        over = used - budget.most
        if np.all(over <= 1e-9 * np.maximum(budget.most, 1)):
            break
        price = np.where(over > 0, price + over / np.maximum(slope, 1e-300), price)
    low, high = np.zeros(len(budget.total)), np.max(np.where(budget.open, effort * stiff, 0), axis=0, initial=0)
    if np.any(np.sum(spent(price)[0], axis=0) > budget.total):
        for _ in range(30):
            middle = (low + high) / 2
            over = np.sum(spent(np.maximum(price, middle))[0], axis=0) > budget.total
            low, high = np.where(over, middle, low), np.where(over, high, middle)
        price = np.where(np.sum(spent(price)[0], axis=0) > budget.total, np.maximum(price, high), price)
    return np.maximum(effort - np.repeat(price, bins, axis=0) * ease, 0)
