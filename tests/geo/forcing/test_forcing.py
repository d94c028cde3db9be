"""Readers of real files against netCDF4 and pyproj, the odd ways of files, and what is refused and
how.
"""

import shutil
import threading
import warnings
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pyproj
import pytest
import writers
import xarray as xr

from geo.box import Box
from geo.errors import UserError
from geo.forcing import describe
from geo.forcing import sources as forcing
from geo.grids.fill import fill
from geo.grids.grid import Grid, sample, share_covered

Z = "datetime64[s]"


def raw(path: Path, name: str) -> Any:
    """A variable's values as netCDF4 itself masks and scales them."""
    with netCDF4.Dataset(path) as data:
        return np.ma.filled(np.ma.asarray(data[name][:], float), np.nan)


def stamps(path: Path, name: str = "time") -> Any:
    with netCDF4.Dataset(path) as data:
        times = data[name]
        dates = netCDF4.num2date(times[:], times.units, getattr(times, "calendar", "standard"))
    return np.array([np.datetime64(d.isoformat()) for d in np.ravel(dates)]).astype(Z)


def turned(crs: str, x: float, y: float, u: float, v: float) -> tuple[float, float, float, float]:
    """(lon, lat, east, north) of a vector along a projection's axes, by PROJ's own convergence."""
    proj = pyproj.Proj(crs)
    lon, lat = proj(x, y, inverse=True)
    angle = -np.radians(proj.get_factors(lon, lat).meridian_convergence)
    return lon, lat, u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)


# --- every real file -------------------------------------------------------------------------------------------

PROJECTED = {
    "current": ("norkyst800_subset_16Nov2015.nc", "u", "v", "X", "Y", "projection_stere"),
    "wind": (
        "arome_subset_16Nov2015.nc",
        "x_wind_10m",
        "y_wind_10m",
        "x",
        "y",
        "projection_lambert",
    ),
}


@pytest.mark.parametrize("quantity", PROJECTED)
def test_norkyst_is_true_east_and_north(quantity: str, data: Path) -> None:
    name, east, north, x_name, y_name, mapping = PROJECTED[quantity]
    path = data / "norkyst" / name
    source = forcing.open_source(quantity, path)
    assert (source.times == stamps(path)).all()
    assert len(source.times) == 67
    with netCDF4.Dataset(path) as file:
        crs = file[mapping].proj4
    u, v = (raw(path, n).squeeze() for n in (east, north))
    x, y = raw(path, x_name), raw(path, y_name)
    rng = np.random.default_rng(5)
    k = 31
    values = source.read(k)
    wet = np.argwhere(np.isfinite(u[k]) & np.isfinite(v[k]))
    wet = wet[(wet > 3).all(1) & (wet < np.array(u.shape[1:]) - 4).all(1)]
    error, speed = [], []
    for j, i in wet[rng.choice(len(wet), 400, replace=False)]:
        lon, lat, e, n = turned(crs, x[i], y[j], u[k, j, i], v[k, j, i])
        got = sample(source.grid, values, [lon], [lat])[0]
        if np.isfinite(got).all():
            error.append(np.hypot(*(got - (e, n))))
            speed.append(np.hypot(e, n))
    assert len(error) > 330
    # bilinear twice at the points, where it is worst: 3 to 4 % measured; a degree of rotation would
    # be 1.7 % more
    assert np.sqrt(np.mean(np.square(error)) / np.mean(np.square(speed))) < 0.06
    got_angle = np.median(error) / np.median(speed)
    assert got_angle < 0.03


def test_norkyst_cost_is_what_the_design_says(data: Path) -> None:
    """0.7 % of the rms speed a component is 1.0 % for both together; 3.2 % of the wet points lost."""
    source = forcing.open_source("current", data / "norkyst" / PROJECTED["current"][0])
    note = next(n for n in source.notes if "cost" in n)
    between, lost = (
        float(note.split("rms error ")[1].split("%")[0]),
        float(note.split("them, ")[1].split("%")[0]),
    )
    assert between <= 1.1
    assert lost <= 3.3


def test_arome_axes_agree_with_its_own_longitudes(data: Path) -> None:
    """Rotating wins over the long_name's "Zonal": without it this point is 8 degrees off."""
    path = data / "norkyst" / PROJECTED["wind"][0]
    source = forcing.open_source("wind", path, box=Box(4.0, 60.0, 5.0, 61.0))
    lon, lat = raw(path, "longitude"), raw(path, "latitude")
    j, i = 75, 40
    east = np.array(
        [
            (lon[j, i + 1] - lon[j, i - 1]) * np.cos(np.radians(lat[j, i])),
            lat[j, i + 1] - lat[j, i - 1],
        ]
    )
    north = np.array(
        [
            (lon[j + 1, i] - lon[j - 1, i]) * np.cos(np.radians(lat[j, i])),
            lat[j + 1, i] - lat[j - 1, i],
        ]
    )
    u, v = raw(path, "x_wind_10m"), raw(path, "y_wind_10m")
    total = []
    for k in range(0, 67, 6):
        wanted = u[k, j, i] * east / np.hypot(*east) + v[k, j, i] * north / np.hypot(*north)
        got = sample(source.grid, source.read(k), [lon[j, i]], [lat[j, i]])[0]
        cross = np.degrees(np.arctan2(got[1], got[0]) - np.arctan2(wanted[1], wanted[0]))
        total.append((cross + 180) % 360 - 180)
    assert np.abs(np.mean(total)) < 1.0


REGULAR: dict[str, tuple[str, str, str, str, str, str, Any]] = {
    "hycom": ("current", "washington/gridded_current.nc", "water_u", "water_v", "lon", "lat", ()),
    "gfs": ("wind", "washington/gridded_wind.nc", "air_u", "air_v", "lon", "lat", ()),
    "rtofs": ("current", "washington/wa_RTOFS_global.nc", "water_u", "water_v", "lon", "lat", ()),
    "era5": ("wind", "florida/era5_moda_2000.nc", "u10", "v10", "longitude", "latitude", ()),
    "mercator": (
        "current",
        "paria/Sea_Med_slice_20170424_Paria.nc",
        "uo",
        "vo",
        "lon",
        "lat",
        (0,),
    ),
    "ecmwf": ("wind", "paria/Wind_Med_slice_24_Paria.nc", "U10M", "V10M", "lon", "lat", ()),
}


@pytest.mark.parametrize("key", REGULAR)
def test_regular_files_are_taken_as_they_are(key: str, data: Path) -> None:
    quantity, name, east, north, lon_name, lat_name, level = REGULAR[key]
    path = data / name
    source = forcing.open_source(quantity, path, lenient=True)
    u, v = raw(path, east), raw(path, north)
    lon, lat = raw(path, lon_name), raw(path, lat_name)
    assert (source.times == stamps(path)).all()
    k = len(source.times) // 2
    values = source.read(k)
    for j in range(0, len(lat), 3):
        for i in range(0, len(lon), 5):
            row = round((lat[j] - source.grid.lat0) / source.grid.dlat)
            column = round(((lon[i] - source.grid.lon0) % 360) / source.grid.dlon)
            np.testing.assert_allclose(
                values[row, column], (u[(k, *level, j, i)], v[(k, *level, j, i)]), atol=1e-5
            )
            assert abs(source.grid.lat[row] - lat[j]) < 1e-4
    assert source.missing == pytest.approx(np.isnan(u[(0, *level)]).mean(), abs=1e-9)


def test_paria_joins_daily_files(data: Path) -> None:
    current = forcing.open_source("current", str(data / "paria" / "Sea_*.nc"))
    wind = forcing.open_source("wind", [str(data / "paria" / "Wind_*.nc")])
    assert (np.diff(current.times) == np.timedelta64(24, "h")).all()
    assert (current.times[0], len(current.times)) == (np.datetime64("2017-04-22T12:00:00"), 8)
    assert (wind.times[0], len(wind.times)) == (np.datetime64("2017-04-23T00:00:00"), 28)
    last = raw(data / "paria" / "Sea_Med_slice_20170429_Paria.nc", "uo")
    np.testing.assert_allclose(current.read(7)[20, 30, 0], last[0, 0, 20, 30], atol=1e-6)


def test_biscay_components_stand_at_their_own_points(data: Path) -> None:
    """The u file's points lie 0.0125 degrees west of the layer file's, the v file's half a native
    cell south.
    """
    u_path, v_path = data / "biscay" / "hycom.gdp.u.nc", data / "biscay" / "hycom.gdp.v.nc"
    source = forcing.open_source("current", [u_path, v_path])
    assert any("staggered" in note for note in source.notes)
    u, v = raw(u_path, "u")[20, 0], raw(v_path, "v")[20, 0]
    values = source.read(20)
    lon, lat = raw(u_path, "lon"), raw(u_path, "lat")
    inner = np.s_[2:-2, 2:-2]
    got = sample(source.grid, values, lon[inner].ravel(), lat[inner].ravel())[:, 0]
    assert np.sqrt(np.nanmean((got - u[inner].ravel()) ** 2)) < 0.05 * np.sqrt(np.mean(u**2))
    lon, lat = raw(v_path, "lon"), raw(v_path, "lat")
    got = sample(source.grid, values, lon[inner].ravel(), lat[inner].ravel())[:, 1]
    assert np.sqrt(np.nanmean((got - v[inner].ravel()) ** 2)) < 0.05 * np.sqrt(np.mean(v**2))
    assert (source.times[0], source.times[-1]) == (
        np.datetime64("2021-03-01"),
        np.datetime64("2021-03-25T12"),
    )
    deeper = forcing.open_source("current", [u_path, v_path], variables={"lev": "3"})
    got = sample(deeper.grid, deeper.read(20), [-2.8], [44.95])[0, 0]
    assert abs(got - sample(source.grid, values, [-2.8], [44.95])[0, 0]) > 1e-4


def test_florida_climatology_must_be_said_to_be_one(data: Path) -> None:
    paths = [data / "florida" / f"hycom_GLBv0.08_53X_archMN.1994_01_2015_12_{c}.nc4" for c in "uv"]
    with pytest.raises(UserError, match=r"one time only.*steady = true"):
        forcing.open_source("current", paths)
    source = forcing.open_source("current", paths, steady=True, box=Box(-84.0, 23.0, -79.0, 27.0))
    assert len(source.times) == 0
    u, v = raw(paths[0], "water_u")[0, 0], raw(paths[1], "water_v")[0, 0]
    lat, lon = raw(paths[0], "lat"), raw(paths[0], "lon")
    # the Florida Current
    j, i = int(np.argmin(np.abs(lat - 25.5))), int(np.argmin(np.abs(lon - 280.3)))
    got = sample(source.grid, source.read(0), [lon[i]], [lat[j]])[0]
    np.testing.assert_allclose(got, (u[j, i], v[j, i]), atol=2e-3)
    assert got[1] > 1.0
    deep = forcing.open_source("current", paths, steady=True, depth=200.0)
    assert any("200 m of 40" in note for note in deep.notes)
    with pytest.raises(UserError, match="northward one is missing"):
        forcing.open_source("current", paths[:1], steady=True)


def test_crop_reads_what_the_whole_holds(data: Path) -> None:
    path = data / "washington" / "gridded_current.nc"
    whole = forcing.open_source("current", path)
    part = forcing.open_source("current", path, box=Box(-125.0, 47.6, -124.5, 48.2))
    assert part.grid.nlon < whole.grid.nlon
    i, j = (
        round((part.grid.lon0 - whole.grid.lon0) / 0.08),
        round((part.grid.lat0 - whole.grid.lat0) / 0.04),
    )
    rows, columns = slice(j, j + part.grid.nlat), slice(i, i + part.grid.nlon)
    np.testing.assert_array_equal(part.read(5), whole.read(5)[rows, columns])
    assert part.grid.lon[2] == pytest.approx(-125.04, abs=1e-3) or part.grid.lon[1] <= -125.0


def test_threads_read_the_same(data: Path) -> None:
    source = forcing.open_source(
        "current", data / "norkyst" / PROJECTED["current"][0], box=Box(3.5, 60.0, 4.5, 61.0)
    )
    alone = [source.read(k) for k in range(6)]
    together: dict[int, Any] = {}
    threads = [
        threading.Thread(target=lambda k=k: together.update({k: source.read(k)})) for k in range(6)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k in range(6):
        np.testing.assert_array_equal(alone[k], together[k])


# --- longitudes, seams, poles ----------------------------------------------------------------------------------


def written(path: Path, lon: Any, lat: Any, u: Any, v: Any, **more: Any) -> Path:
    """A steady current on axes, values over (lat, lon)."""
    dims = ("lat", "lon")
    attributes = more.pop("attributes", {})
    xr.Dataset(
        {"uo": (dims, u, writers.EAST | attributes), "vo": (dims, v, writers.NORTH | attributes)},
        {"lon": lon, "lat": lat},
    ).to_netcdf(path)
    return path


def ramp(lon: Any, lat: Any) -> tuple[Any, Any]:
    x, y = np.meshgrid(lon, lat)
    return np.sin(np.radians(x)) + 0.01 * y, np.cos(np.radians(2 * x)) - 0.02 * y


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


# --- fill values, units, levels, extra dimensions -----------------------------------------------------------------

AXES = (np.arange(0.0, 2.01, 0.25), np.arange(50.0, 51.6, 0.25))


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


# --- times -----------------------------------------------------------------------------------------------------


def timed(
    path: Path,
    values: Any,
    units: str = "hours since 2024-03-05",
    calendar: str = "standard",
    **more: Any,
) -> Path:
    """A current with a time axis stored just so; u is the number of the slice."""
    u, v = ramp(*AXES)
    n = len(values)
    dims = ("time", "lat", "lon")
    xr.Dataset(
        {
            "uo": (
                dims,
                u + np.arange(n)[:, None, None] * 0.1 + more.get("plus", 0.0),
                writers.EAST,
            ),
            "vo": (dims, v + np.zeros((n, 1, 1)), writers.NORTH),
        },
        {
            "time": ("time", values, {"units": units, "calendar": calendar}),
            "lat": AXES[1],
            "lon": AXES[0],
        },
    ).to_netcdf(path)
    return path


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


# --- what is refused, in one line with the key ------------------------------------------------------------------


def refused(quantity: str, path: Any, *words: str, **options: Any) -> None:
    with pytest.raises(UserError) as caught:
        forcing.open_source(quantity, path, **options)
    told = str(caught.value)
    assert "\n" not in told
    for word in words:
        assert word in told, told


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


# --- Zarr, fill, uniform and built-in sources, overlap, description ------------------------------------------------


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
