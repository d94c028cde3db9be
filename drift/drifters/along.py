"""What a case's winds and currents say along the tracks of real drifters, and how far those went another way.

The model's way between two fixes is the integral of what it says at the places where the drifter really was, by two-point
Gauss quadrature in pieces of an hour at most. So a drifter that has left the model's eddy is not held against it for the
rest of its way: what is left over is the model's own error in place and time, the quantity that the errors of a case stand
for. What is compared with the drifter's way is current and Stokes drift; the wind's way comes with it, as a regressor.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drift import start
from drift.case import file as case_file
from drift.case.record import Case
from drift.drifters import error_law
from drift.drifters.error_law import Tracks
from drift.drifters.records import Array, Track, breaks
from drift.motion.forcing import QUANTITIES, Forcing
from geo import sphere
from geo.errors import UserError
from kernels import runtime

PIECE = 3600.0  # [s] of a drifter's way with one quadrature
GAUSS = 0.5 / np.sqrt(3.0)  # of two points on a piece of length 1, from its middle
MARGIN = 0.3  # [deg] about all tracks that forcing is read for
ELSEWHERE = ("sortie", "contact", "unit", "plan", "resampling", "expect", "find", "patrol")  # no matter of drifters


@dataclass(frozen=True)
class Ways:
    """Of one drifter, per fix: seconds since the fix before, and the way made since, shape (n,) and (n, 2) [m].

    fresh: the fix begins a stretch, and has no way. made: the drifter's own; model: current and Stokes drift; wind: of the
    air, none where the case has no wind.
    """

    name: str
    time: Array  # [s since 1970]
    step: Array
    fresh: Array
    made: Array
    model: Array
    wind: Array | None


@dataclass(frozen=True)
class Compared:
    """The ways of all drifters, and in words what could not be compared."""

    ways: tuple[Ways, ...]
    notes: tuple[str, ...]

    @property
    def wind(self) -> bool:
        """Whether there is a wind."""
        return all(way.wind is not None for way in self.ways)


def compared(
    case: Case,
    tracks: Sequence[Track],
    columns: Mapping[str, str],
    gap: float,
    fastest: float,
    datasets: Mapping[str, Any] | None = None,
) -> Compared:
    """Return the ways of drifters beside those of a case's forcing, or of columns of their own files.

    columns: {"current_east": "u", "current_north": "v"}: a quantity that is there is taken from the tracks' columns, all
    others from the case. gap: the longest time between fixes [s] over which they are compared.
    """
    given = {quantity for quantity in QUANTITIES if f"{quantity}_east" in columns}
    asked = [quantity for quantity in QUANTITIES if quantity not in given and _specs(case, quantity)]
    points = [_points(track) for track in tracks]
    said = _said(case, tracks, points, asked, datasets) if asked else {}
    ways, silent, long = [], 0, 0
    for k, track in enumerate(tracks):
        step = np.diff(track.time, prepend=track.time[0])
        fresh = breaks(track, gap, fastest)
        long += int(fresh[1:].sum())
        parts: dict[str, Array] = {}
        for quantity in QUANTITIES:
            if quantity in given:
                values = np.stack([track.columns[columns[f"{quantity}_{side}"]] for side in ("east", "north")], axis=1)
                mean = np.concatenate([np.zeros((1, 2)), (values[1:] + values[:-1]) / 2])
                parts[quantity] = mean * step[:, None]
            elif quantity in asked:
                _, weight, owner = points[k]
                parts[quantity] = np.stack(
                    [np.bincount(owner, weight * said[quantity][k][:, side], track.time.size) for side in (0, 1)],
                    axis=1,
                )
        none = np.zeros((track.time.size, 2))
        model = parts.get("current", none) + parts.get("stokes", none)
        known = np.isfinite(model).all(axis=1) & np.isfinite(parts.get("wind", none)).all(axis=1)
        silent += int((~known & ~fresh).sum())
        fresh = fresh | ~known
        lon, lat = np.radians(track.lon), np.radians(track.lat)
        east, north = sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:])
        made = np.concatenate([np.zeros((1, 2)), np.stack([east, north], axis=1)])
        still = fresh[:, None]
        wind = np.where(still, 0.0, parts["wind"]) if "wind" in parts else None
        ways.append(
            Ways(track.name, track.time, step, fresh, np.where(still, 0.0, made), np.where(still, 0.0, model), wind)
        )
    notes = []
    if long:
        notes.append(f"{long:,} ways between fixes left out that take more than {gap / 3600:.3g} h, or are leaps")
    if silent:
        notes.append(f"{silent:,} ways between fixes left out along which the forcing has no value")
    kept = tuple(way for way in ways if not way.fresh.all())
    if not kept:
        raise UserError(
            f"--drifters: no way between two fixes at most {gap / 3600:.3g} h apart lies where {case.path.name} has forcing"
            f"{f' ({notes[-1]})' if notes else ''}; check the times and the place of its sources, or give --columns"
        )
    return Compared(kept, tuple(notes))


def residuals(ways: Sequence[Ways], wind: bool) -> Tracks:
    """Return the ways made beyond the model's since each stretch began; unknowns: windage (where there is a wind), mean
    error east and north [m/s]."""
    pieces = []
    for way in ways:
        beyond = _since(way.made - way.model, way.fresh)
        regressors = np.zeros((way.step.size, 2, 2 + wind))
        if wind and way.wind is not None:
            regressors[..., 0] = _since(way.wind, way.fresh)
        lasting = _since(np.where(way.fresh, 0.0, way.step), way.fresh)
        regressors[:, 0, -2] = regressors[:, 1, -1] = lasting
        pieces.append((way.step, way.fresh, beyond, regressors))
    return error_law.joined(pieces)


def _since(values: Array, fresh: Array) -> Array:
    """Return sums since each stretch began."""
    total = np.cumsum(values, axis=0)
    begin = np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0))
    return np.asarray(total - total[begin])


def _specs(case: Case, quantity: str) -> tuple[Any, ...]:
    specs: tuple[Any, ...] = {"current": case.currents, "wind": case.winds, "stokes": case.stokes}[quantity]
    return specs


def _points(track: Track) -> tuple[Array, Array, Array]:
    """Return times [s since 1970, whole], weights [s] and the fix at the end of its way of each point of quadrature."""
    steps = np.diff(track.time)
    count = np.maximum(np.ceil(steps / PIECE).astype(int), 1)
    owner = np.repeat(np.arange(1, track.time.size), count)
    number = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
    length = np.repeat(steps / count, count)
    middle = track.time[owner - 1] + (number + 0.5) * length
    time = np.stack([middle - GAUSS * length, middle + GAUSS * length], axis=1).ravel()
    return np.rint(time), np.repeat(length / 2, 2), np.repeat(owner, 2)


def _said(
    case: Case,
    tracks: Sequence[Track],
    points: Sequence[tuple[Array, Array, Array]],
    asked: Sequence[str],
    datasets: Mapping[str, Any] | None,
) -> dict[str, list[Array]]:
    """Return by quantity, per drifter, what a case's sources say at points of its way, shape (points, 2), NaN for nothing.

    They are looked up as particles look them up: priorities, sums and filled coasts are theirs.
    """
    bounds = np.cumsum([0, *(len(point[0]) for point in points)])
    time = np.concatenate([point[0] for point in points])
    place = [track.at(point[0]) for track, point in zip(tracks, points, strict=True)]
    lon, lat = (sphere.to_binary(np.concatenate([one[k] for one in place])) for k in (0, 1))
    sources = start.open_for(over(case, tracks), datasets).scenarios[0]
    forcing = Forcing([sources], 1)
    said = {quantity: np.full((time.size, 2), np.nan) for quantity in asked}
    try:
        order = np.argsort(time, kind="stable")
        moments, begins = np.unique(time[order], return_index=True)
        ends = [*begins[1:], time.size]
        for moment, begin, end in zip(moments.astype(int), begins, ends, strict=True):
            these = order[begin:end]
            for low, fraction in (
                (moment, 0.0),
                (moment - 1, 1.0),
            ):  # a source's last moment ends a step, its first begins one
                forcing.set(int(low), int(low) + 1)
                for number, quantity in enumerate(QUANTITIES):
                    if quantity in asked:
                        first, last = forcing.ranges[0][2 * number : 2 * number + 2]
                        found = forcing.tiles.at(first, last, lon[these], lat[these], fraction)
                        new = np.isnan(said[quantity][these, 0]) & (found[:, 2] > 0)
                        said[quantity][these[new]] = found[new, :2]
                if all(np.isfinite(said[quantity][these]).all() for quantity in asked):
                    break
    finally:
        forcing.close()
    return {quantity: [values[a:b] for a, b in itertools.pairwise(bounds)] for quantity, values in said.items()}


def over(case: Case, tracks: Sequence[Track]) -> Case:
    """Return a case of the same sources over the time and place of tracks, in which nothing is said of a search."""
    first = min(track.time[0] for track in tracks)
    last = max(track.time[-1] for track in tracks)
    lon = np.sort(np.concatenate([track.lon for track in tracks]) % 360)
    lat = np.concatenate([track.lat for track in tracks])
    apart = np.diff(lon, append=lon[0] + 360)  # the widest stretch of longitude that holds no fix is outside
    widest = int(np.argmax(apart))
    west, wide = lon[(widest + 1) % lon.size], 360 - apart[widest]
    high = min(float(np.abs(lat).max()) + MARGIN, 85.0)
    side = MARGIN / np.cos(np.radians(high))
    whole = wide + 2 * side >= 359
    box = {
        "west": float(-180.0 if whole else (west - side + 180) % 360 - 180),
        "east": float(180.0 if whole else (west + wide + side + 180) % 360 - 180),
        "south": float(max(lat.min() - MARGIN, -90)),
        "north": float(min(lat.max() + MARGIN, 90)),
    }
    story = scenario(case)
    blown = bool(case.winds)
    table = {key: story[key] for key in ("currents", "winds", "stokes") if key in story}
    table |= {"name": "drifters", "object": {"windage": 0.01} if blown else "water"}
    table["position"] = {"at": [float(tracks[0].lon[0]), float(tracks[0].lat[0])], "std": 0.0}
    return case_file.vary(
        case,
        {
            **dict.fromkeys((*ELSEWHERE, "spill", "end"), None),
            "direction": "forward",
            "start": np.datetime64(int(np.floor(first)), "s"),
            "duration": float(np.ceil(last) - np.floor(first)),
            "max_lost": 1.0,
            "coast": {"source": "none"},
            "domain": box,
            "output": {},
            "scenario": [table],
        },
    )


def scenario(case: Case) -> Mapping[str, Any]:
    """Return the table of a case's one story; raise UserError where several drift as different objects, or in different seas."""
    tables: list[Mapping[str, Any]] = list(case.tables.get("scenario", ()))
    if not tables:
        raise UserError(f"{case.path.name}: has a [spill]; drifters are compared with a case of one [[scenario]]")
    told = [{key: table.get(key) for key in ("object", "currents", "winds", "stokes")} for table in tables]
    if any(one != told[0] for one in told):
        raise UserError(
            f"{case.path.name}: its scenarios drift as different objects, or in different sources; give a case with the one "
            "[[scenario]] that the drifters are to be compared with"
        )
    return tables[0]


def started(backend: str, threads: int | None) -> None:
    """Start the device that forcing is sampled on."""
    runtime.start(backend, threads)
