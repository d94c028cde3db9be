"""The scene of a run: the forcing, the physics of each scenario and the place, which do not change while particles move."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.motion.ensemble import Ensemble
from drift.motion.environment_spec import Coast
from drift.motion.forcing import Forcing
from drift.motion.forcing_error import Errors, ForcingError
from drift.motion.scenario import Scenario
from kernels import advance as kernel
from kernels import coast as device_coast


@dataclass(frozen=True)
class Scene:
    """What does not change in a run and every scenario needs to move: forcing, physics, and the place."""

    forcing: Forcing
    physics: tuple[kernel.Physics, ...]  # one a scenario
    place: kernel.Place

    def advance(self, ensemble: Ensemble, low: int, high: int, step: kernel.Step) -> None:
        """Move all slots over one step, in place."""
        self.forcing.set(low, high)
        for move in self._movers(ensemble, step.direction):
            move(step)

    def _movers(self, ensemble: Ensemble, direction: int) -> tuple[kernel.Move, ...]:
        """Return what moves each scenario of an ensemble; made once, and kept with the forcing as long as that is open."""
        key = id(self), id(ensemble), direction
        if key not in self.forcing.movers:
            each = zip(ensemble.scenarios, self.forcing.ranges, self.physics, strict=True)
            made = tuple(
                kernel.mover(ensemble, slots, self.forcing.tiles, ranges, physics, self.place, direction)
                for slots, ranges, physics in each
            )
            self.forcing.movers[key] = (self, ensemble), made  # a name of what is no more could be given again
        moves: tuple[kernel.Move, ...] = self.forcing.movers[key][1]
        return moves

    def without_noise(self) -> "Scene":
        """Return the same scene in which nothing is left to chance, and what comes ashore stays there."""
        still = self.place._replace(beach=kernel.Beach(), sinks=False, divergence=False)
        return replace(self, physics=tuple(kernel.Physics() for _ in self.physics), place=still)


def physics(errors: Errors, scenario: Scenario) -> kernel.Physics:
    """Return a scenario's physics; an error without spread is off."""
    current, wind = errors.current, errors.wind if scenario.object.uses_wind else ForcingError(0.0, 1.0)
    return kernel.Physics(current.std, current.time, wind.std, wind.time, errors.diffusivity, scenario.jibe_rate)


def beach(coast: Coast) -> kernel.Beach:
    """Return what a coast does to a particle."""
    return kernel.Beach(coast.half_life / math.log(2), coast.offing, coast.behaviour == "slide")


def land_of(scene: Scene) -> Callable[[npt.NDArray[Any], npt.NDArray[Any]], npt.NDArray[np.bool_]] | None:
    """Return what says whether points [binary angles] lie on land, asked on the device; None without a coast."""
    coast = scene.place.coast
    return None if coast is None else lambda lon, lat: ~device_coast.wet(coast, lon, lat)
