"""Errors of a case's forcing, and the windage of what drifts, from the tracks of real drifters: `drift fit-errors`.

The parameters of `drift.drifters.error_law` are those under which the tracks are likeliest. Standard errors are of the parameters'
logarithms, from the curvature of the log likelihood. Of ten drifters or more the spread of the drifters' own pulls is looked
at as well (sandwich, clustered by drifter; White 1982, doi:10.2307/1912526), which holds where the law does not quite, but
is rough where drifters are few: the larger of both is printed. What the data do not tell is said so, with the most that it
may be.
"""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize, stats

from drift.case.record import Case
from drift.drifters import along, error_law, hold_out, reading
from drift.drifters import records as drifter_records
from drift.drifters.along import Ways
from drift.drifters.error_law import NAMES, Law, Tracks
from drift.drifters.hold_out import Held
from drift.drifters.records import Array, Track
from drift.job import in_turn
from geo.errors import UserError

Report = Callable[[str, float], None]

BOUNDS = {  # of each parameter, SI: far outside all that has been published
    "std": (1e-3, 5.0),
    "time": (300.0, 60 * 86_400.0),
    "bias": (1e-4, 3.0),
    "diffusivity": (1e-4, 1e4),
    "noise": (0.1, 2e4),
}
FEWEST = 12  # ways between fixes that a fit needs
ENOUGH = 10  # drifters from which on the spread between them is believed
VAGUE = 0.7  # standard error of a logarithm from which on a parameter counts as not told
STEP = 0.05  # of a logarithm, for second derivatives
SLOPE = 1e-5  # for first ones
LIMIT = 0.5 * float(stats.chi2.ppf(0.90, 1))  # of log likelihood below the best: 95 % on one side
ONE_WIND = "windage is not told: in a wind that is always the same, or none, it cannot be told from the mean error"
LAGS = np.array([1.0, 3.0, 6.0, 12.0, 24.0, 48.0])  # [h]


@dataclass(frozen=True)
class Parameter:
    """One parameter: its value, the standard error of its logarithm, and whether the data tell it.

    error: the one that is printed; curvature: from the curvature alone. limit: of one that is not told, what it is
    below with 95 % (of `time` none is given: NaN).
    """

    value: float
    error: float
    curvature: float
    told: bool
    limit: float = math.nan


@dataclass(frozen=True)
class Fit:
    """The errors that suit drifters, by component, and how well that is known."""

    law: Law
    parameters: Mapping[str, Parameter]
    windage: float  # of what drifts, share of the wind speed; NaN without a wind
    windage_error: float
    mean: tuple[float, float]  # [m/s] mean error of the model, east and north
    mean_error: tuple[float, float]
    clustered: bool  # whether errors are the larger of curvature and drifters, or from the curvature alone
    log: float
    names: tuple[str, ...]  # of the drifters
    increments: int
    correlation: Array  # (lags, 4): hours, correlation of the data, its standard error, of the law
    held: Held | None
    notes: tuple[str, ...]

    @property
    def standing_bias(self) -> float:
        """Bias [m/s] to state where the mean error is not taken out: both together, the mean's own error deducted."""
        square = (np.square(self.mean).sum() - np.square(self.mean_error).sum()) / 2
        return math.sqrt(self.law.bias**2 + max(float(square), 0.0))


@in_turn
def fit_errors(
    case: Case,
    files: str | os.PathLike[str] | Sequence[Track],
    *,
    columns: Mapping[str, str] | None = None,
    gap: float = drifter_records.GAP,
    fastest: float = drifter_records.FASTEST,
    held_out: bool = False,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    report: Report | None = None,
) -> Fit:
    """Return the errors of a case's forcing that suit the tracks of drifters, a file or tracks as read.

    columns: {"current_east": "u", ..}: the model's values at the drifter's places, from columns of its file. gap: longest
    time between fixes [s] over which they are compared. fastest: [m/s] beyond which a fix is not believed. held_out: fit
    half of the drifters, or of the days of one, and say how well that suits the others. Raises UserError.
    """
    tell = report or (lambda phase, share: None)
    tell("read", 0.0)
    wanted = dict(columns or {})
    tracks = read(files, wanted)
    if not isinstance(gap, int | float) or not gap > 0:
        raise UserError(f"--max-gap {gap!r} must be above 0 s")
    believed = drifter_records.believed(tracks, fastest)
    if not believed.tracks:
        raise UserError(f"--drifters: no track is left; {'; '.join(believed.notes)}")
    along.started(backend, threads)
    compared = along.compared(case, believed.tracks, wanted, gap, fastest, datasets)
    tell("fit", 0.0)
    return of(compared.ways, compared.wind, (*believed.notes, *compared.notes), held_out=held_out)


def read(files: str | os.PathLike[str] | Sequence[Track], columns: Mapping[str, str]) -> Sequence[Track]:
    """Return the tracks of a file with the columns that are wanted, or the tracks that are given."""
    if isinstance(files, str | os.PathLike):
        return reading.read(Path(files), list(dict.fromkeys(columns.values())))
    for track in files:
        if missing := [name for name in columns.values() if name not in track.columns]:
            raise UserError(f'drifter "{track.name}" has no column "{missing[0]}"')
    return files


def of(ways: Sequence[Ways], wind: bool, notes: Sequence[str] = (), *, held_out: bool = False) -> Fit:
    """Return the fit of ways."""
    tracks = along.residuals(ways, wind)
    if tracks.increments < FEWEST:
        raise UserError(
            f"--drifters: {tracks.increments} ways between fixes are too few to fit {len(NAMES)} parameters to; give {FEWEST} or more"
        )
    if wind and not _apart(tracks):
        return of(ways, False, (*notes, ONE_WIND), held_out=held_out)
    names = tuple(way.name for way in ways)
    free = [name for name in NAMES if name != "bias" or len(names) > 1]
    law, found = likeliest(tracks, free)
    errors, curvature, clustered = _errors(law, tracks, free)
    parameters = {}
    for name in NAMES:
        value = getattr(law, name)
        if name not in free:
            parameters[name] = Parameter(math.nan, math.nan, math.nan, told=False)
            continue
        told = errors[name] < VAGUE and value > 1.05 * BOUNDS[name][0] and value < BOUNDS[name][1] / 1.05
        limit = math.nan if told or name == "time" else _limit(law, tracks, free, name, found.log)
        parameters[name] = Parameter(value, errors[name], curvature[name], told, limit)
    mean_error = _mean_errors(found, clustered)
    held = None
    if held_out:
        halves = hold_out.split(ways)
        if min(along.residuals(half, wind).increments for half in (halves.fitted, halves.held)) < FEWEST:
            raise UserError(
                f"--hold-out: {halves.how} are fewer than {FEWEST} ways between fixes; leave it out, or give more"
            )
        half, _ = likeliest(
            along.residuals(halves.fitted, wind), [n for n in free if n != "bias" or len(halves.fitted) > 1]
        )
        best = error_law.likelihood(half, along.residuals(halves.fitted, wind))
        held = hold_out.tested(half, best, halves, wind)
    return Fit(
        law,
        parameters,
        float(found.mean[0]) if wind else math.nan,
        float(mean_error[0]) if wind else math.nan,
        (float(found.mean[-2]), float(found.mean[-1])),
        (float(mean_error[-2]), float(mean_error[-1])),
        clustered,
        found.log,
        names,
        tracks.increments,
        _correlation(law, found.mean, ways, wind),
        held,
        tuple(notes),
    )


def _apart(tracks: Tracks) -> bool:
    """Return whether windage and mean error can be told apart: in one and the same wind all the time they are one."""
    made = error_law.likelihood(_starts(tracks)[0], tracks)
    scale = np.sqrt(np.diag(made.covariance))
    if not (scale > 0).all():
        return False
    return bool(np.linalg.cond(made.covariance / np.outer(scale, scale)) < 1e6)


def likeliest(tracks: Tracks, free: Sequence[str], begin: Law | None = None, fixed: Mapping[str, float] | None = None) -> tuple[Law, error_law.Likelihood]:  # fmt: skip
    """Return the law under which tracks are likeliest, and the likelihood; what is neither free nor fixed is zero."""
    fixed = dict(fixed or {})
    asked = [name for name in free if name not in fixed]
    low, high = (np.log([BOUNDS[name][k] for name in asked]) for k in (0, 1))

    def law(point: Array) -> Law:
        values = dict.fromkeys(NAMES, 0.0) | dict(zip(asked, np.exp(point).tolist(), strict=True)) | fixed
        return Law(**values)

    def cost(point: Array) -> tuple[float, Array]:
        """Minus the log likelihood, and its slope by differences."""
        aside = [law(point), *(law(point + SLOPE * side) for side in np.eye(point.size))]
        here, *near = (-one.log for one in error_law.likelihoods(aside, tracks))
        return here, (np.array(near) - here) / SLOPE

    starts = [begin] if begin else _starts(tracks)
    points = [
        np.clip(np.log([max(getattr(start, name), BOUNDS[name][0] * 1.1) for name in asked]), low, high)
        for start in starts
    ]
    first = int(np.argmax([one.log for one in error_law.likelihoods([law(p) for p in points], tracks)]))
    best = optimize.minimize(
        cost, points[first], jac=True, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)),
        options={"ftol": 1e-9, "gtol": 1e-2, "maxiter": 200},
    )  # fmt: skip
    found = law(best.x)
    return found, error_law.likelihood(found, tracks)


def _starts(tracks: Tracks) -> list[Law]:
    """Return where the climb begins: errors as large as the data's, of long and of short memory."""
    within = tracks.there & ~tracks.fresh
    moved = np.diff(tracks.data, axis=1, prepend=0.0)[within]
    speed = max(float(np.median(np.abs(moved / tracks.step[within][:, None]))) * 1.5, 5e-3)
    return [
        Law(speed, hours * 3600.0, speed / 3, walk, noise)
        for hours in (3.0, 12.0, 48.0)
        for walk, noise in ((1.0, 10.0), (1.0, 200.0), (30.0, 30.0))
    ]


def _errors(law: Law, tracks: Tracks, free: Sequence[str]) -> tuple[dict[str, float], dict[str, float], bool]:
    """Return standard errors of the parameters' logarithms as printed and by curvature, and whether the first are clustered."""
    inside = [n for n in free if BOUNDS[n][0] * 1.05 < getattr(law, n) < BOUNDS[n][1] / 1.05]

    def moved(*steps: tuple[str, float]) -> Law:
        return replace(law, **{name: getattr(law, name) * math.exp(STEP * times) for name, times in steps})

    size = len(inside)
    pairs = [(i, j) for i in range(size) for j in range(i)]
    laws = [law, *(moved((name, 1.0)) for name in inside), *(moved((name, -1.0)) for name in inside)]
    laws += [moved((inside[i], side), (inside[j], side)) for side in (1.0, -1.0) for i, j in pairs]
    middle, *rest = error_law.likelihoods(laws, tracks)
    up, down, both = rest[:size], rest[size : 2 * size], rest[2 * size :]
    curve = np.diag([(a.log + b.log - 2 * middle.log) / STEP**2 for a, b in zip(up, down, strict=True)])
    for number, (i, j) in enumerate(pairs):
        corners = both[number].log + both[number + len(pairs)].log + 2 * middle.log
        cross = corners - up[i].log - down[i].log - up[j].log - down[j].log
        curve[i, j] = curve[j, i] = cross / (2 * STEP**2)
    value, vector = np.linalg.eigh(-curve)
    inverse = (vector / np.maximum(value, 1e-6)) @ vector.T  # a flat direction is an error beyond all bounds
    curvature = dict.fromkeys(free, math.inf) | dict(zip(inside, np.sqrt(np.diag(inverse)).tolist(), strict=True))
    drifters_ = tracks.step.shape[0]
    if drifters_ < ENOUGH:
        return curvature, curvature, False
    pulls = np.stack([(a.own - b.own) / (2 * STEP) for a, b in zip(up, down, strict=True)], axis=1)
    pulls = pulls - pulls.mean(axis=0)
    meat = pulls.T @ pulls * drifters_ / (drifters_ - 1)
    clustered = np.sqrt(np.diag(inverse @ meat @ inverse))
    larger = {name: max(curvature[name], float(error)) for name, error in zip(inside, clustered, strict=True)}
    return dict.fromkeys(free, math.inf) | larger, curvature, True


def _mean_errors(found: error_law.Likelihood, clustered: bool) -> Array:
    """Return standard errors of windage and mean error: by the law, or clustered by drifter where that is larger."""
    variance = np.diag(found.covariance)
    if clustered:
        count = len(found.pull)
        meat = found.pull.T @ found.pull * count / (count - 1)
        variance = np.maximum(variance, np.diag(found.covariance @ meat @ found.covariance))
    return np.asarray(np.sqrt(variance))


def _limit(law: Law, tracks: Tracks, free: Sequence[str], name: str, best: float) -> float:
    """Return what a parameter is below with 95 %, by its profile likelihood; inf where nothing speaks against the most."""
    low, high = math.log(max(getattr(law, name), BOUNDS[name][0])), math.log(BOUNDS[name][1])

    def fallen(point: float) -> float:
        _, there = likeliest(tracks, free, law, {name: math.exp(point)})
        return best - there.log - LIMIT

    reach = low
    while reach < high:
        reach = min(reach + 1.5, high)
        if fallen(reach) > 0:
            return math.exp(optimize.brentq(fallen, low, reach, xtol=0.1) if fallen(low) < 0 else low)
        low = reach
    return math.inf


def _correlation(law: Law, mean: Array, ways: Sequence[Ways], wind: bool) -> Array:
    """Return, by lag, the correlation of velocity errors an hour long or longer: of the data, its error, of the law.

    It is that of the whole error that is left: bias and Ornstein-Uhlenbeck velocity together, about the mean error.
    """
    rows = []
    pieces = [_velocities(way, mean, wind) for way in ways]
    spans = np.concatenate([piece[2] for piece in pieces])
    if not spans.size:
        return np.empty((0, 4))
    span = float(np.median(spans))
    own = float(error_law.spread(law, span)) / span**2
    variance = np.concatenate([(piece[1] ** 2).mean(axis=1) for piece in pieces]).mean()
    for lag in LAGS * 3600:
        if lag < 0.9 * span:
            continue
        products, weights = [], []
        for time, velocity, _ in pieces:
            later = np.searchsorted(time, time + 0.75 * lag), np.searchsorted(time, time + 1.25 * lag)
            sums = np.concatenate([np.zeros((1, 2)), np.cumsum(velocity, axis=0)])
            number = later[1] - later[0]
            products.append(float((velocity * (sums[later[1]] - sums[later[0]])).sum()) / 2)
            weights.append(float(number.sum()))
        count = np.array(weights)
        if count.sum() < 10:
            continue
        covariance = np.array(products).sum() / count.sum()
        left = np.array(products) - covariance * count
        many = int((count > 0).sum())
        error = math.sqrt((left**2).sum() * many / max(many - 1, 1)) / count.sum() if many > 1 else math.nan
        rows.append(
            [lag / 3600, covariance / variance, error / variance, float(error_law.correlation(law, lag, span)) / own]
        )
    return np.array(rows).reshape(-1, 4)


def _velocities(way: Ways, mean: Array, wind: bool) -> tuple[Array, Array, Array]:
    """Return middles [s], mean velocity errors (n, 2) [m/s] and spans [s] of pieces of about an hour or longer."""
    tracks = along.residuals([way], wind)
    beyond = tracks.data[0] - tracks.regressors[0] @ mean
    time, values, spans = [], [], []
    begin = 0
    for k in range(way.step.size):
        if way.fresh[k]:
            begin = k
        elif way.time[k] - way.time[begin] >= 3540.0:
            span = way.time[k] - way.time[begin]
            time.append((way.time[k] + way.time[begin]) / 2)
            values.append((beyond[k] - beyond[begin]) / span)
            spans.append(span)
            begin = k
    return np.array(time), np.array(values).reshape(-1, 2), np.array(spans)
