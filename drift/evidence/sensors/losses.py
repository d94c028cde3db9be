"""Transmission loss by bearing and range from a netCDF file, and its interpolation in space.

The file has a variable in dB over range, and optionally over bearing and places; `table_file`
describes the accepted files.
"""

import os
import re
import weakref
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from drift.evidence.sensors import circle, places, table_file, table_values
from drift.evidence.sensors.places import Places
from drift.evidence.sensors.records import Losses
from drift.evidence.sensors.table_file import Found, Label
from geo import sphere
from geo.array import Array
from geo.errors import UserError
from geo.grids import naming

MEANT = re.compile(r"transmission.?loss|propagation.?loss|^(tl|pl|loss|losses)$", re.I)
LEAST_LARGEST = 20.0  # [dB] a table's largest loss is at least that: the loss at 10 m
MOST = 500.0  # [dB] a larger loss is taken for a fill value
# [dB] largest difference between the bearings 0 and 360 if a file has both: two steps of values
# packed to a hundredth
AGREE = 0.02
REMEDY = "mend its attribute units, or set variable to that of the transmission loss"

_joined: "weakref.WeakKeyDictionary[Losses, Places]" = weakref.WeakKeyDictionary()


def read_losses(
    path: str | os.PathLike[str],
    *,
    variable: str | None = None,
    select: Mapping[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
    name: str | None = None,
) -> Losses:
    """Return the losses of a netCDF file.

    Args:
        path: of the file.
        variable: name of the loss, if the file has several candidates.
        select: value of each further dimension with several values (depth, frequency).
        units: units by variable, if its attribute is absent or wrong.
        name: start of error messages, by default the name of the file.

    Raises:
        UserError: the file has no valid losses, in one line.
    """
    asked = table_file.asked_for(path, name, variable, select, units)
    with table_file.open_table(path) as data:
        found = table_file.find(data, asked, MEANT, "transmission loss", ("bearing", "range"))
        lon, lat, place_dims = _places(found)
        metres, order = table_values.ranges(found)
        bearing = table_values.axis(found, "bearing") if "bearing" in found.kinds else np.zeros(1)
        dims = [*place_dims, *(found.kinds[k] for k in ("bearing", "range") if k in found.kinds)]
        table = table_file.values(found, dims).reshape(max(len(lon), 1), len(bearing), len(metres))[
            :, :, order
        ]
    labels = (
        ("place", np.arange(1, len(table) + 1), ""),
        ("bearing", bearing, " deg"),
        ("range", metres, " m"),
    )
    table_values.check_whole(table, labels, asked.name)
    table_values.check_decibels(
        table,
        table_values.unit_of(found, found.variable),
        MOST,
        0.0,
        "transmission loss",
        asked.name,
        REMEDY,
    )
    _check_losses(table, labels, asked.name)
    radians, table = circle.close_circle(bearing, table, 1, asked.name, AGREE, "dB")
    losses = Losses(radians, metres, np.ascontiguousarray(table, np.float32), lon, lat, asked.name)
    if len(lon) > 1:
        _joined[losses] = places.join(lon, lat, asked.name)
    return losses


def between(losses: Losses, lon: float, lat: float) -> NDArray[np.float32]:
    """Return the table (b, r) [dB] at a position, interpolated between the places of losses.

    With at most one place it is the table of that place; see `places` for several.

    Args:
        losses: of a file.
        lon: longitude [rad].
        lat: latitude [rad].
    """
    if len(losses.loss) == 1:
        only: NDArray[np.float32] = losses.loss[0]
        return only
    which, weight = weights(losses, lon, lat)
    share = weight.astype(np.float32)
    table = share[0] * losses.loss[which[0]]
    for k in range(1, len(which)):
        table += share[k] * losses.loss[which[k]]
    return np.asarray(table, np.float32)


def weights(losses: Losses, lon: float, lat: float) -> places.Weights:
    """Return the numbers of the places nearest to a position, and their weights: one to three.

    Args:
        losses: of a file.
        lon: longitude [rad].
        lat: latitude [rad].
    """
    if len(losses.loss) == 1:
        return np.zeros(1, np.int64), np.ones(1)
    joined = _joined.get(losses)
    if joined is None:
        joined = _joined[losses] = places.join(losses.lon, losses.lat, losses.name)
    return places.weights(joined, lon, lat)


def _places(found: Found) -> tuple[Array, Array, list[str]]:
    """Return lon, lat [rad] of a table's places (p,), and the dimensions along which they lie.

    Both are empty for a table without places.
    """
    data, name = found.data, found.name
    free = [str(d) for d in data[found.variable].dims if d not in found.kinds.values()]
    lon_name, lat_name = (
        _coordinate(data, free, pattern, units, standard)
        for pattern, units, standard in (
            (naming.LON, naming.EAST_UNITS, "longitude"),
            (naming.LAT, naming.NORTH_UNITS, "latitude"),
        )
    )
    if lon_name is None or lat_name is None:
        if (lon_name or lat_name) is not None:
            raise UserError(
                f"{name}: its places have a {'longitude' if lon_name else 'latitude'} only; give the file both, over "
                f"{', '.join(free) or 'no dimension'}"
            )
        return np.empty(0), np.empty(0), []
    pair = (data[n].reset_coords(drop=True) for n in (lon_name, lat_name))
    lon, lat = xr.broadcast(*pair)  # on a grid, each has its own dimension
    dims = [d for d in free if d in lon.dims]
    x, y = (np.ravel(np.asarray(v.transpose(*dims).values, np.float64)) for v in (lon, lat))
    bad = ~(np.isfinite(x) & np.isfinite(y)) | (np.abs(y) > 90.0) | (np.abs(x) > 720.0)
    if bad.any():
        k = int(np.argmax(bad))
        raise UserError(
            f"{name}: place {k + 1} of {x.size} is at longitude {x[k]:g}, latitude {y[k]:g} degrees; allowed are -720 to "
            f"720 and -90 to 90: mend {lon_name}, {lat_name} in the file"
        )
    radians = sphere.wrap(np.radians(x)), np.radians(y)
    _check_apart(*radians, name)
    return *radians, dims


def _coordinate(
    data: xr.Dataset, free: list[str], pattern: Any, units: Any, standard: str
) -> str | None:
    """Return the name of the longitudes or latitudes of places, None if there are none."""
    best, highest = None, 0
    for name in map(str, data.variables):
        variable = data[name]
        if not set(map(str, variable.dims)) <= set(free) or not np.issubdtype(
            variable.dtype, np.number
        ):
            continue
        score = (
            4 * (str(variable.attrs.get("standard_name", "")) == standard)
            + 2 * bool(units.match(str(variable.attrs.get("units", "")).strip()))
            + bool(pattern.match(name))
        )
        score += 8 * (score > 0 and variable.ndim > 0)  # prefer coordinates along a dimension
        if score > highest:
            best, highest = name, score
    return best


def _check_apart(lon: Array, lat: Array, name: str) -> None:
    """Reject duplicate places."""
    if len(lon) < 2:
        return
    points = np.stack(sphere.vector(lon, lat), axis=1)
    apart, near = cKDTree(points).query(points, k=2)
    k = int(np.argmin(apart[:, 1]))
    if apart[k, 1] * sphere.RADIUS < places.SAME:
        first, second = sorted((k, int(near[k][near[k] != k][0])))
        raise UserError(
            f"{name}: places {first + 1} and {second + 1} are the same ({np.degrees(lon[k]):g} E, {np.degrees(lat[k]):g} N); "
            "leave one of them out"
        )


def _check_losses(table: Array, labels: Sequence[Label], name: str) -> None:
    """Reject negative losses, reversed signs, and values that are not decibels."""
    if table.max() <= 0.0 and table.min() < 0.0:
        raise UserError(
            f"{name}: all losses are negative, {table.min():.4g} to {table.max():.4g} dB: their sign is reversed; a loss is "
            "positive: change the sign in the file"
        )
    negative = table < 0.0
    if negative.any():
        raise UserError(
            f"{name}: {int(negative.sum()):,} of {table.size:,} losses are negative, first {table[negative][0]:.4g} dB at "
            f"{table_values.where(negative, labels)}; a loss is at least 0 dB: mend the file"
        )
    if table.max() < LEAST_LARGEST:
        raise UserError(
            f"{name}: the largest loss is {table.max():.3g}; a loss of {table.max():.3g} cannot be in dB, where the largest is at "
            f"least {LEAST_LARGEST:g}: convert the file to dB (-20 log10 of a pressure, -10 log10 of an intensity)"
        )
