"""Fates of a spill's particles, and complete simulated spills drawn from them.

A particle of a world is one possible object: N of a world's particles, drawn without replacement,
are an exact draw of the fates of its N objects. Fates come in parts of whole worlds with all
classes of objects. Results over all parts are built from sums by world, or by blocks of worlds, so
they do not depend on the division into parts.
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
    # [s after start] end of the stay; FOREVER if the particle lies there at the end of the run
    leave: Ints


@dataclass(frozen=True)
class Adrift:
    """Positions [binary angle] and statuses of particles at the time of a find at sea, (n,)."""

    lon: Ints
    lat: Ints
    status: Ints


class FatesSource(Protocol):
    """The fates of all particles, in parts of whole worlds."""

    @property
    def worlds(self) -> int:
        """Number of worlds."""

    @property
    def counts(self) -> tuple[int, ...]:
        """Particles of each class in a world."""

    def parts(self) -> Iterable["Fates"]:
        """Return the parts, in the order of worlds."""


@dataclass(frozen=True)
class Fates:
    """Fates of the particles of some worlds, by slot, class after class; shape (n,).

    The fates of all worlds are a Source.
    """

    worlds: int  # of the whole run
    world: Ints  # number in the whole run, ascending within a class
    kind: Ints  # number of the class of objects
    release: Ints  # [s after start]
    # [s after start] time of sinking, leaving the domain or end of forcing; FOREVER otherwise
    ended: Ints
    ending: Ints  # drift.engine.particles.status.Status at the end of the run
    stays: Stays
    adrift: Mapping[int, Adrift] = field(default_factory=dict)  # by number of the find at sea
    # number of the first world of the part, and of the one after its last; None: all worlds
    some: tuple[int, int] | None = None

    @property
    def here(self) -> slice:
        """The range of worlds in this part."""
        first, last = self.some or (0, self.worlds)
        return slice(first, last)

    @property
    def many(self) -> int:
        """Number of worlds in this part."""
        first, last = self.some or (0, self.worlds)
        return last - first

    def parts(self) -> Iterator["Fates"]:
        """Yield these fates as the only part."""
        yield self

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Particles of each class in a world."""
        return tuple((np.bincount(self.kind) // self.many).tolist())

    @cached_property
    def blocks(self) -> Blocks:
        """The blocks over which sums over particles are made: whole worlds of a class."""
        ends = np.cumsum(self.counts)
        begins = (ends - self.counts) * self.worlds + np.multiply(self.counts, self.here.start)
        size = [max(count, 1) * partials.WORLDS for count in self.counts]
        return partials.cut_blocks((0, *(ends * self.many).tolist()), begins.tolist(), size)


@dataclass(frozen=True)
class Realisation:
    """One complete simulated spill for every world of a part.

    In each world `destroyed`, `found` and the sum of `stands` add up to the number of objects.
    """

    # (n,) number of objects that each slot represents; 0: not drawn, destroyed or already found
    stands: Ints
    destroyed: Ints  # (worlds,) objects destroyed at once
    found: Ints  # (worlds,) objects found and taken away
