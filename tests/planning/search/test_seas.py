"""Paths of boats against closed forms and brute force on polygons."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pyproj
import pytest
import shapely
import shapely.affinity
from flat_sea import AT, degrees
from scipy.sparse import csgraph

from drift.planning.search.boats import courses, seas
from drift.planning.search.planning_tracks import Plane
from geo import sphere

GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
OFF = seas.CLEAR + seas.ROUNDING + seas.SKIN  # [m] from land at which ways turn


def sea(shapes: list[shapely.Polygon], ends: np.ndarray, keeps: float = 0.0) -> seas.Sea:
    """Return the sea round places [m] among islands [m]."""
    plane = Plane(*np.radians(AT))
    made = seas.build_sea(
        [degrees(shape) for shape in shapes], seas.region(plane, ends, 9_000.0), keeps
    )
    assert made is not None
    return made


def by_grid(where: seas.Sea, begin: np.ndarray, end: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the distance on the nodes, and the way that is pulled taut."""
    start = seas.nearest_visible_node(where, np.where(where.open.ravel(), 0.0, np.inf), begin)
    far, before = seas.distances(where, start)
    last = seas.nearest_visible_node(where, far, end)
    way = np.concatenate([begin[None], seas.along(where, before, last), end[None]])
    return seas.length(where, way), seas.pulled_taut(where, way)


BEGIN, END = np.array([-11_300.0, -1_900.0]), np.array([9_700.0, 2_300.0])


def round_a_circle(r: float) -> float:
    """Return the shortest way from BEGIN to END round a circle of a radius [m] about the origin:
    two tangents and an arc.
    """
    a, b = np.hypot(*BEGIN), np.hypot(*END)
    between = math.acos(np.dot(BEGIN, END) / (a * b))
    arc = between - math.acos(r / a) - math.acos(r / b)
    return math.sqrt(a * a - r * r) + math.sqrt(b * b - r * r) + r * arc


def round_a_wall(off: float) -> float:
    """Return the way round the nearer end of a thin wall from (0, -20 km) to (0, 4 km): past its
    end, `off` beyond it.
    """
    tip = [np.array([side, 4000.0 + off]) for side in (-50.0 - off, 50.0 + off)]
    return float(
        np.hypot(*(tip[0] - BEGIN)) + np.hypot(*(tip[1] - tip[0])) + np.hypot(*(END - tip[1]))
    )


def through_a_gap(off: float) -> float:
    """Return the way through a gap from 700 to 1500 m north in a wall: the straight line passes
    south of it, and turns once.
    """
    edge = np.array([-50.0 - off, 700.0 + off])
    return float(np.hypot(*(edge - BEGIN)) + np.hypot(*(END - edge)))


def out_of_a_bay(off: float) -> float:
    """Return the way out of a bay that is open to the west, BEGIN within, to END in the east: round
    its southern arm.
    """
    south = [np.array([x, -3_200.0 - off]) for x in (-14_000.0 - off,)]
    tip = [
        np.array([-14_000.0 - off, -2_800.0 + off]),
        *south,
        np.array([-6_000.0 + off, -3_200.0 - off]),
    ]
    way = [BEGIN, *tip, END]
    return float(sum(np.hypot(*(b - a)) for a, b in itertools.pairwise(way)))


WALL = shapely.box(-50, -20_000, 50, 4000)
GAP = [shapely.box(-50, -20_000, 50, 700), shapely.box(-50, 1500, 50, 20_000)]
BAY = [shapely.Polygon([(-14_000, -3200), (-6000, -3200), (-6000, 6800), (-14_000, 6800), (-14_000, 6400), (-6400, 6400),
                        (-6400, -2800), (-14_000, -2800)])]  # fmt: skip
CIRCLE = [shapely.Point(0, 0).buffer(4000.0, quad_segs=90)]


@pytest.mark.parametrize(
    ("shapes", "length"),
    [(CIRCLE, lambda off: round_a_circle(4000.0 + off)), ([WALL], round_a_wall), (GAP, through_a_gap), (BAY, out_of_a_bay)],
)  # fmt: skip
def test_ways_are_as_long_as_geometry_says(
    shapes: list[shapely.Polygon], length: Callable[[float], float]
) -> None:
    """Between the way that keeps CLEAR from land and the one that turns OFF it, whose corners are
    mitred: sqrt(2) farther out at most.
    """
    where = sea(shapes, np.array([BEGIN, END]))
    found, way = by_grid(where, BEGIN, END)
    assert (
        length(seas.CLEAR) * (1 - 1e-5)
        < seas.length(where, way)
        < length(OFF * math.sqrt(2)) * (1 + 1e-4)
    )
    assert seas.length(where, way) <= found + 1e-6
    place = where.round(way)
    assert courses.on_land(np.array([degrees(shape) for shape in shapes]), *place.T) == 0
    straight = sum(GEOD.inv(*a, *b)[2] for a, b in itertools.pairwise(place))
    assert seas.length(where, way) == pytest.approx(straight, rel=1e-9)


def brute(
    inside: shapely.Geometry, outside: shapely.Geometry, begin: np.ndarray, end: np.ndarray
) -> float:
    """Return the shortest way [m] that keeps off `inside`:

    Dijkstra on all corners of `outside` that see each other.
    """
    points = np.concatenate([[begin, end], np.unique(shapely.get_coordinates(outside), axis=0)])
    i, j = np.triu_indices(len(points), 1)
    lines = shapely.linestrings(np.stack([points[i], points[j]], axis=1))
    shapely.prepare(inside)
    free = ~shapely.intersects(inside, lines)
    graph = np.zeros((len(points), len(points)))
    graph[i[free], j[free]] = np.hypot(*(points[i[free]] - points[j[free]]).T)
    return float(csgraph.dijkstra(graph, directed=False, indices=0)[1])


def shortest(
    shapes: list[shapely.Polygon], begin: np.ndarray, end: np.ndarray
) -> tuple[float, float]:
    """Return what no way that keeps CLEAR is shorter than (arcs by their chords), and the shortest
    that turns where ours do.
    """
    land = shapely.union_all(shapes)
    arcs = land.buffer(seas.CLEAR, quad_segs=3)
    mitre = {"join_style": "mitre", "mitre_limit": 2.0}
    barrier = shapely.union_all(
        [shape.buffer(seas.CLEAR + seas.ROUNDING, **mitre) for shape in shapes]
    )
    return brute(arcs.buffer(-1e-3), arcs, begin, end), brute(
        barrier, barrier.buffer(seas.SKIN, **mitre), begin, end
    )


def islands(count: int) -> list[shapely.Polygon]:
    """Return islands of four or five corners, some of them across each other."""
    rng = np.random.default_rng(12)
    middles, sizes = (
        rng.uniform([-9500, -6000], [8500, 6000], (count, 2)),
        rng.uniform(300, 1500, count),
    )
    return [
        shapely.MultiPoint(m + s * rng.normal(size=(5, 2))).convex_hull
        for m, s in zip(middles, sizes, strict=True)
    ]


@pytest.mark.thorough
def test_ways_among_many_islands_against_brute_force() -> None:
    """The side on which an island is passed is chosen by distances that are up to 2.8 % too long;
    few ways are longer for that.
    """
    rng, shapes, shares, exact = np.random.default_rng(2), islands(24), [], 0
    land = shapely.union_all([shape.buffer(OFF + 50) for shape in shapes])
    where = sea(shapes, np.array([BEGIN, END, [-9000, 8000]]))
    while len(shares) < 7:
        begin, end = rng.uniform([-11_000, -8000], [10_000, 8000], (2, 2))
        if shapely.intersects_xy(land, *begin) or shapely.intersects_xy(land, *end):
            continue
        least, most = shortest(shapes, begin, end)
        found, way = by_grid(where, begin, end)
        assert least * (1 - 1e-5) < seas.length(where, way) < most * 1.028
        assert seas.length(where, way) <= found * (1 + 1e-5)
        shares.append(seas.length(where, way) / most)
        near = seas.short_way(where, begin, end, 3 * most)
        if near is not None and len(near) > 2:
            exact += 1
            assert least * (1 - 1e-5) < seas.length(where, near) < most * (1 + 1e-4)
    assert np.median(shares) < 1 + 1e-3
    assert exact >= 3


def test_a_way_round_an_islet_is_the_shortest() -> None:
    islet = shapely.Polygon([(-300, -150), (500, -420), (260, 700), (-410, 520)])
    where = sea([islet], np.array([BEGIN, END]))
    begin, end = np.array([-900.0, 130.0]), np.array([1100.0, 60.0])
    least, most = shortest([islet], begin, end)
    assert least < seas.length(where, seas.short_way(where, begin, end, 9000.0)) < most * (1 + 1e-5)
    assert seas.short_way(where, begin, end, 2010.0) is None  # any way round is longer
