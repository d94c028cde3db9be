"""The containment of points, read from a forecast: the smallest share whose area holds the
point.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from geo import notation, sphere
from geo.array import Array
from geo.errors import UserError

LEAST = 1e-6  # lower limit of 1 - containment, which keeps its logarithm finite in outer cells


def containment_at(data: Any, time: Any, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
    """Return the containment at points [deg], shape (n,), at an output time; 1 where there is no
    probability.

    Between the centres of cells that hold any probability the logarithm of 1 - containment is
    interpolated bilinearly. For a bivariate normal this is the logarithm of density, by which the
    contours are drawn. Interpolation avoids the noise of a single cell's value.

    Args:
        data: a drift.forecast.products.dataset, of a run or from forecast.nc.
        time: of an output, UTC.
        lon: of the points [deg], (n,).
        lat: of the points [deg], (n,).

    Raises:
        UserError: if there is no output at that time.
    """
    times = data["time"].values
    match = np.flatnonzero(times == np.datetime64(time, "ns"))
    if not match.size:
        first, last = (notation.format_dtg(moment) for moment in times[[0, -1]])
        raise UserError(
            f"containment at {notation.format_dtg(np.datetime64(time, 's'))}: no output is at that time; "
            f"there are {times.size}, from {first} to {last}: see output.times"
        )
    output = data.isel(time=int(match[0]))
    holds = output["probability"].values > 0
    outer = np.log(np.maximum(1 - output["containment"].values.astype(np.float64), LEAST))
    x, y = (
        _axis_position(data["lon"].values, lon, turning=True),
        _axis_position(data["lat"].values, lat, turning=False),
    )
    x, y = np.broadcast_arrays(x, y)
    nlat, nlon = holds.shape
    inside = (x > -0.5) & (x < nlon - 0.5) & (y > -0.5) & (y < nlat - 0.5)
    own = np.zeros(x.shape, bool)
    own[inside] = holds[_nearest(y[inside], nlat), _nearest(x[inside], nlon)]
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    total, weight = np.zeros(x.shape), np.zeros(x.shape)
    for j, i in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share = np.abs(1 - i - (x - column)) * np.abs(1 - j - (y - row))
        k, m = np.clip(row + j, 0, nlat - 1), np.clip(column + i, 0, nlon - 1)
        share = np.where(own & holds[k, m], share, 0.0)
        total += share * np.where(share > 0, outer[k, m], 0.0)
        weight += share
    return np.where(
        own, 1 - np.exp(np.divide(total, weight, out=np.zeros(x.shape), where=weight > 0)), 1.0
    )


def _nearest(place: Array, size: int) -> Array:
    return np.clip(np.rint(place).astype(np.int64), 0, size - 1)


def _axis_position(centres: Array, where: npt.ArrayLike, *, turning: bool) -> Array:
    """Return positions along an axis, in cells from its first centre.

    turning: whether the axis is longitude; values are then wrapped to the axis.
    """
    where = np.asarray(where, np.float64)
    step = float(centres[1] - centres[0]) if len(centres) > 1 else 1.0
    if turning:
        west = centres[0] - step / 2
        where = sphere.east_of_degrees(where, west)
    return np.asarray((where - centres[0]) / step)
