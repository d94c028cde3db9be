"""A variable by place, and by time if it changes, from a netCDF file, on an even grid.

The file may have any grid that forcing may have. Values on an even grid of longitude and latitude
are used as they are; others are interpolated linearly on an even grid that is twice as fine, and
have no value outside their own domain.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from drift.evidence.sensors import table_file, table_values
from drift.evidence.sensors.table_file import Asked, Found
from geo.array import Array
from geo.errors import UserError
from geo.forcing.reading import component, slices, tile
from geo.forcing.times import clock
from geo.grids import grid as grids
from geo.grids import locate, naming, regrid, target
from geo.grids.grid import Grid
from geo.grids.layout import Axes, Layout

Check = Callable[[Array, Found, Sequence[table_file.Label]], Array]


class Places(NamedTuple):
    """Values by time and place."""

    values: Array  # (t, nlat, nlon), NaN where there is none
    times: NDArray[np.datetime64]  # UTC (t,) ascending; empty: always the same, with t = 1
    grid: Grid


def read_places(
    data: xr.Dataset,
    asked: Asked,
    coordinates: Mapping[str, str],
    meant: re.Pattern[str],
    what: str,
    check: Check,
) -> Places:
    """Return the values of a variable by place.

    Args:
        data: of the file.
        asked: the request.
        coordinates: names of lon, lat or the reference system (crs), if they are not recognized.
        meant: matches names of the variable.
        what: the variable in words.
        check: returns the values as they are used, or rejects them; it is given the values, the
            variable, and labels of the dimensions.

    Raises:
        UserError: the file has no such variable over places.
    """
    variable = table_file.variable_of(data, asked, meant, what, lambda n: data[n].ndim > 0)
    data = table_file.selected(data, variable, asked)
    time = clock.variable_of(data, [str(d) for d in data[variable].dims], {})
    has_time = time is not None and data[time].ndim == 1
    kinds = {"time": str(data[time].dims[0])} if has_time else {}
    found = Found(data, variable, kinds, {"time": str(time)} if has_time else {}, asked)
    when, name = table_values.times(found), asked.name
    dims = _horizontal(found, coordinates, what)
    try:
        layout = locate.locate(data, variable, dims, coordinates)[0]
    except UserError as error:
        message = (
            str(error)
            .replace("set variables = {", "set coordinates = {")
            .replace("variables.", "coordinates.")
        )
        raise UserError(f"{name}: {message}") from error
    table = table_file.values(found, [*kinds.values(), *dims])
    table = table.reshape(-1, *table.shape[len(kinds) :])
    for k, index in enumerate(slices.window(layout), start=1):
        table = np.take(table, index, axis=k)
    labels = (("time", moments(when), ""), *_labels(layout, dims, table.shape[1:]))
    table = check(table, found, labels)
    grid = tile.regular(layout, layout)
    if grid is not None:
        values = [grids.widen(slab.astype(np.float32), grid) for slab in table]
    else:
        grid, _ = target.choose([layout], None)
        matrix = regrid.weights(layout, grid)
        shape = grid.nlat, grid.columns
        carried = (regrid.regrid_values(matrix, slab).reshape(shape) for slab in table)
        values = [grids.widen(slab, grid) for slab in carried]
    return Places(np.stack(values), when, grid)


def moments(when: NDArray[np.datetime64]) -> Array:
    """Return the times of a table for messages: one at least."""
    return when if when.size else np.arange(1, 2)


def _labels(layout: Layout, dims: Sequence[str], shape: tuple[int, ...]) -> list[table_file.Label]:
    """Return the labels of the horizontal dimensions for messages."""
    if isinstance(layout, Axes):
        return [("latitude", layout.lat, ""), ("longitude", layout.lon, "")]
    return [(d, np.arange(n), " (counted from 0)") for d, n in zip(dims, shape, strict=True)]


def _horizontal(found: Found, coordinates: Mapping[str, str], what: str) -> tuple[str, ...]:
    """Return the horizontal dimensions, latitude or rows first; a mesh has one."""
    data, name = found.data, found.variable
    dims = [str(d) for d in data[name].dims if str(d) not in found.kinds.values()]
    several = [d for d in dims if data.sizes[d] > 1 or naming.LON.match(d) or naming.LAT.match(d)]
    if len(several) > 2:
        points = {str(d) for n in coordinates.values() if n in data.variables for d in data[n].dims}
        extra = next((d for d in several if d not in points and not naming.of_grid(d)), several[0])
        table_file.values(found, [d for d in dims if d != extra])  # raises, and lists its values
    if not several:
        over = what.partition(" over ")[2].replace("latitude, or ", "latitude, nor over ")
        raise UserError(
            f"{found.name}: {table_file.spoken(data, name)} is no table over {over}: set variable to another"
        )
    if len(several) == 2 and component.lat_last(data, several):
        several.reverse()
    return tuple(several)
