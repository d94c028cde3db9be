"""Find blank slices: no value in the wanted area, between slices that have values.

Model output sometimes has such slices. Candidates come from the time series at one wet point, which
is read at once; each is confirmed by reading the whole slice. Blank slices are removed, so that
time interpolation skips them.
"""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from geo.array import Array
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading import slices, tile
from geo.forcing.reading.component import Component
from geo.forcing.reading.tile import Tile

TRIED = 5  # number of slices in which a wet point is searched for


def find_blank_slices(regridded: Tile, indices: Sequence[int], among: Sequence[int]) -> list[int]:
    """Return which of some slices of a tile are blank; none if no slice shows a wet point.

    among: slices in which a wet point is searched for.
    """
    if not indices:
        return []
    places = None
    for k in np.unique(np.linspace(0, len(among) - 1, TRIED).round().astype(int)):
        places = _find_wet_points(regridded, among[k])
        if places is not None:
            break
    if places is None:
        return []
    silent = np.zeros(len(indices), bool)
    for component, place in zip(regridded.components, places, strict=True):
        silent |= ~_is_real(_read_series(component, indices, place), component)
    return [
        i
        for i, doubted in zip(indices, silent, strict=True)
        if doubted and np.isnan(tile.read_tile(regridded, i)).all()
    ]


def _find_wet_points(regridded: Tile, i: int) -> list[tuple[int, ...]] | None:
    """Return for each component the file indices of a point that has a value in slice i.

    None if a component has none.
    """
    found = []
    for component, layout in zip(regridded.components, regridded.layouts, strict=True):
        values, _ = slices.read_component_slice(component, layout, i)
        wet = np.argwhere(np.isfinite(values) & (values != 0))  # land may be stored as zero
        wet = wet if len(wet) else np.argwhere(np.isfinite(values))
        if not len(wet):
            return None
        middle = wet[len(wet) // 2]
        found.append(
            tuple(int(along[k]) for along, k in zip(slices.window(layout), middle, strict=True))
        )
    return found


def _read_series(component: Component, indices: Sequence[int], place: tuple[int, ...]) -> Array:
    """Return a component at one point in some slices, in the file's units; one read per file."""
    parts = []
    for _, run in groupby(indices, lambda i: id(component.segments[i][0])):
        own = list(run)
        data, _, time_dim, _ = component.segments[own[0]]
        variable = data[component.name]
        at: dict[str, Any] = {d: n for d, n in component.fixed.items() if d in variable.dims}
        at |= dict(zip(component.dims, place, strict=True))
        if time_dim is not None:
            steps = np.array([component.segments[i][3] for i in own])
            first = int(steps.min())
            at[time_dim] = slice(first, int(steps.max()) + 1)
            parts.append(np.asarray(variable.isel(at).values, np.float64)[steps - first])
        else:
            parts.append(np.full(len(own), float(variable.isel(at).values)))
    return np.concatenate(parts)


def _is_real(values: Array, component: Component) -> Array:
    """Return True for values that are real, False for those that mean missing."""
    with np.errstate(invalid="ignore"):
        real = np.isfinite(values) & ~np.isin(values, component.fills)
        return real & (
            np.abs(values) * component.factor <= QUANTITIES[component.quantity].impossible
        )
