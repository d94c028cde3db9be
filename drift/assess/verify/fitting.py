"""Estimate forcing errors and windage from drifters' tracks: `drift fit-errors`.

The parameters of `drift.assess.verify.error_law` are estimated by maximum likelihood. Standard
errors are of the parameters' logarithms, from the curvature of the log likelihood. With ten
drifters or more there is also the sandwich estimate, from the spread of the drifters' own scores
(clustered by drifter; White 1982, doi:10.2307/1912526). It holds even if the law is only
approximate, but is inaccurate for few drifters; the larger of the two is printed. A parameter that
the data do not determine is marked, with an upper limit.
"""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize, stats

from drift.assess.verify import along, error_law, exposed, hold_out, starts
from drift.assess.verify.along import Displacements
from drift.assess.verify.error_law import NAMES, Law, Tracks
from drift.assess.verify.hold_out import HoldOut
from drift.case.record import Case
from drift.case.tracking import reading
from drift.pipeline.run_options import serialized
from drift.tracking.tracks import records as drifter_records
from drift.tracking.tracks.records import Track
from geo.array import Array
from geo.errors import UserError
from kernels.runtime import runtime

Report = Callable[[str, float], None]

# smallest and largest value of each parameter, SI: far outside the published range
BOUNDS = {
    "std": (1e-3, 5.0),
    "time": (300.0, 60 * 86_400.0),
    "bias": (1e-4, 3.0),
    "diffusivity": (1e-4, 1e4),
    "noise": (0.1, 2e4),
}
FEWEST = 12  # fewest displacements between fixes for a fit
ENOUGH = 10  # fewest drifters for clustered standard errors
# standard error of a parameter's logarithm from which it counts as not identified
VAGUE = 0.7
STEP = 0.05  # step of a logarithm for second derivatives
SLOPE = 1e-5  # step of a logarithm for first derivatives
# log likelihood below the best at a one-sided limit of 95 %
LIMIT = 0.5 * float(stats.chi2.ppf(0.90, 1))
ONE_WIND = (
    "windage is not determined: in a wind that is always the same, or none, it cannot be "
    "distinguished from the mean error"
)
LAGS = np.array([1.0, 3.0, 6.0, 12.0, 24.0, 48.0])  # [h]


@dataclass(frozen=True)
class Parameter:
    """One parameter: its value, the standard error of its logarithm, whether the data determine it.

    error: the standard error that is printed; curvature: from the curvature alone. limit: upper
    limit (95 %) of a parameter that is not identified; NaN for `time`, which has none.
    """

    value: float
    error: float
    curvature: float
    identified: bool
    limit: float = math.nan


@dataclass(frozen=True)
class Fit:
    """The fitted forcing errors, and how well they are determined."""

    law: Law
    parameters: Mapping[str, Parameter]
    windage: float  # of the drifters, as a share of the wind speed; NaN without a wind
    windage_error: float
    mean: tuple[float, float]  # [m/s] mean error of the model, east and north
    mean_error: tuple[float, float]
    # whether standard errors include the spread between drifters, not only the curvature
    clustered: bool
    log: float
    names: tuple[str, ...]  # of the drifters
    increments: int
    # (lags, 4): hours, correlation of the data, its standard error, correlation of the law
    correlation: Array
    held: HoldOut | None
    notes: tuple[str, ...]

    @property
    def standing_bias(self) -> float:
        """Bias [m/s] to state in a case that does not correct the model's mean error.

        Its square is that of the fitted bias plus that of the mean error, minus the latter's
        variance.
        """
        square = (np.square(self.mean).sum() - np.square(self.mean_error).sum()) / 2
        return math.sqrt(self.law.bias**2 + max(float(square), 0.0))


@serialized
def fit_errors(
    case: Case,
    files: str | os.PathLike[str] | Sequence[Track],
    *,
    columns: Mapping[str, str] | None = None,
    gap: float = drifter_records.GAP,
    fastest: float = drifter_records.FASTEST,
    ends_aground: bool = False,
    held_out: bool = False,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    report: Report | None = None,
) -> Fit:
    """Estimate the errors of a case's forcing from the tracks of drifters.

    Args:
        case: whose forcing is compared with the drifters.
        files: a file of tracks (CSV or netCDF), or tracks.
        columns: columns of the file with the model's values at the drifter's positions,
            {"current_east": "u", ..} [m/s]; these values are used everywhere around the drifter.
        gap: longest time between fixes [s] over which displacements are compared.
        fastest: speed [m/s] beyond which a fix is rejected.
        ends_aground: whether a drifter whose track ends near the shore ran aground there.
        held_out: whether also to fit half of the drifters, or half of the days of a single one, and
            test that fit on the other half.
        datasets: xarray.Datasets of sources with `dataset = "name"`, by that name; they are only
            read, and not kept.
        threads: threads of the CPU; None, or more than there are: all. The number of threads does
            not change a bit of the results.
        backend: where particles move: "cpu", "cuda", "vulkan", "metal", or "auto" for a graphics
            card if the run is large enough. A process keeps the backend and the threads that it started
            with.
        report: callback that takes the current phase ("read", "drift", "map", "write" ..) and the
            share of it that is done, 0 to 1; `drift.progress` makes one. An exception that it
            raises ends the run.

    Returns:
        Windage, standard deviation [m/s], decorrelation time [s], bias [m/s] and diffusivity
        [m2/s], with standard errors, and the `[uncertainty]` to paste into a case.

    Raises:
        UserError: no track is left, or there are too few displacements for a fit.
    """
    tell = report or (lambda phase, share: None)
    tell("read", 0.0)
    names = dict(columns or {})
    along.check_case(case, names)
    tracks = read_tracks(files, names)
    if not isinstance(gap, int | float) or not gap > 0:
        raise UserError(f"--max-gap {gap!r} must be above 0 s")
    checked = drifter_records.believed(tracks, fastest)
    if not checked.tracks:
        raise UserError(f"--drifters: no track is left; {'; '.join(checked.notes)}")
    usable = exposed.exposed_tracks(
        starts.mark_stranded(checked, case.coast, ends_aground), case.coast, gap
    )
    notes = (*checked.notes, *usable.notes)
    if not usable.tracks:
        raise UserError(f"--drifters: no track is left; {'; '.join(notes)}")
    runtime.start(backend, threads, sum(track.time.size for track in usable.tracks))
    comparison = along.compare_displacements(case, usable.tracks, names, gap, fastest, datasets)
    tell("fit", 0.0)
    return fitted_errors(
        comparison.ways, comparison.wind, (*notes, *comparison.notes), held_out=held_out
    )


def read_tracks(
    files: str | os.PathLike[str] | Sequence[Track], columns: Mapping[str, str]
) -> Sequence[Track]:
    """Return the tracks of a file with the requested columns, or the given tracks."""
    if isinstance(files, str | os.PathLike):
        return reading.read_drifters(Path(files), list(dict.fromkeys(columns.values())))
    for track in files:
        if missing := [name for name in columns.values() if name not in track.columns]:
            raise UserError(f'drifter "{track.name}" has no column "{missing[0]}"')
    return files


def fitted_errors(
    ways: Sequence[Displacements], wind: bool, notes: Sequence[str] = (), *, held_out: bool = False
) -> Fit:
    """Fit the error law to displacements; with `wind` windage too; held_out: as in `fit_errors`."""
    tracks = along.residuals(ways, wind)
    if tracks.increments < FEWEST:
        reasons = f" ({'; '.join(notes)})" if notes else ""
        raise UserError(
            f"--drifters: {tracks.increments} displacements between fixes are too few to fit "
            f"{len(NAMES)} parameters; give {FEWEST} or more{reasons}"
        )
    if wind and not _wind_varies(tracks):
        return fitted_errors(ways, False, (*notes, ONE_WIND), held_out=held_out)
    free = _free(ways)
    law, best = fit_law(tracks, free)
    parameters, clustered = _parameters(law, tracks, free, best.log)
    mean_error = _mean_errors(best, clustered)
    held = _held_out(ways, wind) if held_out else None
    return Fit(
        law,
        parameters,
        float(best.mean[0]) if wind else math.nan,
        float(mean_error[0]) if wind else math.nan,
        (float(best.mean[-2]), float(best.mean[-1])),
        (float(mean_error[-2]), float(mean_error[-1])),
        clustered,
        best.log,
        tuple(way.name for way in ways),
        tracks.increments,
        _correlation(law, best.mean, ways, wind),
        held,
        tuple(notes),
    )


def _free(ways: Sequence[Displacements]) -> list[str]:
    """Return the names of the parameters to fit; one drifter does not determine its bias.

    Its bias cannot be separated from the mean error.
    """
    return [name for name in NAMES if name != "bias" or len(ways) > 1]


def _parameters(
    law: Law, tracks: Tracks, free: Sequence[str], best: float
) -> tuple[dict[str, Parameter], bool]:
    """Return the parameters of the most likely law, and whether their errors are clustered.

    best: the law's log likelihood.
    """
    errors, curvature, clustered = _errors(law, tracks, free)
    parameters = dict.fromkeys(NAMES, Parameter(math.nan, math.nan, math.nan, identified=False))
    for name in free:
        value = getattr(law, name)
        identified = (
            errors[name] < VAGUE
            and value > 1.05 * BOUNDS[name][0]
            and value < BOUNDS[name][1] / 1.05
        )
        limit = math.nan if identified or name == "time" else _limit(law, tracks, free, name, best)
        parameters[name] = Parameter(value, errors[name], curvature[name], identified, limit)
    return parameters, clustered


def _held_out(ways: Sequence[Displacements], wind: bool) -> HoldOut:
    """Return how well a law fitted to one half of the displacements suits the other.

    Raises UserError if a half is too small.
    """
    halves = hold_out.split_halves(ways)
    if (
        min(along.residuals(half, wind).increments for half in (halves.fitted, halves.held))
        < FEWEST
    ):
        raise UserError(
            f"--hold-out: {halves.how} have fewer than {FEWEST} displacements between fixes; omit "
            "--hold-out, or give more tracks"
        )
    law, best = fit_law(along.residuals(halves.fitted, wind), _free(halves.fitted))
    return hold_out.score_hold_out(law, best, halves, wind)


def _wind_varies(tracks: Tracks) -> bool:
    """Return whether windage and mean error can be separated; in a constant wind they cannot."""
    likelihood = error_law.likelihood(_starts(tracks)[0], tracks)
    scale = np.sqrt(np.diag(likelihood.covariance))
    if not (scale > 0).all():
        return False
    return bool(np.linalg.cond(likelihood.covariance / np.outer(scale, scale)) < 1e6)


def fit_law(
    tracks: Tracks,
    free: Sequence[str],
    begin: Law | None = None,
    fixed: Mapping[str, float] | None = None,
) -> tuple[Law, error_law.Likelihood]:
    """Return the law with the largest likelihood of the tracks, and its likelihood.

    Parameters that are neither free nor fixed are zero.

    Args:
        tracks: residuals of the drifters.
        free: names of the parameters to fit.
        begin: starting point of the search; None: the best of several.
        fixed: values of parameters that are not fitted, by name.

    Returns:
        The law and its likelihood.
    """
    fixed = dict(fixed or {})
    fitted = [name for name in free if name not in fixed]
    low, high = (np.log([BOUNDS[name][k] for name in fitted]) for k in (0, 1))

    def law(point: Array) -> Law:
        values = (
            dict.fromkeys(NAMES, 0.0)
            | dict(zip(fitted, np.exp(point).tolist(), strict=True))
            | fixed
        )
        return Law(**values)

    def cost(point: Array) -> tuple[float, Array]:
        """Return minus the log likelihood, and its gradient by finite differences."""
        laws = [law(point), *(law(point + SLOPE * side) for side in np.eye(point.size))]
        value, *neighbours = (-candidate.log for candidate in error_law.likelihoods(laws, tracks))
        return value, (np.array(neighbours) - value) / SLOPE

    starts = [begin] if begin else _starts(tracks)
    points = [
        np.clip(
            np.log([max(getattr(start, name), BOUNDS[name][0] * 1.1) for name in fitted]), low, high
        )
        for start in starts
    ]
    first = int(
        np.argmax(
            [candidate.log for candidate in error_law.likelihoods([law(p) for p in points], tracks)]
        )
    )
    best = optimize.minimize(
        cost,
        points[first],
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        options={"ftol": 1e-9, "gtol": 1e-2, "maxiter": 200},
    )
    law_found = law(best.x)
    return law_found, error_law.likelihood(law_found, tracks)


def _starts(tracks: Tracks) -> list[Law]:
    """Return starting points of the search: errors as large as the data's, several time scales."""
    within = tracks.there & ~tracks.fresh
    moved = np.diff(tracks.data, axis=1, prepend=0.0)[within]
    speed = max(float(np.median(np.abs(moved / tracks.step[within][:, None]))) * 1.5, 5e-3)
    return [
        Law(speed, hours * 3600.0, speed / 3, walk, noise)
        for hours in (3.0, 12.0, 48.0)
        for walk, noise in ((1.0, 10.0), (1.0, 200.0), (30.0, 30.0))
    ]


def _errors(
    law: Law, tracks: Tracks, free: Sequence[str]
) -> tuple[dict[str, float], dict[str, float], bool]:
    """Return standard errors of the parameters' logarithms: as printed, and from the curvature.

    The third value is whether the printed ones are clustered by drifter. They are if there are
    ENOUGH drifters, and are then the larger of the two.
    """
    inside = [n for n in free if BOUNDS[n][0] * 1.05 < getattr(law, n) < BOUNDS[n][1] / 1.05]

    def moved(*steps: tuple[str, float]) -> Law:
        return replace(
            law, **{name: getattr(law, name) * math.exp(STEP * times) for name, times in steps}
        )

    size = len(inside)
    pairs = [(i, j) for i in range(size) for j in range(i)]
    laws = [
        law,
        *(moved((name, 1.0)) for name in inside),
        *(moved((name, -1.0)) for name in inside),
    ]
    laws += [moved((inside[i], side), (inside[j], side)) for side in (1.0, -1.0) for i, j in pairs]
    centre, *others = error_law.likelihoods(laws, tracks)
    up, down, paired = others[:size], others[size : 2 * size], others[2 * size :]
    curve = np.diag(
        [(a.log + b.log - 2 * centre.log) / STEP**2 for a, b in zip(up, down, strict=True)]
    )
    for number, (i, j) in enumerate(pairs):
        corners = paired[number].log + paired[number + len(pairs)].log + 2 * centre.log
        cross = corners - up[i].log - down[i].log - up[j].log - down[j].log
        curve[i, j] = curve[j, i] = cross / (2 * STEP**2)
    value, vector = np.linalg.eigh(-curve)
    inverse = (vector / np.maximum(value, 1e-6)) @ vector.T  # a flat direction gets a huge error
    curvature = dict.fromkeys(free, math.inf) | dict(
        zip(inside, np.sqrt(np.diag(inverse)).tolist(), strict=True)
    )
    drifters = tracks.step.shape[0]
    if drifters < ENOUGH:
        return curvature, curvature, False
    scores = np.stack([(a.own - b.own) / (2 * STEP) for a, b in zip(up, down, strict=True)], axis=1)
    scores = scores - scores.mean(axis=0)
    score_covariance = scores.T @ scores * drifters / (drifters - 1)
    clustered = np.sqrt(np.diag(inverse @ score_covariance @ inverse))
    larger = {
        name: max(curvature[name], float(error))
        for name, error in zip(inside, clustered, strict=True)
    }
    return dict.fromkeys(free, math.inf) | larger, curvature, True


def _mean_errors(best: error_law.Likelihood, clustered: bool) -> Array:
    """Return standard errors of windage and mean error.

    They follow from the law, or are clustered by drifter where that is larger.
    """
    variance = np.diag(best.covariance)
    if clustered:
        count = len(best.score)
        score_covariance = best.score.T @ best.score * count / (count - 1)
        variance = np.maximum(
            variance, np.diag(best.covariance @ score_covariance @ best.covariance)
        )
    return np.asarray(np.sqrt(variance))


def _limit(law: Law, tracks: Tracks, free: Sequence[str], name: str, best: float) -> float:
    """Return the upper limit (95 %) of a parameter by its profile likelihood.

    It is inf if the data allow the largest value of BOUNDS.
    """
    low, high = math.log(max(getattr(law, name), BOUNDS[name][0])), math.log(BOUNDS[name][1])

    def drop(candidate: float) -> float:
        _, profile = fit_law(tracks, free, law, {name: math.exp(candidate)})
        return best - profile.log - LIMIT

    point = low
    while point < high:
        point = min(point + 1.5, high)
        if drop(point) > 0:
            return math.exp(optimize.brentq(drop, low, point, xtol=0.1) if drop(low) < 0 else low)
        low = point
    return math.inf


def _correlation(law: Law, mean: Array, ways: Sequence[Displacements], wind: bool) -> Array:
    """Return the autocorrelation of velocity errors by lag, (lags, 4).

    The columns are hours, correlation of the data, its standard error, correlation of the law.
    Velocity errors are means over about an hour or longer. They are the sum of bias and
    Ornstein-Uhlenbeck velocity, without the mean error.
    """
    rows = []
    velocities = [_velocities(way, mean, wind) for way in ways]
    spans = np.concatenate([piece[2] for piece in velocities])
    if not spans.size:
        return np.empty((0, 4))
    span = float(np.median(spans))
    law_variance = float(error_law.error_variance(law, span)) / span**2
    variance = np.concatenate([(piece[1] ** 2).mean(axis=1) for piece in velocities]).mean()
    for lag in LAGS * 3600:
        if lag < 0.9 * span:
            continue
        products, weights = [], []
        for time, velocity, _ in velocities:
            window = (
                np.searchsorted(time, time + 0.75 * lag),
                np.searchsorted(time, time + 1.25 * lag),
            )
            sums = np.concatenate([np.zeros((1, 2)), np.cumsum(velocity, axis=0)])
            count_at = window[1] - window[0]
            products.append(float((velocity * (sums[window[1]] - sums[window[0]])).sum()) / 2)
            weights.append(float(count_at.sum()))
        count = np.array(weights)
        if count.sum() < 10:
            continue
        covariance = np.array(products).sum() / count.sum()
        residual = np.array(products) - covariance * count
        drifters = int((count > 0).sum())
        error = (
            math.sqrt((residual**2).sum() * drifters / max(drifters - 1, 1)) / count.sum()
            if drifters > 1
            else math.nan
        )
        rows.append(
            [
                lag / 3600,
                covariance / variance,
                error / variance,
                float(error_law.correlation(law, lag, span)) / law_variance,
            ]
        )
    return np.array(rows).reshape(-1, 4)


def _velocities(way: Displacements, mean: Array, wind: bool) -> tuple[Array, Array, Array]:
    """Return midpoints [s], mean velocity errors (n, 2) [m/s] and durations [s] of pieces.

    The pieces of the track last about an hour or longer.
    """
    tracks = along.residuals([way], wind)
    excess = tracks.data[0] - tracks.regressors[0] @ mean
    time, values, spans = [], [], []
    begin = 0
    for k in range(way.step.size):
        if way.fresh[k]:
            begin = k
        elif way.time[k] - way.time[begin] >= 3540.0:
            span = way.time[k] - way.time[begin]
            time.append((way.time[k] + way.time[begin]) / 2)
            values.append((excess[k] - excess[begin]) / span)
            spans.append(span)
            begin = k
    return np.array(time), np.array(values).reshape(-1, 2), np.array(spans)
