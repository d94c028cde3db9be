"""Models of motion: what a particle has besides the core of the ensemble, and the functions that
move it.

A model is a record of functions; a new one is a file of its own in this room, a kernel in
`kernels/` and a line in drift.engine.motion.models. A scenario moves by one model. Scenarios that
move by the same one in the same forcing are a group, which one launch a step moves, however many
they are.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from drift.engine.motion.forcing_error import Errors
from drift.engine.motion.scenario import Scenario
from drift.engine.particles.ensemble import Column, Ensemble, Slots
from kernels.runtime.batch import Batch
from kernels.step import advance as kernel
from kernels.step.bridge import Inside
from kernels.step.sample import Ranges, Tiles

Key = tuple[int, int]  # key of random numbers: kernels.maths.noise.key
# what a model's kernel takes of a scenario, also of its `motion`: opaque to all but the model
Terms = Any


class Waters(NamedTuple):
    """What the objects of a group move through: nodes of forcing, which of them are its sources,
    and the place.
    """

    tiles: Tiles
    ranges: Ranges  # first and last tile by quantity
    place: kernel.Surroundings


class Group(NamedTuple):
    """Scenarios that one launch moves: by one model, in the same forcing."""

    batch: Batch  # their numbers, and their slots
    terms: tuple[Terms, ...]  # of each


@dataclass(frozen=True)
class Model:
    """How objects of one kind move.

    What is forced moves with currents and winds and their errors: without them it is lost. What is
    not goes on everywhere, and its speeds are over ground.
    """

    forced: bool
    columns: tuple[Column, ...]  # columns of the ensemble besides those of the core
    terms: Callable[[Errors, Scenario], Terms]
    # Draws the columns' first values, of a scenario's slots.
    draw: Callable[[Ensemble, Slots, Key, Scenario, Errors], None]
    # Returns what moves a group of scenarios over steps, see kernels.step.advance.Move; int:
    # direction in time. Device array (4 n,) or None: takes how each way departs from its chord.
    mover: Callable[[Ensemble, Group, Waters, int, Any], kernel.Move]
    # Takes positions on to a time inside a step, in place; terms by scenario, None for those that
    # move by another model.
    between: Callable[[Ensemble, tuple[Terms | None, ...], kernel.Surroundings, Inside], None]
    # Returns terms that leave nothing to chance, so that the error of a step can be measured.
    still: Callable[[Terms], Terms]
    # Returns the longest steps [s] that the model allows, by the reason for each.
    longest: Callable[[Errors], Mapping[str, float]]
    # Returns how fast a scenario's object usually goes through the water in a wind [m/s], to draw
    # its box.
    usual: Callable[[Scenario, float], float]
    # Returns the speed that none exceeds in a wind [m/s]; second float: so many standard deviations
    # out.
    fastest: Callable[[Scenario, float, float], float]


class Motion(NamedTuple):
    """How the objects of one scenario move: a model and its terms."""

    model: Model
    terms: Terms
