"""Files of currents with land as zeros or fill values, to be surveyed."""

from pathlib import Path
from typing import Any

import numpy as np
import trial_case
import writers
import xarray as xr

import drift

LON, LAT = np.arange(2.0, 8.01, 0.1), np.arange(57.0, 63.01, 0.05)
HOURS = np.arange(0, 97, 6)


def swirl(lon: Any, lat: Any, hour: float) -> tuple[Any, Any]:
    """A current [m/s] that is nowhere zero for long and has no symmetry."""
    x, y = np.radians(lon * 40), np.radians(lat * 55)
    return (
        0.31 + 0.22 * np.sin(x + 0.07 * hour) * np.cos(0.7 * y),
        -0.12 + 0.27 * np.cos(1.3 * x - y + 0.05 * hour),
    )


def fields(lon: Any = LON, lat: Any = LAT, hours: Any = HOURS) -> tuple[Any, Any]:
    x, y = np.meshgrid(lon, lat)
    both = [swirl(x, y, float(h)) for h in hours]
    return np.stack([u for u, _ in both]), np.stack([v for _, v in both])


def saved(
    path: Path, u: Any, v: Any, lon: Any = LON, lat: Any = LAT, hours: Any = HOURS, **more: Any
) -> Path:
    """A file of currents over (time, lat, lon); more: encoding of both, or attributes."""
    attributes = more.pop("attributes", {})
    dims = ("time", "lat", "lon")
    data = xr.Dataset(
        {
            "uo": (dims, np.asarray(u), writers.EAST | attributes),
            "vo": (dims, np.asarray(v), writers.NORTH | attributes),
        },
        {"time": ("time", hours, {"units": "hours since 2026-03-01"}), "lon": lon, "lat": lat},
    )
    if "dtype" in more and more["dtype"].startswith("int"):
        more["_FillValue"] = np.iinfo(more["dtype"]).min
    data.to_netcdf(path, encoding={n: {"_FillValue": None} | more for n in ("uo", "vo")})
    return path


def shore(lon: Any, lat: Any) -> Any:
    """A coast aslant across the north-east of the field."""
    return 0.8 * (lon - 5.3) + (lat - 60.1) > 0.9


SMALL = {"west": 3.5, "south": 58.9, "east": 7.5, "north": 61.6}  # holds no missing value


def case(folder: Path, domain: dict[str, float], **current: Any) -> drift.Case:
    """Return a case of 40 drifters in a current over a domain."""
    return trial_case.load(
        folder,
        start="2026-03-01T00:00Z",
        duration="96 h",
        particles=40,
        max_lost=1.0,
        output={"trajectories": 40},
        clock={"step": "30 min"},
        domain=domain,
        current=current,
        scenario={"position": {"at": [4.6, 60.0], "error": "3 nmi"}},
    )
