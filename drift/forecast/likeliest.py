"""Selects the ten likeliest scenarios for maps and pictures; the rest are shown as one.

Tables and time series list every scenario.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geo.array import Array

MOST = 10  # scenarios displayed individually where there are more


@dataclass(frozen=True)
class Shown:
    """Scenarios displayed individually, out of `many`; the rest are displayed as one."""

    alone: tuple[int, ...]  # their numbers, ascending
    many: int

    @property
    def rest(self) -> tuple[int, ...]:
        """The numbers of the scenarios that are not displayed individually."""
        return tuple(sorted({*range(self.many)} - {*self.alone}))

    @property
    def size(self) -> int:
        """Number of entries displayed; the rest count as one."""
        return len(self.alone) + (len(self.alone) < self.many)

    @property
    def place(self) -> npt.NDArray[np.int64]:
        """The entry of each scenario, (many,); the last entry is the rest."""
        place = np.full(self.many, len(self.alone))
        place[list(self.alone)] = np.arange(len(self.alone))
        return place

    def names(self, names: Sequence[str]) -> list[str]:
        """Return the names of the entries."""
        others = [f"{self.many - len(self.alone)} others"] if self.size > len(self.alone) else []
        return [str(names[number]) for number in self.alone] + others

    def sums(self, values: Array) -> Array:
        """Return values by scenario (..., many), summed over the rest: (..., size)."""
        own = values[..., list(self.alone)]
        others = values[..., list(self.rest)].sum(axis=-1, keepdims=True)
        return np.concatenate([own, others], axis=-1) if self.rest else own

    def means(self, values: Array, weight: Array) -> Array:
        """Return means by scenario, averaged over the rest by weight (many,), 0 where that has no
        weight.
        """
        rest, heavy = list(self.rest), weight[list(self.rest)]
        own = values[..., list(self.alone)]
        mean = (values[..., rest] * heavy).sum(axis=-1, keepdims=True) / max(
            float(heavy.sum()), 1e-300
        )
        return np.concatenate([own, mean], axis=-1) if rest else own


def likeliest_scenarios(probability: npt.ArrayLike) -> Shown:
    """Return which scenarios are displayed, from their probabilities at some times, (...,
    scenarios).

    The largest value over time decides, so that a scenario that was likely before it was ruled out
    is displayed. A single remaining scenario is displayed too.
    """
    table = np.asarray(probability, np.float64)
    many = table.shape[-1]
    if many <= MOST + 1:
        return Shown(tuple(range(many)), many)
    largest = table.reshape(-1, many).max(axis=0)
    return Shown(tuple(sorted(np.argsort(-largest, kind="stable")[:MOST].tolist())), many)
