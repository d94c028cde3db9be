"""The scene of a run, which does not change while it lasts.

It is the forcing, how each scenario's objects move, and the surroundings.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.motion.forcing import Forcing
from drift.motion.model import Group, Inside, Model, Motion, Waters
from drift.particles.ensemble import Ensemble
from geo.array import Array
from kernels import advance as kernel
from kernels import coast as device_coast
from kernels.sample import Ranges, ordered


@dataclass(frozen=True)
class Scene:
    """What every scenario needs to move: forcing, models with their terms, and the place."""

    forcing: Forcing
    motions: tuple[Motion, ...]  # one a scenario
    place: kernel.Surroundings

    def advance(self, ensemble: Ensemble, low: int, high: int, step: kernel.Step) -> None:
        """Move all slots over one step, in place."""
        self.forcing.set(low, high)
        for move in self._movers(ensemble, step.direction):
            move(step)

    def _movers(self, ensemble: Ensemble, direction: int) -> tuple[kernel.Move, ...]:
        """Return what moves an ensemble, one a group.

        It is made once for a layout of the ensemble, and kept until the forcing is closed.
        """
        key = id(self), id(ensemble), direction
        if key not in self.forcing.movers or self.forcing.movers[key][0][2] is not ensemble.layout:
            movers = tuple(
                model.mover(ensemble, group, Waters(self.forcing.tiles, ranges, self.place), direction)
                for model, ranges, group in self.groups(ensemble)
            )
            # They are kept alive, for an id() may be given again.
            self.forcing.movers[key] = (self, ensemble, ensemble.layout), movers
        moves: tuple[kernel.Move, ...] = self.forcing.movers[key][1]
        return moves

    def groups(self, ensemble: Ensemble) -> list[tuple[Model, Ranges, Group]]:
        """Return the groups of an ensemble's scenarios: those of one model that see the same tiles of the forcing."""
        together: dict[tuple[Model, tuple[int, ...]], list[int]] = {}
        for number, (ranges, motion) in enumerate(zip(self.forcing.ranges, self.motions, strict=True)):
            together.setdefault((motion.model, ordered(ranges)), []).append(number)
        return [
            (model, self.forcing.ranges[own[0]], Group(ensemble.batch(own), tuple(self.motions[k].terms for k in own)))
            for (model, _), own in together.items()
        ]

    def seas(self, quantity: str) -> list[tuple[int, ...]]:
        """Return the numbers of scenarios that see the same sources of a quantity, together."""
        together: dict[tuple[int, int], tuple[int, ...]] = {}
        for number, ranges in enumerate(self.forcing.ranges):
            together[ranges[quantity]] = (*together.get(ranges[quantity], ()), number)
        return list(together.values())

    def without_noise(self) -> "Scene":
        """Return the same scene in which nothing is left to chance, and what comes ashore stays there."""
        still = self.place._replace(beach=kernel.Beach(), sinks=False, divergence=False)
        motions = tuple(Motion(model, model.still(terms)) for model, terms in self.motions)
        return replace(self, motions=motions, place=still)

    def between(self, ensemble: Ensemble, inside: Inside) -> tuple[Array, Array]:
        """Return where an ensemble's particles are at a time inside a step: lon, lat [binary angle], (n,)."""
        lon, lat = inside.before
        for model in dict.fromkeys(model for model, _ in self.motions):
            terms = tuple(terms if own is model else None for own, terms in self.motions)
            mine = np.repeat([own is model for own, _ in self.motions], np.diff(ensemble.bounds))
            there = model.between(ensemble, terms, self.place, inside)
            lon, lat = (np.where(mine, new, old) for new, old in zip(there, (lon, lat), strict=True))
        return lon, lat


def land_of(scene: Scene) -> Callable[[npt.NDArray[Any], npt.NDArray[Any]], npt.NDArray[np.bool_]] | None:
    """Return what says whether points [binary angles] lie on land, asked on the device; None without a coast."""
    coast = scene.place.coast
    return None if coast is None else lambda lon, lat: ~device_coast.wet(coast, lon, lat)
