"""Lines in a gnomonic plane, in which every great circle is straight."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geo import sphere
from geo.array import Array
from geo.polyline import LonLat

# largest angle between the middle of a line and its points; the plane is stretched by 1.7 there
LONGEST = math.radians(40)
SAME = 1.0  # [m] points closer than this count as one


@dataclass(frozen=True)
class PlaneLine:
    """A polyline of great circles in the gnomonic plane about its middle."""

    lon: float  # [rad] the middle, at a whole binary angle
    lat: float
    corners: Array  # (m, 2) [m] east and north
    reach: float  # [m] from the middle to the farthest corner, on the Earth


def build_plane_line(points: Sequence[LonLat]) -> PlaneLine:
    """Return a line through points [deg] in the gnomonic plane about its middle.

    Raises ValueError for a line without length, and for one that is too long for one plane.
    """
    lon, lat = np.radians(np.array(points, np.float64)).T
    x, y, z = (
        float(v.mean()) for v in (np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat))
    )
    here = sphere.to_binary(np.degrees([math.atan2(y, x), math.atan2(z, math.hypot(x, y))]))
    middle_lon, middle_lat = (float(angle) for angle in here * sphere.UNIT)
    east, north = sphere.offset(middle_lon, middle_lat, lon, lat)
    arc = np.hypot(east, north) / sphere.RADIUS
    if math.hypot(x, y, z) < 1e-6 or arc.max() > LONGEST:
        raise ValueError(
            f"they reach {math.degrees(arc.max()):.0f} degrees from their middle; at most "
            f"{math.degrees(LONGEST):.0f} are allowed: make two lines of it"
        )
    scale = np.where(arc > 1e-9, np.tan(arc) / np.maximum(arc, 1e-9), 1.0)
    plane = np.stack([east * scale, north * scale], axis=1)
    keep = [0]
    for k in range(1, len(plane)):
        if math.dist(plane[k], plane[keep[-1]]) > SAME:
            keep.append(k)
    if len(keep) < 2:
        raise ValueError("the line has no length: all its points are the same")
    return PlaneLine(middle_lon, middle_lat, plane[keep], float(arc.max()) * sphere.RADIUS)
