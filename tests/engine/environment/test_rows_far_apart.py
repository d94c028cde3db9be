"""Rows of a table are on straight lines however far apart they are; files with such gaps have
holes.
"""

import math

import numpy as np
import pytest
import trial_case
import xarray as xr

import drift
from geo import sphere
from geo.errors import UserError
from geo.notation import KNOT

HOURS, KNOTS = (0, 1, 2, 3, 15, 24), (10, 12, 14, 8, 20, 5)


def case(tmp_path, source: str):
    return trial_case.load(
        tmp_path,
        f"[[wind]]\n{source}",
        start="2026-11-21T18:00Z",
        duration="24 h",
        particles=10,
        output={"trajectories": 0},
        uncertainty="none",
        current={"constant": {"east": 0, "north": 0}},
        scenario={
            "name": "box",
            "object": {"windage": "3 %"},
            "position": {"at": [0.5, 0.0], "error": "1 m"},
        },
    )


def rows(hours, knots) -> str:
    each = (
        f'{{ time = "+{hour} h", speed = "{speed} kn", from = 270 }}'
        for hour, speed in zip(hours, knots, strict=True)
    )
    return f"table = [{', '.join(each)}]"


def test_rows_far_apart_are_on_straight_lines(tmp_path):
    """On the equator, so that the way east is 3 % of the integral of trapezia."""
    end = drift.run(case(tmp_path, rows(HOURS, KNOTS))).forecast.data.isel(time=-1)
    way = 0.03 * np.trapezoid(np.array(KNOTS) * KNOT, 3600 * np.array(HOURS))
    off = float(end["mean_lon"]) - 0.5 - math.degrees(way / sphere.RADIUS)
    assert abs(math.radians(off)) * sphere.RADIUS < 5  # [m] of 15.6 km; the prior is 1 m wide


def test_check_notes_rows_far_apart(tmp_path):
    assert "rows up to 12 h apart" in drift.check(case(tmp_path, rows(HOURS, KNOTS)))["wind wind 1"]
    assert (
        "apart"
        not in drift.check(case(tmp_path, rows((0, 6, 17.5, 24), (1, 2, 3, 4))))["wind wind 1"]
    )


def test_a_hole_in_a_file_is_refused_in_words_that_agree(tmp_path):
    times = np.datetime64("2026-11-21T18:00", "ns") + np.array(HOURS) * np.timedelta64(1, "h")
    axes = {"time": times, "latitude": [-1.0, 0.0, 1.0], "longitude": [0.0, 1.0, 2.0]}
    values = ("time", "latitude", "longitude"), np.ones((len(HOURS), 3, 3)), {"units": "m s-1"}
    names = {"u10": "eastward_wind", "v10": "northward_wind"}
    data = xr.Dataset(
        {name: (*values[:2], values[2] | {"standard_name": long}) for name, long in names.items()},
        axes,
    )
    data["latitude"].attrs["units"], data["longitude"].attrs["units"] = (
        "degrees_north",
        "degrees_east",
    )
    data.to_netcdf(tmp_path / "wind.nc")
    with pytest.raises(UserError) as refused:
        drift.check(case(tmp_path, 'files = "wind.nc"'))
    (line,) = refused.value.lines
    assert (
        "with gaps of more than 3 times its usual interval, which are not interpolated over" in line
    )
    assert "no data from 212100ZNOV26 to 220900ZNOV26" in line
    assert "(12% of the run is covered)" in line
    with_more = 'files = "wind.nc"\n[[wind]]\n' + rows((0, 24), (10, 10))  # the remedy
    assert "100 % adrift" in drift.check(case(tmp_path, with_more))["by the end"]


def test_what_is_wrong_with_several_sources_and_scenarios_comes_at_once(tmp_path):
    """Two files that cannot be read; then a table that ends early, of all scenarios in it."""
    for name in ("one.nc", "two.nc"):
        (tmp_path / name).write_bytes(b"no forcing at all")
    with pytest.raises(UserError) as refused:
        drift.check(case(tmp_path, 'files = "one.nc"\n[[wind]]\nfiles = "two.nc"'))
    assert [
        name for line in refused.value.lines for name in ("one.nc", "two.nc") if name in line
    ] == [
        "one.nc",
        "two.nc",
    ]
    other = '[[scenario]]\nname = "crate"\nobject = { windage = "2 %" }\nposition = { at = [0.5, 0.0], error = "1 m" }'
    with pytest.raises(UserError) as refused:
        drift.check(case(tmp_path, f"{rows((0, 6), (10, 10))}\n{other}"))
    (line,) = refused.value.lines  # the same of both
    assert line.startswith('scenario "box" and 1 more: wind "wind 1" lasts from')
