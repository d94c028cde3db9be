"""Stretches of coast that a file names: against an island cut by hand; bad files are one line."""

import json

import numpy as np
import pytest
import shapely
from stretches_of_coast import AROUND, DEGREE, FIJI, ISLAND, check, coast_of, edge_lengths, geojson

from geo.coast import edges, segments, shore
from geo.errors import UserError


@pytest.fixture(scope="module")
def island():
    return coast_of([ISLAND], AROUND)


@pytest.fixture(scope="module")
def fiji():
    return edges.build_coast(shore.read_land("gshhg", FIJI), FIJI)


def test_named_stretches(island, tmp_path):
    """A polygon over the west coast, a line 300 m off the east coast: edges by their midpoints, the
    rest by length.
    """
    path = geojson(
        tmp_path / "beaches.geojson",
        (shapely.box(9.9, -0.1, 10.05, 0.05), {"name": "West  End", "access": "town"}),
        (shapely.LineString([(10.4027, -0.05), (10.4027, 0.05)]), {"name": "East Beach"}),
    )
    cut = segments.read_named_segments(island, path)
    check(island, cut)
    assert cut.name[:2] == ("West End", "East Beach")
    assert cut.access[:3] == ("town", "", "")
    longest = edge_lengths(island).max()
    # each end within half an edge
    assert cut.length[0] == pytest.approx(0.15 * DEGREE, abs=longest)
    assert cut.length[1] == pytest.approx(0.10 * DEGREE, abs=longest)
    assert cut.lines[0].geom_type == cut.lines[1].geom_type == "LineString"
    assert (cut.lon[0], cut.lon[1]) == (pytest.approx(10, abs=1e-6), pytest.approx(10.4, abs=1e-6))
    # What is left are two chains, north and south, each cut by itself.
    south = cut.lat[2:] < -0.05
    for chain in (cut.length[2:][south], cut.length[2:][~south]):
        assert len(chain) == round(chain.sum() / 10_000)
        assert np.ptp(chain) <= 2 * longest


def test_lines_that_compete_share_by_nearness(island, tmp_path):
    path = geojson(
        tmp_path / "two.geojson",
        (shapely.LineString([(10.402, -0.08), (10.402, 0.0)]), {"name": "south"}),
        (
            shapely.MultiLineString(
                [[(10.402, 0.0), (10.402, 0.04)], [(10.402, 0.04), (10.402, 0.08)]]
            ),
            {"name": 7},
        ),
    )
    cut = segments.read_named_segments(island, path)
    check(island, cut)
    assert cut.name[:2] == ("south", "7")
    longest = edge_lengths(island).max()
    assert cut.length[:2] == pytest.approx([0.08 * DEGREE] * 2, abs=longest)
    assert cut.lines[0].bounds[3] == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("turn", [-360, 0])
def test_named_across_the_antimeridian(fiji, tmp_path, turn):
    """A polygon round Taveuni that jumps from 179 to -179, as most programs write it, or leaves
    -180..180.
    """
    x, y = np.array([179.8, -179.7, -179.7, 179.8]), np.array([-17.05, -17.05, -16.6, -16.6])
    ring = shapely.Polygon(np.stack([np.where(x < 0, x, x + turn), y], axis=1))
    cut = segments.read_named_segments(
        fiji, geojson(tmp_path / "t.geojson", (ring, {"name": "Taveuni"}))
    )
    check(fiji, cut)
    whole = shapely.box(179.8, -17.05, 180.3, -16.6)
    edge = edges.shoreline_edges(fiji).astype(np.int64)
    lon = (edge[:, 0] + ((edge[:, 2] - edge[:, 0] + 2**31) % 2**32 - 2**31) / 2) * 360 / 2**32 % 360
    lat = (edge[:, 1] + edge[:, 3]) / 2 * 360 / 2**32
    np.testing.assert_array_equal(cut.of_edge == 0, shapely.intersects_xy(whole, lon, lat))
    assert cut.lines[0].bounds[0] < 180 < cut.lines[0].bounds[2]


def test_a_feature_alone(island, tmp_path):
    path = tmp_path / "one.geojson"
    shape = json.loads(shapely.to_geojson(shapely.box(9.9, -1, 10.2, 1)))
    path.write_text(
        json.dumps({"type": "Feature", "properties": {"name": "west"}, "geometry": shape})
    )
    assert segments.read_named_segments(island, path, 1e6).name[0] == "west"


def test_a_name_of_the_rest_may_be_taken(island, tmp_path):
    taken = segments.read_named_segments(
        island,
        geojson(tmp_path / "a.geojson", (shapely.box(9.9, -1, 10.2, 1), {"name": "x"})),
        1e6,
    ).name[1]
    path = geojson(tmp_path / "b.geojson", (shapely.box(9.9, -1, 10.2, 1), {"name": taken}))
    assert segments.read_named_segments(island, path, 1e6).name == (taken, f"{taken} (2)")


BOX = {"type": "Polygon", "coordinates": [[[10, -1], [10.2, -1], [10.2, 1], [10, 1], [10, -1]]]}


def row(geometry, **properties):
    return {"type": "Feature", "properties": properties, "geometry": geometry}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        ("{broken", "not GeoJSON"),
        ("\x00\xff", "not GeoJSON"),
        ("[" * 100_000, "not GeoJSON"),
        ("[1, 2]", "not a GeoJSON FeatureCollection"),
        (BOX, "not a GeoJSON FeatureCollection"),
        ([], "holds no feature"),
        ([7], "feature 1: is no GeoJSON Feature"),
        ([row(BOX)], "feature 1: has no name"),
        ([row(BOX, name="a"), row(BOX, name=" ")], "feature 2: has no name"),
        ([row(BOX, name=None)], "has no name"),
        ([row(BOX, name="a"), row(BOX, name="a")], 'feature 2: name "a" comes twice'),
        ([row(BOX, name="a", access=3)], '"a": access is 3'),
        ([row(None, name="a")], "feature without geometry"),
        (
            [row({"type": "Point", "coordinates": [10, 0]}, name="a")],
            '"a" is a Point; must be a line or a polygon',
        ),
        ([row({"type": "LineString", "coordinates": [[10, 0]]}, name="a")], '"a"'),
        ([row({"type": "LineString", "coordinates": "here"}, name="a")], '"a"'),
        ([row({"type": "LineString", "coordinates": []}, name="a")], "empty"),
        (
            [row({"type": "LineString", "coordinates": [[500000, 0], [500001, 0]]}, name="a")],
            "must be degrees",
        ),
        (
            [row({"type": "LineString", "coordinates": [[10, 95], [10, 96]]}, name="a")],
            "must be degrees",
        ),
        (
            [row({"type": "Polygon", "coordinates": [[[1, 1], [2, 1], [1, 1], [1, 1]]]}, name="a")],
            "without area",
        ),
        ([row(BOX, name="a"), row(BOX, name="b")], '"b" is taken by other'),
        # Half a degree west of the island, 55.6 km, and 100 m long.
        (
            [row({"type": "LineString", "coordinates": [[9.5, 0], [9.5, 0.001]]}, name="off")],
            r"coast is 55\.6 km",
        ),
        (
            [
                row(
                    {
                        "type": "Polygon",
                        "coordinates": [[[9.4, 0], [9.6, 0], [9.5, 0.01], [9.4, 0]]],
                    },
                    name="off",
                )
            ],
            " km",
        ),
    ],
)
def test_bad_files_are_one_clear_line(island, tmp_path, content, words):
    path = tmp_path / "mine.geojson"
    if isinstance(content, list):
        content = {"type": "FeatureCollection", "features": content}
    if content is not None:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(UserError, match=words) as error:
        segments.read_named_segments(island, path)
    assert "\n" not in str(error.value)
    assert "mine.geojson" in str(error.value)
    assert len(str(error.value)) < 400
