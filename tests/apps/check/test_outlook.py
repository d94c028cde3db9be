"""What is told of a run before it is made: where its start lies, holes in its forcing, what leaves
it, its work.
"""

import re
from pathlib import Path

import numpy as np
import pyproj
import pytest
import xarray as xr

from drift.apps.cli.commands import main
from drift.case import file as case_file
from drift.pipeline import run_setup
from geo.forcing import sources
from geo.forcing.reading import stream

CASE = """
title = "trial"
start = "210000ZNOV26"
duration = "24 h"
particles = 400
coast.source = "none"
[[current]]
name = "sea"
files = "sea.nc"
[[scenario]]
name = "boat"
object = "water"
position = { at = "26 20N 088 40W", std = "2 nmi" }
"""


SURE = ("--set", "uncertainty=none")


def write(
    path: Path, hours: np.ndarray, west: float = -90.0, east: float = 0.4, north: float = 0.1
) -> None:
    """A steady current [m/s] over 4 x 3 degrees from (west, 25), at hours after 20 November, 18 h."""
    lon, lat = west + np.arange(17) * 0.25, 25 + np.arange(13) * 0.25
    uv = [np.full((hours.size, lat.size, lon.size), speed, np.float32) for speed in (east, north)]
    names = ("eastward_sea_water_velocity", "northward_sea_water_velocity")
    xr.Dataset(
        {
            key: (("time", "lat", "lon"), values, {"standard_name": name, "units": "m s-1"})
            for key, values, name in zip(("uo", "vo"), uv, names, strict=True)
        },
        {
            "time": np.datetime64("2026-11-20T18:00", "ns") + hours * np.timedelta64(1, "h"),
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    ).to_netcdf(path)


def told(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    *arguments: str,
    command: str = "check",
) -> str:
    (tmp_path / "trial.toml").write_text(text)
    status = main([command, str(tmp_path / "trial.toml"), *arguments])
    streams = capsys.readouterr()
    assert (status, bool(streams.out)) in ((0, True), (2, False))
    return streams.out + streams.err


WITH_HOLE = np.concatenate([np.arange(12), np.arange(20, 40)])  # none from 05 h to 14 h on the 21st


def test_holes_and_spans_of_times() -> None:
    run_setup = np.datetime64("2026-11-20T18:00", "s")
    times = run_setup + np.array([0, 10, 20, 50, 60, 91, 101]) * np.timedelta64(
        60, "s"
    )  # 30 min is three times the usual
    assert [(a - run_setup, b - run_setup) for a, b in stream.long_gaps(times)] == [
        (np.timedelta64(3600, "s"), np.timedelta64(5460, "s"))
    ]
    assert [
        (a - run_setup, b - run_setup)
        for a, b in stream.data_spans(
            sources.uniform_field("current", times, 0 * np.arange(7), np.ones(7))
        )
    ] == [
        (np.timedelta64(0, "s"), np.timedelta64(3600, "s")),
        (np.timedelta64(5460, "s"), np.timedelta64(6060, "s")),
    ]
    assert stream.long_gaps(times[:1]) == stream.long_gaps(times[:0]) == []


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_hole_in_time_is_refused_with_its_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    """9 of 24 hours: once all were lost there in the middle of the run."""
    write(tmp_path / "sea.nc", WITH_HOLE)
    line = told(tmp_path, capsys, CASE, command=command)
    assert "no data from 210500ZNOV26 to 211400ZNOV26 (62% of the run is covered)" in line
    assert "another [[current]]" in line


@pytest.mark.thorough
def test_a_hole_that_another_source_covers_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "sea.nc", WITH_HOLE)
    text = CASE.replace(
        "[[scenario]]", '[[current]]\nname = "report"\nfiles = "whole.nc"\n[[scenario]]'
    )
    write(tmp_path / "whole.nc", np.arange(40))
    out = told(tmp_path, capsys, text)
    assert (
        "no data from 210500ZNOV26 to 211400ZNOV26, 9 h, while its other times are 1 h apart" in out
    )
    assert "99 % adrift" in out or "100 % adrift" in out
    write(tmp_path / "whole.nc", np.arange(18))  # until 11 h: three of 24 hours are left
    assert "no data from 211100ZNOV26 to 211400ZNOV26 (87% of the run is covered)" in told(
        tmp_path, capsys, text
    )


def geodesic(lon1: float, lat1: float, lon2: float, lat2: float) -> float:
    """Distance [nmi] on a sphere of the mean radius, by pyproj."""
    return float(pyproj.Geod(a=6_371_008.8, b=6_371_008.8).inv(lon1, lat1, lon2, lat2)[2]) / 1852


@pytest.mark.thorough
def test_a_start_outside_a_source_is_told_with_distance_and_direction(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Far away, over the antimeridian; and a little outside, one scenario of two, inside the box
    that is read.
    """
    write(tmp_path / "sea.nc", np.arange(40), west=-179.0)
    line = told(tmp_path, capsys, CASE.replace("26 20N 088 40W", "26 20N 170 00E"))
    miles, side = re.search(r"([\d,]+) nmi to the ([a-z-]+)", line).groups()  # type: ignore[union-attr]
    assert side == "east"
    assert float(miles) == pytest.approx(geodesic(170, 26 + 1 / 3, -179, 26.25), abs=1.0)
    # The source's nodes end at 86 W and 28 N; 20 nmi along the meridian is a third of a degree.
    write(tmp_path / "sea.nc", np.arange(40))
    boat = (
        CASE[CASE.index("[[scenario]]") :].replace('"boat"', '"raft"').replace("26 20N", "28 20N")
    )
    line = told(tmp_path, capsys, CASE + boat)
    assert '50.0 % of the prior lies where there is no current (100 % of scenario "raft"' in line
    assert 'scenario "boat"' not in line
    assert (
        pytest.approx(float(re.search(r'"sea" begins ([\d.]+) nmi to the south', line)[1]), abs=1)
        == 20
    )  # type: ignore[index]


def test_an_area_partly_outside_tells_its_share(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "sea.nc", np.arange(40))
    area = 'area = { polygon = ["26N 087W", "27N 087W", "27N 085W", "26N 085W"] }'
    line = told(tmp_path, capsys, CASE[: CASE.index("position")] + area, "--set", "particles=5000")
    share = int(re.search(r"(\d+)\.\d % of the prior lies where there is no current", line)[1])  # type: ignore[index]
    # four standard errors of a share of 5,000
    assert share == pytest.approx(50, abs=4 * 100 * 0.5 / 5000**0.5)


def test_a_start_outside_the_domain_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "sea.nc", np.arange(40))
    text = CASE + "[domain]\nwest = -90\neast = -89\nsouth = 25\nnorth = 28\n"
    line = told(tmp_path, capsys, text)
    assert "[domain]: 100 % of the prior lies outside it, about 26-20" in line
    # A third of a degree of longitude at 26 1/3 N.
    assert float(re.search(r"([\d.]+) nmi to the west", line)[1]) == pytest.approx(
        60 / 3 * 0.896, abs=1
    )  # type: ignore[index]


def test_what_leaves_is_told_with_its_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """At 3 m/s north-east from 26 1/3 N to the last node, 28 N: 185 km less 9 km of the prior's
    spread in some 16 h.
    """
    write(tmp_path / "sea.nc", np.arange(40), east=0.5, north=3.0)
    fast = CASE.replace('files = "sea.nc"', 'files = "sea.nc"\nplausible = true')
    out = told(
        tmp_path, capsys, fast + "[domain]\nwest = -91\neast = -86\nsouth = 25\nnorth = 30\n", *SURE
    )
    assert re.search(r"by the end +(99|100) % run out of forcing", out)
    assert "a run would be rejected at its end" in out
    assert "not ready" in out
    assert "ready to run" not in out
    hour = int(re.search(r"first is lost about 21(\d\d)\d\dZNOV26", out)[1])  # type: ignore[index]
    assert 14 <= hour <= 17


def test_the_work_of_a_step_of_a_second_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """86,400 steps of 10^6 particles at 8 million a second are 3 hours; the field is uniform, so an
    hour would do.
    """
    write(tmp_path / "sea.nc", np.arange(40))
    out = told(tmp_path, capsys, CASE, "--set", "clock.step=1", "--set", "particles=1_000_000")
    assert "86,400 steps x 1,000,000 particles, moved in about 3 h on two cores" in out
    assert 'step = "auto" would take 3600 s: 24 steps, about 3 s' in out


def test_a_box_that_nothing_leaves_bounds_a_vast_domain(tmp_path: Path) -> None:
    """7.8 m/s of current, as typed, for a day are 6.1 degrees; the case's own domain is the globe."""
    write(tmp_path / "sea.nc", np.arange(40))
    text = CASE.replace('files = "sea.nc"', "constant = { east = 6, north = 5 }")
    (tmp_path / "trial.toml").write_text(
        text + "[domain]\nwest = -180\neast = 180\nsouth = -90\nnorth = 90\n"
    )
    box = run_setup.open_for(case_file.load(tmp_path / "trial.toml")).box
    least = np.degrees(np.hypot(6, 5) * 86_400 / 6_371_008.8)
    assert box.north - (26 + 1 / 3) > least
    assert (26 + 1 / 3) - box.south > least
    assert box.east - box.west < 30
