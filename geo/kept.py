"""Slices of a variable that stay in memory once they are read: for many forecasts from the same files."""

import threading
from collections.abc import Callable

import numpy as np

from geo.layout import Array, Index

MOST = 2**28  # [bytes] of one component; the slice that was last asked for longest ago goes first


class Kept:
    """What has been read over a window: the file's indices along each horizontal dimension."""

    def __init__(self, index: tuple[Index, ...]) -> None:
        self.index = index
        self._places = [_places(one) for one in index]
        self._slices: dict[int, tuple[Array, int]] = {}
        self._guard = threading.Lock()

    def part(self, index: tuple[Index, ...]) -> tuple[Index, ...] | None:
        """Return where in the window indices stand; None where some of them are outside it."""
        found = []
        for wanted, places in zip(index, self._places, strict=True):
            if wanted.max(initial=-1) >= len(places) or (places[wanted] < 0).any():
                return None
            found.append(places[wanted])
        return tuple(found)

    def slice(self, i: int, read: Callable[[], tuple[Array, int]]) -> tuple[Array, int]:
        """Return slice i over the window, and how many fill values it held, read now if it is not there."""
        with self._guard:
            got = self._slices.pop(i, None) or read()
            self._slices[i] = got
            while len(self._slices) > 1 and sum(values.nbytes for values, _ in self._slices.values()) > MOST:
                del self._slices[next(iter(self._slices))]
            return got


def _places(index: Index) -> Index:
    """Return the place of each of the file's indices in a window, -1 where it has none."""
    places = np.full(int(index.max(initial=0)) + 1, -1, np.int64)
    places[index] = np.arange(len(index))
    return places
