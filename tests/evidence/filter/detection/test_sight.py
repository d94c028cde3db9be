"""Looks with sensors of the case:

Bayes by NumPy, SciPy's and xarray's interpolation, and particle by particle.
"""

from pathlib import Path

import numpy as np
import pytest
import sonars
import xarray as xr
from scipy import interpolate, special
from sonars import Sonar, rhumb, run

SCENARIO = """
[[current]]
constant = { speed = "1.2 kn", toward = 63 }
[[scenario]]
name = "raft"
object = "water"
position = { at = AT, std = "25 nmi", time = "+0 h", until = "+2 h" }
"""
LOOK = '[[look]]\nname = "x"\ntime = "+HOUR h"\nsees = "SEES"\nfalse_alarms = 0.04\nsensor = "SENSOR"\n'


def case(at: tuple[float, float], hour: float, sees: str, sensor: str) -> str:
    look = LOOK.replace("HOUR", f"{hour}").replace("SEES", sees).replace("SENSOR", sensor)
    return SCENARIO.replace("AT", f"{list(at)}") + look


def places(ran: sonars.Ran, hour: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where rafts are at a time, and whether they have been released."""
    release = ran.ensemble.release.to_numpy() / 3600
    far = 1.2 * sonars.NMI * np.maximum(hour - release, 0)
    return *rhumb(*ran.first.T, 63.0, far), release <= hour


def bayes(chance: np.ndarray, there: np.ndarray, sees: str) -> np.ndarray:
    seen = 0.04 + 0.96 * np.where(there, chance, 0.0)
    return np.log(seen if sees == "something" else 1 - seen)


@pytest.mark.parametrize("sees", ["something", "nothing"])
def test_a_look_of_a_towed_array(tmp_path: Path, sees: str) -> None:
    """Place and heading are those of the look, and its losses those there, between three places;
    noise by the minute.
    """
    ranges, sides = np.arange(0, 160_001.0, 2500.0), np.arange(0, 360, 15.0)
    radials = np.arange(0, 360, 40.0)
    loss = [
        62
        + (12 + k) * np.log10(1 + ranges / 1e3)
        + 4 * np.sin(np.radians(radials + 50 * k))[:, None]
        for k in range(3)
    ]
    sonar = Sonar(
        places=((179.5, 31.0), (-178.9, 31.2), (-179.9, 32.9)), radials=radials, ranges=ranges, loss=np.round(loss, 3),
        hours=(0.0, 3.0, 6.0), around=np.arange(0, 360, 45.0), sides=sides, gain=np.round(4 + 6 * np.cos(np.radians(sides - 50)), 3),
        noise=np.array([[70, 73, 71, 75, 72, 70, 74, 69.0], [72, 75, 74, 75, 73, 71, 75, 70], [69, 70, 74, 77, 72, 75, 70, 69]]),
        levels={"raft": [(0.2, 148.0), (2.2, 160.0)]},
    )  # fmt: skip
    look = case((-179.9, 31.7), 1.35, sees, "ears") + "at = [179.9, 31.6]\nheading = 305\n"
    ran = run(tmp_path, look + sonar.text(tmp_path), particles=500)
    lon, lat, there = places(ran, 1.35)
    source = sonar.source("raft", 1.2)
    chance = sonar.chance(sonar.excess((179.9, 31.6), 305.0, 1.35, lon, lat) + source)
    assert np.ptp(chance) > 0.5
    assert 0.3 < there.mean() < 0.9
    # Gains are laid out to 0.1 degree, weights are float32.
    np.testing.assert_allclose(ran.said, bayes(chance, there, sees), atol=2e-3)


def table(path: Path, data: xr.Dataset) -> str:
    data.to_netcdf(path / "pod.nc")
    return '[[sensor]]\nname = "radar"\npod = { file = "pod.nc" }\n'


@pytest.mark.parametrize("sees", ["something", "nothing"])
@pytest.mark.parametrize("west", [-30.9, 179.2])
def test_pod_by_place_and_time(tmp_path: Path, sees: str, west: float) -> None:
    """As xarray interpolates in time, latitude and longitude; nothing is seen beyond the grid."""
    random = np.random.default_rng(2)
    lon, lat = west + np.arange(13) * 0.1, 35.5 + np.arange(9) * 0.15
    times = np.datetime64("2026-06-01T00:00", "ns") + np.array([0, 2, 5]) * np.timedelta64(1, "h")
    pod = random.random((3, 9, 13)).astype(np.float32)
    data = xr.Dataset(
        {"pod": (("time", "lat", "lon"), pod)},
        {
            "time": times,
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", lon, {"units": "degrees_east"}),
        },
    )
    ran = run(
        tmp_path,
        case((west + 0.7, 36.0), 1.35, sees, "radar") + table(tmp_path, data),
        particles=500,
    )
    x, y, there = places(ran, 1.35)
    x = west + (x - west + 1) % 360 - 1
    at = np.datetime64("2026-06-01T01:21", "ns")
    chance = data.pod.interp(time=at, lat=xr.DataArray(y), lon=xr.DataArray(x)).fillna(0).values
    assert 0.5 < (chance > 0).mean() < 0.99
    np.testing.assert_allclose(ran.said, bayes(chance, there, sees), atol=2e-4)


def test_pod_by_bearing_and_range(tmp_path: Path) -> None:
    """As SciPy interpolates on a grid that goes on round the circle; nothing is seen beyond the
    last range.
    """
    random = np.random.default_rng(4)
    bearing, ranges = np.arange(0, 360, 20.0), np.array([500.0, 4000, 9000, 20_000, 45_000, 60_000])
    pod = random.random((18, 6)).astype(np.float32)
    data = xr.Dataset(
        {"pod": (("bearing", "range"), pod)},
        {
            "bearing": ("bearing", bearing, {"units": "degrees"}),
            "range": ("range", ranges, {"units": "m"}),
        },
    )
    at = (179.95, -61.0)
    ran = run(
        tmp_path,
        case((-179.9, -61.1), 1.35, "nothing", "radar")
        + f"at = {list(at)}\n"
        + table(tmp_path, data),
        particles=500,
    )
    x, y, there = places(ran, 1.35)
    toward, far = sonars.toward(at, x, y)
    grid = interpolate.RegularGridInterpolator(
        (np.append(bearing, 360.0), ranges), np.concatenate([pod, pod[:1]])
    )
    chance = grid(np.stack([toward % 360, np.clip(far, ranges[0], ranges[-1])], axis=-1))
    chance = np.where(far <= ranges[-1], chance, 0.0)
    assert 0.3 < (far <= ranges[-1]).mean() < 0.99
    np.testing.assert_allclose(ran.said, bayes(chance, there, "nothing"), atol=2e-4)


def test_looks_without_false_alarms_are_as_sure_as_their_pod(tmp_path: Path) -> None:
    """A look that saw something rules out what is beyond its table."""
    sonar = Sonar(at=(-30.0, 36.0), ranges=np.array([0.0, 30_000.0]), levels={"raft": 150.0})
    look = case((-30.2, 36.1), 3.0, "something", "ears").replace("false_alarms = 0.04\n", "")
    ran = run(tmp_path, look + sonar.text(tmp_path), particles=300)
    lon, lat, _ = places(ran, 3.0)
    over = sonar.excess((-30.0, 36.0), 0.0, 3.0, lon, lat) + 150.0
    far = over == -np.inf
    assert 0.1 < far.mean() < 0.9
    assert np.all(ran.said[far] == -np.inf)
    np.testing.assert_allclose(ran.said[~far], np.log(special.ndtr(over[~far] / 6)), atol=2e-4)
