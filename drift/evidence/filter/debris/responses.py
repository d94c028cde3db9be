"""The response of debris at the times of its finds to the uncertain forcing that it shares.

The errors of current and wind are Ornstein-Uhlenbeck processes on the steps of the run's clock
(kernels.step.errors): e' = a e + std sqrt(1 - a^2) xi, a = exp(-dt / time). A step moves debris by
the mean of e and e' over dt, times the debris's share of the wind speed. So its displacement at a
find is linear in the standard normals xi, and the coefficients follow from a recursion backward in
time. They define a direction in the space of xi along which particles are guided. Another direction
would guide better where forcing shears, where debris has more than a downwind slope, or where a
particle begins inside a step; but any direction is exact (drift.evidence.filter.debris.guide).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.engine.motion.clock import Clock
from drift.engine.motion.errors.forcing_error import Errors
from drift.engine.motion.guided import Guided
from drift.engine.motion.objects.leeway import Drifter
from geo.array import Array


@dataclass(frozen=True, eq=False)
class Responses:
    """Displacements [m] at the times of finds, by row: one row per step from the run's start."""

    guided: Guided  # per unit normal of each step
    begins: Array  # [s after start] (rows,) when each row begins
    state: Array  # [m] (finds, rows + 1, 2) per unit normal of the errors that a row begins with
    lasting: Array  # [s] (finds, rows + 1) from the begin of each row to the find
    # [m2] (rows + 1, finds, finds) covariance by the normals of each row and all after
    noise: Array
    stds: tuple[float, float]  # [m/s] of the errors of current and wind
    bias: float  # [m/s] standard deviation of the current's

    @property
    def finds(self) -> int:
        """Number of finds."""
        return len(self.lasting)

    @property
    def rows(self) -> int:
        """Number of steps."""
        return int(self.lasting.shape[1]) - 1

    def rows_of(self, release: Array) -> Array:
        """Return the row in which each release [s after start] lies, int32 (n,)."""
        rows = np.clip(np.searchsorted(self.begins, release, "right") - 1, 0, self.rows)
        return np.asarray(rows, np.int32)

    def covariance(self, row: int, place: Array) -> Array:
        """Return the covariance of displacements (east, north) of debris released in a row.

        Args:
            row: of the release.
            place: covariance of the release position [m2], shape (2, 2).

        Returns:
            Covariance [m2], shape (2 finds, 2 finds); both components of a find are adjacent.
        """
        state, last = self.state[:, row], self.bias * self.lasting[:, row]
        per_component = self.noise[row] + state @ state.T + np.outer(last, last)
        return np.kron(per_component, np.eye(2)) + np.kron(np.ones_like(per_component), place)


def forcing_responses(
    errors: Errors, finds: Sequence[tuple[int, Drifter]], clock: Clock
) -> Responses:
    """Return how errors of the forcing move debris by the times of finds.

    Args:
        errors: of current and wind.
        finds: time [s after start] and leeway class of each.
        clock: of the run.
    """
    last = max(time for time, _ in finds)
    steps = [step for _, _, step in clock.steps() if step.elapsed < last]
    count = len(steps)
    table = np.zeros((len(finds), count + 1, 2))
    state, lasting = np.zeros_like(table), np.zeros((len(finds), count + 1))
    for number, (time, drifter) in enumerate(finds):
        flown = np.array([min(max(time - step.elapsed, 0), step.duration) for step in steps], float)
        lasting[number, :-1] = np.cumsum(flown[::-1])[::-1]
        wind = drifter.down.slope if drifter.uses_wind else 0.0
        for kind, (error, share) in enumerate(((errors.current, 1.0), (errors.wind, wind))):
            if error.std == 0 or share == 0:
                continue
            for row in reversed(range(count)):
                keep = np.exp(-steps[row].duration / error.time)
                kick = np.sqrt(1 - keep**2)
                ahead = state[number, row + 1, kind] / (error.std * share)
                half = 0.5 * flown[row]
                table[number, row, kind] = error.std * share * kick * (half + ahead)
                state[number, row, kind] = error.std * share * (half * (1 + keep) + keep * ahead)
    each = np.einsum("fkm,gkm->kfg", table, table)
    summed = np.cumsum(each[::-1], axis=0)[::-1]
    until = steps[-1].elapsed + steps[-1].duration if steps else 0
    guided = Guided(tuple(step.number for step in steps), until, table.astype(np.float32))
    begins = np.array([step.elapsed for step in steps])
    stds = errors.current.std, errors.wind.std
    return Responses(guided, begins, state, lasting, summed, stds, errors.current.bias)
