"""Forecasts of where real drifters went, and how they did: `drift verify`.

Each drifter is forecast again and again from where it was, with the case's forcing, errors and object. What comes out is
held against where it was later: distances, the share of positions that the areas held, ranks. Forecasts of one drifter, and
of one day, are not independent: standard errors are clustered by both.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drift import many, turns
from drift.case import file as case_file
from drift.case import uncertainty
from drift.case.file import Case
from drift.drifters import along, clusters, fitting, scores
from drift.drifters import records as drifter_records
from drift.drifters.clusters import Estimate
from drift.drifters.records import Array, Track
from drift.motion.forcing_error import NOWHERE, ForcingError
from drift.motion.status import Status
from drift.output import writer
from geo import sphere
from geo.errors import UserError

Report = Callable[[str, float], None]

EVERY, HOURS = 12 * 3600.0, 24 * 3600.0  # [s] between starts, and of a forecast
ERROR = 100.0  # [m] radius that holds half of the fixes' errors
PARTICLES = 4000
POINT = (
    3 * 3600.0
)  # [s] between the times at which distances are told: a fix's error is little of the way made meanwhile
LEADS = (6, 12, 24, 48, 72, 96, 120)  # [h] at which areas are asked, besides the end
HEADLINE = 0.9  # share of the area that is judged in one sentence, whatever other areas the case states
BINS = 10  # of a rank histogram
DAY = 86_400.0


@dataclass(frozen=True)
class Verification:
    """Forecasts against drifters; n forecasts at m times, of which those in `leads` are looked at closely.

    hours: (m,) after the start. apart, waiting, way, spread: (n, m) [m]: of the mean position from the drifter; of the
    start from it (persistence); the drifter's own way; root mean square of the particles' distances from their mean.
    containment, along, across: (n, leads) ranks of the drifter, 0 to 1.
    """

    case: Case
    drifter: Array  # (n,) its number in names
    names: tuple[str, ...]
    start: Array  # (n,) [s since 1970]
    block: Array  # (n,) number of the day, or of as many as a forecast takes
    hours: Array
    lon: Array  # (n, m) [deg] of the drifter
    lat: Array
    apart: Array
    waiting: Array
    way: Array
    spread: Array
    leads: Array  # [h]
    containment: Array
    along: Array
    across: Array
    skill: Array  # (n,)
    lost: Array  # (n,) share of the probability that is on no map at the end
    error: float  # [m] of the starts
    notes: tuple[str, ...]

    @property
    def shares(self) -> tuple[float, ...]:
        """Shares of the areas that are judged: those that the case states, and the headline's."""
        return tuple(sorted({*self.case.areas, HEADLINE}))

    def mean(self, values: Array, *, share: bool = False) -> Estimate:
        """Return the mean of values by forecast, shape (n,), with its clustered standard error."""
        return clusters.mean(values, self.drifter, self.block, share=share)

    def held(self, lead: int, share: float) -> Estimate:
        """Return how often the area of a share held the drifter at a lead (its number)."""
        return self.mean(self.containment[:, lead] <= share, share=True)


@turns.in_turn
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
    particles: int = PARTICLES,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    overwrite: bool = False,
    report: Report | None = None,
) -> Verification:
    """Forecast drifters, a file or tracks as read, from many starts; return how that went, and with `out` write it there.

    every: time between starts [s]; hours: length of a forecast; error: radius [m] that holds half of the starts' errors.
    columns: {"current_east": "u", ..}: the model's values at the drifter's place, from columns of its file, taken for the
    same everywhere about it. gap: the longest time between fixes [s] that a forecast may span. Raises UserError.
    """
    from drift.drifters import chapter  # here: it knows what a verification is

    target = None if out is None else Path(out)
    if target is not None:
        writer.check_folder(target, overwrite, (*chapter.FILES, *chapter.PICTURES))
    _check(every, hours, error, gap, particles)
    wanted = dict(columns or {})
    believed = drifter_records.believed(fitting.read(files, wanted), fastest)
    notes = list(believed.notes)
    starts, silent = _starts(believed.tracks, every, hours * 3600, gap, fastest)
    if silent:
        notes.append(
            f"{silent} starts left out: the drifter is silent for more than {gap / 3600:.3g} h, or leaps, before the end"
        )
    if not starts:
        raise UserError(
            f"--drifters: no drifter can be followed for {hours:g} h without a gap of more than {gap / 3600:.3g} h "
            f"({'; '.join(notes) or 'their tracks are shorter'}); give fewer --hours, or a longer --max-gap"
        )
    case = _erring(case, wanted)
    after = _times(hours)
    made, known, silent = [], [], 0
    for number, (who, start) in enumerate(starts):
        one = _case(case, believed.tracks[who], start, after, error, particles, wanted, number)
        silent += one is None
        if one is not None:
            made.append(one)
            known.append((who, start))
    if silent:
        notes.append(f"{silent} starts left out: the columns named have no value at the drifter")
    if not made:
        raise UserError("--columns: the columns named have no value at any drifter")
    result = _scored(
        case,
        believed.tracks,
        known,
        after,
        error,
        notes,
        partial(many.run_many, made, datasets=datasets, threads=threads, backend=backend, report=report),
    )
    if target is not None:
        (report or (lambda phase, share: None))("write", 0.0)
        writer.write(target, [chapter.chapter(result)], overwrite=overwrite)
    return result


def _check(every: float, hours: float, error: float, gap: float, particles: int) -> None:
    """Refuse what no forecasts can be made from."""
    if not every >= 600:
        raise UserError(f"--every {every:g} s must be at least 10 min")
    if not (1 <= hours <= 720 and hours % 1 == 0):
        raise UserError(f"--hours {hours:g} must be whole hours, 1 to 720")
    if not 0 < error <= 100_000:
        raise UserError(f"--error {error:g} m must be above 0 m and at most 100 km")
    if not gap > 0:
        raise UserError(f"--max-gap {gap:g} s must be above 0 s")
    if particles < 500:
        raise UserError(f"--particles {particles} must be at least 500: a rank among fewer is too coarse")


def _erring(case: Case, columns: Mapping[str, str]) -> Case:
    """Return a case with errors of what comes from columns as well: a model's values, for which its files' default holds."""
    errors: dict[str, Any] = {}
    for name, default in (("current", uncertainty.CURRENT), ("wind", uncertainty.WIND)):
        error: ForcingError = getattr(case, f"{name}_error")
        if f"{name}_east" in columns and error.by[0] == NOWHERE:
            errors[f"{name}_error"] = default
    return replace(case, **errors)


def _times(hours: float) -> Array:
    """Return hours after the start at which a forecast is looked at: every three, the leads, and the end."""
    step = POINT / 3600
    return np.unique(np.concatenate([np.arange(step, hours + 1e-9, step), [t for t in LEADS if t < hours], [hours]]))


def _starts(
    tracks: Sequence[Track], every: float, length: float, gap: float, fastest: float
) -> tuple[list[tuple[int, int]], int]:
    """Return (number of the track, start [s since 1970]) of all forecasts, and how many were left out for gaps."""
    found, silent = [], 0
    for who, track in enumerate(tracks):
        fresh = drifter_records.breaks(track, gap, fastest)
        for start in np.arange(np.ceil(track.time[0]), track.time[-1] - length + 1e-6, every):
            first = int(np.searchsorted(track.time, start, "right")) - 1
            last = int(np.searchsorted(track.time, start + length, "left"))
            if fresh[first + 1 : last + 1].any():
                silent += 1
            else:
                found.append((who, int(start)))
    return found, silent


def _case(
    base: Case,
    track: Track,
    start: int,
    after: Array,
    error: float,
    particles: int,
    columns: Mapping[str, str],
    number: int,
) -> Case | None:
    """Return the case of one forecast: the base's sources, errors, coast and object, from where the drifter was.

    None where columns are to say what it drifts in, and have nothing there.
    """
    lon, lat = track.at(start)
    table = {k: v for k, v in along.scenario(base).items() if k not in ("area", "trackline", "weight", "survival")}
    table["position"] = {"at": [float(lon), float(lat)], "error": error}
    changes: dict[str, Any] = {
        **dict.fromkeys((*along.ELSEWHERE, "end"), None),
        "direction": "forward",
        "start": np.datetime64(start, "s"),
        "duration": f"{after[-1]:g} h",
        "particles": particles,
        "seed": (base.seed + number) % 2**63,
        "max_lost": 1.0,  # the share lost is told, and the areas are shares of the rest
        "output": {"times": [f"+{hour:g} h" for hour in after]},
    }
    for quantity in ("current", "wind", "stokes"):
        if f"{quantity}_east" in columns:
            rows = _reported(track, start, after[-1] * 3600, quantity, columns)
            if len(rows) < 2:
                return None
            changes[quantity] = [{"name": "along the track", "table": rows}]
            if quantity != "stokes":
                changes["uncertainty"] = {
                    "current": _stated(base.current_error) | {"bias": base.current_error.bias},
                    "wind": _stated(base.wind_error),
                    "diffusivity": base.diffusivity,
                }  # a table by time has none by default
            table.pop(f"{quantity}s" if quantity != "stokes" else quantity, None)
    return case_file.vary(base, {**changes, "scenario": [table]})


def _stated(error: ForcingError) -> dict[str, Any]:
    return {"std": error.std, "time": error.time}


def _reported(
    track: Track, start: int, length: float, quantity: str, columns: Mapping[str, str]
) -> list[dict[str, Any]]:
    """Return a table of a case: a quantity from columns of a track, by time, over a forecast and a fix beyond its ends."""
    first = max(int(np.searchsorted(track.time, start, "right")) - 1, 0)
    last = min(int(np.searchsorted(track.time, start + length, "left")), track.time.size - 1)
    east, north = (track.columns[columns[f"{quantity}_{side}"]] for side in ("east", "north"))
    rows: dict[int, dict[str, Any]] = {}
    for k in range(first, last + 1):
        if np.isfinite(east[k]) and np.isfinite(north[k]):
            second = int(np.floor(track.time[k])) if k == first else int(np.ceil(track.time[k]))
            when = f"{np.datetime64(second, 's')}Z"
            rows[second] = {"time": when, "east": float(east[k]), "north": float(north[k])}
    return list(rows.values())


def _scored(
    base: Case,
    tracks: Sequence[Track],
    starts: Sequence[tuple[int, int]],
    after: Array,
    error: float,
    notes: list[str],
    run: Callable[[], Iterator[many.Brief]],
) -> Verification:
    """Return how the forecasts from starts did."""
    leads = np.array([*(t for t in LEADS if t < after[-1]), after[-1]], float)
    which = np.searchsorted(after, leads)
    rows: list[dict[str, Any]] = []
    refused: list[str] = []
    for (who, start), made in zip(starts, run(), strict=True):
        when = f"{tracks[who].name} {np.datetime64(start, 's')}Z"
        if made.error is not None:
            refused.append(f"{when}: {made.error.lines[0]}")
        elif not (made.probability * (made.status <= Status.ASHORE)).sum(axis=1).min() > 0:
            refused.append(f"{when}: all of its probability left the forcing or the domain")
        else:
            rows.append({"who": who, "start": start, **_one(made, tracks[who], start, after, which)})
    if not rows:
        raise UserError(f"--drifters: all {len(refused)} forecasts were refused; the first: {refused[0]}")
    if refused:
        notes.append(f"{len(refused)} forecasts refused; the first: {refused[0]}")
    column = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    if (bad := int((column["lost"] > base.max_lost).sum())) > 0:
        notes.append(
            f"{bad} forecasts lost more than {base.max_lost:.0%} of their probability to the edges of the forcing (max_lost); "
            "their areas are shares of the rest"
        )
    present = np.unique(column["who"])
    block = max(DAY, float(np.ceil(after[-1] / 24)) * DAY)
    return Verification(
        case=base,
        drifter=np.searchsorted(present, column["who"]),
        names=tuple(tracks[k].name for k in present),
        start=column["start"],
        block=(column["start"] // block).astype(int),
        hours=after,
        leads=leads,
        error=error,
        notes=tuple(notes),
        **{
            k: column[k]
            for k in (
                "lon",
                "lat",
                "apart",
                "waiting",
                "way",
                "spread",
                "containment",
                "along",
                "across",
                "skill",
                "lost",
            )
        },
    )


def _one(made: many.Brief, track: Track, start: int, after: Array, which: Array) -> dict[str, Any]:
    """Return the scores of one forecast."""
    seconds = start + after * 3600
    begin = [float(x) for x in track.at(start)]
    lon, lat = track.at(seconds)
    offset = made.lon.shape[0] - after.size  # outputs begin with the start where the case asks for that
    path = np.radians([np.append(begin[0], lon), np.append(begin[1], lat)])
    way = np.cumsum(sphere.distance(path[0, :-1], path[1, :-1], path[0, 1:], path[1, 1:]))
    mean = np.radians(made.mean[offset:])
    apart = sphere.distance(mean[:, 0], mean[:, 1], path[0, 1:], path[1, 1:])
    waiting = sphere.distance(path[0, 0], path[1, 0], path[0, 1:], path[1, 1:])
    spread, ranks = np.empty(after.size), np.empty((3, which.size))
    for k in range(after.size):
        row = k + offset
        there = made.status[row] <= Status.ASHORE
        weight = made.probability[row][there]
        x, y = scores.about(lon[k], lat[k], made.lon[row][there], made.lat[row][there])
        middle = np.average(x, weights=weight), np.average(y, weights=weight)
        spread[k] = np.sqrt(np.average((x - middle[0]) ** 2 + (y - middle[1]) ** 2, weights=weight))
        for lead in np.flatnonzero(which == k):
            east, north = sphere.offset(path[0, 0], path[1, 0], mean[k, 0], mean[k, 1])
            length = max(float(np.hypot(east, north)), 1e-9)
            u, v = (float(east) / length, float(north) / length) if length > 1e-3 else (1.0, 0.0)
            ranks[:, lead] = (
                scores.containment(x, y, weight),
                scores.rank(u * x + v * y, weight),
                scores.rank(v * x - u * y, weight),
            )
    lost = 1.0 - float(made.probability[-1][made.status[-1] <= Status.ASHORE].sum())
    regular = np.isclose(after % (POINT / 3600), 0.0)
    return {
        "lon": lon, "lat": lat, "apart": apart, "waiting": waiting, "way": way, "spread": spread,
        "containment": ranks[0], "along": ranks[1], "across": ranks[2],
        "skill": scores.skill(apart[regular], way[regular]) if regular.any() else scores.skill(apart, way), "lost": lost,
    }  # fmt: skip
