"""A quantity with a marginal posterior: its name, and how it is read from the particles."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.steering.settled import Settled
from drift.engine.particles.ensemble import Ensemble
from geo.array import Array

# number: a real number; time: [s] after the start of the run; circular: an angle [rad], modulo a
# turn; category: the number of one of a few values.
Kind = Literal["number", "time", "circular", "category"]


class Drawn(NamedTuple):
    """Particles at some time, and what they were drawn from."""

    spec: EnsembleSpec
    ensemble: Ensemble
    scenario: Array  # (n,) int
    settled: Settled | None  # None: nothing steers
    # [s after start] the time, in the step just made: columns of the ensemble are those at its end
    elapsed: int


class Values(NamedTuple):
    """The values of a quantity for all particles."""

    values: Array  # (n,) in SI and radians; of a category, its number
    holds: Array  # (n,) bool: particles that have the quantity


@dataclass(frozen=True)
class Quantity:
    """One entry of drift.evidence.posterior.quantities."""

    name: str  # in files
    heading: str  # of its picture
    kind: Kind
    of: Callable[[Drawn], Values | None]  # None: no particle of the run has it
    unit: str = ""  # in files and pictures
    scale: float = 1.0  # number of these units per SI unit or radian
    # the values of a category, in words
    labels: Callable[[EnsembleSpec], tuple[str, ...]] | None = None
    # whether each scenario has one value, so that rows of single scenarios are not reported
    by_scenario: bool = False
    # whether particles with equal values may differ later
    later: bool = False
