"""Lines and outlines of exports: cut at the antimeridian, joined and thinned."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr
from exported import METRES

from drift.apps.export import plotter
from drift.apps.export.finished import Finished
from drift.products.files import geojson, gpx

NMI = 1852.0


@pytest.mark.parametrize("east", [1, -1])
def test_a_line_is_cut_where_it_crosses(east: int) -> None:
    """Halfway in longitude: halfway in latitude and time; a point on the line belongs to both
    sides.
    """
    root, lon = ET.Element("trk"), [179.5, -179.5, -179.0] if east > 0 else [-179.5, 179.5, 179.0]
    times = [
        np.datetime64("2026-06-01T00:00", "ns"),
        np.datetime64("2026-06-01T02:00", "ns"),
        np.datetime64("2026-06-01T03:00", "ns"),
    ]
    gpx.segments(root, lon, [10.0, 20.0, 30.0], times)
    told = [
        [(float(p.get("lon")), float(p.get("lat")), p.findtext("time")) for p in part]
        for part in root
    ]
    ends = (179.9999999, -180.0) if east > 0 else (-180.0, 179.9999999)
    assert told == [
        [(lon[0], 10.0, "2026-06-01T00:00:00Z"), (ends[0], 15.0, "2026-06-01T01:00:00Z")],
        [(ends[1], 15.0, "2026-06-01T01:00:00Z"), (lon[1], 20.0, "2026-06-01T02:00:00Z"), (lon[2], 30.0, "2026-06-01T03:00:00Z")],
    ]  # fmt: skip
    root = ET.Element("trk")
    gpx.segments(root, [179.0, 180.0, -179.0], [0.0, 1.0, 2.0])
    assert [[float(p.get("lon")) for p in part] for part in root] == [
        [179.0, 179.9999999],
        [-180.0, -179.0],
    ]


def test_lines_of_geojson_go_the_short_way_however_they_are_written() -> None:
    for lon in ([179.0, -179.0], [179.0, 181.0], [-181.0, -179.0]):
        found = geojson.lines([shapely.LineString([(lon[0], 0), (lon[1], 2)])])
        assert found["coordinates"] == [
            [[179.0, 0.0], [180.0, 1.0]],
            [[-180.0, 1.0], [-179.0, 2.0]],
        ]


def test_outlines_of_cut_shapes() -> None:
    """A square against 180 degrees, one that the line only touches, and a hole through which it was
    cut twice.
    """
    square = [[179.0, 0.0], [180.0, 0.0], [180.0, 1.0], [179.0, 1.0], [179.0, 0.0]]
    assert list(plotter.open_rings(square)) == [
        [[180.0, 1.0], [179.0, 1.0], [179.0, 0.0], [180.0, 0.0]]
    ]
    touching = [[179.0, 0.0], [180.0, 0.5], [179.0, 1.0], [179.0, 0.0]]
    assert list(plotter.open_rings(touching)) == [touching]
    letter_c = [
        [-180.0, 0],
        [-178, 0],
        [-178, 3],
        [-180, 3],
        [-180, 2],
        [-179, 2],
        [-179, 1],
        [-180, 1],
        [-180, 0],
    ]
    found = list(plotter.open_rings(letter_c))
    assert sorted(map(len, found)) == [4, 4]
    assert [-179, 2] in found[0] or [-179, 2] in found[1]


@pytest.mark.parametrize(
    ("corners", "tolerance"),
    [(1900, 0), (4000, 50), pytest.param(60_000, 500, marks=pytest.mark.thorough)],
)
def test_outlines_are_thinned_and_the_file_says_so(
    tmp_path: Path, corners: int, tolerance: int
) -> None:
    """A ragged circle of 20 nmi at 60 N: no point farther off than is told, in metres by the
    sphere, and fewer than 2,000 of them.
    """
    rng = np.random.default_rng(1)
    turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    metres = 20 * NMI + (
        60 * rng.uniform(-1, 1, corners) if corners < 50_000 else 400 * rng.uniform(-1, 1, corners)
    )
    ring = np.column_stack(
        [4 + metres * np.sin(turn) / METRES / 0.5, 60 + metres * np.cos(turn) / METRES]
    )
    speck = np.array([[3.0, 60.0], [3.0001, 60.0], [3.0001, 60.0001], [3.0, 60.0]])
    rings = [[[*ring.tolist(), ring[0].tolist()]], [speck.tolist()]]
    time = np.array(["2026-06-01T18:00"], "datetime64[ns]")
    names = {
        f"{name}_{axis}": ("time", [float(v)])
        for name in ("mean", "datum")
        for axis, v in (("lon", 4), ("lat", 60))
    }
    data = xr.Dataset(names, {"time": time, "share": [0.5]}, {"title": "t", "run_id": "r"})
    told = {"time": "2026-06-01T18:00:00Z", "level": 0.5, "area_nmi2": 1256.0}
    area = {
        "type": "Feature",
        "properties": told,
        "geometry": {"type": "MultiPolygon", "coordinates": rings},
    }
    (tmp_path / "contours.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [area]})
    )
    contact = {"name": "flare", "kind": "contact", "time": "2026-06-01T12:00:00Z", "belief": 0.7}
    shapes = [
        ("point", {"type": "Point", "coordinates": [4.5, 60.5]}),
        ("line", {"type": "MultiLineString", "coordinates": [[[4.0, 60.0], [4.5, 60.5]]]}),
        ("region", {"type": "Polygon", "coordinates": [[[4, 60], [5, 60], [5, 61], [4, 60]]]}),
    ]
    features = [
        {"type": "Feature", "properties": {**contact, "shape": shape}, "geometry": g}
        for shape, g in shapes
    ]
    (tmp_path / "sorties.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    (text,) = plotter.files(
        Finished(tmp_path, frozenset(["contours.geojson", "sorties.geojson"]), data)
    ).values()
    root = ET.fromstring(text)
    tracks = {
        track.findtext("{*}name"): track
        for track in root.findall("{*}trk")
        if track.findtext("{*}type") == "area"
    }
    (area_track,) = tracks.values()
    lines = [
        [(float(p.get("lon")), float(p.get("lat"))) for p in s]
        for s in area_track.findall("{*}trkseg")
    ]
    assert len(lines) == (2 if tolerance == 0 else 1)  # the speck is no wider than the tolerance
    assert sum(map(len, lines)) <= plotter.MOST
    said = f"their error is up to {tolerance} m"
    assert (said in text.decode()) == (tolerance > 0)
    flat = shapely.LineString(np.array(lines[0]) * (0.5 * METRES, METRES))
    off = shapely.distance(shapely.points(ring * (0.5 * METRES, METRES)), flat).max()
    assert off <= 1.03 * tolerance + 0.2  # the cosine is that of its middle, and digits are rounded
    assert ("flare", 4.5, 60.5) in [
        (p.findtext("{*}name"), float(p.get("lon")), float(p.get("lat")))
        for p in root.findall("{*}wpt")
    ]
    drawn = [
        t.findtext("{*}desc") for t in root.findall("{*}trk") if t.findtext("{*}type") == "contact"
    ]
    assert [words.split(", ")[1] for words in drawn] == ["line", "region"]
