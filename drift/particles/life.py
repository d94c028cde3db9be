"""The lives of particles as the columns of an ensemble tell them, on the host.

kernels.life is the same on the device.
"""

from dataclasses import dataclass

import numpy as np

from drift.particles.ensemble import Ensemble
from drift.particles.status import Status
from geo.array import Array


def over(status: Array) -> Array:
    """Return which particles have gone ashore, sunk, left, or run out of forcing, bool (n,)."""
    return np.asarray((status != Status.ADRIFT) & (status != Status.PENDING))


@dataclass(frozen=True)
class Lives:
    """Columns of an ensemble after a step, int32 (n,), times in seconds after the run's start."""

    status: Array  # at the end of the step
    release: Array
    since: Array  # when that status began, where it is an end
    moving: Array  # when the particle last began to move, where what strands refloats

    def at(self, time: int) -> Array:
        """Return the status of each particle at a time within the step, int32 (n,)."""
        status = np.where(
            over(self.status) & (self.since > time) | (self.status == Status.PENDING), Status.ADRIFT, self.status
        )
        refloats = (status == Status.ADRIFT) & (self.moving > np.maximum(time, self.release))  # later in the step
        status = np.where(refloats, Status.ASHORE, status)
        return np.where(self.release > time, Status.PENDING, status).astype(np.int32)

    def way(self, begin: int, end: int) -> tuple[Array, Array]:
        """Return when each particle begins to move between two times of the step, and when it ends; begin <= end."""
        finish = np.where(self.status == Status.ADRIFT, end, np.minimum(self.since, end))
        left = np.maximum(begin, self.release)
        return np.where(self.moving < finish, np.maximum(left, self.moving), left), finish


def read(ensemble: Ensemble) -> Lives:
    """Return the lives of an ensemble's particles."""
    columns = ensemble.status, ensemble.release, ensemble.status_since, ensemble.moving_since
    return Lives(*(column.to_numpy() for column in columns))
