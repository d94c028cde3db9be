"""Columns of all particles of a run, gone through part by part: they lie in memory, or in the files
of its shards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from drift.engine.particles.partials import PART, Blocks
from geo.array import Array


@dataclass(frozen=True)
class Columns:
    """What particles have, by name; all columns are (n,)."""

    blocks: Blocks
    # by name: gives some slots, from the first to before the last
    read: Mapping[str, Callable[[int, int], Array]]

    @classmethod
    def held(cls, blocks: Blocks, columns: Mapping[str, Array]) -> Columns:
        """Return columns (n,) that are in memory."""
        return cls(blocks, {name: _reader(column) for name, column in columns.items()})

    def __contains__(self, name: str) -> bool:
        return name in self.read

    def __or__(self, other: Columns) -> Columns:
        """Return the columns of both, which are of the same particles."""
        return Columns(self.blocks, {**self.read, **other.read})

    def named(self, name: str, other: str) -> Columns:
        """Return the same, with one of the columns under another name too."""
        return Columns(self.blocks, {**self.read, other: self.read[name]})

    def some(self, begin: int, end: int) -> Columns:
        """Return the same of the particles of some blocks, by the numbers of the first and of the
        one after the last.
        """
        first = int([*self.blocks.first, self.blocks.n][begin])

        def reader(read: Callable[[int, int], Array]) -> Callable[[int, int], Array]:
            return lambda a, b: read(first + a, first + b)

        return Columns(
            self.blocks.some(begin, end), {name: reader(read) for name, read in self.read.items()}
        )

    def whole(self, name: str) -> Array:
        """Return a column (n,)."""
        return self.read[name](0, self.blocks.n)

    def parts(self, *names: str) -> Iterator[tuple[Any, ...]]:
        """Yield the blocks of some PART slots after another, and columns of these; None for one
        that is not there.

        Parts are of the run's own blocks: the same ones, whatever shards it was cut into.
        """
        for blocks, (first, last) in self.blocks.cuts(PART):
            yield (
                blocks,
                *(self.read[name](first, last) if name in self.read else None for name in names),
            )


def _reader(column: Array) -> Callable[[int, int], Array]:
    return lambda first, last: column[first:last]
