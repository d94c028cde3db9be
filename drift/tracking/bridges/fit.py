"""Spread rate K of Brownian bridges from real tracks, by maximum likelihood: `drift fit-bridge`.

METHODS holds three likelihoods. The one by neighbours (Horne et al. 2007) measures the deviation
from the straight way between fixes at the tracks' own interval (or `every`). The two by whole
stretches (Pozdnyakov et al. 2014), with and without a mean velocity, include errors of the fixes.
Ships turn, so their K grows with the interval between fixes: fit it at the interval of your case.
The standard error comes from the curvature of the log likelihood (observed information). With ten
tracks or more it is also clustered by track (sandwich, White 1982, doi:10.2307/1912526), because
tracks differ; `spread_error` is the larger of both.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from drift.tracking.bridges import neighbours, stretches, together
from drift.tracking.bridges.neighbours import Triples
from drift.tracking.bridges.stretches import Rules, Stretch, counted
from drift.tracking.tracks import clusters
from drift.tracking.tracks.clusters import Estimate
from drift.tracking.tracks.records import Track
from geo import sphere
from geo.array import Array
from geo.errors import UserError

FEWEST = 4  # fewest comparisons (or steps) to which a K is fitted
ENOUGH = 10  # fewest tracks for a standard error clustered by track
STEP = 0.02  # step of a logarithm for derivatives; their relative error is about 1e-4
RANGE = 9.0  # largest log ratio of K, or the fixes' error, to its first guess
NOTHING = 1e-3  # share of the first guess below which K counts as 0
# [m/sqrt(s)] a centimetre in an hour: rounding of coordinates with seven decimals
ROUNDING = 1e-2 / 60
LARGEST = 2e7  # [m] largest error of a fix: half the Earth's circumference
FLAT = 1e-9  # share of a log likelihood below which its differences are rounding
SHARES = (0.5, 0.9)
DAY = 86_400.0


@dataclass(frozen=True)
class Method:
    """A likelihood: data, log likelihood by track, comparisons, first guess and description."""

    made: Callable[[Sequence[Stretch]], Any]
    log_likelihood: Callable[[Any, float, float], Array]
    count: Callable[[Any], int]
    guess: Callable[[Any], float]
    words: str


def _guess_triples(of: Triples) -> float:
    """Return a first guess of K [m/sqrt(s)]."""
    return math.sqrt(float((of.away**2 / of.unit).mean()))


def _count_steps(of: Sequence[together.Steps]) -> int:
    """Return the number of steps."""
    return sum(one.time.size for one in of)


def _count_beyond_mean(of: Sequence[together.Steps]) -> int:
    """Return the number of steps less one for each stretch's mean velocity."""
    return sum(one.time.size - 1 for one in of)


def _guess_steps(of: Sequence[together.Steps]) -> float:
    """Return a first guess of K [m/sqrt(s)]."""
    return math.sqrt(float(np.concatenate([one.moved**2 / one.time[:, None] for one in of]).mean()))


METHODS = {
    "neighbours": Method(
        neighbours.triples,
        neighbours.log_likelihood,
        lambda of: int(of.time.size),
        _guess_triples,
        "every second fix against the bridge between the fixes beside it (Horne et al. 2007)",
    ),
    "steady": Method(
        together.steps,
        together.steady,
        _count_beyond_mean,
        _guess_steps,
        "all steps together, with a mean velocity in each stretch (after Pozdnyakov et al. 2014)",
    ),
    "wandering": Method(
        together.steps,
        together.wandering,
        _count_steps,
        _guess_steps,
        "all steps together, without a mean velocity (Pozdnyakov et al. 2014)",
    ),
}


@dataclass(frozen=True)
class Coverage:
    """How often the area of a share contained fixes of tracks to which K was not fitted.

    first: fixes of the second half, with the K of the first; second: the other way round; both: all
    of them.
    """

    share: float
    first: Estimate
    second: Estimate
    both: Estimate


@dataclass(frozen=True)
class Half:
    """A fit to half of the tracks.

    K and its standard error [m/sqrt(s)], the number of comparisons or steps, and that of tracks.
    """

    spread_rate: float
    spread_error: float
    count: int
    tracks: int


@dataclass(frozen=True)
class Held:
    """Fits to each half of the tracks, and their coverage of the other half."""

    halves: tuple[Half, Half]
    coverage: tuple[Coverage, ...]


@dataclass(frozen=True)
class Fit:
    """A fitted spread rate and its uncertainty.

    spread_rate: K [m/sqrt(s)]. spread_error: its standard error, the larger of `curvature` and
    `clustered`, which is NaN for fewer than ENOUGH tracks. error: standard deviation of a fix in
    each component [m], given or fitted; error_error: its standard error, NaN if given. count:
    comparisons, steps, or steps less one in each stretch. hours: median interval [h] between fixes.
    """

    method: str
    rules: Rules
    spread_rate: float
    spread_error: float
    curvature: float
    clustered: float
    error: float
    error_error: float
    log: float
    count: int
    tracks: int
    stretches: int
    hours: float
    held: Held | None
    notes: tuple[str, ...]


def fit(
    tracks: Sequence[Track],
    *,
    method: str = "neighbours",
    error: float | None = 0.0,
    rules: Rules | None = None,
    held_out: bool = False,
) -> Fit:
    """Return the spread rate of highest likelihood.

    Args:
        tracks: of drift.case.tracking.reading.
        method: a name in METHODS.
        error: standard deviation of a fix in each component [m]; None: fitted as well.
        rules: which steps count.
        held_out: whether to fit every other track as well, in the order of first fixes, and report
            how its areas cover the rest.

    Raises:
        UserError: one line.
    """
    if method not in METHODS:
        raise UserError(f'--by "{method}" is not known; choose from {", ".join(METHODS)}')
    if error is not None and not 0 <= error <= LARGEST:
        raise UserError(f"--error {error!r} must be from 0 to {LARGEST:g} m")
    rules = rules or Rules()
    cut = stretches.cut_tracks(tracks, rules)
    best = _likeliest(METHODS[method], cut.stretches, error, "tracks")
    return Fit(
        method,
        rules,
        best.spread_rate,
        best.spread_error,
        best.curvature,
        best.clustered,
        best.error,
        best.error_error,
        best.log,
        best.count,
        len(_names(cut.stretches)),
        len(cut.stretches),
        float(np.median(np.concatenate([np.diff(stretch.time) for stretch in cut.stretches])))
        / 3600,
        _held_out(METHODS[method], cut.stretches, error) if held_out else None,
        cut.notes,
    )


@dataclass(frozen=True)
class _Best:
    """The fit of a method to some stretches."""

    spread_rate: float
    spread_error: float
    curvature: float
    clustered: float
    error: float
    error_error: float
    log: float
    count: int


def _names(of: Sequence[Stretch]) -> list[str]:
    """Return the names of the tracks, in the order of their first fixes."""
    return list(dict.fromkeys(stretch.name for stretch in of))


def _likeliest(method: Method, of: Sequence[Stretch], error: float | None, what: str) -> _Best:
    """Return the best fit; what: name of the stretches in error messages."""
    data = method.made(of)
    count = method.count(data)
    if count < FEWEST:
        raise UserError(
            f"{what}: {counted(count, 'comparison')} of a fix with those beside it: too few to fit a spread rate to; {FEWEST} or more "
            f"are needed, each of three consecutive fixes (there are {counted(sum(s.time.size for s in of), 'fix', 'fixes')} in "
            f"{counted(len(of), 'stretch', 'stretches')}); see --every, --max-gap, --min-speed"
        )
    guess = method.guess(data)
    straight = f"{what}: no track leaves the straight line between its fixes: there is no spread rate to fit"
    if guess < ROUNDING:
        raise UserError(straight)

    def own(point: Array) -> Array:
        """Return the log likelihood by track for logarithms of K and a fitted error."""
        spread, sd = math.exp(point[0]), math.exp(point[1]) if error is None else error
        return method.log_likelihood(data, spread, sd)

    point = _highest(lambda p: float(own(p).sum()), guess, _lengths(of), error)
    spread = math.exp(point[0])
    without_spread = point - np.array([RANGE + math.log(spread / guess), *[0.0] * (point.size - 1)])
    best, least = (float(own(p).sum()) for p in (point, without_spread))
    if spread < NOTHING * guess or not best - least > FLAT * max(abs(best), 1.0):
        if error == 0:
            raise UserError(straight)
        described = "that was fitted" if error is None else f"of {error:g} m (standard deviation)"
        raise UserError(
            f"{what}: the error of the fixes {described} explains all of their deviation: no spread rate remains; give a smaller "
            "--error, or take fixes farther apart (--every)"
        )
    free = [0, 1] if error is None and point[1] > math.log(NOTHING * _lengths(of)) else [0]
    inverse, scores = _derivatives(own, point, free)
    if not (np.diag(inverse) > 0).all():
        raise UserError(
            f"{what}: these fixes do not determine the spread rate, as their likelihood is flat; state --error, which is then not fitted, "
            "or give more tracks"
        )
    curvature = spread * math.sqrt(inverse[0, 0])
    clustered = math.nan
    if scores.shape[0] >= ENOUGH:
        centred = scores - scores.mean(axis=0)
        spread_of_scores = centred.T @ centred * scores.shape[0] / (scores.shape[0] - 1)
        clustered = spread * math.sqrt(float((inverse @ spread_of_scores @ inverse)[0, 0]))
    sd = math.exp(point[1]) if error is None else error
    sd_error = sd * math.sqrt(inverse[1, 1]) if len(free) > 1 else math.nan
    larger = max(curvature, clustered) if clustered == clustered else curvature
    return _Best(spread, larger, curvature, clustered, sd, sd_error, float(own(point).sum()), count)


def _lengths(of: Sequence[Stretch]) -> float:
    """Return the root mean square step [m], to which an error of fixes is compared."""
    steps = [
        sphere.distance(stretch.lon[:-1], stretch.lat[:-1], stretch.lon[1:], stretch.lat[1:])
        for stretch in of
    ]
    return max(float(np.sqrt((np.concatenate(steps) ** 2).mean())), 1.0)


def _highest(
    log: Callable[[Array], float], guess: float, length: float, error: float | None
) -> Array:
    """Return the logarithms of K, and of a fitted error, of highest likelihood."""
    centre = math.log(guess)
    if error is not None:
        found = optimize.minimize_scalar(
            lambda x: -log(np.array([x])),
            bounds=(centre - RANGE, centre + RANGE / 3),
            method="bounded",
            options={"xatol": 1e-9},
        )
        return np.array([found.x])
    bounds = [
        (centre - RANGE, centre + RANGE / 3),
        (math.log(length) - RANGE, math.log(length) + 1),
    ]
    runs = [
        optimize.minimize(
            lambda p: -log(p),
            np.array([centre - below, math.log(length) - less]),
            method="Nelder-Mead",
            bounds=bounds,
            options={"xatol": 1e-7, "fatol": 1e-9, "maxiter": 2000},
        )
        for below, less in ((0.3, 5.0), (1.0, 1.5))
    ]
    return np.asarray(min(runs, key=lambda run: float(run.fun)).x)


def _derivatives(
    own: Callable[[Array], Array], point: Array, free: Sequence[int]
) -> tuple[Array, Array]:
    """Return the inverse observed information, and scores by track (tracks, free).

    Both refer to logarithms of the parameters. The inverse is NaN if the likelihood is flat.
    """
    unit = STEP * np.eye(point.size)[list(free)]
    up, down = (np.stack([own(point + sign * step) for step in unit], -1) for sign in (1, -1))
    centre = own(point).sum()
    size = len(free)
    information = np.diag(-(up.sum(axis=0) + down.sum(axis=0) - 2 * centre) / STEP**2)
    if size > 1:
        corners = [
            own(point + a * unit[0] + b * unit[1]).sum() * a * b for a in (1, -1) for b in (1, -1)
        ]
        information[0, 1] = information[1, 0] = -sum(corners) / (4 * STEP**2)
    scores = (up - down) / (2 * STEP)
    try:
        return np.linalg.inv(information), scores
    except np.linalg.LinAlgError:  # flat to rounding
        return np.full((size, size), np.nan), scores


def _held_out(method: Method, of: Sequence[Stretch], error: float | None) -> Held:
    """Return the fits to each half of the tracks, and their coverage of the other half."""
    names = _names(of)
    parts = [[stretch for stretch in of if stretch.name in set(names[side::2])] for side in (0, 1)]
    if not parts[1]:
        raise UserError(
            "--hold-out: there is only one usable track, so none can be held out; remove --hold-out, or give more tracks"
        )
    halves, squares, tracks, days = [], [], [], []
    for side in (0, 1):
        best = _likeliest(
            method,
            parts[side],
            error,
            f"--hold-out, the {('first', 'second')[side]} half of the tracks",
        )
        halves.append(Half(best.spread_rate, best.spread_error, best.count, len(names[side::2])))
        others = neighbours.triples(parts[1 - side])
        if not others.time.size:
            raise UserError(
                "--hold-out: in one half no track has three consecutive fixes; remove --hold-out"
            )
        squares.append(_within(others, best.spread_rate, best.error))
        tracks.append(2 * others.name + side)
        days.append(others.time // DAY)
    pooled = [np.concatenate(parts) for parts in (squares, tracks, days)]
    coverage = []
    for share in SHARES:
        estimates = [
            clusters.mean(held <= share, track, day, share=True)
            for held, track, day in (*zip(squares, tracks, days, strict=True), pooled)
        ]
        coverage.append(Coverage(share, *estimates))
    return Held((halves[0], halves[1]), tuple(coverage))


def _within(of: Triples, spread_rate: float, error: float) -> Array:
    """Return the share that the ellipse through each inner fix contains, shape (m,).

    It is uniform on 0 to 1 if the model is correct.

    Args:
        of: inner fixes with their neighbours (m).
        spread_rate: K [m/sqrt(s)].
        error: standard deviation of a fix in each component [m].
    """
    variance = spread_rate**2 * of.unit + error**2 * of.error
    return np.asarray(-np.expm1(-0.5 * (of.away**2 / variance).sum(-1)))
