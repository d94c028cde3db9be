"""Records of posteriors: quantities, and their distributions before and after each update."""

from dataclasses import dataclass

import numpy as np

from drift.engine.motion.period import Period
from drift.engine.motion.steering.family import InFamily
from drift.evidence.posterior.marginal import Marginal
from drift.evidence.posterior.quantity import Quantity
from geo.array import Array


@dataclass(frozen=True)
class RangedQuantity:
    """A quantity with its range in one run."""

    quantity: Quantity
    low: float  # begin of its histogram in SI; 0 to 2 pi for an angle, unused for a category
    high: float
    labels: tuple[str, ...] = ()  # of a category's values


@dataclass(frozen=True)
class Stage:
    """The distributions before the first update, or after one of them."""

    number: int  # of the update, 0: before the first
    name: str
    kind: str  # "prior", or the kind of update
    time: np.datetime64  # UTC
    ess: float  # effective number of all particles
    scenarios: Array  # (scenarios,) probability of each
    marginals: tuple[Marginal, ...]  # one per quantity


@dataclass(frozen=True)
class Posteriors:
    """All posteriors of one run."""

    scenarios: tuple[str, ...]
    period: Period  # of the run; times are relative to its start
    told: tuple[RangedQuantity, ...]
    stages: tuple[Stage, ...]  # the first is the prior
    families: tuple[InFamily | None, ...] = ()  # (scenarios,) position of each in its family
