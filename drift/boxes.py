"""Boxes of a plane that hold about as many particles each, and no more sea than these span."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Boxes:
    """The boxes (k) of one time, none of which overlap."""

    of: Array  # int64 (m,): the box of each particle
    low: Array  # float64 [m] (k, 2): x and y of the south-western corner
    high: Array  # and of the north-eastern

    @property
    def count(self) -> int:
        """Number of boxes."""
        return len(self.low)

    @property
    def area(self) -> Array:
        """Area [m2] of each, (k,)."""
        return np.asarray(np.prod(self.high - self.low, axis=1))


def grow(x: Array, y: Array, weight: Array, most: float) -> Boxes:
    """Return boxes that hold at most `most` particles each, counted as effective ones, of x, y [m] and weight (m,).

    Each is halved across its longer side, as in a k-d tree (Bentley 1975, doi:10.1145/361002.361007).
    """
    of = np.empty(len(x), np.int64)
    corners: list[tuple[float, float, float, float]] = []
    waiting = [np.arange(len(x))]
    while waiting:
        at = waiting.pop()
        px, py, w = x[at], y[at], weight[at]
        west, south, east, north = px.min(), py.min(), px.max(), py.max()
        if len(at) > 1 and w.sum() ** 2 > most * (w @ w) and (east > west or north > south):
            half = len(at) // 2
            at = at[np.argpartition(px if east - west > north - south else py, half)]
            waiting += [at[half:], at[:half]]
        else:
            of[at] = len(corners)
            corners.append((west, south, east, north))
    low, high = np.split(np.array(corners, np.float64), 2, axis=1)
    return Boxes(of, low, high)
