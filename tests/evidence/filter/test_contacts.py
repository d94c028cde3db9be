"""Likelihoods of contacts against pyproj's geodesics on the sphere and scipy's densities: axes,
wraps, densities, zones.
"""

from typing import Any

import numpy as np
import pytest
from pyproj import Geod
from scipy import stats

from drift.evidence.filter import contacts as contact_laws
from drift.evidence.filter.detection import heard
from drift.evidence.filter.detection.sight import Targets
from drift.evidence.filter.records import Contact, Fix, Heard, Tone, Watch
from geo import sphere
from geo.polyline import Area

EARTH = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
TIME = np.datetime64("2026-11-21T06:00:00")
SENSOR = (179.93, -47.2)


def points(
    n: int = 4000, far: float = 60_000.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (lon, lat) [deg] all round the sensor, across the antimeridian, and (azimuth [rad],
    distance [m]) from it.
    """
    random = np.random.default_rng(8)
    azimuth, distance = random.uniform(-180, 180, n), far * random.uniform(0.01, 1, n)
    lon, lat, _ = EARTH.fwd(np.full(n, SENSOR[0]), np.full(n, SENSOR[1]), azimuth, distance)
    return lon, lat, np.radians(azimuth), distance


def told(contact: Contact, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    return contact_laws.log_likelihood(contact, sphere.to_binary(lon), sphere.to_binary(lat))


def matches(found: np.ndarray, expected: np.ndarray, error: float) -> None:
    """Assert that finite values agree within an error, and that the same ones are impossible, next
    to the edges aside.
    """
    both = np.isfinite(found) & np.isfinite(expected)
    assert both.sum() > 100
    assert np.abs(found[both] - expected[both]).max() < error
    assert (np.isfinite(found) == np.isfinite(expected)).mean() > 0.998


@pytest.mark.parametrize("bearing", [7.0, 124.0, 176.0, 183.0, 251.0, 356.0])
def test_a_bearing_is_a_normal_of_the_short_way_round(bearing: float) -> None:
    """Also where bearing and particle lie on both sides of south or of north; nothing nearer or
    farther than it reaches.
    """
    lon, lat, azimuth, distance = points()
    std, near, far = np.radians(6.0), 5000.0, 45_000.0
    contact = Contact(
        "b",
        TIME,
        "bearing",
        sensor=SENSOR,
        bearing=np.radians(bearing),
        bearing_std=std,
        near=near,
        far=far,
    )
    apart = np.angle(np.exp(1j * (azimuth - np.radians(bearing))))
    expected = np.where(np.abs(apart) < 6 * std, stats.norm.logpdf(apart, scale=std), -np.inf)
    expected = np.where((distance >= near) & (distance <= far), expected, -np.inf)
    matches(told(contact, lon, lat), expected, 1e-3)


def test_a_range_is_a_normal_of_the_distance_times_the_sensors_chance() -> None:
    lon, lat, _, distance = points()
    zones = Watch((0.0, 25_000.0), (18_000.0, 50_000.0), (0.3, 0.8))
    contact = Contact(
        "r", TIME, "range", sensor=SENSOR, range=21_000.0, range_std=6000.0, zones=zones
    )
    chance = np.where(distance < 18_000, 0.3, 0.0) + np.where(
        (distance >= 25_000) & (distance < 50_000), 0.8, 0.0
    )
    with np.errstate(divide="ignore"):
        expected = stats.norm.logpdf(distance, 21_000, 6000) + np.log(chance)
    expected[np.abs(distance - 21_000) > 36_000] = -np.inf
    matches(told(contact, lon, lat), expected, 1e-3)


def test_a_fix_is_a_normal_of_its_own_axes() -> None:
    """Major axis clockwise from north, in the tangent plane at each fix; fixes by their shares;
    zones of the sensor.
    """
    lon, lat, _, distance = points(far=20_000.0)
    fixes = (Fix(-179.98, -47.23, 0.7), Fix(179.86, -47.1, 0.3))
    major, minor, turn = 5000.0, 2000.0, np.radians(35.0)
    axis, across = np.array([np.sin(turn), np.cos(turn)]), np.array([np.cos(turn), -np.sin(turn)])
    covariance = major**2 * np.outer(axis, axis) + minor**2 * np.outer(across, across)
    density = np.zeros(lon.size)
    for fix in fixes:
        n = np.ones(lon.size)
        azimuth, _, away = EARTH.inv(fix.lon * n, fix.lat * n, lon, lat)
        place = away[:, None] * np.column_stack(
            [np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth))]
        )
        inside = (np.abs(place @ axis) < 6 * major) & (np.abs(place @ across) < 6 * minor)
        density += fix.share * inside * stats.multivariate_normal.pdf(place, cov=covariance)
    contact = Contact(
        "f", TIME, "position", fixes=fixes, major=major, minor=minor, orientation=turn
    )
    with np.errstate(divide="ignore"):
        matches(told(contact, lon, lat), np.log(density), 1e-2)
        zones = Watch((0.0, 9000.0), (9000.0, 15_000.0), (0.9, 0.4))
        seen = Contact(
            "z",
            TIME,
            "position",
            fixes=fixes,
            major=major,
            minor=minor,
            orientation=turn,
            sensor=SENSOR,
            zones=zones,
        )
        chance = np.where(distance < 9000, 0.9, np.where(distance < 15_000, 0.4, 0.0))
        matches(told(seen, lon, lat), np.log(density * chance), 1e-2)


def test_an_area_is_a_density_per_square_metre() -> None:
    """1 / area inside, by pyproj's area of the polygon; nothing outside.

    So its evidence compares with that of a fix.
    """
    lon, lat, _, _ = points()
    corners = (np.array([179.6, -179.7, -179.8, 179.7]), np.array([-47.4, -47.3, -46.9, -47.0]))
    contact = Contact(
        "a",
        TIME,
        "area",
        area=Area(tuple(np.where(corners[0] < 0, corners[0] + 360, corners[0])), tuple(corners[1])),
    )
    metres = abs(EARTH.polygon_area_perimeter(*corners)[0])
    found = told(contact, lon, lat)
    assert 0.1 < np.isfinite(found).mean() < 0.9
    assert (
        np.abs(found[np.isfinite(found)] + np.log(metres)).max() < 2e-3
    )  # its sides are great circles there, straight here


def test_doppler_is_of_both_velocities_along_the_way_between() -> None:
    """Kinsler's law with the unit vector taken from pyproj's azimuth: nearer sounds higher, whoever
    of the two moves.
    """
    lon, lat, azimuth, _ = points(300, far=8000.0)
    random = np.random.default_rng(3)
    east, north = random.normal(0, 6, (2, lon.size))
    c, own = 1487.0, (9.1, -4.3)
    sensor: Any = None  # the law asks for none
    hears = Heard(sensor, tone=Tone(50.0, 0.1, 50.0, sound_speed=c), velocity=own)
    targets = Targets(
        sphere.to_binary(lon),
        sphere.to_binary(lat),
        np.zeros(lon.size, np.int32),
        east,
        north,
        np.zeros(lon.size, np.int32),
    )
    way = sphere.offset(*np.radians(SENSOR), np.radians(lon), np.radians(lat))
    u = np.sin(azimuth), np.cos(azimuth)
    nearer = c + own[0] * u[0] + own[1] * u[1], c + east * u[0] + north * u[1]
    found = heard.doppler(hears, targets, way)
    np.testing.assert_allclose(found, nearer[0] / nearer[1], rtol=1e-9)
    still = targets._replace(east=0 * east, north=0 * north)
    ahead = own[0] * u[0] + own[1] * u[1] > 2.0
    assert ahead.sum() > 50
    assert (heard.doppler(hears, still, way)[ahead] > 1).all()
