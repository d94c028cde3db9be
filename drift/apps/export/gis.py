"""A finished result as GeoJSON (RFC 7946) for a GIS: the files of the run that are there, checked,
and positions by time.
"""

import json
from typing import Any

from drift.apps.export.finished import Finished, Release
from drift.products.files import geojson
from geo import notation

COPIED = ("sorties.geojson", "plan.geojson", "washup.geojson", "patrols.geojson")


def files(run: Finished) -> dict[str, bytes]:
    """Return areas.geojson and positions.geojson at the outputs that are wanted, and what else the
    run has as GeoJSON.
    """
    about = {"title": run.title, "run_id": run.run, "description": run.words}
    areas = [geojson.feature(geometry, told) for _, _, geometry, told in run.areas()]
    points = [
        geojson.feature(geojson.point(lon, lat), {"kind": name, "time": notation.iso(time)})
        for name in ("datum", "mean")
        for time, lon, lat in run.positions(name)
    ]
    made = {"areas.geojson": _text(areas, about), "positions.geojson": _text(points, about)}
    for name in COPIED:
        if features := run.search() if name == "sorties.geojson" else run.features(name):
            made[name] = _text(features, about)
    return made


def release_files(run: Release) -> dict[str, bytes]:
    """Return origin.geojson: areas of the release, its mean, and the finds."""
    about = {"title": run.title, "run_id": run.run, "description": run.words}
    return {"origin.geojson": _text(run.features(), about)}


def _text(features: list[dict[str, Any]], about: dict[str, str]) -> bytes:
    return json.dumps(geojson.collection(features, about), allow_nan=False, indent=1).encode()
