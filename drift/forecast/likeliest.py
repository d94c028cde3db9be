"""Which of many scenarios maps and pictures show by themselves: the likeliest ten; all others they
show together.

Tables of rows and what is kept of each time list every scenario.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geo.array import Array

MOST = 10  # scenarios shown by themselves where there are others to show together


@dataclass(frozen=True)
class Shown:
    """Scenarios that are shown by themselves, and how many there are of all; the others are shown
    as one.
    """

    alone: tuple[int, ...]  # their numbers, ascending
    many: int

    @property
    def rest(self) -> tuple[int, ...]:
        """The numbers of the others."""
        return tuple(sorted({*range(self.many)} - {*self.alone}))

    @property
    def size(self) -> int:
        """How many are shown, the others as one."""
        return len(self.alone) + (len(self.alone) < self.many)

    @property
    def place(self) -> npt.NDArray[np.int64]:
        """The place of each scenario among those that are shown, (many,); the others have the last."""
        place = np.full(self.many, len(self.alone))
        place[list(self.alone)] = np.arange(len(self.alone))
        return place

    def names(self, names: Sequence[str]) -> list[str]:
        """Return the names of those that are shown."""
        others = [f"{self.many - len(self.alone)} others"] if self.size > len(self.alone) else []
        return [str(names[number]) for number in self.alone] + others

    def sums(self, values: Array) -> Array:
        """Return values by scenario (..., many), added up over the others: (..., size)."""
        own = values[..., list(self.alone)]
        others = values[..., list(self.rest)].sum(axis=-1, keepdims=True)
        return np.concatenate([own, others], axis=-1) if self.rest else own

    def means(self, values: Array, weight: Array) -> Array:
        """Return the same of means: that of the others is weighted, 0 where they have no weight;
        weight: (many,).
        """
        rest, heavy = list(self.rest), weight[list(self.rest)]
        own = values[..., list(self.alone)]
        mean = (values[..., rest] * heavy).sum(axis=-1, keepdims=True) / max(
            float(heavy.sum()), 1e-300
        )
        return np.concatenate([own, mean], axis=-1) if rest else own


def likeliest_scenarios(probability: npt.ArrayLike) -> Shown:
    """Return which scenarios are shown, by the probability that each has at some times, (...,
    scenarios).

    The largest over the times counts, so that a scenario is shown that was likely before something
    ruled it out. Where there would be one other alone, it is shown too.
    """
    table = np.asarray(probability, np.float64)
    many = table.shape[-1]
    if many <= MOST + 1:
        return Shown(tuple(range(many)), many)
    largest = table.reshape(-1, many).max(axis=0)
    return Shown(tuple(sorted(np.argsort(-largest, kind="stable")[:MOST].tolist())), many)
