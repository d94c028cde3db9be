"""Errors of current and wind given the tracks of drifting buoys: exact Gaussian conditioning.

A component (east or north) of the error of the current at m buoys is a vector U of standard
Ornstein-Uhlenbeck processes with the case's decorrelation time, whose innovations have the
correlations C(t) between the buoys at that time: `correlation` of their distances. Each process
alone is exactly that of the case, however the buoys move. The wind's errors W and the constant
biases V have correlations of the same kind, V those at the start. A buoy moves with the error of the
current, and with its windage times that of the wind:

    dX = (current_std U + bias_std V + windage wind_std W) dt + sqrt(2 diffusivity) dB,

where X is its displacement beyond that by the forcing at its own fixes, since its first fix, whose
error X contains. Each later fix is X plus an error of its own. Given all fixes, the states (U, W, V,
X) are a Markov process whose transitions are found by a backward information filter (Anderson and
Moore 1979, "Optimal filtering", chapter 7): see `condition`. East and north are independent and have
the same transitions; only their means differ.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geo.array import Array

POWER = 1.5  # of the powered exponential correlation: docs/drifters.md


def correlation(distance: Array, length: float) -> Array:
    """Return the correlation of errors at a distance, exp(-(d / length)^POWER).

    Args:
        distance: between two places [m].
        length: [m].
    """
    return np.asarray(np.exp(-((np.asarray(distance) / length) ** POWER)))


@dataclass(frozen=True)
class Law:
    """The prior of the errors that buoys feel; stds are of a component [m/s]."""

    current_std: float
    current_time: float  # [s]
    current_length: float  # [m]
    bias_std: float
    wind_std: float
    wind_time: float
    wind_length: float
    diffusivity: float  # [m2/s]

    @property
    def biased(self) -> bool:
        """Whether the current has a constant bias."""
        return self.bias_std > 0


@dataclass(frozen=True)
class Fixes:
    """The fixes of one buoy, beside the displacements by the forcing.

    Attributes:
        time: [s after the run's start], ascending, (n,).
        fresh: whether a fix begins a stretch, (n,); displacements count from there.
        excess: displacement since the begin of the stretch beyond that by the forcing, east and
            north [m], by hypothesis (which scenario's forcing, which member), (hypotheses, n, 2).
        error: standard deviation of each component of a fix [m].
        windage: share of the wind that moves the buoy.
    """

    time: Array
    fresh: Array
    excess: Array
    error: float
    windage: float


@dataclass(frozen=True)
class Conditioned:
    """The states of the buoys' errors given their fixes, by steps of the run.

    States are the standard processes of the current's errors, one a buoy, then those of the wind's
    (where a buoy feels it), the standard biases (where there are any), and the displacements X [m].

    Attributes:
        first: root of the covariance of the deviation from the mean at the first step's begin,
            (d, d).
        moves: transition of the deviation over each step, (steps, d, d).
        kicks: root of the covariance of what is added, (steps, d, d); 0 for the displacement of a
            buoy after its last fix, as nothing depends on it.
        means: mean of the states at each step's begin and at the last one's end,
            (steps + 1, hypotheses, d, 2).
        log_likelihood: of the fixes under each hypothesis, (hypotheses,).
    """

    first: Array
    moves: Array
    kicks: Array
    means: Array
    log_likelihood: Array


@dataclass(frozen=True)
class _Link:
    """A part of a step between two fixes: z after it is forward z + a normal of covariance noise."""

    forward: Array  # (d, d)
    noise: Array
    seen: tuple[tuple[int, int], ...]  # buoy and number of the fixes at its end that are observed
    step: int  # row of the step of which it is part


def condition(
    law: Law, edges: Array, factors: tuple[Array, Array | None], buoys: Sequence[Fixes]
) -> Conditioned:
    """Return the states of the buoys' errors, given all fixes, over the steps of a run.

    Args:
        law: the prior.
        edges: times of the steps [s after the run's start], ascending, (steps + 1,).
        factors: Cholesky factors of the correlations between the buoys in the middle of each step,
            of the current's and of the wind's errors, (steps, m, m) each; no wind: None.
        buoys: their fixes; those outside of the steps' time must have been left out.
    """
    m, windy = len(buoys), factors[1] is not None
    d = m * (2 + windy + law.biased)
    start = np.zeros((d, d))
    for block, factor in _blocks(law, factors, m, 0):
        start[block, block] = factor @ factor.T
    for number, own in enumerate(buoys):
        if own.time.size and own.fresh[0] and own.time[0] <= edges[0]:
            start[d - m + number, d - m + number] = own.error**2
    links = _links(law, edges, factors, buoys, d)
    first, moves, kicks, means = _smoothed(links, buoys, start, len(edges) - 1)
    for number, own in enumerate(buoys):
        kicks[edges[:-1] >= own.time.max(initial=edges[0]), d - m + number] = 0.0
    return Conditioned(first, moves, kicks, means, _log_likelihoods(links, buoys, start))


def _links(
    law: Law, edges: Array, factors: tuple[Array, Array | None], buoys: Sequence[Fixes], d: int
) -> list[_Link]:
    """Return the parts of the steps between which nothing is observed."""
    m = len(buoys)
    links = []
    for step, (begin, end) in enumerate(itertools.pairwise(edges)):
        inner = {float(t) for own in buoys for t in own.time if begin < t < end}
        times = [float(begin), *sorted(inner), float(end)]
        for low, high in itertools.pairwise(times):
            forward, noise = _transition(law, factors, step, buoys, d, high - low)
            seen = []
            for number, own in enumerate(buoys):
                for k in np.flatnonzero(own.time == high):
                    if not own.fresh[k]:
                        seen.append((number, int(k)))
                        continue
                    state = d - m + number  # X begins again, with the error of this fix
                    forward[state] = 0.0
                    noise[state], noise[:, state] = 0.0, 0.0
                    noise[state, state] = own.error**2
            links.append(_Link(forward, noise, tuple(seen), step))
    return links


def _blocks(
    law: Law, factors: tuple[Array, Array | None], m: int, step: int
) -> list[tuple[slice, Array]]:
    """Return the states of the current's errors, of the wind's and of the biases, each with the
    Cholesky factor of its correlations at a step.
    """
    found = [(slice(0, m), factors[0][step])]
    if factors[1] is not None:
        found.append((slice(m, 2 * m), factors[1][step]))
    if law.biased:
        first = m * len(found)
        found.append((slice(first, first + m), factors[0][step]))
    return found


def _transition(
    law: Law,
    factors: tuple[Array, Array | None],
    step: int,
    buoys: Sequence[Fixes],
    d: int,
    dt: float,
) -> tuple[Array, Array]:
    """Return the transition of the states over dt [s] and the covariance of its noise.

    The integral of an Ornstein-Uhlenbeck process and its covariances are those of Gillespie 1996,
    doi:10.1103/PhysRevE.54.2084, eq. 2.9 to 2.14.
    """
    m = len(buoys)
    windage = np.array([own.windage for own in buoys])
    forward, noise = np.eye(d), np.zeros((d, d))
    moved = slice(d - m, d)
    processes = [(law.current_time, np.full(m, law.current_std), factors[0][step])]
    if factors[1] is not None:
        processes.append((law.wind_time, windage * law.wind_std, factors[1][step]))
    for number, (time, speed, factor) in enumerate(processes):
        own, correlated = slice(number * m, (number + 1) * m), factor @ factor.T
        # 1 - exp(-dt / time) and its square, without loss of digits
        lost = -np.expm1(-dt / time)
        forward[own, own] = np.eye(m) * (1 - lost)
        forward[moved, own] = np.diag(speed * time * lost)
        noise[own, own] = correlated * -np.expm1(-2 * dt / time)
        across = correlated * speed[:, None] * time * lost**2  # of X (rows) and the process
        noise[moved, own], noise[own, moved] = across, across.T
        spread = _integral_variance(dt / time) * time**2
        noise[moved, moved] += np.outer(speed, speed) * correlated * spread
    if law.biased:
        forward[moved, d - 2 * m : d - m] = np.eye(m) * law.bias_std * dt
    noise[moved, moved] += 2 * law.diffusivity * dt * np.eye(m)
    return forward, noise


def _integral_variance(x: float) -> float:
    """Return the variance of the integral of a standard process over x decorrelation times, from a
    known value: 2 x - 3 + 4 exp(-x) - exp(-2 x); for small x its series.
    """
    if x < 0.03:
        return x**3 * (2 / 3 - x * (1 / 2 - x * (7 / 30 - x * (1 / 12 - x * 31 / 1260))))
    return float(2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x))


def _log_likelihoods(links: Sequence[_Link], buoys: Sequence[Fixes], start: Array) -> Array:
    """Return the log likelihood of the fixes under each hypothesis, (hypotheses,): Kalman's filter.

    start: covariance of the states at the first step's begin, (d, d).
    """
    d, many, m = len(start), len(buoys[0].excess), len(buoys)
    mean, cov, total = np.zeros((d, many, 2)), start.copy(), np.zeros(many)
    for link in links:
        mean = np.einsum("ij,jhc->ihc", link.forward, mean)
        cov = link.forward @ cov @ link.forward.T + link.noise
        for number, k in link.seen:
            state, own = d - m + number, buoys[number]
            variance = cov[state, state] + own.error**2
            off = own.excess[:, k] - mean[state]
            total -= 0.5 * (off**2).sum(axis=1) / variance + np.log(2 * np.pi * variance)
            gain = cov[:, state] / variance
            mean = mean + gain[:, None, None] * off
            cov = cov - np.outer(gain, cov[state])
    return total


def _smoothed(
    links: Sequence[_Link], buoys: Sequence[Fixes], start: Array, steps: int
) -> tuple[Array, Array, Array, Array]:
    """Return `first`, `moves`, `kicks` and `means` of `Conditioned`; start: as of
    `_log_likelihoods`.

    The information that later fixes hold of the states is carried backward in time; a transition
    given it has covariance (1 + Q I)^-1 Q and matrix (1 + Q I)^-1 F, where F and Q are the prior's
    transition and noise, and I the information at its end.
    """
    d, many, m = len(start), len(buoys[0].excess), len(buoys)
    information, weighted = np.zeros((d, d)), np.zeros((d, many, 2))
    given = []
    for link in reversed(links):
        for number, k in link.seen:
            state, own = d - m + number, buoys[number]
            information[state, state] += own.error**-2
            weighted[state] += own.excess[:, k] / own.error**2
        shrunk = np.linalg.inv(np.eye(d) + link.noise @ information)
        move, noise = shrunk @ link.forward, shrunk @ link.noise
        pull = np.einsum("ij,jhc->ihc", noise, weighted)
        given.append((move, (noise + noise.T) / 2, pull, link.step))
        information = link.forward.T @ information @ move
        information = (information + information.T) / 2
        weighted = np.einsum("ji,jhc->ihc", move, weighted)
    first = np.linalg.solve(np.eye(d) + start @ information, start)
    mean = np.einsum("ij,jhc->ihc", first, weighted)
    means = np.empty((steps + 1, many, d, 2))
    means[0] = np.moveaxis(mean, 0, 1)
    moves, noises = np.tile(np.eye(d), (steps, 1, 1)), np.zeros((steps, d, d))
    for move, noise, pull, step in reversed(given):
        moves[step] = move @ moves[step]
        noises[step] = move @ noises[step] @ move.T + noise
        mean = np.einsum("ij,jhc->ihc", move, mean) + pull
        means[step + 1] = np.moveaxis(mean, 0, 1)
    return root((first + first.T) / 2), moves, np.stack([root(noise) for noise in noises]), means


def root(covariance: Array) -> Array:
    """Return the lower triangular root of a covariance that may be singular, (d, d).

    A state without variance of its own, given those before it, has a column of zeros.
    """
    d = len(covariance)
    found = np.zeros((d, d))
    for k in range(d):
        left = covariance[k, k] - found[k, :k] @ found[k, :k]
        if left <= 1e-13 * max(covariance[k, k], 1e-300):
            continue
        found[k, k] = np.sqrt(left)
        found[k + 1 :, k] = (covariance[k + 1 :, k] - found[k + 1 :, :k] @ found[k, :k]) / found[
            k, k
        ]
    return found
