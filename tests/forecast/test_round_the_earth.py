"""No probability is lost at a pole, nor where particles lie all round the Earth: maps sum to 1."""

from collections.abc import Callable

import numpy as np
import pytest

from drift.engine.particles.snapshot import Snapshot
from drift.forecast.build import build_forecast, grid_of
from geo import sphere
from geo.array import Array
from geo.cells import Cells
from kernels.runtime import runtime

N = 5003


def snapshot(lon_deg: Array, lat_deg: Array, hours: int = 0) -> Snapshot:
    runtime.start()
    lon = np.clip(lon_deg * sphere.TURN / 360, -(2**31), 2**31 - 1).astype(np.int32)
    lat = np.rint(np.clip(lat_deg, -90, 90) * sphere.TURN / 360).astype(np.int32)
    still = np.zeros(N, np.int32)
    return Snapshot(
        np.datetime64("2026-11-27") + np.timedelta64(hours, "h"),
        lon,
        lat,
        np.full(N, 1 / N),
        still,
        still,
    )


def about(random: np.random.Generator, west: float, east: float) -> Array:
    """Return longitudes, more of them about 0 E, so that the mean lies there."""
    return np.where(random.random(N) < 0.3, random.normal(0, 5, N), random.uniform(west, east, N))


@pytest.mark.parametrize(
    "latitudes",
    [
        lambda random: 90 - 0.01 * np.sqrt(random.random(N)),
        lambda random: -90 + 0.01 * np.sqrt(random.random(N)),
        lambda random: 90 - 3 * np.sqrt(random.random(N)),
        lambda random: random.normal(80, 1, N),
        lambda random: random.normal(-60, 1, N),
    ],
    ids=[
        "1 km about the north pole",
        "1 km about the south pole",
        "3 degrees about a pole",
        "80 N",
        "60 S",
    ],
)
def test_a_map_round_the_earth_sums_to_one(
    latitudes: Callable[[np.random.Generator], Array],
) -> None:
    random = np.random.default_rng(3)
    made = build_forecast(
        [snapshot(random.uniform(-180, 180, N), latitudes(random))], scenarios=["a"]
    )
    assert float(made.probability.sum()) == pytest.approx(1, abs=1e-6)  # stored in float32


@pytest.mark.parametrize("span", [(-175, 179.9), (-150, 179.9), (-120, 100)])
def test_a_narrower_cloud_beside_one_round_the_earth_keeps_its_probability(
    span: tuple[float, float],
) -> None:
    random = np.random.default_rng(3)
    latitudes = random.normal(75, 1, N)
    outputs = [
        snapshot(about(random, *own), latitudes, hours)
        for hours, own in enumerate(((-180, 180), span))
    ]
    sums = build_forecast(outputs, scenarios=["a"]).probability.sum(["lat", "lon"]).values
    assert sums == pytest.approx([1, 1], abs=1e-6)


@pytest.mark.parametrize("west", [-180, -30])
def test_a_given_grid_round_the_earth_holds_a_cloud_across_its_edge(west: int) -> None:
    random = np.random.default_rng(5)
    degree = sphere.TURN // 360 // 16 * 16
    grid = Cells(west * degree, 0, degree, degree, -(-sphere.TURN // degree), 90)
    cloud = snapshot(west + random.normal(0, 2, N), random.normal(40, 1, N))
    made = build_forecast([cloud], scenarios=["a"], grid=grid)
    assert float(made.probability.sum()) == pytest.approx(1, abs=1e-6)
    at = made.probability.sum("lat").squeeze()
    near = np.abs((at.lon.values - west + 180) % 360 - 180) < 9
    assert float(at.values[near].sum()) > 0.999  # the rest lies in the kernels of outliers


def test_the_grid_chosen_for_a_cloud_about_a_pole_holds_all_of_it() -> None:
    random = np.random.default_rng(7)
    cloud = snapshot(random.uniform(-180, 180, N), 90 - 0.01 * np.sqrt(random.random(N)))
    made = build_forecast([cloud], scenarios=["a"], grid=grid_of([cloud], 1))
    assert float(made.probability.sum()) == pytest.approx(1, abs=1e-6)
