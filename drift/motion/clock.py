"""The clock of a run, which steps along a lattice that the forcing's times lie on.

Lattice steps are whole seconds long and counted from 1970, so that noise, keyed by the number of the step, does not
depend on where a run begins, on its outputs or on how it is cut up.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kernels import advance as kernel

LEAST_INTERVAL = 300  # [s] a lattice finer than that is not worth a node of forcing


def lattice(times: list[npt.NDArray[np.int64]]) -> tuple[int, int]:
    """Return the interval [s] that steps should divide, and a point of the lattice [s since 1970].

    That is the common divisor of all sources' times; times that share none of use are left to interpolation.
    """
    for chosen in (times, [t for t in times if _common(t, int(t[0])) >= LEAST_INTERVAL]):
        if chosen:
            origin = int(chosen[0][0])
            divisor = _common(np.concatenate(chosen), origin)
            if divisor >= LEAST_INTERVAL:
                return divisor, origin
    return 3600, int(times[0][0]) // 3600 * 3600 if times else 0


def _common(times: npt.NDArray[np.int64], origin: int) -> int:
    return int(np.gcd.reduce(np.abs(times - origin)))


@dataclass(frozen=True)
class Clock:
    """The time of a run, from start, in lattice steps.

    It runs `duration` seconds forward (direction +1) or backward (-1).
    """

    start: int  # [s since 1970]
    duration: int  # [s]
    direction: int
    step: int  # [s]
    phase: int = 0  # [s] lattice points lie at phase + k step

    def ends(self, elapsed: int) -> bool:
        """Return whether a step ends at a time [s after start]."""
        return (self.start + self.direction * elapsed - self.phase) % self.step == 0

    def steps(self) -> Iterator[tuple[int, int, kernel.Step]]:
        """Return (low, high) [s since 1970] and the step, in the order of the run, covering start to end."""
        inside = (self.start - self.phase) % self.step  # how far the start lies above its lattice point
        if self.direction > 0:
            low, elapsed = self.start - inside, -inside
        else:
            low = self.start - inside - (self.step if inside == 0 else 0)
            elapsed = -(low + self.step - self.start)
        while elapsed < self.duration:
            number = (low - self.phase) // self.step
            yield low, low + self.step, kernel.Step(number, elapsed, self.step, self.direction)
            low += self.direction * self.step
            elapsed += self.step
