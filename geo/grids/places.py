"""Positions of a moving grid: files that give its coordinates for every time, or one file for each
time.

WRF's moving nests are of the first kind, those of hurricane models that follow a storm often of the
second.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from geo.grids import locate, naming
from geo.grids.layout import Layout

# decimals of a degree, a metre, to which coordinates of two times must agree to be the same place
DIGITS = 5


@dataclass(frozen=True)
class Places:
    """The places of a variable's grid.

    held: the file, the dimension of time and the index along it at which each place is first given;
    number: the place of (id of the file, index).
    """

    name: str
    dims: tuple[str, ...]
    chosen: Mapping[str, Any]
    side: int
    held: tuple[tuple[xr.Dataset, str | None, int], ...]
    number: Mapping[tuple[int, int], int]

    @property
    def count(self) -> int:
        """How many places there are."""
        return len(self.held)

    def layout(self, place: int) -> Layout:
        """Return where the points lie at one of the places."""
        data, along, k = self.held[place]
        if along is not None:
            data = data.isel({along: slice(k, k + 1)})
        return locate.locate(data, self.name, self.dims, self.chosen, self.side)[0]


def moving_places(
    files: Sequence[tuple[str, xr.Dataset]],
    name: str,
    dims: tuple[str, ...],
    chosen: Mapping[str, Any],
    side: int,
    time_dim: str | None,
) -> Places | None:
    """Return the places of a variable's grid in its files; None where it does not move.

    It moves where a file gives coordinates for every time, or where every file has one time. dims:
    its horizontal dimensions; chosen, side: as in `locate.locate`.
    """
    if len(dims) != 2 or not _may_move(files, dims, chosen, time_dim):
        return None
    pair = locate.coordinates(files[0][1], name, dims, chosen, side)
    held: list[tuple[xr.Dataset, str | None, int]] = []
    number: dict[tuple[int, int], int] = {}
    known: dict[bytes, int] = {}
    for _, data in files:
        if pair is None or not set(pair) <= set(map(str, data.variables)):
            return None
        along = time_dim if any(time_dim in data[other].dims for other in pair) else None
        if along is None and _count(data, name, time_dim) > 1:
            return None
        for k, row in enumerate(np.round(_probe(data, pair, along), DIGITS) + 0.0):
            place = known.setdefault(row.tobytes(), len(known))
            number[id(data), k] = place
            if place == len(held):
                held.append((data, along, k))
    return Places(name, dims, chosen, side, tuple(held), number) if len(held) > 1 else None


def _may_move(
    files: Sequence[tuple[str, xr.Dataset]],
    dims: tuple[str, ...],
    chosen: Mapping[str, Any],
    time_dim: str | None,
) -> bool:
    """Whether there are several files, or coordinates along time."""
    return len(files) > 1 or any(
        time_dim in v.dims
        and set(v.dims) & set(dims)
        and (naming.role(str(n), v.attrs) or n in chosen.values())
        for n, v in files[0][1].variables.items()
    )


def _count(data: xr.Dataset, name: str, time_dim: str | None) -> int:
    return int(data.sizes[time_dim]) if time_dim in data[name].dims else 1


def _probe(data: xr.Dataset, pair: tuple[str, str], along: str | None) -> NDArray[np.float64]:
    """Return coordinates of a few points at every index along a dimension, (n, points); without a
    dimension n is 1.
    """
    count = int(data.sizes[along]) if along is not None else 1
    found = []
    for other in pair:
        variable = data[other].variable
        few = {
            d: np.unique(np.linspace(0, n - 1, 3).astype(int))
            for d, n in variable.sizes.items()
            if d != along
        }
        values = np.asarray(variable.isel(few).values, np.float64)
        if along in variable.dims:
            found.append(np.moveaxis(values, variable.dims.index(along), 0).reshape(count, -1))
        else:
            found.append(np.tile(np.ravel(values), (count, 1)))
    return np.concatenate(found, axis=1)
