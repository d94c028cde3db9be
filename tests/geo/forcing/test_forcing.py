"""Readers of forcing on files made here: seams, poles, levels, times and units."""

import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import writers
import xarray as xr
from ramps import AXES, Z, ramp, timed, written

from geo.box import Box
from geo.errors import UserError
from geo.forcing import describe
from geo.forcing import sources as forcing
from geo.grids.fill import fill
from geo.grids.grid import Grid, share_covered


@pytest.mark.parametrize(
    "lon",
    [
        np.arange(0.0, 360.0, 2.5),
        np.arange(-180.0, 180.0, 2.5),
        np.arange(0.0, 360.1, 2.5),  # both ends
        np.arange(20.0, 380.0, 2.5).astype(np.float32),
        np.arange(357.5, -0.1, -2.5),
    ],
    ids=["0..360", "-180..180", "0 and 360", "20..380", "descending"],
)
def test_global_seam(lon: Any, tmp_path: Path) -> None:
    lat = np.arange(-60.0, 61.0, 2.5)
    path = written(tmp_path / "a.nc", lon, lat, *ramp(lon, lat))
    source = forcing.open_source("current", path, steady=True)
    assert source.grid.seamless
    assert (source.grid.nlon, source.grid.nlat) == (145, 49)
    assert (source.grid.nlon - 1) * source.grid.dlon == pytest.approx(360, abs=1e-9)
    values = source.read(0)
    np.testing.assert_array_equal(values[:, 0], values[:, -1])
    np.testing.assert_allclose(
        values, np.stack(ramp(source.grid.lon, source.grid.lat), -1), atol=1e-5
    )
    for west in (-181.0 + 360, -3.0, 177.0, 17.0):
        box = Box((west + 180) % 360 - 180, -10.0, (west + 180) % 360 - 180 + 6.0, 20.0)
        part = forcing.open_source("current", path, steady=True, box=box)
        assert part.grid.nlon <= 8
        assert share_covered(part.grid, box) == pytest.approx(1.0)
        np.testing.assert_allclose(
            part.read(0), np.stack(ramp(part.grid.lon, part.grid.lat), -1), atol=1e-5
        )


@pytest.mark.parametrize(
    "lon",
    [np.arange(170.0, 190.1, 0.5), (np.arange(170.0, 190.1, 0.5) + 180) % 360 - 180,
     np.sort((np.arange(170.0, 190.1, 0.5) + 180) % 360 - 180)],
    ids=["170..190", "jumps", "sorted"],
)  # fmt: skip
def test_antimeridian_inside_a_region(lon: Any, tmp_path: Path) -> None:
    lat = np.arange(-20.0, -9.9, 0.5)
    path = written(tmp_path / "a.nc", lon, lat, *ramp(lon, lat))
    for box in (None, Box(178.0, -15.0, 183.0, -12.0), Box(-179.0, -15.0, -175.0, -12.0)):
        source = forcing.open_source("current", path, steady=True, box=box)
        assert not source.grid.seamless
        assert source.grid.nlon == 41 or box is not None
        assert source.grid.nlon < 60
        np.testing.assert_allclose(
            source.read(0), np.stack(ramp(source.grid.lon, source.grid.lat), -1), atol=1e-5
        )
        if box:
            assert share_covered(source.grid, box) == pytest.approx(1.0)


@pytest.mark.parametrize("row", ["vector", "constant", "zero"])
def test_the_row_of_a_pole_is_one_vector(row: str, tmp_path: Path) -> None:
    """A uniform flow over the pole; files write the pole's row as that vector, as one number for
    all columns, or as nothing.
    """
    lon, lat = np.arange(0.0, 360.0, 5.0), np.arange(-90.0, 90.1, 0.5)
    turn = np.radians(lon)[None, :] * np.sign(lat)[:, None]
    u, v = 0.4 * np.cos(turn) - 0.1 * np.sin(turn), -0.1 * np.cos(turn) - 0.4 * np.sin(turn)
    if row != "vector":
        for pole in (0, -1):
            u[pole], v[pole] = (0.4, -0.1) if row == "constant" else (0.0, 0.0)
    source = forcing.open_source("current", written(tmp_path / "a.nc", lon, lat, u, v), steady=True)
    values = source.read(0)
    assert np.isfinite(values).all()
    for pole, sign in ((0, -1), (-1, 1)):
        turn = sign * np.radians(source.grid.lon)
        expected = 0.4 * np.cos(turn) - 0.1 * np.sin(turn), -0.1 * np.cos(turn) - 0.4 * np.sin(turn)
        np.testing.assert_allclose(values[pole], np.stack(expected, axis=-1), atol=1e-6)


def test_single_precision_axes_are_uniform(tmp_path: Path) -> None:
    lon = np.linspace(-75.04, -60.0, 189).astype(np.float32)
    lat = np.linspace(31.0, 42.0, 276).astype(np.float32)
    source = forcing.open_source(
        "current", written(tmp_path / "a.nc", lon, lat, *ramp(lon, lat)), steady=True
    )
    assert (source.grid.nlon, source.grid.nlat) == (189, 276)


@pytest.mark.parametrize("value", [999.0, -999.0, 9999.0, 1e20, 1.26765e30, -1e34, np.inf])
def test_undeclared_fill_values(value: float, tmp_path: Path) -> None:
    u, v = ramp(*AXES)
    u[2, 3], v[2, 3] = value, value
    source = forcing.open_source("current", written(tmp_path / "a.nc", *AXES, u, v), steady=True)
    dry = np.isnan(source.read(0)[..., 0])
    assert dry[2, 3]
    assert dry.sum() == 1
    assert any("fill values that the file does not declare" in note for note in source.notes)


def test_zeros_are_land_whether_or_not_other_values_are_missing(tmp_path: Path) -> None:
    u, v = ramp(*AXES)
    u[:3, :2] = v[:3, :2] = 0.0
    path = written(tmp_path / "a.nc", *AXES, u, v)
    assert forcing.open_source("current", path, steady=True).missing == pytest.approx(6 / u.size)
    assert (
        forcing.open_source("current", path, steady=True, variables={"mask": "none"}).missing == 0
    )
    u[-1, -1] = np.nan
    path = written(tmp_path / "b.nc", *AXES, u, v)
    assert forcing.open_source("current", path, steady=True).missing == pytest.approx(7 / u.size)


@pytest.mark.parametrize(
    ("units", "factor"),
    [("m s-1", 1), ("meter second-1", 1), ("m s**-1", 1), ("m/s", 1), ("cm/s", 0.01), ("cm s-1", 0.01), ("kn", 1852 / 3600),
     ("knots", 1852 / 3600), ("kt", 1852 / 3600), ("km/h", 1 / 3.6), ("km h-1", 1 / 3.6), ("mm s^-1", 1e-3), ("M/S", 1),
     ("metres per second", 1), ("Meters Per Second", 1), ("m per sec", 1), ("centimetres per second", 0.01), ("KM/H", 1 / 3.6),
     ("nautical miles per hour", 1852 / 3600), ("NM/h", 1852 / 3600), ("m s\u207b\u00b9", 1), ("m\u00b7s-1", 1),
     ("miles per hour", 1609.344 / 3600), ("feet per second", 0.3048)],
)  # fmt: skip
def test_units(units: str, factor: float, tmp_path: Path) -> None:
    u, v = ramp(*AXES)
    path = written(tmp_path / "a.nc", *AXES, u, v, attributes={"units": units})
    got = forcing.open_source("current", path, steady=True).read(0)
    np.testing.assert_allclose(got, factor * np.stack((u, v), -1), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("levels", "attributes", "depth", "chosen"),
    [([0.5, 10.0, 30.0], {"units": "m", "positive": "down"}, None, 0), ([-30.0, -10.0, -0.5], {"units": "m", "positive": "up"}, None, 2),
     ([30.0, 10.0, 0.5], {"units": "m", "positive": "down"}, None, 2), ([0.5, 10.0, 30.0], {"units": "m"}, 12.0, 1),
     ([-30.0, -10.0, -0.5], {"units": "m"}, 12.0, 1), ([-0.9, -0.5, -0.1], {"standard_name": "ocean_s_coordinate_g2"}, None, 2),
     ([1, 2, 3], {"positive": "down"}, None, 0), ([1, 2, 3], {"positive": "up"}, None, 2)],
)  # fmt: skip
def test_levels(
    levels: Any, attributes: Any, depth: float | None, chosen: int, tmp_path: Path
) -> None:
    u, v = ramp(*AXES)
    weight = np.array([0.1, 0.2, 0.3])[:, None, None]
    dims = ("depth", "lat", "lon")
    xr.Dataset(
        {"uo": (dims, u * weight, writers.EAST), "vo": (dims, v * weight, writers.NORTH)},
        {"depth": ("depth", levels, attributes), "lat": AXES[1], "lon": AXES[0]},
    ).to_netcdf(tmp_path / "a.nc")
    source = forcing.open_source("current", tmp_path / "a.nc", steady=True, depth=depth)
    np.testing.assert_allclose(source.read(0)[..., 0], u * weight[chosen], atol=1e-6)


def test_ensembles_must_be_chosen(tmp_path: Path) -> None:
    u, v = ramp(*AXES)
    weight = np.array([0.1, 0.2, 0.3])[:, None, None]
    dims = ("member", "lat", "lon")
    data = xr.Dataset(
        {"uo": (dims, u * weight, writers.EAST), "vo": (dims, v * weight, writers.NORTH)},
        {"lat": AXES[1], "lon": AXES[0]},
    )
    data.to_netcdf(tmp_path / "a.nc")
    with pytest.raises(UserError, match=r"more than one member.*variables.member"):
        forcing.open_source("current", tmp_path / "a.nc", steady=True)
    source = forcing.open_source("current", tmp_path / "a.nc", steady=True, variables={"member": 1})
    np.testing.assert_allclose(source.read(0)[..., 0], u * 0.2, atol=1e-6)
    with pytest.raises(UserError, match="it is an index, 0 to 2"):
        forcing.open_source("current", tmp_path / "a.nc", steady=True, variables={"member": "3"})
    data.isel(member=[2]).to_netcdf(tmp_path / "b.nc")
    np.testing.assert_allclose(
        forcing.open_source("current", tmp_path / "b.nc", steady=True).read(0)[..., 0],
        u * 0.3,
        atol=1e-6,
    )


def test_calendars_and_rounding(tmp_path: Path) -> None:
    source = forcing.open_source(
        "current", timed(tmp_path / "a.nc", [0.0, 1 / 3, 2 / 3], "days since 2024-02-28", "noleap")
    )
    assert (source.times == np.array(["2024-02-28T00", "2024-02-28T08", "2024-02-28T16"], Z)).all()
    source = forcing.open_source(
        "current", timed(tmp_path / "b.nc", [0.0, 1.0, 2.0], "days since 2024-02-28", "noleap")
    )
    assert source.times[1] == np.datetime64("2024-03-01")  # its own 29 February does not exist
    assert any("noleap" in note for note in source.notes)
    with pytest.raises(UserError, match=r"360_day.*do not exist.*times"):
        forcing.open_source(
            "current",
            timed(tmp_path / "c.nc", [28.0, 29.0, 30.0], "days since 2023-02-01", "360_day"),
        )
    # Half a second and more goes up, also where a day's fraction is cut by float64.
    source = forcing.open_source(
        "current", timed(tmp_path / "e.nc", [0.6, 10.4, 3599.7], "seconds since 2024-03-05")
    )
    assert (
        source.times
        == np.array(["2024-03-05T00:00:01", "2024-03-05T00:00:10", "2024-03-05T01:00:00"], Z)
    ).all()
    # Single precision: days since 1950 are told to 169 s, so that whole hours come back however
    # they were cut.
    late = np.array(["2024-03-05T01", "2024-03-05T02", "2024-03-05T05", "2024-03-06T13"], Z)
    cut = ((late - np.datetime64("1950-01-01")) / np.timedelta64(1, "D")).astype(np.float32)
    assert np.ptp((cut * 86_400.0) % 3600) > 300  # below and above their hours
    source = forcing.open_source("current", timed(tmp_path / "f.nc", cut, "days since 1950-01-01"))
    assert (source.times == late).all()
    days = ((writers.TIMES - np.datetime64("1858-11-17")) / np.timedelta64(1, "D")).astype(
        np.float32
    )
    source = forcing.open_source("current", timed(tmp_path / "d.nc", days, "days since 1858-11-17"))
    assert (source.times == writers.TIMES.astype(Z)).all()


def test_zarr(tmp_path: Path) -> None:
    pytest.importorskip("zarr")
    path = timed(tmp_path / "a.nc", [0.0, 3.0, 6.0])
    with xr.open_dataset(path) as data, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Zarr's own on its format 3
        data.to_zarr(tmp_path / "a.zarr", consolidated=False)
    one, other = (forcing.open_source("current", tmp_path / n) for n in ("a.nc", "a.zarr"))
    assert (one.times == other.times).all()
    np.testing.assert_array_equal(one.read(1), other.read(1))


def test_fingerprint_follows_the_content_alone(tmp_path: Path) -> None:
    a = timed(tmp_path / "a.nc", [0.0, 3.0])
    shutil.copy(a, tmp_path / "moved.nc")
    b = timed(tmp_path / "b.nc", [0.0, 3.0], plus=1e-3)
    prints = [forcing.open_source("current", p).fingerprint for p in (a, tmp_path / "moved.nc", b)]
    assert prints[0] == prints[1]
    assert prints[0] != prints[2]


def test_fill_goes_ring_by_ring() -> None:
    values = np.full((5, 7, 2), np.nan, np.float32)
    values[0, 0], values[1, 0] = (1.0, 4.0), (3.0, 8.0)
    one, two = fill(values, 1), fill(values, 2)
    np.testing.assert_array_equal(one[0, 1], (2.0, 6.0))  # mean of both wet neighbours
    np.testing.assert_array_equal(one[2, 0], (3.0, 8.0))
    assert np.isfinite(one[..., 0]).sum() == 6
    assert np.isfinite(two[..., 0]).sum() == 12
    np.testing.assert_array_equal(two[:2, 0], values[:2, 0])
    np.testing.assert_array_equal(fill(values, 0), values)
    ring = fill(np.concatenate((values, values[:, :1]), 1), 1, seamless=True)
    assert np.isfinite(ring[0, 6, 0])
    np.testing.assert_array_equal(ring[:, 0], ring[:, -1])
    assert np.isnan(values[3, 3]).all()  # the input is not touched


def test_constant_and_table() -> None:
    source = forcing.constant_field("wind", 3.0, -4.0)
    assert source.grid == Grid(-180.0, -90.0, 360.0, 180.0, 2, 2)
    assert source.grid.seamless
    np.testing.assert_array_equal(source.read(0), np.broadcast_to([3.0, -4.0], (2, 2, 2)))
    times = np.array(["2024-03-05T00", "2024-03-05T06"], Z)
    source = forcing.uniform_field("current", times, [0.1, 0.2], [0.3, -0.4])
    np.testing.assert_array_equal(source.read(1)[1, 0], np.array([0.2, -0.4], np.float32))
    with pytest.raises(UserError, match="times must increase"):
        forcing.uniform_field("current", times[::-1], [0.1, 0.2], [0.3, -0.4])
    with pytest.raises(UserError, match="not a finite"):
        forcing.constant_field("wind", np.nan, 0.0)


def test_understand_and_describe(data: Path, tmp_path: Path) -> None:
    sources = describe.open_quantities(data / "paria" / "Sea_Med_slice_20170422_Paria.nc")
    assert [s.quantity for s in sources] == ["current"]
    text = "\n".join(describe.describe(sources[0]) + describe.sketch(sources[0]))
    for words in (
        "current: Sea_Med",
        "66.00 W to 62.00 W, 9.00 N to 13.00 N",
        "221200ZAPR17 only",
        "34.1 %",
        "·",
    ):
        assert words in text
    both = xr.merge([xr.open_dataset(timed(tmp_path / "a.nc", [0.0, 3.0]), decode_times=False)])
    both["u10"] = both.uo.assign_attrs(standard_name="eastward_wind") * 9.0
    both["v10"] = both.vo * 9.0
    both["u10"].attrs, both["v10"].attrs = {"units": "m/s"}, {"units": "m/s"}
    both.to_netcdf(tmp_path / "b.nc")
    assert [s.quantity for s in describe.open_quantities(tmp_path / "b.nc")] == ["current", "wind"]
    with pytest.raises(UserError, match="no current, wind or Stokes drift"):
        describe.open_quantities(data / "biscay" / "hycom.gdp.h.nc")
