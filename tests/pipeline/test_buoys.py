"""Runs with drifting buoys, against particles in NumPy whose errors are drawn given the tracks."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from buoys import conditioned

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.engine.motion.buoy_errors import Fixes, Law, correlation
from drift.pipeline import run_setup
from geo import sphere
from kernels.runtime import runtime

HOUR = 3600.0
LON, LAT = 179.95, 0.02  # near the equator, where degrees are a plane; particles cross 180
METRES = np.radians(1.0) * sphere.RADIUS
CURRENT = 0.4 * 1852 / 3600 * np.array([np.sin(np.radians(61)), np.cos(np.radians(61))])
LAW = Law(0.22, 9 * HOUR, 8_000.0, 0.06, 0.0, 1.0, 1e5, 0.0)
ERROR, AWAY = 25.0, np.array([3_000.0, -2_500.0])  # [m] of fixes; of the buoy from the datum
N = 40_000
CASE = """
title = "A raft beside buoys"
start = "2026-03-05T00:00Z"
duration = "{hours} h"
particles = {particles}
coast = {{ source = "none" }}
clock = {{ step = "{step}" }}
output = {{ every = "{hours} h" }}
[[current]]
constant = {{ speed = "0.4 kn", toward = 61 }}
[uncertainty]
current = {{ std = "0.22 m/s", time = "9 h", bias = "0.06 m/s", length = "8 km" }}
[[scenario]]
name = "raft"
object = "water"
position = {{ at = [179.95, 0.02], std = "1.5 km" }}
{more}
"""
BUOY = '[[drifter]]\ntrack = "{}.csv"\nerror = "25 m"\n'


def write_track(folder: Path, name: str, time: Any, east: Any, north: Any) -> None:
    """Write fixes at times [s after the start] and places [m] from the datum."""
    lon = (LON + np.asarray(east) / METRES + 180) % 360 - 180
    lat = LAT + np.asarray(north) / METRES
    begin = np.datetime64("2026-03-05T00:00:00")
    rows = [
        f"{begin + np.timedelta64(int(t), 's')}Z,{x:.8f},{y:.8f}"
        for t, x, y in zip(time, lon, lat, strict=True)
    ]
    (folder / f"{name}.csv").write_text("\n".join(["time,lon,lat", *rows]) + "\n")


def moved(folder: Path, more: str, **keys: Any) -> tuple[Any, np.ndarray]:
    """Return the start of a case's run, moved to its end, and its places there [m], (n, 2)."""
    words = {"hours": 16, "particles": N, "step": "15 min", **keys}
    path = folder / "case.toml"
    path.write_text(CASE.format(more=more, **words))
    case = case_file.load(path)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    list(simulate.run(begin.ensemble, begin.scene, begin.clock, np.empty(0)))
    begin.scene.forcing.close()
    lon = (begin.ensemble.lon.to_numpy() - sphere.to_binary(LON)).astype(np.int32)
    lat = begin.ensemble.lat.to_numpy()
    east, north = (np.degrees(x * sphere.UNIT) * METRES for x in (lon, lat))
    return begin, np.stack([east, north - LAT * METRES], axis=-1)


def drifting_buoy(times: Any, pull: Any) -> np.ndarray:
    """Return places [m] of a buoy at times [s] that drifts with the current and an error [m/s]."""
    return AWAY + np.outer(times, CURRENT + pull)


def expected(fixes: Fixes, last: float, dt: float, n: int, hours: float = 16) -> np.ndarray:
    """Return places [m] (n, 2) at the end of particles whose errors are drawn given the fixes.

    The buoy begins at AWAY and drifts steadily until its last fix; after it, its error fades.
    """
    times = np.arange(0, hours * HOUR + dt / 2, dt)
    mean, covariance, _ = conditioned(
        LAW, (np.ones((1, 1)), np.ones((1, 1))), np.zeros(1), np.array([ERROR]), [fixes], times
    )
    k = times.size
    pick = np.append(3 * np.arange(k), 2)  # the current's errors, and the bias
    root = np.linalg.cholesky(covariance[np.ix_(pick, pick)] + 1e-10 * np.eye(k + 1))
    random = np.random.default_rng(11)
    normals = random.normal(size=(k + 1, n, 2))
    drawn = mean[pick, 0][:, None] + np.einsum("ij,jnc->inc", root, normals)
    error, bias = drawn[:k], drawn[k]
    keep = np.exp(-dt / LAW.current_time)
    own, own_bias = random.normal(size=(2, n, 2))
    place = random.normal(size=(n, 2)) * 1500.0
    fade = (fixes.excess[0, -1] / (last - fixes.time[0])) * LAW.current_time

    def pulled(step: int, x: np.ndarray, own: np.ndarray) -> np.ndarray:
        t = times[step]
        beyond = max(t - last, 0.0)
        buoy = (
            AWAY + CURRENT * t + fixes.excess[0, -1] * min(t, last) / last
            + fade * (1 - np.exp(-beyond / LAW.current_time))
        )  # fmt: skip
        share = correlation(np.hypot(*(x - buoy).T), LAW.current_length)[:, None]
        left = np.sqrt(1 - share**2)
        return LAW.current_std * (share * error[step] + left * own) + LAW.bias_std * (
            share * bias + left * own_bias
        )

    for step in range(k - 1):
        later = keep * own + np.sqrt(1 - keep**2) * random.normal(size=(n, 2))
        first = pulled(step, place, own)
        there = place + dt * (CURRENT + first)
        place = place + dt * (CURRENT + 0.5 * (first + pulled(step + 1, there, later)))
        own = later
    return place


@pytest.mark.parametrize("step", ["30 min", "5 min"])
def test_a_cloud_beside_a_buoy_is_that_of_conditioned_errors(tmp_path: Path, step: str) -> None:
    """Mean and covariance, at two steps; the buoy is seen for 9 of 16 hours."""
    time, pull = np.arange(0, 9 * HOUR + 1, 1800.0), np.array([0.21, -0.13])
    write_track(tmp_path, "buoy", time, *drifting_buoy(time, pull).T)
    _, own = moved(tmp_path, BUOY.format("buoy"), step=step)
    excess = np.outer(time, pull)[None]
    fixes = Fixes(time, time == 0, excess, ERROR, 0.0)
    other = expected(fixes, time[-1], 300.0, N)
    compare(own, other)
    alone = moved(tmp_path, "", step=step)[1]
    assert np.linalg.det(np.cov(own.T)) < 0.93 * np.linalg.det(np.cov(alone.T))


def compare(own: np.ndarray, other: np.ndarray) -> None:
    """Hold mean and covariance of two clouds to 3.5 standard errors of their difference."""
    for axis in range(2):
        error = np.hypot(own[:, axis].std(), other[:, axis].std()) / np.sqrt(len(own))
        assert abs(own[:, axis].mean() - other[:, axis].mean()) < 3.5 * error
    a, b = own - own.mean(axis=0), other - other.mean(axis=0)
    for i, j in ((0, 0), (0, 1), (1, 1)):
        one, two = a[:, i] * a[:, j], b[:, i] * b[:, j]
        error = np.hypot(one.std(), two.std()) / np.sqrt(len(own))
        assert abs(one.mean() - two.mean()) < 3.5 * error, (i, j)
