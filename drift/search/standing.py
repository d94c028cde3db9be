"""How a search stands after an update: when the object went adrift, as the weights tell it, and what was never searched.

What it takes to say how likely somebody is alive at any time, of millions of particles, in a few numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geo.array import Array

BINS = 400  # of release times: a thousandth of a window of 40 h is 6 minutes, and each has its own mean


@dataclass(frozen=True)
class Standing:
    """Particles by scenario and time of release, given all that was seen; S scenarios, B bins."""

    time: np.datetime64
    release: Array  # [s after start] mean of each bin, (S, B)
    mass: Array  # probability, (S, B); adds up to 1
    never: Array  # probability of having been where no sortie searched, given each scenario, then of all; (S + 1,)
    effective: float  # particles that all this stands on


def standing(
    time: np.datetime64,
    weight: Array,
    release: Array,
    slots: Sequence[tuple[int, int]],
    never: Array | None,
    effective: float,
) -> Standing:
    """Return how a search stands by its particles' weights, release times [s after start] and shares never searched (n,)."""
    first, last = float(release.min()), float(release.max())
    bins = np.minimum(((release - first) / max(last - first, 1.0) * BINS).astype(np.int64), BINS - 1)
    total = weight.sum()
    mass, when, free = np.zeros((len(slots), BINS)), np.zeros((len(slots), BINS)), np.ones(len(slots))
    for s, (a, b) in enumerate(slots):
        mass[s] = np.bincount(bins[a:b], weight[a:b], BINS)
        when[s] = np.bincount(bins[a:b], weight[a:b] * release[a:b], BINS)
        if never is not None and mass[s].sum() > 0:
            free[s] = float(weight[a:b] @ never[a:b]) / mass[s].sum()
    when = np.divide(when, mass, out=np.full_like(when, first), where=mass > 0)
    share = mass / total
    return Standing(time, when, share, np.append(free, share.sum(axis=1) @ free), effective)
