"""The specification of a run's ensemble: scenarios, number of particles, and forcing errors."""

from dataclasses import dataclass

from drift.engine.motion.errors.forcing_error import Errors
from drift.engine.motion.objects.leeway import Drifter
from drift.engine.motion.period import Period
from drift.engine.motion.scenario import Scenario


@dataclass(frozen=True)
class Release:
    """Variation of a spill's objects about the scenario; all its classes are released together."""

    release_std: float  # [m] standard deviation of an object's release about its world's
    windage_bias: float  # standard deviation of the logarithm of a factor on all leeway


@dataclass(frozen=True)
class EnsembleSpec:
    """The specification from which an ensemble is drawn.

    The scenarios of a spill are its classes of objects, all with the same prior.
    """

    period: Period
    scenarios: tuple[Scenario, ...]
    errors: Errors
    particles: int
    seed: int
    # How particles are resampled (drift.engine.particles.resample.METHODS), which may need slots to
    # spare; None: never.
    resampling: str | None = None
    debris: tuple[Drifter, ...] = ()  # debris that drifts with the objects and is found by contacts
    release: Release | None = None  # only of a spill
    counts: tuple[int, ...] | None = None  # particles of each scenario; None: by their weights
    # names of the forcing ensemble's members; empty: there is no ensemble
    members: tuple[str, ...] = ()
    # finds of debris toward which particles are guided: drift.evidence.filter.debris.guide
    guiding: int = 0
    # buoys on scene, and states of the errors at them: drift.engine.motion.errors.buoys
    buoys: tuple[int, int] = (0, 0)

    @property
    def story(self) -> str:
        """The user's word for a scenario; in a spill it is a class of objects."""
        return "class" if self.release else "scenario"

    @property
    def drifters(self) -> list[Drifter]:
        """All drifting objects: those of the scenarios, then the debris."""
        return [*(scenario.object for scenario in self.scenarios), *self.debris]
