"""What became of every particle of a spill, and complete simulated spills drawn from them.

A particle of a world is one possible object: N of a world's particles, drawn without replacement, are an exact draw of
the fates of its N objects.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int32]

FOREVER = 2**31 - 1  # [s]


@dataclass(frozen=True)
class Stays:
    """Stays of particles on the shore, one in each row, sorted by slot and arrival; shape (m,)."""

    slot: Ints
    segment: Ints  # number in geo.coast.segments.Segments
    arrival: Ints  # [s after the run's start]
    leave: Ints  # [s after start] when it was afloat again; FOREVER while it lies there at the end of the run


@dataclass(frozen=True)
class Fates:
    """What became of every particle, by slot; shape (n,)."""

    worlds: int
    world: Ints
    kind: Ints  # number of its class of objects
    release: Ints  # [s after start]
    ended: Ints  # [s after start] when it sank, left the domain or ran out of forcing; FOREVER otherwise
    ending: Ints  # drift.particles.status.Status at the end of the run
    stays: Stays


@dataclass(frozen=True)
class Realisation:
    """One complete simulated spill for every world.

    In each world the sum of `stands`, with `destroyed` and `found`, is the number of objects.
    """

    stands: Ints  # (n,) how many objects each slot stands for; 0: not drawn, destroyed or already found
    destroyed: Ints  # (worlds,) lost at once
    found: Ints  # (worlds,) found and taken away
