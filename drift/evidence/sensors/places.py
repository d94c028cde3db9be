"""Interpolation weights of places at a position.

Weights are linear on Delaunay's triangles in the azimuthal equidistant plane about the middle of
the places, add up to 1, and are continuous everywhere except at the antipode of that middle.
Outside the places, the weights are those of the nearest point of their hull in the plane; nothing
is extrapolated. Places on a line, as two always are, are interpolated along it.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from geo import sphere
from geo.array import Array
from geo.errors import UserError

SAME = 100.0  # [m] closer places are duplicates
THIN = 0.02  # largest width over length of places that lie on a line
Weights = tuple[NDArray[np.int64], Array]  # places (k,) and their weights (k,), which add up to 1


@dataclass(frozen=True, eq=False)
class Places:
    """Places in a plane, joined by triangles or a line."""

    lon: float  # [rad] middle of the plane
    lat: float
    plane: Array  # (p, 2) [m] east and north
    mesh: Any = None  # Delaunay's triangles; None: a line
    hull: NDArray[np.int64] | None = None  # (h, 2) places at the ends of each edge of the hull
    order: NDArray[np.int64] | None = None  # (p,) places in order along the line
    along: Array | None = None  # (p,) [m] positions along the line, in this order, ascending
    direction: Array | None = None  # (2,) unit vector of the line


def join(lon: Array, lat: Array, name: str) -> Places:
    """Return at least two places joined by triangles or a line.

    Args:
        lon: longitudes [rad], shape (p,).
        lat: latitudes [rad], shape (p,).
        name: start of error messages.

    Raises:
        UserError: the places surround the Earth, or one is too close to others.
    """
    x, y, z = (float(v.mean()) for v in sphere.vector(lon, lat))
    if math.sqrt(x * x + y * y + z * z) < 1e-3:
        raise UserError(
            f"{name}: its points surround the globe, so no centre can be chosen; use points from one ocean basin"
        )
    middle = math.atan2(y, x), math.atan2(z, math.hypot(x, y))
    plane = np.stack(sphere.offset(*middle, lon, lat), axis=1)
    centred = plane - plane.mean(axis=0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    along, across = centred @ direction, centred @ np.array([-direction[1], direction[0]])
    order = np.argsort(along, kind="stable")
    width, steps = float(np.ptp(across)), np.diff(along[order])
    if len(plane) == 2 or (width <= THIN * np.ptp(along) and width < steps.min()):
        offset = float(plane.mean(axis=0) @ direction)
        return Places(*middle, plane, order=order, along=along[order] + offset, direction=direction)
    mesh = Delaunay(plane)
    # if the triangles left out a place, its table would not hold at its own position
    if mesh.coplanar.size:
        k = int(mesh.coplanar[0, 0])
        raise UserError(
            f"{name}: place {k + 1} is too close to the line or corner of others; leave it out"
        )
    return Places(*middle, plane, mesh=mesh, hull=np.asarray(mesh.convex_hull, np.int64))


def weights(places: Places, lon: float, lat: float) -> Weights:
    """Return the places to interpolate between, and their weights.

    Args:
        places: joined places.
        lon: longitude of the position [rad].
        lat: latitude of the position [rad].
    """
    east, north = sphere.offset(places.lon, places.lat, lon, lat)
    point = np.array([float(east), float(north)])
    if places.mesh is None:
        return _along(places, point)
    triangle = int(places.mesh.find_simplex(point))
    if triangle < 0:
        return _nearest(places, point)
    transform = places.mesh.transform[triangle]
    if not np.isfinite(transform).all():  # a triangle without area
        return _nearest(places, point)
    two = transform[:2] @ (point - transform[2])
    share = np.clip(np.array([two[0], two[1], 1.0 - two.sum()]), 0.0, 1.0)
    return np.asarray(places.mesh.simplices[triangle], np.int64), share / share.sum()


def _along(places: Places, point: Array) -> Weights:
    assert places.along is not None
    assert places.order is not None
    assert places.direction is not None
    where = float(np.clip(point @ places.direction, places.along[0], places.along[-1]))
    k = int(np.clip(np.searchsorted(places.along, where, "right") - 1, 0, len(places.along) - 2))
    share = (where - places.along[k]) / (places.along[k + 1] - places.along[k])
    return places.order[k : k + 2], np.array([1.0 - share, share])


def _nearest(places: Places, point: Array) -> Weights:
    """Return the weights at the nearest point of the hull."""
    assert places.hull is not None
    start, end = places.plane[places.hull[:, 0]], places.plane[places.hull[:, 1]]
    edge = end - start
    share = np.clip(((point - start) * edge).sum(axis=1) / (edge**2).sum(axis=1), 0.0, 1.0)
    k = int(np.argmin(((start + share[:, None] * edge - point) ** 2).sum(axis=1)))
    return places.hull[k], np.array([1.0 - share[k], share[k]])
