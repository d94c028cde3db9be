"""The sphere in float64 against pyproj; the kernel's exponential map against the sphere in float64."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from geo import sphere
from geo.box import Box
from kernels.maths import sphere as kernel

GEOD = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
longitudes = st.floats(-180, 179.999)
latitudes = st.floats(-89.99, 89.99)


@given(longitudes, latitudes, st.floats(-179, 180), st.floats(0, 1.9e7))
def test_destination_and_distance_agree_with_geodesics(
    lon: float, lat: float, azimuth: float, length: float
) -> None:
    a = np.radians(azimuth)
    x, y = sphere.destination(
        np.radians(lon), np.radians(lat), length * np.sin(a), length * np.cos(a)
    )
    lon2, lat2, _ = GEOD.fwd(lon, lat, azimuth, length)
    assert sphere.distance(x, y, np.radians(lon2), np.radians(lat2)) < 1e-3 + 1e-9 * length
    assert sphere.distance(np.radians(lon), np.radians(lat), x, y) == pytest.approx(
        length, abs=1e-3
    )


@given(longitudes, latitudes, longitudes, latitudes)
def test_there_and_back(lon1: float, lat1: float, lon2: float, lat2: float) -> None:
    a, b = np.radians([lon1, lat1]), np.radians([lon2, lat2])
    if sphere.distance(*a, *b) > 1.99e7:
        return  # at the antipode every direction leads there
    x, y = sphere.destination(*a, *sphere.offset(*a, *b))
    assert sphere.distance(x, y, *b) < 1e-2


@given(st.floats(-1000, 1000))
def test_binary_angles_wrap(angle: float) -> None:
    there = sphere.to_degrees(sphere.to_binary(angle))
    assert -180 <= there < 180
    assert abs((there - angle + 180) % 360 - 180) <= 180 / 2**32 * 1.01


@given(st.floats(-1000, 1000), st.floats(-1000, 1000))
def test_longitudes_turn_by_whole_turns(lon: float, about: float) -> None:
    """Into their range, to the rounding of a sum of a thousand degrees; by how much, by the
    library's remainder.
    """
    rounding = 4 * np.spacing(2000.0)
    for made, low in (
        (sphere.wrap_degrees(lon), -180.0),
        (sphere.near_degrees(lon, about), about - 180),
        (sphere.east_of_degrees(lon, about), about),
    ):
        assert low - rounding <= made <= low + 360 + rounding
        assert abs(math.remainder(made - lon, 360)) <= rounding
    assert sphere.wrap_degrees(lon) < 180
    lons = np.array([lon, lon + 360, lon - 720])
    assert np.ptp(sphere.near_degrees(lons, lons[0])) <= rounding


def test_the_antimeridian_has_one_binary_angle() -> None:
    assert sphere.to_binary(180.0) == sphere.to_binary(-180.0) == -(2**31)


@pytest.mark.parametrize("lat", [0.0, 12.3, -57.0, 75.5, 89.0, -89.9, 89.9])
def test_kernel_is_within_5_cm_of_float64_at_10_km(lat: float) -> None:
    rng = np.random.default_rng(5)
    n = 20_000
    lon_b, lat_b = sphere.to_binary(rng.uniform(-180, 180, n)), sphere.to_binary(np.full(n, lat))
    azimuth = rng.uniform(0, 2 * np.pi, n)
    east, north = (10_000 * f(azimuth) for f in (np.sin, np.cos))
    east, north = east.astype(np.float32), north.astype(np.float32)
    x, y = sphere.destination(lon_b * sphere.UNIT, lat_b * sphere.UNIT, east, north)
    kernel.displace(lon_b, lat_b, east, north)
    assert sphere.distance(lon_b * sphere.UNIT, lat_b * sphere.UNIT, x, y).max() < 0.05


def test_kernel_wraps_at_180_and_passes_over_the_pole() -> None:
    lon, lat = sphere.to_binary([179.99, 25.0, 25.0]), sphere.to_binary([10.0, 89.95, -89.95])
    east, north = np.array([5000, 0, 0], np.float32), np.array([0, 20_000, -20_000], np.float32)
    kernel.displace(lon, lat, east, north)
    assert sphere.to_degrees(lon)[0] == pytest.approx(-179.9643, abs=1e-3)
    beyond = np.degrees(20_000 / sphere.RADIUS) - 0.05
    assert sphere.to_degrees(lon)[1:] == pytest.approx([-155, -155], abs=1e-3)
    assert sphere.to_degrees(lat)[1:] == pytest.approx([90 - beyond, beyond - 90], abs=1e-6)


def test_a_slow_drifter_does_not_stall_at_180_degrees() -> None:
    """1 cm/s for 600 s, 100 times: float32 longitudes [deg] would not move there at all."""
    lon, lat = sphere.to_binary([179.9999]), sphere.to_binary([0.0])
    start = lon.astype(np.int64).copy()
    for _ in range(100):
        kernel.displace(lon, lat, np.array([6], np.float32), np.array([0], np.float32))
    moved = ((lon.astype(np.int64) - start) % 2**32) * sphere.UNIT * sphere.RADIUS
    assert moved[0] == pytest.approx(600, abs=100 * 0.005)


def test_a_track_is_a_great_circle_in_pieces_no_longer_than_asked() -> None:
    corners = np.array([[178.0, 61.0], [-171.0, 63.5], [-171.2, 40.0]])
    lon, lat = np.degrees(sphere.track(*np.radians(corners).T, 20_000.0))
    earth = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
    length = np.array(earth.inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2])
    assert length.max() <= 20_000.0 + 1e-3
    at = 0
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        count = int(np.ceil(earth.inv(x0, y0, x1, y1)[2] / 20_000.0))
        between = np.array(earth.npts(x0, y0, x1, y1, count - 1))
        away = earth.inv(lon[at + 1 : at + count], lat[at + 1 : at + count], *between.T)[2]
        assert np.max(away) < 1e-3
        at += count
    assert at == len(lon) - 1


def test_a_box_that_grows_over_the_antimeridian_begins_within_the_degrees() -> None:
    grown = Box(-179.5, 10.0, -170.0, 20.0).grown(2.0, 1.5)
    assert (grown.west, grown.south, grown.east, grown.north) == (178.5, 8.5, 192.0, 21.5)
    grown = Box(170.0, -88.0, 185.0, 3.0).grown(3.0, 4.0)
    assert (grown.west, grown.south, grown.east, grown.north) == (167.0, -90.0, 188.0, 7.0)
    grown = Box(-30.0, 0.0, 320.0, 1.0).grown(5.0, 1.0)
    assert (grown.west, grown.east) == (-180.0, 180.0)


def test_the_exponential_map_holds_to_the_antipode() -> None:
    """Relative error of a float32 map: a few units of 6e-8 of the arc, wherever it starts, poles
    included.
    """
    rng = np.random.default_rng(0)
    n = 50_000
    lon = rng.integers(-(2**31), 2**31, n).astype(np.int32)
    lat = sphere.to_binary(np.degrees(np.arcsin(rng.uniform(-1, 1, n))))
    lat[:100], lat[100:200] = 2**30, -(2**30)
    length, angle = 10 ** rng.uniform(0, 7.3, n), rng.uniform(0, 2 * np.pi, n)
    east, north = (
        (length * np.sin(angle)).astype(np.float32),
        (length * np.cos(angle)).astype(np.float32),
    )
    x, y = lon.copy(), lat.copy()
    kernel.displace(x, y, east, north)
    exact = sphere.destination(lon * sphere.UNIT, lat * sphere.UNIT, east, north)
    error = sphere.distance(*exact, x * sphere.UNIT, y * sphere.UNIT)
    # 2 m at the antimeridian: float32 of an angle of pi has a spacing of 2.4e-7 rad, which is 1.5 m
    assert (error < 0.02 + np.minimum(1e-6 * length, 6.0)).all()
