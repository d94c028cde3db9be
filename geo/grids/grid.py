"""Regular longitude-latitude grids: what kernels sample, and the target of every regridding.

Nodes ascend in both directions. A grid that spans the globe repeats its first column at its end, so
that samplers need no special case at the seam.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geo import sphere
from geo.array import Array
from geo.box import Box


@dataclass(frozen=True)
class Grid:
    """First node (lon0, lat0) [deg], spacing (dlon, dlat) > 0 [deg], number of nodes (nlon, nlat)."""

    lon0: float
    lat0: float
    dlon: float
    dlat: float
    nlon: int
    nlat: int

    @property
    def seamless(self) -> bool:
        """True if the grid spans the globe, so that its last column repeats the first."""
        return bool(abs((self.nlon - 1) * self.dlon - 360.0) < 1e-9)

    @property
    def columns(self) -> int:
        """Number of distinct columns: all but the one that a seamless grid repeats."""
        return self.nlon - 1 if self.seamless else self.nlon

    @property
    def lon(self) -> Array:
        """Longitudes of the columns [deg], ascending from lon0; they may exceed 180; shape (nlon,)."""
        return np.asarray(self.lon0 + self.dlon * np.arange(self.nlon))

    @property
    def lat(self) -> Array:
        """Latitudes of the rows [deg], ascending; shape (nlat,)."""
        return np.asarray(self.lat0 + self.dlat * np.arange(self.nlat))

    @property
    def box(self) -> Box:
        """Box that the nodes span, with its west edge in [-180, 180)."""
        west = sphere.wrap_degrees(self.lon0)
        return Box(
            west,
            self.lat0,
            west + (self.nlon - 1) * self.dlon,
            self.lat0 + (self.nlat - 1) * self.dlat,
        )


def nodes(grid: Grid) -> tuple[Array, Array]:
    """Return (lon, lat) [deg] of a grid's distinct nodes, shape (nlat, columns)."""
    lon, lat = np.meshgrid(grid.lon[: grid.columns], grid.lat)
    return lon, lat


def widen(values: NDArray[np.float32], grid: Grid) -> NDArray[np.float32]:
    """Return values (nlat, columns) with the first column repeated at the end of a seamless grid."""
    return np.concatenate((values, values[:, : grid.nlon - grid.columns]), axis=1)


def sample(grid: Grid, values: NDArray[np.floating], lon: ArrayLike, lat: ArrayLike) -> Array:
    """Return values interpolated bilinearly at points, without filling missing values.

    It serves error measurements and tests.

    Args:
        grid: of the values.
        values: shape (nlat, nlon, ...).
        lon: of the points [deg], shape (n,).
        lat: of the points [deg], shape (n,).

    Returns:
        Values, shape (n, ...); NaN outside the grid, and in cells with a missing corner of nonzero
        weight.
    """
    x = (np.asarray(lon, float) - grid.lon0) % 360.0 / grid.dlon
    # a rounding error west of the first node counts as the first node
    x = np.where(x > 360.0 / grid.dlon - 1e-6, 0.0, x)
    y = (np.asarray(lat, float) - grid.lat0) / grid.dlat
    inside = (x <= grid.nlon - 1 + 1e-6) & (y >= -1e-6) & (y <= grid.nlat - 1 + 1e-6)
    x, y = np.clip(x, 0, grid.nlon - 1), np.clip(y, 0, grid.nlat - 1)
    i, j = np.minimum(x.astype(int), grid.nlon - 2), np.minimum(y.astype(int), grid.nlat - 2)
    fx, fy = x - i, y - j
    total = np.zeros((*x.shape, *values.shape[2:]))
    for dj, di, weight in (
        (0, 0, (1 - fx) * (1 - fy)),
        (0, 1, fx * (1 - fy)),
        (1, 0, (1 - fx) * fy),
        (1, 1, fx * fy),
    ):
        weight = np.where(weight < 1e-6, 0.0, weight)
        weight = weight.reshape(weight.shape + (1,) * (values.ndim - 2))
        total += np.where(weight > 0, weight * values[j + dj, i + di], 0.0)
    return np.where(inside.reshape(inside.shape + (1,) * (values.ndim - 2)), total, np.nan)


def share_covered(grid: Grid, box: Box) -> float:
    """Return the share of a box's area on the sphere that lies inside the grid, 0 to 1."""
    south, north = max(box.south, grid.box.south), min(box.north, grid.box.north)
    if south > north:
        return 0.0
    if box.north > box.south:
        band = (np.sin(np.radians(north)) - np.sin(np.radians(south))) / (
            np.sin(np.radians(box.north)) - np.sin(np.radians(box.south))
        )
    else:
        band = 1.0
    width = 0.0
    if grid.seamless:
        return float(band)
    for turn in (-360.0, 0.0, 360.0):
        width += max(0.0, min(box.east, grid.box.east + turn) - max(box.west, grid.box.west + turn))
    return float(band * min(1.0, width / (box.east - box.west)))
