"""The containment of a point: how it is read between cells, whether it is true, and how much of it
is noise.
"""

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from drift.engine.particles.snapshot import Snapshot
from drift.forecast import build as forecast_build
from drift.forecast import containment, density
from geo import sphere
from geo.errors import UserError

LON, LAT = 4.1, 60.3  # [deg] of the middle of the clouds
TIME = np.datetime64("2026-11-21T18:30:00", "s")
N = 4000


def law(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A banana and a small cloud beside one of its ends: points (east, north) [m]."""
    t = rng.normal(size=n)
    east, north = 12_000 * t, 5000 * (t**2 - 1) + 3000 * rng.normal(size=n)
    aside = rng.random(n) < 0.25
    east[aside] = 25_000 + 2500 * rng.normal(size=aside.sum())
    north[aside] = -9000 + 4000 * rng.normal(size=aside.sum())
    return east, north


def thickness(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """The density of the law [1/m2]."""
    t = east / 12_000
    banana = stats.norm.pdf(t) / 12_000 * stats.norm.pdf(north, 5000 * (t**2 - 1), 3000)
    return 0.75 * banana + 0.25 * stats.norm.pdf(east, 25_000, 2500) * stats.norm.pdf(
        north, -9000, 4000
    )


def exact(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """The share of the law that is denser than points, by 400,000 draws: known to 0.0008."""
    draws = np.sort(-thickness(*law(400_000, np.random.default_rng(1))))
    return np.searchsorted(draws, -thickness(east, north)) / draws.size


def degrees(east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    lon, lat = sphere.destination(np.radians(LON), np.radians(LAT), east, north)
    return np.degrees(lon), np.degrees(lat)


def forecast(seed: int) -> forecast_build.Forecast:
    lon, lat = (sphere.to_binary(x) for x in degrees(*law(N, np.random.default_rng(seed))))
    none = np.zeros(N, np.int32)
    return forecast_build.build_forecast(
        [Snapshot(TIME, lon, lat, np.full(N, 1 / N), none, none)], scenarios=["only"]
    )


def test_truths_of_the_law_lie_at_every_containment_alike() -> None:
    """Uniform on (0, 1) by Kolmogorov and Smirnov, and each area holds its share within 3 standard
    errors.

    Truths of one map share its error: its calibration stands on N particles, so that of a share p
    the map's own varies by p (1 - p) / N, and k truths of each map have 1 + (k - 1) / N times the
    variance that as many independent ones have.
    """
    maps, each = 16, 100
    level = []
    for k in range(maps):
        rng = np.random.default_rng((7, k))
        level.append(forecast(100 + k).containment_at(TIME, *degrees(*law(each, rng))))
    wide = np.sqrt(1 + (each - 1) / N)
    drawn = np.concatenate(level)
    assert stats.kstest(drawn, "uniform").statistic < wide * stats.kstwobign.isf(0.0027) / np.sqrt(
        drawn.size
    )
    for share in (0.1, 0.3, 0.5, 0.75, 0.9, 0.95):
        error = wide * np.sqrt(share * (1 - share) / drawn.size)
        assert abs(np.mean(drawn <= share) - share) < 3 * error, share


def test_wide_kernels_where_it_is_dense_take_noise_away_and_no_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Against the law itself, within its 50 % area: the error of both kinds together, and its part
    that seeds make.
    """
    east, north = law(300, np.random.default_rng(3))
    inner = exact(east, north) < 0.5
    truth, points = exact(east, north)[inner], degrees(east[inner], north[inner])

    def read() -> tuple[float, float]:
        seen = np.stack([forecast(k).containment_at(TIME, *points) for k in range(6)])
        return float(np.sqrt(((seen - truth) ** 2).mean())), float(seen.std(axis=0, ddof=1).mean())

    error, noise = read()
    monkeypatch.setattr(density, "WIDER", 1.0)
    error_before, noise_before = read()
    assert error < error_before
    assert (
        noise < 0.8 * noise_before
    )  # in the core m is up to 4 times as many: half the noise where the density is highest


def round_cloud(west: float, size: int) -> xr.Dataset:
    """Containment 1 - exp(-r^2 / 2) of a normal on cells, r in degrees of longitude and 0.5 degrees
    of latitude.
    """
    lon, lat = west + 0.05 * (np.arange(size) + 0.5), -3 + 0.04 * (np.arange(size + 20) + 0.5)
    x, y = np.meshgrid(lon - lon.mean() - 0.013, (lat - lat.mean() + 0.021) / 0.5)
    inside = 1 - np.exp(-(x**2 + y**2) / 2)
    here = ("time", "lat", "lon")
    data = {
        "containment": (here, inside[None]),
        "probability": (here, np.exp(-(x**2 + y**2) / 2)[None]),
    }
    times = np.array([TIME], "datetime64[ns]")
    return xr.Dataset(data, {"time": times, "lat": lat, "lon": lon})


@pytest.mark.parametrize("west", [-2.0, 177.7])
def test_between_cells_a_normal_is_read_as_it_is(west: float) -> None:
    data = round_cloud(west, 90)
    rng = np.random.default_rng(5)
    lon, lat = rng.uniform(west + 1, west + 3.5, 500), rng.uniform(-2.2, 0.2, 500)
    x = lon - float(data.lon.mean()) - 0.013
    y = (lat - float(data.lat.mean()) + 0.021) / 0.5
    # The logarithm is a parabola: bilinear between centres it is off by h^2 / 8 a direction, h in
    # standard deviations.
    off = (0.05**2 + (0.04 / 0.5) ** 2) / 8
    outside = np.exp(-(x**2 + y**2) / 2)
    wrapped = (lon + 180) % 360 - 180
    found = containment.containment_at(data, TIME, wrapped, lat)
    assert (np.abs((1 - found) / outside - 1) < np.expm1(off) + 1e-9).all()


def test_where_nothing_is_all_is_needed_and_a_coast_is_no_slope() -> None:
    data = round_cloud(-2.0, 60)
    dry = data["probability"].values[0]
    dry[:, 35:] = 0.0  # land
    data["containment"].values[0][dry == 0] = 1.0
    edge = float(data.lon[34])
    lat = float(data.lat[40])
    at_shore = containment.containment_at(
        data, TIME, [edge - 0.01, edge, edge + 0.02, edge + 0.04], lat
    )
    assert at_shore[3] == 1.0  # in a cell that holds nothing
    assert at_shore[1:3] == pytest.approx([float(data["containment"][0, 40, 34])] * 2)
    assert at_shore[0] < at_shore[1] + 0.02
    assert (containment.containment_at(data, TIME, [170.0, 0.0], [0.0, 50.0]) == 1.0).all()
    with pytest.raises(
        UserError, match=r"no output is at that time; there are 1, from 211830ZNOV26"
    ):
        containment.containment_at(data, TIME + np.timedelta64(1, "h"), 0.0, 0.0)
