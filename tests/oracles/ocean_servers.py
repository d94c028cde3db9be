"""An ocean on servers of this machine, and orders for parts of it."""

from pathlib import Path

import hostile
import numpy as np
from hostile import Variable

import drift
from drift.apps.fetch.fetching import Fetched

BEGIN, END = "2024-03-01T02:30Z", "2024-03-03T10:00Z"
TABLE = """
[trial]
title = "trial"
quantity = "current"
protocol = "{protocol}"
address = "{address}"
dataset = "sea"
variables = ["u", "v"]
license = "free"
"""


def ocean(lon: np.ndarray, lat: np.ndarray, hours: int = 72) -> dict[str, Variable]:
    """Return a current, packed in 16 bits and in floats, each value another one."""
    rng = np.random.default_rng(7)
    shape = (hours, lat.size, lon.size)
    packed = rng.integers(-900, 900, shape).astype(np.int16)
    packed[:, 1, 2] = -32767
    u = {
        "units": "m s-1",
        "standard_name": "eastward_sea_water_velocity",
        "scale_factor": np.float32(0.001),
        "_FillValue": np.int16(-32767),
    }
    return {
        "time": Variable(
            ("time",), np.arange(hours) * 1.0, {"units": "hours since 2024-03-01 00:00:00"}
        ),
        "lat": Variable(
            ("lat",),
            lat.astype(np.float64),
            {"units": "degrees_north", "standard_name": "latitude"},
        ),
        "lon": Variable(
            ("lon",),
            lon.astype(np.float64),
            {"units": "degrees_east", "standard_name": "longitude"},
        ),
        "u": Variable(("time", "lat", "lon"), packed, u),
        "v": Variable(
            ("time", "lat", "lon"),
            rng.uniform(-0.9, 0.9, shape).astype(np.float32),
            {"units": "m s-1", "standard_name": "northward_sea_water_velocity"},
        ),
    }


# longitudes and latitudes as servers have them, and boxes with the longitudes of their nodes, west
# to east
AXES = {
    "plain": (np.arange(-30, 31, 1.5), np.arange(30, 50.1, 0.5), (-5, 35, 5, 40)),
    "0..360, descending": (np.arange(0, 360, 2.0), np.arange(80, -80.1, -2.0), (-9, 35, 11, 48)),
    "-180..180, across 180": (
        np.arange(-180, 180, 2.0),
        np.arange(-80, 80.1, 2.0),
        (171, -45, 190, -31),
    ),
    "0..360, across 180": (
        np.arange(0, 360, 2.0),
        np.arange(80, -80.1, -2.0),
        (171, -45, -170, -31),
    ),
    "74..434": (np.arange(74, 434, 2.0), np.arange(-80, 80.1, 2.0), (70, -10, 80, 5)),
    "whole": (np.arange(0, 360, 10.0), np.arange(-80, 80.1, 10.0), (-180, -70, 180, 70)),
}


def written(folder: Path, address: str, protocol: str = "opendap") -> Path:
    path = folder / "own.toml"
    path.write_text(TABLE.format(address=address, protocol=protocol), encoding="utf-8")
    return path


def fetched(folder: Path, address: str, box: tuple[float, ...], **more: object) -> Fetched:
    how = {
        "begin": BEGIN,
        "end": END,
        "providers": ["trial"],
        "out": folder / "out",
        "timeout": 5.0,
        **more,
    }
    protocol = str(how.pop("protocol", "opendap"))
    return drift.fetch(box=box, catalogue=written(folder, address, protocol), **how)


def by_component(served: list[dict[str, Variable]]) -> hostile.Answer:
    """Serve several datasets, each under its number."""
    return lambda connection, target: connection.sendall(
        hostile.good(served[int(target[1])], target[2:])
    )
