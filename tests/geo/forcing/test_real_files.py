"""Readers of real forcing files against netCDF4 and pyproj."""

import threading
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pyproj
import pytest
from ramps import Z

from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources as forcing
from geo.grids.grid import sample


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
