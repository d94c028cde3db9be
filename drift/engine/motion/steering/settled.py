"""Initial random choices of steering targets that no ensemble column holds
(kernels.steering.settled).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from drift.engine.motion.steering import itinerary_tables
from drift.engine.motion.steering.itinerary import Acts, Course, Itinerary, Loiter, Ways
from drift.engine.motion.steering.steer import Steering
from drift.engine.particles.ensemble import NEVER, Ensemble
from geo.array import Array
from kernels.runtime import runtime
from kernels.steering import settled as kernel


class Settled(NamedTuple):
    """Columns on the host, (n,) each; 0 where a scenario has no such value, NEVER for an unknown
    arrival.
    """

    speed: Array  # [m/s] of the first phase for which a speed of advance is drawn
    # [rad] the first one of the first phase that keeps a course, clockwise from north
    course: Array
    destination: Array  # index among the destinations of the last phase that has several
    k: Array  # [m/sqrt(s)] of the first phase that is a Brownian bridge
    # [s] end of an itinerary that is a single voyage, unless its distress comes first
    arrival: Array
    has: Mapping[str, Array]  # (scenarios,) bool each: which scenarios have each value


def read_settled(ensemble: Ensemble, steering: Steering) -> Settled:
    """Return the initial random choices of an ensemble's particles."""
    wanted = phases(steering.itineraries)
    dtypes = {"destination": np.int32, "arrival": np.int32}
    out = {
        name: runtime.upload(
            np.full(ensemble.n, NEVER if name == "arrival" else 0, dtypes.get(name, np.float32))
        )
        for name in kernel.FIELDS
    }
    plan = itinerary_tables.plan(steering.itineraries, steering.period)
    own = ensemble.batch(steering.scenarios)
    kernel.settle(
        ensemble.columns, own, plan, ensemble.seed, runtime.upload(wanted.reshape(-1)), out
    )
    has = dict(zip(kernel.FIELDS, wanted.T >= 0, strict=True))
    speed, course, destination, k, arrival = (out[name].to_numpy() for name in kernel.FIELDS)
    return Settled(speed, course, destination, k, arrival, has)


def phases(itineraries: Sequence[Itinerary | None]) -> Array:
    """Return the phase from which each value is taken, int32 (scenarios, WANTED); -1: none.

    Phases are numbered over all itineraries.
    """
    table = np.full((len(itineraries), kernel.WANTED), -1, np.int32)
    number = 0
    for row, itinerary in zip(table, itineraries, strict=True):
        for k, phase in enumerate(itinerary.phases if itinerary else ()):
            told = []
            on_its_way = isinstance(phase, Course | Acts) or (
                isinstance(phase, Ways) and _by_speed(phase)
            )
            # other phases hold a patrol speed
            if on_its_way or (isinstance(phase, Loiter) and k == 0):
                told.append(kernel.SPEED)
            if isinstance(phase, Course | Acts):
                told.append(kernel.FIRST_COURSE)
            if isinstance(phase, Ways) and phase.k > 0:
                told.append(kernel.SPREAD_RATE)
            if (
                isinstance(phase, Ways)
                and _by_speed(phase)
                and itinerary
                and len(itinerary.phases) == 1
            ):
                told.append(kernel.ARRIVAL)
            for what in told:
                row[what] = number if row[what] < 0 else row[what]
            if isinstance(phase, Ways) and phase.destinations:
                row[kernel.DESTINATION] = number  # the last phase counts
            number += 1
    return table


def _by_speed(phase: Ways) -> bool:
    """Return whether a phase's way points have no times, so that a speed determines them."""
    return not phase.destinations and all(point.time is None for point in phase.points)
