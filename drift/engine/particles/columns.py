"""Columns of all particles of a run, read part by part from memory or from the files of its
shards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from drift.engine.particles.partials import PART, Blocks
from geo.array import Array


@dataclass(frozen=True)
class Columns:
    """Particle columns by name, each of shape (n,), read on demand."""

    blocks: Blocks
    # by column name: a function that returns the slots [first, last)
    read: Mapping[str, Callable[[int, int], Array]]

    @classmethod
    def held(cls, blocks: Blocks, columns: Mapping[str, Array]) -> Columns:
        """Return a reader of columns (n,) that are in memory."""
        return cls(blocks, {name: _reader(column) for name, column in columns.items()})

    def __contains__(self, name: str) -> bool:
        return name in self.read

    def __or__(self, other: Columns) -> Columns:
        """Return the columns of both readers, which must describe the same particles."""
        return Columns(self.blocks, {**self.read, **other.read})

    def named(self, name: str, other: str) -> Columns:
        """Return the same columns, with column `name` also available under the name `other`."""
        return Columns(self.blocks, {**self.read, other: self.read[name]})

    def some(self, begin: int, end: int) -> Columns:
        """Return the columns of the particles in blocks `begin` to `end` - 1."""
        first = int([*self.blocks.first, self.blocks.n][begin])

        def reader(read: Callable[[int, int], Array]) -> Callable[[int, int], Array]:
            return lambda a, b: read(first + a, first + b)

        return Columns(
            self.blocks.some(begin, end), {name: reader(read) for name, read in self.read.items()}
        )

    def whole(self, name: str) -> Array:
        """Return one column of all particles, (n,)."""
        return self.read[name](0, self.blocks.n)

    def parts(self, *names: str) -> Iterator[tuple[Any, ...]]:
        """Yield the particles in parts of about PART slots: their blocks, then the named columns.

        A column that does not exist is None. Parts are whole blocks, so that they are the same
        however many shards the run had.
        """
        for blocks, (first, last) in self.blocks.cuts(PART):
            yield (
                blocks,
                *(self.read[name](first, last) if name in self.read else None for name in names),
            )


def _reader(column: Array) -> Callable[[int, int], Array]:
    return lambda first, last: column[first:last]
