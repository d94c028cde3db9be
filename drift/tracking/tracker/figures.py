"""Statistics over many runs: means, standard errors and quantiles."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from geo.array import Array

QUANTILES = (0.1, 0.5, 0.9)
ENDLESS = 1e30  # replaces inf when numbers are ranked


@dataclass(frozen=True)
class Figure:
    """A number of each run, for every way of following."""

    name: str
    unit: str
    values: (
        # (ways of following, runs); NaN: no value; inf: the run did not end (a time to an event
        # that never came)
        Array
    )
    apart: Array | None = (
        # differences from the first way (ways, runs), if they are known better than by the values
        None
    )

    def mean(self) -> Array:
        """Return the mean over runs that have a value, shape (ways of following,).

        NaN if a run did not end.
        """
        return _over(np.nanmean, self._ended)

    def error(self) -> Array:
        """Return the standard error of the mean, shape (ways of following,).

        NaN for fewer than two runs, and if a run did not end.
        """
        many = np.isfinite(self._ended).sum(axis=1)
        spread = np.array(
            [
                np.nanstd(row, ddof=1) if n > 1 else np.nan
                for row, n in zip(self._ended, many, strict=True)
            ]
        )
        return np.asarray(spread / np.sqrt(np.maximum(many, 1)))

    def quantiles(self) -> Array:
        """Return the QUANTILES over runs that have a value (ways of following, quantiles).

        inf if the quantile is that of a run that did not end.
        """
        ranked = np.where(np.isinf(self.values), ENDLESS, self.values)
        found = np.stack(
            [_over(partial(np.nanquantile, q=share), ranked) for share in QUANTILES], axis=1
        )
        return np.where(found < ENDLESS * 1e-9, found, np.where(np.isnan(found), np.nan, np.inf))

    def missing(self) -> Array:
        """Return the number of runs without a value or an end, (ways of following,)."""
        return np.asarray((~np.isfinite(self.values)).sum(axis=1))

    @property
    def _ended(self) -> Array:
        """Return the values, NaN in all runs of a way of following if one run did not end.

        A mean of the other runs would favour a way that fails.
        """
        return np.where(np.isinf(self.values).any(axis=1, keepdims=True), np.nan, self.values)

    def difference(self) -> tuple[Array, Array]:
        """Return mean and standard error of the difference from the first way, run by run.

        Each has the shape (ways of following,). Runs share random numbers, which reduces the error
        of the difference.
        """
        apart = Figure(
            self.name, self.unit, self._ended - self._ended[0] if self.apart is None else self.apart
        )
        return apart.mean(), apart.error()


@dataclass(frozen=True)
class Curve:
    """A number of each run at each time, for every way of following."""

    name: str
    unit: str
    values: Array  # (ways of following, runs, times); NaN: that run has none then
    right: float | None = None  # expected value

    def mean(self) -> tuple[Array, Array]:
        """Return mean and standard error over runs with a value, (ways of following, times)."""
        finite = np.isfinite(self.values)
        many = finite.sum(axis=1)
        safe = np.maximum(many, 1)
        mean = np.where(many > 0, np.where(finite, self.values, 0.0).sum(axis=1) / safe, np.nan)
        spread = np.where(finite, (self.values - mean[:, None]) ** 2, 0.0).sum(axis=1) / np.maximum(
            many - 1, 1
        )
        return mean, np.where(many > 1, np.sqrt(spread / safe), np.nan)


def of_times(name: str, unit: str, values: Array) -> Figure:
    """Return a figure that is a mean over times; NaN: no value at any time.

    Differences use only times at which both ways have a value. Otherwise a way that loses the
    target in difficult times would seem better.

    Args:
        name: of the figure.
        unit: of the figure.
        values: shape (ways of following, runs, times).
    """
    return Figure(name, unit, _over(np.nanmean, values), _over(np.nanmean, values - values[:1]))


def _over(reduce: Callable[[Array], Array], values: Array) -> Array:
    """Return a reduction over the last axis, ignoring NaN; NaN if all values are NaN."""
    flat = values.reshape(-1, values.shape[-1])
    rows = [reduce(row) if np.isfinite(row).any() else np.nan for row in flat]
    return np.asarray(rows, np.float64).reshape(values.shape[:-1])
