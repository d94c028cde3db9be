"""Where beliefs read what particles have of each quantity: from an ensemble as it is, or from what was taken down of one."""

from typing import Protocol

import numpy as np

from drift.motion import settled
from drift.motion.ensemble_spec import EnsembleSpec
from drift.motion.settled import Settled
from drift.motion.steer import Steering
from drift.particles.ensemble import Ensemble
from drift.particles.partials import Blocks
from drift.posterior.quantity import Drawn, Quantity, Values
from geo.array import Array


class Source(Protocol):
    """The particles of a run at some time."""

    @property
    def blocks(self) -> Blocks:
        """The blocks by which sums over them are made."""

    def values(self, quantity: Quantity) -> Values | None:
        """Return what they have of a quantity; None: none has it."""


class Particles:
    """The particles of an ensemble, as they are whenever it is asked."""

    def __init__(self, spec: EnsembleSpec, ensemble: Ensemble, steering: Steering | None) -> None:
        """Make ready to read an ensemble that was drawn from `spec`."""
        self._spec, self._ensemble, self._steering = spec, ensemble, steering
        self._birth: Array | None = None
        self._settled: Settled | None = None

    @property
    def blocks(self) -> Blocks:
        """The blocks by which sums over them are made."""
        return self._ensemble.blocks

    def values(self, quantity: Quantity) -> Values | None:
        """Return what they have of a quantity; what is settled at birth is asked for again if births have changed."""
        if self._steering is not None:
            birth = self._ensemble.own["birth"].to_numpy()
            if self._birth is None or not np.array_equal(birth, self._birth):
                self._birth, self._settled = birth.copy(), settled.read(self._ensemble, self._steering)
        scenario = self._ensemble.scenario.to_numpy().astype(np.int64)
        return quantity.of(Drawn(self._spec, self._ensemble, scenario, self._settled))
