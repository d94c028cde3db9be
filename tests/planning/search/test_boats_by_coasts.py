"""Paths of boats on the coast of Norway against Shapely: no metre on land, arrival in time, legs
round the coast, shallow water.
"""

import itertools
import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely
import shapely.affinity
import xarray as xr
from flat_sea import AT, degrees, local
from shapely.ops import substring

from drift.case.record import Depth
from drift.planning.search.boats import courses, seas
from drift.planning.search.boats.depth import shoals
from geo import sphere
from geo.box import Box
from geo.coast import shore
from geo.errors import UserError

GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
OFF = seas.CLEAR + seas.ROUNDING + seas.SKIN  # [m] from land at which ways turn
BASE, OUT = (4.95, 60.60), (4.55, 60.72)


@pytest.fixture(scope="module")
def norway() -> np.ndarray:
    """The coast between Bergen and the open sea, full resolution."""
    return shore.read_land("gshhg", Box(3.9, 59.9, 6.2, 61.2)).polygons


def boat(**more: object) -> courses.Unit:
    """Return a boat based among the skerries."""
    told = {
        "name": "boat", "kind": "Boat", "base": BASE, "return_to": BASE, "ready": np.datetime64("2026-06-01T06:00"),
        "search_speed": 8.0, "transit_speed": 12.0, "endurance": 3e4, "law": None, "sweep_width": (1852.0,),
    }  # fmt: skip
    return courses.Unit(**{**told, **more})  # type: ignore[arg-type]


@pytest.mark.thorough
@pytest.mark.parametrize("keeps", [pytest.param(0.0, marks=pytest.mark.thorough), 200.0])
def test_no_metre_on_land_among_skerries(norway: np.ndarray, keeps: float) -> None:
    places = np.array([OUT, (4.75, 60.42)])
    course, _ = courses.prepare(boat(clear_of_land=keeps), lambda box: norway, places)
    assert course is not None
    out, home = courses.out_and_home(course, OUT, (4.75, 60.42))
    plane = local((4.9, 60.6))
    assert courses.out_and_home(course, OUT, (4.75, 60.42)) == (out, home)
    assert home[-1] == pytest.approx(out[0], abs=1e-9)
    for way, far in ((out, OUT), (home, (4.75, 60.42))):
        assert courses.on_land(norway, *np.array(way).T) == 0
        length = sum(GEOD.inv(*a, *b)[2] for a, b in itertools.pairwise(way))
        straight = GEOD.inv(*BASE, *far)[2]
        assert 1.01 * straight < length < (2.0 if keeps else 1.5) * straight
        there = course.sea.flat(*np.array([far]).T)
        assert length <= courses.distances(course, course.out, there)[0] + 1
        # distance from the shore, in a plane of pyproj's round the middle
        some = norway[shapely.intersects(norway, shapely.box(4.2, 60.2, 5.5, 61.0))]
        land = shapely.transform(some, lambda p: np.column_stack(plane(*p.T)))
        close = course.out.close
        sailed = np.array(way if way is out else way[::-1])
        x, y = sphere.track(*np.radians(sailed.T), 200.0)
        line = shapely.LineString(np.column_stack(plane(np.degrees(x), np.degrees(y))))
        inner = substring(line, close + 1, line.length)
        assert shapely.distance(inner, land).min() > max(keeps, seas.CLEAR) - 1
        assert (close > 0) == (keeps > 0)


@pytest.mark.thorough
def test_arrival_is_never_early_and_hardly_late(norway: np.ndarray) -> None:
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(4.5, 4.9, 12), rng.uniform(60.45, 60.7, 12)])
    course, _ = courses.prepare(boat(), lambda box: norway, places)
    assert course is not None
    told = course.arrival(*np.radians(places.T))
    ways = [courses.way(course, course.out, tuple(place)) for place in places]
    assert sum(way is not None for way in ways) >= 8  # others are on islands
    for way, far in zip(ways, told, strict=True):
        if way is not None:
            length = sum(GEOD.inv(*a, *b)[2] for a, b in itertools.pairwise(way))
            assert length <= far * (1 + 1e-6) + 2 * course.sea.step
            assert far < 1.04 * length + 2 * course.sea.step


@pytest.mark.thorough
def test_a_base_far_from_the_sea_is_refused_and_one_near_it_is_not(norway: np.ndarray) -> None:
    with pytest.raises(
        ValueError,
        match=r"no route by sea leads from 60-30.0N 005-57.0E .* nmi away; at most 1 nmi is allowed",
    ):
        courses.prepare(
            boat(base=(5.95, 60.50), return_to=(5.95, 60.50)), lambda box: norway, np.array([OUT])
        )
    quay = (4.9713, 60.5532)  # on land
    course, _ = courses.prepare(boat(base=quay), lambda box: norway, np.array([OUT]))
    assert course is not None
    assert 0 < course.out.ashore < courses.HARBOUR


@pytest.mark.thorough
def test_legs_are_cut_at_the_coast_and_sailed_round_it() -> None:
    islet = shapely.Polygon([(-520, -320), (360, -568), (504, 280), (-164, 608)])
    shapes = [islet, shapely.box(4000, -9000, 9000, 9000)]
    polygons = np.array([degrees(shape) for shape in shapes])
    place = local()(-9000.0, 3000.0, inverse=True)
    base = (float(place[0]) % 360, float(place[1]))
    course, said = courses.prepare(
        boat(base=base, return_to=base), lambda box: polygons, np.array([AT, (AT[0] + 0.2, AT[1])])
    )
    assert course is not None
    assert said == ""
    east, north = (
        np.array([-6000, 6000, 6000, -6000, -6000, 6000]),
        np.array([-200, -200, 400, 400, 3000, 3000]),
    )
    lon, lat = local()(east, north, inverse=True)
    lon, lat = AT[0] + (np.asarray(lon) - AT[0] + 180) % 360 - 180, np.asarray(lat)
    (made,) = courses.sail(course, [(lon, lat)], 8.0, 12.0)
    assert made is not None
    assert made.cut == (0, 1, 2, 4)  # legs into the eastern land too; the cross leg in it is gone
    # What is told of a search is the same in company: reversed, on land, and out of the region
    inland = lon[0] + (lon[1] - lon[0]) * np.array([0.93, 0.99])
    several = [(lon[::-1], lat[::-1]), (inland, lat[:2]), (lon, lat + 5), (lon, lat)]
    (back,), *others, same = (
        courses.sail(course, several[:1], 8.0, 12.0),
        *courses.sail(course, several, 8.0, 12.0),
    )
    assert back is not None
    np.testing.assert_array_equal(back.elapsed, others[0].elapsed)
    np.testing.assert_array_equal(same.elapsed, made.elapsed)
    assert others[1:] == [None, None]
    assert courses.on_land(polygons, made.lon, made.lat) == 0
    x, y = local()(made.lon, made.lat)
    pattern = shapely.LineString(np.column_stack([east, north]))
    steps = np.hypot(np.diff(x), np.diff(y))
    sought = 0.0
    for k, seeks in enumerate(made.searching):
        piece = shapely.LineString([(x[k], y[k]), (x[k + 1], y[k + 1])])
        if seeks:
            sought += steps[k]
            assert (
                shapely.hausdorff_distance(piece, shapely.intersection(piece.buffer(5), pattern))
                < 6
            )
        lasts = made.elapsed[k + 1] - made.elapsed[k]
        assert (
            steps[k] / (8.0 if seeks else 12.0)
            <= lasts * (1 + 1e-5)
            < steps[k] / (8.0 if seeks else 12.0) + 1.01
        )
    grown = shapely.union_all([shape.buffer(OFF) for shape in shapes])
    want = shapely.difference(pattern, grown).length
    assert want * (1 - 0.005) < sought < want * (1 + 1e-3)  # corners are mitred, not round
    # An island round which it takes longer than what lies behind it would take to search: that is
    # left out, and said
    wide = np.array(
        [degrees(shape) for shape in (shapely.affinity.scale(islet, 2.5, 2.5), shapes[1])]
    )
    less, _ = courses.prepare(
        boat(base=base, return_to=base), lambda box: wide, np.array([AT, (AT[0] + 0.2, AT[1])])
    )
    assert less is not None
    (made,) = courses.sail(less, [(lon, lat)], 8.0, 12.0)
    assert made is not None
    assert made.cut == (0, 1, 2, 4)
    assert made.searching.tolist() == [True, False, True, True, True]


@pytest.mark.parametrize(("positive", "sign"), [("down", 1.0), (None, -1.0)])
def test_a_boat_keeps_out_of_shallow_water(
    tmp_path: Path, positive: str | None, sign: float
) -> None:
    """A ridge 1 m deep across the straight way, with a gap 6 m deep to the north; a boat of 3 m
    goes through it, one of 0.5 m over it.
    """
    x, y = np.arange(-14_000, 14_001, 500.0), np.arange(-9000, 9001, 500.0)
    # A grid on longitude and latitude; at 0.1 degrees from its middle it is the plane of the test
    # to some metres
    lon, lat = (
        AT[0] + np.degrees(x / sphere.RADIUS) / math.cos(math.radians(AT[1])),
        AT[1] + np.degrees(y / sphere.RADIUS),
    )
    depth = np.full((len(y), len(x)), 30.0)
    depth[:, np.abs(x - 1000) < 900] = 1.0
    depth[(y > 4000) & (y < 7000), :] = 6.0
    name = "depth" if positive else "elevation"
    data = xr.Dataset(
        {name: (("lat", "lon"), (sign * depth).astype(np.float32))},
        {"lat": lat, "lon": (lon + 180) % 360 - 180},
    )
    data.to_netcdf(tmp_path / "depths.nc")
    source = Depth(str(tmp_path / "depths.nc"), None, positive)  # type: ignore[arg-type]
    middle = local()(-9000.0, 200.0, inverse=True)
    base, goal = (float(middle[0]) % 360, float(middle[1])), AT[0] + 0.1
    islet = np.array([degrees(shapely.Point(-3000, -6000).buffer(300))])
    ways = {}
    for draught in (0.5, 3.0):
        course, _ = courses.prepare(
            boat(base=base, return_to=base, draught=draught), lambda box: islet, np.array([(goal, AT[1])]),
            lambda box, most=draught: shoals(source, box, most),
        )  # fmt: skip
        assert course is not None
        way = courses.way(course, course.out, (goal, AT[1]))
        assert way is not None
        ways[draught] = np.array(local()(*way.T))
    assert ways[0.5].shape == (2, 2)
    over = np.abs(ways[3.0][0] - 1000) < 1300
    # Between the points of the grid it is as shallow as the shallower: no gap within 500 m of the
    # ridge's rows
    assert np.all((ways[3.0][1][over] > 4450) & (ways[3.0][1][over] < 7000))
    with pytest.raises(
        UserError, match=r'depths.nc": no variable "z"; those on its latitude and longitude: '
    ):
        shoals(Depth(source.file, "z"), Box(179.0, -42.0, 181.0, -41.0), 3.0)
