"""Members of an ensemble of forcings: which of them each particle drifts in, for its life.

They are dealt in runs of slots that follow each other, so that neighbours read the same winds and
currents, and a part of the particles (a shard of a run) needs few members. Where there are enough
slots a run is made of whole blocks.
"""

import numpy as np

from drift.engine.particles import partials
from drift.engine.particles.ensemble import Column, Ensemble
from geo.array import Array

COLUMN = Column("member", np.int32, 0, "", "member of the ensemble of forcings in which it drifts")
# blocks a member from which runs are whole blocks: then no member has an eighth more slots than
# another
ENOUGH = 8


def ends(count: int, members: int, block: int = partials.BLOCK) -> Array:
    """Return how many of so many slots the members up to and with each have together, (members,).

    Each has some if count >= members.
    """
    unit = block if count >= ENOUGH * members * block else 1
    after = np.arange(1, members + 1) * (count // unit) // members * unit
    after[-1] = count
    return np.asarray(after)


def deal(count: int, members: int, block: int = partials.BLOCK) -> Array:
    """Return the member of each of so many slots, int32 (count,), ascending."""
    return np.repeat(
        np.arange(members, dtype=np.int32), np.diff(ends(count, members, block), prepend=0)
    )


def even(member: Array, members: int) -> Array:
    """Return the logarithm of what each slot weighs so that members are equally likely, float64
    (n,), of sum 1.
    """
    counts = np.bincount(member, minlength=members)
    return np.asarray(-np.log(members) - np.log(counts[member]))


def member_of_particles(ensemble: Ensemble) -> Array | None:
    """Return the member of each particle, int32 (n,); None where there is no ensemble of forcings."""
    column = ensemble.own.get(COLUMN.name)
    return None if column is None else np.asarray(column.to_numpy())
