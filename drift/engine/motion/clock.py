"""The clock of a run, which steps along a lattice that the forcing's times lie on.

Lattice steps are whole seconds long and counted from 1970, so that noise, keyed by the number of
the step, does not depend on where a run begins, on its outputs or on how it is cut up. Times of the
forcing that lie on no lattice of use cut the step that holds them, for within a step the forcing is
one straight line in time.
"""

import itertools
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from kernels.step import advance as kernel

LEAST_INTERVAL = 300  # [s] a lattice finer than that is not worth a node of forcing
NEVER = 2**31 - 1  # [s]


def lattice(times: list[npt.NDArray[np.int64]]) -> tuple[int, int]:
    """Return the interval [s] that steps should divide, and a point of the lattice [s since 1970].

    That is the common divisor of all sources' times; times that share none of use become `breaks`.
    """
    for chosen in (times, [t for t in times if _common(t, int(t[0])) >= LEAST_INTERVAL]):
        if chosen:
            origin = int(chosen[0][0])
            divisor = _common(np.concatenate(chosen), origin)
            if divisor >= LEAST_INTERVAL:
                return divisor, origin
    return 3600, int(times[0][0]) // 3600 * 3600 if times else 0


def breaks(times: Sequence[npt.NDArray[np.int64]], step: int, origin: int) -> tuple[int, ...]:
    """Return the times of sources [s since 1970], ascending, at which a step of the lattice through
    `origin` is cut.
    """
    every = np.unique(np.concatenate([np.zeros(0, np.int64), *times]))
    return tuple(every[(every - origin) % step != 0].tolist())


def _common(times: npt.NDArray[np.int64], origin: int) -> int:
    return int(np.gcd.reduce(np.abs(times - origin)))


class Timed(NamedTuple):
    """A step, and between which times it lies [s since 1970]."""

    low: int
    high: int
    step: kernel.Step


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
    breaks: tuple[int, ...] = ()  # [s since 1970] ascending: times at which a step is cut in two
    # [s] ways of what drifts are straight for so long: evidence looks at pieces of a step
    straight: int = NEVER

    def ends(self, elapsed: int) -> bool:
        """Return whether a step ends at a time [s after start]."""
        time = self.start + self.direction * elapsed
        return (time - self.phase) % self.step == 0 or time in self.breaks

    def steps(self) -> Iterator[Timed]:
        """Return the steps in the order of the run, covering start to end."""
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
                if elapsed + end - begin > 0:  # else it ends before the run begins
                    pieces = -(-(end - begin) // self.straight)
                    step = kernel.Step(
                        self._number(begin), elapsed, end - begin, self.direction, pieces
                    )
                    yield Timed(begin, end, step)
            low += self.direction * self.step

    def _parts(self, low: int, high: int) -> list[tuple[int, int]]:
        """Return a lattice step in the parts into which it is cut, in the order of the run."""
        inner = self.breaks[bisect_right(self.breaks, low) : bisect_left(self.breaks, high)]
        parts = list(itertools.pairwise((low, *inner, high)))
        return parts[:: self.direction]

    def _number(self, begin: int) -> int:
        """Return the key of a step's noise: its number on the lattice; of a part that begins
        between, a time.
        """
        number, inside = divmod(begin - self.phase, self.step)
        return number if inside == 0 else -begin
