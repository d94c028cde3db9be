"""Motion models: the extra particle columns of each and the functions that move particles.

A model is a record of functions. To add one, write a file in this package, a kernel in `kernels/`,
and a line in drift.engine.motion.models.by_name. For a velocity by current, wind and waves a file in
`kernels/drift_models/` suffices (drift.engine.motion.models.own_model). Each scenario uses one model.
Scenarios with the same model and the same forcing form a group, which is moved by one kernel launch
per step.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from drift.engine.motion.errors.forcing_error import Errors
from drift.engine.motion.scenario import Scenario
from drift.engine.particles.ensemble import Column, Ensemble, Slots
from kernels.runtime.batch import Batch
from kernels.step import advance as kernel
from kernels.step.bridge import Inside
from kernels.step.sample import Ranges, Tiles

Key = tuple[int, int]  # key of random numbers: kernels.maths.noise.key
# a scenario's parameters for the model's kernel; only the model reads them
Terms = Any


class Waters(NamedTuple):
    """The surroundings of a group: forcing tiles, the range of tiles of each quantity, domain and
    coast.
    """

    tiles: Tiles
    ranges: Ranges  # first and last tile by quantity
    place: kernel.Surroundings


class Group(NamedTuple):
    """Scenarios moved by one kernel launch: same model, same forcing."""

    batch: Batch  # scenario numbers and slots
    terms: tuple[Terms, ...]  # of each scenario


@dataclass(frozen=True)
class Model:
    """A motion model.

    A forced model moves with currents, winds and their errors; without forcing its particles are
    lost. Other models move everywhere, and their speeds are over ground.
    """

    forced: bool
    columns: tuple[Column, ...]  # columns of the ensemble besides CORE
    terms: Callable[[Errors, Scenario], Terms]
    # Draws the columns' initial values for a scenario's slots.
    draw: Callable[[Ensemble, Slots, Key, Scenario, Errors], None]
    # Returns the function that moves a group over steps (kernels.step.advance.Move); int: direction
    # in time. Device array (4 n,) or None: receives each track's deviation from its chord.
    mover: Callable[[Ensemble, Group, Waters, int, Any], kernel.Move]
    # Moves positions to a time inside a step, in place; terms by scenario,
    # None for those of another model.
    between: Callable[[Ensemble, tuple[Terms | None, ...], kernel.Surroundings, Inside], None]
    # Returns the longest steps [s] that the model allows, by the reason for each.
    longest: Callable[[Errors], Mapping[str, float]]
    # Returns the typical speed through the water in a wind [m/s], for the size of the domain.
    usual: Callable[[Scenario, float], float]
    # Returns the highest speed in a wind [m/s]; second float: number of standard deviations that
    # count.
    fastest: Callable[[Scenario, float, float], float]


class Motion(NamedTuple):
    """The motion of one scenario's objects: a model and its terms."""

    model: Model
    terms: Terms
