"""The period of a run, and how it is divided into steps.

A case holds both, so this module must not import Taichi.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from geo import notation

SECOND = np.timedelta64(1, "s")


@dataclass(frozen=True)
class Period:
    """Start and end of a run, UTC; direction: +1, or -1 for a backward run, which ends before its
    start.
    """

    start: np.datetime64
    end: np.datetime64
    direction: int

    @property
    def epoch(self) -> int:
        """The start [s since 1970]."""
        return notation.epoch(self.start)

    @property
    def duration(self) -> int:
        """Length [s], positive in a backward run too."""
        return abs(int((self.end - self.start) / SECOND))

    @property
    def span(self) -> tuple[np.datetime64, np.datetime64]:
        """The earlier and the later of start and end."""
        return min(self.start, self.end), max(self.start, self.end)

    def elapsed(self, time: np.datetime64) -> int:
        """Return the seconds from the start to a time, positive in the direction of the run."""
        return int((time - self.start) / SECOND) * self.direction

    def seconds(self, times: Iterable[np.datetime64]) -> npt.NDArray[np.int64]:
        """Return the seconds from the start to each of some times, shape (m,)."""
        return np.array([self.elapsed(time) for time in times], np.int64)

    def time(self, elapsed: int) -> np.datetime64:
        """Return the time `elapsed` seconds from the start, in the direction of the run."""
        return self.start + np.timedelta64(self.direction * elapsed, "s")


@dataclass(frozen=True)
class ClockSpec:
    """How a run is divided into steps."""

    step: int | None = None  # [s], positive also in a backward run; None: choose it
    scheme: Literal["rk2", "rk4"] = "rk4"
    tolerance: float = 20.0  # [m a day] largest error of an automatically chosen step
