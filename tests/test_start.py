"""The start of a case's run: its step, its domain, how far its sources are filled; and refusals of
steps that the result would depend on.
"""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import drift
from drift.pipeline import run_setup

TEXT = """
title = "start"
start = "2026-11-21T00:00Z"
duration = "{duration}"
particles = 2000
max_lost = 1.0
coast.source = "{coast}"
{more}
[[current]]
{current}
[[scenario]]
name = "s"
{object}
{prior}
"""


def case_of(folder: Path, **changes: str) -> drift.Case:
    usual = {
        "duration": "24 h",
        "coast": "none",
        "more": "",
        "current": "constant = { speed = '0.5 m/s', toward = 90 }",
        "object": 'object = "water"',
        "prior": 'position = { at = [-20.0, 10.0], std = "500 m" }',
    }
    (folder / "case.toml").write_text(TEXT.format(**{**usual, **changes}))
    return drift.load(folder / "case.toml")


def test_an_onshore_drift_strands_whatever_the_step(tmp_path: Path) -> None:
    """0.6 m/s straight onto a wall 7 km away: all are ashore after 12 h; nothing is ever outside of
    the forcing.
    """
    lon, lat = np.arange(-1, 0.5001, 0.005), np.arange(49.3, 50.7, 0.005)
    east = np.full((2, lat.size, lon.size), 0.3, np.float32)
    east[:, :, lon > 1e-4] = np.nan
    name = {"uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity"}
    data = {
        k: (("time", "lat", "lon"), v, {"standard_name": name[k], "units": "m s-1"})
        for k, v in (("uo", east), ("vo", 0 * east))
    }
    hours = (
        "time",
        np.array([0, 48]),
        {"units": "hours since 2026-11-21", "standard_name": "time"},
    )
    axes = {
        "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
    }
    xr.Dataset(data, {"time": hours, **axes}).to_netcdf(tmp_path / "current.nc")
    corners = [[0, 48], [2, 48], [2, 52], [0, 52], [0, 48]]
    (tmp_path / "land.geojson").write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, '
        f'"geometry": {{"type": "Polygon", "coordinates": [{corners}]}}}}]}}'
    )
    case = case_of(
        tmp_path,
        duration="12 h",
        coast="land.geojson",
        more='domain = { west = -0.9, east = 0.4, south = 49.4, north = 50.6 }\nuncertainty = "none"',
        current='files = "current.nc"\n[[wind]]\nconstant = { speed = "10 m/s", from = 270 }',
        object='object = { windage = "3 %" }',
        prior='position = { at = [-0.1, 50.0], std = "500 m" }',
    )
    account = drift.run(case).summary["account"]
    assert account["outside"] == 0
    assert account["ashore"] == pytest.approx(1.0)


def test_a_wind_of_the_same_name_leaves_the_fill_of_a_current_alone(tmp_path: Path) -> None:
    same = 'name = "model"\nconstant = { speed = "0.5 m/s", toward = 90 }\n'
    case = case_of(tmp_path, current=f"fill = 5\n{same}[[wind]]\nfill = 0\n{same}")
    assert run_setup.open_for(case).scenarios[0].cells["current", "model"] == 5


def test_the_reach_holds_the_great_circle_between_waypoints(tmp_path: Path) -> None:
    prior = """[scenario.trackline]
    waypoints = [[140.0, 35.0], [-125.0, 48.0]]
    departure = "2026-11-17T00:00Z"
    speed = "20 kn"
    cross_track = "1 nmi"
    distress = { between = ["2026-11-21T01:00Z", "2026-11-21T06:00Z"] }"""
    assert drift.run(case_of(tmp_path, prior=prior)).summary["account"]["adrift"] == pytest.approx(
        1.0
    )


def test_a_step_too_long_for_the_correlation_of_errors_is_refused(tmp_path: Path) -> None:
    """At a step of three decorrelation times the spread would come out 1.6 times too large."""
    more = "clock = { step = 3600 }\nuncertainty = { current = { std = 0.3, time = 1200 } }"
    with pytest.raises(
        drift.UserError, match=r"clock\.step: 3600 s is longer than a sixth of .*, 200 s"
    ):
        drift.run(case_of(tmp_path, more=more))


def test_a_step_longer_than_the_forcing_interval_is_refused(tmp_path: Path) -> None:
    """A current of 0, 4, 0 kn within 12 h: a step of 12 h would see both zeros and nothing of what
    lies between.
    """
    rows = ", ".join(
        f'{{ time = "+{h} h", speed = "{s} kn", toward = 90 }}'
        for h, s in ((0, 0), (6, 4), (12, 0))
    )
    case = case_of(
        tmp_path, duration="12 h", current=f"table = [{rows}]", more='clock = { step = "12 h" }'
    )
    with pytest.raises(drift.UserError, match="longer than the interval of the forcing, 21600 s"):
        drift.run(case)


def test_the_lattice_holds_the_times_of_all_sources(tmp_path: Path) -> None:
    """A current on full hours and a wind at half past: steps of 30 minutes, so that neither bends
    inside one.
    """
    rows = {
        run_setup: ", ".join(
            f'{{ time = "{np.datetime64("2026-11-20T23:00") + np.timedelta64(run_setup + 60 * h, "m")}Z", speed = "{3 + h % 2} {unit}", {word} = 70 }}'
            for h in range(9)
        )
        for run_setup, unit, word in ((0, "kn", "toward"), (30, "m/s", "from"))
    }
    case = case_of(
        tmp_path,
        duration="6 h",
        current=f"table = [{rows[0]}]\n[[wind]]\ntable = [{rows[30]}]",
        more='clock = { tolerance = "2000 m" }',
        object='object = "LIFE-RAFT-DB-10"',
    )
    assert drift.run(case).summary["run"]["step_s"] == 1800
