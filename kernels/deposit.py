"""Weights of particles to the cells of a lon-lat grid, summed in fixed point.

The sums have the same bits in any order and on any thread.
"""

from typing import Any

import numpy as np
import taichi as ti

from kernels.coast import Ints

Longs = ti.types.ndarray(dtype=ti.i64, ndim=1)


@ti.kernel
def _deposit(
    lon: Ints,
    lat: Ints,
    amount: Longs,
    lon0: ti.i32,
    lat0: ti.i32,
    width: ti.u32,
    height: ti.u32,
    nlon: ti.i32,
    nlat: ti.i32,
    grid: Longs,
):
    for i in range(lon.shape[0]):
        # What lies west or south of the grid wraps to far east or north of it.
        ix = ti.cast(lon[i] - lon0, ti.u32) // width
        iy = ti.cast(lat[i] - lat0, ti.u32) // height
        if ix < ti.cast(nlon, ti.u32) and iy < ti.cast(nlat, ti.u32):
            ti.atomic_add(grid[ti.cast(iy, ti.i32) * nlon + ti.cast(ix, ti.i32)], amount[i])


def deposit(lon: np.ndarray, lat: np.ndarray, amount: np.ndarray, cells: Any) -> np.ndarray:
    """Return the amounts (int64) summed by cell, int64, shape (nlat, nlon); what lies outside is not counted.

    lon, lat: int32 binary angles (n,); cells: lon0, lat0, width, height [binary angle units], nlon, nlat.
    """
    grid = np.zeros(cells.nlat * cells.nlon, np.int64)
    if lon.size:
        arrays = (np.ascontiguousarray(a) for a in (lon, lat, amount))
        corner = (int(_wrapped(c)) for c in (cells.lon0, cells.lat0))
        _deposit(*arrays, *corner, cells.width, cells.height, cells.nlon, cells.nlat, grid)
    return grid.reshape(cells.nlat, cells.nlon)


def _wrapped(angle: int) -> int:
    """Return a whole number of binary angle units brought into int32."""
    return (angle + 2**31) % 2**32 - 2**31
