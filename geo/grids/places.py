"""Positions of a moving grid, from files with coordinates for every time, or one file per time.

WRF's moving nests are of the first kind; hurricane models that follow a storm are often of the
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

# decimals of a degree (1 m) to which coordinates at two times must agree to be one position
DIGITS = 5


@dataclass(frozen=True)
class Places:
    """The positions of a variable's grid.

    held: for each position the file, time dimension and index at which it first occurs; number: the
    position for (id of the file, index).
    """

    name: str
    dims: tuple[str, ...]
    chosen: Mapping[str, Any]
    side: int
    held: tuple[tuple[xr.Dataset, str | None, int], ...]
    number: Mapping[tuple[int, int], int]

    @property
    def count(self) -> int:
        """Number of positions."""
        return len(self.held)

    def layout(self, place: int) -> Layout:
        """Return the layout of the points at a position."""
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
    """Return the positions of a variable's grid in its files; None if it does not move.

    It may move if files give coordinates for every time, or if every file has one time.

    Args:
        files: paths and datasets.
        name: of the variable.
        dims: its horizontal dimensions.
        chosen: as in `locate.locate`.
        side: as in `locate.locate`.
        time_dim: time dimension of the variable.
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
        for k, row in enumerate(np.round(_probe_coordinates(data, pair, along), DIGITS) + 0.0):
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
    """Return True if there are several files, or coordinates along time."""
    return len(files) > 1 or any(
        time_dim in v.dims
        and set(v.dims) & set(dims)
        and (naming.role(str(n), v.attrs) or n in chosen.values())
        for n, v in files[0][1].variables.items()
    )


def _count(data: xr.Dataset, name: str, time_dim: str | None) -> int:
    return int(data.sizes[time_dim]) if time_dim in data[name].dims else 1


def _probe_coordinates(
    data: xr.Dataset, pair: tuple[str, str], along: str | None
) -> NDArray[np.float64]:
    """Return coordinates of a few points at every index along a dimension, shape (n, points).

    Without a dimension n is 1.
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
