"""Particle statuses, and the groups of statuses that products distinguish."""

from enum import IntEnum

import numpy as np

from geo.array import Array


class Status(IntEnum):
    """Codes in the ensemble's status column; kernels test ADRIFT == 0."""

    ADRIFT = 0
    ASHORE = 1
    OUTSIDE = 2  # no forcing here or now
    LEFT = 3  # left the case's domain
    SUNK = 4
    PENDING = 5  # not yet released, or not yet departed
    UNDER_WAY = 6  # steers
    ARRIVED = 7  # steered to the end of its itinerary
    AGROUND = 8  # stopped by the shore while under way


ON_MAP = (Status.ADRIFT, Status.ASHORE, Status.UNDER_WAY, Status.ARRIVED, Status.AGROUND)
AT_REST = (Status.ASHORE, Status.ARRIVED, Status.AGROUND)
STRANDED = (Status.ASHORE, Status.AGROUND)
LOST = (Status.OUTSIDE, Status.LEFT)
_ON_MAP, _AT_REST = (
    np.isin(list(Status), some) for some in (ON_MAP, AT_REST)
)  # by code: indexing is faster than np.isin


def on_map(status: Array) -> Array:
    """Return which particles are on the map: adrift, under way, or stopped there; bool, of any
    shape.
    """
    return np.asarray(_ON_MAP[status])


def at_rest(status: Array) -> Array:
    """Return which particles are on the map and have stopped (stranded, arrived, aground); bool,
    any shape.
    """
    return np.asarray(_AT_REST[status])


def under_way(status: Array) -> Array:
    """Return which targets are under way or stopped before they went adrift; bool, of any shape."""
    return np.asarray(status >= Status.UNDER_WAY)
