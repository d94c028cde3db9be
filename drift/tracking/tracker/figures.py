"""Numbers of many runs: means, standard errors, quantiles."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from geo.array import Array

QUANTILES = (0.1, 0.5, 0.9)
ENDLESS = 1e30  # stands for inf among numbers that are ranked


@dataclass(frozen=True)
class Figure:
    """A number of each run, in every way of following."""

    name: str
    unit: str
    values: (
        # (ways of following, runs); NaN: that run has none; inf: it came to no end, as a time to
        # what never came
        Array
    )
    apart: Array | None = (
        # differences from the first way (ways, runs), where more is known of them than the values
        # tell
        None
    )

    def mean(self) -> Array:
        """Return the mean over the runs that have one (ways of following,);

        NaN where one came to no end.
        """
        return over(np.nanmean, self._ended)

    def error(self) -> Array:
        """Return the standard error of the mean (ways of following,);

        NaN of fewer than two runs, and where one came to no end.
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
        """Return the QUANTILES over the runs that have one (ways of following, quantiles); inf
        where that is of one without an end.
        """
        ranked = np.where(np.isinf(self.values), ENDLESS, self.values)
        found = np.stack(
            [over(partial(np.nanquantile, q=share), ranked) for share in QUANTILES], axis=1
        )
        return np.where(found < ENDLESS * 1e-9, found, np.where(np.isnan(found), np.nan, np.inf))

    def missing(self) -> Array:
        """Return in how many runs there is none, or no end (ways of following,)."""
        return np.asarray((~np.isfinite(self.values)).sum(axis=1))

    @property
    def _ended(self) -> Array:
        """Return the values, NaN in all runs of a way where one came to no end: a mean of the
        others would praise who fails.
        """
        return np.where(np.isinf(self.values).any(axis=1, keepdims=True), np.nan, self.values)

    def difference(self) -> tuple[Array, Array]:
        """Return (mean, standard error) of the difference from the first way, run by run, each
        (ways of following,).

        Runs share their random numbers, so that it errs by less than two means do.
        """
        apart = Figure(
            self.name, self.unit, self._ended - self._ended[0] if self.apart is None else self.apart
        )
        return apart.mean(), apart.error()


@dataclass(frozen=True)
class Curve:
    """A number of each run at each time, in every way of following."""

    name: str
    unit: str
    values: Array  # (ways of following, runs, times); NaN: that run has none then
    right: float | None = None  # what it should be

    def mean(self) -> tuple[Array, Array]:
        """Return (mean, standard error) over the runs that have one, each (ways of following,
        times).
        """
        held = np.isfinite(self.values)
        many = held.sum(axis=1)
        safe = np.maximum(many, 1)
        mean = np.where(many > 0, np.where(held, self.values, 0.0).sum(axis=1) / safe, np.nan)
        spread = np.where(held, (self.values - mean[:, None]) ** 2, 0.0).sum(axis=1) / np.maximum(
            many - 1, 1
        )
        return mean, np.where(many > 1, np.sqrt(spread / safe), np.nan)


def of_times(name: str, unit: str, values: Array) -> Figure:
    """Return a figure that is a mean over times (ways of following, runs, times); NaN: that way has
    none then.

    Differences are over the times at which both ways have one: who loses the target when it is hard
    to follow would else seem to follow it better.
    """
    return Figure(name, unit, over(np.nanmean, values), over(np.nanmean, values - values[:1]))


def over(reduce: Callable[[Array], Array], values: Array) -> Array:
    """Return a mean or quantile over the last axis of what is no NaN; NaN where all are."""
    flat = values.reshape(-1, values.shape[-1])
    rows = [reduce(row) if np.isfinite(row).any() else np.nan for row in flat]
    return np.asarray(rows, np.float64).reshape(values.shape[:-1])
