"""Weighted distribution of one quantity: shares, moments, exact quantiles and a histogram.

Particles are read in parts, and sums are made by blocks (drift.engine.particles.partials).
Quantiles are exact: the histogram finds the bin of each, and only the particles of those bins are
sorted.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drift.engine.particles import partials, weights
from drift.engine.particles.columns import Columns
from drift.engine.particles.partials import Blocks, Partial
from geo.array import Array

LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
BINS = 256
TURN = 2 * np.pi
# relative rounding error of sums of a million terms: a variance that is a smaller part of the mean
# square counts as 0
ROUNDING = 2.0**-44
SORTED = 2**21  # most particles of a bin that are sorted at once; a larger bin is divided again

# Yields values and weights of particles, part by part.
Members = Callable[[], Iterable[tuple[Array, Array]]]


@dataclass(frozen=True)
class Marginal:
    """A distribution in SI and radians; NaN without weight.

    Rows are each scenario, then all together. A category only has shares and effective numbers.
    """

    share: Array  # (rows,) probability of the particles that have the quantity
    ess: Array  # (rows,) effective number of these particles (Kong 1992)
    # category: shares of its values (rows, values), or (1, values) if each scenario has one value;
    # otherwise: shares of bins of all together (1, BINS)
    table: Array
    mean: Array | None = None  # (rows,); of angles the direction of the mean vector, in [0, 2 pi)
    # (rows,); of angles sqrt(-2 ln R), R the length of the mean vector (Mardia 1972)
    std: Array | None = None
    # (rows, LEVELS); for angles, of the turn that begins opposite the mean
    quantiles: Array | None = None


class Weighted(NamedTuple):
    """Particles with their weights, and the sums of weights and of their squares."""

    # log_weight; lineage after resampling; holds if some particles do not have the quantity
    columns: Columns
    top: float  # the largest log weight of all
    total: Array  # (rows,) in units of the largest weight
    squares: Array  # (rows,) sums of squared weights, copies of a particle counting as one

    @property
    def ess(self) -> Array:
        """The effective sample size (Kong 1992), copies as one, (rows,); 0 without weight."""
        none = np.zeros(len(self.total))
        return np.asarray(np.divide(self.total**2, self.squares, out=none, where=self.squares > 0))

    def parts(self, *names: str) -> Iterator[tuple[Any, ...]]:
        """Yield blocks of particles, their weights and columns, part by part.

        Weights are 0 for particles that do not have the quantity.
        """
        for blocks, log_weight, holds, *columns in self.columns.parts(
            "log_weight", "holds", *names
        ):
            weight = weights.relative(log_weight, self.top)
            yield blocks, weight if holds is None else weight * holds, *columns

    def row(self, row: int) -> "Weighted":
        """Return the particles of a row: of one scenario, or all."""
        blocks = self.columns.blocks
        return (
            self
            if row == blocks.scenarios
            else self._replace(columns=self.columns.some(*_span(blocks, row)))
        )


def weighted(columns: Columns, top: float | None = None) -> Weighted:
    """Return particles with their weights and sums.

    Args:
        columns: `log_weight` and, after resampling, `lineage`, the initial particle from which each
            descends: copies count as one (drift.forecast.effective).
        top: the largest log weight, if it is known.
    """
    if top is None:
        top = max(float(log_weight.max()) for _, log_weight in columns.parts("log_weight"))
    found = Weighted(columns, top, np.empty(0), np.empty(0))
    sums, runs = [], []
    for blocks, weight, lineage in found.parts("lineage"):
        sums.append(blocks.partial(weight, weight**2))
        if lineage is not None:
            scenario = np.repeat(blocks.scenario, np.diff(blocks.first, append=blocks.n))
            runs.append(
                weights.runs_of_families(scenario, blocks.scenarios, weight, lineage, blocks)
            )
    total, squares = _sums_by_scenario(sums)[:, 0].T
    if runs:
        many = columns.blocks.scenarios
        of, mass = weights.families(many, runs)
        own = np.bincount(of, mass**2, many)
        squares = np.append(own, own.sum())
    return found._replace(total=total, squares=squares)


def of_category(own: Weighted, values: Columns, many: int) -> Marginal:
    """Return the distribution of a category.

    Args:
        own: the particles.
        values: number of each particle's value, 0 to many - 1 where it `holds`.
        many: number of values.
    """
    held = _having_quantity(own, values)
    coded = [
        blocks.partial(weight, code=np.where(holds, number, 0), many=many)
        for blocks, weight, number, holds in held.parts("values", "holds")
    ]
    sums, total = _sums_by_scenario(coded)[:, :, 0], own.total[:, None]
    table = np.divide(sums, total, out=np.full(sums.shape, np.nan), where=total > 0)
    return Marginal(table.sum(axis=1), held.ess, table)


def of_scenarios(own: Weighted, number: npt.NDArray[np.int64], many: int) -> Marginal:
    """Return the distribution of a category with one value per scenario.

    The table has one row, of all scenarios together.

    Args:
        own: the particles.
        number: of each scenario's value, 0 to many - 1; -1: none. Shape (scenarios,).
        many: number of values.
    """
    holds, total = number >= 0, own.total[:-1]
    sums = np.bincount(number[holds], total[holds], many)
    held, squares = np.append(total * holds, sums.sum()), own.squares[:-1] * holds
    squares = np.append(squares, squares.sum())
    ess = np.divide(held**2, squares, out=np.zeros(len(held)), where=squares > 0)
    return Marginal(_ratio(held, own.total), ess, _ratio(sums, own.total[-1])[None])


def of_number(own: Weighted, values: Columns, low: float, high: float) -> Marginal:
    """Return the distribution of numbers, where they hold.

    Args:
        own: the particles.
        values: of the quantity.
        low: begin of the histogram; smaller values are in its first bin.
        high: end of the histogram; larger values are in its last bin.
    """
    # moments about the middle lose less precision
    held, middle = _having_quantity(own, values), (low + high) / 2
    moments, coded = [], []
    for blocks, weight, number in held.parts("values"):
        off = np.subtract(number, middle, dtype=np.float64)
        moments.append(blocks.partial(weight * off, weight * off * off))
        coded.append(
            blocks.partial(weight, code=_bins(number.astype(np.float64), low, high), many=BINS)
        )
    sums, table = _sums_by_scenario(moments)[:, 0], _sums_by_scenario(coded)[:, :, 0]
    mean, square = _ratio(sums[:, 0], held.total), _ratio(sums[:, 1], held.total)
    variance = np.where(square - mean**2 > ROUNDING * square, square - mean**2, 0.0 * square)

    def members(row: int) -> Iterator[tuple[Array, Array]]:
        for _, weight, number in held.row(row).parts("values"):
            yield number.astype(np.float64), weight

    quantiles = [
        _quantiles(partial(members, row), levels, low, high) for row, levels in enumerate(table)
    ]
    shares = _ratio(held.total, own.total), held.ess
    return Marginal(
        *shares,
        _ratio(table[-1], own.total[-1])[None],
        mean + middle,
        np.sqrt(variance),
        np.array(quantiles),
    )


def of_angle(own: Weighted, values: Columns) -> Marginal:
    """Return the distribution of angles [rad], where they hold.

    The histogram covers [0, 2 pi).
    """
    held, turned, coded = _having_quantity(own, values), [], []
    for blocks, weight, angle in held.parts("values"):
        within = angle.astype(np.float64) % TURN
        turned.append(blocks.partial(weight * np.sin(within), weight * np.cos(within)))
        coded.append(blocks.partial(weight, code=_bins(within, 0.0, TURN), many=BINS))
    sums, table = _sums_by_scenario(turned)[:, 0], _sums_by_scenario(coded)[:, :, 0]
    mean = np.where(held.total > 0, np.arctan2(sums[:, 0], sums[:, 1]) % TURN, np.nan)
    length = np.minimum(_ratio(np.hypot(sums[:, 0], sums[:, 1]), held.total), 1.0)
    with np.errstate(divide="ignore"):
        std = np.sqrt(-2 * np.log(length))
    quantiles = np.array(
        [_quantiles_about(held.row(row), middle) for row, middle in enumerate(np.nan_to_num(mean))]
    )
    shares = _ratio(held.total, own.total), held.ess
    return Marginal(*shares, _ratio(table[-1], own.total[-1])[None], mean, std, quantiles)


def _quantiles_about(held: Weighted, centre: float) -> Array:
    """Return the quantiles (LEVELS,) of angles, ordered by their difference from a centre."""

    def members() -> Iterator[tuple[Array, Array]]:
        for _, weight, angle in held.parts("values"):
            apart = angle.astype(np.float64) % TURN - centre
            yield apart + TURN * ((apart < -np.pi).astype(np.float64) - (apart >= np.pi)), weight

    table = np.zeros(BINS)
    for apart, weight in members():
        table += np.bincount(_bins(apart, -np.pi, np.pi), weight, BINS)
    return np.asarray((_quantiles(members, table, -np.pi, np.pi) + centre) % TURN)


def _having_quantity(own: Weighted, values: Columns) -> Weighted:
    """Return the particles that have a quantity, with their values."""
    return weighted(own.columns | values, own.top)


def _span(blocks: Blocks, scenario: int) -> tuple[int, int]:
    """Return the numbers of a scenario's first block and of the block after its last."""
    begin, end = np.searchsorted(blocks.scenario, (scenario, scenario + 1))
    return int(begin), int(end)


def _sums_by_scenario(parts: list[Partial]) -> Array:
    """Return sums of all parts by scenario and, last, of all, (scenarios + 1, codes, values)."""
    by_scenario = partials.merge_partials(parts).by_scenario
    # added in the order of Partial.total, for the same bits
    return np.concatenate([by_scenario, np.add.accumulate(by_scenario, axis=0)[-1:]])


def _ratio(part: Array, whole: Array) -> Array:
    """Return part / whole; NaN where the whole is 0."""
    return np.asarray(np.divide(part, whole, out=np.full(np.shape(part), np.nan), where=whole > 0))


def _bins(values: Array, low: float, high: float) -> Array:
    """Return the bin of each value, uint8 (n,); values outside are in the first or last bin."""
    bins = (values - low) * (BINS / (high - low) if high > low else 0.0)
    return np.clip(bins, 0, BINS - 1, out=bins).astype(np.uint8)


def _quantiles(members: Members, table: Array, low: float, high: float) -> Array:
    """Return the quantiles of particles (LEVELS,); table: weights in BINS from low to high."""
    return _ranked(members, table, low, high, np.asarray(LEVELS) * np.cumsum(table)[-1])


def _ranked(members: Members, table: Array, low: float, high: float, aim: Array) -> Array:
    """Return the smallest values at which cumulative weights reach `aim`; NaN without weight."""
    if not table.any():
        return np.full(len(aim), np.nan)
    # rounding must not lead beyond the last weight
    up_to, end = np.cumsum(table), np.flatnonzero(table)[-1]
    wanted = np.minimum(np.searchsorted(up_to, aim), end)
    rest, found = aim - (up_to - table)[wanted], np.empty(len(aim))
    bins = {int(code): _Bin() for code in np.unique(wanted)}
    chosen = np.zeros(BINS, bool)  # only the particles of bins that hold a quantile are sorted
    chosen[wanted] = True
    for numbers, weight in members():
        codes = _bins(numbers, low, high)
        which = np.flatnonzero(chosen.take(codes) & (weight > 0))
        numbers, weight, codes = numbers[which], weight[which], codes[which]
        for code, own in bins.items():
            inside = codes == code
            own.take(numbers[inside], weight[inside])
    for code, own in bins.items():
        levels = wanted == code
        if own.many <= SORTED or own.least == own.most:
            found[levels] = own.at(rest[levels])
            continue

        def inner(code: int = code) -> Iterator[tuple[Array, Array]]:
            for numbers, weight in members():
                inside = (_bins(numbers, low, high) == code) & (weight > 0)
                yield numbers[inside], weight[inside]

        finer = np.zeros(BINS)
        for numbers, weight in inner():
            finer += np.bincount(_bins(numbers, own.least, own.most), weight, BINS)
        found[levels] = _ranked(inner, finer, own.least, own.most, rest[levels])
    return found


class _Bin:
    """The particles of one bin, stored while they are few enough to be sorted."""

    def __init__(self) -> None:
        self.many, self.least, self.most = 0, np.inf, -np.inf
        self._kept: list[tuple[Array, Array]] = []

    def take(self, numbers: Array, weight: Array) -> None:
        """Add particles."""
        if not numbers.size:
            return
        self.many += numbers.size
        self.least, self.most = (
            min(self.least, float(numbers.min())),
            max(self.most, float(numbers.max())),
        )
        if self.many <= SORTED:
            self._kept.append((numbers, weight))
        else:
            self._kept.clear()

    def at(self, rest: Array) -> Array:
        """Return the values at which the cumulative weights reach `rest`."""
        if self.least == self.most:
            return np.full(len(rest), self.least)
        numbers, weight = (np.concatenate(column) for column in zip(*self._kept, strict=True))
        rising = np.argsort(numbers, kind="stable")
        at = np.searchsorted(np.cumsum(weight[rising]), rest)
        return np.asarray(numbers[rising][np.minimum(at, len(numbers) - 1)])
