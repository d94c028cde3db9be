"""Dense Gaussian conditioning on the tracks of buoys and on reports, in NumPy."""

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
    """Return the displacements of buoys (drift.engine.motion.errors.buoy_errors.Fixes)."""
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
    times: Array, sights: Any = (),
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return the errors at m places given fixes of buoys and reports: mean (times x 3m, hypotheses, 2), covariance,
    and the log likelihood of each hypothesis.

    The 3m values of a time are the standardised errors of the current, those of the wind and the
    biases there. correlations: between places, (m, m), constant, of current and wind; the buoys are
    the first places. sights: what reports show (drift.engine.motion.errors.buoy_errors.Sight).
    """
    seen, m = displacements(fixes), len(correlations[0])
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
    excess = [a.excess for a in seen]
    for number, sight in enumerate(sights):
        own = [across_fix(law, correlations, windage, sight, a) for a in seen]
        own += [across_sights(law, correlations, sight, other) for other in sights[:number]]
        own.append(across_sights(law, correlations, sight, sight) + sight.error**2)
        grown = np.zeros((len(own), len(own)))
        grown[:-1, :-1] = variance
        grown[-1], grown[:, -1] = own, own
        variance = grown
        column = across_states(law, correlations, sight, times).reshape(k * size, 1)
        cross = np.concatenate([cross, column], axis=1)
        excess.append(sight.excess)
    inverse = np.linalg.inv(variance)
    excess = np.stack(excess)  # (n, hypotheses, 2)
    mean = np.einsum("xp,pq,qhc->xhc", cross, inverse, excess)
    determinant = np.linalg.slogdet(2 * np.pi * variance)[1]
    log_likelihood = -0.5 * np.einsum("phc,pq,qhc->h", excess, inverse, excess) - determinant
    return mean, prior - cross @ inverse @ cross.T, log_likelihood


def across_fix(law: Any, correlations: Any, windage: Array, sight: Any, seen: Seen) -> float:
    """Return the covariance of the error that a report shows and a displacement."""
    both = correlations[int(sight.of_wind)][sight.place, seen.buoy]
    if sight.of_wind:
        pull = windage[seen.buoy] * law.wind_std**2
        return both * pull * float(integral(sight.time, seen.begin, seen.end, law.wind_time))
    changing = law.current_std**2 * float(
        integral(sight.time, seen.begin, seen.end, law.current_time)
    )
    return both * (changing + law.bias_std**2 * (seen.end - seen.begin))


def across_sights(law: Any, correlations: Any, one: Any, other: Any) -> float:
    """Return the covariance of the errors that two reports show."""
    if one.of_wind != other.of_wind:
        return 0.0
    both, lag = correlations[int(one.of_wind)][one.place, other.place], abs(one.time - other.time)
    if one.of_wind:
        return both * law.wind_std**2 * np.exp(-lag / law.wind_time)
    return both * (law.current_std**2 * np.exp(-lag / law.current_time) + law.bias_std**2)


def across_states(law: Any, correlations: Any, sight: Any, times: Array) -> Array:
    """Return the covariance of the states at times with what a report shows, (times, 3m)."""
    m = len(correlations[0])
    found, lag = np.zeros((len(times), 3 * m)), np.abs(times - sight.time)[:, None]
    both = correlations[int(sight.of_wind)][sight.place]
    if sight.of_wind:
        found[:, m : 2 * m] = law.wind_std * both * np.exp(-lag / law.wind_time)
    else:
        found[:, :m] = law.current_std * both * np.exp(-lag / law.current_time)
        found[:, 2 * m :] = law.bias_std * both
    return found
