"""GPX 1.1 export for chart plotters (OpenCPN and others).

Datum and contacts become waypoints; areas, mean position and search become tracks. Names are short
and unique, as many plotters cut them: D for datum, then day and time, D221830Z. Plotters accept few
points: outlines are thinned, and the file states the error of thinning.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import shapely

from drift.apps.export.finished import Finished, Release
from drift.products.files import gpx, markup
from geo import notation, sphere

MOST = 2000  # most outline points in a file, unless the coarsest tolerance needs more
TOLERANCES = (0.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # [m] largest error of thinned outlines
Line = Sequence[Sequence[float]]

MONTH = np.timedelta64(27, "D")  # longest span in which no day of the month occurs twice


def files(run: Finished) -> dict[str, bytes]:
    """Return forecast.gpx, or one file per day (UTC) for a run of more than a day.

    Results of a spill add their stretches and patrols.
    """
    return _forecast(run) | _coast(run)


def release_files(run: Release) -> dict[str, bytes]:
    """Return origin.gpx: mean position and finds as waypoints, outlines of the areas as tracks."""
    root, lines = gpx.document(run.title, run.words), list[tuple[str, str, Sequence[Line]]]()
    for feature in run.features():
        properties, shape = feature["properties"], feature["geometry"]
        if shape["type"] == "Point":
            name = "MEAN" if properties["kind"] == "mean" else f"F{properties.get('number', '')}"
            description = (
                "mean position of the release"
                if properties["kind"] == "mean"
                else f"find {properties.get('name', '')}"
            )
            gpx.point(
                root,
                "wpt",
                *shape["coordinates"][:2],
                name=name,
                words=description,
                kind=properties["kind"],
            )
        elif shape["type"] == "MultiPolygon":
            percent = notation.hundredths(float(properties["level"] or 0))
            description = (
                f"{percent} % of the release, {float(properties['area_nmi2'] or 0):,.1f} nmi2"
            )
            rings = [
                line
                for polygon in shape["coordinates"]
                for ring in polygon
                for line in open_rings(ring)
            ]
            lines.append((f"{percent}%", description, rings))
    for name, description, outlines in lines:
        _lines(_track(root, name, description, "area"), outlines)
    return {"origin.gpx": markup.document_text(root).encode()}


def _coast(run: Finished) -> dict[str, bytes]:
    """Return stretches.gpx and patrols.gpx of a spill: a track per stretch, named by its id."""
    contents = {}
    for name, title in (("washup", "stretches"), ("patrols", "patrols")):
        features = run.features(f"{name}.geojson")
        if not features:
            continue
        root = gpx.document(f"{run.title}, {title}", run.words)
        for feature in features:
            properties = feature["properties"]
            if name == "washup":
                track_name = str(properties.get("stretch_id") or properties["name"])
                description = (
                    f"{properties['rank']} {properties['name']}, "
                    f"{properties['expected']:.3g} objects on average at the end"
                )
            else:
                track_name = f"{properties['patrol_unit']} {properties['stretch_id']}"
                description = (
                    f"{properties['time']} {properties['stretch']}, "
                    f"{properties['length_km']:.1f} km, {properties['found']:.2g} found on average"
                )
            _lines(_track(root, track_name, description, title), feature["geometry"]["coordinates"])
        contents[f"{title}.gpx"] = markup.document_text(root).encode()
    return contents


def _forecast(run: Finished) -> dict[str, bytes]:
    times = run.forecast["time"].values
    if times[-1] - times[0] <= np.timedelta64(1, "D"):
        return {"forecast.gpx": _document(run, "").encode()}
    stamps = [notation.iso(time) for time, _, _ in run.positions("mean")]
    stamps += [str(feature["properties"]["start"]) for feature in _legs(run)]
    stamps += [str(feature["properties"]["time"]) for feature in _contacts(run)]
    days = sorted({time[:10] for time in stamps}) or [notation.iso(times[0])[:10]]
    return {f"forecast-{day.replace('-', '')}.gpx": _document(run, day).encode() for day in days}


def _legs(run: Finished) -> list[dict[str, Any]]:
    """Return the features of legs that units searched along."""
    return [feature for feature in run.search() if feature["properties"]["shape"] == "legs"]


def _contacts(run: Finished) -> list[dict[str, Any]]:
    """Return the features of contacts: points, lines of bearing, and containment regions."""
    return [feature for feature in run.search() if feature["properties"]["kind"] == "contact"]


def _document(run: Finished, day: str) -> str:
    """Return the document of a day, or of the whole run if `day` is ""."""
    names = _names(run.forecast["time"].values)
    areas = [
        (
            time,
            share,
            properties,
            [
                line
                for polygon in geometry["coordinates"]
                for ring in polygon
                for line in open_rings(ring)
            ],
        )
        for time, share, geometry, properties in run.areas()
        if notation.iso(time).startswith(day)
    ]
    tolerance, areas = _thin_areas(areas)
    description = (
        f"{run.words}. Outlines of areas are thinned; their error is up to {tolerance:g} m"
        if tolerance
        else run.words
    )
    root = gpx.document(f"{run.title} {day}".strip(), description)
    for time, lon, lat in run.positions("datum"):
        if notation.iso(time).startswith(day):
            name = f"D{names[time]}"
            description = f"datum {notation.format_dtg(time)}, mean of those adrift"
            gpx.point(root, "wpt", lon, lat, time=time, name=name, words=description, kind="datum")
    contacts = [
        feature for feature in _contacts(run) if str(feature["properties"]["time"]).startswith(day)
    ]
    for feature in contacts:
        properties, shape = feature["properties"], feature["geometry"]
        if shape["type"] == "Point":
            description = (
                f"contact {properties['time']}, believed {100 * float(properties['belief']):.0f} %"
            )
            gpx.point(
                root,
                "wpt",
                *shape["coordinates"][:2],
                name=str(properties["name"]),
                words=description,
                kind="contact",
            )
    mean = [point for point in run.positions("mean") if notation.iso(point[0]).startswith(day)]
    if len(mean) > 1:
        track = _track(root, "MEAN", "mean position, adrift or ashore", "mean")
        gpx.segments(
            track, [row[1] for row in mean], [row[2] for row in mean], [row[0] for row in mean]
        )
    for time, share, properties, lines in areas:
        percent = notation.hundredths(share)
        description = f"{percent} % area {notation.format_dtg(time)}, {float(properties['area_nmi2']):,.1f} nmi2"
        _lines(_track(root, f"{percent}% {names[time]}", description, "area"), lines)
    for feature in contacts:
        properties, shape = feature["properties"], feature["geometry"]
        if shape["type"] != "Point":
            rings = (
                [ring for polygon in shape["coordinates"] for ring in polygon]
                if shape["type"] == "MultiPolygon"
                else shape["coordinates"]
            )
            lines = [line for ring in rings for line in open_rings(ring)]
            _lines(
                _track(
                    root,
                    str(properties["name"]),
                    f"contact {properties['time']}, {properties['shape']}",
                    "contact",
                ),
                lines,
            )
    for feature in _legs(run):
        properties = feature["properties"]
        if str(properties["start"]).startswith(day):
            description = f"{properties['kind']} {properties['start']} to {properties['end']}"
            _lines(
                _track(root, str(properties["name"]), description, "search"),
                feature["geometry"]["coordinates"],
            )
    return markup.document_text(root)


def _thin_areas(areas: list[Any]) -> tuple[float, list[Any]]:
    """Return the smallest sufficient tolerance [m], and the areas thinned by it.

    areas: (time, share, properties, lines).
    """
    for tolerance in TOLERANCES:
        found = [
            (*area[:3], [thin for line in area[3] if len(thin := _thin_line(line, tolerance)) > 1])
            for area in areas
        ]
        if sum(len(line) for area in found for line in area[3]) <= MOST:
            break
    return tolerance, found


def _thin_line(line: Line, tolerance: float) -> Line:
    """Return a line [deg] thinned to a tolerance [m] (Douglas and Peucker 1973).

    A closed line that is narrower than the tolerance is dropped: the result is empty.
    """
    if tolerance == 0:
        return line
    points = np.array(line, float)
    scaling = np.array([np.cos(np.radians(points[:, 1]).mean()), 1.0])
    tolerance_deg = np.degrees(tolerance / sphere.RADIUS)
    thin = (
        shapely.get_coordinates(
            shapely.LineString(points * scaling).simplify(tolerance_deg, preserve_topology=False)
        )
        / scaling
    )
    closed = bool((points[0] == points[-1]).all())
    return (
        []
        if closed and len(thin) < 4
        else [[round(float(x), 6), round(float(y), 6)] for x, y in thin]
    )


def _names(times: Any) -> dict[Any, str]:
    """Return a short unique name for each output, like 221830Z.

    A month in front, or a letter behind, separates names that would be equal.
    """
    month = np.ptp(times) > MONTH
    names: dict[Any, str] = {}
    for time in times:
        plain = name = f"{notation.iso(time)[5:7] if month else ''}{notation.day_time(time)}"
        letter = "a"
        while name in names.values():
            letter = chr(ord(letter) + 1)
            name = f"{plain}{letter}"
        names[time] = name
    return names


def _track(root: ET.Element, name: str, words: str, kind: str) -> ET.Element:
    track = ET.SubElement(root, "trk")
    for key, value in (("name", name), ("desc", words), ("type", kind)):
        markup.leaf(track, key, value)
    return track


def _lines(track: ET.Element, lines: Sequence[Sequence[Sequence[float]]]) -> None:
    """Append a track segment for each line, split at 180 degrees."""
    for line in lines:
        gpx.segments(track, *zip(*((point[0], point[1]) for point in line), strict=True))


def open_rings(ring: Sequence[Sequence[float]]) -> Iterator[list[Sequence[float]]]:
    """Yield the parts of a ring without its edges along 180 degrees, where the shape was split."""
    cut = [abs(a[0]) == abs(b[0]) == 180 for a, b in pairwise(ring)]
    if not any(cut):
        yield list(ring)
        return
    first = cut.index(True) + 1
    points = [*ring[first:-1], *ring[:first]]  # start at the end of a cut edge
    line = [points[0]]
    for a, b in pairwise(points):
        if abs(a[0]) == abs(b[0]) == 180:
            if len(line) > 1:
                yield line
            line = []
        line.append(b)
    if len(line) > 1:
        yield line
