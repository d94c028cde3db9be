"""SAR messages of a finished run as text: a situation report, and a warning for NAVTEX.

The situation report has the sections of the IMO's standard format (IAMSAR manual, volume II: A to
N, without I). What drift does not know stands as a blank line for the coordinator. Texts are ASCII
capitals of at most 69 letters a line, which any radio or telex takes.
"""

import textwrap
from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from shapely.geometry import shape

from drift.apps.export.finished import Finished
from drift.forecast import likeliest_places
from drift.forecast.likeliest_places import LikelyPlace
from geo import notation
from geo.errors import UserError

WIDE = 69  # letters of a line
BLANK = "____"
SHARE = 0.5  # of the area that the messages give corners of


def files(run: Finished) -> dict[str, bytes]:
    """Return sitrep.txt and navtex.txt for the last of the wanted outputs, with a plan for the last
    one before its first search: later ones assume that its searches find nothing.

    Raises:
        UserError: the run has no position at that time.
    """
    time = _valid_time(run)
    return {
        "sitrep.txt": _encoded(_situation(run, time)),
        "navtex.txt": _encoded(_warning(run, time)),
    }


def _valid_time(run: Finished) -> np.datetime64:
    """Return the output that the messages describe."""
    times = run.forecast["time"].values
    starts = [
        np.datetime64(f["properties"]["takeoff"].rstrip("Z")) for f in run.features("plan.geojson")
    ]
    before = times[times <= min(starts)] if starts else times
    found: np.datetime64 = (before if before.size else times)[-1]
    return found


def _encoded(lines: Iterable[str]) -> bytes:
    """Return lines as ASCII capitals, wrapped."""
    wrapped: list[str] = []
    for line in lines:
        text = line.upper().encode("ascii", "replace").decode()
        wrapped += textwrap.wrap(text, WIDE, subsequent_indent="   ") or [""]
    return ("\r\n".join(wrapped) + "\r\n").encode()


def _situation(run: Finished, time: np.datetime64) -> list[str]:
    """Return the lines of the situation report."""
    forecast = run.forecast.sel(time=time)
    flown = _flown(run)
    sections = {
        "A. identity of casualty": [run.title, f"name, call sign, flag {BLANK}"],
        "B. position": _position(run, time),
        "C. situation": [f"nature and time of the emergency {BLANK}"],
        "D. number of persons": [BLANK],
        "E. assistance required": [BLANK],
        "F. coordinating RCC": [BLANK],
        "G. description of casualty": [
            *(f"possible: {name}" for name in _scenarios(forecast)),
            f"colour, equipment {BLANK}",
        ],
        "H. weather on scene": [BLANK],
        "J. initial actions taken": [*flown, *([] if flown else ["no search flown so far"])],
        "K. search area": _search_area(run, time),
        "L. coordinating instructions": [f"OSC, frequencies {BLANK}"],
        "M. future plans": [*_planned(run), *([] if _planned(run) else [BLANK])],
        "N. additional information": [run.words],
    }
    head = [
        f"date and time {notation.format_dtg(time)}",
        f"transmission priority {BLANK}",
        f"from {BLANK}",
        f"to {BLANK}",
        f"SAR sitrep number {BLANK}",
    ]
    return head + [f"{title}: {'. '.join(told)}" for title, told in sections.items()]


def _position(run: Finished, time: np.datetime64) -> list[str]:
    """Return the mean position, the most likely places and how sure they are, by the areas."""
    lon, lat = _mean(run, time)
    areas = [
        f"{notation.short_percent(share)} within {properties['area_nmi2']:,.3g} nmi2"
        for at, share, _, properties in run.areas()
        if at == time
    ]
    when = notation.format_dtg(time)
    return [
        f"mean of the forecast at {when} {notation.position(lon, lat)}",
        *map(_likely, likeliest_places.likeliest_places(run.cells_with_ashore().sel(time=time))),
        *areas,
    ]


def _likely(place: LikelyPlace) -> str:
    """Return a most likely place as text."""
    where = notation.position(place.lon, place.lat)
    if not place.ashore:
        return f"most likely afloat {where}, {notation.short_percent(place.share)} is afloat"
    reach = likeliest_places.REACH / notation.NMI
    return f"most likely coast {where}, {notation.short_percent(place.share)} within {reach:g} nmi"


def _mean(run: Finished, time: np.datetime64) -> tuple[float, float]:
    """Return the mean position [deg] at a time."""
    found = [(lon, lat) for at, lon, lat in run.positions("mean") if at == time]
    if not found:
        raise UserError(
            f"results {run.folder}: nothing is adrift or ashore at {notation.format_dtg(time)}; choose an earlier output with --time"
        )
    return found[0]


def _scenarios(forecast: Any) -> list[str]:
    """Return the names of the scenarios."""
    return [str(name) for name in np.atleast_1d(forecast["scenario"].values)]


def _flown(run: Finished) -> list[str]:
    """Return a sentence for each search that was flown, in order of time."""
    seen: dict[str, dict[str, Any]] = {}
    for feature in run.search():
        properties = feature["properties"]
        if properties["kind"] == "sortie":
            seen.setdefault(str(properties["name"]), properties)
    told = [
        f"{f['properties']['name']} {notation.format_dtg(str(f['properties']['time']).rstrip('Z'))}, reported"
        for f in run.search()
        if f["properties"]["kind"] == "contact"
    ]
    for name, own in sorted(seen.items(), key=lambda one: str(one[1]["start"])):
        begin, end = (notation.format_dtg(str(own[key]).rstrip("Z")) for key in ("start", "end"))
        pos = "" if own.get("pos") is None else f", POS {notation.probability(own['pos'])}"
        told.append(f"{name} {begin} to {end}, nothing found{pos}")
    return told


def _search_area(run: Finished, time: np.datetime64) -> list[str]:
    """Return the corners of the planned areas; without a plan those of a box about the area."""
    planned = [f for f in run.features("plan.geojson") if f["properties"]["shape"] == "area"]
    if planned:
        return [
            f"area {f['properties']['area']} {_corners(f['geometry'])}, for {f['properties']['unit']}"
            for f in planned
        ]
    return [f"none planned. {_box(run, time)}"]


def _corners(geometry: Any) -> str:
    """Return the corners of an area's outline as text."""
    ring = shape(geometry).geoms[0].exterior.coords[:-1]
    return ", ".join(str(notation.position(lon, lat)) for lon, lat, *_ in ring)


def _box(run: Finished, time: np.datetime64) -> str:
    """Return the least rectangle about the area of a share, as text."""
    found = [one for one in run.areas() if one[0] == time]
    if not found:
        raise UserError(f"results {run.folder}: no area at {notation.format_dtg(time)}")
    _, share, geometry, _ = min(found, key=lambda one: abs(one[1] - SHARE))
    box = shapely.minimum_rotated_rectangle(shape(geometry))
    corners = [str(notation.position(lon, lat)) for lon, lat in box.exterior.coords[:-1]]
    return f"{notation.short_percent(share)} area within {', '.join(corners)}"


def _planned(run: Finished) -> list[str]:
    """Return a sentence for each tasking of the plan."""
    told = []
    for feature in run.features("plan.geojson"):
        own = feature["properties"]
        if own["shape"] != "area":
            continue
        on, off = (
            notation.format_dtg(str(own[key]).rstrip("Z")) for key in ("on_scene", "off_scene")
        )
        told.append(
            f"{own['unit']} searches {own['area']} {on} to {off}, POS {notation.probability(own['pos'])}"
        )
    return told


def _warning(run: Finished, time: np.datetime64) -> list[str]:
    """Return the lines of a warning for NAVTEX, subject indicator D: search and rescue."""
    lon, lat = _mean(run, time)
    return [
        f"ZCZC {BLANK}D{BLANK}",
        f"{notation.format_dtg(time)}",
        f"search and rescue. {run.title}.",
        f"adrift near {notation.position(lon, lat)} at {notation.format_dtg(time)}. {_box(run, time)}.",
        "vessels in vicinity requested to keep a sharp lookout, assist if possible "
        f"and report to {BLANK}.",
        "NNNN",
    ]
