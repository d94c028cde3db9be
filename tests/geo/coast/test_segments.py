"""Segments against pyproj's lengths on the same sphere, shapely, and islands cut by hand."""

import numpy as np
import pytest
import shapely
from shapely.ops import substring
from stretches_of_coast import (
    AROUND,
    ATOL,
    DEGREE,
    EARTH,
    FIJI,
    ISLAND,
    check,
    coast_of,
    edge_lengths,
    geojson,
    rectangle,
)

from geo import notation
from geo.box import Box
from geo.coast import edges, segments, shore
from geo.coast.shore import Shore
from geo.errors import UserError


@pytest.fixture(scope="module")
def island():
    return coast_of([ISLAND], AROUND)


@pytest.fixture(scope="module")
def fiji():
    return edges.build_coast(shore.read_land("gshhg", FIJI), FIJI)


def test_ids_are_the_same_in_every_domain_and_name_what_lies_there():
    """An island whole in two boxes has the same stretches and ids; mainland cut by the edge is
    named by place.
    """
    boxes = Box(9.5, -0.6, 11.0, 0.5), Box(9.0, -0.9, 12.0, 0.9)
    other = rectangle(11.2, 0.3, 11.6, 0.5, 0.0099)
    one, two = (
        segments.cut_coast(coast_of(shapes, box))
        for shapes, box in zip(([ISLAND], [other, ISLAND]), boxes, strict=True)
    )
    assert len(set(two.id)) == len(two.id)
    assert set(one.id) < set(two.id)
    assert one.id != two.id[: len(one.id)]  # their numbers differ
    for number, name in enumerate(one.id):
        same = segments.segment_of_id(two, name)
        assert (two.lon[same], two.lat[same], two.length[same]) == pytest.approx(
            (one.lon[number], one.lat[number], one.length[number])
        )
    mainland = shapely.segmentize(shapely.box(5.0, -2.0, 10.4, 0.1), 0.0099)
    boxes = Box(9.5, -0.6, 11.0, 0.5), Box(9.17, -0.83, 11.0, 0.5)
    narrow, wide = (segments.cut_coast(coast_of([mainland], box)) for box in boxes)
    assert not set(narrow.id) <= set(wide.id)
    for number, name in enumerate(narrow.id):
        there = segments.segment_of_id(wide, name)
        assert shapely.dwithin(
            wide.lines[there], shapely.Point(narrow.lon[number], narrow.lat[number]), 1e-4
        )
    assert segments.segment_of_id(one, "stretch 1") is None
    assert segments.segment_of_id(one, "u4pruydqq") is None  # Denmark


def test_a_real_mainland_has_the_same_stretches_in_every_domain():
    """Brittany in a box and in one that reaches farther: what differs lies near the edge of the
    smaller box.
    """
    small, large = Box(-5.5, 47.5, -2.0, 49.2), Box(-6.4, 46.8, -0.2, 50.1)
    narrow, wide = (
        segments.cut_coast(edges.build_coast(shore.read_land("gshhg", box), box))
        for box in (small, large)
    )
    shared = {name: number for number, name in enumerate(wide.id)}
    inner = [
        k for k in range(len(narrow.id)) if -4.9 < narrow.lon[k] < -2.8 and narrow.lat[k] > 47.75
    ]
    assert len(inner) > 100
    assert max(narrow.length[inner]) > 8000
    for k in inner:
        same = shared[narrow.id[k]]
        assert wide.length[same] == pytest.approx(narrow.length[k], abs=ATOL)
        assert wide.name[same] == narrow.name[k]
    assert any(narrow.id[k] not in shared for k in range(len(narrow.id)))


def test_an_island_by_hand(island):
    """Perimeter 2 (0.4 cos(lat) + 0.25) degrees = 144.55 km, between two landmarks: stretches of
    9.6 km, as whole edges allow.
    """
    cut = segments.cut_coast(island)
    check(island, cut)
    around = 2 * 0.25 * DEGREE + 0.4 * DEGREE * (np.cos(np.deg2rad(0.15)) + np.cos(np.deg2rad(0.1)))
    assert cut.length.sum() == pytest.approx(around, rel=1e-6)  # vertices are rounded to 9 mm
    assert len(cut.name) == 15
    longest = edge_lengths(island).max()
    # both ends lie within half an edge of where they should
    assert np.abs(cut.length - around / 15).max() <= longest
    assert all(line.geom_type == "LineString" for line in cut.lines)  # each runs on without a gap
    assert set(cut.access) == {""}
    merged = shapely.line_merge(shapely.union_all(cut.lines))
    assert merged.is_ring
    assert shapely.hausdorff_distance(merged, ISLAND.exterior) < 1e-7


def test_half_of_a_segment_lies_on_each_side_of_its_midpoint(island):
    cut = segments.cut_coast(island, 30_000)
    for k in range(len(cut.name)):
        where = cut.lines[k].project(shapely.Point(cut.lon[k], cut.lat[k]))
        first = substring(cut.lines[k], 0, where)
        # a chord is no great circle
        assert EARTH.geometry_length(first) == pytest.approx(cut.length[k] / 2, rel=1e-4)


def test_names_are_positions(island):
    cut = segments.cut_coast(island, 200_000)
    # The only midpoint: opposite the south-west corner, where the ring begins, so at the north-east
    # one.
    assert cut.name == ("00-06.0N 010-24.0E",)
    assert notation.position(-87.5, -28.7) == "28-42.0S 087-30.0W"
    assert notation.position(190.0, 59.99999) == "60-00.0N 170-00.0W"


@pytest.mark.parametrize("length", [3000.0, 11_000.0])
def test_between_landmarks_and_up_to_the_box_lengths_are_within_an_eighth(length):
    """A straight coast of 3,300 km that the box cuts at both ends, with edges of 110 m: no landmark
    lies near an end.
    """
    coast = coast_of(
        [shapely.segmentize(shapely.box(-5.0, -2.0, 35.0, 0.1), 0.00099)], Box(0.3, -0.4, 30.0, 0.5)
    )
    cut = segments.cut_coast(coast, length)
    assert np.abs(cut.length - length).max() < length / 8 + edge_lengths(coast).max()


@pytest.mark.parametrize("length", [500.0, 10_000.0])
def test_stretches_do_not_depend_on_the_order_of_the_land(length):
    """Skerries of Norway, those that are taken together among them, with their polygons shuffled:
    ids, and names by id.
    """
    box = Box(5.0, 60.2, 5.6, 60.7)
    land = shore.read_land("gshhg", box)
    shuffled = land.polygons[np.random.default_rng(1).permutation(len(land.polygons))]
    one, two = (
        segments.cut_coast(edges.build_coast(Shore(polygons, "test", box=box), box), length)
        for polygons in (land.polygons, shuffled)
    )
    assert sum("islets" in name for name in one.name) > 10 or length < 1000
    assert dict(zip(one.id, one.name, strict=True)) == dict(zip(two.id, two.name, strict=True))


def test_equal_edges_are_shared_out_the_same_beside_another_island():
    """A square of long edges that were halved: where an edge's middle lies on a boundary, last bits
    decided.
    """
    west, south, side = 11.06, 45.04, 0.31
    square = shapely.box(west, south, west + side, south + side)
    triangle = shapely.Polygon([(6.13, 44.71), (6.50, 44.76), (6.24, 45.00)])
    alone = segments.cut_coast(coast_of([square], Box(9.4, 43.4, 13.2, 47.1)), 3000.0)
    beside = segments.cut_coast(coast_of([triangle, square], Box(5.3, 43.4, 13.2, 47.1)), 3000.0)
    assert set(alone.id) < set(beside.id)


@pytest.mark.parametrize("turn", [1, 17, 60])
def test_stretches_do_not_depend_on_where_a_ring_begins(island, turn):
    points = shapely.get_coordinates(ISLAND)[:-1]
    other = segments.cut_coast(coast_of([shapely.Polygon(np.roll(points, turn, axis=0))], AROUND))
    assert other.name == segments.cut_coast(island).name


def test_a_ring_cut_by_the_box_is_one_chain():
    """Only the south lies in the grid; the file's ring begins there, so its edges come as two runs
    of numbers.
    """
    middle = np.roll(shapely.get_coordinates(ISLAND)[:-1], -20, axis=0)
    for points in (shapely.get_coordinates(ISLAND), middle):
        built = coast_of([shapely.Polygon(points)], Box(9.5, -0.6, 11.0, -0.05))
        cut = segments.cut_coast(built, 1e6)
        check(built, cut)
        assert [line.geom_type for line in cut.lines] == ["LineString"]
        assert not cut.lines[0].is_ring


def test_islets_are_taken_together():
    """Twenty islets of 0.9 km round in one square of 10 km, as many in another, one larger island
    on its own.
    """
    rng = np.random.default_rng(3)
    places = np.concatenate(
        [rng.uniform((x, 0.01), (x + 0.06, 0.07), (20, 2)) for x in (0.02, 5.05)]
    )
    blocks = [shapely.box(x, y, x + 0.002, y + 0.002) for x, y in places]
    land = shapely.get_parts(shapely.union_all([*blocks, rectangle(2, 0.5, 2.03, 0.52, 0.005)]))
    built = coast_of(land, Box(-1, -1, 6, 1))
    cut = segments.cut_coast(built)
    check(built, cut)
    assert len(cut.name) == 3
    assert sorted(name.split(" near ")[0] for name in cut.name if " near " in name) == [
        "islets",
        "islets",
    ]
    ours = sorted(shapely.get_num_geometries(cut.lines).tolist())
    assert ours[0] == 1
    assert sum(ours[1:]) == len(land) - 1


def test_long_edges_leave_no_empty_segment():
    built = coast_of([shapely.box(1, 1, 2, 1.5)], Box(0, 0, 3, 2))
    cut = segments.cut_coast(built, 1000)
    check(built, cut)
    assert len(cut.name) > 150  # of 333 km: edges are 2.4 km long at most, and not split
    assert cut.length.max() < 2500


def test_equal_names_are_told_apart():
    blocks = [shapely.box(x, 1, x + 1e-4, 1 + 1e-4) for x in (1, 1.0003)]
    built = coast_of(blocks, Box(0, 0, 2, 2))
    cut = segments.cut_coast(built, 20)
    check(built, cut)
    names = [cut.name[k] for k in np.argsort(cut.id)]  # counted in the order of ids
    assert names[:3] == [names[0], f"{names[0]} (2)", f"{names[0]} (3)"]


def test_no_coast(tmp_path):
    built = coast_of([], AROUND)
    cut = segments.cut_coast(built)
    assert (cut.name, cut.length.size, cut.of_edge.size, len(cut.lines)) == ((), 0, 0, 0)
    assert segments.nearest_segment(cut, built, 10.0, 0.0) == (-1, np.inf)
    path = geojson(tmp_path / "some.geojson", (shapely.box(10, 0, 10.1, 0.2), {"name": "nowhere"}))
    with pytest.raises(UserError, match="no coast"):
        segments.read_named_segments(built, path)


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan, np.inf])
def test_lengths_that_are_none(island, length):
    with pytest.raises(ValueError, match="more than 0"):
        segments.cut_coast(island, length)


@pytest.mark.parametrize("box", [FIJI, Box(4.5, 60, 6.5, 61.5), Box(-91, 28.5, -88.5, 30.5)])
def test_real_coasts(box):
    built = edges.build_coast(shore.read_land("gshhg", box), box)
    cut = segments.cut_coast(built)
    check(built, cut)
    alone = np.array([" near " not in name for name in cut.name])
    # Each runs on without a gap, and is between half and one and a half of what was asked, give or
    # take an edge.
    assert all(line.geom_type == "LineString" for line in cut.lines[alone])
    longest = np.zeros(len(cut.name))
    np.maximum.at(longest, cut.of_edge, edge_lengths(built))
    assert (cut.length[alone] > 5000 - longest[alone]).all()
    assert (cut.length[alone] < 15_000 + longest[alone]).all()
    # Between landmarks, which are at least four stretches apart, it is within an eighth.
    assert np.median(cut.length[alone]) == pytest.approx(10_000, rel=1 / 8)
    assert alone.sum() > 20


def test_taveuni_is_one_ring_across_the_antimeridian(fiji):
    cut = segments.cut_coast(fiji, 120_000)  # its perimeter by shapely and pyproj
    on_both = [k for k, line in enumerate(cut.lines) if line.bounds[0] < 180 < line.bounds[2]]
    rings = [
        cut.lines[k]
        for k in on_both
        if cut.lines[k].geom_type == "LineString" and cut.lines[k].is_ring
    ]
    assert any(shapely.Polygon(ring).contains(shapely.Point(180, -16.9)) for ring in rings)
    west, _, east, _ = shapely.total_bounds(cut.lines)
    assert west > 177
    assert east < 183


@pytest.mark.thorough
def test_nearest_against_brute_force(fiji):
    """The nearest of points every 20 m along all lines: at 1 km or more from the shore, 10 m aside
    add 5 cm.
    """
    cut = segments.cut_coast(fiji)
    points, owner = shapely.get_coordinates(
        shapely.segmentize(cut.lines, 20 / DEGREE), return_index=True
    )
    rng = np.random.default_rng(5)
    tested = 0
    for lon, lat in zip(rng.uniform(178.2, 181.8, 15), rng.uniform(-17.8, -15.2, 15), strict=True):
        metres = EARTH.inv(
            points[:, 0], points[:, 1], *np.broadcast_arrays(lon, lat, points[:, 0])[:2]
        )[2]
        if metres.min() < 1000:
            continue
        tested += 1
        segment, distance = segments.nearest_segment(cut, fiji, (lon + 180) % 360 - 180, lat)
        assert distance == pytest.approx(metres.min(), abs=0.1)
        assert metres[owner == segment].min() < metres.min() + 0.1
    assert tested > 7


def test_far_north_the_sphere_tells_which_is_nearest():
    """By a plane the island 20 degrees east is farther than the one to the north; by the great
    circle it is nearer.
    """
    east, north = shapely.box(20.0, 79.99, 20.01, 80.0), shapely.box(-0.01, 83.465, 0.01, 83.475)
    built = coast_of([east, north], Box(-5, 79, 25, 85))
    cut = segments.cut_coast(built)
    away = [EARTH.inv(0.0, 80.0, 20.0, 80.0)[2], EARTH.inv(0.0, 80.0, 0.0, 83.465)[2]]
    assert away[0] < away[1] < 20 * np.cos(np.radians(80.0)) * DEGREE
    segment, distance = segments.nearest_segment(cut, built, 0.0, 80.0)
    assert distance == pytest.approx(away[0], abs=1.0)
    assert shapely.get_coordinates(cut.lines[segment])[:, 0].min() > 19


def test_nearest_from_both_sides_of_180(fiji):
    cut = segments.cut_coast(fiji)
    here, there = (
        segments.nearest_segment(cut, fiji, 180.0, -17.2),
        segments.nearest_segment(cut, fiji, -180.0, -17.2),
    )
    assert here == (there[0], pytest.approx(there[1], abs=1e-6))
    west, east = (
        segments.nearest_segment(cut, fiji, 179.9999, -17.2),
        segments.nearest_segment(cut, fiji, -179.9999, -17.2),
    )
    assert west[1] == pytest.approx(east[1], abs=30)  # the two lie 21 m apart
