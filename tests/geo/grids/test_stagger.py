"""Components of a staggered grid whose own points have no usable coordinates: taken from the points
between them.
"""

from pathlib import Path
from typing import Any

import model_writers
import numpy as np
import pytest
import writers
import xarray as xr

from geo import sphere
from geo.box import Box
from geo.errors import UserError
from geo.files import dataset
from geo.forcing import sources
from geo.forcing.reading import component
from geo.grids import layout, stagger
from geo.grids.grid import sample

AREA = Box(writers.LON[0], writers.LAT[0], writers.LON[1], writers.LAT[1])
SPACING = writers.CELL * 111_195.0  # [m]


def zero(values: Any) -> Any:
    return 0.0 * values


def fill(values: Any) -> Any:
    return 0.0 * values + 1e37


def nothing(values: Any) -> Any:
    return values + np.nan


def roms(folder: Path, spoil: Any) -> Path:
    """A ROMS file whose lon_u, lat_u, lon_v, lat_v are spoiled, or absent for None."""
    data = xr.load_dataset(
        model_writers.roms(folder / "good.nc", own_points=True), decode_times=False
    )
    named = [f"{axis}_{side}" for axis in ("lon", "lat") for side in "uv"]
    data = (
        data.drop_vars(named) if spoil is None else data.assign({n: spoil(data[n]) for n in named})
    )
    for side in "uv":
        data[side].attrs["coordinates"] = f"lon_{side} lat_{side} s_rho ocean_time"
    data.to_netcdf(folder / "a.nc", encoding={n: {"_FillValue": None} for n in data.variables})
    return folder / "a.nc"


def places(path: Path, name: str, side: int, **chosen: Any) -> tuple[Any, Any]:
    data = dataset.open_one(str(path), "current")
    wanted = component.Wanted(name, side, "current", chosen, None, None, needs_times=False)
    return layout.points(component.gather(wanted, [(str(path), data)]).layout)


def apart(a: Any, b: Any) -> float:
    """The largest distance [m] between places."""
    return float(np.max(sphere.distance(*np.radians(a), *np.radians(b))))


@pytest.mark.parametrize(
    "spoil", [None, zero, fill, nothing], ids=["absent", "zero", "undeclared fill", "missing"]
)
def test_roms_without_usable_points(spoil: Any, tmp_path: Path) -> None:
    path = roms(tmp_path, spoil)
    good = xr.load_dataset(tmp_path / "good.nc", decode_times=False)
    for side, name in enumerate("uv"):
        true = good[f"lon_{name}"].values, good[f"lat_{name}"].values
        # the writer's points are midway in a plane 300 km wide: its straight lines bend by x / R^2,
        # over h / 2 twice
        bound = (SPACING / 2) ** 2 * 400e3 / sphere.RADIUS**2
        assert apart(places(path, name, side), true) < bound
    source = sources.open_source("current", path, box=AREA)
    assert any(
        "u has no coordinates of its own: taken midway between the points of lon_rho" in n
        for n in source.notes
    )
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(*writers.LON, 2000), rng.uniform(*writers.LAT, 2000)
    got = sample(source.grid, source.read(0), lon, lat)
    assert np.abs(got - np.stack(writers.field(lon, lat, 0.0), -1)).max() < writers.tolerance()


def nemo(
    path: Path,
    names: tuple[str, str] = ("vozocrtx", "vomecrty"),
    t: str = "glamt gphit",
    mask: bool = False,
) -> Path:
    """u and v half a cell after their T points, of the same sizes; the file holds the T points
    alone.
    """
    to, x, y, turn = model_writers.oblique()
    step = x[0, 1] - x[0, 0]
    held: dict[str, Any] = {}
    for k, (name, east, north) in enumerate(
        zip(names, (step / 2, 0.0), (0.0, step / 2), strict=True)
    ):
        held[name] = (
            ("time", "y", "x"),
            model_writers.along(to, *model_writers.turned(to, x + east, y + north, turn), turn)[k],
            {"units": "m/s"},
        )
    for name, values, units in zip(
        t.split(), model_writers.turned(to, x, y, turn), ("east", "north"), strict=True
    ):
        held[name] = (("y", "x"), values, {"units": f"degrees_{units}"})
    if mask:
        held |= {name: (("y", "x"), np.ones(x.shape)) for name in ("umask", "vmask", "tmask")}
    xr.Dataset(held, {"time": writers.TIMES}).to_netcdf(path)
    return path


def own_points(side: int) -> tuple[Any, Any]:
    to, x, y, turn = model_writers.oblique()
    step = x[0, 1] - x[0, 0]
    return model_writers.turned(
        to, x + (step / 2 if side == 0 else 0), y + (step / 2 if side else 0), turn
    )


def test_columns_midway_across_the_antimeridian(tmp_path: Path) -> None:
    """T points in rows and columns, whose longitudes jump from 180 to -180 degrees."""
    lon, lat = np.meshgrid(177.1 + 0.5 * np.arange(12), -17.3 + 0.25 * np.arange(9))
    current = ("time", "y", "x"), np.full((len(writers.TIMES), *lon.shape), 0.3), {"units": "m/s"}
    held: dict[str, Any] = {"vozocrtx": current, "vomecrty": current}
    held["glamt"] = ("y", "x"), (lon + 180) % 360 - 180, {"units": "degrees_east"}
    held["gphit"] = ("y", "x"), lat, {"units": "degrees_north"}
    xr.Dataset(held, {"time": writers.TIMES}).to_netcdf(tmp_path / "a.nc")
    for side, name in enumerate(("vozocrtx", "vomecrty")):
        east, north = (0.25, 0.0) if side == 0 else (0.0, 0.125)
        assert apart(places(tmp_path / "a.nc", name, side), (lon + east, lat + north)) < 0.1


@pytest.mark.parametrize("how", ["names", "masks", "stated"])
def test_nemo_from_t_points(how: str, tmp_path: Path) -> None:
    names = ("u", "v") if how != "names" else ("vozocrtx", "vomecrty")
    path = nemo(tmp_path / "a.nc", names, mask=how == "masks")
    chosen = {"stagger": "after"} if how == "stated" else {}
    if how == "stated":
        data = xr.load_dataset(path, decode_times=False)
        for name in names:
            data[name].attrs["standard_name"] = (
                f"sea_water_{'xy'[name == 'v']}_velocity_at_{name}_location"
            )
        data.to_netcdf(path)
    for side, name in enumerate(names):
        # at the last column and row a straight line goes on by half a cell: h^2 of the plane's
        # bending there
        assert (
            apart(places(path, name, side, **chosen), own_points(side))
            < SPACING**2 * 400e3 / sphere.RADIUS**2
        )
    source = sources.open_source("current", path, variables=chosen, box=AREA)
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(*writers.LON, 2000), rng.uniform(*writers.LAT, 2000)
    got = sample(source.grid, source.read(0), lon, lat)
    assert np.abs(got - np.stack(writers.field(lon, lat, 0.0), -1)).max() < writers.tolerance()
    assert any("half a cell after them along the columns" in note for note in source.notes)


def test_u_points_are_chosen_before_t_points(tmp_path: Path) -> None:
    data = xr.load_dataset(nemo(tmp_path / "a.nc"), decode_times=False)
    for side, letter in enumerate("uv"):
        for axis, values in zip(("glam", "gphi"), own_points(side), strict=True):
            data[f"{axis}{letter}"] = (("y", "x"), values, data[f"{axis}t"].attrs)
    data.to_netcdf(tmp_path / "b.nc")
    for side, name in enumerate(("vozocrtx", "vomecrty")):
        assert apart(places(tmp_path / "b.nc", name, side), own_points(side)) < 1e-3


def test_what_a_case_states_wins_over_names(tmp_path: Path) -> None:
    """A cut-out of NEMO that kept the T points under the name that U files have for their own."""
    data = xr.load_dataset(nemo(tmp_path / "a.nc"), decode_times=False)
    data.rename(glamt="nav_lon", gphit="nav_lat").to_netcdf(tmp_path / "b.nc")
    for how, shift in (("after", 0.0), ("before", 1.0), ("none", 0.5)):
        off = apart(places(tmp_path / "b.nc", "vozocrtx", 0, stagger=how), own_points(0))
        assert off == pytest.approx(shift * SPACING, rel=0.02, abs=2.0)


def test_side_that_nothing_tells_is_asked_for(tmp_path: Path) -> None:
    """ROMS's names with u and v as large as rho: half a cell, but which way?"""
    data = xr.load_dataset(
        nemo(tmp_path / "a.nc", ("u", "v"), "lon_rho lat_rho"), decode_times=False
    )
    held = {"u": data["u"].rename(x="xi_u", y="eta_u"), "v": data["v"].rename(x="xi_v", y="eta_v")}
    points = {n: data[n].rename(x="xi_rho", y="eta_rho") for n in ("lon_rho", "lat_rho")}
    xr.Dataset(held | points).to_netcdf(tmp_path / "b.nc")
    with pytest.raises(
        UserError, match=r'"u" lies half a cell beside.*variables\.stagger = "after"'
    ) as caught:
        sources.open_source("current", tmp_path / "b.nc")
    assert "\n" not in str(caught.value)
    with pytest.raises(UserError, match="allowed are after, before, none"):
        sources.open_source("current", tmp_path / "b.nc", variables={"stagger": "left"})
    for how, shift in (("after", 0.0), ("before", 1.0), ("none", 0.5)):
        off = apart(places(tmp_path / "b.nc", "u", 0, stagger=how), own_points(0))
        assert off == pytest.approx(shift * SPACING, rel=0.02, abs=2.0)  # 0.02: the plane's scale


@pytest.mark.parametrize("shift", [-0.5, 0.5])
def test_axis_shifts_tell_the_side(shift: float, tmp_path: Path) -> None:
    """MITgcm's u stands before its centre, in the words of xgcm: c_grid_axis_shift of the
    dimension's variable.
    """
    data = xr.load_dataset(nemo(tmp_path / "a.nc", ("u", "v"), "XC YC"), decode_times=False)
    count = {d: np.arange(data.sizes[d]) for d in ("x", "y")}
    held = {"u": data["u"].rename(x="i_g", y="j"), "v": data["v"].rename(x="i", y="j_g")}
    held |= {n: data[n].rename(x="i", y="j") for n in ("XC", "YC")}
    held |= {"i_g": ("i_g", count["x"], {"axis": "X", "c_grid_axis_shift": shift})}
    held |= {"j_g": ("j_g", count["y"], {"axis": "Y", "c_grid_axis_shift": shift})}
    xr.Dataset(held).to_netcdf(tmp_path / "b.nc")
    for side, name in enumerate("uv"):
        off = apart(places(tmp_path / "b.nc", name, side), own_points(side))
        assert off == pytest.approx((0.5 - shift) * SPACING, rel=0.02, abs=2.0)


def test_points_beyond_both_ends(tmp_path: Path) -> None:
    """WRF: one column more than the mass points have, whose places are repeated for every time."""
    to, x, y, turn = model_writers.oblique()
    step = x[0, 1] - x[0, 0]
    lon, lat = model_writers.turned(to, x, y, turn)
    wide = np.concatenate((x - step / 2, x[:, -1:] + step / 2), axis=1)
    true = model_writers.turned(to, wide, np.concatenate((y, y[:, -1:]), axis=1), turn)
    dims = ("Time", "south_north", "west_east")
    data = xr.Dataset(
        {
            "U10": (
                ("Time", "south_north", "west_east_stag"),
                np.ones((1, *wide.shape)),
                {"units": "m/s"},
            ),
            "XLONG": (dims, lon[None], {"units": "degree_east"}),
            "XLAT": (dims, lat[None], {"units": "degree_north"}),
        }
    )
    data.to_netcdf(tmp_path / "a.nc")
    assert apart(places(tmp_path / "a.nc", "U10", 0), true) < SPACING**2 * 400e3 / sphere.RADIUS**2


def test_midway_round_the_earth() -> None:
    """Midway is on the great circle, over the antimeridian, over the pole and across the seam."""
    lon, lat = np.meshgrid(np.arange(5.0, 360.0, 10.0), [60.0, 89.0])
    x, y = stagger.midpoints(lon, lat, lon.shape, (0.0, 0.5), 0)
    np.testing.assert_allclose((x - lon + 180.0) % 360.0 - 180.0, 5.0, atol=1e-9)
    np.testing.assert_allclose(
        np.tan(np.radians(y)), np.tan(np.radians(lat)) / np.cos(np.radians(5.0)), rtol=1e-12
    )
    x, y = stagger.midpoints(lon, lat, lon.shape, (0.0, -0.5), 0)
    np.testing.assert_allclose((x - lon + 180.0) % 360.0 - 180.0, -5.0, atol=1e-9)
