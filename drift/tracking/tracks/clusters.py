"""Means and shares of dependent values, with standard errors clustered by drifter and by day.

Forecasts of one drifter share its track, and forecasts of one day share the model's errors of that
day. With two-way clustering (Cameron, Gelbach and Miller 2011, doi:10.1198/jbes.2010.07136, eq.
2.11) values in a common cluster may be correlated in any way; values without one count as
independent. A few clusters give only a rough estimate of their spread; `few` reports that.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geo.array import Array

FEW = 10  # clusters of a kind below which the standard error is rough


@dataclass(frozen=True)
class Estimate:
    """A mean with its standard error, and the numbers of values, drifters and days."""

    mean: float
    error: float
    count: int
    drifters: int
    days: int

    @property
    def few(self) -> bool:
        """Whether the standard error is rough because there are few clusters."""
        return min(self.drifters if self.drifters > 1 else self.days, self.days) < FEW


def _variance(residual: Array, cluster: Array) -> float:
    """Return the variance of a mean by G clusters, with the small-sample factor G / (G - 1).

    It is NaN for one cluster.
    """
    _, code = np.unique(cluster, return_inverse=True)
    sums = np.bincount(code.ravel(), residual)
    if sums.size < 2:
        return math.nan
    return float((sums**2).sum() * sums.size / (sums.size - 1) / residual.size**2)


def mean(
    values: npt.ArrayLike, drifter: npt.ArrayLike, day: npt.ArrayLike, *, share: bool = False
) -> Estimate:
    """Return the mean of values with its clustered standard error.

    With one drifter the clusters are days.

    Args:
        values: shape (n,).
        drifter: cluster of each value, shape (n,).
        day: other cluster of each value, shape (n,).
        share: whether values are 0 or 1. Their standard error is then at least that of n
            independent trials with the probability (k + 1) / (n + 2), because none or all of a few
            values do not prove an error of 0.
    """
    value = np.asarray(values, np.float64)
    drifters, days = np.asarray(drifter), np.asarray(day)
    if value.size == 0:
        return Estimate(math.nan, math.nan, 0, 0, 0)
    centre = float(value.mean())
    residual = value - centre
    _, a = np.unique(drifters, return_inverse=True)
    _, b = np.unique(days, return_inverse=True)
    crossed_code = a.ravel() * (b.max() + 1) + b.ravel()
    single, daily, crossed = (
        _variance(residual, a),
        _variance(residual, b),
        _variance(residual, crossed_code),
    )
    variances = [variance for variance in (single, daily) if not math.isnan(variance)]
    if len(variances) == 2:
        # The combination may be too small by chance (ibid., section 2.3): take at least each one
        # alone.
        variances.append(single + daily - crossed)
    variance = max(variances, default=math.nan)
    if share:
        guess = (value.sum() + 1) / (value.size + 2)
        variance = np.nanmax([variance, guess * (1 - guess) / value.size])
    return Estimate(centre, math.sqrt(variance), value.size, int(a.max()) + 1, int(b.max()) + 1)
