"""Motion within 60 nmi of a pole: against rotations and integrations in three dimensions, in
float64.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import taichi as ti
import trial_case
import xarray as xr

import drift
from drift.engine.motion.models.drift import COLUMNS
from drift.engine.particles import ensemble as record
from geo import sphere
from geo.grids.grid import Grid
from kernels.runtime import runtime
from kernels.step import advance as kernel
from kernels.step.sample import Tiles
from kernels.step.velocity import f32x3

T = ti.template()
EVERYWHERE = kernel.Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
SPEED = 0.9  # [m/s] across the pole
# [rad] longitude of the rotation's axis, on the equator: it carries along great circles over both
# poles
AXIS = 0.6


@ti.func
def over_the_pole(features: T, sea: T, own: T, lon, lat, fraction):
    """East and north of a rigid rotation about an axis on the equator."""
    d = ti.cast(lon, ti.f32) * ti.f32(sphere.UNIT) - ti.f32(AXIS)
    y = ti.cast(lat, ti.f32) * ti.f32(sphere.UNIT)
    return f32x3(-ti.f32(SPEED) * ti.sin(y) * ti.cos(d), ti.f32(SPEED) * ti.sin(d), 1.0)


def unit(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def turned(lon: np.ndarray, lat: np.ndarray, way: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places [rad] after the rotation has led its equator by a way [m] (Rodrigues)."""
    r, k, a = (
        unit(lon, lat),
        np.array([np.cos(AXIS), np.sin(AXIS), 0.0])[:, None],
        way / sphere.RADIUS,
    )
    end = r * np.cos(a) + np.cross(k, r, axis=0) * np.sin(a) + k * (k * r).sum(0) * (1 - np.cos(a))
    return np.arctan2(end[1], end[0]), np.arctan2(end[2], np.hypot(end[0], end[1]))


@pytest.mark.parametrize(("pole", "scheme"), [(1, "rk4"), (-1, "rk2")])
def test_what_drifts_over_a_pole_keeps_to_its_great_circle(pole: int, scheme: str) -> None:
    """12 hours of an hour's steps from up to 60 nmi this side of the pole, or at it, to the other
    side: right to a metre.
    """
    runtime.start()
    rng = np.random.default_rng(7)
    lon = np.append(rng.uniform(-np.pi, np.pi, 300), [0.3, -2.0])
    lat = pole * (np.pi / 2 - np.append(rng.uniform(1, 111_000, 300), [0.0, 0.01]) / sphere.RADIUS)
    ensemble = record.empty(1, (0, lon.size), COLUMNS)
    x, y = sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat))
    ensemble.lon.from_numpy(x)
    ensemble.lat.from_numpy(y)
    place = kernel.Surroundings(EVERYWHERE, scheme=scheme, polar=True)
    tiles, still = Tiles([Grid(0, 0, 1, 1, 2, 2)]), kernel.Physics()
    for k in range(12):
        step = kernel.Step(k, 3600 * k, 3600, 1)
        kernel.advance(ensemble, (0, lon.size, 0), tiles, {}, still, step, place, over_the_pole)
    expected = turned(x * sphere.UNIT, y * sphere.UNIT, SPEED * 12 * 3600)
    ends = ensemble.lon.to_numpy() * sphere.UNIT, ensemble.lat.to_numpy() * sphere.UNIT
    # Each step is rounded to 5 mm and wrapped by float32: 12 of them stray by some centimetres.
    assert sphere.distance(*ends, *expected).max() < 0.5


def integrated(
    lon: float, lat: float, velocity, duration: float, step: float = 20.0
) -> tuple[float, float]:
    """Return the end [rad] of a track by RK4 on the unit vector in float64; velocity: (lon, lat,
    time) -> east, north.
    """

    def rate(r: np.ndarray, time: float) -> np.ndarray:
        x, y = math.atan2(r[1], r[0]), math.atan2(r[2], math.hypot(r[0], r[1]))
        u, v = velocity(x, y, time)
        east = np.array([-math.sin(x), math.cos(x), 0.0])
        north = np.array([-math.sin(y) * math.cos(x), -math.sin(y) * math.sin(x), math.cos(y)])
        return (u * east + v * north) / sphere.RADIUS

    r = unit(np.array(lon), np.array(lat))
    for k in range(round(duration / step)):
        t = k * step
        a = rate(r, t)
        b = rate(r + 0.5 * step * a, t + 0.5 * step)
        c = rate(r + 0.5 * step * b, t + 0.5 * step)
        d = rate(r + step * c, t + step)
        r = r + step * (a + 2 * b + 2 * c + d) / 6
        r /= np.linalg.norm(r)
    return math.atan2(r[1], r[0]), math.atan2(r[2], math.hypot(r[0], r[1]))


def final(case: Path) -> tuple[float, float]:
    """Return the place [rad] of the first particle at the end of a case."""
    tracks = next(iter(drift.run_many([drift.load(case)])))  # which makes no maps
    return math.radians(float(tracks.lon[-1, 0])), math.radians(float(tracks.lat[-1, 0]))


@pytest.mark.thorough
@pytest.mark.parametrize("pole", [1, -1])
def test_typed_forcing_near_a_pole_has_one_direction_in_its_plane(
    tmp_path: Path, pole: int
) -> None:
    """As at the meridian of the first scenario's position; a current that turns, and a wind with 4
    % of it as windage.
    """
    lat = "89 59.0N" if pole > 0 else "89 59.0S"
    path = trial_case.write(
        tmp_path,
        start="2026-03-03T18:00Z",
        duration="680 min",
        particles=100,
        uncertainty="none",
        current={
            "table": [
                {"time": "2026-03-03T18:00Z", "speed": "0.5 kn", "toward": 60},
                {"time": "2026-03-04T02:00Z", "speed": "1.5 kn", "toward": 130},
                {"time": "2026-03-04T06:00Z", "speed": "0.2 kn", "toward": 350},
            ]
        },
        wind={"constant": {"speed": "15 kn", "from": 240}},
        scenario={
            "object": {"windage": "4 %"},
            "position": {"at": f"{lat} 010 00W", "error": "0.001 m"},
        },
    )
    knot, start = 1852 / 3600, math.radians(-10)
    rows = [(0, 0.5, 60), (8, 1.5, 130), (12, 0.2, 350)]
    hours = [row[0] for row in rows]
    vector = (
        np.array(
            [[s * math.sin(math.radians(b)), s * math.cos(math.radians(b))] for _, s, b in rows]
        )
        * knot
    )
    wind = 0.04 * 15 * knot * np.array([math.sin(math.radians(60)), math.cos(math.radians(60))])

    def velocity(x: float, y: float, time: float) -> tuple[float, float]:
        u, v = (np.interp(time / 3600, hours, vector[:, k]) + wind[k] for k in range(2))
        turn = pole * (
            x - start
        )  # the bearing at a meridian is that at the first one, turned by the angle between them
        return u * math.cos(turn) + v * math.sin(turn), v * math.cos(turn) - u * math.sin(turn)

    expected = integrated(start, pole * math.radians(90 - 1 / 60), velocity, 11 * 3600 + 1200)
    assert float(sphere.distance(*final(path), *expected)) < 3.0  # of 36 km


@pytest.mark.thorough
@pytest.mark.parametrize(("axes", "shift"), [("grid", 0.0), ("true", 1250.0)])
def test_a_polar_stereographic_file_is_followed_over_the_pole(
    tmp_path: Path, axes: str, shift: float
) -> None:
    """Components along the grid's own axes, or east and north at each point, values at the pole
    itself; a flow that shears and turns, linear in time.
    """
    import pyproj

    crs = pyproj.CRS.from_proj4("+proj=stere +lat_0=90 +lat_ts=70 +lon_0=-45 +R=6371008.8")
    # no point is the pole itself, where east is any direction
    x = np.arange(-161_250, 161_251, 2500.0)
    y = np.arange(-180_000, 180_001, 2500.0) + shift  # with a shift the pole lies amid a cell
    X, Y = np.meshgrid(x, y)
    hours = np.arange(0, 25)

    def along(px, py, hour):
        """Components along the grid's axes [m/s]."""
        return 0.5 + 2e-6 * py - 0.02 * hour + 0 * px, 0.2 - 3e-6 * px + 0.01 * hour + 0 * py

    u, v = (np.stack([along(X, Y, h)[k] for h in hours]) for k in range(2))
    to_degrees = pyproj.Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    lon, lat = to_degrees.transform(X, Y)
    names = "sea_water_x_velocity", "sea_water_y_velocity"
    if axes == "true":
        at = np.radians(lon + 45)
        u, v = u * np.cos(at) + v * np.sin(at), v * np.cos(at) - u * np.sin(at)
        names = "eastward_sea_water_velocity", "northward_sea_water_velocity"
    time = np.datetime64("2026-03-03T00:00", "ns") + hours * np.timedelta64(1, "h")
    data = xr.Dataset(
        {
            "u": (
                ("time", "y", "x"),
                u,
                {"standard_name": names[0], "units": "m s-1", "grid_mapping": "crs"},
            ),
            "v": (
                ("time", "y", "x"),
                v,
                {"standard_name": names[1], "units": "m s-1", "grid_mapping": "crs"},
            ),
            "crs": ((), 0, crs.to_cf()),
        },
        {
            "x": ("x", x, {"standard_name": "projection_x_coordinate", "units": "m"}),
            "y": ("y", y, {"standard_name": "projection_y_coordinate", "units": "m"}),
            "time": time,
            "lon": (("y", "x"), lon, {"standard_name": "longitude", "units": "degrees_east"}),
            "lat": (("y", "x"), lat, {"standard_name": "latitude", "units": "degrees_north"}),
        },
    )
    data.to_netcdf(tmp_path / "polar.nc")
    start = 89.8
    path = trial_case.write(
        tmp_path,
        start="2026-03-03T00:00Z",
        duration="20 h",
        particles=100,
        uncertainty="none",
        current={"files": "polar.nc"},
        scenario={"position": {"at": [-160.0, start], "error": "0.001 m"}},
    )
    back = pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)

    def velocity(px: float, py: float, seconds: float) -> tuple[float, float]:
        """East and north: the grid's axes are turned by the longitude from the central meridian
        (stereographic is conformal).
        """
        gx, gy = back.transform(math.degrees(px), math.degrees(py))
        a, b = along(gx, gy, seconds / 3600)
        turn = px + math.radians(45)
        return a * math.cos(turn) + b * math.sin(turn), b * math.cos(turn) - a * math.sin(turn)

    expected = integrated(math.radians(-160), math.radians(start), velocity, 20 * 3600, 60.0)
    found = final(path)
    way = float(sphere.distance(math.radians(-160), math.radians(start), *expected))
    assert 25_000 < way < 60_000
    # The regridded tile errs by 0.02 % of the speed: metres of the way.
    assert float(sphere.distance(*found, *expected)) < 15.0


@pytest.mark.thorough
@pytest.mark.parametrize(
    # [m/s] what an hour adds to an error of 100 years: std sqrt(2 h / time)
    ("pole", "error", "kick"),
    [
        (1, {"std": "0.3 m/s", "time": "876000 h"}, 0.3 * math.sqrt(2 / 876_000)),
        (-1, {"std": "0 m/s", "bias": "0.3 m/s"}, 0.0),
    ],
    ids=["error", "bias"],
)
def test_a_lasting_error_of_the_current_leads_over_a_pole_along_a_great_circle(
    tmp_path: Path, pole: int, error: dict[str, str], kick: float
) -> None:
    """What has one error all along is as far from its start after 12, 18 and 24 hours as the first
    six make it.
    """
    case = trial_case.load(
        tmp_path,
        start="2026-03-03T18:00Z",
        duration="24 h",
        particles=1000,
        seed=5,
        uncertainty={"diffusivity": "0 m2/s", "current": error},
        output={"every": "6 h"},
        clock={"step": "1 h"},
        current={"constant": {"east": 0, "north": 0}},
        scenario={"position": {"at": f"90 00{'N' if pole > 0 else 'S'} 000 00E", "error": "3 nmi"}},
    )
    tracks = next(iter(drift.run_many([case])))
    lon, lat = np.radians(tracks.lon), np.radians(tracks.lat)
    far = sphere.distance(lon[0], lat[0], lon, lat)
    assert far.shape == (5, 1000)
    # 0.3 m/s sqrt(2 ln 2) for 24 h: 30.5 km, across the pole
    assert 20_000 < np.median(far[-1]) < 40_000
    # After n hours kicks have led astray by their own size times (n^3 / 3)^1/2.
    hours = 6 * np.arange(5)
    walked = 3600 * kick * np.sqrt(hours**3 / 3)
    # Of the difference between a walk and k times its first six hours; besides, 24 roundings of 5
    # mm, four times.
    tolerance = 4.5 * (walked + hours / 6 * walked[1]) + 0.5
    assert np.all(np.abs(far - np.arange(5)[:, None] * far[1]).max(axis=1) < tolerance)
