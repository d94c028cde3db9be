"""Tables between places against linear interpolation in pyproj's plane and shapely's nearest
points.
"""

import numpy as np
import pyproj
import pytest
from shapely import MultiPoint, Point
from shapely.ops import nearest_points

from drift.evidence.sensors import losses, places
from drift.evidence.sensors.records import Losses
from geo import sphere
from geo.errors import UserError

METRES = np.array([10.0, 100.0, 1000.0])
TURNS = {"antimeridian": (np.array([-178.0, 179.0, 176.5, -179.5, -179.9, 178.2]), np.array([31, 36, 30, 33, 38, 33.5])),
         "south pole": (np.array([10.0, 100.0, 190.0, 300.0, 40.0]), np.array([-85.0, -82.0, -86.0, -84.0, -89.0]))}  # fmt: skip


def of_values(values: np.ndarray, lon: np.ndarray, lat: np.ndarray) -> Losses:
    """A record in which each place has one number for a table, with others beside it."""
    table = (
        values[:, None, None]
        + np.array([0.0, 2.0])[None, :, None]
        + np.array([0.0, 5.0, 9.0])[None, None, :]
    )
    bearing = np.array([0.0, np.pi])
    return Losses(
        bearing, METRES, table.astype(np.float32), np.radians(lon), np.radians(lat), "made"
    )


def plane(lon: np.ndarray, lat: np.ndarray) -> pyproj.Proj:
    """The azimuthal equidistant plane about the mean of the places' unit vectors."""
    phi, lam = np.radians(lat), np.radians(lon)
    x, y, z = (
        (np.cos(phi) * np.cos(lam)).mean(),
        (np.cos(phi) * np.sin(lam)).mean(),
        np.sin(phi).mean(),
    )
    middle = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    return pyproj.Proj(proj="aeqd", lon_0=middle[0], lat_0=middle[1], R=sphere.RADIUS)


@pytest.mark.parametrize("where", TURNS)
def test_exact_at_the_places(where: str) -> None:
    lon, lat = TURNS[where]
    values = np.array([60.0, 71.0, 85.5, 64.25, 90.0, 77.0])[: len(lon)]
    made = of_values(values, lon, lat)
    for k in range(len(lon)):
        read = losses.between(
            made, float(np.radians(lon[k] + 360.0 * (k % 2))), float(np.radians(lat[k]))
        )
        assert read.dtype == np.float32
        np.testing.assert_allclose(read, made.loss[k], rtol=0, atol=4 * np.spacing(np.float32(100)))


@pytest.mark.parametrize("where", TURNS)
def test_a_linear_field_is_met_within_the_places_and_its_nearest_value_beyond(where: str) -> None:
    lon, lat = TURNS[where]
    to = plane(lon, lat)
    x, y = to(lon, lat)

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 70.0 + 3e-5 * np.asarray(x) - 1.7e-5 * np.asarray(y)

    made = of_values(field(x, y), lon, lat)
    hull = MultiPoint(np.stack((x, y), -1)).convex_hull
    rng = np.random.default_rng(5)
    span = np.hypot(x, y).max()
    inside = 0
    for east, north in rng.uniform(-span, span, (300, 2)):
        point = Point(east, north)
        inside += hull.contains(point)
        nearest = nearest_points(hull, point)[0]
        at = np.radians(to(east, north, inverse=True))
        got = losses.between(made, float(at[0]), float(at[1]))[1, 2]
        assert got == pytest.approx(
            field(nearest.x, nearest.y) + 11.0, abs=2e-4
        )  # single precision, and pyproj's rounding
    assert 40 < inside < 260


def test_continuous_across_triangles_and_the_edge_of_all() -> None:
    """Half the step, half the largest jump: what was not continuous would keep it."""
    lon, lat = TURNS["antimeridian"]
    made = of_values(np.array([60.0, 90.0, 75.0, 110.0, 62.0, 84.0]), lon, lat)

    def largest(count: int) -> float:
        turn = np.linspace(0, 2 * np.pi, count)
        reach = np.radians(4.0) * (1 + 0.9 * np.sin(7 * turn))  # in and out of the hull
        x, y = (
            np.radians(179.0) + 1.2 * reach * np.cos(turn),
            np.radians(33.5) + reach * np.sin(turn),
        )
        values = [losses.between(made, a, b)[0, 0] for a, b in zip(x, y, strict=True)]
        return float(np.abs(np.diff(values)).max())

    assert largest(4001) < 0.6 * largest(2001)
    assert largest(2001) > 0.1


@pytest.mark.parametrize("count", [2, 4])
def test_places_in_a_line_are_joined_along_it(count: int) -> None:
    """On the equator, where the plane's x is the longitude; the line's order is not the file's."""
    lon = np.array([181.0, 178.0, 185.0, 182.0])[:count]
    values = np.array([60.0, 90.0, 75.0, 66.0])[:count]
    made = of_values(values, lon, np.zeros(count))
    order = np.argsort(lon)
    for at in np.linspace(175.0, 189.0, 57):
        for lat in (-3.0, 0.0, 2.0):
            got = float(
                losses.between(made, float(np.radians(at - 360.0)), float(np.radians(lat)))[0, 0]
            )
            # Off the equator x is longer than the longitude by up to 0.15 % of the 11 degrees to
            # the farthest place.
            slack = 1e-4 if lat == 0.0 else 20.0 * 0.02
            assert got == pytest.approx(np.interp(at, lon[order], values[order]), abs=slack)


def test_places_almost_in_a_line_do_not_depend_on_the_side() -> None:
    """A hundred metres beside the line of two others a place must count on both sides of it."""
    made = of_values(
        np.array([60.0, 100.0, 60.0]), np.array([10.0, 12.0, 14.0]), np.array([0.0, 0.001, 0.0])
    )
    north, south = (
        float(losses.between(made, np.radians(12.0), np.radians(lat))[0, 0]) for lat in (1.0, -1.0)
    )
    assert north == south == pytest.approx(100.0, abs=1e-3)


def test_one_place_and_none_hold_everywhere() -> None:
    for lon in (np.array([20.0]), np.empty(0)):
        made = Losses(
            np.zeros(1),
            METRES,
            np.ones((1, 1, 3), np.float32),
            np.radians(lon),
            np.radians(lon),
            "made",
        )
        np.testing.assert_array_equal(losses.between(made, 3.0, -1.0), made.loss[0])


def test_weights_are_shares() -> None:
    lon, lat = TURNS["south pole"]
    joined = places.join(np.radians(lon), np.radians(lat), "made")
    rng = np.random.default_rng(6)
    for x, y in zip(rng.uniform(-np.pi, np.pi, 200), rng.uniform(-1.5, -1.3, 200), strict=True):
        which, weight = places.weights(joined, x, y)
        assert weight.sum() == pytest.approx(1.0, abs=1e-12)
        assert (weight >= 0).all()
        assert len(set(which.tolist())) == len(which)


def test_places_all_round_the_earth_are_refused() -> None:
    made = of_values(np.arange(4.0), np.array([0.0, 90.0, 180.0, -90.0]), np.zeros(4))
    with pytest.raises(UserError, match="made: its points surround the globe"):
        losses.between(made, 0.0, 0.0)
