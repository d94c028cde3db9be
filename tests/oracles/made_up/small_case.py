"""A small case and a small field of currents for it, to be damaged by tests."""

import numpy as np
import xarray as xr

CASE = """
title = "trial"
start = "2026-11-21T00:00Z"
duration = "6 h"
particles = 500
coast.source = "none"
[[current]]
name = "sea"
files = "current.nc"
[[wind]]
name = "air"
constant = { speed = "10 kn", from = 270 }
[[scenario]]
name = "boat"
object = "PIW-1"
position = { at = "27 30N 088 00W", std = "1 nmi" }
"""
STEADY = CASE.replace('files = "current.nc"', 'constant = { speed = "0.5 kn", toward = 90 }')


def field(
    names: tuple[str, str] = ("uo", "vo"),
    standard: tuple[str, str] = ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
    hours: np.ndarray | None = None,
    west: float = -90.0,
) -> xr.Dataset:
    """A current 5 x 4 degrees wide, hourly for nine hours from three before the start."""
    times = np.datetime64("2026-11-20T21:00", "ns") + (
        np.arange(13) if hours is None else hours
    ) * np.timedelta64(1, "h")
    lon, lat = west + np.arange(21) * 0.25, 25.5 + np.arange(17) * 0.25
    values = np.full((times.size, lat.size, lon.size), 0.3, np.float32)
    attributes = [{"standard_name": name, "units": "m s-1"} for name in standard]
    return xr.Dataset(
        {
            name: (("time", "lat", "lon"), values, a)
            for name, a in zip(names, attributes, strict=True)
        },
        {
            "time": times,
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    )
