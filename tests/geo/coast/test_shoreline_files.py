"""Files of shorelines: real ones, what is repaired, and what is rejected in one line."""

import json

import numpy as np
import pytest
import shapely
import xarray as xr
from coast_steps import square
from places import DATA

from geo import sphere
from geo.box import Box
from geo.coast import edges, shore
from geo.errors import UserError
from kernels.runtime import runtime
from kernels.step import coast as crossing


@pytest.fixture(autouse=True)
def _taichi():
    runtime.start()


def data(name):
    path = DATA / name
    if not path.exists():
        pytest.skip(f"no {path}: set DRIFT_DATA")
    return path


@pytest.mark.parametrize(
    ("name", "box", "wet", "dry"),
    [
        ("louisiana/LA_shoreline.bna", Box(-92, 28, -88, 31), (-90.10, 30.20), (-91.15, 30.45)),
        ("washington/wa_coast.bna", Box(-126, 46.6, -123.6, 49), (-125.0, 47.5), (-123.9, 47.7)),
    ],
)
def test_noaa_shoreline(name, box, wet, dry):
    land = shore.read_land(data(name), box)
    assert any("map bounds" in note for note in land.notes)
    built = edges.build_coast(land, box)
    points = sphere.to_binary([wet, dry])
    np.testing.assert_array_equal(edges.is_land(built, points[:, 0], points[:, 1]), [False, True])
    # the frame of the map is not land
    assert not edges.is_land(built, *sphere.to_binary([box.west, box.south]))
    if "louisiana" in name:
        assert any("10 lakes" in note for note in land.notes)
        lake = sphere.to_binary([-90.499, 30.257])  # Lake Maurepas, a record of type 2
        assert not edges.is_land(built, *lake)


def test_self_crossing_shoreline_is_repaired(tmp_path):
    bow = {"type": "Polygon", "coordinates": [[[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]]}
    path = tmp_path / "bow.geojson"
    path.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": bow}))
    land = shore.read_land(path, Box(-1, -1, 3, 3))
    assert any("1 of 1" in note and "repaired" in note for note in land.notes)
    built = edges.build_coast(land, Box(-1, -1, 3, 3))
    lon, lat = sphere.to_binary([0.5, 1.5, 1.0, 1.0]), sphere.to_binary([1.0, 1.0, 0.5, 1.5])
    np.testing.assert_array_equal(edges.is_land(built, lon, lat), [True, True, False, False])


def test_overlapping_polygons_are_joined(tmp_path):
    path = tmp_path / "two.geojson"
    path.write_text(
        shapely.to_geojson(shapely.MultiPolygon([square(0, 0, 2, 1), square(1, 0.5, 3, 2)]))
    )
    built = edges.build_coast(shore.read_land(path, Box(-1, -1, 4, 3)), Box(-1, -1, 4, 3))
    assert edges.is_land(built, *sphere.to_binary([1.5, 0.75]))


def test_shapefile_in_metres(tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    # UTM 32 N, so 9 E
    x, y = 500_000 + np.array([0, 60_000, 60_000]), 6_700_000 + np.array([0, 0, 40_000])
    ring = shapely.Polygon(np.stack([x, y], 1))
    pyogrio.raw.write(
        tmp_path / "utm.shp",
        np.array([shapely.to_wkb(ring)]),
        [],
        [],
        geometry_type="Polygon",
        crs="EPSG:32632",
    )
    land = shore.read_land(tmp_path / "utm.shp", Box(8, 59, 12, 62))
    assert any("UTM" in note for note in land.notes)
    west, south, _, _ = shapely.total_bounds(land.polygons)
    assert west == pytest.approx(9.0, abs=1e-6)
    assert 60.3 < south < 60.5


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("gone.bna", None, "no such file"),
        ("text.bna", "hello\n", "line 1"),
        ("short.bna", '"1","1",4\n0,0\n1,1\n', "needs 4 lines"),
        ("nan.bna", '"1","1",3\n0,0\n1,nan\n1,1\n', "needs 3 lines"),
        ("line.bna", '"1","1",-3\n0,0\n1,0\n1,1\n', "no land polygon"),
        ("metres.bna", '"1","1",3\n500000,6700000\n600000,6700000\n500000,6800000\n', "degrees"),
        ("empty.geojson", '{"type": "FeatureCollection", "features": []}', "no land polygon"),
        (
            "line.geojson",
            '{"type": "LineString", "coordinates": [[0, 0], [1, 1]]}',
            "no land polygon",
        ),
        ("broken.geojson", '{"type": "Poly', "cannot be read"),
        ("broken.shp", "nothing", "cannot be read"),
    ],
)
def test_bad_shoreline_is_one_clear_line(tmp_path, name, content, words):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(UserError, match=words) as error:
        shore.read_land(path, Box(0, 0, 2, 2))
    assert "\n" not in str(error.value)
    assert name in str(error.value)


def test_a_shoreline_elsewhere_is_said(tmp_path):
    path = tmp_path / "far.bna"
    path.write_text('"1","1",3\n50,0\n51,0\n51,1\n')
    assert any("none of its land" in note for note in shore.read_land(path, Box(0, 0, 2, 2)).notes)


def test_buoy_lands_on_hopen():
    """UIB-2022-TILL-01 went ashore on 2022-10-18 between 20:00 and 20:30 UTC: its track's one and
    only crossing.
    """
    with xr.open_dataset(data("barents/barents.nc")) as file:
        buoy = file.isel(trajectory=file.drifter_names.values.tolist().index("UIB-2022-TILL-01"))
        fixed = ~np.isnat(buoy.time.values)
        time = buoy.time.values[fixed].astype("datetime64[s]")
        lon, lat = (
            sphere.to_binary(buoy.lon.values[fixed]),
            sphere.to_binary(buoy.lat.values[fixed]),
        )
    box = Box(16, 74, 31, 78)
    device = crossing.upload(edges.build_coast(shore.read_land("gshhg", box), box))
    afloat = np.flatnonzero(crossing.wet(device, lon[:-1], lat[:-1]))
    found = crossing.crossings(
        device, lon[afloat], lat[afloat], (lon[1:] - lon[:-1])[afloat], (lat[1:] - lat[:-1])[afloat]
    )
    first = np.flatnonzero(found.hit)[0]
    i = afloat[first]
    landing = time[i] + (time[i + 1] - time[i]) * float(found.fraction[first])
    assert np.datetime64("2022-10-18T20:00") < landing < np.datetime64("2022-10-18T20:31")
    assert crossing.wet(device, lon[: i + 1], lat[: i + 1]).all()
    assert sphere.to_degrees(found.lon[first]) == pytest.approx(25.107, abs=0.002)
