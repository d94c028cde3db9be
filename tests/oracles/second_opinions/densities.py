"""Densities of particles about a place: normal, ring, filament and others."""

import clouds
import numpy as np
import shapely

from drift.forecast import shares
from geo import sphere

LON, LAT = -87.3, 28.1  # [deg] where the test clouds lie
SHARES = np.array(shares.SHARES)
TIME = np.datetime64("2026-11-21T18:30:00")


def positions(east, north, lon=LON, lat=LAT):
    """Binary angles of points (east, north) [m] from a place."""
    x, y = sphere.destination(np.radians(lon), np.radians(lat), east, north)
    return sphere.to_binary(np.degrees(x)), sphere.to_binary(np.degrees(y))


def snapshot(east, north, *, weight=None, status=None, scenario=None, lon=LON, lat=LAT, time=TIME):
    n = len(east)
    weight = np.ones(n) if weight is None else weight
    x, y = positions(east, north, lon, lat)
    return clouds.at(
        time,
        x,
        y,
        weight / weight.sum(),
        np.zeros(n, np.int32) if status is None else np.asarray(status, np.int32),
        np.zeros(n, np.int32) if scenario is None else np.asarray(scenario, np.int32),
    )


def normal(n, rng):
    return rng.normal(0, 4000, n), rng.normal(0, 9000, n)


def ring(n, rng):
    angle, radius = rng.uniform(0, 2 * np.pi, n), rng.normal(15_000, 1000, n)
    return radius * np.cos(angle), radius * np.sin(angle)


def mixture(n, rng):
    which = rng.choice(3, n, p=[0.3, 0.3, 0.4])
    middle, width = np.array([0, 20e3, -30e3])[which], np.array([500, 3000, 8000])[which]
    return middle + width * rng.normal(size=n), -0.3 * middle + width * rng.normal(size=n)


def filament(n, rng):
    along = rng.uniform(-40e3, 40e3, n)
    return along + rng.normal(0, 200, n), 12e3 * np.sin(along / 12e3) + rng.normal(0, 200, n)


def far_apart(n, rng):
    which = rng.integers(0, 3, n)
    east, north = np.array([0, 200e3, -150e3])[which], np.array([0, 120e3, 90e3])[which]
    return east + rng.normal(0, 900, n), north + rng.normal(0, 900, n)


def pinpoint(n, rng):
    return rng.uniform(-5, 5, n), rng.uniform(-4, 4, n)


def inside(forecast, share, east, north, lon=LON, lat=LAT):
    """Share of points inside the contour of a share."""
    contour = next(c for c in forecast.contours if c.share == share)
    x, y = (sphere.to_degrees(v) for v in positions(east, north, lon, lat))
    west = forecast.data["lon"].values[0] - 180
    shapely.prepare(contour.polygon)
    return shapely.contains_xy(contour.polygon, west + (x - west) % 360, y).mean()
