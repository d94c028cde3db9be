"""Debris that contacts tell of: particles of a class of its own.

They share releases and errors of the forcing with the object's particles, and drift beside them,
slot by slot, until they are last asked for. Where they are reweights the object's particles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.engine.motion import drift, guided, models, prior
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.leeway import Drifter
from drift.engine.motion.scene import Begin, Scene
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter.records import Contact
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.step.advance import Step

# What debris shares with its object when both begin, in addition to the guiding.
SHARED = ("lon", "lat", "release", *drift.ERRORS)


@dataclass
class Debris:
    """Debris of one class: an ensemble that drifts beside the object's, slot by slot.

    It shares releases and errors of the forcing with the object's ensemble.
    """

    ensemble: Ensemble
    scene: Scene
    last: int  # [s after start] when it is last asked for
    start: int  # of the run [s since 1970]
    # numbers of the scenarios whose objects steer before they go adrift
    steered: tuple[int, ...] = ()
    begin: Begin | None = None  # where its particles began the present step

    def advance(self, beside: Ensemble, begin: Begin | None, step: Step) -> None:
        """Move it over the step that the objects beside it have just made.

        begin: where they began the step, and where those that steer went adrift in it: there their
        debris begins.
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
    """Return the debris that contacts tell of, by class; spec: what the objects beside it are drawn
    from.

    resumed: whether its columns come from elsewhere, and need not be drawn. copied: whether
    releases and errors are those of the objects beside it as they stand, rather than drawn by the
    same numbers: so it is where particles are guided.
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
        # Debris drifts, however the object beside it moves.
        drifting = tuple(
            replace(s, object=drifter, model="drift", motion=None, itinerary=None)
            for s in spec.scenarios
        )
        own = replace(spec, scenarios=drifting, guiding=finds)
        if resumed:
            ensemble = prior.empty(own, beside.layout)
        else:
            ensemble = prior.draw_ensemble(own, scene.place.coast, beside.layout).ensemble
            for slots in ensemble.slots:  # coefficients of its own
                drift.draw_leeway(
                    ensemble, slots, noise.key(spec.seed, Purpose.DEBRIS, number), drifter
                )
        if (copied or finds) and not resumed:
            _copy_shared(ensemble, beside, finds)
        if steered and not resumed:  # it goes adrift with its object
            own_release, theirs = ensemble.release.to_numpy(), beside.release.to_numpy()
            later = np.isin(beside.scenario.to_numpy(), steered)
            ensemble.release.from_numpy(np.where(later, theirs, own_release))
        place = scene.place._replace(debris=number)
        moved = replace(
            scene, motions=models.motions(own.errors, own.scenarios), place=place, steering=None
        )
        debris[drifter] = Debris(ensemble, moved, time, spec.period.epoch, steered)
    return debris


def _copy_shared(ensemble: Ensemble, beside: Ensemble, finds: int) -> None:
    """Give debris the releases, the errors and the pulls of the objects beside it."""
    theirs, own = beside.columns, ensemble.columns
    pulls = [name for pair in guided.pull_names(finds) for name in pair]
    for name in (*SHARED, *pulls):
        own[name].from_numpy(theirs[name].to_numpy())
