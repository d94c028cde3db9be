"""Final and preliminary values of ERA5 in one file, along the dimension `expver`.

1 is final, 5 is preliminary (ERA5T). Each time has values in only one of them.
"""

import re

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo.array import Array
from geo.forcing.derived import Part, derive, values_of

NAME = "expver"


def merge_versions(data: xr.Dataset, name: str, notes: list[str]) -> xr.Variable:
    """Return a variable without the dimension `expver`: at each point the lowest version present.

    A note is appended to `notes`.
    """
    variable = data.variables[name]
    if variable.sizes.get(NAME, 1) < 2:
        return variable
    order, labels = _version_order(data, variable.sizes[NAME])
    note = f"{NAME} {' and '.join(labels[k] for k in order)} merged: each value is from the first that has it"
    if note not in notes:
        notes.append(note)

    def read(part: Part) -> Array:
        values = values_of(variable, {**part, NAME: order[0]})
        for k in order[1:]:
            lacking = np.isnan(values)
            if not lacking.any():
                break
            values[lacking] = values_of(variable, {**part, NAME: k})[lacking]
        return values

    return derive(variable, read, without=NAME)


def along(data: xr.Dataset, dim: str | None) -> NDArray[np.int64] | None:
    """Return the version at each time, "0001" or "0005" in files of the new format.

    None if the file has none.
    """
    if NAME not in data.variables or dim is None or data.variables[NAME].dims != (dim,):
        return None
    return np.array(
        [_version_number(_text(value)) for value in data.variables[NAME].values.tolist()], np.int64
    )


def _text(value: object) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _version_number(text: str) -> int:
    hit = re.search(r"\d+", text)
    return int(hit[0]) if hit else 10**6


def _version_order(data: xr.Dataset, count: int) -> tuple[list[int], list[str]]:
    """Return the indices of versions, final ones first, and their labels."""
    if NAME not in data.variables or data.variables[NAME].dims != (NAME,):
        return list(range(count)), [str(k) for k in range(count)]
    labels = [_text(value) for value in data.variables[NAME].values.tolist()]
    return sorted(range(count), key=lambda k: _version_number(labels[k])), labels
