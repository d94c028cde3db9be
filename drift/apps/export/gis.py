"""GeoJSON (RFC 7946) export for a GIS: checked files of the run, and positions by time."""

import json
from typing import Any

from drift.apps.export.finished import Finished, Release
from drift.products.files import geojson
from geo import notation

COPIED = ("sorties.geojson", "plan.geojson", "washup.geojson", "patrols.geojson")


def files(run: Finished) -> dict[str, bytes]:
    """Return areas.geojson and positions.geojson, and the run's other GeoJSON files."""
    attributes = {"title": run.title, "run_id": run.run, "description": run.words}
    areas = [geojson.feature(geometry, properties) for _, _, geometry, properties in run.areas()]
    points = [
        geojson.feature(geojson.point(lon, lat), {"kind": name, "time": notation.iso(time)})
        for name in ("datum", "mean")
        for time, lon, lat in run.positions(name)
    ]
    contents = {
        "areas.geojson": _text(areas, attributes),
        "positions.geojson": _text(points, attributes),
    }
    for name in COPIED:
        if features := run.search() if name == "sorties.geojson" else run.features(name):
            contents[name] = _text(features, attributes)
    return contents


def release_files(run: Release) -> dict[str, bytes]:
    """Return origin.geojson: release areas, mean position and finds."""
    attributes = {"title": run.title, "run_id": run.run, "description": run.words}
    return {"origin.geojson": _text(run.features(), attributes)}


def _text(features: list[dict[str, Any]], attributes: dict[str, str]) -> bytes:
    return json.dumps(geojson.collection(features, attributes), allow_nan=False, indent=1).encode()
