"""Verify forecasts against real drifters: `drift verify`.

Each drifter is forecast many times from positions along its track, with the case's forcing, errors
and object. The forecasts are compared with its later positions: distances, the share of positions
that the areas held, ranks. A drifter that runs aground is scored where it lies, among particles of
which some have come ashore too (drift.assess.verify.starts). Forecasts of one drifter, or of one
day, are not independent: standard errors are clustered by both.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from drift.assess.verify import along, fitting, scores, starts
from drift.assess.verify.starts import Start, Stranded
from drift.case import file as case_file
from drift.case.forcing import uncertainty
from drift.case.record import Case
from drift.engine.motion.errors.forcing_error import NOWHERE, ForcingError
from drift.engine.particles.status import Status, on_map
from drift.pipeline import many
from drift.pipeline.run_options import JobOptions, Options, serialized
from drift.products.files import writer
from drift.tracking.tracks import clusters
from drift.tracking.tracks import records as drifter_records
from drift.tracking.tracks.clusters import Estimate
from drift.tracking.tracks.records import Track
from geo import sphere
from geo.array import Array
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES, velocities
from kernels.maths import noise
from kernels.maths.noise import Purpose

Report = Callable[[str, float], None]

EVERY, HOURS = 12 * 3600.0, 24 * 3600.0  # [s] from start to start, and length of a forecast
ERROR = 100.0  # [m] radius that holds half of the fixes' errors
PARTICLES = 4000
# [s] between the times of distances; a drifter moves much more in this time than the error of a fix
POINT = 3 * 3600.0
LEADS = (6, 12, 24, 48, 72, 96, 120)  # [h] at which areas are scored, besides the end
# share of the area that the headline judges, even if the case states other areas
HEADLINE = 0.9
BINS = 10  # of a histogram of ranks
DAY = 86_400.0


@dataclass(frozen=True, repr=False)
class Verification:
    """Scores of n forecasts of drifters at m times.

    Areas and ranks are scored at those of the times that are `leads`. hours: (m,) after the start.
    apart, waiting, way, spread: (n, m) [m]: distance of the drifter from the mean position, and
    from the start (persistence); path length of the drifter since the start; root mean square of
    the particles' distances from their mean. aground: (n, m) whether the drifter is aground;
    ashore: (n, m) share of the mapped probability that is ashore. containment, along, across: (n,
    leads) ranks of the drifter, 0 to 1. energy: (n, leads) energy score [m]; log: (n, leads)
    logarithm of the density [1/km2] at the drifter. skill, unclipped, staying: (n,) skill of the
    mean position, clipped at 0 and not, and the unclipped skill of an object that does not move.
    """

    case: Case
    drifter: Array  # (n,) index in names
    names: tuple[str, ...]
    start: Array  # (n,) [s since 1970]
    block: Array  # (n,) number of the day, or of the block of days as long as a forecast
    hours: Array
    lon: Array  # (n, m) [deg] of the drifter
    lat: Array
    apart: Array
    waiting: Array
    way: Array
    spread: Array
    aground: Array
    ashore: Array
    leads: Array  # [h]
    containment: Array
    along: Array
    across: Array
    energy: Array
    log: Array
    skill: Array
    unclipped: Array
    staying: Array
    lost: Array  # (n,) share of the probability that is not mapped at the end
    error: float  # [m] of the starts
    notes: tuple[str, ...]
    left_out: Mapping[str, int]  # number of starts that were left out, by reason

    def __repr__(self) -> str:
        """Return the title and the figures, as the terminal shows them."""
        from drift.assess.verify import text  # imported here because it imports this module

        facts = text.verification_facts(self)
        lines = [f"  {name}: {words}" for name, words in facts.items()]
        return "\n".join([f'<drift.Verification "{self.case.title}"', *lines]) + ">"

    @property
    def shares(self) -> tuple[float, ...]:
        """Shares of the areas that are judged: those of the case, and the headline's."""
        return tuple(sorted({*self.case.areas, HEADLINE}))

    def mean(self, values: Array, *, share: bool = False) -> Estimate:
        """Return the mean of values by forecast, (n,), with its clustered standard error."""
        return clusters.mean(values, self.drifter, self.block, share=share)

    def held(self, lead: int, share: float) -> Estimate:
        """Return how often the area of a share held the drifter at a lead (index)."""
        return self.mean(self.containment[:, lead] <= share, share=True)


@dataclass(frozen=True)
class _Scores:
    """Scores of one forecast; fields as those of Verification, without the axis of forecasts."""

    track: int  # number of the drifter's track
    start: int
    lon: Array
    lat: Array
    apart: Array
    waiting: Array
    way: Array
    spread: Array
    aground: Array
    ashore: Array
    containment: Array
    along: Array
    across: Array
    energy: Array
    log: Array
    skill: float
    unclipped: float
    staying: float
    lost: float


@serialized
def verify(
    case: Case,
    files: str | os.PathLike[str] | Sequence[Track],
    out: str | os.PathLike[str] | None = None,
    *,
    every: float = EVERY,
    hours: float = HOURS / 3600,
    error: float = ERROR,
    columns: Mapping[str, str] | None = None,
    gap: float = drifter_records.GAP,
    fastest: float = drifter_records.FASTEST,
    ends_aground: bool = False,
    particles: int = PARTICLES,
    **options: Unpack[JobOptions],
) -> Verification:
    """Forecast drifters from many starts, and score the forecasts against the drifters' tracks.

    With `out`, also write the results into that folder.

    Args:
        case: whose forcing, object and errors the forecasts have.
        files: a file of tracks (CSV or netCDF), or tracks.
        out: folder for the results, written completely or not at all; None: nothing is written.
        every: time between starts [s], at least 600.
        hours: length of a forecast [h], whole hours, 1 to 720.
        error: radius [m] that holds half of the starts' errors.
        columns: columns of the file with the model's values at the drifter's positions,
            {"current_east": "u", ..} [m/s]; these values are used everywhere around the drifter.
        gap: longest time between fixes [s] that a forecast may span.
        fastest: speed [m/s] beyond which a fix is rejected.
        ends_aground: whether a drifter whose track ends near the shore ran aground there, and is
            scored there until the end.
        particles: number of particles of each forecast, at least 500.
        **options: as in `drift.run`.

    Returns:
        By lead time: separation of mean and drifter [m], skill, and share of drifters in each area
        (0 to 1), with standard errors clustered by drifter and day.

    Raises:
        UserError: no drifter can be followed for so long, or all forecasts are rejected.
    """
    from drift.assess.verify import chapter  # imported here because it imports this module

    shared_options, target = Options(out, **options), None if out is None else Path(out)
    if target is not None:
        writer.check_folder(target, shared_options.overwrite, (*chapter.FILES, *chapter.PICTURES))
    _check(every, hours, error, gap, particles)
    names = dict(columns or {})
    along.check_case(case, names)
    believed = drifter_records.believed(fitting.read_tracks(files, names), fastest)
    notes = list(believed.notes)
    stranded = starts.mark_stranded(believed, case.coast, ends_aground)
    start_list, left_out = starts.known_starts(
        stranded, case.coast, every, hours * 3600, gap, fastest, notes
    )
    case, times = _with_errors(case, names), _times(hours)
    cases = {
        start: _case(
            case, stranded.tracks[start.track], start.time, times, error, particles, names, number
        )
        for number, start in enumerate(start_list)
    }
    kept = {
        start: case_of_start for start, case_of_start in cases.items() if case_of_start is not None
    }
    if len(kept) < len(cases):
        left_out["columns without a value"] = len(cases) - len(kept)
        notes.append(
            f"{len(cases) - len(kept)} starts left out: the columns named have no value at the "
            "drifter"
        )
    if not kept:
        raise UserError("--columns: the columns named have no value at any drifter")
    forecasts = many.run_many(
        list(kept.values()),
        datasets=shared_options.datasets,
        threads=shared_options.threads,
        backend=shared_options.backend,
        report=shared_options.report,
    )
    rows, rejected = _scored(forecasts, list(kept), stranded, times)
    notes += [*_aground_notes(rows, stranded), *_lost_notes(case, rows, rejected)]
    if rejected:
        left_out["refused"] = len(rejected)
    result = _joined(case, stranded.tracks, rows, times, error, tuple(notes), left_out)
    if target is not None:
        if shared_options.report:
            shared_options.report("write", 0.0)
        writer.write(
            target, [chapter.verification_bundle(result)], overwrite=shared_options.overwrite
        )
    return result


def _check(every: float, hours: float, error: float, gap: float, particles: int) -> None:
    """Raise UserError if no forecasts can be made with these numbers."""
    if not every >= 600:
        raise UserError(f"--every {every:g} s must be at least 10 min")
    if not (1 <= hours <= 720 and hours % 1 == 0):
        raise UserError(f"--hours {hours:g} must be whole hours, 1 to 720")
    if not 0 < error <= 100_000:
        raise UserError(f"--error {error:g} m must be above 0 m and at most 100 km")
    if not gap > 0:
        raise UserError(f"--max-gap {gap:g} s must be above 0 s")
    if particles < 500:
        raise UserError(
            f"--particles {particles} must be at least 500: a rank among fewer is too coarse"
        )


def _with_errors(case: Case, columns: Mapping[str, str]) -> Case:
    """Return a case in which quantities from columns have a model's default errors."""
    errors: dict[str, Any] = {}
    for name, default in (("current", uncertainty.CURRENT), ("wind", uncertainty.WIND)):
        error: ForcingError = getattr(case, f"{name}_error")
        if f"{name}_east" in columns and error.by[0] == NOWHERE:
            errors[f"{name}_error"] = default
    return replace(case, **errors)


def _times(hours: float) -> Array:
    """Return the hours after the start at which a forecast is scored, ascending.

    These are every third hour, the LEADS and the end.
    """
    step = POINT / 3600
    return np.unique(
        np.concatenate(
            [np.arange(step, hours + 1e-9, step), [t for t in LEADS if t < hours], [hours]]
        )
    )


def _case(
    base: Case,
    track: Track,
    start: int,
    times: Array,
    error: float,
    particles: int,
    columns: Mapping[str, str],
    number: int,
) -> Case | None:
    """Return the case of one forecast, which starts where the drifter was; the rest is the base's.

    times: hours of its outputs. number: number of the forecast. Return None if the columns have no
    values there.
    """
    lon, lat = track.at(start)
    table = {
        k: v
        for k, v in along.single_scenario(base).items()
        if k not in ("area", "trackline", "hazard", "weight", "survival")
    }
    table["position"] = {"at": [float(lon), float(lat)], "error": error}
    changes: dict[str, Any] = {
        **dict.fromkeys((*along.ELSEWHERE, "end"), None),
        "direction": "forward",
        "start": np.datetime64(start, "s"),
        "duration": f"{times[-1]:g} h",
        "particles": particles,
        "seed": noise.seed_for(base.seed, Purpose.VERIFICATION, number) % 2**63,
        "max_lost": 1.0,  # notes state the share that is lost, and areas are shares of the rest
        "output": {"times": [f"+{hour:g} h" for hour in times]},
    }
    for quantity in velocities():
        if f"{quantity}_east" in columns:
            rows = _table_rows(track, start, times[-1] * 3600, quantity, columns)
            if len(rows) < 2:
                return None
            changes[quantity] = [{"name": "along the track", "table": rows}]
            if QUANTITIES[quantity].has_errors:
                # stated, because a table by time has no errors by default
                changes["uncertainty"] = {
                    "current": {
                        **_error_table(base.current_error),
                        "bias": base.current_error.bias,
                        "tail": base.current_error.tail if base.current_error.tailed else "none",
                    },
                    "wind": _error_table(base.wind_error),
                    "diffusivity": base.diffusivity,
                }
            table.pop(QUANTITIES[quantity].key, None)
    return case_file.vary(base, {**changes, "scenario": [table]})


def _error_table(error: ForcingError) -> dict[str, Any]:
    return {"std": error.std, "time": error.time}


def _table_rows(
    track: Track, start: int, length: float, quantity: str, columns: Mapping[str, str]
) -> list[dict[str, Any]]:
    """Return a quantity from a track's columns as a case's table by time.

    It begins with a fix before the forecast and ends with one after it.
    """
    first = max(int(np.searchsorted(track.time, start, "right")) - 1, 0)
    last = min(int(np.searchsorted(track.time, start + length, "left")), track.time.size - 1)
    east, north = (track.columns[columns[f"{quantity}_{side}"]] for side in ("east", "north"))
    rows: dict[int, dict[str, Any]] = {}
    for k in range(first, last + 1):
        if np.isfinite(east[k]) and np.isfinite(north[k]):
            second = int(np.floor(track.time[k])) if k == first else int(np.ceil(track.time[k]))
            time = f"{np.datetime64(second, 's')}Z"
            rows[second] = {"time": time, "east": float(east[k]), "north": float(north[k])}
    return list(rows.values())


def _leads(times: Array) -> Array:
    """Return the hours at which areas and ranks are scored: LEADS, and the end."""
    return np.array([*(lead for lead in LEADS if lead < times[-1]), times[-1]], float)


def _scored(
    forecasts: Iterable[many.Brief], known: Sequence[Start], stranded: Stranded, times: Array
) -> tuple[list[_Scores], list[str]]:
    """Return the scores of the forecasts, and a line for each rejected one.

    known: the start of each forecast; times: hours at which it is scored. Raises UserError if all
    were rejected.
    """
    rows: list[_Scores] = []
    rejected: list[str] = []
    for start, forecast in zip(known, forecasts, strict=True):
        name = f"{stranded.tracks[start.track].name} {np.datetime64(start.time, 's')}Z"
        if forecast.error is not None:
            rejected.append(f"{name}: {forecast.error.lines[0]}")
        elif not (forecast.probability * on_map(forecast.status)).sum(axis=1).min() > 0:
            rejected.append(f"{name}: all of its probability left the forcing or the domain")
        else:
            rows.append(_score(forecast, stranded, start, times))
    if not rows:
        raise UserError(
            f"--drifters: all {len(rejected)} forecasts were rejected; the first: {rejected[0]}"
        )
    return rows, rejected


def _score(forecast: many.Brief, stranded: Stranded, start: Start, times: Array) -> _Scores:
    """Return the scores of one forecast."""
    leads = np.searchsorted(times, _leads(times))
    begin = [float(x) for x in stranded.tracks[start.track].at(start.time)]
    lon, lat, aground = stranded.position(start, start.time + times * 3600)
    # outputs begin with the start where the case asks for that
    offset = forecast.lon.shape[0] - times.size
    path = np.radians([np.append(begin[0], lon), np.append(begin[1], lat)])
    way = np.cumsum(sphere.distance(path[0, :-1], path[1, :-1], path[0, 1:], path[1, 1:]))
    mean = np.radians(forecast.mean[offset:])
    apart = sphere.distance(mean[:, 0], mean[:, 1], path[0, 1:], path[1, 1:])
    waiting = sphere.distance(path[0, 0], path[1, 0], path[0, 1:], path[1, 1:])
    spread, ashore, at_leads = np.empty(times.size), np.empty(times.size), np.empty((5, leads.size))
    for k in range(times.size):
        row = k + offset
        mapped = on_map(forecast.status[row])
        weight = forecast.probability[row][mapped]
        ashore[k] = weight[forecast.status[row][mapped] == Status.ASHORE].sum() / weight.sum()
        x, y = scores.relative_to(
            lon[k], lat[k], forecast.lon[row][mapped], forecast.lat[row][mapped]
        )
        middle = np.average(x, weights=weight), np.average(y, weights=weight)
        spread[k] = np.sqrt(np.average((x - middle[0]) ** 2 + (y - middle[1]) ** 2, weights=weight))
        for lead in np.flatnonzero(leads == k):
            east, north = sphere.offset(path[0, 0], path[1, 0], mean[k, 0], mean[k, 1])
            length = max(float(np.hypot(east, north)), 1e-9)
            u, v = (float(east) / length, float(north) / length) if length > 1e-3 else (1.0, 0.0)
            at_leads[:, lead] = (
                scores.containment(x, y, weight),
                scores.rank(u * x + v * y, weight),
                scores.rank(v * x - u * y, weight),
                scores.energy_score(x, y, weight),
                scores.log_score(x, y, weight),
            )
    regular = np.isclose(times % (POINT / 3600), 0.0)
    if not regular.any():
        regular[:] = True
    return _Scores(
        track=start.track,
        start=start.time,
        lon=lon,
        lat=lat,
        apart=apart,
        waiting=waiting,
        way=way,
        spread=spread,
        aground=aground,
        ashore=ashore,
        containment=at_leads[0],
        along=at_leads[1],
        across=at_leads[2],
        energy=at_leads[3],
        log=at_leads[4],
        skill=scores.skill(apart[regular], way[regular]),
        unclipped=scores.unclipped_skill(apart[regular], way[regular]),
        staying=scores.unclipped_skill(waiting[regular], way[regular]),
        lost=1.0 - float(forecast.probability[-1][on_map(forecast.status[-1])].sum()),
    )


def _aground_notes(rows: Sequence[_Scores], stranded: Stranded) -> Iterator[str]:
    """Yield notes on forecasts whose drifters ran aground: scoring, and a selection effect."""
    if count := sum(bool(row.aground.any()) for row in rows):
        drifters = sorted({row.track for row in rows if row.aground.any()})
        words = drifter_records.words_for_spells(
            [stranded.tracks[k] for k in drifters], [stranded.ashore[k] for k in drifters]
        )
        yield (
            f"{count} forecasts whose drifters run aground; these are scored where they lie, like "
            f"particles ashore: {words}"
        )
        if len(rows) > len({row.track for row in rows}):
            yield (
                "a later start of a drifter implies that it is still afloat, so its errors are "
                "biased offshore compared with the particles; with --every longer than the "
                "tracks, each drifter has only one start"
            )


def _lost_notes(case: Case, rows: Sequence[_Scores], rejected: Sequence[str]) -> Iterator[str]:
    """Yield notes on rejected forecasts, and on those that lost much of their probability."""
    if rejected:
        yield f"{len(rejected)} forecasts rejected; the first: {rejected[0]}"
    if many_lost := sum(row.lost > case.max_lost for row in rows):
        yield (
            f"{many_lost} forecasts lost more than {case.max_lost:.0%} of their probability to "
            "the edges of the forcing (max_lost); their areas are shares of the rest"
        )


def _joined(
    case: Case,
    tracks: Sequence[Track],
    rows: Sequence[_Scores],
    times: Array,
    error: float,
    notes: tuple[str, ...],
    left_out: Mapping[str, int],
) -> Verification:
    """Return the verification of all forecasts from their scores."""
    columns = {
        field.name: np.array([getattr(row, field.name) for row in rows])
        for field in fields(_Scores)
    }
    number = columns.pop("track")
    present = np.unique(number)
    block = max(DAY, float(np.ceil(times[-1] / 24)) * DAY)
    return Verification(
        case=case,
        drifter=np.searchsorted(present, number),
        names=tuple(tracks[k].name for k in present),
        block=(columns["start"] // block).astype(int),
        hours=times,
        leads=_leads(times),
        error=error,
        notes=notes,
        left_out=left_out,
        **columns,
    )
