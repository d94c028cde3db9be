"""Messages of GRIB on every grid, in closed form."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gribs
import numpy as np
import pytest
import writers
from pyproj import Geod

from geo.errors import UserError
from geo.forcing import sources

SPHERE = Geod(a=6371229.0, b=6371229.0)
BOTH = ("10u", "10v")
CELL = 0.1  # [deg of latitude] of every grid here, 11 km
LAMBERT = {
    "gridType": "lambert", "Nx": 36, "Ny": 25, "Latin1InDegrees": 50.0, "Latin2InDegrees": 62.0, "LoVInDegrees": 20.0,
    "LaDInDegrees": 56.0, "latitudeOfFirstGridPointInDegrees": 57.8, "longitudeOfFirstGridPointInDegrees": 1.5,
    "DxInMetres": 9000, "DyInMetres": 11000,
}  # fmt: skip
STEREOGRAPHIC = {
    "gridType": "polar_stereographic", "Nx": 36, "Ny": 25, "orientationOfTheGridInDegrees": 58.0, "LaDInDegrees": 60.0,
    "latitudeOfFirstGridPointInDegrees": 58.9, "longitudeOfFirstGridPointInDegrees": 0.3, "DxInMetres": 9000,
    "DyInMetres": 11000,
}  # fmt: skip
ROTATED = {
    "gridType": "rotated_ll", "Ni": 36, "Nj": 25, "latitudeOfSouthernPoleInDegrees": -34.0,
    "longitudeOfSouthernPoleInDegrees": -20.0, "angleOfRotationInDegrees": 0.0,
    "latitudeOfFirstGridPointInDegrees": 4.0, "longitudeOfFirstGridPointInDegrees": 11.5,
    "latitudeOfLastGridPointInDegrees": 6.4, "longitudeOfLastGridPointInDegrees": 15.0,
    "iDirectionIncrementInDegrees": 0.1, "jDirectionIncrementInDegrees": 0.1,
}  # fmt: skip
REGULAR = {
    "gridType": "regular_ll", "Ni": 36, "Nj": 25, "latitudeOfFirstGridPointInDegrees": 57.6,
    "longitudeOfFirstGridPointInDegrees": 2.2, "latitudeOfLastGridPointInDegrees": 60.0,
    "longitudeOfLastGridPointInDegrees": 5.7, "iDirectionIncrementInDegrees": 0.1, "jDirectionIncrementInDegrees": 0.1,
}  # fmt: skip
MERCATOR = {
    "gridType": "mercator", "Ni": 36, "Nj": 25, "latitudeOfFirstGridPointInDegrees": 57.6,
    "longitudeOfFirstGridPointInDegrees": 2.2, "latitudeOfLastGridPointInDegrees": 60.12,
    "longitudeOfLastGridPointInDegrees": 5.7, "LaDInDegrees": 58.0, "DiInMetres": 5900, "DjInMetres": 5900,
}  # fmt: skip
GRIDS = {
    "lambert": LAMBERT,
    "stereographic": STEREOGRAPHIC,
    "rotated": ROTATED,
    "regular": REGULAR,
    "mercator": MERCATOR,
}


def settings(
    keys: dict[str, Any], edition: int, hour: float, along: bool, name: str, more: dict[str, Any]
) -> dict[str, Any]:
    """All keys of a message in an order in which eccodes takes them."""
    flags = {
        "iScansNegatively": 0,
        "jScansPositively": 1,
        "jPointsAreConsecutive": 0,
        "resolutionAndComponentFlags": 8 * along,
    }
    own = (
        keys
        | {k: keys.get(k, v) for k, v in flags.items()}
        | {"dataDate": 20240305, "dataTime": 100 * int(hour)}
    )
    if edition == 1:
        lacking = {"angleOfRotationInDegrees"} | (
            {"LaDInDegrees"} if keys["gridType"] != "mercator" else set()
        )
        own = {k: v for k, v in own.items() if k not in lacking} | {
            "indicatorOfTypeOfLevel": 1,
            "level": 0,
        }
    return own | ({"shortName": name} if name else {}) | more


def message(
    name: str,
    keys: dict[str, Any],
    values: Any = None,
    edition: int = 2,
    hour: float = 0.0,
    along: bool = False,
    **more: Any,
) -> bytes:
    """One field. values: of its points, in the file's order; None: the field of the writers, of the
    side of `name`.

    along: components count along the grid, whose x axis is taken from differences of eccodes' own
    points.
    """
    sample, all_keys = f"GRIB{edition}", settings(keys, edition, hour, along, name, more)
    if values is None:
        lon, lat = gribs.points(sample, all_keys)
        u, v = writers.field((lon + 180.0) % 360.0 - 180.0, lat, hour)
        if along:
            angle = np.radians(direction(lon.reshape(25, 36), lat.reshape(25, 36))).ravel()
            u, v = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
        values = (
            v if name in ("10v", "v", "ocv", "vst") or more.get("parameterNumber") in (3, 22) else u
        )
    return gribs.pack(sample, all_keys, values)


def direction(lon: Any, lat: Any) -> Any:
    """Direction of the grid's x axis [deg from east] at points (ny, nx): bearings to the neighbours
    on both sides.
    """
    ahead = 90.0 - SPHERE.inv(lon[:, :-1], lat[:, :-1], lon[:, 1:], lat[:, 1:])[0]
    back = 270.0 - SPHERE.inv(lon[:, 1:], lat[:, 1:], lon[:, :-1], lat[:, :-1])[0]
    at_start, at_end = ahead[:, :1], back[:, -1:]
    turn = (back[:, :-1] - ahead[:, 1:] + 180.0) % 360.0 - 180.0
    # at the ends the change of direction along half a cell is carried on
    return np.concatenate(
        (at_start - turn[:, :1] / 2, ahead[:, 1:] + turn / 2, at_end + turn[:, -1:] / 2), axis=1
    )


def written(path: Path, parts: Sequence[bytes]) -> Path:
    path.write_bytes(b"".join(parts))
    return path


def pair(keys: dict[str, Any], **options: Any) -> list[bytes]:
    return [message(name, keys, **options) for name in BOTH]


def worst(source: sources.Source, k: int = 0, hour: float = 0.0) -> tuple[float, float]:
    """The greatest error [m/s] of slice k against the field that was written, and the share of
    nodes present.
    """
    lon, lat = np.meshgrid(source.grid.lon, source.grid.lat)
    got = source.read(k).astype(float)
    u, v = writers.field((lon + 180.0) % 360.0 - 180.0, lat, hour)
    return float(np.nanmax(np.hypot(got[..., 0] - u, got[..., 1] - v))), float(
        np.isfinite(got[..., 0]).mean()
    )


def refusal(quantity: str, path: Any, **options: Any) -> str:
    with pytest.raises(UserError) as caught:
        sources.open_source(quantity, path, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)
