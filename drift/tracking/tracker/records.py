"""Trackers, their sensors, and the rules by which a cloud's particles act and are refilled."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geo.array import Array

METHODS = {
    "position": 1,
    "course": 2,
    "combined": 3,
}  # how a cloud is repopulated from a box; kernels.tracking.clouds defines the numbers


@dataclass(frozen=True)
class Plan:
    """A schedule: on from `begin` for `lasting`, and again every `every` [s]."""

    begin: float = 0.0
    every: float = math.inf
    lasting: float = math.inf

    def spans(self, end: float) -> Iterator[tuple[float, float]]:
        """Yield (begin, end) [s] of each time that it is on, until an end."""
        begin, number = self.begin, 0
        while begin < end:
            yield begin, min(begin + self.lasting, end)
            number += 1
            begin = self.begin + number * self.every

    def includes(self, time: float) -> bool:
        """Return True if it is on at a time [s], or within a second of that."""
        return any(begin - 1 <= time <= end + 1 for begin, end in self.spans(time + 2))

    def sweeps(self, interval: float, end: float) -> Array:
        """Return the times of sweeps [s]: at each begin, and every interval until before its end.

        Args:
            interval: [s].
            end: of the sweeps [s].
        """
        times = []
        for begin, off in self.spans(end):
            count = max(math.ceil((off - begin) / interval - 1e-9), 1)
            # rounded, so that equal times of different sensors compare equal
            times.append(np.round(begin + interval * np.arange(count), 6))
        return np.concatenate(times) if times else np.empty(0)


@dataclass(frozen=True)
class Sensor:
    """A sensor of the tracker: it detects targets within its reach, in a box of range and bearing.

    The box is the true range less and more a share of it, at most the reach, and the true bearing
    on either side.
    """

    name: str
    reach: float  # [m]
    range_share: float  # relative error of the range; 0: exact; 1: unknown
    bearing_error: float  # [rad] on either side; pi: unknown
    interval: float  # [s] between its sweeps, or between the emissions that it hears
    on: Plan = Plan()
    hears: bool = False  # passive: it detects only targets that radiate; silence is no evidence
    grace: float = (
        # [s] of recorded detections: silence nearer in time to one within its reach is no evidence
        300.0
    )


@dataclass(frozen=True)
class Behaviour:
    """Random acts of particles; without `acts` each keeps its course and speed."""

    fastest: float  # [m/s]
    change: float = 0.0  # probability that an act is a change to any other course and speed
    seek: float = 0.0  # that it seeks the tracker from then on, at its speed
    hide: float = 0.0  # that it flees from the tracker from then on
    leave: float = 0.0  # that a seeking or fleeing particle acts freely again
    acts: tuple[float, float] | None = None  # [s] least and longest time between acts
    # [rad] courses of flight, on either side of the reciprocal bearing
    spread: float = math.radians(30.0)


@dataclass(frozen=True)
class Filling:
    """When and how a cloud is refilled."""

    method: str = "combined"  # of METHODS
    partial: float = 0.75  # share of particles below which the remaining ones are duplicated
    # share below which they are repopulated from the detection's box; after silence the track is
    # lost
    bulk: float = 0.1


@dataclass(frozen=True)
class Tracker:
    """A way of following a target."""

    name: str
    behaviour: Behaviour
    filling: Filling
