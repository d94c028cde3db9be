"""Levels that are not the surface's are refused wherever they are written, and the surface is found
where it is there.
"""

from pathlib import Path
from typing import Any

import linear
import numpy as np
import pytest
import trial_case
import xarray as xr

from drift.apps.cli.commands import main
from geo.errors import UserError
from geo.forcing import sources

LON, LAT = np.arange(3.0, 5.01, 0.25), np.arange(57.0, 58.51, 0.25)
NAMES = {
    "wind": ("eastward_wind", "northward_wind"),
    "current": ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
    "stokes": (
        "sea_surface_wave_stokes_drift_eastward_velocity",
        "sea_surface_wave_stokes_drift_northward_velocity",
    ),
}


def saved(
    path: Path,
    quantity: str,
    name: str,
    values: Any,
    attributes: dict[str, Any],
    lone: str = "",
    long_name: str = "",
) -> Path:
    """A field whose value on level k is (k + 1) / 10 east and (k + 1) / 20 north.

    lone: "" for a dimension, "scalar" or "size 1" for a coordinate beside the variables, "listed"
    in their attributes.
    """
    levels = np.atleast_1d(np.asarray(values, float))
    block = (np.arange(len(levels)) + 1.0)[:, None, None] / 10 * np.ones((len(LAT), len(LON)))
    dims = ("lat", "lon") if lone else (name, "lat", "lon")
    block = block[0] if lone else block
    more = {"coordinates": f"lat lon {name}"} if lone == "listed" else {}
    about = [
        {"standard_name": n, "units": "m s-1", "long_name": long_name, **more}
        for n in NAMES[quantity]
    ]
    data = xr.Dataset(
        {"a": (dims, block, about[0]), "b": (dims, block / 2, about[1])}, {"lat": LAT, "lon": LON}
    )
    if name:
        level = (
            (name, levels, attributes) if lone in ("", "size 1") else ((), levels[0], attributes)
        )
        data = xr.Dataset({**data.variables, name: level})
    data.to_netcdf(path)
    return path


def east(path: Path, quantity: str, **options: Any) -> float:
    return float(sources.open_source(quantity, path, steady=True, **options).read(0)[2, 2, 0])


def refusal(path: Path, quantity: str, **options: Any) -> str:
    with pytest.raises(UserError) as caught:
        sources.open_source(quantity, path, steady=True, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


DOWN, UP = {"positive": "down"}, {"positive": "up"}
# quantity, coordinate, values, attributes, index that is the surface's, or None
CASES: dict[str, tuple[str, str, Any, dict[str, str], int | None]] = {
    "850 hPa": ("wind", "isobaricInhPa", [850.0], {"units": "hPa"}, None),
    "pressure levels": ("wind", "pressure_level", [1000, 925, 850], {"units": "hPa", **DOWN}, None),
    "pressure in Pa": ("wind", "plev", [100000.0, 85000.0], {"units": "Pa"}, None),
    "pressure without units": ("wind", "plev", [1000.0], {}, None),
    "10 m": ("wind", "height", [10.0], {"units": "m", **UP}, 0),
    "2 m": ("wind", "heightAboveGround", [2.0], {"units": "m"}, 0),
    "20 m": ("wind", "height", [20.0], {"units": "m"}, 0),
    "33 feet": ("wind", "height", [100.0, 33.0], {"units": "ft"}, 1),
    "80 m": ("wind", "heightAboveGround", [80.0], {"units": "m"}, None),
    "1 m": ("wind", "height", [1.0], {"units": "m"}, None),
    "heights": ("wind", "height", [100.0, 50.0, 12.0, 2.0], {"units": "m", **UP}, 2),
    "the highest and the lowest that pass": ("wind", "height", [19.0, 8.5, 12.5, 3.0, 140.0], {"units": "m", **UP}, 1),
    "heights upwards": ("wind", "height", [3.5, 14.0, 19.5], {"units": "m", **UP}, 1),
    "a height of 0 beside one of 17 m": ("wind", "height", [0.0, 17.0, 60.0], {"units": "m"}, 1),
    "a height of 0 beside one of 60 m": ("wind", "height", [60.0, 0.0], {"units": "m"}, 1),
    "heights above 20 m": ("wind", "height", [100.0, 50.0, 30.0], {"units": "m"}, None),
    "heights downwards": ("wind", "z", [-10.0, -80.0], {"units": "m", **DOWN}, 0),
    "km": ("wind", "height", [0.08, 0.01], {"units": "km"}, 1),
    "a wind at the surface": ("wind", "depth", [0.0], {"units": "m", **DOWN}, 0),
    "a wind under water": ("wind", "depth", [10.0], {"units": "m", **DOWN}, None),
    "sigma 0.995": ("wind", "sigma", [0.5, 0.995], {"standard_name": "atmosphere_sigma_coordinate", "units": "1"}, 1),
    "sigma 0.85": ("wind", "sigma", [0.1, 0.85], {"standard_name": "atmosphere_sigma_coordinate", "units": "1"}, None),
    "model levels": ("wind", "hybrid", [136.0, 137.0], {"units": "1", **DOWN}, None),
    "a model level": ("wind", "hybrid", [137.0], {"units": "1", **DOWN}, None),
    "0.5 m": ("current", "depth", [0.5], {"units": "m", **DOWN}, 0),
    "5 m": ("current", "depth", [5.0], {"units": "m"}, 0),
    "15 m": ("current", "depth", [15.0], {"units": "m"}, None),
    "15 m as -15": ("current", "depth", [-15.0], {"units": "m", **UP}, None),
    "1500 cm": ("current", "depth", [1500.0, 200.0], {"units": "cm"}, 1),
    "nothing above 8 m": ("current", "depth", [8.0, 20.0], {"units": "m"}, None),
    "negative numbers": ("current", "z", [-40.0, -12.0, -3.0], {"units": "m", **UP}, 2),
    "dbar": ("current", "pressure", [1.0, 10.0], {"units": "dbar"}, 0),
    "dbar below": ("current", "pressure", [20.0], {"units": "dbar"}, None),
    "the shallowest that pass": ("current", "depth", [4.5, 0.7, 2.2, 11.0], {"units": "m", **DOWN}, 1),
    "sigmas that pass": ("current", "siglay", [-0.09, -0.02, -0.05, -0.4], {}, 1),
    "fathoms": ("current", "depth", [1.0, 10.0], {"units": "fathoms"}, 0),
    "depths without units": ("current", "depth", [0.0, 10.0, 30.0, 120.0], {}, 0),
    "a depth without units": ("current", "depth", [120.0], {}, None),
    "metres without units": ("current", "lev", [2.5, 10.0, 30.0], {}, 0),
    "sigma -0.92": ("current", "s_rho", [-0.92], {"standard_name": "ocean_s_coordinate_g2"}, None),
    "sigma -0.05": ("current", "siglay", [-0.95, -0.05], {"standard_name": "ocean_sigma_coordinate"}, 1),
    "sigma by name": ("current", "siglay", [-0.05, -0.95], {}, 0),
    "sigma upwards": ("current", "sigma", [0.05, 0.97], {"standard_name": "ocean_sigma_coordinate", **UP}, 1),
    "sigma downwards": ("current", "sigma", [0.05, 0.97], {"standard_name": "ocean_sigma_coordinate", **DOWN}, 0),
    "sigma either way": ("current", "sigma", [0.05, 0.97], {"units": "sigma_level"}, None),
    "three thick layers": ("current", "siglay", [-1 / 6, -0.5, -5 / 6], {}, None),
    "layers downwards": ("current", "lev", [1, 2, 3], {"long_name": "level", **DOWN}, 0),
    "layers upwards": ("current", "lev", [1, 2, 3], UP, 2),
    "layers from the fourth": ("current", "lev", [4, 5, 6], DOWN, None),
    "the fourth layer": ("current", "lev", [4], DOWN, None),
    "the first layer": ("current", "lev", [1], DOWN, 0),
    "layers either way": ("current", "layer", [1, 2, 3], {}, None),
    "s_rho by number": ("current", "s_rho", [1, 2, 3], {}, 2),
    "above the sea floor": ("current", "height", [1.0, 30.0], {"units": "m", "long_name": "height above sea floor"}, None),
    "Stokes drift at 0": ("stokes", "depth", [0.0], {"units": "m"}, 0),
    "Stokes drift at 12 m": ("stokes", "depth", [12.0], {"units": "m"}, None),
}  # fmt: skip


@pytest.mark.parametrize("key", CASES)
def test_along_a_dimension(key: str, tmp_path: Path) -> None:
    quantity, name, values, attributes, surface = CASES[key]
    path = saved(tmp_path / "a.nc", quantity, name, values, attributes)
    if surface is not None:
        assert east(path, quantity) == pytest.approx((surface + 1) / 10)
        return
    told = refusal(path, quantity)
    assert "a.nc" in told
    assert f"variables.{name}" in told
    assert "= 0" not in told.replace(f'"{name}" = ', "")  # no recipe to copy
    for value in values:
        assert f"{value:.6g}" in told
    assert attributes.get("units", "").replace("sigma_level", "sigma") in told
    assert "2 to 20 m" in told if quantity == "wind" else "5 m deep" in told
    last = len(values) - 1  # and who knows better says so
    assert east(path, quantity, variables={name: str(last)}) == pytest.approx((last + 1) / 10)


@pytest.mark.parametrize("lone", ["scalar", "size 1", "listed"])
@pytest.mark.parametrize("key", [k for k, case in CASES.items() if len(case[2]) == 1])
def test_beside_the_variable(key: str, lone: str, tmp_path: Path) -> None:
    quantity, name, values, attributes, surface = CASES[key]
    path = saved(tmp_path / "a.nc", quantity, name, values, attributes, lone)
    if surface is not None:
        assert east(path, quantity) == pytest.approx(0.1)
        return
    told = refusal(path, quantity)
    assert f"{values[0]:.6g}" in told
    assert f"variables.{name}" in told
    assert east(path, quantity, variables={name: "0"}) == pytest.approx(0.1)
    assert "index is 0" in refusal(path, quantity, variables={name: "1"})


def test_a_lone_depth_is_accepted_by_the_depth_that_the_case_wants(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.nc", "current", "depth", [15.0], {"units": "m"}, "scalar")
    assert "[[current]] depth" in refusal(path, "current")
    assert east(path, "current", depth=15.0) == pytest.approx(0.1)
    assert "no level near" in refusal(path, "current", depth=100.0)
    several = saved(tmp_path / "b.nc", "current", "depth", [0.0, 10.0, 100.0], {"units": "m"})
    assert east(several, "current", depth=60.0) == pytest.approx(0.3)
    assert "no level near" in refusal(several, "current", depth=200.0)
    uneven = saved(tmp_path / "d.nc", "current", "depth", [3.0, 7.5, 16.0, 31.0], {"units": "m"})
    # the nearest, above or below
    wanted = {1.0: 1, 5.0: 1, 5.5: 2, 11.0: 2, 12.3: 3, 23.0: 3, 24.0: 4, 33.0: 4}
    assert {depth: round(10 * east(uneven, "current", depth=depth)) for depth in wanted} == wanted
    assert east(uneven, "current", depth=-12.3) == pytest.approx(0.3)  # whichever way it counts
    sigma = saved(tmp_path / "c.nc", "current", "s_rho", [-0.9, -0.05], {})
    assert "not in metres" in refusal(sigma, "current", depth=10.0)


@pytest.mark.parametrize(
    ("quantity", "attributes", "word"),
    [("wind", {"long_name": "eastward wind at 850 hPa"}, "850"), ("wind", {"long_name": "100 metre U wind component"}, "100"),
     ("wind", {"long_name": "10 metre U wind component"}, ""), ("wind", {"long_name": "Eastward wind at 10 m"}, ""),
     ("wind", {"GRIB_typeOfLevel": "isobaricInhPa", "GRIB_level": 925}, "925"), ("wind", {"GRIB_typeOfLevel": "surface"}, ""),
     ("wind", {"GRIB_typeOfLevel": "maxWind"}, "maxWind"), ("wind", {"level": "80 m above ground"}, "80"),
     ("wind", {"long_name": "wind, mean over 10 min, error 5 m/s"}, ""), ("wind", {"level": "10 m above ground"}, ""),
     ("current", {"long_name": "eastward current at 15 m depth"}, "15"), ("current", {"long_name": "current at 1 m"}, "")],
)  # fmt: skip
def test_in_attributes_alone(
    quantity: str, attributes: dict[str, Any], word: str, tmp_path: Path
) -> None:
    path = saved(tmp_path / "a.nc", quantity, "", [0.0], {}, "scalar")
    with xr.open_dataset(path) as data:
        data.load()
    for name in ("a", "b"):
        data[name].attrs |= attributes
    data.to_netcdf(tmp_path / "b.nc")
    if not word:
        assert east(tmp_path / "b.nc", quantity) == pytest.approx(0.1)
        return
    assert word in refusal(tmp_path / "b.nc", quantity)
    assert east(tmp_path / "b.nc", quantity, variables={"level": "0"}) == pytest.approx(0.1)


def test_a_case_names_a_level_by_a_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved(tmp_path / "aloft.nc", "wind", "isobaricInhPa", [1000.0, 850.0], {"units": "hPa"})
    wind = {"files": "aloft.nc", "steady": True}
    here = {
        "start": "050000ZMAR24",
        "duration": "2 h",
        "scenario": {"object": "PIW-1", "position": {"at": [4.0, 57.75], "error": "1 nmi"}},
    }
    path = trial_case.write(tmp_path, wind=wind, **here)
    assert main(["check", str(path)]) != 0
    told = capsys.readouterr().err
    assert "1000, 850 hPa" in told
    assert "variables.isobaricInhPa" in told
    wind["variables"] = {"isobaricInhPa": 1}
    trial_case.write(tmp_path, wind=wind, **here)
    assert main(["check", str(path)]) == 0
    assert "index 1 of 2 along isobaricInhPa, as the case says" in " ".join(
        capsys.readouterr().out.split()
    )


def test_a_coordinate_of_another_variable_is_not_ours(tmp_path: Path) -> None:
    """cfgrib and others keep the height of the air temperature beside the wind's variables."""
    path = saved(tmp_path / "a.nc", "wind", "heightAboveGround", [80.0], {"units": "m"}, "listed")
    with xr.open_dataset(path, decode_coords=False) as data:
        data.load()
    data["gust"] = data["a"].assign_attrs(standard_name="wind_speed_of_gust")
    for name in ("a", "b"):
        data[name].attrs["coordinates"] = "lat lon"
    data.to_netcdf(tmp_path / "b.nc")
    assert east(tmp_path / "b.nc", "wind") == pytest.approx(0.1)


def test_files_that_hold_other_levels_are_not_joined(tmp_path: Path) -> None:
    paths = []
    for k, levels in enumerate(([10.0, 100.0], [100.0, 10.0])):
        path = saved(tmp_path / f"{k}.nc", "wind", "height", levels, {"units": "m"})
        with xr.open_dataset(path) as data:
            timed = data[["a", "b"]].expand_dims(
                time=np.array(["2024-03-05", "2024-03-06"], "M8[ns]") + np.timedelta64(2 * k, "D")
            )
            timed.to_netcdf(tmp_path / f"t{k}.nc")
        paths.append(tmp_path / f"t{k}.nc")
    with pytest.raises(UserError, match="has other levels"):
        sources.open_source("wind", paths)


def test_an_auxiliary_coordinate_gives_a_dimension_its_depths(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.nc", "current", "layer", [1, 2, 3], {})
    with xr.open_dataset(path) as data:
        data.drop_vars("layer").assign(z_t=("layer", [40.0, 20.0, 2.0], {"units": "m"})).to_netcdf(
            tmp_path / "b.nc"
        )
    assert east(tmp_path / "b.nc", "current") == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("folder", "pattern", "level"),
    [("norkyst", "norkyst800*.nc", ""), ("biscay", "hycom.gdp.[uv].nc", "level 1 of 6"),
     ("paria", "Sea_Med*.nc", "level 0 of 4"), ("washington", "gridded_current.nc", "")],
)  # fmt: skip
def test_real_files_give_the_surface(folder: str, pattern: str, level: str, data: Path) -> None:
    extra = [str(data / folder / "hycom.gdp.h.nc")] if folder == "biscay" else []
    source = sources.open_source(
        "current", [str(data / folder / pattern), *extra], steady=folder == "biscay"
    )
    assert level in " ".join(source.notes)


AIR = ("eastward_wind", "northward_wind")


def winds(path: Path, *names: str, speeds: Any = (5.0, 20.0, 30.0)) -> Path:
    """Write winds by standard name, each pair as fast as the next of `speeds`."""
    data = linear.dataset([0.0, 1.0])
    held = {}
    for name, speed in zip(names, speeds, strict=False):
        for letter, standard in zip("uv", AIR, strict=True):
            values = np.full(data.uo.shape, speed)
            held[name.replace("?", letter)] = (
                data.uo.dims,
                values,
                {"standard_name": standard, "units": "m s-1"},
            )
    return linear.written(path, data.drop_vars(["uo", "vo"]).assign(held))


@pytest.mark.parametrize(
    ("name", "told"),
    [("?850", "850 hPa"), ("?GRD_850mb", "850 mb"), ("?100", "100 m"), ("100?", "100 m"), ("?_ml", '"ml"'),
     ("?GRD_tropopause", '"tropopause"'), ("?wnd_925hPa", "925 hPa"), ("?_component_of_wind_500", "500 hPa"),
     ("?GRD_1829mabovemeansealevel", "1829 m"), ("?_height_100", "100 m"), ("?a_h80", "80 m"), ("?_hub", '"hub"'), ("?GRD_0D85sigma", "0.85"), ("?80m", "80 m")],
)  # fmt: skip
def test_a_level_in_a_name_alone_is_judged(name: str, told: str, tmp_path: Path) -> None:
    """Rejected as a level in an attribute is; the key that the error names takes it."""
    path = winds(tmp_path / "a.nc", name)
    with pytest.raises(UserError) as caught:
        sources.open_source("wind", path)
    assert told in str(caught.value)
    assert "[[wind]] variables.level" in str(caught.value)
    source = sources.open_source("wind", path, variables={"level": 0})
    assert source.read(0)[3, 3, 0] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("name", "other"),
    [("?10", "?850"), ("?10m", "?GRD_850mb"), ("10?", "100?"), ("?10n", "?_ml"), ("?GRD_10maboveground", "?gust"),
     ("?GRD_0D995sigma", "?GRD_850mb"), ("wind_?", "?850"), ("wind_?", "?gust")],
)  # fmt: skip
def test_ten_metres_are_taken_of_several(name: str, other: str, tmp_path: Path) -> None:
    source = sources.open_source("wind", winds(tmp_path / "a.nc", other, name, speeds=(20.0, 5.0)))
    assert source.read(0)[3, 3, 0] == pytest.approx(5.0)


def test_gusts_are_no_wind_whatever_their_standard_name(tmp_path: Path) -> None:
    path = winds(tmp_path / "a.nc", "?gust")
    with pytest.raises(UserError, match=r"no wind .*ugust"):
        sources.open_source("wind", path)
    source = sources.open_source("wind", path, variables={"east": "ugust", "north": "vgust"})
    assert source.read(0)[3, 3, 1] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("name", "passes"),
    [
        ("u_15m", False),
        ("u_bottom", False),
        ("u_depth_30", False),
        ("u_z30", False),
        ("u_mid", False),
        ("ubar", False),
        ("uo_30", False),
        ("u_0m", True),
        ("u_2m", True),
    ],
)
def test_a_depth_in_a_name(name: str, passes: bool, tmp_path: Path) -> None:
    data = linear.dataset([0.0, 1.0]).rename(uo=name, vo=f"v{name[1:]}")
    path = linear.written(tmp_path / "a.nc", data)
    if not passes:
        with pytest.raises(UserError, match="at most 5 m deep"):
            sources.open_source("current", path)
    source = sources.open_source("current", path, variables={} if passes else {"level": 0})
    assert linear.worst(source) < 1e-6
