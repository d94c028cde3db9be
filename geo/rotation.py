"""Directions of a grid's own axes on the Earth, and the turning of vectors from them to true east and north."""

import numpy as np
from numpy.typing import NDArray

from geo import sphere
from geo.layout import Array, Plane

STEP = 1e-4  # [rad] of a finite difference on the Earth: 640 m, error of the direction below 1e-8


def curved_angle(lon: Array, lat: Array) -> Array:
    """Return the angle [rad] of the x axis (growing column index) from east at points (ny, nx) [deg].

    The mean of the great-circle directions to the next column and from the last one: second order in the cell.
    """
    lon, lat = np.radians(lon), np.radians(lat)
    east, north = np.zeros_like(lon), np.zeros_like(lon)
    here, there = (lon[:, :-1], lat[:, :-1]), (lon[:, 1:], lat[:, 1:])
    ahead, back = sphere.offset(*here, *there), sphere.offset(*there, *here)
    for total, forward, backward in ((east, ahead[0], back[0]), (north, ahead[1], back[1])):
        total[:, :-1] += forward
        total[:, 1:] -= backward
    return np.asarray(np.arctan2(north, east))


def plane_axes(plane: Plane, lon: Array, lat: Array) -> NDArray[np.float32]:
    """Return the unit vectors of a projection's axes at points [deg]: (x's east, x's north, y's east, y's north).

    Found by stepping on the Earth, where a metre east and north mean the same everywhere, and inverting the
    2 x 2 matrix that maps the step to the plane: no convention about a meridian's convergence is needed.
    shape (..., 4), NaN where the projection has no image.
    """
    phi, lam = np.radians(lat), np.radians(lon)
    columns = []
    for east, north in ((STEP, 0.0), (0.0, STEP)):
        ahead = sphere.destination(lam, phi, east * sphere.RADIUS, north * sphere.RADIUS)
        behind = sphere.destination(lam, phi, -east * sphere.RADIUS, -north * sphere.RADIUS)
        there, back = (plane.to_plane(np.degrees(p[0]), np.degrees(p[1])) for p in (ahead, behind))
        columns.append((there[0] - back[0], there[1] - back[1]))
    (a, c), (b, d) = columns  # d(x, y) = [[a, b], [c, d]] d(east, north)
    with np.errstate(invalid="ignore", divide="ignore"):
        sign = np.sign(a * d - b * c)
        x_east, x_north, y_east, y_north = sign * d, sign * -c, sign * -b, sign * a
        x_size, y_size = np.hypot(x_east, x_north), np.hypot(y_east, y_north)
        result = np.stack((x_east / x_size, x_north / x_size, y_east / y_size, y_north / y_size), axis=-1)
    return np.asarray(np.where(np.isfinite(result), result, np.nan), np.float32)


def angle_axes(cosine: Array, sine: Array) -> NDArray[np.float32]:
    """Return the same four numbers for a right-angled grid whose x axis has this (unnormalised) direction."""
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.hypot(cosine, sine)
        c, s = cosine / size, sine / size
    return np.asarray(np.stack((c, s, -s, c), axis=-1), np.float32)


def turn(x: Array, y: Array, directions: NDArray[np.float32] | None) -> tuple[Array, Array]:
    """Return (east, north) of vectors with components along the axes; None: they are east and north already."""
    if directions is None:
        return x, y
    d = directions
    return x * d[..., 0] + y * d[..., 2], x * d[..., 1] + y * d[..., 3]
