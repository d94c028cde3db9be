"""One POD in closed form, on every kind of grid, reads back within the error of bilinear
interpolation.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import model_writers
import numpy as np
import pyproj
import pytest
import writers
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from drift.evidence.sensors import pod_file
from drift.evidence.sensors.records import PodGrid
from geo.errors import UserError

LON, LAT = np.arange(1.4, 6.65, 0.05), np.arange(57.6, 60.42, 0.05)
ATTRIBUTES = {"long_name": "probability of detection", "units": "1"}
SCALE = 0.45


def pod(lon: Any, lat: Any) -> np.ndarray:
    """POD (3, ...) at the times of the writers: 0.09 to 0.49, asymmetric."""
    return SCALE * writers.slices(np.asarray(lon), np.asarray(lat))[0]


def regular(lon: np.ndarray = LON, lat: np.ndarray = LAT) -> xr.Dataset:
    data = xr.Dataset(
        {"pod": (("time", "lat", "lon"), pod(*np.meshgrid(lon, lat)), ATTRIBUTES)},
        {"time": writers.TIMES, "lat": lat, "lon": lon},
    )
    data["lat"].attrs["units"], data["lon"].attrs["units"] = "degrees_north", "degrees_east"
    return data


def uneven(line: np.ndarray) -> np.ndarray:
    """The same extent, with steps of at most the cell's."""
    share = np.linspace(0, 1, 2 * len(line))
    return line[0] + (line[-1] - line[0]) * (share + 0.08 * np.sin(2 * np.pi * share))


def projected() -> xr.Dataset:
    to = pyproj.Proj(writers.STEREO)
    x, y = (
        np.asarray(v) for v in to(*np.meshgrid(np.linspace(1, 7, 30), np.linspace(57.5, 60.5, 30)))
    )
    step = writers.CELL * 111_195.0
    px, py = np.arange(x.min(), x.max(), step), np.arange(y.max(), y.min(), -step)
    lon, lat = to(*np.meshgrid(px, py), inverse=True)
    mapping = {"grid_mapping_name": "polar_stereographic", "straight_vertical_longitude_from_pole": 70.0,
               "latitude_of_projection_origin": 90.0, "standard_parallel": 60.0, "earth_radius": 6.371e6}  # fmt: skip
    axes = {"Y": ("Y", py, {"units": "m", "standard_name": "projection_y_coordinate"}),
            "X": ("X", px, {"units": "m", "standard_name": "projection_x_coordinate"})}  # fmt: skip
    values = (("time", "Y", "X"), pod(lon, lat), ATTRIBUTES | {"grid_mapping": "crs"})
    return xr.Dataset({"pod": values, "crs": ((), 0, mapping)}, {"time": writers.TIMES, **axes})


def rotated() -> xr.Dataset:
    mapping = {"grid_mapping_name": "rotated_latitude_longitude", "grid_north_pole_latitude": 25.0,
               "grid_north_pole_longitude": -40.0}  # fmt: skip
    to = pyproj.Transformer.from_crs("EPSG:4326", pyproj.CRS.from_cf(mapping), always_xy=True)
    x, y = to.transform(*np.meshgrid(np.linspace(1, 7, 9), np.linspace(57, 61, 9)))
    rlon, rlat = (
        np.arange(x.min(), x.max(), writers.CELL),
        np.arange(y.min(), y.max(), writers.CELL),
    )
    lon, lat = to.transform(*np.meshgrid(rlon, rlat), direction="INVERSE")
    axes = {"rlat": ("rlat", rlat, {"standard_name": "grid_latitude", "units": "degrees"}),
            "rlon": ("rlon", rlon + 360.0, {"standard_name": "grid_longitude", "units": "degrees"})}  # fmt: skip
    values = (("time", "rlat", "rlon"), pod(lon, lat), ATTRIBUTES | {"grid_mapping": "pole"})
    return xr.Dataset({"pod": values, "pole": ((), 0, mapping)}, {"time": writers.TIMES, **axes})


def curved() -> xr.Dataset:
    to, x, y, turn = model_writers.oblique()
    lon, lat = model_writers.turned(to, x, y, turn)
    values = (("time", "j", "i"), pod(lon, lat), ATTRIBUTES | {"coordinates": "lat lon"})
    return xr.Dataset(
        {"pod": values, "lon": (("j", "i"), lon), "lat": (("j", "i"), lat)}, {"time": writers.TIMES}
    )


def mesh() -> xr.Dataset:
    lon, lat, cells = model_writers.mesh()
    return xr.Dataset(
        {
            "pod": (("time", "node"), pod(lon, lat), ATTRIBUTES),
            "lon": ("node", lon, {"units": "degrees_east"}),
            "lat": ("node", lat, {"units": "degrees_north"}),
            "nv": (("three", "nele"), cells.T + 1),
        },
        {"time": writers.TIMES},
    )


def east_of_zero() -> xr.Dataset:
    data = regular(np.concatenate((np.arange(0.0, 8.0, 0.05), np.arange(358.0, 359.99, 0.05))))
    return data.isel(lat=slice(None, None, -1)).transpose("lon", "time", "lat")


def percent() -> xr.Dataset:
    data = regular()
    return data.assign(pod=(data["pod"] * 100).assign_attrs(units="%"))


KINDS: dict[str, Callable[[], xr.Dataset]] = {
    "regular": regular,
    "0..360, descending, lon first": east_of_zero,
    "per cent": percent,
    "no unit": lambda: regular().assign(pod=lambda d: d["pod"].assign_attrs(units="")),
    "uneven": lambda: regular(uneven(LON), uneven(LAT)),
    "two-dimensional coordinates of a regular grid": lambda: (
        regular()
        .rename(lat="y", lon="x")
        .assign(
            lon=(("y", "x"), np.meshgrid(LON, LAT)[0], {"units": "degrees_east"}),
            lat=(("y", "x"), np.meshgrid(LON, LAT)[1], {"units": "degrees_north"}),
        )
        .drop_vars(["x", "y"])
    ),
    "a name that says nothing, beside numbers of each time": lambda: xr.Dataset(
        {
            "field": regular()["pod"].drop_attrs().assign_attrs(units="1"),
            "sorties": ("time", [1.0, 2.0, 3.0]),
        }
    ),
    "a depth": lambda: regular().expand_dims(depth=[50.0]),
    "projected": projected,
    "rotated pole": rotated,
    "curved": curved,
    "mesh": mesh,
}


def sampled(grid: PodGrid, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """POD (t, n) by scipy's bilinear interpolation at points [deg]."""
    x = np.degrees(grid.lon[0]) + np.mod(lon - np.degrees(grid.lon[0]), 360.0)
    axes = (np.degrees(grid.lat), np.degrees(grid.lon))
    return np.stack(
        [RegularGridInterpolator(axes, slab)(np.stack((lat, x), -1)) for slab in grid.pod]
    )


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_same_pod_on_every_grid(kind: str, packed: bool, tmp_path: Path) -> None:
    data = KINDS[kind]()
    factor = 100.0 if kind == "per cent" else 1.0
    step = 2e-5
    how = (
        {
            "dtype": "i2",
            "scale_factor": step * factor,
            "add_offset": 0.5 * factor,
            "_FillValue": -32768,
        }
        if packed
        else {}
    )
    data.to_netcdf(tmp_path / "a.nc", encoding={"field" if "field" in data else "pod": how})
    made = pod_file.read_pod(tmp_path / "a.nc", per=3600.0)
    assert made.pod.dtype == np.float32
    assert made.pod.shape == (3, made.lat.size, made.lon.size)
    assert made.bearing is made.range is None
    assert made.per == 3600.0
    assert made.name == "a.nc"
    np.testing.assert_array_equal(made.times, writers.TIMES.astype("datetime64[s]"))
    for line in (made.lat, made.lon):
        np.testing.assert_allclose(np.diff(line), np.diff(line).mean(), rtol=1e-6)
        assert np.diff(line).mean() > 0
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(*writers.LON, 2000), rng.uniform(*writers.LAT, 2000)
    worst = np.abs(sampled(made, lon, lat) - pod(lon, lat)).max()
    assert worst < SCALE * writers.tolerance() + packed * step


def test_an_even_grid_is_taken_as_it_is(tmp_path: Path) -> None:
    regular().to_netcdf(tmp_path / "a.nc")
    made = pod_file.read_pod(tmp_path / "a.nc", per=np.nan)
    np.testing.assert_array_equal(made.pod, regular()["pod"].values.astype(np.float32))
    assert np.isnan(made.per)


def test_round_the_earth_the_first_column_is_repeated(tmp_path: Path) -> None:
    lon, lat = np.arange(0.0, 360.0, 5.0), np.arange(-60.0, 61.0, 4.0)
    values = 0.5 + 0.3 * np.sin(np.radians(lon + 20))[None] * np.cos(np.radians(lat))[:, None]
    xr.Dataset({"p": (("lat", "lon"), values)}, {"lat": lat, "lon": lon}).to_netcdf(
        tmp_path / "a.nc"
    )
    made = pod_file.read_pod(tmp_path / "a.nc", per=60.0)
    assert np.ptp(made.lon) == pytest.approx(2 * np.pi)
    np.testing.assert_array_equal(made.pod[..., 0], made.pod[..., -1])
    at = np.array([-177.5, 179.0, -1.0, 3.0]), np.array([1.0, -30.0, 55.0, 10.0])
    want = 0.5 + 0.3 * np.sin(np.radians(at[0] + 20)) * np.cos(np.radians(at[1]))
    np.testing.assert_allclose(sampled(made, *at)[0], want, atol=0.3 * np.radians(5.0) ** 2 / 8 * 2)


def test_across_the_antimeridian_longitudes_go_on(tmp_path: Path) -> None:
    lon, lat = np.array([178.0, 179.0, -180.0, -179.0]), np.array([10.0, 11.0, 12.0])
    values = np.arange(12).reshape(3, 4) / 20
    xr.Dataset({"p": (("lat", "lon"), values)}, {"lat": lat, "lon": lon}).to_netcdf(
        tmp_path / "a.nc"
    )
    made = pod_file.read_pod(tmp_path / "a.nc", per=60.0)
    np.testing.assert_allclose(np.degrees(made.lon), [178, 179, 180, 181])
    np.testing.assert_allclose(made.pod[0], values, atol=1e-7)


def test_outside_of_a_curved_grid_nothing_is_detected(tmp_path: Path) -> None:
    curved().to_netcdf(tmp_path / "a.nc")
    made = pod_file.read_pod(tmp_path / "a.nc", per=60.0)
    assert (made.pod[:, 0, 0] == 0).all()
    assert made.pod.max() < 0.55


def test_gaps_are_blind_where_the_user_says_so(tmp_path: Path) -> None:
    data = regular()
    data["pod"][1, 10, 20] = np.nan
    data.to_netcdf(
        tmp_path / "a.nc", encoding={"pod": {"dtype": "i2", "scale_factor": 1e-4, "_FillValue": -1}}
    )
    made = pod_file.read_pod(tmp_path / "a.nc", per=60.0, gaps="blind")
    assert np.argwhere(made.pod == 0).tolist() == [[1, 10, 20]]


BEARING, RANGE = np.arange(0.0, 360.0, 30.0), np.array([0.0, 1.0, 4.0, 10.0])
ROUND = np.clip(
    0.9 - 0.08 * RANGE[None, None] + 0.05 * np.sin(np.radians(BEARING))[None, :, None] - np.array([0, 0.03])[:, None, None],
    0.0, 1.0,
)  # fmt: skip


def polar() -> xr.Dataset:
    data = xr.Dataset(
        {"pod": (("time", "bearing", "range"), ROUND.copy())},
        {"time": writers.TIMES[:2], "bearing": BEARING, "range": RANGE},
    )
    data["bearing"].attrs["units"], data["range"].attrs["units"] = "degree", "nmi"
    return data


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d,
        lambda d: d.transpose("range", "time", "bearing"),
        lambda d: d.isel(range=[2, 0, 3, 1], bearing=np.random.default_rng(1).permutation(12)),
        lambda d: d.assign(pod=(100 * d["pod"]).assign_attrs(units="percent")),
        lambda d: xr.concat(
            [d, d.isel(bearing=[0]).assign_coords(bearing=[360.0])], "bearing"
        ).assign_coords(bearing=lambda e: e["bearing"].assign_attrs(units="degree")),
    ],
    ids=["plain", "range first", "any order", "per cent", "0 and 360"],
)
def test_bearing_and_range_in_any_order(change: Any, tmp_path: Path) -> None:
    change(polar()).to_netcdf(tmp_path / "a.nc")
    made = pod_file.read_pod(tmp_path / "a.nc", per=600.0)
    np.testing.assert_allclose(made.pod, ROUND, atol=1e-7)
    np.testing.assert_allclose(np.degrees(made.bearing), BEARING, atol=1e-12)
    np.testing.assert_allclose(made.range, RANGE * 1852.0)
    assert made.lat is made.lon is None
    assert len(made.times) == 2


def test_a_curve_of_range_alone_holds_all_round(tmp_path: Path) -> None:
    polar().isel(time=0, bearing=0, drop=True).to_netcdf(tmp_path / "a.nc")
    made = pod_file.read_pod(tmp_path / "a.nc", per=600.0)
    assert made.pod.shape == (1, 1, 4)
    assert made.times.size == 0


def at(data: xr.Dataset, value: float, *index: int) -> xr.Dataset:
    data["pod"][index] = value
    return data


BAD: dict[str, tuple[Callable[[], xr.Dataset], dict[str, Any], str]] = {
    "gap": (
        lambda: at(regular(), np.nan, 1, 10, 20), {},
        r"1 of 17,955 values are missing, first at time 2024-03-05T03:00:00Z, latitude 58.1, longitude 2.4; fill them in the "
        r'file, or set gaps = "blind"',
    ),
    "gap of a radial": (lambda: at(polar(), np.nan, 0, 3, 1), {}, "1 of 96 values are missing, first at .*bearing 90 deg, range 1852 m"),
    "gap of a mesh": (lambda: at(mesh(), np.nan, 0, 3), {}, r"first at time .*, node 3 \(counted from 0\)"),
    "per cent that says 1": (
        lambda: regular().assign(pod=lambda d: (d["pod"] * 100).assign_attrs(units="1")), {},
        'are no probability, first .*; allowed are 0 to 1: is it in per cent\\? Set its attribute units to "%"',
    ),
    "below 0": (lambda: at(regular(), -0.2, 0, 0, 0), {}, "1 of 17,955 values are no probability, first -0.2 at .*mend the file"),
    "infinite": (lambda: at(regular(), np.inf, 0, 0, 0), {"gaps": "blind"}, "1 of 17,955 values are missing"),
    "other units": (lambda: regular().assign(pod=lambda d: d["pod"].assign_attrs(units="dB")), {}, 'the POD is in "dB"; allowed are 1 and %'),
    "no circle": (lambda: polar().isel(bearing=slice(0, 7)), {}, "between the bearings 180 and 0 degrees"),
    "no unit of range": (lambda: polar().assign_coords(range=RANGE), {}, 'the ranges "range" are in no unit'),
    "no places": (
        lambda: regular().rename(lat="a", lon="b").assign_coords(a=np.arange(57.0), b=np.arange(105.0)), {},
        "no longitude and latitude for .* set coordinates = { lon = ..., lat = ... }",
    ),
    "two depths": (
        lambda: xr.concat([regular(), regular()], xr.IndexVariable("depth", [5.0, 50.0])), {},
        r'2 values of "depth" \(5, 50\); choose one with select = \{ depth',
    ),
    "axes of text": (
        lambda: projected().assign_coords(X=("X", [f"x{k}" for k in range(projected().sizes["X"])], {"units": "m"})), {},
        "no longitude and latitude for",
    ),
    "nothing in it": (lambda: regular().isel(lat=slice(0, 0)), {}, "holds no values"),
    "a line": (lambda: regular().isel(lat=[3]), {}, '"lat" has one value'),
    "times reversed": (lambda: regular().isel(time=[1, 0, 2]), {}, "times do not increase"),
    "no such variable": (regular, {"variable": "pd"}, 'no variable "pd" .the nearest name is "pod"'),
    "per": (regular, {"per": 0.0}, "per = 0 s; it is a time above 0"),
    "gaps": (regular, {"gaps": "ignore"}, 'gaps = "ignore"; allowed are "refuse" and "blind"'),
    "nothing": (lambda: xr.Dataset({"x": ("x", [1.0, 2.0])}), {}, "no POD over longitude and latitude, or bearing and range"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_pod_is_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    made, keys, said = BAD[kind]
    made().to_netcdf(tmp_path / "a.nc")
    with pytest.raises(UserError, match=f"^lookout: .*{said}") as caught:
        pod_file.read_pod(tmp_path / "a.nc", **{"per": 60.0, "name": "lookout", **keys})
    assert len(caught.value.lines) == 1
    assert "variables." not in str(caught.value)


def test_a_chosen_dimension_is_read(tmp_path: Path) -> None:
    low = regular().assign(pod=lambda d: d["pod"] / 2)
    xr.concat([low, regular()], xr.IndexVariable("season", ["summer", "winter"])).to_netcdf(
        tmp_path / "a.nc"
    )
    made = pod_file.read_pod(tmp_path / "a.nc", per=60.0, select={"season": "winter"})
    np.testing.assert_allclose(made.pod, regular()["pod"].values, atol=1e-7)
