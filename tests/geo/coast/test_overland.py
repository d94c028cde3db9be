"""Ways over land against a visibility graph (every pair of corners that see each other) and closed
forms.
"""

import itertools

import numpy as np
import pytest
import shapely
from scipy.sparse import csgraph

from geo import sphere
from geo.coast import land_masses, overland

DEGREE = np.pi * sphere.RADIUS / 180  # [m] of latitude, and of longitude on the equator


def apart(a, b):
    return float(sphere.distance(*np.radians([*a, *b])))


def by_sight(polygon, a, b):
    """Return the length [m] of the shortest way in a polygon, over all pairs of points that see
    each other.
    """
    points = np.array([a, b, *shapely.get_coordinates(polygon)])
    seen = polygon.buffer(1e-9)
    between = np.zeros((len(points), len(points)))
    for i, j in itertools.combinations(range(len(points)), 2):
        if shapely.covers(seen, shapely.LineString([points[i], points[j]])):
            between[i, j] = max(apart(points[i], points[j]), 1e-6)
    return csgraph.dijkstra(between, directed=False, indices=0)[1]


@pytest.mark.parametrize("seed", range(6))
def test_a_way_is_the_shortest_of_all_between_corners(seed, monkeypatch):
    """Stars of 30 corners on the equator, where straight lines of both planes agree to (size /
    radius)^2 = 1e-5.
    """
    monkeypatch.setattr(overland, "DETAIL", 0.0)
    rng = np.random.default_rng(seed)
    angle, far = np.sort(rng.uniform(0, 2 * np.pi, 30)), rng.uniform(0.05, 1, 30)
    star = shapely.Polygon(
        np.stack([10 + 0.3 * far * np.cos(angle), 0.2 * far * np.sin(angle)], axis=1)
    )
    west, south, east, north = star.bounds
    points = []
    while len(points) < 4:
        point = rng.uniform(west, east), rng.uniform(south, north)
        if shapely.contains_xy(star, *point):
            points.append(point)
    land = land_masses.build_land_masses(np.array([star], object))
    found = overland.overland_distances(land, points[0], points[1:], 200e3)
    np.testing.assert_allclose(
        found, [by_sight(star, points[0], point) for point in points[1:]], rtol=2e-5
    )


BAY = shapely.Polygon(
    [(0, 0), (0.3, 0), (0.3, 0.2), (0.2, 0.2), (0.2, 0.05), (0.1, 0.05), (0.1, 0.2), (0, 0.2)]
)


@pytest.mark.parametrize("shift", [0.0, 179.85, 359.85])
def test_round_a_bay_and_not_across(shift):
    """From one head of a bay to the other: down one side, along the bottom, up the other, wherever
    it lies.
    """
    bay = shapely.transform(BAY, lambda xy: xy + np.array([shift, 0.0]))
    land = land_masses.build_land_masses(np.array([bay], object))
    base, to = (
        (float(sphere.wrap_degrees(shift + 0.1)), 0.2),
        (float(sphere.wrap_degrees(shift + 0.2)), 0.2),
    )
    way = (0.15 + 0.1 + 0.15) * DEGREE
    (found,) = overland.overland_distances(land, base, [to], 60e3)
    assert found == pytest.approx(way, abs=2 * overland.DETAIL * 60e3)
    assert apart(base, to) < 0.3 * way
    assert overland.overland_distances(land, base, [to], 0.95 * way).tolist() == [np.inf]


def test_islands_are_apart_until_a_bridge_joins_them():
    islands = np.array([shapely.box(0, 0, 0.1, 0.1), shapely.box(0.12, 0, 0.2, 0.1)], object)
    base, to = (0.02, 0.05), (0.18, 0.05)
    assert overland.overland_distances(
        land_masses.build_land_masses(islands), base, [to], 50e3
    ).tolist() == [np.inf]
    bridged = land_masses.build_land_masses(islands, [((0.1, 0.08), (0.12, 0.08))])
    assert bridged.mass[0] == bridged.mass[1]
    (found,) = overland.overland_distances(bridged, base, [to], 50e3)
    legs = [base, (0.1, 0.08), (0.12, 0.08), to]
    assert found == pytest.approx(sum(apart(a, b) for a, b in itertools.pairwise(legs)), rel=1e-6)


def test_round_a_lake():
    """A lake is no way: the way goes round its nearer end."""
    ring = shapely.Polygon(
        shapely.box(0, 0, 0.3, 0.3).exterior, [shapely.box(0.1, 0.05, 0.2, 0.29).exterior]
    )
    land = land_masses.build_land_masses(np.array([ring], object))
    (found,) = overland.overland_distances(land, (0.09, 0.1), [(0.21, 0.1)], 60e3)
    legs = [(0.09, 0.1), (0.1, 0.05), (0.2, 0.05), (0.21, 0.1)]
    assert found == pytest.approx(sum(apart(a, b) for a, b in itertools.pairwise(legs)), rel=1e-4)
