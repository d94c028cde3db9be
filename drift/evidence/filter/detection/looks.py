"""Probability of detection of a look by position, and the likelihood of its result.

Nunez, Singham and Atkinson 2020, doi:10.1080/01605682.2019.1570806, eqs. 13 to 15: distances are in
units of the field's half size, max(2 |x| / W, 2 |y| / H) in a box and r / R in a circle.
"""

import math
from collections.abc import Callable

import numpy as np

from drift.evidence.filter.records import Field, Look, Sight
from geo import sphere
from geo.array import Array


def log_likelihood(look: Look, lon: Array, lat: Array, there: Array) -> Array:
    """Return the log probability of a look's result, given each position; -inf: impossible.

    Args:
        look: at a field.
        lon: binary angles, shape (n,).
        lat: binary angles, shape (n,).
        there: whether the object was detectable, bool (n,).

    Returns:
        Log probabilities, float64 (n,).
    """
    assert look.field is not None
    chance = np.where(
        there, SIGHTS[look.sight.kind](look.sight, distance(look.field, lon, lat)), 0.0
    )
    return log_report_probability(chance, look.positive, 1.0, look.false_alarms)


def log_report_probability(
    chance: Array, positive: bool, detection: float, false_alarms: float
) -> Array:
    """Return the log probability of a sensor's report, float64 (n,).

    Args:
        chance: probability of the event that the sensor detects, shape (n,).
        positive: whether it reported the event.
        detection: probability of a report if the event happens.
        false_alarms: probability of a report otherwise.
    """
    seen = false_alarms + (1 - false_alarms) * detection * chance
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(seen if positive else 1 - seen))


def distance(field: Field, lon: Array, lat: Array) -> Array:
    """Return the distance of binary angles from the middle of a field, in half sizes, (n,)."""
    at_lon, at_lat = math.radians(field.lon), math.radians(field.lat)
    east, north = sphere.offset(at_lon, at_lat, lon * sphere.UNIT, lat * sphere.UNIT)
    if field.radius > 0:
        return np.asarray(np.hypot(east, north) / field.radius)
    c, s = math.cos(field.turned), math.sin(field.turned)
    x, y = east * c - north * s, east * s + north * c
    return np.asarray(np.maximum(2 / field.width * np.abs(x), 2 / field.height * np.abs(y)))


def _cookie_cutter(sight: Sight, far: Array) -> Array:
    return np.asarray(far <= 1, np.float64)


def _linear(sight: Sight, far: Array) -> Array:
    return np.asarray(1 - sight.number * np.minimum(far, 1))


def _exponential(sight: Sight, far: Array) -> Array:
    return np.asarray(np.exp(-(far**sight.number)))


def _table(sight: Sight, far: Array) -> Array:
    return np.interp(far, sight.distances, sight.chances, right=0.0)


SIGHTS: dict[str, Callable[[Sight, Array], Array]] = {
    "cookie_cutter": _cookie_cutter,
    "linear": _linear,
    "exponential": _exponential,
    "table": _table,
}
