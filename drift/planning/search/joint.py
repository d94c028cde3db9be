"""Joint detection probability of several sorties, and the gain of one more.

Sorties miss independently, given the unknown factors of the sweep widths; those take joint values
(nodes, k). If the worth of finding falls with time, sorties count in the order of their middle
times. Two at the same time are taken one after the other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import Sortie, Unit
from geo.array import Array

NODES = {0: 1, 1: 6, 2: 4, 3: 3}  # nodes per unknown factor, by number of factors; more: 2
MOST_GROUPS = 6  # most unknown factors; further ones are treated as known


@dataclass(frozen=True)
class Find:
    """Detection probabilities of one sortie."""

    time: float  # [s] middle of the sortie
    chance: Array  # (m, nodes) probability of finding a particle that was not found before
    worth: Array  # (m,) of finding it at that time


def nodes(units: Sequence[Unit | Sortie]) -> tuple[Array, Array]:
    """Return sweep width factors at the joint nodes, and the weights of the nodes.

    Returns:
        Factors, shape (units, nodes), and weights, shape (nodes,).
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
    """Return the mean worth of what sorties find of each particle, shape (m,).

    With a worth of 1 that is the probability of detection.
    """
    return _later(sorted(finds, key=lambda find: find.time)) @ weight


def others(finds: Sequence[Find], time: float, weight: Array, m: int) -> tuple[Array, Array]:
    """Return what the other sorties leave of each particle, and what later ones still add.

    Args:
        finds: of the other sorties.
        time: middle of the sortie in question [s].
        weight: of the nodes, shape (nodes,).
        m: number of particles.

    Returns:
        Probability of being missed before `time`, times the nodes' weights, and the worth of what
            later sorties find; both of shape (m, nodes).
    """
    ordered = sorted(finds, key=lambda find: find.time)
    before = np.broadcast_to(weight, (m, len(weight))).copy()
    for find in ordered:
        if find.time < time:
            before *= 1 - find.chance
    later = [find for find in ordered if find.time >= time]
    return before, _later(later) if later else np.zeros((m, len(weight)))


def by_factor(factor: Array, before: Array, later: Array) -> tuple[Array, Array, Array]:
    """Return what others leave, at the distinct sweep width factors of one unit.

    Joint nodes at which its factor is the same are summed up: a unit with a factor of its own has
    three of them in a plan with 27.

    Args:
        factor: of the unit's sweep width at the joint nodes, shape (nodes,).
        before: remaining weight, shape (m, nodes), as of `others`.
        later: worth of what later sorties find, (m, nodes); its mean over equal factors is
            returned, weighted with `before`.

    Returns:
        Distinct factors, shape (k,); `before` and `later` at these, shape (m, k).
    """
    distinct, which = np.unique(factor, return_inverse=True)
    same = (which[:, None] == np.arange(len(distinct))).astype(np.float64)
    left, worth = before @ same, (before * later) @ same
    return distinct, left, np.divide(worth, left, out=np.zeros_like(left), where=left > 0)


def _later(ordered: Sequence[Find]) -> Array:
    """Return the worth of what sorties find, in their order, shape (m, nodes)."""
    last = ordered[-1]
    total = (last.chance * last.worth[:, None]).astype(np.float64)
    for find in ordered[-2::-1]:
        total = find.chance * find.worth[:, None] + (1 - find.chance) * total
    return total
