"""Bad input, through the command line: one clear line, exit status 2, nothing written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from drift.__main__ import main

CASE = """
title = "trial"
start = "2026-11-21T00:00Z"
duration = "6 h"
particles = 500
coast.source = "none"
[[current]]
name = "sea"
files = "current.nc"
[[wind]]
name = "air"
constant = { speed = "10 kn", from = 270 }
[[scenario]]
name = "boat"
object = "PIW-1"
position = { at = "27 30N 088 00W", std = "1 nmi" }
"""


def field(
    names: tuple[str, str] = ("uo", "vo"),
    standard: tuple[str, str] = ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
    hours: np.ndarray | None = None,
    west: float = -90.0,
) -> xr.Dataset:
    """A current 5 x 4 degrees wide, hourly for nine hours from three before the start."""
    times = np.datetime64("2026-11-20T21:00", "ns") + (np.arange(13) if hours is None else hours) * np.timedelta64(
        1, "h"
    )
    lon, lat = west + np.arange(21) * 0.25, 25.5 + np.arange(17) * 0.25
    values = np.full((times.size, lat.size, lon.size), 0.3, np.float32)
    attributes = [{"standard_name": name, "units": "m s-1"} for name in standard]
    return xr.Dataset(
        {name: (("time", "lat", "lon"), values, a) for name, a in zip(names, attributes, strict=True)},
        {
            "time": times,
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    )


def truncated(path: Path) -> None:
    field().to_netcdf(path)
    path.write_bytes(path.read_bytes()[:3000])


def backwards(path: Path) -> None:
    field(hours=np.array([0, 1, 2, 5, 4, 3, 6, 7, 8, 9, 10, 11, 12])).to_netcdf(path)


def nothing_but_nan(path: Path) -> None:
    data = field()
    (data * np.nan).assign_attrs(data.attrs).map(lambda v: v.assign_attrs(data[v.name].attrs)).to_netcdf(path)


def without_units(path: Path) -> None:
    data = field()
    for name in ("uo", "vo"):
        del data[name].attrs["units"]
    data.to_netcdf(path)


def winds(path: Path) -> None:
    field(("u10", "v10"), ("eastward_wind", "northward_wind")).to_netcdf(path)


FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "not a netCDF file": (lambda path: path.write_text("hello"), "current.nc"),
    "truncated": (truncated, "current.nc"),
    "current file that holds a wind": (winds, "wind"),
    "NaN everywhere": (nothing_but_nan, "missing"),
    "time axis not increasing": (backwards, "increas"),
    "absent units": (without_units, "units"),
    "too early": (lambda path: field(hours=np.arange(-50, -30)).to_netcdf(path), ": 0% of it is covered"),
    "ends halfway": (lambda path: field(hours=np.arange(7)).to_netcdf(path), ": 50% of it is covered"),
    "elsewhere": (lambda path: field(west=120.0).to_netcdf(path), "no overlap"),
    "half of the prior outside": (lambda path: field(west=-88.0).to_netcdf(path), "54% of the prior"),
}


def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, *arguments: str) -> str:
    """Return the one line with which a run is refused; nothing may have been written."""
    (tmp_path / "trial.toml").write_text(text)
    before = sorted(tmp_path.iterdir())
    status = main(["run", str(tmp_path / "trial.toml"), "--out", str(tmp_path / "out"), *arguments])
    captured = capsys.readouterr()
    assert status == 2
    assert sorted(tmp_path.iterdir()) == before
    assert captured.out == ""
    (line,) = captured.err.strip().splitlines()
    assert line.startswith("drift: ")
    assert "Traceback" not in line
    return line


@pytest.mark.parametrize("kind", FILES)
def test_forcing(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write, word = FILES[kind]
    write(tmp_path / "current.nc")
    line = refused(tmp_path, capsys, CASE)
    print(line)
    assert word.lower() in line.lower()


def test_no_wind_in_the_wind_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    text = CASE.replace('constant = { speed = "10 kn", from = 270 }', 'files = "current.nc"')
    line = refused(tmp_path, capsys, text)
    assert "wind" in line
    assert "current" in line


def test_missing_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "current.nc" in refused(tmp_path, capsys, CASE)


def test_position_on_land_says_where_the_nearest_water_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    square = '{"type": "Polygon", "coordinates": [[[-88.2, 27], [-87.9, 27], [-87.9, 28], [-88.2, 28], [-88.2, 27]]]}'
    (tmp_path / "shore.geojson").write_text(square)
    line = refused(tmp_path, capsys, CASE.replace('"none"', '"shore.geojson"'))
    # 0.1 degrees of longitude east of it, at 27.5 N: 5.3 nmi.
    assert "27-30.0N 088-00.0W" in line
    assert "5.3 nmi" in line
    assert "087-5" in line


def test_output_folder_not_empty(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("keep")
    assert "--overwrite" in refused(tmp_path, capsys, CASE)
    assert (tmp_path / "out" / "mine.txt").read_text() == "keep"


def test_backend_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    field().to_netcdf(tmp_path / "current.nc")
    line = refused(tmp_path, capsys, CASE, "--backend", "metal")
    assert "metal" in line
    assert "cpu" in line


def test_a_run_that_loses_too_much_fails_and_one_that_may_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """3 h at 0.3 m/s is 3.2 km; a prior 3 km from the rim of the forcing loses about half of what is there."""
    field(west=-93.02 + 0.05).to_netcdf(tmp_path / "current.nc")
    text = CASE.replace('"1 nmi"', '"500 m"')
    line = refused(tmp_path, capsys, text)
    assert "max_lost" in line
    assert main(["run", str(tmp_path / "trial.toml"), "--out", str(tmp_path / "out"), "--set", "max_lost=1.0"]) == 0
    assert (tmp_path / "out" / "forecast.nc").is_file()
