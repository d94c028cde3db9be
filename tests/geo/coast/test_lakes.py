"""Lakes of shorelines: against shapely."""

import json

import numpy as np
import pytest
import shapely
from places import DATA

from geo import sphere
from geo.box import Box
from geo.coast import edges, gshhg, shore
from geo.errors import UserError
from kernels.runtime import runtime
from kernels.step import coast as crossing

BOX = Box(-1, -1, 5, 4)
HOLED = shapely.Polygon(
    shapely.box(0, 0, 4, 3).exterior,
    [shapely.box(1, 1, 2, 2).exterior, shapely.box(2.5, 0.5, 3, 2.5).exterior],
)
ISLE = shapely.box(1.4, 1.4, 1.6, 1.6)
LAKE = shapely.difference(shapely.box(1, 1, 2, 2), ISLE)  # a lake with an island


@pytest.fixture(autouse=True)
def _taichi():
    runtime.start()


def write(path, *shapes):
    path.write_text(shapely.to_geojson(shapely.GeometryCollection(shapes)))
    return path


def records(*shapes_and_kinds):
    lines = []
    for shape, kind in shapes_and_kinds:
        points = shapely.get_coordinates(shape.exterior)
        lines += [f'"a","{kind}",{len(points)}', *(f"{x!r},{y!r}" for x, y in points.tolist())]
    return "\n".join(lines)


def same_land(land, expected):
    """Whether two sets of polygons cover the same place."""
    return shapely.symmetric_difference(
        shapely.union_all(land.polygons), expected
    ).area == pytest.approx(0, abs=1e-9)


def test_inner_rings_are_land_unless_asked_for(tmp_path):
    path = write(tmp_path / "land.geojson", HOLED, ISLE)
    land = shore.read_land(path, BOX)
    assert same_land(land, shapely.box(0, 0, 4, 3))
    assert any("2 inner rings" in note and "are land" in note for note in land.notes)
    wet = shore.read_land(path, BOX, lakes=True)
    assert same_land(wet, shapely.union(HOLED, ISLE))
    assert any("2 lakes of the shoreline are water" in note for note in wet.notes)
    points = sphere.to_binary([(1.2, 1.2), (1.5, 1.5), (2.7, 1.0), (0.5, 0.5)])
    np.testing.assert_array_equal(
        edges.is_land(edges.build_coast(land, BOX), *points.T), [True, True, True, True]
    )
    np.testing.assert_array_equal(
        edges.is_land(edges.build_coast(wet, BOX), *points.T), [False, True, False, True]
    )


def test_a_sea_between_several_polygons_is_no_lake(tmp_path):
    """Land cut into four tiles round a sea: no polygon has an inner ring, and the sea stays."""
    ring = shapely.difference(shapely.box(0, 0, 4, 3), shapely.box(1, 1, 3, 2))
    halves = (shapely.box(0, 0, 2, 3), shapely.box(2, 0, 4, 3))
    path = write(tmp_path / "tiles.geojson", *(shapely.intersection(ring, half) for half in halves))
    land = shore.read_land(path, BOX)
    assert same_land(land, ring)
    assert not land.notes


@pytest.mark.parametrize("lakes", [False, True])
def test_lakes_of_a_bna_are_water(tmp_path, lakes):
    path = tmp_path / "land.bna"
    path.write_text(records((shapely.box(0, 0, 4, 3), 1), (shapely.box(1, 1, 2, 2), 2)))
    land = shore.read_land(path, BOX, lakes=lakes)
    assert same_land(land, shapely.difference(shapely.box(0, 0, 4, 3), shapely.box(1, 1, 2, 2)))
    assert [note for note in land.notes if "lake" in note] == ["1 lakes of the shoreline are water"]


def test_no_lakes_where_they_were_asked_for_is_said(tmp_path):
    land = shore.read_land(write(tmp_path / "land.geojson", ISLE), BOX, lakes=True)
    assert any("the shoreline holds none" in note for note in land.notes)


def test_a_file_of_lakes_is_cut_out(tmp_path):
    """A lake with an island, one half on the shore, one of another continent: shapely's difference."""
    land = write(tmp_path / "land.geojson", HOLED)
    bay, far = shapely.box(3.5, -0.5, 4.5, 0.5), shapely.box(50, 50, 51, 51)
    lakes = write(tmp_path / "lakes.geojson", LAKE, bay, far)
    cut = shore.read_land(land, BOX, lakes=lakes)
    assert same_land(cut, shapely.difference(shapely.box(0, 0, 4, 3), shapely.union(LAKE, bay)))
    assert any("2 lakes of lakes.geojson" in note for note in cut.notes)
    assert "land.geojson (sha256" in cut.source
    assert "lakes lakes.geojson (sha256" in cut.source
    other = write(tmp_path / "far.geojson", far)
    same = shore.read_land(land, BOX, lakes=other)
    assert same_land(same, shapely.box(0, 0, 4, 3))
    assert any("none of the 1 lakes of far.geojson" in note for note in same.notes)


def test_lakes_are_cut_out_of_gshhg_after_its_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("DRIFT_CACHE", str(tmp_path / "cache"))
    island = shapely.box(0, 0, 4, 3)
    monkeypatch.setattr(gshhg, "_read_package", lambda: np.array([island]))
    lakes = write(tmp_path / "lakes.geojson", LAKE)
    for _ in range(2):
        assert same_land(
            shore.read_land("gshhg", BOX, lakes=lakes), shapely.difference(island, LAKE)
        )
        assert same_land(shore.read_land("gshhg", BOX), island)


def test_a_lake_across_the_antimeridian(tmp_path):
    """Land that leaves 180, lakes cut at 180: water on both sides, and no shore along the cut."""
    land = write(tmp_path / "land.geojson", shapely.box(178, 10, 182, 13))
    lakes = write(
        tmp_path / "lakes.geojson", shapely.box(179, 11, 180, 12), shapely.box(-180, 11, -179.5, 12)
    )
    box = Box(177, 9, 183, 14)
    cut = shore.read_land(land, box, lakes=lakes)
    assert same_land(
        cut, shapely.difference(shapely.box(178, 10, 182, 13), shapely.box(179, 11, 180.5, 12))
    )
    built = edges.build_coast(cut, box)
    lon, lat = sphere.to_binary([179.5, 180, -180, -179.7, -179.3]), sphere.to_binary([11.5] * 5)
    np.testing.assert_array_equal(
        edges.is_land(built, lon, lat), [False, False, False, False, True]
    )
    assert not (edges.shoreline_edges(built)[:, [0, 2]] == -(2**31)).all(axis=1).any()


def test_a_bna_of_lakes(tmp_path):
    """Of a shoreline with its lakes, the lakes; of a file without type 2, all."""
    land = write(tmp_path / "land.geojson", shapely.box(0, 0, 4, 3))
    first, second = shapely.box(1, 1, 2, 2), shapely.box(2.5, 0.5, 3, 2.5)
    lakes = tmp_path / "lakes.bna"
    lakes.write_text(records((second, 1), (first, 2)))
    assert same_land(
        shore.read_land(land, BOX, lakes=lakes), shapely.difference(shapely.box(0, 0, 4, 3), first)
    )
    lakes.write_text(records((second, 1), (first, 1)))
    assert same_land(shore.read_land(land, BOX, lakes=lakes), HOLED)


def test_lakes_that_cross_themselves_or_overlap(tmp_path):
    land = write(tmp_path / "land.geojson", shapely.box(0, 0, 4, 3))
    bow = {"type": "Polygon", "coordinates": [[[1, 1], [2, 2], [2, 1], [1, 2], [1, 1]]]}
    block = json.loads(shapely.to_geojson(shapely.box(1.5, 0.5, 2.5, 1.5)))
    path = tmp_path / "lakes.geojson"
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": [bow, block]}))
    cut = shore.read_land(land, BOX, lakes=path)
    water = [
        shapely.Polygon([(1, 1), (1.5, 1.5), (1, 2)]),
        shapely.Polygon([(2, 2), (1.5, 1.5), (2, 1)]),
    ]
    water.append(shapely.box(1.5, 0.5, 2.5, 1.5))
    assert same_land(cut, shapely.difference(shapely.box(0, 0, 4, 3), shapely.union_all(water)))
    assert any("1 of 2 lakes" in note and "repaired" in note for note in cut.notes)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("gone.geojson", None, "no such file"),
        ("broken.geojson", '{"type": "Poly', "cannot be read"),
        ("line.geojson", '{"type": "LineString", "coordinates": [[0, 0], [1, 1]]}', "no polygon"),
        ("empty.geojson", '{"type": "FeatureCollection", "features": []}', "no polygon"),
        ("text.bna", "hello\n", "line 1"),
        ("metres.bna", '"1","2",3\n500000,6700000\n600000,6700000\n500000,6800000\n', "degrees"),
    ],
)
def test_bad_lakes_are_one_clear_line(tmp_path, name, content, words):
    land, path = write(tmp_path / "land.geojson", HOLED), tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(UserError, match=f"^lakes .*{words}") as error:
        shore.read_land(land, BOX, lakes=path)
    assert "\n" not in str(error.value)
    assert name in str(error.value)


@pytest.mark.parametrize(
    ("source", "lakes", "words"),
    [
        ("gshhg", True, "GSHHG as installed holds no lakes; name a file"),
        ("none", True, "no land"),
        ("none", "x", "no land"),
    ],
)
def test_lakes_that_cannot_be_had(source, lakes, words):
    with pytest.raises(UserError, match=words) as error:
        shore.read_land(source, BOX, lakes=lakes)
    assert "\n" not in str(error.value)


def test_lakes_of_louisiana_on_gshhg():
    """NOAA's lakes, cut out of GSHHG: Maurepas is water, as it is in NOAA's own shoreline."""
    path = DATA / "louisiana" / "LA_shoreline.bna"
    if not path.exists():
        pytest.skip(f"no {path}: set DRIFT_DATA")
    box = Box(-90.9, 30.0, -90.0, 30.5)
    lake = sphere.to_binary([-90.499, 30.257])
    assert edges.is_land(edges.build_coast(shore.read_land("gshhg", box), box), *lake)
    land = shore.read_land("gshhg", box, lakes=path)
    assert not edges.is_land(edges.build_coast(land, box), *lake)
    assert any("lakes of LA_shoreline.bna" in note for note in land.notes)


def test_a_box_on_the_open_ocean():
    """GSHHG without land in the box: no polygon, no edge, all water, no lake to cut, nothing
    refused.
    """
    box = Box(-140.4, 29.5, -138.2, 31.1)
    land = shore.read_land("gshhg", box)
    assert land.polygons.size == 0
    built = edges.build_coast(land, box)
    assert edges.shoreline_edges(built).shape == (0, 4)
    assert not edges.is_land(
        built, sphere.to_binary([-140.0, -139.0]), sphere.to_binary([30.0, 31.0])
    ).any()
    device = crossing.upload(built)
    found = crossing.crossings(
        device, sphere.to_binary([-140.0]), sphere.to_binary([30.0]), [2**24], [-(2**22)]
    )
    assert not found.hit[0]


def test_lakes_where_no_land_is(tmp_path):
    land = write(tmp_path / "land.geojson", shapely.box(50, 0, 51, 1))
    lakes = write(tmp_path / "lakes.geojson", LAKE)
    assert shore.read_land(land, BOX, lakes=lakes).polygons.size == 0
