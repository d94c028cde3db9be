"""Debris that contacts tell of: particles of its own class that share releases and errors of the forcing with the object's.

They drift beside the object's, slot by slot, until they are last asked for; where they are reweights the object's.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy.typing as npt

from drift.motion import prior
from drift.motion.ensemble import Ensemble
from drift.motion.ensemble_spec import EnsembleSpec
from drift.motion.leeway import Drifter
from drift.motion.scene import Scene, physics
from drift.search.records import Contact
from kernels import noise

Array = npt.NDArray[Any]

APART = 2**56  # between the seeds of an object's own coefficients and those of each class of its debris


@dataclass
class Debris:
    """Debris of one class: an ensemble that shares releases and errors of the forcing with the object's, slot by slot."""

    ensemble: Ensemble
    scene: Scene
    last: int  # [s after start] when it is last asked for
    before: tuple[Array, Array] | None = None


def of_contacts(spec: EnsembleSpec, contacts: list[tuple[int, Contact]], scene: Scene) -> dict[Drifter, Debris]:
    """Return the debris that contacts tell of, by class; spec: what the objects beside it are drawn from."""
    found: dict[Drifter, Debris] = {}
    for time, contact in contacts:
        drifter = contact.drifter
        if drifter is None:
            continue
        if drifter in found:
            found[drifter].last = max(found[drifter].last, time)
            continue
        number = len(found) + 1
        told = replace(spec, scenarios=tuple(replace(s, object=drifter) for s in spec.scenarios))
        ensemble = prior.draw(told, scene.place.coast).ensemble
        for slots in ensemble.scenarios:  # coefficients of its own
            prior.equip(ensemble, slots, noise.key((spec.seed + number * APART) % 2**64), drifter)
        place = scene.place._replace(debris=number)
        moved = replace(scene, physics=tuple(physics(told.errors, s) for s in told.scenarios), place=place)
        found[drifter] = Debris(ensemble, moved, time)
    return found
