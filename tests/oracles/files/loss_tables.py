"""Transmission losses at four places, and the comparison of a table with them."""

import numpy as np
from sensor_tables import BEARING, LAT, LON, RANGE, Table, loss

from drift.evidence.sensors import losses

ROUNDING = 4 * float(np.spacing(np.float32(128)))  # [dB] unpacked and stored in single precision
WHOLE = loss(BEARING, RANGE)
PLACES = loss(BEARING, RANGE, np.arange(4) * 1.0)
FOUR = Table(places=(LON, LAT))


def same(read: losses.Losses, table: np.ndarray = WHOLE) -> None:
    """The record holds this table (p, b, r) over BEARING and RANGE."""
    # from radians in single precision
    np.testing.assert_allclose(np.degrees(read.bearing), BEARING, atol=2e-5)
    np.testing.assert_allclose(read.range, RANGE, rtol=1e-6)
    np.testing.assert_allclose(read.loss, table, rtol=0, atol=ROUNDING)
    assert read.loss.dtype == np.float32
    assert read.bearing.dtype == read.range.dtype == np.float64
    assert (np.diff(read.bearing) > 0).all()
    assert read.bearing[0] >= 0
    assert read.bearing[-1] < 2 * np.pi


def holed(count: int) -> np.ndarray:
    values = WHOLE.copy()
    values.reshape(-1)[[k * 7 + 3 for k in range(4, 4 + count)]] = np.nan
    return values
