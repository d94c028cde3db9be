"""What became of every particle of a spill, and complete simulated spills drawn from them.

A particle of a world is one possible object: N of a world's particles, drawn without replacement,
are an exact draw of the fates of its N objects. Fates come part by part, each of some whole worlds
with all classes of objects: what is made of all of them is made of sums by world, or by blocks of
worlds, and does not depend on the parts.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from drift.engine.particles import partials
from drift.engine.particles.partials import Blocks

Ints = npt.NDArray[np.int32]

FOREVER = 2**31 - 1  # [s]


@dataclass(frozen=True)
class Stays:
    """Stays of particles on the shore, one in each row, sorted by slot and arrival; shape (m,)."""

    slot: Ints
    segment: Ints  # number in geo.coast.segments.Segments
    arrival: Ints  # [s after the run's start]
    # [s after start] when it was afloat again; FOREVER while it lies there at the end of the run
    leave: Ints


@dataclass(frozen=True)
class Adrift:
    """Where particles are at the time of a find at sea: binary angles and status, (n,)."""

    lon: Ints
    lat: Ints
    status: Ints


class Source(Protocol):
    """The fates of all particles, part by part."""

    @property
    def worlds(self) -> int:
        """Number of worlds."""

    @property
    def counts(self) -> tuple[int, ...]:
        """Particles of each class in a world."""

    def parts(self) -> Iterable["Fates"]:
        """Return the parts, of one world after another."""


@dataclass(frozen=True)
class Fates:
    """What became of the particles of some worlds, by slot, class after class; shape (n,).

    All of them are a Source.
    """

    worlds: int  # of the whole run
    world: Ints  # number in the whole run, ascending within a class
    kind: Ints  # number of its class of objects
    release: Ints  # [s after start]
    # [s after start] when it sank, left the domain or ran out of forcing; FOREVER otherwise
    ended: Ints
    ending: Ints  # drift.engine.particles.status.Status at the end of the run
    stays: Stays
    adrift: Mapping[int, Adrift] = field(default_factory=dict)  # by number of the find at sea
    # number of the first world and of the one after the last; None: all
    some: tuple[int, int] | None = None

    @property
    def here(self) -> slice:
        """Which worlds they are."""
        first, last = self.some or (0, self.worlds)
        return slice(first, last)

    @property
    def many(self) -> int:
        """Number of the worlds that are here."""
        first, last = self.some or (0, self.worlds)
        return last - first

    def parts(self) -> Iterator["Fates"]:
        """Yield all of them at once."""
        yield self

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Particles of each class in a world."""
        return tuple((np.bincount(self.kind) // self.many).tolist())

    @cached_property
    def blocks(self) -> Blocks:
        """The blocks by which sums over particles are made: whole worlds of a class."""
        ends = np.cumsum(self.counts)
        begins = (ends - self.counts) * self.worlds + np.multiply(self.counts, self.here.start)
        size = [max(count, 1) * partials.WORLDS for count in self.counts]
        return partials.cut_blocks((0, *(ends * self.many).tolist()), begins.tolist(), size)


@dataclass(frozen=True)
class Realisation:
    """One complete simulated spill for every world of some fates.

    In each world the sum of `stands`, with `destroyed` and `found`, is the number of objects.
    """

    # (n,) how many objects each slot stands for; 0: not drawn, destroyed or already found
    stands: Ints
    destroyed: Ints  # (worlds,) lost at once
    found: Ints  # (worlds,) found and taken away
