"""A quantity of which a posterior is told: what it is called, and how it is read from the
particles.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.steering.settled import Settled
from drift.engine.particles.ensemble import Ensemble
from geo.array import Array

# number: on a line; time: [s] after the start of the run; circular: an angle [rad], of which a turn
# more or less is the same; category: the number of one of a few values.
Kind = Literal["number", "time", "circular", "category"]


class Drawn(NamedTuple):
    """Particles as they are at some time, and what they were drawn from."""

    spec: EnsembleSpec
    ensemble: Ensemble
    scenario: Array  # (n,) int
    settled: Settled | None  # None: nothing steers


class Values(NamedTuple):
    """What particles have of a quantity."""

    values: Array  # (n,) in SI and radians; of a category, its number
    holds: Array  # (n,) bool: those for which it means anything


@dataclass(frozen=True)
class Quantity:
    """One entry of drift.evidence.posterior.quantities."""

    name: str  # in files
    heading: str  # of its picture
    kind: Kind
    of: Callable[[Drawn], Values | None]  # None: no particle of the run has it
    unit: str = ""  # in files and pictures
    scale: float = 1.0  # how many of these units an SI unit, or a radian, is
    # the values of a category, in words
    labels: Callable[[EnsembleSpec], tuple[str, ...]] | None = None
    # a category: its value is the scenario's own, and nothing is told of single scenarios
    by_scenario: bool = False
