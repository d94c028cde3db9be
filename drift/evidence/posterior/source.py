"""Sources of the particles' quantities: an ensemble as it is, or stored columns."""

from typing import Protocol

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.steering import settled
from drift.engine.motion.steering.settled import Settled
from drift.engine.motion.steering.steer import Steering
from drift.engine.particles.columns import Columns
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.posterior.quantity import Drawn, Quantity
from geo.array import Array


class Source(Protocol):
    """The particles of a run at some time."""

    def columns(self, quantity: Quantity, time: np.datetime64 | None) -> Columns | None:
        """Return a quantity of the particles at a time, as columns by the names of `Values`.

        The time lies in the step just made; None: the start of the run. Return None if no particle has the quantity.
        """


class Particles:
    """The particles of an ensemble at the time of the call."""

    def __init__(self, spec: EnsembleSpec, ensemble: Ensemble, steering: Steering | None) -> None:
        """Set up for an ensemble that was drawn from `spec`."""
        self._spec, self._ensemble, self._steering = spec, ensemble, steering
        self._birth: Array | None = None
        self._settled: Settled | None = None

    def columns(self, quantity: Quantity, time: np.datetime64 | None) -> Columns | None:
        """Return a quantity of the particles at a time.

        Values that are fixed at birth are read again if births have changed.
        """
        if self._steering is not None:
            birth = self._ensemble.own["birth"].to_numpy()
            if self._birth is None or not np.array_equal(birth, self._birth):
                self._birth, self._settled = (
                    birth.copy(),
                    settled.read_settled(self._ensemble, self._steering),
                )
        scenario = self._ensemble.scenario.to_numpy().astype(np.int64)
        elapsed = 0 if time is None else self._spec.period.elapsed(time)
        found = quantity.of(Drawn(self._spec, self._ensemble, scenario, self._settled, elapsed))
        return None if found is None else Columns.held(self._ensemble.blocks, found._asdict())
