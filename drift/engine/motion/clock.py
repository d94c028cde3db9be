"""The clock of a run, whose steps lie on a lattice shared with the forcing's times.

Lattice steps are whole seconds long and counted from 1970. Noise is keyed by the number of the
step, so it does not depend on where a run begins, on its outputs or on how it is divided. Forcing
times that are not on the lattice split the step that contains them, because within a step the
forcing is linear in time.
"""

import itertools
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from kernels.step import advance as kernel

LEAST_INTERVAL = 300  # [s] shortest lattice interval; source times that need less split steps
NEVER = 2**31 - 1  # [s]


def lattice(times: list[npt.NDArray[np.int64]]) -> tuple[int, int]:
    """Return the interval [s] that steps should divide, and a point of the lattice [s since 1970].

    The interval is the common divisor of all sources' times. Times whose common divisor is too
    small are handled by `breaks`.
    """
    for chosen in (times, [t for t in times if _common(t, int(t[0])) >= LEAST_INTERVAL]):
        if chosen:
            origin = int(chosen[0][0])
            divisor = _common(np.concatenate(chosen), origin)
            if divisor >= LEAST_INTERVAL:
                return divisor, origin
    return 3600, int(times[0][0]) // 3600 * 3600 if times else 0


def off_lattice_times(
    times: Sequence[npt.NDArray[np.int64]], step: int, origin: int
) -> tuple[int, ...]:
    """Return the source times [s since 1970], ascending, that split a step of the lattice through
    `origin`.
    """
    every = np.unique(np.concatenate([np.zeros(0, np.int64), *times]))
    return tuple(every[(every - origin) % step != 0].tolist())


def _common(times: npt.NDArray[np.int64], origin: int) -> int:
    return int(np.gcd.reduce(np.abs(times - origin)))


class Timed(NamedTuple):
    """A step and the times between which it lies [s since 1970]."""

    low: int
    high: int
    step: kernel.Step


@dataclass(frozen=True)
class Clock:
    """The time of a run in lattice steps from `start`.

    It runs `duration` seconds forward (direction +1) or backward (-1).
    """

    start: int  # [s since 1970]
    duration: int  # [s]
    direction: int
    step: int  # [s]
    phase: int = 0  # [s] lattice points lie at phase + k step
    breaks: tuple[int, ...] = ()  # [s since 1970] ascending: times at which a step is cut in two
    # [s] longest piece of a step in which drift tracks count as straight, for evidence inside steps
    straight: int = NEVER

    def ends(self, elapsed: int) -> bool:
        """Return whether a step ends at a time [s after start]."""
        time = self.start + self.direction * elapsed
        return (time - self.phase) % self.step == 0 or time in self.breaks

    def steps(self) -> Iterator[Timed]:
        """Yield the steps from start to end, in the order of the run."""
        # how far the start lies above its lattice point
        inside = (self.start - self.phase) % self.step
        low = self.start - inside
        if self.direction < 0 and inside == 0:
            low -= self.step
        while True:
            for begin, end in self._parts(low, low + self.step):
                elapsed = begin - self.start if self.direction > 0 else self.start - end
                if elapsed >= self.duration:
                    return
                if elapsed + end - begin > 0:  # otherwise it ends before the run begins
                    pieces = -(-(end - begin) // self.straight)
                    step = kernel.Step(
                        self._number(begin), elapsed, end - begin, self.direction, pieces
                    )
                    yield Timed(begin, end, step)
            low += self.direction * self.step

    def _parts(self, low: int, high: int) -> list[tuple[int, int]]:
        """Return the parts into which a lattice step is split, in the order of the run."""
        inner = self.breaks[bisect_right(self.breaks, low) : bisect_left(self.breaks, high)]
        parts = list(itertools.pairwise((low, *inner, high)))
        return parts[:: self.direction]

    def _number(self, begin: int) -> int:
        """Return the key of a step's noise: its lattice number, or minus the start time of a part
        within a step.
        """
        number, inside = divmod(begin - self.phase, self.step)
        return number if inside == 0 else -begin
