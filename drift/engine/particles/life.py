"""When each particle moves and stops, from the ensemble's columns, on the host.

kernels.step.life is the device counterpart.
"""

from dataclasses import dataclass

import numpy as np

from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status
from geo.array import Array


def has_stopped(status: Array) -> Array:
    """Return which particles have stopped for good (stranded, sunk, left, lost, arrived, aground),
    bool (n,).
    """
    return np.asarray(
        (status != Status.ADRIFT) & (status != Status.PENDING) & (status != Status.UNDER_WAY)
    )


@dataclass(frozen=True)
class Lives:
    """Status columns of an ensemble after a step, int32 (n,); times are seconds after the run's
    start.
    """

    status: Array  # at the end of the step
    release: Array
    since: Array  # when that status began, if it is a final one
    moving: Array  # when the particle last began to move; refloating resets it
    # when a target gets under way, if before its release; None: no scenario steers
    departure: Array | None = None

    def at(self, time: int) -> Array:
        """Return the status of each particle at a time within the step, int32 (n,)."""
        ended = has_stopped(self.status) & (self.since <= time)
        status = np.where(ended, self.status, np.int32(Status.ADRIFT))
        # later in the step
        refloats = (status == Status.ADRIFT) & (self.moving > np.maximum(time, self.release))
        status[refloats] = Status.ASHORE
        later = self.release > time
        if self.departure is None:
            status[later] = Status.PENDING
            return status
        before = np.where(
            self.departure <= time, np.int32(Status.UNDER_WAY), np.int32(Status.PENDING)
        )
        # a target that stops before its release never goes adrift
        before = np.where(ended, self.status, before)
        return np.where(later, before, status)

    def way(self, begin: int, end: int) -> tuple[Array, Array]:
        """Return when each particle starts and stops moving within [begin, end] of the step, (n,)
        each.
        """
        finish = np.where(self.status == Status.ADRIFT, end, np.minimum(self.since, end))
        left = np.maximum(begin, self.release)
        return np.where(self.moving < finish, np.maximum(left, self.moving), left), finish

    def share(self, begin: int, end: int, time: int) -> Array:
        """Return the share (0 to 1) of its track within [begin, end] that each particle has covered
        by a time.
        """
        left, finish = self.way(begin, end)
        return np.asarray(np.clip((time - left) / np.maximum(finish - left, 1), 0.0, 1.0))


def read_lives(ensemble: Ensemble) -> Lives:
    """Return the status columns of an ensemble, copied to the host."""
    departure = ensemble.own.get("departure")
    return Lives(
        status=ensemble.status.to_numpy(),
        release=ensemble.release.to_numpy(),
        since=ensemble.status_since.to_numpy(),
        moving=ensemble.moving_since.to_numpy(),
        departure=None if departure is None else departure.to_numpy(),
    )
