"""Forcing ensemble members: each particle drifts in one member for its whole life.

Members are assigned to runs of consecutive slots. Neighbouring particles then read the same winds
and currents, and a shard of a run needs few members. Where there are enough slots, runs are whole
blocks.
"""

import numpy as np

from drift.engine.particles import partials
from drift.engine.particles.ensemble import Column, Ensemble
from geo.array import Array

COLUMN = Column("member", np.int32, 0, "", "forcing ensemble member in which it drifts")
# blocks a member from which runs are whole blocks: then no member has an eighth more slots than
# another
ENOUGH = 8


def ends(count: int, members: int, block: int = partials.BLOCK) -> Array:
    """Return the cumulative number of slots up to and including each member, (members,).

    Every member has at least one slot if count >= members.
    """
    unit = block if count >= ENOUGH * members * block else 1
    after = np.arange(1, members + 1) * (count // unit) // members * unit
    after[-1] = count
    return np.asarray(after)


def deal(count: int, members: int, block: int = partials.BLOCK) -> Array:
    """Return the member of each of `count` slots, int32 (count,), ascending."""
    return np.repeat(
        np.arange(members, dtype=np.int32), np.diff(ends(count, members, block), prepend=0)
    )


def even(member: Array, members: int) -> Array:
    """Return log weights that make all members equally likely, float64 (n,); the weights add up to
    1.
    """
    counts = np.bincount(member, minlength=members)
    return np.asarray(-np.log(members) - np.log(counts[member]))


def member_of_particles(ensemble: Ensemble) -> Array | None:
    """Return the member of each particle, int32 (n,); None if the run has no forcing ensemble."""
    column = ensemble.own.get(COLUMN.name)
    return None if column is None else np.asarray(column.to_numpy())
