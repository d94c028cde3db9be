"""Squares of a plane, finer where particles are denser: each bin of time has its own."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import tracks as record

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Quadtree:
    """Leaves of all bins, numbered through: those of bin t are [start[t], start[t + 1])."""

    west: float  # [m] of the square that is divided
    south: float
    side: float
    start: Array  # int64 (b + 1,)
    code: Array  # int64 (leaves,) place on Morton's curve where the leaf begins, ascending in each bin
    level: Array  # int64 (leaves,): side / 2^level

    @property
    def area(self) -> Array:
        """Area [m2] of each leaf."""
        return np.asarray((self.side / 2.0**self.level) ** 2)

    @property
    def bin(self) -> Array:
        """Bin of time of each leaf."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def centre(self) -> tuple[Array, Array]:
        """Return (x, y) [m] of the leaves' centres."""
        half = self.side / 2.0**self.level / 2
        size = self.side / 2**record.LEVELS
        x, y = (_unspread(self.code >> shift) * size for shift in (0, 1))
        return self.west + x + half, self.south + y + half

    def find(self, x: Array, y: Array) -> Array:
        """Return the leaf of each particle in each bin, int32 (b, m); points outside take the nearest edge's."""
        code = record.morton(x, y, self.west, self.south, self.side)
        leaf = np.empty(code.shape, np.int32)
        for t, (first, last) in enumerate(zip(self.start[:-1], self.start[1:], strict=True)):
            leaf[t] = first + np.searchsorted(self.code[first:last], code[t], side="right") - 1
        return leaf


def grow(x: Array, y: Array, weight: Array, most: float) -> Quadtree:
    """Return leaves that hold at most `most` particles each, counted as effective ones, of x, y [m] (b, m)."""
    west, south, side = record.square(x, y)
    code = record.morton(x, y, west, south, side)
    start, codes, levels = [0], [], []
    for t in range(len(code)):
        at = np.argsort(code[t], kind="stable")
        ordered = code[t][at]
        total, squares = (np.concatenate([[0.0], np.cumsum(w[at])]) for w in (weight, weight**2))
        begin, done = np.zeros(1, np.int64), []
        for level in range(record.LEVELS + 1):
            size = 1 << 2 * (record.LEVELS - level)
            first, last = np.searchsorted(ordered, begin), np.searchsorted(ordered, begin + size)
            mass, spread = total[last] - total[first], squares[last] - squares[first]
            split = (mass**2 > most * spread) & (last - first > most) & (level < record.LEVELS)
            done.append(np.stack([begin[~split], np.full(np.sum(~split), level)]))
            begin = (begin[split][:, None] + np.arange(4) * (size // 4)).reshape(-1)
        leaf = np.concatenate(done, axis=1)
        leaf = leaf[:, np.argsort(leaf[0])]
        codes.append(leaf[0])
        levels.append(leaf[1])
        start.append(start[-1] + leaf.shape[1])
    return Quadtree(west, south, side, np.array(start), np.concatenate(codes), np.concatenate(levels))


def _unspread(code: Array) -> Array:
    """Return every other bit of a place on Morton's curve, from the lowest, as a number."""
    v = code & 0x55555555
    for gap, mask in ((1, 0x33333333), (2, 0x0F0F0F0F), (4, 0x00FF00FF), (8, 0x0000FFFF)):
        v = (v | (v >> gap)) & mask
    return np.asarray(v)
