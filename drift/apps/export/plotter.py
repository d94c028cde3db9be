"""A forecast as GPX 1.1 for chart plotters (OpenCPN and others): datum and contacts as waypoints,
areas, mean and search as tracks.

Names are short, for many plotters cut them: D for datum, then day and time, D221830Z; no two
outputs have the same. Plotters take few points: outlines are thinned, and the file says by how
much.
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

MOST = 2000  # points of the outlines of a file, unless the last of these is not enough
TOLERANCES = (0.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # [m] by which outlines are off at most
Line = Sequence[Sequence[float]]

MONTH = np.timedelta64(27, "D")  # after which days of the month may come again


def files(run: Finished) -> dict[str, bytes]:
    """Return forecast.gpx; of more than a day, one file for each day (UTC); of a spill its
    stretches and patrols too.
    """
    return _forecast(run) | _coast(run)


def release_files(run: Release) -> dict[str, bytes]:
    """Return origin.gpx: the mean and the finds as waypoints, outlines of the areas as tracks."""
    root, lines = gpx.document(run.title, run.words), list[tuple[str, str, Sequence[Line]]]()
    for feature in run.features():
        told, shape = feature["properties"], feature["geometry"]
        if shape["type"] == "Point":
            name = "MEAN" if told["kind"] == "mean" else f"F{told.get('number', '')}"
            words = (
                "mean position of the release"
                if told["kind"] == "mean"
                else f"find {told.get('name', '')}"
            )
            gpx.point(
                root, "wpt", *shape["coordinates"][:2], name=name, words=words, kind=told["kind"]
            )
        elif shape["type"] == "MultiPolygon":
            percent = notation.hundredths(float(told["level"] or 0))
            words = f"{percent} % of the release, {float(told['area_nmi2'] or 0):,.1f} nmi2"
            rings = [
                line
                for polygon in shape["coordinates"]
                for ring in polygon
                for line in open_rings(ring)
            ]
            lines.append((f"{percent}%", words, rings))
    for name, words, outlines in lines:
        _lines(_track(root, name, words, "area"), outlines)
    return {"origin.gpx": markup.document_text(root).encode()}


def _coast(run: Finished) -> dict[str, bytes]:
    """Return stretches.gpx and patrols.gpx of a spill: a track for each stretch, named by its id."""
    made = {}
    for name, title in (("washup", "stretches"), ("patrols", "patrols")):
        features = run.features(f"{name}.geojson")
        if not features:
            continue
        root = gpx.document(f"{run.title}, {title}", run.words)
        for feature in features:
            told = feature["properties"]
            if name == "washup":
                called = str(told.get("stretch_id") or told["name"])
                words = f"{told['rank']} {told['name']}, {told['expected']:.3g} objects on average at the end"
            else:
                called = f"{told['patrol_unit']} {told['stretch_id']}"
                words = f"{told['time']} {told['stretch']}, {told['length_km']:.1f} km, {told['found']:.2g} found on average"
            _lines(_track(root, called, words, title), feature["geometry"]["coordinates"])
        made[f"{title}.gpx"] = markup.document_text(root).encode()
    return made


def _forecast(run: Finished) -> dict[str, bytes]:
    times = run.forecast["time"].values
    if times[-1] - times[0] <= np.timedelta64(1, "D"):
        return {"forecast.gpx": _document(run, "").encode()}
    told = [notation.iso(time) for time, _, _ in run.positions("mean")]
    told += [str(feature["properties"]["start"]) for feature in _legs(run)]
    told += [str(feature["properties"]["time"]) for feature in _contacts(run)]
    days = sorted({time[:10] for time in told}) or [notation.iso(times[0])[:10]]
    return {f"forecast-{day.replace('-', '')}.gpx": _document(run, day).encode() for day in days}


def _legs(run: Finished) -> list[dict[str, Any]]:
    """Return the features of what units searched along."""
    return [feature for feature in run.search() if feature["properties"]["shape"] == "legs"]


def _contacts(run: Finished) -> list[dict[str, Any]]:
    """Return the features of contacts: points, lines of bearing, and regions that hold them."""
    return [feature for feature in run.search() if feature["properties"]["kind"] == "contact"]


def _document(run: Finished, day: str) -> str:
    """Return a document of what is of a day, of all if it is ""."""
    names = _names(run.forecast["time"].values)
    areas = [
        (
            time,
            share,
            told,
            [
                line
                for polygon in geometry["coordinates"]
                for ring in polygon
                for line in open_rings(ring)
            ],
        )
        for time, share, geometry, told in run.areas()
        if notation.iso(time).startswith(day)
    ]
    tolerance, areas = _thinned(areas)
    words = (
        f"{run.words}. Outlines of areas are thinned, and off by up to {tolerance:g} m"
        if tolerance
        else run.words
    )
    root = gpx.document(f"{run.title} {day}".strip(), words)
    for time, lon, lat in run.positions("datum"):
        if notation.iso(time).startswith(day):
            name = f"D{names[time]}"
            words = f"datum {notation.group(time)}, mean of those adrift"
            gpx.point(root, "wpt", lon, lat, time=time, name=name, words=words, kind="datum")
    contacts = [
        feature for feature in _contacts(run) if str(feature["properties"]["time"]).startswith(day)
    ]
    for feature in contacts:
        told, shape = feature["properties"], feature["geometry"]
        if shape["type"] == "Point":
            words = f"contact {told['time']}, believed {100 * float(told['belief']):.0f} %"
            gpx.point(
                root,
                "wpt",
                *shape["coordinates"][:2],
                name=str(told["name"]),
                words=words,
                kind="contact",
            )
    mean = [point for point in run.positions("mean") if notation.iso(point[0]).startswith(day)]
    if len(mean) > 1:
        track = _track(root, "MEAN", "mean position, adrift or ashore", "mean")
        gpx.segments(
            track, [row[1] for row in mean], [row[2] for row in mean], [row[0] for row in mean]
        )
    for time, share, told, lines in areas:
        percent = notation.hundredths(share)
        words = f"{percent} % area {notation.group(time)}, {float(told['area_nmi2']):,.1f} nmi2"
        _lines(_track(root, f"{percent}% {names[time]}", words, "area"), lines)
    for feature in contacts:
        told, shape = feature["properties"], feature["geometry"]
        if shape["type"] != "Point":
            rings = (
                [ring for polygon in shape["coordinates"] for ring in polygon]
                if shape["type"] == "MultiPolygon"
                else shape["coordinates"]
            )
            lines = [line for ring in rings for line in open_rings(ring)]
            _lines(
                _track(
                    root, str(told["name"]), f"contact {told['time']}, {told['shape']}", "contact"
                ),
                lines,
            )
    for feature in _legs(run):
        told = feature["properties"]
        if str(told["start"]).startswith(day):
            words = f"{told['kind']} {told['start']} to {told['end']}"
            _lines(
                _track(root, str(told["name"]), words, "search"), feature["geometry"]["coordinates"]
            )
    return markup.document_text(root)


def _thinned(areas: list[Any]) -> tuple[float, list[Any]]:
    """Return by how much outlines are off [m], and the areas (time, share, told, lines) with so few
    points as that allows.
    """
    for tolerance in TOLERANCES:
        found = [
            (*area[:3], [thin for line in area[3] if len(thin := thinned(line, tolerance)) > 1])
            for area in areas
        ]
        if sum(len(line) for area in found for line in area[3]) <= MOST:
            break
    return tolerance, found


def thinned(line: Line, tolerance: float) -> Line:
    """Return a line [deg] with fewer points, off it by no more than a tolerance [m] (Douglas and
    Peucker 1973).

    A closed one that is no wider than that is left out: nothing is returned.
    """
    if tolerance == 0:
        return line
    points = np.array(line, float)
    wide = np.array([np.cos(np.radians(points[:, 1]).mean()), 1.0])
    apart = np.degrees(tolerance / sphere.RADIUS)
    thin = (
        shapely.get_coordinates(
            shapely.LineString(points * wide).simplify(apart, preserve_topology=False)
        )
        / wide
    )
    closed = bool((points[0] == points[-1]).all())
    return (
        []
        if closed and len(thin) < 4
        else [[round(float(x), 6), round(float(y), 6)] for x, y in thin]
    )


def _names(times: Any) -> dict[Any, str]:
    """Return a short name of each output, 221830Z: with the month before it, or a letter behind,
    where two were alike.
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
    """Append a segment for each line, cut at 180 degrees."""
    for line in lines:
        gpx.segments(track, *zip(*((point[0], point[1]) for point in line), strict=True))


def open_rings(ring: Sequence[Sequence[float]]) -> Iterator[list[Sequence[float]]]:
    """Yield the outline of a ring without the edges along 180 degrees, where a shape was cut that
    goes on beyond.
    """
    cut = [abs(a[0]) == abs(b[0]) == 180 for a, b in pairwise(ring)]
    if not any(cut):
        yield list(ring)
        return
    first = cut.index(True) + 1
    points = [*ring[first:-1], *ring[:first]]  # from the end of a cut edge to the beginning of it
    line = [points[0]]
    for a, b in pairwise(points):
        if abs(a[0]) == abs(b[0]) == 180:
            if len(line) > 1:
                yield line
            line = []
        line.append(b)
    if len(line) > 1:
        yield line
