"""Dense Gaussian conditioning on the tracks of buoys, and particles that share their errors, in
NumPy.
"""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any


@dataclass(frozen=True)
class Seen:
    """A displacement since the begin of a stretch: from `begin` to `end` [s], of buoy `buoy`."""

    buoy: int
    begin: float
    end: float
    excess: Array  # (hypotheses, 2) [m]


def displacements(fixes: Any) -> list[Seen]:
    """Return the displacements of buoys (drift.engine.motion.buoy_errors.Fixes)."""
    found = []
    for number, own in enumerate(fixes):
        begin = 0.0
        for k, (time, fresh) in enumerate(zip(own.time, own.fresh, strict=True)):
            if fresh:
                begin = time
            else:
                found.append(Seen(number, begin, time, own.excess[:, k]))
    return found


def integral(times: Array, begin: float, end: float, memory: float) -> Array:
    """Return the integral over s from begin to end of exp(-|t - s| / memory), at times t."""

    def below(t: Array, a: float, b: float) -> Array:  # s from a to b, both at most t
        return memory * (np.exp(-(t - b) / memory) - np.exp(-(t - a) / memory))

    t = np.asarray(times, float)
    before = below(t, np.minimum(begin, t), np.minimum(end, t))
    after = memory * (
        np.exp(-(np.maximum(begin, t) - t) / memory) - np.exp(-(np.maximum(end, t) - t) / memory)
    )
    return before + after


def twice(a: Seen, b: Seen, memory: float) -> float:
    """Return the integral over both displacements of exp(-|t - s| / memory), by Gauss-Legendre."""
    edges = np.unique(np.clip([a.begin, a.end, b.begin, b.end], a.begin, a.end))
    nodes, weights = np.polynomial.legendre.leggauss(24)
    total = 0.0
    for low, high in itertools.pairwise(edges):
        half = (high - low) / 2
        t = low + half * (nodes + 1)
        total += half * weights @ integral(t, b.begin, b.end, memory)
    return total


def conditioned(
    law: Any, correlations: tuple[Array, Array], windage: Array, error: Array, fixes: Any,
    times: Array,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return the errors at m buoys given their fixes: mean (times x 3m, hypotheses, 2), covariance,
    and the log likelihood of each hypothesis.

    The 3m values of a time are the standardised errors of the current, those of the wind and the
    biases at the buoys. correlations: between buoys, (m, m), constant, of current and wind.
    """
    seen, m = displacements(fixes), len(windage)
    current, wind = correlations
    n = len(seen)
    variance = np.zeros((n, n))
    for p, a in enumerate(seen):
        for q, b in enumerate(seen):
            together = max(0.0, min(a.end, b.end) - max(a.begin, b.begin))
            both = current[a.buoy, b.buoy]
            variance[p, q] = (
                both * law.current_std**2 * twice(a, b, law.current_time)
                + both * law.bias_std**2 * (a.end - a.begin) * (b.end - b.begin)
                + wind[a.buoy, b.buoy] * windage[a.buoy] * windage[b.buoy]
                * law.wind_std**2 * twice(a, b, law.wind_time)
            )  # fmt: skip
            if a.buoy == b.buoy:
                variance[p, q] += 2 * law.diffusivity * together
                variance[p, q] += error[a.buoy] ** 2 * (int(a.begin == b.begin) + int(p == q))
    k, size = len(times), 3 * m
    cross = np.zeros((k, size, n))
    prior = np.zeros((k, size, k, size))
    lag = np.abs(times[:, None] - times)
    for j in range(m):
        for p, a in enumerate(seen):
            cross[:, j, p] = (
                law.current_std * current[j, a.buoy]
                * integral(times, a.begin, a.end, law.current_time)
            )  # fmt: skip
            cross[:, m + j, p] = (
                windage[a.buoy] * law.wind_std * wind[j, a.buoy]
                * integral(times, a.begin, a.end, law.wind_time)
            )  # fmt: skip
            cross[:, 2 * m + j, p] = law.bias_std * current[j, a.buoy] * (a.end - a.begin)
        for i in range(m):
            prior[:, j, :, i] = current[j, i] * np.exp(-lag / law.current_time)
            prior[:, m + j, :, m + i] = wind[j, i] * np.exp(-lag / law.wind_time)
            prior[:, 2 * m + j, :, 2 * m + i] = current[j, i]
    cross, prior = cross.reshape(k * size, n), prior.reshape(k * size, k * size)
    inverse = np.linalg.inv(variance)
    excess = np.stack([a.excess for a in seen])  # (n, hypotheses, 2)
    mean = np.einsum("xp,pq,qhc->xhc", cross, inverse, excess)
    determinant = np.linalg.slogdet(2 * np.pi * variance)[1]
    log_likelihood = -0.5 * np.einsum("phc,pq,qhc->h", excess, inverse, excess) - determinant
    return mean, prior - cross @ inverse @ cross.T, log_likelihood
