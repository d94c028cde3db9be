"""One field in closed form, written on the regular and projected grids that oceanographers store
currents on.

The writers know nothing of `geo`: directions come from pyproj, by projecting a small step to true
north.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import xarray as xr
from numpy.typing import ArrayLike

from geo.array import Array

TIMES = np.array(["2024-03-05T00", "2024-03-05T03", "2024-03-05T06"], "datetime64[ns]")
LON, LAT = (2.0, 6.0), (58.0, 60.0)  # [deg] every grid covers this
CELL = 0.05  # [deg of latitude] of every grid
KX, KY = 1.7, 2.3  # [rad/deg]


def field(lon: ArrayLike, lat: ArrayLike, hour: float) -> tuple[Array, Array]:
    """True east and north [m/s]: east and north differ, and neither is symmetric in anything."""
    x, y = np.asarray(lon) - 4.0, np.asarray(lat) - 59.0
    u = 0.6 + 0.4 * np.sin(KX * x + 0.3) * np.cos(KY * y) + 0.02 * hour
    return u, -0.25 + 0.5 * np.cos(KX * x - KY * y + 1.1) - 0.01 * hour


def tolerance(cell: float = CELL) -> float:
    """The largest error of bilinear interpolation at `cell` and then at half of it: h^2 / 8 |f''|
    each.
    """
    across = cell / np.cos(np.radians(LAT[1]))  # [deg of longitude] of a square cell
    return 0.5 * ((KX * across) ** 2 + (KY * cell) ** 2) / 8 * 1.25 * 2  # 2: cells lie askew


def slices(lon: Array, lat: Array) -> tuple[Array, Array]:
    """The field at all times, shape (3, ...)."""
    pairs = [field(lon, lat, 3.0 * k) for k in range(len(TIMES))]
    return np.stack([p[0] for p in pairs]), np.stack([p[1] for p in pairs])


def in_plane(to: pyproj.Proj, lon: Array, lat: Array, u: Array, v: Array) -> tuple[Array, Array]:
    """Components along the axes of a conformal projection's plane of true (u, v)."""
    x0, y0 = to(lon, lat)
    x1, y1 = to(lon, lat + 1e-5)
    # of true north from the plane's y axis, counterclockwise
    angle = np.arctan2(y1 - y0, x1 - x0) - np.pi / 2
    return u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)


def save(data: xr.Dataset, path: Path, **encoding: Any) -> Path:
    """Write with times in hours, as most files have them."""
    data.to_netcdf(path, encoding=encoding)
    return path


EAST = {"standard_name": "eastward_sea_water_velocity", "units": "m s-1"}
NORTH = {"standard_name": "northward_sea_water_velocity", "units": "m s-1"}
ALONG_X = {"standard_name": "x_sea_water_velocity", "units": "m s-1"}
ALONG_Y = {"standard_name": "y_sea_water_velocity", "units": "m s-1"}


def regular(path: Path) -> Path:
    lon, lat = (
        np.arange(LON[0] - 0.5, LON[1] + 0.5, 2 * CELL),
        np.arange(LAT[0] - 0.5, LAT[1] + 0.5, CELL),
    )
    u, v = slices(*np.meshgrid(lon, lat))
    dims = ("time", "lat", "lon")
    return save(
        xr.Dataset(
            {"uo": (dims, u, EAST), "vo": (dims, v, NORTH)}, {"time": TIMES, "lat": lat, "lon": lon}
        ),
        path,
    )


def east_of_zero(path: Path) -> Path:
    """Longitudes 0..360 over Greenwich's far side are tested elsewhere; here descending latitudes,
    (lon, lat) order.
    """
    lon, lat = (
        np.arange(LON[0] - 0.5, LON[1] + 0.5, 2 * CELL) + 360.0,
        np.arange(LAT[1] + 0.5, LAT[0] - 0.5, -CELL),
    )
    u, v = slices(*np.meshgrid(lon - 360.0, lat))
    dims = ("time", "longitude", "latitude")
    return save(
        xr.Dataset(
            {"uo": (dims, u.swapaxes(1, 2), EAST), "vo": (dims, v.swapaxes(1, 2), NORTH)},
            {"time": TIMES, "latitude": lat, "longitude": lon},
        ),
        path,
    )


def packed(path: Path) -> Path:
    """16-bit integers in cm/s with a scale, an offset and a fill value."""
    lon, lat = (
        np.arange(LON[0] - 0.5, LON[1] + 0.5, 2 * CELL),
        np.arange(LAT[0] - 0.5, LAT[1] + 0.5, CELL),
    )
    u, v = slices(*np.meshgrid(lon, lat))
    dims = ("time", "lat", "lon")
    data = xr.Dataset(
        {
            "u": (dims, 100 * u, EAST | {"units": "cm/s"}),
            "v": (dims, 100 * v, NORTH | {"units": "cm/s"}),
        },
        {"time": TIMES, "lat": lat, "lon": lon},
    )
    how = {"dtype": "int16", "scale_factor": 0.01, "add_offset": 12.5, "_FillValue": -32767}
    return save(data, path, u=how, v=how)


STEREO = "+proj=stere +lat_0=90 +lon_0=70 +lat_ts=60 +units=m +a=6.371e+06 +e=0 +no_defs"


def projected(path: Path) -> Path:
    """A polar stereographic plane without longitudes and latitudes, components along its axes, y
    descending.
    """
    to = pyproj.Proj(STEREO)
    x, y = (
        np.asarray(v) for v in to(*np.meshgrid(np.linspace(1, 7, 30), np.linspace(57.5, 60.5, 30)))
    )
    step = CELL * 111_195.0
    px, py = np.arange(x.min(), x.max(), step), np.arange(y.max(), y.min(), -step)
    lon, lat = to(*np.meshgrid(px, py), inverse=True)
    u, v = slices(lon, lat)
    a, b = in_plane(to, lon, lat, u, v)
    mapping = {
        "grid_mapping_name": "polar_stereographic", "straight_vertical_longitude_from_pole": 70.0,
        "latitude_of_projection_origin": 90.0, "standard_parallel": 60.0, "earth_radius": 6.371e6, "proj4": STEREO,
    }  # fmt: skip
    dims, extra = ("time", "depth", "Y", "X"), {"grid_mapping": "crs"}
    return save(
        xr.Dataset(
            {
                "u": (dims, a[:, None], ALONG_X | extra),
                "v": (dims, b[:, None], ALONG_Y | extra),
                "crs": ((), 0, mapping),
            },
            {
                "time": TIMES,
                "depth": ("depth", [0.0], {"units": "m", "positive": "down"}),
                "Y": ("Y", py, {"units": "m", "standard_name": "projection_y_coordinate"}),
                "X": ("X", px, {"units": "m", "standard_name": "projection_x_coordinate"}),
            },
        ),
        path,
    )
