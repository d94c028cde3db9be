"""What is told of posteriors: the quantities, and their distributions before the first and after
each update.
"""

from dataclasses import dataclass

import numpy as np

from drift.engine.motion.period import Period
from drift.engine.motion.steering.family import InFamily
from drift.evidence.posterior.marginal import Marginal
from drift.evidence.posterior.quantity import Quantity
from geo.array import Array


@dataclass(frozen=True)
class Told:
    """A quantity as it is in one run."""

    quantity: Quantity
    low: float  # ends of its histogram, in SI; of an angle a turn from 0, of a category unused
    high: float
    labels: tuple[str, ...] = ()  # of a category's values


@dataclass(frozen=True)
class Stage:
    """What was known before the first update, or after one of them."""

    number: int  # of the update, 0: before the first
    name: str
    kind: str  # "prior", or what kind of update
    time: np.datetime64  # UTC
    ess: float  # effective number of all particles
    scenarios: Array  # (scenarios,) probability of each
    marginals: tuple[Marginal, ...]  # one a quantity


@dataclass(frozen=True)
class Posteriors:
    """All that is told of one run."""

    scenarios: tuple[str, ...]
    period: Period  # from whose start times count
    told: tuple[Told, ...]
    stages: tuple[Stage, ...]  # the first is the prior
    families: tuple[InFamily | None, ...] = ()  # (scenarios,) where each stands in its family
