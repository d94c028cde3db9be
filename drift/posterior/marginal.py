"""The distribution of one quantity by the weights of particles: shares, moments, exact quantiles, and a histogram.

Sums are made by blocks (drift.particles.partials). Quantiles are exact: a histogram says in which bin each lies, and only
the particles of those bins are sorted.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drift.particles.partials import Blocks, Partial
from geo.array import Array

LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
BINS = 256
TURN = 2 * np.pi


@dataclass(frozen=True)
class Marginal:
    """A distribution in SI and radians; NaN where nothing has weight. Rows: each scenario, then all together.

    Of a category there are shares and effective numbers alone.
    """

    share: Array  # (rows,) probability of those for which the quantity means anything
    ess: Array  # (rows,) effective number of these particles (Kong 1992)
    table: Array  # of a category the shares of its values (rows, values), else those of BINS of all together (1, BINS)
    mean: Array | None = None  # (rows,); of angles the direction of the mean vector, 0 to a turn
    std: Array | None = None  # (rows,); of angles sqrt(-2 ln R), R the length of the mean vector (Mardia 1972)
    quantiles: Array | None = None  # (rows, LEVELS); of angles those of a turn that begins opposite the mean


class Weighted(NamedTuple):
    """Weights of all particles, and what they add up to."""

    weight: Array  # float64 (n,), the largest is 1
    total: Array  # (rows,)
    scenario: Array  # (n,) int
    blocks: Blocks


class _Held(NamedTuple):
    """The particles for which a quantity means anything, in the order of their slots."""

    weight: Array  # (m,)
    scenario: Array  # (m,)
    blocks: Blocks  # of these m alone
    total: Array  # (rows,) of all particles


def weighted(weight: Array, scenario: Array, blocks: Blocks) -> Weighted:
    """Return weights, float64 (n,), as the other functions take them."""
    return Weighted(weight, _rows(blocks, weight)[:, 0], scenario, blocks)


def of_category(own: Weighted, number: Array, holds: Array, many: int) -> Marginal:
    """Return the distribution of a category.

    number: of each particle's value, 0 to many - 1 where it `holds`, (n,).
    """
    held, number = _held(own, number, holds)
    sums = _coded(held, number, many)
    total = own.total[:, None]
    table = np.divide(sums, total, out=np.full(sums.shape, np.nan), where=total > 0)
    both = _rows(held.blocks, held.weight, held.weight**2)
    return Marginal(table.sum(axis=1), _ess(both[:, 0], both[:, 1]), table)


def of_number(own: Weighted, values: Array, holds: Array, low: float, high: float) -> Marginal:
    """Return the distribution of numbers (n,), where they hold.

    low, high: ends of the histogram, to whose first and last bin what lies outside is added.
    """
    held, values = _held(own, values, holds)
    values = values.astype(np.float64)
    middle = (low + high) / 2  # of which squares are small enough to be subtracted
    off = values - middle
    first = held.weight * off
    sums = _rows(held.blocks, held.weight, held.weight**2, first, first * off)
    mean = _over(sums[:, 2], sums[:, 0])
    variance = np.maximum(_over(sums[:, 3], sums[:, 0]) - mean**2, 0.0)
    quantiles, table = _quantiles(held, values, low, high)
    shares = _over(sums[:, 0], own.total), _ess(sums[:, 0], sums[:, 1])
    return Marginal(*shares, _over(table[-1], own.total[-1])[None], mean + middle, np.sqrt(variance), quantiles)


def of_angle(own: Weighted, values: Array, holds: Array) -> Marginal:
    """Return the distribution of angles [rad] (n,), where they hold; its histogram is of one turn from 0."""
    held, values = _held(own, values, holds)
    values = values.astype(np.float64)
    weight = held.weight
    sums = _rows(held.blocks, weight, weight**2, weight * np.sin(values), weight * np.cos(values))
    mean = np.where(sums[:, 0] > 0, np.arctan2(sums[:, 2], sums[:, 3]) % TURN, np.nan)
    length = np.minimum(_over(np.hypot(sums[:, 2], sums[:, 3]), sums[:, 0]), 1.0)
    with np.errstate(divide="ignore"):
        std = np.sqrt(-2 * np.log(length))
    # Quantiles are those of the angle from the mean, -pi to pi: the turn is cut opposite it.
    centre = np.nan_to_num(mean)
    by_scenario = _quantiles(held, _from(values, centre[held.scenario]), -np.pi, np.pi)[0]
    together = _quantiles(held, _from(values, centre[-1]), -np.pi, np.pi)[0]
    quantiles = (np.concatenate([by_scenario[:-1], together[-1:]]) + centre[:, None]) % TURN
    shares = _over(sums[:, 0], own.total), _ess(sums[:, 0], sums[:, 1])
    turned = _coded(held, _bins(values % TURN, 0.0, TURN), BINS)
    return Marginal(*shares, _over(turned[-1], own.total[-1])[None], mean, std, quantiles)


def _from(values: Array, centre: Array) -> Array:
    return np.asarray((values - centre + np.pi) % TURN - np.pi)


def _held(own: Weighted, values: Array, holds: Array) -> tuple[_Held, Array]:
    """Return the particles for which values (n,) mean anything, and their values (m,)."""
    if holds.all():
        return _Held(own.weight, own.scenario, own.blocks, own.total), values
    slots = np.flatnonzero(holds)
    blocks = own.blocks
    first = np.searchsorted(slots, blocks.first)
    some = np.diff(first, append=slots.size) > 0  # blocks that hold any
    part = Blocks(slots.size, blocks.scenarios, first[some], blocks.scenario[some], blocks.number[some])
    return _Held(own.weight[slots], own.scenario[slots], part, own.total), values[slots]


def _rows(blocks: Blocks, *values: Array) -> Array:
    """Return the sums of values by scenario and, last, of all, (scenarios + 1, values)."""
    return _with_all(blocks.partial(*values))[:, 0]


def _coded(held: _Held, code: Array, many: int) -> Array:
    """Return the sums of weights by scenario and, last, of all, of each code 0 to many - 1, (scenarios + 1, many)."""
    return _with_all(held.blocks.partial(held.weight, code=code, many=many))[:, :, 0]


def _with_all(part: Partial) -> Array:
    by_scenario = part.by_scenario
    return np.concatenate([by_scenario, np.add.accumulate(by_scenario, axis=0)[-1:]])  # as Partial.total


def _over(part: Array, whole: Array) -> Array:
    """Return a part of something; NaN of nothing."""
    return np.asarray(np.divide(part, whole, out=np.full(np.shape(part), np.nan), where=whole > 0))


def _ess(total: Array, squares: Array) -> Array:
    return np.asarray(np.divide(total**2, squares, out=np.zeros(len(total)), where=squares > 0))


def _bins(values: Array, low: float, high: float) -> Array:
    """Return the bin of each value, int (n,); outside of low and high the first and the last."""
    scale = BINS / (high - low) if high > low else 0.0
    bins = ((values - low) * scale).astype(np.int64)
    return np.clip(bins, 0, BINS - 1, out=bins)


def _quantiles(held: _Held, values: Array, low: float, high: float) -> tuple[Array, Array]:
    """Return the quantiles of values (rows, LEVELS), and the weights of bins between low and high (rows, BINS).

    A quantile is the least value up to and with which the weights add up to its level.
    """
    bins = _bins(values, low, high)
    table = _coded(held, bins, BINS)
    up_to = np.cumsum(table, axis=1)
    aim = np.asarray(LEVELS) * up_to[:, -1:]
    end = np.where(table > 0, np.arange(BINS), 0).max(axis=1)  # rounding must not lead beyond the last weight
    wanted = np.minimum((up_to[:, None, :] < aim[:, :, None]).sum(axis=-1), end[:, None])
    # Only the particles of bins that hold a quantile, of their scenario or of all, are sorted.
    chosen = np.zeros((len(table), BINS), bool)
    np.put_along_axis(chosen, wanted, True, axis=1)
    chosen = chosen[:-1] | chosen[-1]
    slots = np.flatnonzero(chosen.reshape(-1)[held.scenario * BINS + bins])
    slots = slots[held.weight[slots] > 0]
    slots = slots[np.argsort(values[slots], kind="stable")]
    ranked, weight, place = values[slots], held.weight[slots], bins[slots]
    quantiles = np.full(wanted.shape, np.nan)
    order = np.argsort(held.scenario[slots], kind="stable")
    edges = np.searchsorted(held.scenario[slots][order], np.arange(len(table)))
    for row in np.flatnonzero(up_to[:, -1] > 0):
        own = order[edges[row] : edges[row + 1]] if row < len(table) - 1 else slice(None)
        rest = aim[row] - (up_to - table)[row, wanted[row]]
        quantiles[row] = _within(ranked[own], weight[own], place[own], wanted[row], rest)
    return quantiles, table


def _within(values: Array, weight: Array, bins: Array, wanted: Array, rest: Array) -> Array:
    """Return the values at which the weights within bins add up to what is wanted, (LEVELS,).

    values: ascending, (m,), with their weights and bins. wanted: the bin of each level, rest: the weight within it.
    """
    found = np.empty(len(wanted))
    first, last = np.searchsorted(bins, wanted), np.searchsorted(bins, wanted, side="right") - 1
    for level, (a, b) in enumerate(zip(first, last, strict=True)):
        reached = np.searchsorted(np.cumsum(weight[a : b + 1]), rest[level])
        found[level] = values[min(a + reached, b)]
    return found
