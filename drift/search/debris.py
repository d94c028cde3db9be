"""Debris that contacts tell of: particles of a class of its own.

They share releases and errors of the forcing with the object's particles, and drift beside them, slot by slot, until
they are last asked for. Where they are reweights the object's particles.
"""

from dataclasses import dataclass, replace

from drift.motion import drift, models, prior
from drift.motion.ensemble_spec import EnsembleSpec
from drift.motion.leeway import Drifter
from drift.motion.scene import Begin, Scene
from drift.particles.ensemble import Ensemble
from drift.search.records import Contact
from kernels import noise
from kernels.noise import Purpose


@dataclass
class Debris:
    """Debris of one class: an ensemble that drifts beside the object's, slot by slot.

    It shares releases and errors of the forcing with the object's ensemble.
    """

    ensemble: Ensemble
    scene: Scene
    last: int  # [s after start] when it is last asked for
    begin: Begin | None = None  # where its particles began the present step


def of_contacts(spec: EnsembleSpec, contacts: list[tuple[int, Contact]], scene: Scene) -> dict[Drifter, Debris]:
    """Return the debris that contacts tell of, by class; spec: what the objects beside it are drawn from."""
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
        drifting = tuple(replace(s, object=drifter, model="drift", motion=None) for s in spec.scenarios)
        own = replace(spec, scenarios=drifting)
        ensemble = prior.draw(own, scene.place.coast).ensemble
        for slots in ensemble.slots:  # coefficients of its own
            drift.draw_leeway(ensemble, slots, noise.key(spec.seed, Purpose.DEBRIS, number), drifter)
        place = scene.place._replace(debris=number)
        moved = replace(scene, motions=models.motions(own.errors, own.scenarios), place=place)
        debris[drifter] = Debris(ensemble, moved, time)
    return debris
