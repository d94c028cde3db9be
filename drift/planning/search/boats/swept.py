"""The part of a boat's rectangle that is searched after its legs are cut at the coast.

The crew gets this part as its area. Otherwise a leg that is left out or ends early would make
unsearched sea count as searched.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from drift.evidence.filter import patterns
from drift.planning.search.boats.courses import Sailed
from drift.planning.search.rectangle import Laid
from geo import sphere
from geo.array import Array
from geo.polyline import LonLat

SAMPLES = 41  # points along each side of the area, to estimate its share of sea
AHEAD = 1000.0  # [m] distance over which the direction of the legs is measured


class Swept(NamedTuple):
    """The smallest rectangle of whole legs that contains everything sailed."""

    centre: LonLat  # [deg]
    length: float  # [m] along the legs, half a spacing beyond their ends
    width: float  # [m]
    orientation: float  # [rad] of the legs at its centre
    legs: int  # number of legs that are sailed at least in part
    first: int  # index of its first leg in the pattern
    # searching track over the track of an uncut pattern on the sea of this rectangle
    share: float


def area(
    laid: Laid, sailed: Sailed, length: float, spacing: float, sea: Callable[[Array, Array], Array]
) -> Swept:
    """Return the searched part of a rectangle.

    Args:
        laid: the rectangle.
        sailed: its legs cut at the coast.
        length: of the rectangle along the legs [m].
        spacing: between tracks [m].
        sea: returns the share of positions [rad], (c, n), that are sea, (c,).
    """
    legs = len(laid.pattern.legs.lon) // 2
    lon, lat = np.radians(sailed.lon), np.radians(sailed.lat)
    east, north = sphere.offset(
        math.radians(laid.centre[0]), math.radians(laid.centre[1]), lon, lat
    )
    sin, cos = np.sin(laid.turn), np.cos(laid.turn)
    along, across = east * sin + north * cos, east * cos - north * sin
    # Cross legs search too, but a pattern's legs are counted without them.
    own = np.flatnonzero(sailed.searching & (np.abs(np.diff(along)) > np.abs(np.diff(across))))
    own = own if own.size else np.flatnonzero(sailed.searching)  # all legs are on land
    middle = (across[own] + across[own + 1]) / 2
    number = np.rint(-laid.corner[1] * middle / spacing + (legs - 1) / 2).astype(int)
    ends = np.stack([along[own], along[own + 1]])
    low, high = (
        max(ends.min() - spacing / 2, -length / 2),
        min(ends.max() + spacing / 2, length / 2),
    )
    first, many = int(number.min()), int(np.ptp(number)) + 1
    centre = (low + high) / 2, -laid.corner[1] * (first + (many - legs) / 2) * spacing
    x, y = patterns.points_along(
        laid.centre, laid.turn, centre[0] + np.array([0.0, AHEAD]), np.full(2, centre[1])
    )
    ahead = sphere.offset(*np.radians([x[0], y[0], x[1], y[1]]))
    # convergence of meridians
    turned = float((np.arctan2(ahead[0], ahead[1]) - laid.turn + np.pi) % (2 * np.pi) - np.pi)
    ticks = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    places = patterns.points_along(
        laid.centre,
        laid.turn,
        *(
            v.ravel()
            for v in np.meshgrid(
                centre[0] + ticks * (high - low), centre[1] + ticks * many * spacing
            )
        ),
    )
    at_sea = float(sea(*np.radians(places)[:, None])[0])
    track = float(sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:])[sailed.searching].sum())
    full_track = (many * (high - low) - spacing) * at_sea
    share = float(min(track / full_track, 1.0)) if full_track > 0 else 1.0
    size = float(high - low), many * spacing
    return Swept(
        (float(x[0]), float(y[0])), *size, laid.turn + turned, len(np.unique(number)), first, share
    )
