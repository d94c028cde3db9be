"""Slices kept in memory, for several forecasts from the same files or several passes of one.

`Kept` holds a component's slices as they are read, `Finished` a source's slices ready for sampling.
"""

import functools
import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geo.array import Array
from geo.forcing.reading.stored import Stored
from geo.grids.layout import Index

# [bytes] limit for one component, and for all finished slices
MOST = 2**28


class Kept:
    """Slices of a component over a window, given by the file's indices along each dimension."""

    def __init__(self, index: tuple[Index, ...]) -> None:
        self.index = index
        self._window_positions = [_window_positions(along) for along in index]
        self._slices: dict[int, tuple[Array, int]] = {}
        self._guard = threading.Lock()

    def part(self, index: tuple[Index, ...]) -> tuple[Index, ...] | None:
        """Return the position of indices in the window; None if some are outside it."""
        inside = []
        for wanted, places in zip(index, self._window_positions, strict=True):
            if wanted.max(initial=-1) >= len(places) or (places[wanted] < 0).any():
                return None
            inside.append(places[wanted])
        return tuple(inside)

    def slice(self, i: int, read: Callable[[], tuple[Array, int]]) -> tuple[Array, int]:
        """Return slice i over the window and its number of fill values; read it if it is absent."""
        with self._guard:
            got = self._slices.pop(i, None) or read()
            self._slices[i] = got
            while (
                len(self._slices) > 1
                and sum(values.nbytes for values, _ in self._slices.values()) > MOST
            ):
                del self._slices[next(iter(self._slices))]
            return got


class SliceCache:
    """Slices that are ready to be sampled: true east and north, filled toward the coast.

    Two slices may share a key only if they are bitwise equal: slices of the same part of the same
    source, filled equally deep. If memory is used up, the least recently used slice is dropped.
    With `first`, new slices are not kept instead: for a run that is longer than the memory, a
    second pass from the beginning would otherwise find nothing.
    """

    def __init__(self, first: bool = False) -> None:
        self._first = first
        self._stored: Stored | None = None
        self._slices: dict[Hashable, Array] = {}
        self._size = 0  # [bytes]
        self._guard = threading.Lock()

    def find(self, key: Hashable) -> Array | None:
        """Return the slice of a key; None if it is absent."""
        with self._guard:
            values = self._slices.pop(key, None)
            if values is not None:
                self._slices[key] = values
            return values

    def made(self, key: Hashable, make: Callable[[], Array]) -> Array:
        """Return a slice that `find` did not find, made now or read from disk; do not change it."""
        values = make() if self._stored is None else self._stored.get(key, make)
        self._add(key, values)
        return values

    def store(self, folder: Path | None) -> None:
        """Store slices in a folder from now on, and those in memory too; None to stop storing."""
        if folder == (self._stored and self._stored.folder):
            return
        self._stored, slices = None if folder is None else Stored(folder), self._slices
        self._slices, self._size = {}, 0
        for key, values in slices.items() if self._stored else ():
            self.made(key, functools.partial(np.asarray, values))

    def _add(self, key: Hashable, values: Array) -> None:
        with self._guard:
            if self._first and self._size + values.nbytes > MOST:
                return
            self._size += values.nbytes - getattr(self._slices.pop(key, None), "nbytes", 0)
            self._slices[key] = values
            while len(self._slices) > 1 and self._size > MOST:
                self._size -= self._slices.pop(next(iter(self._slices))).nbytes


@dataclass(frozen=True)
class Shelf:
    """View of `Finished` for one part of a source."""

    part: Hashable
    finished: SliceCache = field(repr=False)

    def find(self, *key: Hashable) -> Array | None:
        """Return a slice of this part; None if it is absent."""
        return self.finished.find((self.part, *key))

    def made(self, make: Callable[[], Array], *key: Hashable) -> Array:
        """Return a slice of this part that `find` did not find, made now or read from disk."""
        return self.finished.made((self.part, *key), make)


def _window_positions(index: Index) -> Index:
    """Return the position of each of the file's indices in a window, -1 if it is outside."""
    places = np.full(int(index.max(initial=0)) + 1, -1, np.int64)
    places[index] = np.arange(len(index))
    return places
