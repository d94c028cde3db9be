"""Deposits of weights on cells against NumPy in int64."""

import numpy as np

from geo.cells import Cells
from kernels import deposit as kernel

RNG = np.random.default_rng(4)


def test_deposits_are_exact_and_blind_to_order_and_wrap() -> None:
    cells = Cells(2**31 - 40_000, -30_000, 2_000, 1_000, 37, 61)  # across the antimeridian
    n = 100_000
    lon = (2**31 + RNG.integers(-60_000, 60_000, n)).astype(np.uint32).view(np.int32)
    lat = RNG.integers(-50_000, 50_000, n).astype(np.int32)
    amount = RNG.integers(0, 2**40, n)
    ix, iy = (lon.astype(np.int64) - cells.lon0) % 2**32 // 2_000, (lat.astype(np.int64) + 30_000) // 1_000
    inside = (ix < 37) & (iy >= 0) & (iy < 61)
    expected = np.zeros(cells.shape, np.int64)
    np.add.at(expected, (iy[inside], ix[inside]), amount[inside])
    order = RNG.permutation(n)
    assert (kernel.deposit(lon, lat, amount, cells) == expected).all()
    assert (kernel.deposit(lon[order], lat[order], amount[order], cells) == expected).all()
