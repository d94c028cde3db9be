"""Grids of lon-lat cells whose edges are whole binary angles, and which of them holds a particle.

Cells are integers in both directions, so that a particle falls into the same cell on every machine
and a cell divides into 2 x 2 finer ones exactly. Longitudes are unwrapped: an edge may lie beyond
180 degrees, so that a grid over the antimeridian is contiguous. Weights are summed by cell in fixed
point: the same in any order.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geo import sphere
from geo.array import Array

# [binary angle unit] 0.15 m, of which the cells of a stated grid are a whole number: maps are made
# on cells of half, down to 1/16, the size.
QUANTUM = 16
ONE = 2**50  # probability 1 in fixed point; sums stay below 2^53, so float64 adds them exactly


@dataclass(frozen=True)
class Cells:
    """South-west corner and size of cells [binary angle] and their number; row 0 is the
    southernmost.
    """

    lon0: int
    lat0: int
    width: int
    height: int
    nlon: int
    nlat: int

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (nlat, nlon) of an array of one value a cell."""
        return self.nlat, self.nlon

    def lon(self) -> Array:
        """Return the cells' centres [deg], unwrapped, strictly increasing, shape (nlon,)."""
        return (self.lon0 + self.width * (np.arange(self.nlon) + 0.5)) * (360.0 / sphere.TURN)

    def lat(self) -> Array:
        """Return the cells' centres [deg], strictly increasing, shape (nlat,)."""
        return (self.lat0 + self.height * (np.arange(self.nlat) + 0.5)) * (360.0 / sphere.TURN)

    def centres(self) -> tuple[Array, Array]:
        """Return (lon, lat) of every cell's centre as int32 binary angles, each of shape (nlat,
        nlon).
        """
        lon = self.lon0 + self.width // 2 + self.width * np.arange(self.nlon, dtype=np.int64)
        lat = self.lat0 + self.height // 2 + self.height * np.arange(self.nlat, dtype=np.int64)
        lon = (lon + 2**31) % sphere.TURN - 2**31
        x, y = np.meshgrid(lon.astype(np.int32), lat.astype(np.int32))
        return x, y

    def area(self) -> Array:
        """Return the area [m2] of a cell of each row on the sphere, R^2 dlon (sin lat2 - sin lat1),
        shape (nlat,).
        """
        south = (self.lat0 + self.height * np.arange(self.nlat)) * sphere.UNIT
        half = self.height * sphere.UNIT / 2
        # sin b - sin a = 2 cos((a + b) / 2) sin((b - a) / 2): no cancellation in cells of a few
        # metres
        band = 2 * np.cos(south + half) * np.sin(half)
        # A row that reaches over a pole has almost no area, but densities are divided by it.
        return np.asarray(sphere.RADIUS**2 * self.width * sphere.UNIT * np.maximum(band, 1e-12))

    def finer(self, k: int) -> "Cells":
        """Return the same extent in cells of 1/2^k the size."""
        return Cells(
            self.lon0, self.lat0, self.width >> k, self.height >> k, self.nlon << k, self.nlat << k
        )


IsLand = Callable[[Array, Array], Array]


def index(lon: Array, lat: Array, cells: Cells) -> Array:
    """Return the flat index of the cell that holds each particle, int64 (n,); -1 off the grid.

    lon, lat: int32 binary angles (n,).
    """
    ix = (lon.view(np.uint32) - np.uint32(cells.lon0 % sphere.TURN)) // np.uint32(cells.width)
    iy = (lat.view(np.uint32) - np.uint32(cells.lat0 % sphere.TURN)) // np.uint32(cells.height)
    # unsigned differences of what lies west or south are large
    inside = (ix < cells.nlon) & (iy < cells.nlat)
    return np.asarray(np.where(inside, iy.astype(np.int64) * cells.nlon + ix, -1))


def fixed(probability: Array) -> Array:
    """Return probabilities in fixed point, int64: ONE is certainty."""
    return np.asarray(np.rint(probability * ONE), np.int64)
