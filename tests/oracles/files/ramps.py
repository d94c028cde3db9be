"""Files of a current that rises along the axes, with any times."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import writers
import xarray as xr

from geo.errors import UserError
from geo.forcing import sources as forcing

Z = "datetime64[s]"


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


AXES = (np.arange(0.0, 2.01, 0.25), np.arange(50.0, 51.6, 0.25))


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


def refused(quantity: str, path: Any, *words: str, **options: Any) -> None:
    with pytest.raises(UserError) as caught:
        forcing.open_source(quantity, path, **options)
    told = str(caught.value)
    assert "\n" not in told
    for word in words:
        assert word in told, told
