"""What the warm process answers about the spill of a text: its rows, and what a map shows of them.

Rows with a mistake are drawn without the rest of the case where that is possible. A find is checked
against the shore as a run does, so that a click in the open sea gets the run's own message.
"""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from drift.apps.serve.answers.search_answers import DIGITS, readable_case
from drift.apps.serve.fields import form, search_fields
from drift.case.record import Case
from drift.case.values import units
from drift.engine.motion.scenario import TrackPrior
from drift.spills.worlds import evidence
from drift.spills.worlds.records import Find
from geo import notation
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import shore
from geo.coast.edges import Coast
from geo.errors import UserError

LATTICE = 0.5  # [deg] to which the middle of a box of shore is rounded
AROUND = 0.75  # [deg] half the height of that box: farther from the shore is the open sea


def spill(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the spill of a text, and what a map shows of it.

    Args:
        request: `text` of a case, and its `path`.

    Returns:
        What `search_fields.read_rows` returns, and `shapes`: the ship's `track` and the parts of it
        where objects may have gone overboard, `losses`; by number in the text `finds`, each with its
        distance from the shore or the mistake, `patrols` and `teams`.
    """
    path, text = Path(request["path"]), request["text"]
    data = form.parse_text(text)
    case = readable_case(path, text)
    return {
        **search_fields.read_rows(data),
        "shapes": {
            **_shapes_of_track(data, case),
            "finds": _by_number(data, "find", lambda row, k: _find(data, row, k)),
            "patrols": _by_number(data, "patrol", _patrol),
            "teams": _by_number(data, "patrol_unit", _team),
        },
    }


def _by_number(data: Mapping[str, Any], table: str, shape: Any) -> dict[int, Any]:
    """Return the shapes of the rows that have one, by number in the text."""
    rows = data.get(table)
    found = {}
    for k, row in enumerate(rows[: search_fields.MOST] if isinstance(rows, list) else ()):
        try:
            one = shape(row, k)
        except (ValueError, TypeError, AttributeError, LookupError, OverflowError):
            continue  # the check reports it
        if one is not None:
            found[k] = one
    return found


def _point(value: Any) -> list[float]:
    lon, lat = units.position(value)
    return [round(lon, DIGITS), round(lat, DIGITS)]


def _patrol(row: Any, k: int) -> dict[str, Any] | None:
    ends = row.get("between")
    return None if ends is None else {"points": [_point(one) for one in ends]}


def _team(row: Any, k: int) -> dict[str, Any] | None:
    if "base" not in row:
        return None
    try:
        reach = units.quantity(row["reach"], "m", "distance", "40 km")
    except (ValueError, KeyError):
        reach = 0.0
    return {"at": _point(row["base"]), "reach": reach}


def _find(data: Mapping[str, Any], row: Any, k: int) -> dict[str, Any] | None:
    """Return the place of a find, its distance from the shore [m], and the mistake if it has one."""
    if "at" not in row:
        return None
    lon, lat = units.position(row["at"])
    at_sea = row.get("at_sea") is True
    name = str(row.get("name", f"find {k + 1}"))
    find = Find(name, np.datetime64("NaT"), False, None, lon, lat, 0.0, at_sea, None, None, 0.0)
    told: dict[str, Any] = {"at": _point(row["at"]), "off_shore": None, "mistake": None}
    try:
        told["off_shore"] = evidence.check_place_of_find(find, _coast_near(data, lon, lat))
    except UserError as error:
        told["mistake"] = error.lines[0].removeprefix(f"{name}: ")
    return told


def _coast_near(data: Mapping[str, Any], lon: float, lat: float) -> Coast:
    """Return the shore of the case around a place."""
    table = data.get("coast")
    table = table if isinstance(table, dict) else {}
    source, lakes = table.get("source", "gshhg"), table.get("lakes", False)
    if source != "gshhg" or lakes:
        raise ValueError("the run checks a shore of the case's own")
    return _coast(round(lon / LATTICE), round(lat / LATTICE))


@lru_cache(32)
def _coast(column: int, row: int) -> Coast:
    lon, lat = column * LATTICE, row * LATTICE
    wide = min(AROUND / max(np.cos(np.radians(lat)), 0.01), 90.0)
    box = Box(lon - wide, max(lat - AROUND, -89.0), lon + wide, min(lat + AROUND, 89.0))
    return shoreline.build_coast(shore.read_land("gshhg", box), box)


def _shapes_of_track(data: Mapping[str, Any], case: Case | None) -> dict[str, Any]:
    """Return the ship's track and the parts of it on which objects may have gone overboard."""
    prior = case.spill.prior if case is not None and case.spill is not None else None
    if isinstance(prior, TrackPrior):
        track = _degrees(np.unwrap(prior.lon), prior.lat)
        return {"track": track, "losses": [_part_of_track(prior, loss) for loss in prior.losses]}
    table = data.get("spill")
    points = table.get("track") if isinstance(table, dict) else None
    track = []
    for point in points if isinstance(points, list) else ():
        try:
            track.append(_point(point["at"]))
        except (ValueError, TypeError, KeyError, AttributeError):
            continue
    return {"track": track, "losses": []}


def _degrees(lon: Any, lat: Any) -> list[list[float]]:
    points: list[list[float]] = np.degrees([lon, lat]).T.round(DIGITS).tolist()
    return points


def _part_of_track(prior: TrackPrior, loss: Any) -> dict[str, Any]:
    """Return the part of a ship's track between the earliest begin and the latest end of a loss."""
    first, last = (float(notation.epoch(time)) for time in (loss.begin[0], loss.end))
    known = np.array(prior.time)
    times = np.array([first, *known[(known > first) & (known < last)], last])
    lon = np.interp(times, known, np.unwrap(prior.lon))
    lat = np.interp(times, known, prior.lat)
    begun, ended = (notation.format_dtg(time) for time in (loss.begin[0], loss.end))
    return {"points": _degrees(lon, lat), "period": f"{begun} to {ended}"}
