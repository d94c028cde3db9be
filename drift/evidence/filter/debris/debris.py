"""Debris reported by contacts: particles with a leeway class of their own.

They share releases and forcing errors with the object's particles, and drift beside them, slot by
slot, until their last contact. Their positions reweight the object's particles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.engine.motion import guided, prior
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.models import by_name as models
from drift.engine.motion.models import drift
from drift.engine.motion.objects.leeway import Drifter
from drift.engine.motion.scene import Begin, Scene
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.records import Contact
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.step.advance import Step

# Columns that debris shares with its object at the start, in addition to the pulls that guide it.
SHARED = ("lon", "lat", "release", *drift.ERRORS)


@dataclass
class Debris:
    """Debris of one class: an ensemble that drifts beside the object's, slot by slot.

    It shares releases and forcing errors with the object's ensemble.
    """

    ensemble: Ensemble
    scene: Scene
    last: int  # [s after start] time of its last contact
    start: int  # of the run [s since 1970]
    # numbers of the scenarios whose objects steer before they go adrift
    steered: tuple[int, ...] = ()
    begin: Begin | None = None  # where its particles began the present step

    def advance(self, beside: Ensemble, begin: Begin | None, step: Step) -> None:
        """Move the debris over the step that the objects have just made.

        Args:
            beside: the ensemble of the objects.
            begin: where they began the step, and where steering objects went adrift during it,
                which is where their debris begins.
            step: the step.
        """
        if begin is not None and begin.helm is not None:
            release = beside.release.to_numpy()
            fresh = np.isin(beside.scenario.to_numpy(), self.steered)
            fresh &= (release >= step.elapsed) & (release < step.elapsed + step.duration)
            for own, place in ((self.ensemble.lon, begin.lon), (self.ensemble.lat, begin.lat)):
                own.from_numpy(np.where(fresh, place.to_numpy(), own.to_numpy()))
        low = self.start + step.direction * step.elapsed
        low, high = (low, low + step.duration) if step.direction > 0 else (low - step.duration, low)
        self.begin = self.scene.advance(self.ensemble, low, high, step, keep=True)


def of_contacts(
    spec: EnsembleSpec,
    contacts: Sequence[tuple[int, Contact]],
    scene: Scene,
    beside: Ensemble,
    *,
    resumed: bool = False,
    copied: bool = False,
) -> dict[Drifter, Debris]:
    """Return the debris of all contacts, by class.

    Args:
        spec: what the objects are drawn from.
        contacts: time [s after start] and contact of each; those without a drifter are ignored.
        scene: of the run.
        beside: the ensemble of the objects.
        resumed: whether the columns are loaded later, and need not be drawn.
        copied: whether to copy releases and errors from the objects as they are, instead of drawing
            them with the same random numbers. Guided particles need this.
    """
    finds = 0 if scene.guided is None else scene.guided.finds
    steered = tuple(number for number, scenario in enumerate(spec.scenarios) if scenario.itinerary)
    debris: dict[Drifter, Debris] = {}
    for time, contact in contacts:
        drifter = contact.drifter
        if drifter is None:
            continue
        if drifter in debris:
            debris[drifter].last = max(debris[drifter].last, time)
            continue
        number = len(debris) + 1
        # Debris drifts, whatever the motion model of its object.
        drifting = tuple(
            replace(s, object=drifter, model="drift", motion=None, itinerary=None, changes=())
            for s in spec.scenarios
        )
        own = replace(spec, scenarios=drifting, guiding=finds)
        if resumed:
            ensemble = prior.empty(own, beside.layout)
        else:
            ensemble = prior.draw_ensemble(own, scene.place.coast, beside.layout).ensemble
            for slots in ensemble.slots:  # its own leeway coefficients
                drift.draw_leeway(
                    ensemble, slots, noise.key(spec.seed, Purpose.DEBRIS, number), drifter
                )
        if (copied or finds) and not resumed:
            _copy_shared(ensemble, beside, finds)
        if steered and not resumed:  # it goes adrift when its object does
            own_release, theirs = ensemble.release.to_numpy(), beside.release.to_numpy()
            later = np.isin(beside.scenario.to_numpy(), steered)
            ensemble.release.from_numpy(np.where(later, theirs, own_release))
        place = scene.place._replace(debris=number, changes=())
        moved = replace(
            scene, motions=models.motions(own.errors, own.scenarios), place=place, steering=None
        )
        debris[drifter] = Debris(ensemble, moved, time, spec.period.epoch, steered)
    return debris


def _copy_shared(ensemble: Ensemble, beside: Ensemble, finds: int) -> None:
    """Copy the releases, errors and pulls of the objects to their debris."""
    theirs, own = beside.columns, ensemble.columns
    pulls = [name for pair in guided.pull_names(finds) for name in pair]
    for name in (*SHARED, *pulls):
        own[name].from_numpy(theirs[name].to_numpy())
