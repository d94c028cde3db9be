"""A vector field in closed form, linear in time, longitude and latitude: any right reader gives it
back without error.

Bilinear interpolation, linear interpolation in triangles and linear interpolation in time are exact
for it.
"""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from geo.array import Array
from geo.forcing.sources import Source
from geo.grids.grid import sample

UNITS = "hours since 2024-03-10 00:00:00"
LON, LAT = np.arange(-34.0, -25.9, 0.5), np.arange(37.0, 43.01, 0.25)
CURRENT = (("uo", "eastward_sea_water_velocity"), ("vo", "northward_sea_water_velocity"))
WIND = (("u10", "eastward_wind"), ("v10", "northward_wind"))


def field(lon: ArrayLike, lat: ArrayLike, hour: ArrayLike) -> tuple[Array, Array]:
    """Return true east and north [m/s] at places [deg] and times [h]."""
    x, y, t = np.asarray(lon) + 30.0, np.asarray(lat) - 40.0, np.asarray(hour)
    return 0.3 + 0.01 * t + 0.03 * x + 0.05 * y, 0.2 - 0.008 * t - 0.04 * x + 0.02 * y


def values(hours: ArrayLike, lon: ArrayLike = LON, lat: ArrayLike = LAT) -> tuple[Array, Array]:
    """Return the field on axes, shape (hours, lat, lon)."""
    return field(np.asarray(lon), np.asarray(lat)[:, None], np.asarray(hours, float)[:, None, None])


def dataset(
    hours: Any, lon: Any = LON, lat: Any = LAT, names: Any = CURRENT, **attributes: Any
) -> xr.Dataset:
    """Return the field as a file holds it, with its times in hours."""
    pair = values(hours, lon, lat)
    said = {"units": "m s-1"} | attributes
    dims = ("time", "lat", "lon")
    return xr.Dataset(
        {
            name: (dims, w, {"standard_name": kind} | said)
            for (name, kind), w in zip(names, pair, strict=True)
        },
        {
            "time": ("time", np.asarray(hours, float), {"units": UNITS}),
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", lon, {"units": "degrees_east"}),
        },
    )


def written(path: Path, data: xr.Dataset, **encoding: Any) -> Path:
    """Write a dataset; encoding by variable."""
    data.to_netcdf(path, encoding=encoding)
    return path


def worst(
    source: Source, lon: Any = (-30.3, -29.1, -27.77), lat: Any = (40.1, 41.33, 38.6)
) -> float:
    """Return the largest error [m/s] at places in the middle of the field, at all times;

    NaN where a value is missing.
    """
    hours = (source.times - np.datetime64("2024-03-10")) / np.timedelta64(1, "h")
    errors = []
    for k, hour in enumerate(hours):
        right = np.stack(field(lon, lat, hour), -1)
        errors.append(np.abs(sample(source.grid, source.read(k), lon, lat) - right).max())
    return float(np.max(errors))
