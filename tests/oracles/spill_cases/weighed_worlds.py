"""Worlds of a spill that are weighed by finds, with rates and losses that are known."""

from typing import Any

import numpy as np
from spills import DAY

from drift.spills.worlds import finds, realisations
from drift.spills.worlds.exposure import Reporting, Walk
from drift.spills.worlds.fates import Fates, Realisation
from drift.spills.worlds.finds import Detection, Numbers, SpillEvidence

RATE, LOSS = 1 / (10 * DAY), 1 / (40 * DAY)


def numbers(
    objects: list[int], shares: list[float] | None = None, destroyed: list[float] | None = None
) -> Numbers:
    shares, destroyed = shares or [1.0], destroyed or [0.0]
    even = [np.full(len(x), 1 / len(x)) for x in (objects, destroyed)]
    return Numbers(np.array(objects), even[0], np.array(shares), np.array(destroyed), even[1])


def known(
    count: Numbers,
    seen: list[Detection],
    patrols: list[Walk],
    worlds: int,
    now: float,
    **other: Any,
) -> SpillEvidence:
    reporting = other.pop("reporting", Reporting(np.full(3, RATE), LOSS, np.ones(worlds)))
    return SpillEvidence(count, tuple(seen), tuple(patrols), reporting, np.full(3, 1e4), now)


def weigh(fates: Fates, told: SpillEvidence, latent: Any = None) -> finds.Posterior:
    return finds.posterior(
        fates,
        told,
        np.zeros((fates.worlds, 0)) if latent is None else latent,
        np.zeros(fates.worlds),
    )


def realised(fates: Fates, told: finds.Posterior, seed: int, count: int) -> list[Realisation]:
    ((_, drawn),) = realisations.realise(fates, told, seed, count)
    return drawn


SEEN = [
    Detection("a", 0, 1, 2 * DAY), Detection("b", 1, 0, 4 * DAY), Detection("c", None, 1, 5 * DAY, latest=True),
    Detection("d", None, 2, 5 * DAY, false=0.4), Detection("e", 0, 1, 6 * DAY, by=0), Detection("f", 0, 1, 6 * DAY),
]  # fmt: skip
SEARCHES = [Walk((0, 1), 6 * DAY, 0.6), Walk((2,), 3 * DAY, 0.8)]
