"""When each unit can search where: ready, on its way, by daylight, before the plan ends, and no longer than it lasts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.planner import daylight
from drift.search import laws
from drift.search.records import PlanSpec, Unit
from geo import notation, sphere

Array = npt.NDArray[Any]

MARGIN = 5.0  # [s] legs in whole seconds on the sphere take so much longer than on the plane, at most
SHARE = 0.85  # of the endurance on scene is search (Joint Pub 3-50, National Search and Rescue Supplement)


def moment(time: float) -> np.datetime64:
    """Return seconds since 1970 as a time, to the second."""
    return np.datetime64(round(time), "s")


@dataclass(frozen=True)
class Reach:
    """What a unit can do. Times in seconds since 1970."""

    base: tuple[float, float]  # (lon, lat) [rad]
    leaves: float  # earliest
    transit_speed: float  # [m/s]
    spans: tuple[tuple[float, float], ...]  # in which it may search, in order
    search: float  # [s] of search in a sortie
    way: Callable[[npt.ArrayLike, npt.ArrayLike], Array] | None = (
        None  # length [m] of the way to positions [rad]; None: straight
    )

    def arrival(self, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
        """Return when it can be at positions [rad] at the earliest."""
        way = sphere.distance(*self.base, lon, lat) if self.way is None else self.way(lon, lat)
        return np.asarray(self.leaves + way / self.transit_speed)

    def slot(self, earliest: npt.ArrayLike) -> tuple[Array, Array]:
        """Return when a search that may begin at `earliest` begins, and for how long [s] it lasts, 0 if it cannot."""
        earliest = np.asarray(earliest, np.float64)
        start, length = earliest.copy(), np.zeros(earliest.shape)
        free = np.ones(earliest.shape, bool)
        for begin, end in self.spans:
            here = free & (earliest < end)
            start = np.where(here, np.maximum(earliest, begin), start)
            length = np.where(here, np.minimum(end - start, self.search), length)
            free &= ~here
        return start, length

    def within(self, begin: Array, end: Array, arrival: Array) -> Array:
        """Return the time [s] between `begin` and `end` in which it can search where it arrives at `arrival`."""
        total = np.zeros(np.broadcast_shapes(np.shape(begin), np.shape(arrival)))
        for first, last in self.spans:
            total += np.maximum(np.minimum(end, last) - np.maximum(np.maximum(begin, first), arrival), 0.0)
        return total


def reach(unit: Unit, spec: PlanSpec, place: tuple[float, float], after: float | None = None) -> Reach:
    """Return what a unit can do from its base round a place (lon, lat) [rad]; `after`: it leaves no earlier than that."""
    begin, until = float(notation.epoch(spec.begin)), float(notation.epoch(spec.until))
    leaves = max(begin, float(notation.epoch(unit.ready)), after if after is not None else -np.inf)
    spans = [(begin, until)]
    if unit.daylight:
        spans = daylight.windows(begin, until, float(np.degrees(place[0])), float(np.degrees(place[1])))
    if laws.of(unit.law).detects != "anywhere":  # which has no legs
        spans = [(first, last - MARGIN) for first, last in spans if last - first > MARGIN]
    base = tuple(float(v) for v in np.radians(unit.base))
    return Reach((base[0], base[1]), leaves, unit.transit_speed, tuple(spans), SHARE * unit.endurance)
