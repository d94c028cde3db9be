"""The result of a budget: areas by coalition of sources, and the figures derived from them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas

from drift.assess.budget import shapley
from drift.assess.budget.consensus import Consensus
from drift.assess.budget.sources import Source
from drift.case.record import Case
from geo.array import Array


@dataclass(frozen=True)
class Estimate:
    """A figure and its standard error (sampling only), of one shape."""

    value: Array
    error: Array


@dataclass(frozen=True, repr=False)
class Budget:
    """The areas of one case with each combination of its sources of spread.

    A coalition is a set of sources that are on, as the bits of a number (source i: 2^i). areas:
    [m2] of all particles, (coalitions, times, shares). batches: the same of each batch of
    particles, (batches, coalitions, times, shares).
    """

    case: Case
    sources: tuple[Source, ...]
    times: tuple[np.datetime64, ...]
    shares: tuple[float, ...]
    particles: int
    areas: Array
    batches: Array
    consensus: Consensus | None  # where models agree; None: there is one model
    left_out: tuple[str, ...] = ()  # evidence of the case that was not used

    def __repr__(self) -> str:
        """Return the title and the figures, as the terminal shows them."""
        from drift.assess.budget import text  # imported here because it imports this module

        lines = [f"  {name}: {words}" for name, words in text.budget_facts(self).items()]
        return "\n".join([f'<drift.Budget "{self.case.title}"', *lines]) + ">"

    @cached_property
    def total(self) -> Estimate:
        """The area [m2] with all sources, (times, shares)."""
        return self._estimate(self.areas[-1], self.batches[:, -1])

    @cached_property
    def share(self) -> Estimate:
        """The Shapley share of each source in the area, (sources, times, shares).

        All shares and `rest` add up to 1.
        """
        return self._estimate(
            shapley.shapley_values(self.areas) / self.areas[-1],
            np.stack([shapley.shapley_values(own) / own[-1] for own in self.batches]),
        )

    @cached_property
    def rest(self) -> Estimate:
        """The share of the area that is left without any source, (times, shares)."""
        return self._estimate(
            self.areas[0] / self.areas[-1], self.batches[:, 0] / self.batches[:, -1]
        )

    @cached_property
    def without(self) -> Estimate:
        """The change of the area without each source, as a share of it, (sources, times, shares)."""
        return self._estimate(
            shapley.without_each(self.areas) / self.areas[-1] - 1,
            np.stack([shapley.without_each(own) / own[-1] - 1 for own in self.batches]),
        )

    @cached_property
    def alone(self) -> Estimate:
        """The area [m2] with each source alone, (sources, times, shares)."""
        return self._estimate(
            shapley.each_alone(self.areas), np.stack([shapley.each_alone(b) for b in self.batches])
        )

    def _estimate(self, value: Array, batches: Array) -> Estimate:
        """Return a figure of all particles; its error comes from the spread between batches."""
        return Estimate(value, batches.std(axis=0, ddof=1) / np.sqrt(len(batches)))

    @property
    def greatest(self) -> Source:
        """The source with the largest share of the largest area at the last time."""
        return self.sources[int(np.argmax(self.share.value[:, -1, -1]))]

    @property
    def table(self) -> pandas.DataFrame:
        """A row for each time, area and source.

        Columns are as those of budget.csv, with areas in [m2].
        """
        rows = []
        for t, time in enumerate(self.times):
            for s, area in enumerate(self.shares):
                for k, source in enumerate(self.sources):
                    figures = {
                        name: figure
                        for name, estimate in (
                            ("share", self.share),
                            ("without", self.without),
                            ("alone_m2", self.alone),
                        )
                        for name, figure in (
                            (name, float(estimate.value[k, t, s])),
                            (f"{name}_standard_error", float(estimate.error[k, t, s])),
                        )
                    }
                    rows.append({"time": time, "area": area, "source": source.key, **figures})
        return pandas.DataFrame(rows).astype({"time": "datetime64[ns]"})
