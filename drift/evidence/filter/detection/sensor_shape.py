"""The area of a fixed sensor in the form that kernels take: a field, or a line.

A line consists of great circles, which are straight in its gnomonic plane.
"""

import math
from collections.abc import Sequence

import numpy as np

from drift.evidence.filter.records import Field
from geo import gnomonic, sphere
from geo.array import Array
from geo.polyline import LonLat
from kernels.evidence import observe
from kernels.evidence.observe import Shape


def of_field(field: Field, *, stays: bool) -> Shape:
    """Return the shape of a field.

    stays: whether it tests for staying in the field, else for touching it.
    """
    round_ = field.radius > 0
    half = np.array([field.radius, 0.0] if round_ else [field.width / 2, field.height / 2])
    kinds = (observe.DISC, observe.IN_DISC) if round_ else (observe.BOX, observe.IN_BOX)
    outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
    lon, lat = (float(x) for x in np.radians([field.lon, field.lat]))
    return _shape(kinds[stays], lon, lat, field.turned, half, outline, float(np.hypot(*half)))


def of_line(points: Sequence[LonLat]) -> Shape:
    """Return the shape of a line through two or more points [deg].

    The line lies in the gnomonic plane of its middle.
    """
    line = gnomonic.build_plane_line(points)
    return _shape(observe.LINE, line.lon, line.lat, 0.0, np.ones(2), line.corners, line.reach)


def _shape(
    kind: int, lon: float, lat: float, turned: float, half: Array, corners: Array, reach: float
) -> Shape:
    """Return a shape about a position [rad] that extends at most `reach` [m]."""
    x, y = (int(sphere.to_binary(math.degrees(angle))) for angle in (lon, lat))
    tall = math.ceil(1.01 * reach / (sphere.RADIUS * sphere.UNIT)) + 1
    # A cap of radius r spans asin(sin r / cos lat) of longitude to either side of its middle, or
    # all longitudes if it contains a pole.
    sine = math.sin(min(1.01 * reach / sphere.RADIUS, math.pi / 2)) / max(math.cos(lat), 1e-9)
    wide = math.ceil(math.asin(sine) / sphere.UNIT) + 1 if sine < 1 else 2**31 - 1
    south = max(y - tall, -(2**30))
    box = (
        (x - wide + 2**31) % 2**32 - 2**31,
        south,
        min(2 * wide, 2**32 - 1),
        min(y + tall, 2**30) - south,
    )
    flat = np.ascontiguousarray(corners, np.float32).reshape(-1)
    return Shape(
        kind, x, y, math.cos(turned), math.sin(turned), float(half[0]), float(half[1]), box, flat
    )
