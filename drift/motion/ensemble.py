"""The record of a run: one slot a particle, one column a property.

Columns lie on the device (opaque here: only `kernels` touches them) and keep their order: the slots of a scenario are
contiguous, so that a scenario is a range of slots.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.motion import weights
from drift.motion.status import Status
from kernels import runtime, weigh

Array = npt.NDArray[Any]
Device = Any  # a one-dimensional array on the device

INTEGERS = ("lon", "lat", "status", "release", "ended", "edge", "side", "world", "sinks", "afloat")
LEEWAY = ("down_slope", "down_offset", "right_slope", "right_offset", "left_slope", "left_offset")
REALS = (
    "log_weight",
    *LEEWAY,
    "current_error_east",
    "current_error_north",
    "wind_error_east",
    "wind_error_north",
    "current_bias_east",
    "current_bias_north",
)
BYTES_PER_PARTICLE = 4 * (len(INTEGERS) + len(REALS))


@dataclass(frozen=True)
class Ensemble:
    """Columns of shape (n,); `bounds` holds the first slot of each scenario and, last, n."""

    seed: int
    bounds: tuple[int, ...]
    lon: Device  # int32 binary angle
    lat: Device
    status: Device  # int32, drift.motion.status.Status
    release: Device  # int32 [s] after the run's start
    ended: Device  # int32 [s] after the run's start: when it went ashore, outside or left
    edge: Device  # int32, shoreline edge where it went ashore, else -1
    side: Device  # int32, +1 drifts to the right of the wind, -1 to the left
    world: Device  # int32, number of the world whose unknowns it shares; 0 where there are none
    sinks: Device  # int32 [s] after the run's start: when it sinks if it is still adrift
    afloat: Device  # int32 [s] after the run's start: when it last began to move, where what strands refloats
    log_weight: Device  # float32, -inf is legal
    down_slope: Device  # float32, leeway per wind speed [1] and offset [m/s] of the particle's own three lines
    down_offset: Device
    right_slope: Device
    right_offset: Device
    left_slope: Device
    left_offset: Device
    current_error_east: Device  # float32 [m/s], Ornstein-Uhlenbeck errors as they stand
    current_error_north: Device
    wind_error_east: Device
    wind_error_north: Device
    current_bias_east: Device  # float32 [m/s], error of the current that lasts: its own, or in a spill its world's
    current_bias_north: Device

    @property
    def n(self) -> int:
        """Number of slots."""
        return self.bounds[-1]

    @property
    def scenarios(self) -> list[tuple[int, int]]:
        """Range [first, last) of slots of each scenario."""
        return list(zip(self.bounds[:-1], self.bounds[1:], strict=True))


def empty(seed: int, bounds: tuple[int, ...]) -> Ensemble:
    """Return an ensemble whose particles all wait at (0, 0) for a release at the start, all of weight 1."""
    n = bounds[-1]
    integers = {name: runtime.upload(np.zeros(n, np.int32)) for name in INTEGERS}
    integers["status"].fill(int(Status.PENDING))
    integers["edge"].fill(-1)
    integers["sinks"].fill(2**31 - 1)
    integers["side"].fill(1)
    return Ensemble(seed, bounds, **integers, **{name: runtime.empty(n) for name in REALS})


def probability(ensemble: Ensemble) -> Array:
    """Return each particle's normalised weight, float64, shape (n,), of sum 1."""
    return weights.shares(ensemble.log_weight.to_numpy())


@dataclass(frozen=True)
class Account:
    """Where the probability is: by status and scenario, and how many particles it is worth."""

    by_status: Array  # (scenario, status), sum 1
    ess: float  # effective sample size, 1 / sum of squared weights (Kong 1992)


def account(ensemble: Ensemble, status: Array | None = None) -> Account:
    """Return the account of an ensemble, the same for any number of threads.

    status: int32 (n,) at another time than that of the last step; default: the ensemble's own.
    """
    statuses = ensemble.status if status is None else runtime.upload(status)
    parts = [weigh.account(ensemble.log_weight, statuses, *slots) for slots in ensemble.scenarios]
    largest = max(factor for _, _, factor in parts)
    table = np.array([sums * np.exp(factor - largest) for sums, _, factor in parts])
    squares = sum(square * np.exp(2 * (factor - largest)) for _, square, factor in parts)
    return Account(table / table.sum(), float(table.sum() ** 2 / squares))


def sample(ensemble: Ensemble, slots: Array) -> Ensemble:
    """Return a copy of chosen slots (sorted), for trials that must not touch the run."""
    columns = {name: runtime.upload(getattr(ensemble, name).to_numpy()[slots]) for name in (*INTEGERS, *REALS)}
    bounds = tuple(int(x) for x in np.searchsorted(slots, ensemble.bounds))
    return replace(ensemble, bounds=bounds, **columns)
