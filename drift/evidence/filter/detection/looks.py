"""How likely a look sees what lies at each place, and so how well what it said fits each place.

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
    """Return the log probability of what a look said, given where the object was, float64 (n,);
    -inf: impossible.

    lon, lat: binary angles; there: whether the object was there to be seen, bool (n,).
    """
    assert look.field is not None
    chance = np.where(
        there, SIGHTS[look.sight.kind](look.sight, distance(look.field, lon, lat)), 0.0
    )
    return said(chance, look.positive, 1.0, look.false_alarms)


def said(chance: Array, positive: bool, detection: float, false_alarms: float) -> Array:
    """Return the log probability that a sensor says something, or that it says nothing.

    chance: that what it tells of was so, (n,); detection: that it then says so; false_alarms: that
    it says so all the same.
    """
    seen = false_alarms + (1 - false_alarms) * detection * chance
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(seen if positive else 1 - seen))


def distance(field: Field, lon: Array, lat: Array) -> Array:
    """Return how far from the middle of a field binary angles lie, in units of its half size, (n,)."""
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
