"""Who follows what, with which sensors, and how the cloud of particles acts and is filled again."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geo.array import Array

METHODS = {
    "position": 1,
    "course": 2,
    "combined": 3,
}  # how a box is drawn from again; kernels.tracking.clouds names the numbers


@dataclass(frozen=True)
class Plan:
    """When something is on: from `begin` for `lasting`, and again every `every` [s]."""

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
        """Return whether it is on at a time [s], or off by a second at most."""
        return any(begin - 1 <= time <= end + 1 for begin, end in self.spans(time + 2))

    def sweeps(self, interval: float, end: float) -> Array:
        """Return the times of sweeps [s], one at each begin and one every interval [s] until before
        its end.
        """
        times = []
        for begin, off in self.spans(end):
            count = max(math.ceil((off - begin) / interval - 1e-9), 1)
            # what sensors have in common is one number
            times.append(np.round(begin + interval * np.arange(count), 6))
        return np.concatenate(times) if times else np.empty(0)


@dataclass(frozen=True)
class Sensor:
    """A sensor of the tracker: what is within its reach it detects, in a box of ranges and
    bearings.

    The box is the true range less and more a share of it, at most the reach, and the true bearing
    on either side.
    """

    name: str
    reach: float  # [m]
    range_share: float  # 0: the range is exact; 1: nothing is told of it
    bearing_error: float  # [rad] on either side; pi: nothing is told of it
    interval: float  # [s] between its sweeps; of one that hears, between the emissions it hears
    on: Plan = Plan()
    hears: bool = False  # it detects a target while that radiates, and its silence tells nothing
    grace: float = (
        # [s] of detections as they were written down: nearer to one within its reach silence tells
        # nothing
        300.0
    )


@dataclass(frozen=True)
class Behaviour:
    """What particles do at times of their own; without `acts` each keeps its course and speed."""

    fastest: float  # [m/s]
    change: float = 0.0  # probability that one which acts takes any other course and speed
    seek: float = 0.0  # that from then on it seeks the tracker, at its speed
    hide: float = 0.0  # that from then on it flees from it
    leave: float = 0.0  # that one which seeks or hides acts freely again
    acts: tuple[float, float] | None = None  # [s] least and longest time between acts
    # [rad] on either side of the reciprocal bearing on which one flees
    spread: float = math.radians(30.0)


@dataclass(frozen=True)
class Filling:
    """When and how a cloud is filled again."""

    method: str = "combined"  # of METHODS
    partial: float = 0.75  # share of the particles below which what is left is duplicated
    # share below which they are drawn again from the detection's box; after silence the track is
    # lost
    bulk: float = 0.1


@dataclass(frozen=True)
class Tracker:
    """A way of following a target."""

    name: str
    behaviour: Behaviour
    filling: Filling
