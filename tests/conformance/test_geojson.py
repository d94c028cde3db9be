"""Every GeoJSON file by the rules of RFC 7946, with which GDAL must be able to read it."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyogrio
import pytest

pytestmark = pytest.mark.conformance

FILES = ("plan/contours.geojson", "plan/sorties.geojson", "plan/plan.geojson", "spill/contours.geojson",
         "spill/washup.geojson", "origin/origin.geojson")  # fmt: skip
DEPTH = {
    "Point": 0,
    "MultiPoint": 1,
    "LineString": 1,
    "MultiLineString": 2,
    "Polygon": 2,
    "MultiPolygon": 3,
}


def positions(coordinates: Any, depth: int) -> list[list[float]]:
    if depth == 0:
        return [coordinates]
    return [position for part in coordinates for position in positions(part, depth - 1)]


def rings(geometry: dict[str, Any]) -> list[tuple[bool, list[list[float]]]]:
    """Return (is it an outer one, ring) of polygons."""
    parts = {"Polygon": [geometry["coordinates"]], "MultiPolygon": geometry["coordinates"]}.get(
        geometry["type"], []
    )
    return [(k == 0, ring) for part in parts for k, ring in enumerate(part)]


def lines(geometry: dict[str, Any]) -> list[list[list[float]]]:
    parts = {"LineString": [geometry["coordinates"]], "MultiLineString": geometry["coordinates"]}
    return parts.get(geometry["type"], [])


def test_all_are_looked_at(written: Path) -> None:
    assert {str(path.relative_to(written)) for path in written.glob("*/*.geojson")} == set(FILES)


@pytest.mark.parametrize("file", FILES)
def test_rfc_7946(written: Path, file: str) -> None:
    text = (written / file).read_text(encoding="utf-8")
    found = json.loads(text)
    assert found["type"] == "FeatureCollection"
    assert "crs" not in found  # section 4
    assert not found.keys() & {"coordinates", "geometries", "geometry", "properties"}  # section 7.1
    assert found["features"]
    for feature in found["features"]:
        assert feature["type"] == "Feature"
        assert isinstance(feature["properties"], dict)
        geometry = feature["geometry"]
        places = positions(geometry["coordinates"], DEPTH[geometry["type"]])
        assert places
        for place in places:
            assert len(place) == 2
            assert -180 <= place[0] <= 180
            assert -90 <= place[1] <= 90
        # section 3.1.6: closed, four positions, the outer one anticlockwise
        for outer, ring in rings(geometry):
            assert len(ring) >= 4
            assert ring[0] == ring[-1]
            twice = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(_near(ring)))
            assert twice > 0 if outer else twice < 0
        for line in [*lines(geometry), *(ring for _, ring in rings(geometry))]:
            assert len(line) >= 2
            # section 3.1.9: cut at the antimeridian
            assert all(abs(a[0] - b[0]) <= 180 for a, b in pairwise(line))
    _, _, shapes, _ = pyogrio.raw.read(written / file)
    assert len(shapes) == len(found["features"])


def _near(ring: list[list[float]]) -> list[list[float]]:
    """Return a ring about its first corner, where products of coordinates lose no digits."""
    return [[x - ring[0][0], y - ring[0][1]] for x, y in ring]


def test_shapes_lie_on_both_sides(written: Path) -> None:
    """The case of the plan is made so."""
    for file in FILES[:3]:
        found = json.loads((written / file).read_text())["features"]
        every = [
            p[0]
            for f in found
            for p in positions(f["geometry"]["coordinates"], DEPTH[f["geometry"]["type"]])
        ]
        assert min(every) < -179 < 179 < max(every), file
