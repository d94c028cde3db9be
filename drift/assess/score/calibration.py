"""Are forecasts calibrated? Tests of the containment at many finds.

If forecasts are right, the containment at the find is uniform from 0 to 1 (it is the probability
integral transform of the density's rank: drift.assess.verify.scores). So an area of 90 % holds nine
finds of ten.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from drift.assess.score.incident import Incident
from drift.tracking.tracks import clusters
from drift.tracking.tracks.clusters import Estimate
from geo import notation
from geo.array import Array

SHARES = (0.5, 0.75, 0.9, 0.95)
CONFIDENCE = 0.95  # of the intervals of shares
DAY = 86_400.0


@dataclass(frozen=True)
class Held:
    """How often the area of a share held the find."""

    share: float  # stated
    count: int  # of the finds, inside
    of: int
    low: float  # ends of the exact 95 % interval (Clopper and Pearson 1934)
    high: float
    p: float  # of a count as unlikely as this one, if the area is right (two-sided, exact)


@dataclass(frozen=True, repr=False)
class Score:
    """The scores of past cases, and how well their forecasts were calibrated."""

    incidents: tuple[Incident, ...]

    def __repr__(self) -> str:
        """Return the figures, as the terminal shows them."""
        from drift.assess.score import text  # imported here because it imports this module

        lines = [f"  {name}: {words}" for name, words in text.score_facts(self).items()]
        return "\n".join([f"<drift.Score of {len(self.incidents)} finds", *lines]) + ">"

    @property
    def containment(self) -> Array:
        """Containment at each find, (n,)."""
        return np.array([incident.containment for incident in self.incidents])

    @property
    def held(self) -> tuple[Held, ...]:
        """How often the area of each of SHARES held the find."""
        return tuple(count_held(self.containment, share) for share in SHARES)

    @property
    def uniform(self) -> tuple[float, float]:
        """Kolmogorov's distance of the containments from a uniform distribution, and its p."""
        return kolmogorov(self.containment)

    def mean(self, values: Array, *, share: bool = False) -> Estimate:
        """Return the mean of values by incident, (n,), with an error clustered by day.

        Incidents of one day share the weather and its errors.
        """
        days = np.array([notation.epoch(one.find.time) // DAY for one in self.incidents])
        return clusters.mean(values, np.arange(len(days)), days, share=share)


def count_held(containment: Array, share: float) -> Held:
    """Return how often an area held the find.

    Args:
        containment: at each find, (n,).
        share: stated for the area.
    """
    count, of = int((containment <= share).sum()), len(containment)
    test = stats.binomtest(count, of, share)
    low, high = test.proportion_ci(CONFIDENCE, method="exact")
    return Held(share, count, of, float(low), float(high), float(test.pvalue))


def kolmogorov(containment: Array) -> tuple[float, float]:
    """Return Kolmogorov's distance from a uniform distribution, and its p (exact).

    containment: at each find, (n,).
    """
    found = stats.kstest(containment, "uniform", method="exact")
    return float(found.statistic), float(found.pvalue)


def band(count: int) -> float:
    """Return Kolmogorov's distance that 5 % of calibrated sets of `count` finds exceed."""
    return float(stats.kstwo.ppf(1 - 0.05, count))


def verdict(score: Score) -> str:
    """Return what the finds say about the sizes of the areas."""
    _, p = score.uniform
    if len(score.incidents) < 2:
        return "one find says almost nothing about calibration"
    if p >= 0.05:
        return f"the finds do not contradict the areas (p = {p:.2g})"
    if np.mean(score.containment) > 0.5:
        return (
            f"the areas hold fewer finds than they state (p = {p:.2g}): they are too small, or "
            "in the wrong place"
        )
    return f"the areas hold more finds than they state (p = {p:.2g}): they are too large"
