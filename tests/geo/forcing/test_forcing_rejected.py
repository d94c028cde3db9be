"""Forcing files that are rejected, in one line with the key."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from ramps import AXES, Z, ramp, refused, timed, written

from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources as forcing


def test_units_refused_or_stated(tmp_path: Path) -> None:
    u, v = ramp(*AXES)
    path = written(tmp_path / "a.nc", *AXES, u, v, attributes={"units": ""})
    with pytest.raises(UserError, match=r"no units.*\[\[current\]\] units"):
        forcing.open_source("current", path, steady=True)
    got = forcing.open_source("current", path, steady=True, units="kn").read(0)
    np.testing.assert_allclose(got[..., 0], u * 1852 / 3600, rtol=1e-5, atol=1e-7)
    path = written(tmp_path / "b.nc", *AXES, u, v, attributes={"units": "Pa"})
    with pytest.raises(UserError, match='"Pa" are not a speed'):
        forcing.open_source("current", path, steady=True)


def test_meaningless_times_are_refused_or_stated(tmp_path: Path) -> None:
    for name, values, units in (
        ("a", [1, 2, 3], "month"), ("b", [20240305.0, 20240306.0, 20240307.0], "day as %Y%m%d.%f"),
        ("c", [0.0, 31.0, 60.0], "days since 0001-01-01"),
    ):  # fmt: skip
        path = timed(tmp_path / f"{name}.nc", values, units)
        with pytest.raises(UserError, match=r"\[\[current\]\] times = .*steady = true"):
            forcing.open_source("current", path)
        told = {
            "start": np.datetime64("2024-03-05T06:00:00"),
            "interval": np.timedelta64(3600, "s"),
        }
        source = forcing.open_source("current", path, times=told)
        assert (
            source.times == np.array(["2024-03-05T06", "2024-03-05T07", "2024-03-05T08"], Z)
        ).all()
        np.testing.assert_allclose(source.read(2)[..., 0], ramp(*AXES)[0] + 0.2, atol=1e-6)
        assert len(forcing.open_source("current", path, steady=True).times) == 0
    with pytest.raises(UserError, match=r"states 2 times.*3 slices"):
        forcing.open_source("current", path, times=["2024-03-05", "2024-03-06"])


def test_joined_times_must_increase(tmp_path: Path) -> None:
    a, b = timed(tmp_path / "b1.nc", [0.0, 3.0]), timed(tmp_path / "a2.nc", [6.0, 9.0], plus=0.2)
    source = forcing.open_source("current", str(tmp_path / "*.nc"))  # a2 before b1 by name
    assert (np.diff(source.times) == np.timedelta64(3, "h")).all()
    np.testing.assert_allclose(source.read(3)[..., 0], ramp(*AXES)[0] + 0.3, atol=1e-6)
    source = forcing.open_source("current", [a, b, timed(tmp_path / "c3.nc", [9.0, 12.0])])
    assert (np.diff(source.times) == np.timedelta64(3, "h")).all()
    # c3 began later: it counts
    np.testing.assert_allclose(source.read(3)[..., 0], ramp(*AXES)[0], atol=1e-6)
    with pytest.raises(UserError, match="have the same time"):
        forcing.open_source("current", timed(tmp_path / "d.nc", [0.0, 3.0, 3.0]))
    with pytest.raises(UserError, match="named twice"):
        forcing.open_source("current", [a, a])


def test_files_of_one_source_share_a_grid(tmp_path: Path) -> None:
    a = timed(tmp_path / "a.nc", [0.0, 3.0])
    with xr.open_dataset(timed(tmp_path / "b.nc", [6.0, 9.0])) as data:
        data.assign_coords(lon=data.lon + 0.25).to_netcdf(tmp_path / "c.nc")
    with pytest.raises(UserError, match="another grid"):
        forcing.open_source("current", [a, tmp_path / "c.nc"])


def test_files_that_cannot_be_read(tmp_path: Path, data: Path) -> None:
    key = "[[current]] files"
    refused("current", tmp_path / "none.nc", "no such file", "none.nc", key)
    refused("current", str(tmp_path / "*.nc"), "no file matches", key)
    refused("current", [], "empty", key)
    refused("current", tmp_path, "is a folder", key)
    text = tmp_path / "text.nc"
    text.write_text("not a netCDF file")
    refused("current", text, "is not a netCDF file", "text.nc", key)
    (tmp_path / "nothing.nc").touch()
    refused("current", tmp_path / "nothing.nc", "it is empty", key)
    # HDF5 and classic
    for name in ("norkyst/norkyst800_subset_16Nov2015.nc", "washington/gridded_current.nc"):
        whole = (data / name).read_bytes()
        cut = tmp_path / "cut.nc"
        cut.write_bytes(whole[: int(0.7 * len(whole))])
        refused("current", cut, "cut.nc", "truncated", key)


def test_damage_inside_a_file_is_told_when_read(tmp_path: Path, data: Path) -> None:
    whole = bytearray((data / "norkyst/norkyst800_subset_16Nov2015.nc").read_bytes())
    for k in range(3_500_000, 6_500_000):
        whole[k] = 0x55
    (tmp_path / "holed.nc").write_bytes(whole)

    def read_all() -> None:
        source = forcing.open_source("current", tmp_path / "holed.nc")
        for k in range(len(source.times)):
            source.read(k)

    with pytest.raises(UserError, match=r"holed\.nc"):
        read_all()


def test_wrong_quantity(data: Path, tmp_path: Path) -> None:
    wash = data / "washington"
    refused(
        "wind",
        wash / "gridded_current.nc",
        "no wind in the wind file gridded_current.nc",
        "current (water_u, water_v)",
        "[[wind]] files",
    )
    refused(
        "current",
        wash / "gridded_wind.nc",
        "no current in the current file",
        "wind (air_u, air_v)",
        "[[current]] files",
    )
    refused(
        "current", data / "norkyst" / "arome_subset_16Nov2015.nc", "wind (x_wind_10m, y_wind_10m)"
    )
    refused(
        "wind", [data / "biscay" / f"hycom.gdp.{c}.nc" for c in "uv"], "no wind", "current (u, v)"
    )
    refused("current", data / "biscay" / "hycom.gdp.h.nc", "no current", "bathymetry")
    refused("current", data / "barents" / "barents.nc", "no current")
    refused("stokes", wash / "gridded_wind.nc", "no Stokes drift")
    u, v = ramp(*AXES)
    path = written(tmp_path / "a.nc", *AXES, u, v)
    with xr.open_dataset(path) as file:
        renamed = file.rename(uo="u10", vo="v10").load()
    renamed.to_netcdf(tmp_path / "b.nc")
    # what it says of itself beats its name
    refused("wind", tmp_path / "b.nc", "no wind", "current (u10, v10)")
    source = forcing.open_source(
        "wind", tmp_path / "b.nc", variables={"east": "u10", "north": "v10"}, steady=True
    )
    # and the case's word beats both
    np.testing.assert_allclose(source.read(0)[..., 0], u, atol=1e-6)
    refused(
        "current",
        path,
        'no variable "q"',
        "uo",
        variables={"east": "q", "north": "vo"},
        steady=True,
    )


def test_variables_keys(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", *AXES, *ramp(*AXES))
    refused(
        "current", path, 'no variable "q"', "variables.lon", variables={"lon": "q"}, steady=True
    )
    refused(
        "current",
        path,
        "variables.eastt",
        "allowed are east, north",
        variables={"eastt": "uo"},
        steady=True,
    )
    refused("current", path, "true", "grid", variables={"axes": "x"}, steady=True)
    assert (
        forcing.open_source(
            "current", path, variables={"lon": "lon", "lat": "lat"}, steady=True
        ).missing
        == 0
    )


def test_empty_and_apart(tmp_path: Path) -> None:
    u, v = ramp(*AXES)
    refused(
        "current",
        written(tmp_path / "a.nc", *AXES, u * np.nan, v),
        "every value is missing",
        "a.nc",
        steady=True,
    )
    refused(
        "current",
        written(tmp_path / "c.nc", *AXES, u + 500, v),
        "every value is missing",
        "units right?",
        steady=True,
    )
    u[2:5, 2:5] = np.nan
    path = written(tmp_path / "b.nc", *AXES, u, v)
    refused(
        "current",
        path,
        "no overlap",
        "0.00 to 2.00 E",
        steady=True,
        box=Box(20.0, 50.0, 21.0, 51.0),
    )
    refused("current", path, "no overlap", steady=True, box=Box(0.0, 55.0, 1.0, 56.0))


def test_unreachable_address() -> None:
    refused("current", "http://127.0.0.1:9/none.nc", "cannot open the address", "[[current]] files")
