"""Grids that move: every slice is read at its own places, and the nest has no value where it is
not.
"""

from pathlib import Path
from typing import Any

import linear
import numpy as np
import pyproj
import pytest
import xarray as xr

from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources
from geo.grids.grid import sample

HOURS = np.arange(0.0, 13.0)
NODES = np.arange(-16, 17)
NEAR = 5e-6  # [m/s] float32 of the places is 2e-6 deg, of the speeds 1e-7


def nest(hours: Any, turn: float = 0.0, drift: float = 0.1, quantity: str = "wind") -> xr.Dataset:
    """Return WRF's layout, whose 33 x 33 points move east and north with the hours; turn: of its
    axes from east [rad].
    """
    i, j = np.meshgrid(0.25 * NODES, 0.2 * NODES)
    east, north = i * np.cos(turn) - j * np.sin(turn), i * np.sin(turn) + j * np.cos(turn)
    hours = np.asarray(hours, float)[:, None, None]
    lon, lat = -30.5 + drift * hours + east, 40.0 + 0.6 * drift * hours + north
    u, v = linear.field(lon, lat, hours)
    dims = ("Time", "south_north", "west_east")
    names = ("U10", "V10") if quantity == "wind" else ("uo", "vo")
    said = {"units": "m s-1", "coordinates": "XLONG XLAT XTIME"}
    return xr.Dataset(
        {names[0]: (dims, u, said), names[1]: (dims, v, said)},
        {
            "XLONG": (dims, lon.astype(np.float32), {"units": "degree_east"}),
            "XLAT": (dims, lat.astype(np.float32), {"units": "degree_north"}),
            "Time": ("Time", hours[:, 0, 0], {"units": linear.UNITS}),
        },
    )


@pytest.mark.parametrize("box", [None, Box(-31.0, 38.0, -27.0, 42.0)])
def test_each_slice_is_read_at_its_own_places(box: Box | None, tmp_path: Path) -> None:
    path = linear.written(tmp_path / "nest.nc", nest(HOURS))
    source = sources.open_source("wind", path, box=box)
    assert linear.worst(source) < NEAR
    assert any("13 positions" in note for note in source.notes)


def test_one_file_a_time_and_places_that_come_again(tmp_path: Path) -> None:
    """WRF writes a file a time; the nest stands still between its moves, and may go back."""
    for k, place in enumerate((0.0, 0.0, 3.0, 5.0, 3.0)):
        data = nest([place])
        right = linear.field(
            data.XLONG.values.astype(float), data.XLAT.values.astype(float), float(k)
        )
        data = data.assign(U10=data.U10.copy(data=right[0]), V10=data.V10.copy(data=right[1]))
        linear.written(
            tmp_path / f"wrfout_{k}.nc", data.assign_coords(Time=data.Time.copy(data=[float(k)]))
        )
    source = sources.open_source("wind", str(tmp_path / "wrfout_*.nc"))
    assert linear.worst(source) < NEAR
    assert any("3 positions" in note for note in source.notes)


def test_one_file_a_time_whose_axes_know_no_time(tmp_path: Path) -> None:
    """Hurricane nests: every file has one time and its own longitudes and latitudes."""
    for k in range(4):
        lon, lat = linear.LON + 0.37 * k, linear.LAT - 0.11 * k
        linear.written(
            tmp_path / f"storm_{k}.nc", linear.dataset([float(k)], lon, lat, names=linear.WIND)
        )
    source = sources.open_source("wind", str(tmp_path / "storm_*.nc"))
    assert linear.worst(source) < NEAR
    assert any("4 positions" in note for note in source.notes)
    larger = linear.dataset([4.0], np.arange(-35.0, -25.0, 0.5), linear.LAT, names=linear.WIND)
    linear.written(tmp_path / "storm_4.nc", larger.assign_coords(lon=larger.lon + 0.2))
    with pytest.raises(UserError, match="another grid"):
        sources.open_source("wind", str(tmp_path / "storm_*.nc"))


def test_axes_that_move_and_a_time_that_does_not(tmp_path: Path) -> None:
    data = nest(HOURS, quantity="current")
    for name, dim in (("XLONG", "west_east"), ("XLAT", "south_north")):
        data[name] = data[name].isel({"south_north" if dim == "west_east" else "west_east": 0})
    source = sources.open_source("current", linear.written(tmp_path / "axes.nc", data))
    assert linear.worst(source) < NEAR
    still = linear.written(tmp_path / "still.nc", nest(HOURS, drift=0.0))
    source = sources.open_source("wind", still)
    assert not any("moves" in note for note in source.notes)


def test_a_turned_nest_has_its_vectors_turned(tmp_path: Path) -> None:
    """Its axes lie 20 degrees from east on a plane of degrees, which no projection is: true
    components are stated.
    """
    path = linear.written(tmp_path / "nest.nc", nest(HOURS, turn=0.35))
    source = sources.open_source("wind", path, variables={"axes": "true"})
    # bilinear in cells that are no rectangles of degrees, edges of great circles
    assert linear.worst(source) < 2e-3


LAMBERT = "+proj=lcc +lat_1=30 +lat_2=50 +lat_0=40 +lon_0=-50 +R=6370000"


@pytest.mark.parametrize("staggered", [False, True])
def test_a_lambert_nest_turns_its_vectors_at_each_place(staggered: bool, tmp_path: Path) -> None:
    """20 degrees from its central meridian the axes lie 13 degrees from east; u and v may have
    places of their own.
    """
    to = pyproj.Proj(LAMBERT)
    data: dict[str, Any] = {"Time": ("Time", HOURS, {"units": linear.UNITS})}
    half = 0.5 if staggered else 0.0
    for name, side, along_x, along_y in (("U10", 0, half, 0.0), ("V10", 1, 0.0, half)):
        i, j = np.meshgrid(np.arange(36.0) - along_x, np.arange(34.0) - along_y)
        x0, y0 = to(-30.5, 40.0)
        step = 20e3
        x = x0 + step * (i - 18) + 9e3 * HOURS[:, None, None]
        y = y0 + step * (j - 17) + 4e3 * HOURS[:, None, None]
        lon, lat = to(x, y, inverse=True)
        u, v = linear.field(lon, lat, HOURS[:, None, None])
        angle = np.radians(to.get_factors(lon, lat).meridian_convergence)
        value = (
            u * np.cos(angle) - v * np.sin(angle)
            if side == 0
            else u * np.sin(angle) + v * np.cos(angle)
        )
        dims = (
            "Time",
            "south_north_stag" if along_y else "south_north",
            "west_east_stag" if along_x else "west_east",
        )
        tail = f"_{'UV'[side]}" if staggered else ""
        data[name] = (
            dims,
            value,
            {"units": "m s-1", "coordinates": f"XLONG{tail} XLAT{tail} XTIME"},
        )
        data[f"XLONG{tail}"] = (dims, lon, {"units": "degree_east"})
        data[f"XLAT{tail}"] = (dims, lat, {"units": "degree_north"})
    source = sources.open_source("wind", linear.written(tmp_path / "nest.nc", xr.Dataset(data)))
    # in cells of 20 km
    assert linear.worst(source, (-30.3, -29.7, -29.9), (40.1, 40.6, 39.6)) < 3e-4
    assert any("rotated" in note for note in source.notes)


def test_outside_the_nest_there_is_nothing(tmp_path: Path) -> None:
    path = linear.written(tmp_path / "nest.nc", nest(HOURS, drift=0.5))
    source = sources.open_source("wind", path)
    ahead, behind = (-25.0, 41.0), (-34.0, 38.0)  # inside the nest at the end, and at the beginning
    for k, (lon, lat) in ((0, ahead), (12, behind)):
        assert np.isnan(sample(source.grid, source.read(k), [lon], [lat])).all()
    for k, (lon, lat) in ((12, ahead), (0, behind)):
        right = linear.field(lon, lat, float(k))
        np.testing.assert_allclose(
            sample(source.grid, source.read(k), [lon], [lat])[0], right, atol=NEAR
        )
    with pytest.raises(UserError, match="no overlap"):
        sources.open_source("wind", path, box=Box(10.0, 40.0, 11.0, 41.0))
    early = sources.open_source("wind", path, box=Box(-34.4, 37.0, -33.5, 37.8))
    assert np.isfinite(early.read(0)).all(axis=2).any()
    assert np.isnan(early.read(12)).all()
