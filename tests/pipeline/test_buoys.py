"""Runs with drifting buoys, against particles in NumPy whose errors are drawn given the tracks."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from buoys import conditioned

import drift
from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.engine.motion.errors.buoy_errors import Fixes, Law, correlation
from drift.pipeline import buoy_effect, run_setup
from geo import sphere
from geo.errors import UserError
from kernels.runtime import runtime

HOUR = 3600.0
LON, LAT = 179.95, 0.02  # near the equator, where degrees are a plane; particles cross 180
METRES = np.radians(1.0) * sphere.RADIUS
CURRENT = 0.4 * 1852 / 3600 * np.array([np.sin(np.radians(61)), np.cos(np.radians(61))])
LAW = Law(0.22, 9 * HOUR, 8_000.0, 0.06, 0.0, 1.0, 1e5, 0.0)
ERROR, AWAY = 25.0, np.array([3_000.0, -2_500.0])  # [m] of fixes; of the buoy from the datum
N = 20_000
CASE = """
title = "A raft beside buoys"
start = "2026-03-05T00:00Z"
duration = "{hours} h"
particles = {particles}
seed = {seed}
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
    words = {"hours": 16, "particles": N, "step": "15 min", "seed": 1, **keys}
    path = folder / "case.toml"
    path.write_text(words.pop("text", CASE).format(more=more, **words))
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
    drawn = mean[pick, 0][:, None] + np.tensordot(root, normals, axes=1)
    error, bias = drawn[:k], drawn[k]
    keep = np.exp(-dt / LAW.current_time)
    own, own_bias, place = random.normal(size=(3, n, 2))
    place = place * 1500.0
    # the mean error at the last fix, of which the changing part fades
    past = round(last / dt)
    fade, lasting = LAW.current_std * mean[3 * past, 0], LAW.bias_std * mean[2, 0]

    def near(step: int, x: np.ndarray) -> np.ndarray:
        t = times[step]
        beyond = max(t - last, 0.0)
        buoy = (
            AWAY + CURRENT * t + fixes.excess[0, -1] * min(t, last) / last + lasting * beyond
            + fade * LAW.current_time * (1 - np.exp(-beyond / LAW.current_time))
        )  # fmt: skip
        return correlation(np.hypot(*(x - buoy).T), LAW.current_length)[:, None]

    share = near(0, place)
    left = np.sqrt(1 - share**2)
    lasts = LAW.bias_std * (share * bias + left * own_bias)
    present = share * error[0] + left * own
    for step in range(k - 1):
        share = near(step, place)
        kick = (error[step + 1] - keep * error[step]) / np.sqrt(1 - keep**2)
        kick = share * kick + np.sqrt(1 - share**2) * random.normal(size=(n, 2))
        later = keep * present + np.sqrt(1 - keep**2) * kick
        place = place + dt * (CURRENT + lasts + LAW.current_std * 0.5 * (present + later))
        present = later
    return place


@pytest.mark.parametrize("step", ["30 min", pytest.param("5 min", marks=pytest.mark.thorough)])
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
    assert np.linalg.det(np.cov(own.T)) < np.linalg.det(np.cov(alone.T))


@pytest.mark.parametrize("pull", [np.zeros(2), np.array([0.3, -0.2])])
def test_before_its_first_fix_a_buoy_is_where_its_water_was(
    tmp_path: Path, pull: np.ndarray
) -> None:
    """With the current alone where it follows the current; else between that and its own pace."""
    time = np.arange(5, 11.01, 0.5) * HOUR
    write_track(tmp_path, "buoy", time, *drifting_buoy(time, pull).T)
    begin, _ = moved(tmp_path, BUOY.format("buoy"), particles=200)
    lon, lat = begin.scene.buoys.places[0, 0]
    place = np.array([(lon - LON + 180) % 360 - 180, lat - LAT]) * METRES
    own = AWAY  # where it would have been at its own pace
    by_current = AWAY + pull * 5 * HOUR
    if not pull.any():
        np.testing.assert_allclose(place, own, atol=5)  # of places in 1e-8 degrees, over 5 hours
    else:
        shares = (place - by_current) / (own - by_current)
        assert (shares > 0.6).all()
        assert (shares < 1).all()


def test_a_buoy_that_shows_nothing_changes_nothing(tmp_path: Path) -> None:
    """Its fixes are right to 1,000 km; particles move from beside it to where it says little."""
    time = np.arange(0, 9 * HOUR + 1, 1800.0)
    write_track(tmp_path, "buoy", time, *drifting_buoy(time, np.array([0.21, -0.13])).T)
    _, own = moved(tmp_path, BUOY.format("buoy").replace("25 m", "1000 km"), step="30 min")
    compare(own, moved(tmp_path, "", step="30 min", seed=2)[1])


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


THREE = """members = [{ constant = { speed = "0.4 kn", toward = 61 } }, { constant = { speed = "0.7 kn", toward = 40 } },
 { constant = { speed = "0.3 kn", toward = 200 } }]"""


def velocity(knots: float, toward: float) -> np.ndarray:
    """Return (east, north) [m/s]."""
    return knots * 1852 / 3600 * np.array([np.sin(np.radians(toward)), np.cos(np.radians(toward))])


def likelihoods(time: np.ndarray, own: np.ndarray, currents: list[np.ndarray]) -> np.ndarray:
    """Return the log likelihoods of a track whose velocity is `own` under constant currents."""
    fresh = np.diff(time, prepend=-np.inf) > 6 * HOUR
    begin = np.maximum.accumulate(np.where(fresh, time, 0))
    excess = np.stack([np.outer(time - begin, own - current) for current in currents])
    fixes = Fixes(time, fresh, excess, ERROR, 0.0)
    one = np.ones((1, 1))
    return conditioned(LAW, (one, one), np.zeros(1), np.array([ERROR]), [fixes], time)[2]


def shares(begin: Any, column: np.ndarray) -> np.ndarray:
    """Return the probability of each number of a column."""
    weight = np.exp(begin.ensemble.log_weight.to_numpy().astype(float))
    total = np.bincount(column, weight)
    return total / total.sum()


def test_members_are_weighted_by_the_track(tmp_path: Path) -> None:
    """In two stretches."""
    currents = [velocity(0.4, 61), velocity(0.7, 40), velocity(0.3, 200)]
    time, own = np.append(np.arange(2, 5.01, 0.5), [12.0, 12.5, 14]) * HOUR, np.array([0.24, 0.2])
    write_track(tmp_path, "buoy", time, *(AWAY + np.outer(time, own)).T)
    more = BUOY.format("buoy")
    text = CASE.replace(
        'constant = {{ speed = "0.4 kn", toward = 61 }}',
        THREE.replace("{", "{{").replace("}", "}}"),
    )
    begin, _ = moved(tmp_path, more, text=text, particles=3000)
    found = shares(begin, begin.ensemble.own["member"].to_numpy())
    log = likelihoods(time, own, currents)
    expected_shares = np.exp(log - log.max()) / np.exp(log - log.max()).sum()
    assert expected_shares[1] < 0.9
    np.testing.assert_allclose(found, expected_shares, atol=2e-4)  # of places in 1e-8 degrees


def test_scenarios_with_currents_of_their_own_are_weighted_by_the_track(tmp_path: Path) -> None:
    """Their prior weights are 0.8 and 0.2."""
    time, own = np.arange(0, 5.01, 1.0) * HOUR, np.array([0.05, 0.1])
    write_track(tmp_path, "buoy", time, *(AWAY + np.outer(time, own)).T)
    text = CASE.replace(
        "[uncertainty]",
        '[[current]]\nname = "other"\nconstant = {{ speed = "0.5 kn", toward = 350 }}\n[uncertainty]',
    )
    text = text.replace('name = "raft"', 'name = "raft"\ncurrents = ["current 1"]\nweight = 0.8')
    more = (
        BUOY.format("buoy")
        + """
[[scenario]]
name = "elsewhere"
object = "water"
weight = 0.2
currents = ["other"]
position = { at = [179.95, 0.02], std = "1.5 km" }
"""
    )
    begin, _ = moved(tmp_path, more, text=text, particles=3000)
    log = likelihoods(time, own, [velocity(0.4, 61), velocity(0.5, 350)])
    weight = np.array([0.8, 0.2]) * np.exp(log - log.max())
    found = shares(begin, begin.ensemble.scenario.to_numpy())
    np.testing.assert_allclose(found, weight / weight.sum(), atol=2e-4)


def test_a_buoy_where_the_domain_cuts_the_forcing_off_is_rejected(tmp_path: Path) -> None:
    """The message's remedy, a wider domain, works."""
    time = np.arange(0, 5.01, 1.0) * HOUR
    write_track(tmp_path, "buoy", time, 0 * time, 150_000 + 0.1 * time)
    lon, lat = np.arange(178.0, 182.01, 0.1), np.arange(-1.5, 1.51, 0.1)
    hours = np.datetime64("2026-03-05T00:00:00", "ns") + np.arange(0, 25, 3) * np.timedelta64(
        1, "h"
    )
    field = np.full((hours.size, lat.size, lon.size), 0.1, np.float32)
    names = {"uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity"}
    xr.Dataset(
        {
            key: (("time", "lat", "lon"), field, {"standard_name": name, "units": "m s-1"})
            for key, name in names.items()
        },
        {
            "time": hours,
            "lat": ("lat", lat, {"units": "degrees_north", "standard_name": "latitude"}),
            "lon": ("lon", lon, {"units": "degrees_east", "standard_name": "longitude"}),
        },
    ).to_netcdf(tmp_path / "current.nc")
    narrow = "domain = {{ west = 179.2, south = -0.3, east = -179.2, north = 0.3 }}\n"
    text = narrow + CASE.replace(
        'constant = {{ speed = "0.4 kn", toward = 61 }}', 'files = ["current.nc"]'
    )
    with pytest.raises(UserError, match=r'drifter "buoy": no two of its fixes .* widen \[domain\]'):
        moved(tmp_path, BUOY.format("buoy"), text=text, particles=500)
    wide = text.replace("south = -0.3", "south = -1").replace("north = 0.3", "north = 1.45")
    moved(tmp_path, BUOY.format("buoy"), text=wide, particles=500)


@pytest.mark.thorough
def test_the_summary_and_the_report_say_what_each_buoy_showed(tmp_path: Path) -> None:
    """Two buoys with the same error; the mean of the errors given their tracks is next to it."""
    pull = np.array([0.21, -0.13])
    time = np.arange(0, 5.01, 0.5) * HOUR
    for name, away in (("near", 1.0), ("far", 3.0)):
        write_track(tmp_path, name, time, *(away * AWAY + np.outer(time, CURRENT + pull)).T)
    path = tmp_path / "case.toml"
    words = {"hours": 6, "particles": 2000, "step": "15 min", "seed": 1}
    path.write_text(CASE.format(more=BUOY.format("near") + BUOY.format("far"), **words))
    result = drift.run(drift.load(path))
    found = result.summary["drifters"]
    assert [own["name"] for own in found["buoys"]] == ["near", "far"]
    for own in found["buoys"]:
        assert own["displacements"] == 10
        assert own["last_fix"] == "2026-03-05T05:00:00"
        assert own["excess_m_s"] == pytest.approx(np.hypot(*pull), rel=0.03)
        assert own["excess_toward_deg"] == pytest.approx(np.degrees(np.arctan2(*pull)), abs=1)
    near, far = (own["area_nmi2_without_it"]["95%"] for own in found["buoys"])
    areas = found["area_nmi2"]
    # without the buoy far off the near one remains; areas of 2,000 particles err by some percent
    assert max(areas["with"]["95%"], far) < 0.9 * min(near, areas["without"]["95%"])
    layer, table = buoy_effect.buoys_bundle(found, result.case.drifters).leaves[0]()
    assert [f["properties"]["name"] for f in layer["features"]] == ["near", "far", "", ""]
    assert [row[0] for row in table["rows"]] == ["near", "far"]
    assert "0.48 kn toward 122" in str(table["rows"][0])
