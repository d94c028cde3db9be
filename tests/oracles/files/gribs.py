"""GRIB messages made and read by eccodes, in a process of its own: beside pyproj in one process it
corrupts memory.

(eccodes' wheels bring a PROJ of their own; whichever library is loaded second finds the other's.)
"""

import functools
import multiprocessing
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from geo.array import Array


@functools.cache
def _process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))


def points(sample: str, settings: Mapping[str, Any]) -> tuple[Array, Array]:
    """Return eccodes' own longitudes and latitudes [deg] of the grid that a sample has with these
    settings.
    """
    return _process().submit(_points, sample, dict(settings)).result()


def pack(sample: str, settings: Mapping[str, Any], values: Array) -> bytes:
    """Return a message with these settings and values, NaN missing."""
    return _process().submit(_pack, sample, dict(settings), np.asarray(values, float)).result()


def unpack(path: str, names: tuple[str, ...]) -> dict[str, Array]:
    """Return the values of fields by short name, and "lon", "lat" [deg] of the last one, all (ny,
    nx).
    """
    return _process().submit(_unpack, path, names).result()


def _made(sample: str, settings: dict[str, Any]) -> Any:
    import eccodes

    handle = eccodes.codes_grib_new_from_samples(sample)
    for key, value in settings.items():
        eccodes.codes_set(handle, key, value)
    return handle


def _points(sample: str, settings: dict[str, Any]) -> tuple[Array, Array]:
    import eccodes

    handle = _made(sample, settings)
    if settings:
        eccodes.codes_set_values(
            handle,
            np.zeros(
                settings["Ni" if "Ni" in settings else "Nx"]
                * settings["Nj" if "Nj" in settings else "Ny"]
            ),
        )
    lon, lat = (eccodes.codes_get_array(handle, k) for k in ("longitudes", "latitudes"))
    eccodes.codes_release(handle)
    return lon, lat


def _pack(sample: str, settings: dict[str, Any], values: Array) -> bytes:
    import eccodes

    handle = _made(sample, settings | {"bitsPerValue": 24})
    if np.isnan(values).any():
        eccodes.codes_set(handle, "bitmapPresent", 1)
        eccodes.codes_set(handle, "missingValue", 9999.0)
        values = np.where(np.isnan(values), 9999.0, values)
    if values.size:
        eccodes.codes_set_values(handle, values)
    message = bytes(eccodes.codes_get_message(handle))
    eccodes.codes_release(handle)
    return message


def _unpack(path: str, names: tuple[str, ...]) -> dict[str, Array]:
    import eccodes

    eccodes.codes_grib_multi_support_on()
    found: dict[str, Array] = {}
    with open(path, "rb") as file:
        while (handle := eccodes.codes_grib_new_from_file(file)) is not None:
            name = eccodes.codes_get(handle, "shortName")
            if name in names:
                shape = eccodes.codes_get(handle, "Ny"), eccodes.codes_get(handle, "Nx")
                found[name] = eccodes.codes_get_values(handle).reshape(shape)
                found |= {
                    k[:3]: eccodes.codes_get_array(handle, k).reshape(shape)
                    for k in ("latitudes", "longitudes")
                }
            eccodes.codes_release(handle)
    return found
