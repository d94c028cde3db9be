"""When each unit can search where: arrival, daylight, endurance and end of the plan."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drift.evidence.filter.detection import laws
from drift.evidence.filter.records import PlanSpec, Unit
from drift.planning.search.boats import daylight
from geo import notation, sphere
from geo.array import Array

MARGIN = 5.0  # [s] rounded legs on the sphere may take this much longer than on the plane
# share of the on-scene endurance used for search (Joint Pub 3-50, National SAR Supplement)
SHARE = 0.85


def moment(time: float) -> np.datetime64:
    """Return seconds since 1970 as a time in whole seconds."""
    return np.datetime64(round(time), "s")


@dataclass(frozen=True)
class Availability:
    """When and for how long a unit can search; times are seconds since 1970."""

    base: tuple[float, float]  # (lon, lat) [rad]
    leaves: float  # earliest departure
    transit_speed: float  # [m/s]
    spans: tuple[tuple[float, float], ...]  # (begin, end) in which it may search, in order
    search: float  # [s] of search in a sortie
    # returns the length [m] of the way to positions (lon, lat) [rad]; None: all ways are straight
    way: Callable[[npt.ArrayLike, npt.ArrayLike], Array] | None = None

    def arrival(self, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
        """Return the earliest arrival at positions [rad]."""
        way = sphere.distance(*self.base, lon, lat) if self.way is None else self.way(lon, lat)
        return np.asarray(self.leaves + way / self.transit_speed)

    def slot(self, earliest: npt.ArrayLike) -> tuple[Array, Array]:
        """Return begin and duration [s] of searches that may not begin before `earliest`.

        The duration is 0 if no time is left.
        """
        earliest = np.asarray(earliest, np.float64)
        start, length = earliest.copy(), np.zeros(earliest.shape)
        free = np.ones(earliest.shape, bool)
        for begin, end in self.spans:
            in_span = free & (earliest < end)
            start = np.where(in_span, np.maximum(earliest, begin), start)
            length = np.where(in_span, np.minimum(end - start, self.search), length)
            free &= ~in_span
        return start, length

    def within(self, begin: Array, end: Array, arrival: Array) -> Array:
        """Return how long [s] the unit can search in time intervals.

        Args:
            begin: of the intervals, shape (n,).
            end: of the intervals, shape (n,).
            arrival: of the unit at the place.
        """
        total = np.zeros(np.broadcast_shapes(np.shape(begin), np.shape(arrival)))
        for first, last in self.spans:
            total += np.maximum(
                np.minimum(end, last) - np.maximum(np.maximum(begin, first), arrival), 0.0
            )
        return total


def of_unit(
    unit: Unit, spec: PlanSpec, place: tuple[float, float], after: float | None = None
) -> Availability:
    """Return the availability of a unit.

    Args:
        unit: of the case.
        spec: of the plan.
        place: (lon, lat) [rad] where daylight is computed.
        after: earliest departure [s since 1970]; None: no further limit.
    """
    begin, until = float(notation.epoch(spec.begin)), float(notation.epoch(spec.until))
    leaves = max(begin, float(notation.epoch(unit.ready)), after if after is not None else -np.inf)
    spans = [(begin, until)]
    if unit.daylight:
        spans = daylight.windows(
            begin, until, float(np.degrees(place[0])), float(np.degrees(place[1]))
        )
    if laws.formulas_of(unit.law).detects != "anywhere":  # a search without legs needs no margin
        spans = [(first, last - MARGIN) for first, last in spans if last - first > MARGIN]
    base = tuple(float(v) for v in np.radians(unit.base))
    return Availability(
        (base[0], base[1]), leaves, unit.transit_speed, tuple(spans), SHARE * unit.endurance
    )
