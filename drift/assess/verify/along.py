"""Displacements of real drifters between fixes, beside those by a case's winds and currents.

The model's displacement between two fixes is the integral of its velocity at the positions where
the drifter really was, by two-point Gauss quadrature in pieces of an hour at most. So a drifter
that has left an eddy of the model does not count against the model for the rest of its track: the
difference is the model's own error at that place and time, which is what the errors of a case
describe. The displacement by current and Stokes drift is compared with the drifter's; that of the
wind is a regressor.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drift.assess.verify import error_law
from drift.assess.verify.error_law import Tracks
from drift.case import file as case_file
from drift.case.record import Case
from drift.engine.environment import along_track
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.models.own_motion import OwnMotion
from drift.pipeline import run_setup
from drift.tracking.tracks.records import Track, breaks
from geo import sphere
from geo.array import Array
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES, velocities

MARGIN = 0.3  # [deg] margin about all tracks within which forcing is read
# keys of a case that a comparison with drifters does not use
ELSEWHERE = (
    *("sortie", "contact", "unit", "plan", "resampling", "expect", "find", "patrol"),
    *("drifter", "report"),
)


@dataclass(frozen=True)
class Displacements:
    """Displacements of one drifter between consecutive fixes; each ends at one of its n fixes.

    step: time since the previous fix [s], (n,). fresh: whether a fix begins a stretch, so that no
    displacement ends there, (n,). Displacements east and north [m], (n, 2): observed: the drifter's
    own; model: by current and Stokes drift; wind: by the wind speed itself, None if the case has no
    wind.
    """

    name: str
    time: Array  # [s since 1970]
    step: Array
    fresh: Array
    observed: Array
    model: Array
    wind: Array | None


@dataclass(frozen=True)
class Comparison:
    """The displacements of all drifters, and notes on those that could not be compared."""

    ways: tuple[Displacements, ...]
    notes: tuple[str, ...]

    @property
    def wind(self) -> bool:
        """Whether all displacements have a wind."""
        return all(way.wind is not None for way in self.ways)


def compare_displacements(
    case: Case,
    tracks: Sequence[Track],
    columns: Mapping[str, str],
    gap: float,
    fastest: float,
    datasets: Mapping[str, Any] | None = None,
) -> Comparison:
    """Return drifters' displacements, and those by the forcing of a case or by own columns.

    Args:
        case: the case whose sources are compared with the drifters.
        tracks: tracks of the drifters.
        columns: {"current_east": "u", "current_north": "v"}: quantities named here come from the
            tracks' columns, all others from the case.
        gap: longest time between fixes [s] over which displacements are compared.
        fastest: speed [m/s] beyond which two fixes are a leap.
        datasets: xarray.Datasets of sources with `dataset = "name"`, by that name.

    Returns:
        The displacements of each drifter, with notes.

    Raises:
        UserError: no displacement lies where there is forcing, or the forcing is an ensemble.
    """
    reported = {quantity for quantity in velocities() if f"{quantity}_east" in columns}
    asked = [
        quantity
        for quantity in velocities()
        if quantity not in reported and case.forcing.get(quantity)
    ]
    points = [along_track.quadrature_points(track.time) for track in tracks]
    sampled = _sampled(case, tracks, points, asked, datasets) if asked else {}
    ways, without_forcing, cut = [], 0, 0
    for k, track in enumerate(tracks):
        step = np.diff(track.time, prepend=track.time[0])
        fresh = breaks(track, gap, fastest)
        cut += int(fresh[1:].sum())
        parts: dict[str, Array] = {}
        for quantity in velocities():
            if quantity in reported:
                values = np.stack(
                    [track.columns[columns[f"{quantity}_{side}"]] for side in ("east", "north")],
                    axis=1,
                )
                mean = np.concatenate([np.zeros((1, 2)), (values[1:] + values[:-1]) / 2])
                parts[quantity] = mean * step[:, None]
            elif quantity in asked:
                _, weight, owner = points[k]
                parts[quantity] = np.stack(
                    [
                        np.bincount(owner, weight * sampled[quantity][k][:, side], track.time.size)
                        for side in (0, 1)
                    ],
                    axis=1,
                )
        zero = np.zeros((track.time.size, 2))
        parts = {
            q: part if QUANTITIES[q].needed else np.nan_to_num(part) for q, part in parts.items()
        }
        model = sum(
            (part for quantity, part in parts.items() if not QUANTITIES[quantity].in_air), zero
        )
        present = np.isfinite(model).all(axis=1) & np.isfinite(parts.get("wind", zero)).all(axis=1)
        without_forcing += int((~present & ~fresh).sum())
        fresh = fresh | ~present
        lon, lat = np.radians(track.lon), np.radians(track.lat)
        east, north = sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:])
        observed = np.concatenate([np.zeros((1, 2)), np.stack([east, north], axis=1)])
        observed, model = (np.where(fresh[:, None], 0.0, way) for way in (observed, model))
        wind = np.where(fresh[:, None], 0.0, parts["wind"]) if "wind" in parts else None
        ways.append(Displacements(track.name, track.time, step, fresh, observed, model, wind))
    notes = []
    if cut:
        notes.append(
            f"{cut:,} displacements between fixes left out: longer than {gap / 3600:.3g} h, or "
            "leaps"
        )
    if without_forcing:
        notes.append(
            f"{without_forcing:,} displacements between fixes left out: the forcing has no value "
            "there"
        )
    comparable = tuple(way for way in ways if not way.fresh.all())
    if not comparable:
        raise UserError(
            f"--drifters: no two fixes at most {gap / 3600:.3g} h apart lie where "
            f"{case.path.name} has forcing{f' ({notes[-1]})' if notes else ''}; check the times "
            "and places of its sources, or give --columns"
        )
    return Comparison(comparable, tuple(notes))


def residuals(ways: Sequence[Displacements], wind: bool) -> Tracks:
    """Return how far drifters went beyond the model in each stretch, with regressors.

    Displacements are counted from the start of the stretch. The unknowns of the mean are windage
    (if `wind`), and the mean error east and north [m/s].
    """
    pieces = []
    for way in ways:
        excess = _since(way.observed - way.model, way.fresh)
        regressors = np.zeros((way.step.size, 2, 2 + wind))
        if wind and way.wind is not None:
            regressors[..., 0] = _since(way.wind, way.fresh)
        elapsed = _since(np.where(way.fresh, 0.0, way.step), way.fresh)
        regressors[:, 0, -2] = regressors[:, 1, -1] = elapsed
        pieces.append((way.step, way.fresh, excess, regressors))
    return error_law.join_drifters(pieces)


def _since(values: Array, fresh: Array) -> Array:
    """Return cumulative sums of values since the start of the stretch of each."""
    total = np.cumsum(values, axis=0)
    begin = np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0))
    return np.asarray(total - total[begin])


def _sampled(
    case: Case,
    tracks: Sequence[Track],
    points: Sequence[tuple[Array, Array, Array]],
    asked: Sequence[str],
    datasets: Mapping[str, Any] | None,
) -> dict[str, list[Array]]:
    """Return the values of a case's sources at each drifter's points, (points, 2), by quantity.

    Values are NaN where the forcing has none. They are sampled as for particles, with the same
    priorities, sums and filled coasts.
    """
    bounds = np.cumsum([0, *(len(point[0]) for point in points)])
    time = np.concatenate([point[0] for point in points])
    positions = [track.at(point[0]) for track, point in zip(tracks, points, strict=True)]
    lon, lat = (
        sphere.to_binary(np.concatenate([position[k] for position in positions])) for k in (0, 1)
    )
    environment = run_setup.open_for(case_over_tracks(case, tracks), datasets)
    if environment.members:
        raise UserError(
            f"{case.path.name}: drifters are compared with one current and one wind, not with "
            f"{len(environment.members)} members of an ensemble: leave members out, and choose "
            "one by its index in variables"
        )
    sources = environment.scenarios[0]
    forcing = Forcing([sources], 1)
    try:
        sampled = along_track.sample_forcing(forcing, 0, asked, time, lon, lat)
    finally:
        forcing.close()
    return {
        quantity: [values[a:b] for a, b in itertools.pairwise(bounds)]
        for quantity, values in sampled.items()
    }


def case_over_tracks(case: Case, tracks: Sequence[Track]) -> Case:
    """Return a case with the same sources over the tracks' time and place, without evidence."""
    first = min(track.time[0] for track in tracks)
    last = max(track.time[-1] for track in tracks)
    lon = np.sort(np.concatenate([track.lon for track in tracks]) % 360)
    lat = np.concatenate([track.lat for track in tracks])
    # the box leaves out the widest gap between longitudes of fixes
    gaps = np.diff(lon, append=lon[0] + 360)
    widest = int(np.argmax(gaps))
    west, wide = lon[(widest + 1) % lon.size], 360 - gaps[widest]
    highest_lat = min(float(np.abs(lat).max()) + MARGIN, 85.0)
    side = MARGIN / np.cos(np.radians(highest_lat))
    round_earth = wide + 2 * side >= 359
    box = {
        "west": float(-180.0 if round_earth else sphere.wrap_degrees(west - side)),
        "east": float(180.0 if round_earth else sphere.wrap_degrees(west + wide + side)),
        "south": float(max(lat.min() - MARGIN, -90)),
        "north": float(min(lat.max() + MARGIN, 90)),
    }
    scenario_table = single_scenario(case)
    windy = bool(case.forcing["wind"])
    table = {key: scenario_table[key] for key in _keys() if key in scenario_table}
    table |= {"name": "drifters", "object": {"windage": 0.01} if windy else "water"}
    table["position"] = {"at": [float(tracks[0].lon[0]), float(tracks[0].lat[0])], "std": 0.0}
    return case_file.vary(
        case,
        {
            **dict.fromkeys((*ELSEWHERE, "spill", "end", "leeway"), None),
            "direction": "forward",
            "start": np.datetime64(int(np.floor(first)), "s"),
            "duration": float(np.ceil(last) - np.floor(first)),
            "max_lost": 1.0,
            "coast": {"source": "none"},
            "domain": box,
            "output": {"times": ["+0 h"]},  # no output is made; the default times would be too many
            "scenario": [table],
        },
    )


def _keys() -> list[str]:
    """Return the keys of a scenario that name sources."""
    return [quantity.key for quantity in QUANTITIES.values()]


def check_case(case: Case, columns: Mapping[str, str]) -> None:
    """Raise UserError if drifters cannot be compared with the case.

    Either a scenario has a motion other than drift, or a quantity was to come from columns and
    `columns` does not name them.
    """
    for quantity, specs in case.forcing.items():
        if f"{quantity}_east" not in columns and any(
            spec.name == case_file.ALONG for spec in specs
        ):
            raise UserError(
                f"{case.path.name}: was loaded with along = {quantity}, but no columns for it "
                f"were given; give {quantity}_east and {quantity}_north, or give the case a source"
            )
    for case_scenario in case.scenarios:
        motion = (
            case_scenario.motion.path.name
            if isinstance(case_scenario.motion, OwnMotion)
            else case_scenario.model
        )
        if motion != "drift":
            raise UserError(
                f'{case.path.name}: scenario "{case_scenario.name}" has motion = "{motion}"; '
                'drifters can only be compared with motion = "drift"'
            )


def single_scenario(case: Case) -> Mapping[str, Any]:
    """Return the scenario table of a case.

    Raises:
        UserError: there is none, or several have different objects or sources.
    """
    tables: list[Mapping[str, Any]] = list(case.tables.get("scenario", ()))
    if not tables:
        raise UserError(
            f"{case.path.name}: has a [spill]; drifters are compared with a case of one "
            "[[scenario]]"
        )
    sources_of = [{key: table.get(key) for key in ("object", *_keys())} for table in tables]
    if any(sources != sources_of[0] for sources in sources_of):
        raise UserError(
            f"{case.path.name}: its scenarios drift as different objects, or in different "
            "sources; give a case with the one [[scenario]] that the drifters are to be compared "
            "with"
        )
    return tables[0]
