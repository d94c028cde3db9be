"""What several sorties find together of the same particles, and what one more would add to the
others.

Sorties miss independently given the unknown factors of the sweep widths; those are taken at joint
nodes (k). With what finding is worth falling in time, sorties count in the order of their middles:
two at the same time are taken one after the other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import Unit
from geo.array import Array

NODES = {0: 1, 1: 6, 2: 4, 3: 3}  # of each unknown factor, by how many there are; more: 2
MOST_GROUPS = 6  # unknown factors that are treated as such; further ones count as known


@dataclass(frozen=True)
class Find:
    """What one sortie finds."""

    time: float  # [s] its middle
    chance: Array  # (m, nodes) of finding each particle, given that it was not found before
    worth: Array  # (m,) of finding it then


def nodes(units: Sequence[Unit]) -> tuple[Array, Array]:
    """Return each unit's factor of sweep width at the joint nodes, (units, nodes), and their
    weights, (nodes,).
    """
    names = [unit.group or unit.name for unit in units]
    groups = list(
        dict.fromkeys(n for n, unit in zip(names, units, strict=True) if math.isfinite(unit.shape))
    )[:MOST_GROUPS]
    count = NODES.get(len(groups), 2)
    factor, weight = np.ones((len(units), 1)), np.ones(1)
    for group in groups:
        shape = next(unit.shape for n, unit in zip(names, units, strict=True) if n == group)
        at, chance = laws.factors(shape, count)
        own = np.array([n == group for n in names])[:, None, None]
        factor = (factor[:, :, None] * np.where(own, at, 1.0)).reshape(len(units), -1)
        weight = np.outer(weight, chance).ravel()
    return factor, weight


def worth(finds: Sequence[Find], weight: Array) -> Array:
    """Return what finding is worth on average, for each particle (m,): for POS, its chance of being
    found.
    """
    return _later(sorted(finds, key=lambda find: find.time)) @ weight


def others(finds: Sequence[Find], time: float, weight: Array, m: int) -> tuple[Array, Array]:
    """Return what is left of each particle at a time, and what later sorties still bring, both (m,
    nodes).

    What is left is multiplied by the nodes' weights.
    """
    ordered = sorted(finds, key=lambda find: find.time)
    before = np.broadcast_to(weight, (m, len(weight))).copy()
    for find in ordered:
        if find.time < time:
            before *= 1 - find.chance
    later = [find for find in ordered if find.time >= time]
    return before, _later(later) if later else np.zeros((m, len(weight)))


def _later(ordered: Sequence[Find]) -> Array:
    total = np.zeros(ordered[0].chance.shape)
    for find in reversed(ordered):
        total = find.chance * find.worth[:, None] + (1 - find.chance) * total
    return total
