"""What the ensemble of a run is drawn from: stories, how many particles tell them, and how wrong the forcing may be."""

from dataclasses import dataclass

from drift.motion.forcing_error import Errors
from drift.motion.leeway import Drifter
from drift.motion.period import Period
from drift.motion.scenario import Scenario


@dataclass(frozen=True)
class Release:
    """How far the objects of a spill, whose classes go adrift together, part from what the scenarios say of them."""

    release_std: float  # [m] standard deviation of an object's release about its world's
    windage_bias: float  # standard deviation of the logarithm of a factor on all leeway


@dataclass(frozen=True)
class EnsembleSpec:
    """What an ensemble is drawn from. The scenarios of a spill are its classes of objects, all with one prior."""

    period: Period
    scenarios: tuple[Scenario, ...]
    errors: Errors
    particles: int
    seed: int
    resampling: str | None = (
        None  # way to draw particles anew (drift.particles.resample.METHODS), which may need slots to spare; None: never
    )
    debris: tuple[Drifter, ...] = ()  # what drifts beside the objects: contacts tell of it
    release: Release | None = None  # of a spill

    @property
    def story(self) -> str:
        """What users call a scenario: in a spill it is a class of objects."""
        return "class" if self.release else "scenario"

    @property
    def drifters(self) -> list[Drifter]:
        """All that drifts: the scenarios' objects, then the debris."""
        return [*(scenario.object for scenario in self.scenarios), *self.debris]
