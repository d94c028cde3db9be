"""Errors of current and wind given drifting buoys and reports on scene: exact conditioning.

A component (east or north) of the error of the current at m places, those of the buoys and those of
the reports, is a vector U of standard Ornstein-Uhlenbeck processes with the case's decorrelation
time, whose innovations have the correlations C(t) between the places at that time: `correlation` of
their distances. Each process
alone is exactly that of the case, however the buoys move. The wind's errors W and the constant
biases V have correlations of the same kind, V those at the start. A buoy moves with the error of the
current, and with its windage times that of the wind:

    dX = (current_std U + bias_std V + windage wind_std W) dt + sqrt(2 diffusivity) dB,

where X is its displacement beyond that by the forcing at its own fixes, since its first fix, whose
error X contains. Each later fix is X plus an error of its own. A report at a fixed place is the error
there and then, current_std U + bias_std V or wind_std W, plus an error of its own: its best estimate
elsewhere is optimal interpolation (Gandin 1963; Bretherton, Davis and Fandry 1976,
doi:10.1016/0011-7471(76)90001-2). Given all of them, the states (U, W, V, X) are a Markov process whose transitions are found by a backward information filter (Anderson and
Moore 1979, "Optimal filtering", chapter 7): see `condition`. East and north are independent and have
the same transitions; only their means differ.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geo.array import Array

POWER = 1.5  # of the powered exponential correlation: docs/drifters.md
LEAD = (
    60.0  # [s] by which the errors are followed before the run, so that a fix may lie at its start
)


def correlation(distance: Array, length: float) -> Array:
    """Return the correlation of errors at a distance, exp(-(d / length)^POWER).

    Args:
        distance: between two places [m].
        length: [m].
    """
    return np.asarray(np.exp(-((np.asarray(distance) / length) ** POWER)))


@dataclass(frozen=True)
class Law:
    """The prior of the errors at buoys and reports; stds are of a component [m/s]."""

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
class Sight:
    """The error of current or wind that a report shows, at one place and time.

    Attributes:
        place: number of the place; those of the buoys are the first.
        time: [s after the run's start]; it may lie before the run or after it.
        of_wind: whether it is of the wind, not of the current.
        excess: velocity beyond the forcing, east and north [m/s], by hypothesis, (hypotheses, 2).
        error: standard deviation of each component [m/s].
    """

    place: int
    time: float
    of_wind: bool
    excess: Array
    error: float


@dataclass(frozen=True)
class Conditioned:
    """The states of the errors at buoys and reports, given these, by steps of the run.

    States are the standard processes of the current's errors, one a place, then those of the wind's
    (where a buoy feels it or a report is of it), the standard biases (where there are any), and the
    displacements X [m] of the buoys.

    Attributes:
        first: root of the covariance of the deviation from the mean at the first step's begin,
            (d, d).
        moves: transition of the deviation over each step, (steps, d, d).
        kicks: root of the covariance of what is added, (steps, d, d); 0 for the displacement of a
            buoy after its last fix, as nothing depends on it.
        means: mean of the states at each step's begin and at the last one's end,
            (steps + 1, hypotheses, d, 2).
        log_likelihood: of fixes and reports under each hypothesis, (hypotheses,).
    """

    first: Array
    moves: Array
    kicks: Array
    means: Array
    log_likelihood: Array


@dataclass(frozen=True)
class _Seen:
    """What is observed of the states: a sum of them plus an error."""

    parts: Array  # (d,) of each state in the sum
    value: Array  # (hypotheses, 2)
    variance: float  # of the error


@dataclass(frozen=True)
class _Link:
    """A time in which nothing is observed: z after it is forward z + a normal of covariance noise."""

    forward: Array  # (d, d)
    noise: Array
    seen: tuple[_Seen, ...]  # at its end
    step: int  # row of the step of which it is part; -1: before the first, steps: after the last


@dataclass(frozen=True)
class _States:
    """Which states there are: see `Conditioned`."""

    law: Law
    factors: tuple[Array, Array | None]  # see `condition`
    buoys: Sequence[Fixes]

    @property
    def places(self) -> int:
        """Number of places."""
        return int(self.factors[0].shape[1])

    @property
    def number(self) -> int:
        """Number of states."""
        return self.places * (1 + self.windy + self.law.biased) + len(self.buoys)

    @property
    def windy(self) -> bool:
        """Whether there are errors of the wind."""
        return self.factors[1] is not None

    @property
    def current(self) -> slice:
        """The current's errors."""
        return slice(0, self.places)

    @property
    def wind(self) -> slice:
        """The wind's errors."""
        return slice(self.places, 2 * self.places)

    @property
    def bias(self) -> slice:
        """The biases of the current."""
        first = self.places * (1 + self.windy)
        return slice(first, first + self.places)

    @property
    def moved(self) -> slice:
        """The displacements."""
        return slice(self.number - len(self.buoys), self.number)

    def blocks(self, step: int) -> list[tuple[slice, Array]]:
        """Return the states of the current's errors, of the wind's and of the biases, each with its
        correlations at a step.
        """
        found = [(self.current, _product(self.factors[0][step]))]
        if self.factors[1] is not None:
            found.append((self.wind, _product(self.factors[1][step])))
        if self.law.biased:
            found.append((self.bias, found[0][1]))
        return found

    def seen_by_fix(self, number: int, k: int) -> _Seen:
        """Return what fix k of a buoy shows: its displacement."""
        own = self.buoys[number]
        parts = np.zeros(self.number)
        parts[self.moved.start + number] = 1.0
        return _Seen(parts, own.excess[:, k], own.error**2)

    def seen_by_report(self, sight: Sight) -> _Seen:
        """Return what a report shows: the error at its place."""
        parts = parts_of_error(
            self.law, self.places, self.number, self.windy, sight.place, sight.of_wind
        )
        return _Seen(parts, sight.excess, sight.error**2)


def parts_of_error(
    law: Law, places: int, states: int, windy: bool, place: int, of_wind: bool
) -> Array:
    """Return the share of each state in the error of wind or current at a place [m/s], (states,).

    Args:
        law: the prior.
        places: number of places.
        states: number of states: see `Conditioned`.
        windy: whether there are errors of the wind.
        place: number of the place.
        of_wind: of the wind's error, not of the current's.
    """
    parts = np.zeros(states)
    if of_wind:
        parts[places + place] = law.wind_std
        return parts
    parts[place] = law.current_std
    if law.biased:
        parts[places * (1 + windy) + place] = law.bias_std
    return parts


def condition(
    law: Law,
    edges: Array,
    factors: tuple[Array, Array | None],
    buoys: Sequence[Fixes],
    sights: Sequence[Sight] = (),
) -> Conditioned:
    """Return the states of the errors at buoys and reports, given these, over the steps of a run.

    Args:
        law: the prior.
        edges: times of the steps [s after the run's start], ascending, (steps + 1,).
        factors: Cholesky factors of the correlations between the places in the middle of each step,
            of the current's and of the wind's errors, (steps, m, m) each; no wind: None.
        buoys: their fixes; those outside of the steps' time must have been left out.
        sights: what reports show, at any time.
    """
    states = _States(law, factors, buoys)
    links = _links(states, edges, sights)
    start = np.zeros((states.number, states.number))
    for block, correlated in states.blocks(0):
        start[block, block] = correlated
    many = len(buoys[0].excess) if buoys else len(sights[0].excess)
    first, moves, kicks, means = _smoothed(links, start, many, len(edges) - 1)
    for number, own in enumerate(buoys):
        state = states.moved.start + number
        kicks[edges[:-1] >= own.time.max(initial=edges[0]), state] = 0.0
    return Conditioned(first, moves, kicks, means, _log_likelihoods(links, start, many))


def _product(factor: Array) -> Array:
    return np.asarray(factor @ factor.T)


def _links(states: _States, edges: Array, sights: Sequence[Sight]) -> list[_Link]:
    """Return the times between which nothing is observed.

    They begin before the run and the first report: the prior is stationary, so it does not matter
    how long before.
    """
    fixed = {float(t) for own in states.buoys for t in own.time}
    reported = {sight.time for sight in sights}
    begin, end = min({float(edges[0]), *reported}) - LEAD, max({float(edges[-1]), *reported})
    bounds = [begin, *edges, end]
    links = []
    for step, (begin, end) in enumerate(itertools.pairwise(bounds), -1):
        inner = {t for t in fixed | reported if begin < t < end}
        times = [float(begin), *sorted(inner), float(end)]
        row = min(max(step, 0), len(edges) - 2)
        for low, high in itertools.pairwise(times):
            if low == high:  # nothing is reported after the run
                continue
            forward, noise = _transition(states, row, high - low)
            seen = [states.seen_by_report(sight) for sight in sights if sight.time == high]
            for number, own in enumerate(states.buoys):
                for k in np.flatnonzero(own.time == high):
                    if not own.fresh[k]:
                        seen.append(states.seen_by_fix(number, int(k)))
                        continue
                    state = states.moved.start + number
                    # X begins again, with the error of this fix
                    forward[state] = 0.0
                    noise[state], noise[:, state] = 0.0, 0.0
                    noise[state, state] = own.error**2
            links.append(_Link(forward, noise, tuple(seen), step))
    return links


def _transition(states: _States, step: int, dt: float) -> tuple[Array, Array]:
    """Return the transition of the states over dt [s] and the covariance of its noise.

    The integral of an Ornstein-Uhlenbeck process and its covariances are those of Gillespie 1996,
    doi:10.1103/PhysRevE.54.2084, eq. 2.9 to 2.14.
    """
    law, m, n = states.law, states.places, len(states.buoys)
    windage = np.array([own.windage for own in states.buoys])
    forward, noise = np.eye(states.number), np.zeros((states.number, states.number))
    moved, buoyed = states.moved, np.eye(m, n)  # the buoys are the first places
    speeds = [
        (law.current_time, np.full(n, law.current_std)),
        (law.wind_time, windage * law.wind_std),
    ]
    processes = states.blocks(step)[: 1 + states.windy]
    for (own, correlated), (time, speed) in zip(processes, speeds, strict=False):
        # 1 - exp(-dt / time) and its square, without loss of digits
        lost = -np.expm1(-dt / time)
        forward[own, own] = np.eye(m) * (1 - lost)
        forward[moved, own] = (buoyed * speed).T * time * lost
        noise[own, own] = correlated * -np.expm1(-2 * dt / time)
        # of X (rows) and the process
        across = correlated[:n] * speed[:, None] * time * lost**2
        noise[moved, own], noise[own, moved] = across, across.T
        spread = _integral_variance(dt / time) * time**2
        noise[moved, moved] += np.outer(speed, speed) * correlated[:n, :n] * spread
    if law.biased:
        forward[moved, states.bias] = buoyed.T * law.bias_std * dt
    noise[moved, moved] += 2 * law.diffusivity * dt * np.eye(n)
    return forward, noise


def _integral_variance(x: float) -> float:
    """Return the variance of the integral of a standard process over x decorrelation times, from a
    known value: 2 x - 3 + 4 exp(-x) - exp(-2 x); for small x its series.
    """
    if x < 0.03:
        return x**3 * (2 / 3 - x * (1 / 2 - x * (7 / 30 - x * (1 / 12 - x * 31 / 1260))))
    return float(2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x))


def _log_likelihoods(links: Sequence[_Link], start: Array, many: int) -> Array:
    """Return the log likelihood of all that is seen under each hypothesis, (many,): Kalman's filter.

    start: covariance of the states before all links, (d, d).
    """
    d = len(start)
    mean, cov, total = np.zeros((d, many, 2)), start.copy(), np.zeros(many)
    for link in links:
        mean = np.einsum("ij,jhc->ihc", link.forward, mean)
        cov = link.forward @ cov @ link.forward.T + link.noise
        for seen in link.seen:
            across = cov @ seen.parts
            variance = seen.parts @ across + seen.variance
            off = seen.value - np.einsum("i,ihc->hc", seen.parts, mean)
            total -= 0.5 * (off**2).sum(axis=1) / variance + np.log(2 * np.pi * variance)
            gain = across / variance
            mean = mean + gain[:, None, None] * off
            cov = cov - np.outer(gain, across)
    return total


def _smoothed(
    links: Sequence[_Link], start: Array, many: int, steps: int
) -> tuple[Array, Array, Array, Array]:
    """Return `first`, `moves`, `kicks` and `means` of `Conditioned`; start, many: as of
    `_log_likelihoods`.

    The information that later fixes hold of the states is carried backward in time; a transition
    given it has covariance (1 + Q I)^-1 Q and matrix (1 + Q I)^-1 F, where F and Q are the prior's
    transition and noise, and I the information at its end.
    """
    d = len(start)
    information, weighted = np.zeros((d, d)), np.zeros((d, many, 2))
    given = []
    for link in reversed(links):
        for seen in link.seen:
            information += np.outer(seen.parts, seen.parts) / seen.variance
            weighted += seen.parts[:, None, None] * seen.value / seen.variance
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
    moves, noises = np.tile(np.eye(d), (steps, 1, 1)), np.zeros((steps, d, d))
    for move, noise, pull, step in reversed(given):
        if step == steps:  # after the run
            break
        mean = np.einsum("ij,jhc->ihc", move, mean) + pull
        means[step + 1] = np.moveaxis(mean, 0, 1)
        if step < 0:  # before it
            first = move @ first @ move.T + noise
            continue
        moves[step] = move @ moves[step]
        noises[step] = move @ noises[step] @ move.T + noise
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
