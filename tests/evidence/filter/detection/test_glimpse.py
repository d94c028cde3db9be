"""Watches with a table of POD: hazards along ways, against xarray's and SciPy's interpolation,
pyproj's geodesics and quadrature.

Ways are those that the run tells, straight from step to step. Tolerances: parts of half a cell err
by less than 0.2 % of a hazard here.
"""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import trial_case
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

import drift
from geo import sphere

GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
NMI, HOUR = 1852.0, 3600.0
FINE = 60  # points of a step at which the oracle asks
WATCH = """
[[sensor]]
name = "radar"
{at}
pod = {{ file = "pod.nc"{per} }}
[[sortie]]
name = "watched"
start = "+1 h"
end = "+4.7 h"
{way}
watch.sensor = "radar"
"""


def run(
    tmp_path: Path, pod: xr.DataArray, at: str = "", per: str = "", way: str = ""
) -> drift.Result:
    pod.to_dataset(name="pod").to_netcdf(tmp_path / "pod.nc")
    case = trial_case.load(
        tmp_path,
        WATCH.format(at=at, per=per, way=way),
        particles=2000,
        output={"every": "30 min", "trajectories": 2000},
        clock={"step": "30 min"},
        uncertainty="none",
        current={"constant": {"speed": "3 kn", "toward": 70}},
        scenario={"position": {"at": [179.9, 51.3], "std": "6 nmi"}},
    )
    return drift.run(case)


def paths(result: drift.Result) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [h] (t,) in the middle of fine parts of the watch, and lon, lat [deg] (n, t)
    there.
    """
    tracks = result.trajectories
    assert tracks is not None
    hours = (tracks.time - tracks.time[0]) / np.timedelta64(1, "h")
    lon = np.unwrap(np.radians(np.asarray(tracks.lon) * (360 / 2**32)), axis=1)
    lat = np.asarray(tracks.lat) * (360 / 2**32)
    when = np.arange(1.0, 4.7, 0.5 / FINE) + 0.25 / FINE
    found = [
        np.array([np.interp(when, hours, own) for own in values])
        for values in (np.degrees(lon), lat)
    ]
    return when, *found


def agree(result: drift.Result, hazard: np.ndarray) -> None:
    """Hold the weights of particles against misses exp(-hazard), (n,)."""
    assert result.updates is not None
    assert result.trajectories is not None
    missed = np.exp(-hazard)
    (update,) = result.updates.all
    assert 0.05 < update.pos[-1] < 0.95
    assert update.pos[-1] == pytest.approx(1 - missed.mean(), abs=2e-3)
    weight = np.asarray(result.trajectories.weight[:, -1])
    seen = missed > 1e-4
    np.testing.assert_allclose(
        weight[seen] / weight[seen].sum(), missed[seen] / missed[seen].sum(), rtol=1e-2
    )


def by_place() -> xr.DataArray:
    """Return POD on a grid across the antimeridian, that changes in an hour of the watch."""
    lon, lat = np.arange(179.7, 180.5, 0.05), np.arange(51.1, 51.6, 0.03)
    x, y = np.meshgrid(lon, lat)
    bump = 0.8 * np.exp(-(((x - 180.05) / 0.15) ** 2) - ((y - 51.35) / 0.1) ** 2)
    return xr.DataArray(bump, {"lat": lat, "lon": lon}, ("lat", "lon"), attrs={"units": "1"})


@pytest.mark.thorough
@pytest.mark.parametrize(("per", "scale"), [("", 3.7), (', per = "1 h"', 1.0)])
def test_by_place(tmp_path: Path, per: str, scale: float) -> None:
    pod = by_place()
    result = run(tmp_path, pod, per=per)
    when, lon, lat = paths(result)
    there = pod.interp(
        lon=xr.DataArray(np.mod(lon, 360), dims=("n", "t")), lat=xr.DataArray(lat, dims=("n", "t"))
    )
    hazard = -np.log1p(-there.fillna(0).values)
    agree(result, hazard.sum(axis=1) * (when[1] - when[0]) / scale)


@pytest.mark.thorough
def test_it_changes_with_time(tmp_path: Path) -> None:
    times = np.datetime64("2026-11-21T00:00") + np.array([0, 150, 400], "timedelta64[m]")
    pod = by_place().expand_dims(time=times) * xr.DataArray([0.2, 1.0, 0.4], dims="time")
    pod.attrs["units"] = "1"
    result = run(tmp_path, pod.astype("f4"), per=', per = "1 h"')
    when, lon, lat = paths(result)
    # It is taken in the middle of each step.
    middle = np.minimum(np.floor(when / 0.5) * 0.5 + 0.25, 4.6)
    moment = times[0] + (middle * 3600).astype("timedelta64[s]")
    there = pod.interp(
        time=xr.DataArray(moment, dims="t"), lon=xr.DataArray(np.mod(lon, 360), dims=("n", "t")),
        lat=xr.DataArray(lat, dims=("n", "t")),
    ).transpose("n", "t")  # fmt: skip
    agree(result, -np.log1p(-there.fillna(0).values).sum(axis=1) * (when[1] - when[0]))


@pytest.mark.thorough
def test_round_a_carrier_that_moves(tmp_path: Path) -> None:
    """Uneven bearings and ranges; from pole to pole of its circle."""
    bearing, ranges = (
        np.array([0.0, 40, 90, 130, 180, 240, 300, 350]),
        np.array([1.0, 3, 7, 12, 20]) * 1000,
    )
    pod = (
        0.9
        * np.exp(-((ranges / 9000) ** 2))[None]
        * (1 + 0.5 * np.cos(np.radians(bearing - 70)))[:, None]
        / 1.5
    )
    table = xr.DataArray(
        pod, {"bearing": ("bearing", bearing, {"units": "degrees"}), "range": ("range", ranges, {"units": "m"})},
        ("bearing", "range"), attrs={"units": "1"},
    )  # fmt: skip
    ends = (179.95, 51.2), (-179.9, 51.45)
    way = f'waypoints = [["+1 h", {list(ends[0])}], ["+4.7 h", {list(ends[1])}]]'
    result = run(tmp_path, table, per=', per = "1 h"', way=way)
    when, lon, lat = paths(result)
    azimuth, _, length = GEOD.inv(*ends[0], *ends[1])
    share = (when - 1) / 3.7
    n = np.ones(len(when))
    x, y, _ = GEOD.fwd(ends[0][0] * n, ends[0][1] * n, azimuth * n, share * length)
    shape = lon.shape
    toward, _, far = GEOD.inv(np.broadcast_to(x, shape), np.broadcast_to(y, shape), lon, lat)
    around = np.append(bearing, 360), np.concatenate([[0.0], ranges])
    padded = np.concatenate([pod[:, :1], pod], axis=1)  # nearer than the first range it is as there
    ask = RegularGridInterpolator(
        around, np.concatenate([padded, padded[:1]]), bounds_error=False, fill_value=0.0
    )
    hazard = -np.log1p(-ask(np.stack([np.mod(toward, 360), far], axis=-1)))
    agree(result, hazard.sum(axis=1) * (when[1] - when[0]))


@pytest.mark.thorough
def test_a_pod_of_one_leaves_a_chance(tmp_path: Path) -> None:
    result = run(tmp_path, xr.ones_like(by_place()).assign_attrs(units="1"), per=', per = "1 h"')
    assert result.trajectories is not None
    assert np.all(np.isfinite(result.trajectories.weight))
    assert result.updates is not None
    assert 0.3 < result.updates.all[0].pos[-1] < 1


BRIDGE = """
title = "bridge"
start = "2026-11-21T00:00Z"
duration = "8 h"
particles = 10000
seed = 3
clock.step = "{step} min"
coast.source = "none"
[[scenario]]
name = "ship"
[[scenario.phase]]
[scenario.phase.bridge]
k = "4 nmi/sqrt(h)"
[[scenario.phase.bridge.points]]
at = [179.6, 0.1]
std = "0.5 nmi"
time = "+0 h"
[[scenario.phase.bridge.destinations]]
at = [-179.6, -0.1]
std = "0.5 nmi"
time = "+8 h"
probability = 1
"""


@pytest.mark.thorough
def test_bridges_wander_into_a_table_and_out_of_it(tmp_path: Path) -> None:
    """Against bridges by steps of 24 s in the plane, on the equator; at any step."""
    lon, lat = np.linspace(179.9, 180.1, 21), np.linspace(-0.06, 0.06, 13)
    pod = np.full((len(lat), len(lon)), 0.9)
    xr.DataArray(pod, {"lat": lat, "lon": lon}, ("lat", "lon"), attrs={"units": "1"}).to_dataset(
        name="pod"
    ).to_netcdf(tmp_path / "pod.nc")
    found = []
    for step in (60, 15):
        (tmp_path / "case.toml").write_text(
            BRIDGE.format(step=step)
            + WATCH.format(at="", per=', per = "1 h"', way="").replace("+4.7 h", "+8 h")
        )
        updates = drift.run(drift.load(tmp_path / "case.toml")).updates
        assert updates is not None
        found.append(updates.all[0].pos[-1])
    random, steps, many = np.random.default_rng(9), 1200, 8000
    unit = 1 / 60  # [deg] of a mile
    begin = np.array([179.6, 0.1]) + 0.5 * unit * random.standard_normal((many, 2))
    end = np.array([180.4, -0.1]) + 0.5 * unit * random.standard_normal((many, 2))
    at, hazard = begin, np.zeros(many)
    for k in range(steps):
        left = (steps - k) * 8 / steps
        dt = 8 / steps
        spread = 4 * unit * np.sqrt(dt * (left - dt) / left)
        after = at + (end - at) * dt / left + spread * random.standard_normal((many, 2))
        if (k + 0.5) * dt >= 1:
            for point in (at, after):
                inside = (np.abs(point[:, 0] - 180.0) <= 0.1 + 1e-9) & (
                    np.abs(point[:, 1]) <= 0.06 + 1e-9
                )
                hazard += 0.5 * inside * dt * -np.log(0.1)
        at = after
    missed = np.exp(-hazard)
    error = missed.std() * np.sqrt(1 / many + 1 / 10_000)
    for pos in found:
        assert abs(pos - (1 - missed.mean())) < 3 * error
    assert found[0] == pytest.approx(found[1], abs=4 * missed.std() / np.sqrt(10_000))
