"""What the ensemble of a run is drawn from.

That is its scenarios, how many particles they have, and how wrong the forcing may be.
"""

from dataclasses import dataclass

from drift.engine.motion.forcing_error import Errors
from drift.engine.motion.leeway import Drifter
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import Scenario


@dataclass(frozen=True)
class Release:
    """How far the objects of a spill depart from what its scenarios say.

    The classes of a spill go adrift together.
    """

    release_std: float  # [m] standard deviation of an object's release about its world's
    windage_bias: float  # standard deviation of the logarithm of a factor on all leeway


@dataclass(frozen=True)
class EnsembleSpec:
    """What an ensemble is drawn from.

    The scenarios of a spill are its classes of objects, all with one prior.
    """

    period: Period
    scenarios: tuple[Scenario, ...]
    errors: Errors
    particles: int
    seed: int
    # How particles are resampled (drift.engine.particles.resample.METHODS), which may need slots to
    # spare; None: never.
    resampling: str | None = None
    debris: tuple[Drifter, ...] = ()  # what drifts beside the objects, and is reported by contacts
    release: Release | None = None  # only of a spill
    counts: tuple[int, ...] | None = None  # particles of each scenario; None: by their weights
    # what the members of an ensemble of forcings are called; empty: there is none
    members: tuple[str, ...] = ()
    # finds of debris toward which particles are guided: drift.evidence.filter.debris.guide
    guiding: int = 0

    @property
    def story(self) -> str:
        """What users call a scenario: in a spill it is a class of objects."""
        return "class" if self.release else "scenario"

    @property
    def drifters(self) -> list[Drifter]:
        """All that drifts: the scenarios' objects, then the debris."""
        return [*(scenario.object for scenario in self.scenarios), *self.debris]
