"""The distribution of one quantity by the weights of particles: shares, moments, exact quantiles, and a histogram.

Sums are made by blocks (drift.particles.partials). Quantiles are exact: a histogram says in which bin each lies, and only
the particles of those bins are sorted. What does not change with the weights is laid out once (`Laid`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drift.particles import weights
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
    """Weights of particles, and what they and their squares add up to."""

    weight: Array  # float64 (n,), the largest is 1; 0 where a quantity means nothing
    total: Array  # (rows,)
    squares: Array  # (rows,) of the weights of families
    blocks: Blocks
    family: Array | None  # int (n,) not negative: the particle of the begin from which each descends; None: itself

    @property
    def ess(self) -> Array:
        """The effective number of particles (Kong 1992), copies as one, (rows,); 0 of nothing."""
        none = np.zeros(len(self.total))
        return np.asarray(np.divide(self.total**2, self.squares, out=none, where=self.squares > 0))


class Laid(NamedTuple):
    """Values of a quantity, and what is made of them once for all weights."""

    values: Array  # (n,) as they came
    bins: Array  # uint8 (n,) of their histogram
    middle: float = 0.0  # of which squares are small enough to be subtracted
    turns: tuple[Array, Array, Array] | None = None  # of angles: brought into a turn from 0, their sine and cosine


def weighted(weight: Array, blocks: Blocks, family: Array | None = None) -> Weighted:
    """Return weights, float64 (n,), as the other functions take them.

    family: int (n,), the particle of the begin from which each descends: copies count as one (drift.forecast.effective).
    """
    total, squares = _with_all(blocks.partial(weight, weight**2))[:, 0].T
    if family is not None:
        squares = _of_families(weight, blocks, family)
    return Weighted(weight, total, squares, blocks, family)


def _of_families(weight: Array, blocks: Blocks, family: Array) -> Array:
    """Return the sums of the squared weights of families by scenario and, last, of all."""
    scenario = np.repeat(np.arange(blocks.scenarios), np.diff(_edges(blocks)))
    of, mass = weights.of_families(scenario, blocks.scenarios, weight, family, blocks)
    squares = np.bincount(of, mass**2, blocks.scenarios)
    return np.append(squares, squares.sum())


def numbers(values: Array, low: float, high: float) -> Laid:
    """Return numbers (n,) as of_number takes them.

    low, high: ends of the histogram, to whose first and last bin what lies outside is added.
    """
    return Laid(values, _bins(values.astype(np.float64), low, high), (low + high) / 2)


def angles(values: Array) -> Laid:
    """Return angles [rad] (n,) as of_angle takes them; their histogram is of one turn from 0."""
    within = values.astype(np.float64) % TURN
    return Laid(values, _bins(within, 0.0, TURN), turns=(within, np.sin(within), np.cos(within)))


def of_category(own: Weighted, number: Array, holds: Array, many: int) -> Marginal:
    """Return the distribution of a category.

    number: of each particle's value, 0 to many - 1 where it `holds`, (n,).
    """
    held = _held(own, holds)
    sums = _coded(held, number if held is own else np.where(holds, number, 0), many)
    total = own.total[:, None]
    table = np.divide(sums, total, out=np.full(sums.shape, np.nan), where=total > 0)
    return Marginal(table.sum(axis=1), held.ess, table)


def of_number(own: Weighted, laid: Laid, holds: Array) -> Marginal:
    """Return the distribution of numbers, where they hold (n,)."""
    held = _held(own, holds)

    def moments(part: slice) -> tuple[Array, Array]:
        off = np.subtract(laid.values[part], laid.middle, dtype=np.float64)
        first = held.weight[part] * off
        return first, first * off

    sums = _summed(held, moments)
    mean = _over(sums[:, 0], held.total)
    variance = np.maximum(_over(sums[:, 1], held.total) - mean**2, 0.0)
    table = _coded(held, laid.bins, BINS)
    rows = range(len(table))
    quantiles = _quantiles(held, laid.bins, table, lambda slots: laid.values[slots].astype(np.float64), rows)
    shares = _over(held.total, own.total), held.ess
    return Marginal(*shares, _over(table[-1], own.total[-1])[None], mean + laid.middle, np.sqrt(variance), quantiles)


def of_angle(own: Weighted, laid: Laid, holds: Array) -> Marginal:
    """Return the distribution of angles, where they hold (n,)."""
    assert laid.turns is not None
    held, (within, sine, cosine) = _held(own, holds), laid.turns
    sums = _summed(held, lambda part: (held.weight[part] * sine[part], held.weight[part] * cosine[part]))
    mean = np.where(held.total > 0, np.arctan2(sums[:, 0], sums[:, 1]) % TURN, np.nan)
    length = np.minimum(_over(np.hypot(sums[:, 0], sums[:, 1]), held.total), 1.0)
    with np.errstate(divide="ignore"):
        std = np.sqrt(-2 * np.log(length))
    # Quantiles are those of the angle from the mean, -pi to pi: the turn is cut opposite it.
    centre = np.nan_to_num(mean)
    every = len(centre) - 1
    quantiles = _about(held, within, centre[:-1], range(every))
    quantiles[-1] = quantiles[0] if every == 1 else _about(held, within, np.full(every, centre[-1]), [every])[-1]
    quantiles = (quantiles + centre[:, None]) % TURN
    shares = _over(held.total, own.total), held.ess
    turned = _coded(held, laid.bins, BINS)
    return Marginal(*shares, _over(turned[-1], own.total[-1])[None], mean, std, quantiles)


def _about(held: Weighted, within: Array, centre: Array, rows: Sequence[int]) -> Array:
    """Return the quantiles (rows, LEVELS) of angles from the centre of their scenario, -pi to pi; of some rows alone.

    Angles and centres are within a turn from 0.
    """
    blocks, bins = held.blocks, np.empty(held.weight.size, np.uint8)

    def off(slots: Array | slice, middle: Array) -> Array:
        apart = within[slots] - middle
        return apart + TURN * ((apart < -np.pi).astype(np.float64) - (apart >= np.pi))

    for part, scenario in zip(blocks.spans, blocks.scenario, strict=True):
        bins[part] = _bins(off(part, centre[scenario]), -np.pi, np.pi)
    edges, table = _edges(blocks), _coded(held, bins, BINS)

    def values(slots: Array) -> Array:
        return off(slots, centre[np.searchsorted(edges, slots, side="right") - 1])

    return _quantiles(held, bins, table, values, rows)


def _held(own: Weighted, holds: Array) -> Weighted:
    """Return the weights of those for which a quantity means anything (n,), and none of others."""
    return own if holds.all() else weighted(own.weight * holds, own.blocks, own.family)


def _edges(blocks: Blocks) -> Array:
    """Return the first slot of each scenario and, last, n."""
    return np.append(blocks.first, blocks.n)[np.searchsorted(blocks.scenario, np.arange(blocks.scenarios + 1))]


def _summed(held: Weighted, terms: Callable[[slice], tuple[Array, Array]]) -> Array:
    """Return the sums of two terms, made block by block, by scenario and, last, of all, (scenarios + 1, 2)."""
    blocks = held.blocks
    sums = np.array([[term.sum() for term in terms(part)] for part in blocks.spans]).reshape(-1, 1, 2)
    return _with_all(Partial(blocks.scenarios, blocks.scenario, blocks.number, sums))[:, 0]


def _coded(held: Weighted, code: Array, many: int) -> Array:
    """Return the sums of weights by scenario and, last, of all, of each code 0 to many - 1, (scenarios + 1, many)."""
    return _with_all(held.blocks.partial(held.weight, code=code, many=many))[:, :, 0]


def _with_all(part: Partial) -> Array:
    by_scenario = part.by_scenario
    return np.concatenate([by_scenario, np.add.accumulate(by_scenario, axis=0)[-1:]])  # as Partial.total


def _over(part: Array, whole: Array) -> Array:
    """Return a part of something; NaN of nothing."""
    return np.asarray(np.divide(part, whole, out=np.full(np.shape(part), np.nan), where=whole > 0))


def _bins(values: Array, low: float, high: float) -> Array:
    """Return the bin of each value, uint8 (n,); outside of low and high the first and the last."""
    bins = (values - low) * (BINS / (high - low) if high > low else 0.0)
    return np.clip(bins, 0, BINS - 1, out=bins).astype(np.uint8)


def _quantiles(
    held: Weighted, bins: Array, table: Array, values: Callable[[Array], Array], rows: Sequence[int]
) -> Array:
    """Return the quantiles of values (rows, LEVELS), of some rows alone.

    A quantile is the least value up to and with which the weights add up to its level. bins: uint8 (n,), and table: the
    weights in them (rows, BINS). values: gives those of some slots, which ascend with their bins within a row.
    """
    up_to = np.cumsum(table, axis=1)
    aim = np.asarray(LEVELS) * up_to[:, -1:]
    end = np.where(table > 0, np.arange(BINS), 0).max(axis=1)  # rounding must not lead beyond the last weight
    wanted = np.minimum((up_to[:, None, :] < aim[:, :, None]).sum(axis=-1), end[:, None])
    quantiles, edges = np.full(wanted.shape, np.nan), _edges(held.blocks)
    for row in rows:
        if up_to[row, -1] > 0:
            begin, over = (edges[row], edges[row + 1]) if row < len(table) - 1 else (0, held.blocks.n)
            chosen = np.zeros(BINS, bool)  # only the particles of bins that hold a quantile are sorted
            chosen[wanted[row]] = True
            slots = np.flatnonzero(chosen.take(bins[begin:over])) + begin
            slots = slots[held.weight[slots] > 0]
            ranked = values(slots)
            rising = np.argsort(ranked)
            slots, ranked = slots[rising], ranked[rising]
            rest = aim[row] - (up_to - table)[row, wanted[row]]
            quantiles[row] = _within(ranked, held.weight[slots], bins[slots], wanted[row], rest)
    return quantiles


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
