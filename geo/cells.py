"""Grids of lon-lat cells with edges at whole binary angles, and the cell of each particle.

Cells are integers in both directions, so that a particle falls into the same cell on every machine,
and a cell divides exactly into 2 x 2 finer ones. Longitudes are unwrapped: an edge may exceed 180
degrees, so that a grid over the antimeridian is contiguous. Weights are summed by cell in fixed
point, which gives the same sum in any order.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geo import sphere
from geo.array import Array

# [binary angle unit] 0.15 m. Cells of a stated grid are a multiple of it, because maps are made on
# cells of half the size, down to 1/16.
QUANTUM = 16
ONE = 2**50  # probability 1 in fixed point; sums stay below 2^53, so float64 adds them exactly


@dataclass(frozen=True)
class Cells:
    """South-west corner and size of cells [binary angle], and their number.

    Row 0 is the southernmost.
    """

    lon0: int
    lat0: int
    width: int
    height: int
    nlon: int
    nlat: int

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (nlat, nlon) of an array with one value per cell."""
        return self.nlat, self.nlon

    def lon(self) -> Array:
        """Return longitudes of cell centres [deg], unwrapped, increasing, shape (nlon,)."""
        return (self.lon0 + self.width * (np.arange(self.nlon) + 0.5)) * (360.0 / sphere.TURN)

    def lat(self) -> Array:
        """Return latitudes of cell centres [deg], increasing, shape (nlat,)."""
        return (self.lat0 + self.height * (np.arange(self.nlat) + 0.5)) * (360.0 / sphere.TURN)

    def centres(self) -> tuple[Array, Array]:
        """Return (lon, lat) of cell centres as int32 binary angles, each of shape (nlat, nlon)."""
        lon = self.lon0 + self.width // 2 + self.width * np.arange(self.nlon, dtype=np.int64)
        lat = self.lat0 + self.height // 2 + self.height * np.arange(self.nlat, dtype=np.int64)
        lon = (lon + 2**31) % sphere.TURN - 2**31
        x, y = np.meshgrid(lon.astype(np.int32), lat.astype(np.int32))
        return x, y

    def area(self) -> Array:
        """Return the area [m2] on the sphere of a cell in each row, shape (nlat,).

        It is R^2 dlon (sin lat2 - sin lat1).
        """
        south = (self.lat0 + self.height * np.arange(self.nlat)) * sphere.UNIT
        half = self.height * sphere.UNIT / 2
        # sin b - sin a = 2 cos((a + b) / 2) sin((b - a) / 2) has no cancellation in cells of a few
        # metres
        band = 2 * np.cos(south + half) * np.sin(half)
        # a row that reaches over a pole has almost no area, but densities are divided by it
        return np.asarray(sphere.RADIUS**2 * self.width * sphere.UNIT * np.maximum(band, 1e-12))

    def finer(self, k: int) -> "Cells":
        """Return the same extent with cells of 1/2^k the size."""
        return Cells(
            self.lon0, self.lat0, self.width >> k, self.height >> k, self.nlon << k, self.nlat << k
        )


IsLand = Callable[[Array, Array], Array]


def index_of_cells(lon: Array, lat: Array, cells: Cells) -> Array:
    """Return the flat index of each particle's cell, int64 (n,); -1 outside the grid.

    Args:
        lon: int32 binary angles, shape (n,).
        lat: int32 binary angles, shape (n,).
        cells: the grid.
    """
    ix = (lon.view(np.uint32) - np.uint32(cells.lon0 % sphere.TURN)) // np.uint32(cells.width)
    iy = (lat.view(np.uint32) - np.uint32(cells.lat0 % sphere.TURN)) // np.uint32(cells.height)
    # unsigned differences of positions west or south of the grid are large
    inside = (ix < cells.nlon) & (iy < cells.nlat)
    return np.asarray(np.where(inside, iy.astype(np.int64) * cells.nlon + ix, -1))


def to_fixed_point(probability: Array) -> Array:
    """Return probabilities in fixed point, int64, where ONE means 1."""
    return np.asarray(np.rint(probability * ONE), np.int64)
