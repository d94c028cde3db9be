"""Water that is too shallow for a boat, from a netCDF grid of depths or elevations.

Each grid cell counts as shallow as the shallowest of its four corners, and as too shallow if one
has no value: water is never taken to be deeper than the grid says. Outside the grid no water is
excluded. Tides are unknown: depths are below the datum of the grid.
"""

from typing import Any

import numpy as np
import shapely

from drift.case.record import Depth
from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from geo.files import dataset

UP = ("height", "altitude", "elevation", "topography")
DOWN = ("depth", "bathymetry")


def shoals(source: Depth, box: Box, draught: float) -> Array:
    """Return polygons [deg] of water that is too shallow, or unknown within the grid.

    Args:
        source: the grid.
        box: limits of the polygons.
        draught: least depth [m].

    Raises:
        UserError: the file cannot be read or interpreted.
    """
    try:
        with dataset.open_local(source.file) as data:
            lon, lat, depth = _grid(data, source)
            # Longitudes in the box's range of 360 degrees.
            lon = sphere.east_of_degrees(lon, box.west)
            order = np.argsort(lon)
            columns = order[(lon[order] <= box.east)]
            rows = np.flatnonzero((lat >= box.south) & (lat <= box.north))
            if len(rows) < 2 or len(columns) < 2:
                return np.empty(0, object)
            values = np.asarray(
                depth.isel({depth.dims[0]: rows, depth.dims[1]: columns}).values, np.float64
            )
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise UserError(
            f'[depth]: "{source.file}" cannot be read ({str(error).splitlines()[0]}); give a netCDF grid'
        ) from None
    if _sign(depth, source) == "up":
        values = -values
    shallow = ~(values >= draught)
    cell = shallow[:-1, :-1] | shallow[1:, :-1] | shallow[:-1, 1:] | shallow[1:, 1:]
    x, y = lon[columns], lat[rows]
    step = np.median(np.diff(x))
    # exclude no water in the gap between the grid's ends
    cell &= (np.diff(x) < 2.5 * step)[None, :]
    edge = np.diff(np.pad(cell, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(edge == 1)
    last = np.nonzero(edge == -1)[1]
    low, high = np.minimum(y[row], y[row + 1]), np.maximum(y[row], y[row + 1])
    return np.asarray(shapely.box(x[first], low, x[last], high))


def _grid(data: Any, source: Depth) -> tuple[Array, Array, Any]:
    """Return longitudes, latitudes [deg] and the variable (lat, lon)."""
    axes = {}
    for name, letters in (("lat", "lat"), ("lon", "lon")):
        candidates = [
            c for c in data.variables if str(c).lower().startswith(letters) and data[c].ndim == 1
        ]
        if len(candidates) != 1:
            raise UserError(
                f'[depth]: "{source.file}" has no one-dimensional {name}; give a grid on latitude and longitude'
            )
        axes[name] = candidates[0]
    dims = tuple(data[axes[name]].dims[0] for name in ("lat", "lon"))
    known = [str(v) for v in data.data_vars if set(data[v].dims) == set(dims)]
    name = source.variable or (known[0] if len(known) == 1 else "")
    if name not in known:
        problem = (
            f'no variable "{source.variable}"'
            if source.variable
            else f"{len(known)} variables, and no `variable` given"
        )
        raise UserError(
            f'[depth]: "{source.file}": {problem}; those on its latitude and longitude: {", ".join(known) or "none"}'
        )
    lon, lat = (np.asarray(data[axes[k]].values, np.float64) for k in ("lon", "lat"))
    return lon, lat, data[name].transpose(*dims)


def _sign(variable: Any, source: Depth) -> str:
    """Return whether a variable is positive up or down from the sea surface."""
    words = (
        " ".join(str(variable.attrs.get(key, "")) for key in ("standard_name", "long_name"))
        + f" {variable.name}"
    )
    positive: str = source.positive or str(variable.attrs.get("positive", "")).lower()
    if positive in ("up", "down"):
        return positive
    up, down = (any(word in words.lower() for word in kind) for kind in (UP, DOWN))
    if up == down:
        raise UserError(
            f'[depth]: "{source.file}": {variable.name} does not say whether it is positive up (elevation) or down (depth); '
            'give positive = "up" or "down"'
        )
    return "up" if up else "down"
