"""Scenarios by rank: posterior probability, and its ratio to the prior.

The effective number of scenarios is exp(-sum p ln p), by the entropy of their probabilities: n for
n equally likely scenarios.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.engine.motion.steering import family
from drift.engine.motion.steering.family import Along
from drift.evidence.posterior.records import Posteriors
from drift.forecast import likeliest
from drift.forecast.likeliest import Shown
from drift.products.files import formats
from geo.array import Array

AXIS = "axis "  # prefix of the column of an axis


@dataclass(frozen=True)
class Ranking:
    """The scenarios of a run, before the first update and after the last.

    Arrays are (scenarios,), in the order of the case.
    """

    posteriors: Posteriors
    prior: Array
    posterior: Array

    @property
    def order(self) -> npt.NDArray[np.int64]:
        """The numbers of the scenarios by posterior, the likeliest first; ties are by prior."""
        return np.lexsort((-self.prior, -self.posterior))

    @property
    def factor(self) -> Array:
        """Posterior over prior of each scenario; NaN without prior."""
        none = np.full(len(self.prior), np.nan)
        return np.asarray(np.divide(self.posterior, self.prior, out=none, where=self.prior > 0))

    @property
    def shown(self) -> Shown:
        """The scenarios that are shown separately: the likeliest in the end."""
        return likeliest.likeliest_scenarios(self.posterior)

    @property
    def words(self) -> str:
        """The number of scenarios and the effective number, in words."""
        before, now = (
            family.effective_scenarios(values) for values in (self.prior, self.posterior)
        )
        return f"{len(self.prior):,} scenarios, {now:.3g} of them effective now, {before:.3g} before the first update"

    @property
    def axes(self) -> list[Along]:
        """The axes of families along which they differ."""
        return family.axes_of_scenarios(self.posteriors.families)


def ranking_of(posteriors: Posteriors) -> Ranking | None:
    """Return the ranking of a run's scenarios.

    Return None with a single scenario or without updates.
    """
    first, last = posteriors.stages[0], posteriors.stages[-1]
    if len(posteriors.scenarios) < 2 or first is last:
        return None
    return Ranking(posteriors, np.nan_to_num(first.scenarios), np.nan_to_num(last.scenarios))


def csv(ranking: Ranking, run: str) -> str:
    """Return the CSV of scenarios, the likeliest first.

    `factor` is posterior over prior, and `cumulative` the probability of all scenarios up to this
    one. After these, there is one column for each axis of families.

    Args:
        ranking: of the run.
        run: the run_id for the last column.
    """
    axes, families, factor = ranking.axes, ranking.posteriors.families, ranking.factor
    rows, order = [], ranking.order
    for rank, (k, total) in enumerate(
        zip(order.tolist(), np.cumsum(ranking.posterior[order]), strict=True), 1
    ):
        place = families[k]
        values = {
            AXIS + axis.axis.name: axis.axis.labels[axis.number[k]] if axis.number[k] >= 0 else ""
            for axis in axes
        }
        rows.append(
            {
                "rank": rank,
                "scenario": ranking.posteriors.scenarios[k],
                "family": place.family.name if place else "",
                "prior": ranking.prior[k],
                "posterior": ranking.posterior[k],
                "factor": factor[k],
                "cumulative": total,
                **values,
            }
        )
    return formats.csv_rows(rows, run=run, digits=".7g")


def summary_of_ranking(ranking: Ranking) -> dict[str, Any]:
    """Return the ranking for the summary: effective numbers, and probabilities on each axis."""
    before, now = (
        family.effective_scenarios(ranking.prior),
        family.effective_scenarios(ranking.posterior),
    )
    axes = {}
    for along in ranking.axes:
        shares = zip(
            along.axis.labels,
            along.shares(ranking.prior).tolist(),
            along.shares(ranking.posterior).tolist(),
            strict=True,
        )
        axes[along.axis.name] = {
            label: {"prior": prior, "posterior": posterior} for label, prior, posterior in shares
        }
    return {
        "number": len(ranking.prior),
        "effective": {"prior": before, "posterior": now},
        "entropy_bit": {"prior": float(np.log2(before)), "posterior": float(np.log2(now))},
        "axes": axes,
    }


def _text(value: float) -> str:
    return f"{float(value):.7g}" if np.isfinite(value) else ""
