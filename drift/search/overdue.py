"""What is overdue: a target that was to have arrived by a time, and has not.

Those that have arrived by then are not what is looked for. That is evidence as any other: it makes a distress on the way
likelier, and slow passages too.
"""

import numpy as np

from drift.motion.ensemble_spec import EnsembleSpec
from drift.particles import life
from drift.particles.ensemble import Ensemble
from drift.particles.status import Status
from geo import notation
from geo.array import Array


def times(spec: EnsembleSpec) -> list[int]:
    """Return the times [s after the run's start] at which scenarios are known to be overdue, ascending."""
    known = {s.itinerary.overdue for s in spec.scenarios if s.itinerary and s.itinerary.overdue is not None}
    return sorted(spec.period.elapsed(time) for time in known)


def name(spec: EnsembleSpec, time: int) -> str:
    """Return what the evidence of a time [s after the run's start] is called."""
    return f"overdue {notation.group(spec.period.time(time))}"


def log_likelihood(spec: EnsembleSpec, time: int, ensemble: Ensemble) -> Array:
    """Return the log likelihood (n,) of not having arrived by a time: -inf of what has, 0 of all else."""
    when = spec.period.time(time)
    concerned = [k for k, s in enumerate(spec.scenarios) if s.itinerary and s.itinerary.overdue == when]
    arrived = life.read(ensemble).at(time) == Status.ARRIVED
    return np.where(arrived & np.isin(ensemble.scenario.to_numpy(), concerned), -np.inf, 0.0)
