"""Weights and their logarithms on the host, in float64 and one order: what evidence, shares and effective sizes are made from."""

import numpy as np

from geo.array import Array


def relative(log_weight: Array, scale: Array | None = None) -> Array:
    """Return weights, float64, of which the largest is 1; or in units of the largest of `scale`."""
    top = float((log_weight if scale is None else scale).max())
    return np.asarray(np.exp(log_weight.astype(np.float64) - top))


def shares(log_weight: Array) -> Array:
    """Return log weights (n,) as probabilities, float64, of sum 1."""
    weight = relative(log_weight)
    return np.asarray(weight / weight.sum())


def log_sum(log_weight: Array) -> float:
    """Return the log of the sum of weights; -inf where there is none."""
    top = float(log_weight.max()) if log_weight.size else -np.inf
    if top == -np.inf:
        return top
    return float(top + np.log(np.exp(log_weight.astype(np.float64) - top).sum()))


def ess(log_weight: Array) -> float:
    """Return the effective sample size of log weights (Kong 1992)."""
    return effective(relative(log_weight))


def effective(weight: Array) -> float:
    """Return the effective number of weights (n,) of any scale, not all 0: sum squared over sum of squares (Kish 1965, sec. 11.2)."""
    return float(weight.sum() ** 2 / (weight**2).sum())
