"""report.html: the leaves of a run and their files, in one page that loads nothing from outside.

The map is OpenLayers, shipped as published. The page's Content-Security-Policy allows its own
scripts, by their digests, and no connections. Text from a case is stored in JSON and is inserted as
text, never as markup.
"""

import base64
import hashlib
import html
import json
import math
import re
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from drift.products.files import formats, geojson
from drift.products.maps import gazetteer
from drift.products.maps.imprint import Setting
from drift.products.report import leaves as records
from drift.products.report import packed
from drift.products.report.leaves import Leaf
from geo import notation, sphere
from geo.array import Array
from geo.box import Box

SCRIPTS = (
    "ol.js",
    "unpack.js",
    "projection.js",
    "graticule.js",
    "looks.js",
    "tables.js",
    "layers.js",
    "page.js",
)
STYLES = ("ol.css", "page.css")
# types of files that the page contains
CARRIED = {".geojson", ".csv", ".txt", ".toml", ".gpx", ".kml", ".json"}
PICTURE = 2_500_000  # [bytes] of a picture in the page; a larger one is a link
LARGEST = 4_000_000  # [characters] of a packed file in the page; a larger one is a link
MERCATOR_UP_TO = 75.0  # [deg] latitude, as the charts of drift.products.maps.chart
FINE = 1 / 6000  # detail of the shoreline, as a share of the map's size
FINEST = 1e-4  # [deg]
PLACES = 40  # most towns and harbours
AROUND = 0.5  # land beyond each side of the map, as a share of its size


def write(path: Path, leaves: Sequence[Leaf], on: Setting, warnings: Sequence[str]) -> None:
    """Write report.html next to the run's other files.

    Args:
        path: the page's file, in the folder of the results.
        leaves: items of the page.
        on: title, land and starting positions of the run.
        warnings: warnings at the top of the page.
    """
    folder = path.parent
    box = _box(leaves, on, folder)
    leaves = [*leaves, _places(box)]
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    embedded, beside = _files(folder, {name for leaf in leaves for name in _files_of_leaf(leaf)})
    content = {
        "title": on.imprint.title,
        "caution": on.imprint.caution,
        "warnings": list(warnings),
        "source": on.imprint.footer,
        "attributes": {name: summary[name] for name in ("run_id", "versions", "date_created")},
        "opens": None if on.opens is None else int(notation.epochs(on.opens)),
        "projection": _projection(box),
        "land": packed.packed_text(json.dumps(_land(on, box), separators=(",", ":")).encode()),
        "leaves": list(leaves),
        "files": embedded,
        "pictures": _pictures(folder),
        "beside": beside,
    }
    data = formats.json_text(content, separators=(",", ":"))
    path.write_text(_fill_page(on.imprint.title, data), encoding="utf-8", newline="\n")


def _places(box: Box) -> Leaf:
    """Return a leaf with the names of towns and harbours."""
    drawn = [
        geojson.feature(geojson.point(place.lon, place.lat), {"name": place.name})
        for place in gazetteer.places_in_box(
            box.grown(0.3 * (box.east - box.west), 0.3 * (box.north - box.south)), PLACES
        )
    ]
    return records.features_leaf("Towns and harbours", drawn, "place", label="name")


def _files_of_leaf(leaf: Leaf) -> list[str]:
    """Return the files of the run that a leaf needs."""
    graded = leaf.get("graded") or {}
    return [name for name in (leaf.get("file"), graded.get("file")) if name]


def _box(leaves: Sequence[Leaf], on: Setting, folder: Path) -> Box:
    """Return the box of the whole page: its maps, framed shapes, and starting positions."""
    around = on.marks[0].lon if on.marks else None
    places: list[Array] = [np.array([[mark.lon, mark.lat] for mark in on.marks]).reshape(-1, 2)]
    places += [np.column_stack([line.lon, line.lat]) for line in on.lines]
    for leaf in leaves:
        if leaf["leaf"] == "maps":
            axes = [
                leaf[name]["first"] + leaf[name]["step"] * np.array([0, leaf[name]["size"]])
                for name in ("lon", "lat")
            ]
            around = float(axes[0].mean())
            places.append(np.column_stack(axes))
        elif leaf.get("features") and leaf.get("frame"):
            places += [_coordinates(one["geometry"]["coordinates"]) for one in leaf["features"]]
        elif leaf.get("frame"):
            shapes = shapely.from_geojson((folder / leaf["file"]).read_text(encoding="utf-8"))
            places.append(shapely.get_coordinates(shapes))
    points = np.concatenate(places)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return Box(-180.0, -60.0, 180.0, 60.0)
    lon = sphere.near_degrees(points[:, 0], float(points[0, 0]) if around is None else around)
    west, east = float(lon.min()), float(lon.max())
    if east - west >= 360:
        west, east = -180.0, 180.0
    return Box(west, float(points[:, 1].min()), east, float(points[:, 1].max()))


def _coordinates(nested: Any) -> Array:
    """Return the points of nested GeoJSON coordinates, shape (n, 2)."""
    points = [nested]
    while points and isinstance(points[0][0], (list, tuple)):
        points = [part for parts in points for part in parts if part]
    return np.array(points, float).reshape(-1, 2)


def _projection(box: Box) -> dict[str, Any]:
    """Return the projection of the page's map, as in drift.products.maps.chart."""
    lon, lat = (box.west + box.east) / 2, (box.south + box.north) / 2
    is_mercator = (
        max(abs(box.south), abs(box.north)) <= MERCATOR_UP_TO and box.east - box.west < 180
    )
    extent = [box.west, box.south, box.east, box.north]
    return {
        "kind": "mercator" if is_mercator else "azimuthal",
        "lon": sphere.wrap_degrees(lon),
        "lat": lat,
        "extent": extent,
    }


def _land(on: Setting, box: Box) -> list[list[list[int]]]:
    """Return rings of land around the map.

    Each point is the difference from the previous one, in whole steps of FINEST degrees.
    """
    high, wide = box.north - box.south, box.east - box.west
    grown = Box(
        box.west - AROUND * wide,
        max(box.south - AROUND * high, -90.0),
        box.east + AROUND * wide,
        min(box.north + AROUND * high, 90.0),
    )
    if grown.east - grown.west >= 360:
        grown = Box(-180.0, grown.south, 180.0, grown.north)
    shapes = np.array(list(on.polygons(grown)), dtype=object)
    if not len(shapes):
        return []
    fine = max(FINEST, max(high, wide * math.cos(math.radians((box.south + box.north) / 2))) * FINE)
    middle = (grown.west + grown.east) / 2
    rings = []
    for turn in (-360, 0, 360):
        cut = shapely.clip_by_rect(
            shapes, grown.west + turn, grown.south, grown.east + turn, grown.north
        )
        cut = shapely.simplify(cut, fine, preserve_topology=False)
        parts = shapely.get_parts(shapely.get_parts(cut))
        for part in parts[~shapely.is_empty(parts)]:
            if part.geom_type == "Polygon":
                found = [
                    np.array(ring.coords) - (turn, 0) for ring in (part.exterior, *part.interiors)
                ]
                rings.append([_steps(ring - (middle, 0)) for ring in found])
    return rings


def _steps(ring: Array) -> list[int]:
    steps = np.rint(ring / FINEST).astype(np.int64)
    return np.diff(steps, axis=0, prepend=np.zeros((1, 2), np.int64)).ravel().tolist()


def _files(folder: Path, needed: set[str]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the files in the page, and those next to it, without pictures.

    needed: files that leaves need, which the page contains whatever their size.
    """
    embedded, beside = {}, []
    for path in sorted(folder.iterdir()):
        size = path.stat().st_size
        if path.suffix == ".png" and size <= PICTURE:
            continue
        if path.suffix in CARRIED and path.name != "manifest.json":
            packed_text = packed.packed_text(path.read_bytes())
            if path.name in needed or len(packed_text) <= LARGEST:
                embedded[path.name] = {"bytes": size, "data": packed_text}
                continue
        beside.append({"name": path.name, "bytes": size})
    return embedded, beside


def _pictures(folder: Path) -> dict[str, str]:
    """Return pictures by name as base64, for the page to show without their files."""
    shown = (path for path in sorted(folder.glob("*.png")) if path.stat().st_size <= PICTURE)
    return {path.name: base64.b64encode(path.read_bytes()).decode() for path in shown}


@cache
def _asset(name: str) -> str:
    return (
        resources.files("drift.products.report")
        .joinpath("assets", name)
        .read_text(encoding="utf-8")
    )


def _script(name: str) -> str:
    """Return a script that can be embedded in a page."""
    text = re.sub(r"^//# sourceMappingURL=.*$", "", _asset(name), flags=re.MULTILINE)
    return text.replace("</script", "<\\/script")


def _fill_page(title: str, data: str) -> str:
    """Return the page with its styles, scripts and data filled in."""
    scripts = [_script(name) for name in SCRIPTS]
    digests = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'"
        for s in scripts
    )
    policy = (
        f"default-src 'none'; script-src {digests}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
    parts = {
        "policy": policy,
        "title": html.escape(title),
        "styles": "\n".join(f"<style>{_asset(name)}</style>" for name in STYLES),
        "data": data.replace("<", "\\u003c")
        .replace("\u2028", "\\u2028")
        .replace("\u2029", "\\u2029"),
        "scripts": "\n".join(f"<script>{script}</script>" for script in scripts),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _asset("page.html"))
