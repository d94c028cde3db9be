"""Errors of current and wind given the tracks of drifting buoys: exact Gaussian conditioning.

A component (east or north) of the error of the current is a Gaussian process with the
autocorrelation exp(-|t - s| / time) of the case's Ornstein-Uhlenbeck error and the correlation
`correlation(d, length)` over a distance d; the constant bias has the same correlation in space. At
m buoys the errors are L(t) u(t): u are m independent standard processes, and L(t) is the Cholesky
factor of the correlations between the buoys at that time. A buoy moves with the error of the
current, and with its windage times that of the wind:

    dX = (current_std L u + bias_std L v + windage wind_std L' w) dt + sqrt(2 diffusivity) dW,

where X is its displacement beyond that by the forcing at its own fixes, since its first fix, whose
error X contains. Each later fix is X plus an error of its own. Given all fixes, the states (u, w, v,
X) are a Markov process whose transitions are found by a backward information filter (Anderson and
Moore 1979, "Optimal filtering", chapter 7): see `condition`. East and north are independent and have
the same transitions; only their means differ.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

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
        kicks: root of the covariance of what is added, (steps, d, d).
        means: mean of the states at each step's begin and at the last one's end,
            (steps + 1, hypotheses, d, 2).
        log_likelihood: of the fixes under each hypothesis, (hypotheses,).
        reports: number of displacements that counted.
    """

    first: Array
    moves: Array
    kicks: Array
    means: Array
    log_likelihood: Array
    reports: int


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
    start = np.eye(d)
    start[d - m :, d - m :] = 0.0
    for number, own in enumerate(buoys):
        if own.time.size and own.fresh[0] and own.time[0] <= edges[0]:
            start[d - m + number, d - m + number] = own.error**2
    links = _links(law, edges, factors, buoys, d)
    _mean, _cov, log_likelihood = _filtered(links, buoys, start, d)
    return Conditioned(
        *_smoothed(links, buoys, start, len(edges) - 1),
        log_likelihood,
        sum(len(link.seen) for link in links),
    )


def _links(
    law: Law, edges: Array, factors: tuple[Array, Array | None], buoys: Sequence[Fixes], d: int
) -> list[_Link]:
    """Return the parts of the steps between which nothing is observed."""
    m = len(buoys)
    links = []
    for step, (begin, end) in enumerate(itertools.pairwise(edges)):
        inner = {float(t) for own in buoys for t in own.time if begin < t < end}
        generator, spread = _generator(
            law, factors[0][step], None if factors[1] is None else factors[1][step], buoys, d
        )
        times = [float(begin), *sorted(inner), float(end)]
        for low, high in itertools.pairwise(times):
            forward, noise = _exact(generator, spread, high - low)
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


def _generator(
    law: Law, factor: Array, wind_factor: Array | None, buoys: Sequence[Fixes], d: int
) -> tuple[Array, Array]:
    """Return the generator of the linear process of the states, and the covariance that its noise
    adds in a second.
    """
    m = len(buoys)
    generator, spread = np.zeros((d, d)), np.zeros((d, d))
    current, displaced = slice(0, m), slice(d - m, d)
    generator[current, current] = -np.eye(m) / law.current_time
    spread[current, current] = 2 * np.eye(m) / law.current_time
    generator[displaced, current] = law.current_std * factor
    if wind_factor is not None:
        wind = slice(m, 2 * m)
        windage = np.array([own.windage for own in buoys])
        generator[wind, wind] = -np.eye(m) / law.wind_time
        spread[wind, wind] = 2 * np.eye(m) / law.wind_time
        generator[displaced, wind] = windage[:, None] * law.wind_std * wind_factor
    if law.biased:
        generator[displaced, d - 2 * m : d - m] = law.bias_std * factor
    spread[displaced, displaced] = 2 * law.diffusivity * np.eye(m)
    return generator, spread


def _exact(generator: Array, spread: Array, dt: float) -> tuple[Array, Array]:
    """Return the transition of a linear process over dt [s] and the covariance of its noise.

    Van Loan 1978, doi:10.1109/TAC.1978.1101743.
    """
    d = len(generator)
    block = np.zeros((2 * d, 2 * d))
    block[:d, :d], block[:d, d:], block[d:, d:] = -generator, spread, generator.T
    grown = scipy.linalg.expm(block * dt)
    forward = grown[d:, d:].T
    noise = forward @ grown[:d, d:]
    return forward, (noise + noise.T) / 2


def _filtered(
    links: Sequence[_Link], buoys: Sequence[Fixes], start: Array, d: int
) -> tuple[Array, Array, Array]:
    """Return mean and covariance at the end, and the log likelihood of each hypothesis: Kalman's
    filter.
    """
    many, m = len(buoys[0].excess), len(buoys)
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
    return mean, cov, total


def _smoothed(
    links: Sequence[_Link], buoys: Sequence[Fixes], start: Array, steps: int
) -> tuple[Array, Array, Array, Array]:
    """Return `first`, `moves`, `kicks` and `means` of Conditioned.

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
