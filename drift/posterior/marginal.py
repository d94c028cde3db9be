"""The distribution of one quantity by the weights of particles: shares, moments, exact quantiles, and a histogram.

Sums are made by blocks (drift.particles.partials). Quantiles are exact: a histogram says in which bin each lies, and only
the particles of those bins are sorted.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drift.particles.partials import Blocks
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
    squared: Array  # (n,)
    total: Array  # (rows,)
    scenario: Array  # (n,) int
    blocks: Blocks


def weighted(weight: Array, scenario: Array, blocks: Blocks) -> Weighted:
    """Return weights, float64 (n,), as the other functions take them."""
    return Weighted(weight, weight**2, _rows(blocks, weight)[:, 0], scenario, blocks)


def of_category(own: Weighted, number: Array, holds: Array, many: int) -> Marginal:
    """Return the distribution of a category.

    number: of each particle's value, 0 to many - 1 where it `holds`, (n,).
    """
    weight, squared = _only(own, holds)
    part = own.blocks.partial(weight, squared, code=np.where(holds, number, 0), many=many)
    sums = np.concatenate([part.by_scenario, part.total[None]])
    total = own.total[:, None]
    table = np.divide(sums[:, :, 0], total, out=np.full(sums.shape[:2], np.nan), where=total > 0)
    both = sums.sum(axis=1)
    return Marginal(table.sum(axis=1), _ess(both[:, 0], both[:, 1]), table)


def of_number(own: Weighted, values: Array, holds: Array, low: float, high: float) -> Marginal:
    """Return the distribution of numbers, float64 (n,), where they hold.

    low, high: ends of the histogram, to whose first and last bin what lies outside is added.
    """
    weight, squared = _only(own, holds)
    middle = (low + high) / 2  # of which squares are small enough to be subtracted
    off = values - middle
    first = weight * off
    sums = _rows(own.blocks, weight, squared, first, first * off)
    share, mean = _over(sums[:, 0], own.total), _over(sums[:, 2], sums[:, 0])
    variance = np.maximum(_over(sums[:, 3], sums[:, 0]) - mean**2, 0.0)
    quantiles, table = _quantiles(own, weight, values, low, high)
    ess = _ess(sums[:, 0], sums[:, 1])
    return Marginal(share, ess, table, mean + middle, np.sqrt(variance), quantiles)


def of_angle(own: Weighted, values: Array, holds: Array) -> Marginal:
    """Return the distribution of angles [rad], float64 (n,), where they hold; its histogram is of one turn from 0."""
    weight, squared = _only(own, holds)
    sums = _rows(own.blocks, weight, squared, weight * np.sin(values), weight * np.cos(values))
    mean = np.where(sums[:, 0] > 0, np.arctan2(sums[:, 2], sums[:, 3]) % TURN, np.nan)
    length = np.minimum(_over(np.hypot(sums[:, 2], sums[:, 3]), sums[:, 0]), 1.0)
    with np.errstate(divide="ignore"):
        std = np.sqrt(-2 * np.log(length))
    # Quantiles are those of the angle from the mean, -pi to pi: the turn is cut opposite it.
    centre = np.nan_to_num(mean)
    by_scenario, _ = _quantiles(own, weight, _from(values, centre[own.scenario]), -np.pi, np.pi)
    together, _ = _quantiles(own, weight, _from(values, centre[-1]), -np.pi, np.pi)
    quantiles = np.concatenate([by_scenario[:-1], together[-1:]]) + centre[:, None]
    table = _over(own.blocks.table(_bins(values % TURN, 0.0, TURN), BINS, weight), own.total[-1])
    return Marginal(
        _over(sums[:, 0], own.total), _ess(sums[:, 0], sums[:, 1]), table[None], mean, std, quantiles % TURN
    )


def _from(values: Array, centre: Array) -> Array:
    return np.asarray((values - centre + np.pi) % TURN - np.pi)


def _only(own: Weighted, holds: Array) -> tuple[Array, Array]:
    """Return weights and their squares (n,), 0 where a quantity means nothing."""
    if holds.all():
        return own.weight, own.squared
    return np.where(holds, own.weight, 0.0), np.where(holds, own.squared, 0.0)


def _rows(blocks: Blocks, *values: Array) -> Array:
    """Return the sums of values by scenario and, last, of all, (scenarios + 1, values)."""
    part = blocks.partial(*values)
    return np.concatenate([part.by_scenario[:, 0], part.total])


def _over(part: Array, whole: Array) -> Array:
    """Return a part of something; NaN of nothing."""
    return np.asarray(np.divide(part, whole, out=np.full(np.shape(part), np.nan), where=whole > 0))


def _ess(total: Array, squares: Array) -> Array:
    return np.asarray(np.divide(total**2, squares, out=np.zeros(len(total)), where=squares > 0))


def _bins(values: Array, low: float, high: float) -> Array:
    """Return the bin of each value, int (n,); outside of low and high the first and the last."""
    scale = BINS / (high - low) if high > low else 0.0
    return np.clip((values - low) * scale, 0, BINS - 1).astype(np.int64)


def _quantiles(own: Weighted, weight: Array, values: Array, low: float, high: float) -> tuple[Array, Array]:
    """Return the quantiles of values (rows, LEVELS), and the shares of bins of all together (1, BINS).

    A quantile is the least value up to and with which the weights add up to its level.
    """
    bins, many = _bins(values, low, high), own.blocks.scenarios
    part = own.blocks.partial(weight, code=bins, many=BINS)
    table, together = part.by_scenario[:, :, 0], part.total[:, 0]
    quantiles = np.full((many + 1, len(LEVELS)), np.nan)
    quantiles[-1:] = _within(weight, values, bins, together[None])
    quantiles[:-1] = quantiles[-1] if many == 1 else _within(weight, values, own.scenario * BINS + bins, table)
    return quantiles, _over(together, own.total[-1])[None]


def _within(weight: Array, values: Array, cell: Array, table: Array) -> Array:
    """Return the quantiles of each group (groups, LEVELS).

    cell: of each particle, (n,): its group * BINS + its bin. table: weight of each bin, (groups, BINS).
    """
    up_to = np.cumsum(table, axis=1)
    total = up_to[:, -1]
    aim = np.asarray(LEVELS) * total[:, None]
    last = np.where(table > 0, np.arange(BINS), 0).max(axis=1)  # rounding must not lead beyond the last weight
    bins = np.minimum((up_to[:, None, :] < aim[:, :, None]).sum(axis=-1), last[:, None])
    wanted = np.arange(len(table))[:, None] * BINS + bins
    chosen = np.zeros(table.size, bool)
    chosen[wanted] = True
    slots = np.flatnonzero(chosen[cell] & (weight > 0))
    slots = slots[np.lexsort((values[slots], cell[slots]))]
    cells, ordered, running = cell[slots], values[slots], np.cumsum(weight[slots])
    found = np.full(aim.shape, np.nan)
    for group, level in np.argwhere(np.broadcast_to(total[:, None] > 0, aim.shape)):
        a, b = np.searchsorted(cells, wanted[group, level] + np.array([0, 1]))
        below = up_to[group, bins[group, level]] - table[group, bins[group, level]]
        before = running[a - 1] if a else 0.0
        found[group, level] = ordered[min(a + np.searchsorted(running[a:b], before + aim[group, level] - below), b - 1)]
    return found
