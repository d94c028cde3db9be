"""Slices that stay in memory, for many forecasts from the same files and for the passes of one over
its forcing.

Of a variable they are kept as they are read, of a source as they are sampled.
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

# [bytes] of one component, and of all finished slices.
MOST = 2**28


class Kept:
    """What has been read over a window: the file's indices along each horizontal dimension."""

    def __init__(self, index: tuple[Index, ...]) -> None:
        self.index = index
        self._places = [_places(along) for along in index]
        self._slices: dict[int, tuple[Array, int]] = {}
        self._guard = threading.Lock()

    def part(self, index: tuple[Index, ...]) -> tuple[Index, ...] | None:
        """Return where in the window indices stand; None where some of them are outside it."""
        inside = []
        for wanted, places in zip(index, self._places, strict=True):
            if wanted.max(initial=-1) >= len(places) or (places[wanted] < 0).any():
                return None
            inside.append(places[wanted])
        return tuple(inside)

    def slice(self, i: int, read: Callable[[], tuple[Array, int]]) -> tuple[Array, int]:
        """Return slice i over the window, and how many fill values it held, read now if it is not
        there.
        """
        with self._guard:
            got = self._slices.pop(i, None) or read()
            self._slices[i] = got
            while (
                len(self._slices) > 1
                and sum(values.nbytes for values, _ in self._slices.values()) > MOST
            ):
                del self._slices[next(iter(self._slices))]
            return got


class Finished:
    """Slices of parts of sources, ready to be sampled: true east and north, filled towards the
    coast.

    Only what is the same in every bit may share a key: slices of one part of one source, filled
    equally deep. Once there is no room, what was used longest ago is dropped; or, with `first`,
    what comes is not kept: a second pass from the same begin would find nothing of one that is
    longer than the room.
    """

    def __init__(self, first: bool = False) -> None:
        self._first = first
        self._stored: Stored | None = None
        self._slices: dict[Hashable, Array] = {}
        self._size = 0  # [bytes]
        self._guard = threading.Lock()

    def find(self, key: Hashable) -> Array | None:
        """Return the slice of a key; None where it is not there."""
        with self._guard:
            values = self._slices.pop(key, None)
            if values is not None:
                self._slices[key] = values
            return values

    def made(self, key: Hashable, make: Callable[[], Array]) -> Array:
        """Return a slice that is not there, made now, or read from where they are stored; it must
        not be changed.
        """
        values = make() if self._stored is None else self._stored.get(key, make)
        self._keep(key, values)
        return values

    def store(self, folder: Path | None) -> None:
        """Store slices in a folder from now on, those that are there too; None: no longer."""
        if folder == (self._stored and self._stored.folder):
            return
        self._stored, held = None if folder is None else Stored(folder), self._slices
        self._slices, self._size = {}, 0
        for key, values in held.items() if self._stored else ():
            self.made(key, functools.partial(np.asarray, values))

    def _keep(self, key: Hashable, values: Array) -> None:
        with self._guard:
            if self._first and self._size + values.nbytes > MOST:
                return
            self._size += values.nbytes - getattr(self._slices.pop(key, None), "nbytes", 0)
            self._slices[key] = values
            while len(self._slices) > 1 and self._size > MOST:
                self._size -= self._slices.pop(next(iter(self._slices))).nbytes


@dataclass(frozen=True)
class Shelf:
    """Where the finished slices of one part of a source stand among those of others."""

    part: Hashable
    finished: Finished = field(repr=False)

    def find(self, *key: Hashable) -> Array | None:
        """Return a slice of this part; None where it is not there."""
        return self.finished.find((self.part, *key))

    def made(self, make: Callable[[], Array], *key: Hashable) -> Array:
        """Return a slice of this part that is not there, made now or read from where they are
        stored.
        """
        return self.finished.made((self.part, *key), make)


def _places(index: Index) -> Index:
    """Return the place of each of the file's indices in a window, -1 where it has none."""
    places = np.full(int(index.max(initial=0)) + 1, -1, np.int64)
    places[index] = np.arange(len(index))
    return places
