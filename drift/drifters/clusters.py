"""Shares and means of what is not independent: standard errors clustered by drifter and by day.

Forecasts of one drifter share its ways, forecasts of one day share the model's errors of that day. With two-way clustering
(Cameron, Gelbach and Miller 2011, doi:10.1198/jbes.2010.07136, eq. 2.11) both may be correlated in any way; what has neither
in common counts as independent. Few clusters say little about their own spread: then it is said.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drift.drifters.records import Array

FEW = 10  # clusters of a kind below which their spread is a rough guess


@dataclass(frozen=True)
class Estimate:
    """A mean with its standard error, of how many values in how many drifters and days."""

    mean: float
    error: float
    count: int
    drifters: int
    days: int

    @property
    def few(self) -> bool:
        """Whether the standard error is a rough guess."""
        return min(self.drifters if self.drifters > 1 else self.days, self.days) < FEW


def _variance(residual: Array, cluster: Array) -> float:
    """Return the variance of a mean by clusters, with the small-sample factor G / (G - 1); NaN of one cluster."""
    _, code = np.unique(cluster, return_inverse=True)
    sums = np.bincount(code.ravel(), residual)
    if sums.size < 2:
        return math.nan
    return float((sums**2).sum() * sums.size / (sums.size - 1) / residual.size**2)


def mean(values: npt.ArrayLike, drifter: npt.ArrayLike, day: npt.ArrayLike, *, share: bool = False) -> Estimate:
    """Return the mean of values (n,) with its clustered standard error; drifter, day: the clusters of each, (n,).

    share: values are 0 or 1. Their standard error is then at least that of as many independent trials, of (k + 1) / (n + 2),
    for none or all of a few say less than an error of 0 would. Of one drifter days alone are the clusters.
    """
    value = np.asarray(values, np.float64)
    who, when = np.asarray(drifter), np.asarray(day)
    if value.size == 0:
        return Estimate(math.nan, math.nan, 0, 0, 0)
    centre = float(value.mean())
    left = value - centre
    _, a = np.unique(who, return_inverse=True)
    _, b = np.unique(when, return_inverse=True)
    both = a.ravel() * (b.max() + 1) + b.ravel()
    single, daily, crossed = _variance(left, a), _variance(left, b), _variance(left, both)
    known = [variance for variance in (single, daily) if not math.isnan(variance)]
    if len(known) == 2:
        # the difference may come out too small by chance (ibid., section 2.3): it is never below either alone
        known.append(single + daily - crossed)
    variance = max(known, default=math.nan)
    if share:
        guess = (value.sum() + 1) / (value.size + 2)
        variance = np.nanmax([variance, guess * (1 - guess) / value.size])
    return Estimate(centre, math.sqrt(variance), value.size, int(a.max()) + 1, int(b.max()) + 1)
