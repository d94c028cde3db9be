"""Probability and time of a Brownian bridge's first crossing of a straight line in the plane.

Only the distance from the line matters. It is a one-dimensional bridge between the distances of
departure and arrival: equations 10 and 11 of Nunez, Singham and Atkinson 2020
(doi:10.1080/01605682.2019.1570806), from propositions 4.6 and 4.7 of Atkinson and Singham 2015
(doi:10.1016/j.spl.2015.02.006). The line is infinite, and departure and arrival are known;
drift.tracking.bridges.crossing extends this to the sphere and to uncertain ends.
"""

import numpy as np
import numpy.typing as npt
from scipy import special

from geo.array import Array


def crossed(
    departure: npt.ArrayLike,
    arrival: npt.ArrayLike,
    spread_rate: npt.ArrayLike,
    duration: npt.ArrayLike,
) -> Array:
    """Return the probability that a bridge crosses the line at all (equation 10).

    It is 1 if the ends are on different sides. All arguments broadcast.

    Args:
        departure: distance from the line [m], negative on its other side.
        arrival: distance from the line [m].
        spread_rate: K [m/sqrt(s)], at least 0.
        duration: [s], above 0.
    """
    return touched(departure, arrival, spread_rate, duration, duration)


def touched(
    departure: npt.ArrayLike,
    arrival: npt.ArrayLike,
    spread_rate: npt.ArrayLike,
    duration: npt.ArrayLike,
    elapsed: npt.ArrayLike,
) -> Array:
    """Return the probability that a bridge has crossed the line by a time (equation 11).

    It also holds for ends on one side. With the distance a of departure on the positive side and b
    of arrival, let m = a (T - t) / T + b t / T be the mean distance at t and v = K^2 t (T - t) / T
    its variance. Then F(t) = Phi(-m / sqrt(v)) + exp(-2 a b / (K^2 T)) Phi(q), where q = (b t - a
    (T - t)) / (T sqrt(v)). For b < 0 that is equation 11; for b > 0 and t = T it is equation 10.
    The exponential overflows for a small K. But exp(-2 a b / (K^2 T) - q^2 / 2) = exp(-m^2 / (2
    v)), so for q < 0 the second term is exp(-m^2 / (2 v)) erfcx(-q / sqrt(2)) / 2: no term exceeds
    1 and nothing cancels, for any K down to 0.

    Args:
        departure: distance from the line [m], negative on its other side.
        arrival: distance from the line [m].
        spread_rate: K [m/sqrt(s)], at least 0.
        duration: [s], above 0.
        elapsed: time since departure [s], 0 to `duration`.
    """
    a, b, k, total, t = np.broadcast_arrays(
        *(np.asarray(x, np.float64) for x in (departure, arrival, spread_rate, duration, elapsed))
    )
    side = np.where(a < 0, -1.0, 1.0)
    a, b = a * side, b * side
    mean = a * (total - t) / total + b * t / total
    std = k * np.sqrt(t * (total - t) / total)
    away = (b * t - a * (total - t)) / total
    moving = std > 0
    scale = np.where(moving, std, 1.0)
    with np.errstate(over="ignore"):
        p, q = mean / scale, away / scale
    strays = np.where(k > 0, k, 1.0)
    with np.errstate(
        over="ignore"
    ):  # for K near 0 these are infinite and their exponentials 0, which is correct
        # Equation 10 is needed only if both ends are on one side: only then can q be positive.
        one_side = np.exp(-2 * (a / strays) * (np.maximum(b, 0.0) / strays) / total)
        second = np.where(
            q < 0,
            0.5 * np.exp(-0.5 * p**2) * special.erfcx(-np.minimum(q, 0.0) / np.sqrt(2)),
            one_side * special.ndtr(q),
        )
    reached = special.ndtr(-p) + second
    # Without variance the mean decides, except at arrival, when the whole path has been travelled.
    still = np.where((t >= total) & (b > 0) & (k > 0), one_side, np.where(mean <= 0, 1.0, 0.0))
    return np.asarray(np.clip(np.where(a == 0, 1.0, np.where(moving, reached, still)), 0.0, 1.0))
