"""A contact that was lost, in words and tables."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

import numpy as np

from drift.output import formats, geojson, markup
from drift.output import gpx as gpx_file
from drift.output.chapter import Stamped
from drift.regain.record import Regained
from drift.tracker import path
from drift.tracker.density import Region
from drift.tracker.detections import Detections
from geo import notation
from geo.notation import KNOT, NMI


def moment(found: Regained, seconds: float) -> np.datetime64:
    """Return a time [s after the start] as a date and time, to the second."""
    return np.datetime64(notation.epoch(found.held.study.start) + round(seconds), "s")


def facts(found: Regained) -> dict[str, str]:
    """Return a line for the last detection, each time shown, and for what must be doubted."""
    held = found.held
    seen = held.study.target
    assert isinstance(seen, Detections)
    who = held.study.sensors[int(seen.sensor[-1])].name
    told = {"last detection": f"{notation.group(moment(found, seen.time[-1]))} by {who}; {len(seen.time)} in all"}
    for time, regions in found.areas:
        told[notation.group(moment(found, time))] = _state(found, time, regions)
    if held.lost:
        times = ", ".join(notation.group(moment(found, time)) for time in held.lost)
        told["lost"] = f"no particle is left by {times}: sweeps that found nothing rule out where it could be. " \
            "Check positions and reaches, or take a higher fastest speed, or more particles"  # fmt: skip
    if not held.clouds[-1][1]:
        told["warning"] = "no track is held at the end"
    return told


def _state(found: Regained, time: float, regions: Mapping[float, Region]) -> str:
    held = found.held
    k = int(np.flatnonzero((held.time == time) & ~held.detected)[-1])
    if not regions:
        return "no track is held"
    lon, lat = path.degrees(held.place[k])
    course = round(float(np.degrees(held.course[k]))) % 360
    return f"{notation.position(float(lon), float(lat))}, course {course:03d}, {held.speed[k] / KNOT:.0f} kn; {sizes(regions)}"


def sizes(regions: Mapping[float, Region]) -> str:
    """Return how large the areas are."""
    each = (f"{notation.percent(share)} % {_rounded(region.area / NMI**2)} nmi2" for share, region in regions.items())
    return ", ".join(each)


def _rounded(value: float) -> str:
    """Return an area to two digits: more than that a cloud does not know."""
    return f"{float(f'{value:.2g}'):,.10g}"


def table(found: Regained) -> str:
    """Return the track as CSV."""
    held = found.held
    header = ["time", "detection", "lat", "lon", "course_deg", "speed_kn", "particles"]
    lon, lat = path.degrees(held.place)
    rows: list[list[Any]] = []
    for k, time in enumerate(held.time):
        known = np.isfinite(lat[k])
        numbers = [lat[k], lon[k], np.degrees(held.course[k]) % 360, held.speed[k] / KNOT]
        rows.append([
            notation.iso(moment(found, time)), "yes" if held.detected[k] else "no",
            *(f"{v:.{d}f}" if known else "" for v, d in zip(numbers, (4, 4, 1, 1), strict=True)),
            int(held.count[k]) if known else 0,
        ])  # fmt: skip
    return formats.csv_text(header, rows)


def gpx(found: Regained, run: str) -> str:
    """Return the estimate as a GPX track, in a segment for each time that it was held, and the estimates shown as waypoints."""
    held = found.held
    root = gpx_file.document(held.study.title, f"Estimated track; run {run}")
    lon, lat = path.degrees(held.place)
    known = np.isfinite(lat)
    for time, _ in found.areas:
        k = int(np.flatnonzero(held.time == time)[-1])
        if known[k]:
            name = notation.group(moment(found, time))
            gpx_file.point(root, "wpt", float(lon[k]), float(lat[k]), time=moment(found, time), name=name)
    track = ET.SubElement(root, "trk")
    markup.leaf(track, "name", "estimated track")
    edges = np.flatnonzero(np.diff(known.astype(int))) + 1
    for some in np.split(np.arange(len(known)), edges):
        if known[some[0]]:
            segment = ET.SubElement(track, "trkseg")
            for k in some:
                when = moment(found, held.time[k])
                gpx_file.point(segment, "trkpt", float(lon[k]), float(lat[k]), time=when)
    return markup.text(root)


def areas(found: Regained, attributes: Stamped) -> dict[str, Any]:
    """Return the areas at the times shown as GeoJSON, cut at the antimeridian."""
    features = [
        geojson.feature(
            geojson.polygons(region.outline),
            {
                "time": notation.iso(moment(found, time)),
                "probability": share,
                "area_km2": float(f"{region.area / 1e6:.4g}"),
            },
        )
        for time, regions in found.areas
        for share, region in regions.items()
    ]
    return geojson.collection(features, attributes)


def numbers(found: Regained) -> dict[str, Any]:
    """Return the track at the times shown, for programs."""
    held = found.held
    lon, lat = path.degrees(held.place)
    told = []
    for time, regions in found.areas:
        k = int(np.flatnonzero((held.time == time) & ~held.detected)[-1])
        state = {
            "lat": float(lat[k]), "lon": float(lon[k]), "course_deg": float(np.degrees(held.course[k]) % 360),
            "speed_kn": float(held.speed[k] / KNOT), "particles": int(held.count[k]),
            "area_nmi2": {notation.percent(share): region.area / NMI**2 for share, region in regions.items()},
        } if regions else {}  # fmt: skip
        told.append({"time": notation.iso(moment(found, time)), "held": bool(regions), **state})
    return {"title": held.study.title, "shown": told, "lost": [notation.iso(moment(found, t)) for t in held.lost]}
