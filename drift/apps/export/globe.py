"""KML 2.2 export for Google Earth and others: areas, datum, track, search and plan by time.

Areas differ in outline width, opacity and name, not in colour alone.
"""

import io
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import shapely

from drift.apps.export.finished import Finished, Release
from drift.products.files import geojson, kml, markup
from geo import notation

INK = "ff7a2f00"  # aabbggrr, a dark blue; the smallest area is the most opaque
FILLS = ("b0", "70", "38", "1c")  # opacity, from the smallest area to the largest; then the last
WIDTHS = ("4", "2.5", "1.5", "1")
DARK, GREY = "ff202020", "ff707070"
# name, description, begin and end, style, geometry
Place = tuple[str, str, tuple[str, str], str, dict[str, Any]]
ARCHIVE_DATE = (
    1980,
    1,
    1,
    0,
    0,
    0,
)  # fixed date in the archive, so that equal runs give equal bytes


def kml_files(run: Finished) -> dict[str, bytes]:
    """Return forecast.kml."""
    return {"forecast.kml": _document(run).encode()}


def kmz_files(run: Finished) -> dict[str, bytes]:
    """Return forecast.kmz: the content of forecast.kml, compressed."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        entry = zipfile.ZipInfo("doc.kml", ARCHIVE_DATE)
        entry.compress_type = zipfile.ZIP_DEFLATED
        archive.writestr(entry, _document(run))
    return {"forecast.kmz": packed.getvalue()}


def _document(run: Finished) -> str:
    root, document = kml.document(run.title, run.words)
    for k in range(len(run.shares)):
        opacity, width = (row[min(k, len(row) - 1)] for row in (FILLS, WIDTHS))
        kml.style(document, f"area{k}", INK, width, fill=f"{opacity}{INK[2:]}")
    kml.style(document, "track", DARK, "2")
    kml.style(document, "legs", GREY, "1.5")
    kml.style(document, "field", GREY, "2", fill="00ffffff")
    days: dict[str, ET.Element] = {}
    spans = _spans(run.forecast["time"].values)
    for time, share, geometry, properties in run.areas():
        day = notation.iso(time)[:10]
        if day not in days:
            days[day] = kml.folder(document, f"Forecast {day}")
        name = f"{notation.hundredths(share)} % {notation.format_dtg(time)}"
        description = (
            f"{run.words}. {notation.hundredths(share)} % area of "
            f"{properties['area_nmi2']:,.1f} nmi2"
        )
        kml.append_place(
            days[day],
            name,
            description,
            spans[notation.iso(time)],
            f"area{run.shares.index(share)}",
            geometry,
        )
    _tracks(document, run, spans)
    _search(document, run)
    _plan(document, run)
    for title, places in (("Coast", _coast), ("Patrols", _patrols), ("Finds", _finds)):
        listed = list(places(run))
        if listed:
            folder = kml.folder(document, title)
        for place in listed:
            kml.append_place(folder, *place)
    return markup.document_text(root)


def release_files(run: Release) -> dict[str, bytes]:
    """Return origin.kml: the area where a spill may have been released, its mean, and the finds."""
    root, document = kml.document(run.title, run.words)
    kml.style(document, "area0", INK, WIDTHS[0], fill=f"{FILLS[0]}{INK[2:]}")
    kml.style(document, "area1", INK, WIDTHS[1], fill=f"{FILLS[2]}{INK[2:]}")
    times = run.data["time"].values
    span = notation.iso(times.min()), notation.iso(times.max())
    areas = sorted(
        (f for f in run.features() if f["properties"]["kind"] == "area"),
        key=lambda f: -float(f["properties"]["level"] or 0),
    )
    folder = kml.folder(document, "Release")
    for feature in areas:  # the smallest comes last, so that it is drawn on top
        properties = feature["properties"]
        percent = notation.hundredths(float(properties["level"] or 0))
        description = (
            f"{run.words}. {percent} % area of {float(properties['area_nmi2'] or 0):,.1f} nmi2"
        )
        kml.append_place(
            folder,
            f"{percent} % of the release",
            description,
            span,
            f"area{int(feature is not areas[-1])}",
            feature["geometry"],
        )
    for feature in run.features():
        properties = feature["properties"]
        if properties["kind"] != "area":
            name = (
                "mean position"
                if properties["kind"] == "mean"
                else f"find {properties.get('number', '')} {properties.get('name', '')}"
            )
            kml.append_place(folder, name.strip(), run.words, span, "", feature["geometry"])
    return {"origin.kml": markup.document_text(root).encode()}


def _spans(times: Any) -> dict[str, tuple[str, str]]:
    """Return the interval in which each output is shown, up to a second before the next output."""
    ends = [*(times[1:] - np.timedelta64(1, "s")), times[-1]]
    return {
        notation.iso(a): (notation.iso(a), notation.iso(b))
        for a, b in zip(times, ends, strict=True)
    }


def _tracks(document: ET.Element, run: Finished, spans: Mapping[str, tuple[str, str]]) -> None:
    """Append the datum and the mean position: a place at each output, and the track of both."""
    for name, words in (("datum", "Datum (mean of those adrift)"), ("mean", "Mean position")):
        points = run.positions(name)
        if not points:
            continue
        folder = kml.folder(document, words)
        for time, lon, lat in points:
            description = f"{words} {notation.position(lon, lat)}. {run.words}"
            title = f"{name} {notation.format_dtg(time)}"
            kml.append_place(
                folder, title, description, spans[notation.iso(time)], "", geojson.point(lon, lat)
            )
        if len(points) > 1:
            track = geojson.lines([shapely.LineString([(lon, lat) for _, lon, lat in points])])
            span = notation.iso(points[0][0]), notation.iso(points[-1][0])
            kml.append_place(folder, f"{name}, track", run.words, span, "track", track)


def _search(document: ET.Element, run: Finished) -> None:
    """Append a folder for each sortie, look and contact."""
    folders: dict[str, ET.Element] = {}
    features = run.search()
    if features:
        parent = kml.folder(document, "Search")
    for feature in features:
        properties = feature["properties"]
        name = str(properties.get("name") or properties["kind"])
        if name not in folders:
            folders[name] = kml.folder(parent, name)
        begin = str(
            properties.get("start")
            or properties.get("time")
            or notation.iso(run.forecast["time"].values[0])
        )
        facts = [
            f"{properties['kind']} {name}",
            *(
                f"{k.upper()} {notation.percent(float(properties[k]))}"
                for k in ("poc", "pod", "pos")
                if properties.get(k)
            ),
        ]
        style = "legs" if properties["shape"] == "legs" else "field"
        span = (begin, str(properties.get("end") or begin))
        kml.append_place(
            folders[name],
            f"{name} {properties['shape']}",
            ", ".join(facts),
            span,
            style,
            feature["geometry"],
        )


def _plan(document: ET.Element, run: Finished) -> None:
    """Append a folder for each unit's task of a plan."""
    folders: dict[str, ET.Element] = {}
    features = run.features("plan.geojson")
    if features:
        parent = kml.folder(document, "Plan")
    for feature in features:
        properties = feature["properties"]
        name = f"{properties['area']} {properties['unit']}"
        if name not in folders:
            folders[name] = kml.folder(parent, name)
        in_transit = properties["shape"] == "transit"
        span = (
            (properties["takeoff"], properties["home"])
            if in_transit
            else (properties["on_scene"], properties["off_scene"])
        )
        description = (
            f"{name}: on scene {properties['on_scene']} to {properties['off_scene']}, "
            f"POS {notation.percent(properties['pos'])}"
        )
        style = {"area": "field", "csp": ""}.get(properties["shape"], "legs")
        kml.append_place(
            folders[name],
            f"{properties['area']} {properties['shape']}",
            description,
            span,
            style,
            feature["geometry"],
        )


def _coast(run: Finished) -> Iterator[Place]:
    """Yield the stretches of coast that a spill reaches, by rank, shown all the time."""
    times = run.forecast["time"].values
    span = notation.iso(times[0]), notation.iso(times[-1])
    for feature in run.features("washup.geojson"):
        properties = feature["properties"]
        description = (
            f"{properties['position']}, {properties['access']}, {properties['length_km']:.1f} "
            f"km: {properties['number_10']:.0f} to {properties['number_90']:.0f} objects at the "
            "end (10 "
            f"to 90 %), {properties['expected']:.3g} on average, probability of any "
            f"{notation.percent(properties['probability'])}, that any ever comes "
            f"{notation.percent(properties['ever'])}"
        )
        name = f"{properties['rank']}  {properties['name']}"
        description = f"{properties.get('stretch_id') or ''} {description}".strip()
        yield name, description, span, "track", feature["geometry"]


def _patrols(run: Finished) -> Iterator[Place]:
    """Yield the stretches of each patrol of a plan, from the time of the patrol on."""
    for feature in run.features("patrols.geojson"):
        properties = feature["properties"]
        description = (
            f"{properties['patrol_unit']}, {properties['time']}: {properties['stretch']} "
            f"({properties['stretch_id']}), {properties['length_km']:.1f} km, "
            f"finds {properties['found']:.2g} on average"
        )
        name = f"{properties['patrol_unit']} {properties['stretch_id']}"
        yield name, description, _span_to_end(run, properties["time"]), "legs", feature["geometry"]


def _finds(run: Finished) -> Iterator[Place]:
    """Yield each find of a spill, from its time on."""
    for row in run.rows("finds.csv"):
        odd = "UNLIKELY, check it: " if row["odd"] == "yes" else ""
        description = (
            f"{odd}{row['name']}, {row['position']}, {row['stretch']}, {row['class'] or 'class unknown'}, by {row['by']}; chance of a find there "
            f"{notation.percent(float(row['probability_beforehand']))}, there or at less likely places {notation.percent(float(row['tail']))}; not from this spill: "
            f"{notation.percent(float(row['none_of_ours']))}"
        )
        point = geojson.point(float(row["lon_deg"]), float(row["lat_deg"]))
        name = f"find {row['number']} {row['name']}{' (odd)' if odd else ''}"
        yield name, description, _span_to_end(run, row["time"]), "", point


def _span_to_end(run: Finished, time: str) -> tuple[str, str]:
    """Return the span from a time to the end of the forecast."""
    return time, max(time, notation.iso(run.forecast["time"].values[-1]))
