"""Directions of a grid's axes on the Earth, and rotation of vectors to true east and north."""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from geo import sphere
from geo.array import Array
from geo.grids.layout import Plane, Triangles

# least area spanned by two interpolated unit axes; it is smaller where axes meet, at a grid pole
LEAST = 0.1
STEP = 1e-4  # [rad] finite difference on the Earth (640 m); the direction's error is below 1e-8


def curved_angle(lon: Array, lat: Array, joined: NDArray[np.bool_] | None = None) -> Array:
    """Return the angle [rad] of the x axis (growing column index) from east.

    It is the mean of the great-circle directions to the next column and from the previous one,
    which is second order in the cell size. NaN if neither neighbour is present.

    Args:
        lon: of the points [deg], shape (ny, nx).
        lat: of the points [deg], shape (ny, nx).
        joined: as in `layout.Curved`.
    """
    nx = lon.shape[1]
    lon, lat = np.radians(lon), np.radians(lat)
    near = np.nonzero(np.arange(nx) < nx - 1 if joined is None else joined)[0]
    after = (near + 1) % nx
    east, north = np.zeros_like(lon), np.zeros_like(lon)
    here, there = (lon[:, near], lat[:, near]), (lon[:, after], lat[:, after])
    ahead, back = sphere.offset(*here, *there), sphere.offset(*there, *here)
    for total, forward, backward in ((east, ahead[0], back[0]), (north, ahead[1], back[1])):
        total[:, near] += np.nan_to_num(forward)
        total[:, after] -= np.nan_to_num(backward)
    return np.where((east == 0) & (north == 0), np.nan, np.arctan2(north, east))


def carried_axis(
    matrix: sp.csr_matrix, lon: Array, lat: Array, angle: Array, node_lon: Array, node_lat: Array
) -> NDArray[np.float32]:
    """Return unit vectors along an axis, interpolated from points to nodes as 3-D vectors.

    Neither the pole nor the antimeridian is a special case then. The result is a little shorter
    than 1 where directions vary, and 0 at nodes without weights.

    Args:
        matrix: interpolation weights, (nodes, points).
        lon: of the points [deg].
        lat: of the points [deg].
        angle: of the axis from east at the points [rad].
        node_lon: of the nodes [deg], shape (...).
        node_lat: of the nodes [deg], shape (...).

    Returns:
        (east, north), shape (..., 2).
    """
    phi, lam = np.radians(np.ravel(lat)), np.radians(np.ravel(lon))
    c, s = (np.nan_to_num(np.ravel(f(angle))) for f in (np.cos, np.sin))
    x = matrix @ np.nan_to_num(-c * np.sin(lam) - s * np.sin(phi) * np.cos(lam))
    y = matrix @ np.nan_to_num(c * np.cos(lam) - s * np.sin(phi) * np.sin(lam))
    z = matrix @ np.nan_to_num(s * np.cos(phi))
    phi, lam = np.radians(np.ravel(node_lat)), np.radians(np.ravel(node_lon))
    east = -np.sin(lam) * x + np.cos(lam) * y
    north = np.cos(phi) * z - np.sin(phi) * (np.cos(lam) * x + np.sin(lam) * y)
    return np.asarray(np.stack((east, north), -1).reshape(*node_lon.shape, 2), np.float32)


def undone(x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the four numbers for `turn` from interpolated axes x and y, each (east, north).

    A component is interpolated like its axis. So a vector that is equal at all corners of a cell is
    reproduced exactly, however the axes turn inside; only the error of interpolating the vector
    remains. Shape (..., 4), NaN where there are no axes.
    """
    det = x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        back = np.stack((y[..., 1], -y[..., 0], -x[..., 1], x[..., 0]), -1) / det[..., None]
    return np.asarray(np.where(np.abs(det)[..., None] > LEAST, back, np.nan), np.float32)


def plane_axes(plane: Plane | Triangles, lon: Array, lat: Array) -> NDArray[np.float32]:
    """Return the unit vectors of a projection's axes at points [deg], shape (..., 4).

    The four numbers are (x's east, x's north, y's east, y's north), NaN outside the projection's
    domain. They come from finite differences on the Earth, where a metre east and a metre north are
    equal everywhere: inverting the 2 x 2 matrix from steps to the plane needs no convention about
    the convergence of meridians.
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
        result = np.stack(
            (x_east / x_size, x_north / x_size, y_east / y_size, y_north / y_size), axis=-1
        )
    return np.asarray(np.where(np.isfinite(result), result, np.nan), np.float32)


def rotate_vectors(
    x: Array, y: Array, directions: NDArray[np.float32] | None
) -> tuple[Array, Array]:
    """Return (east, north) of vectors from components along axes.

    Args:
        x: component along the first axis.
        y: component along the second axis.
        directions: (..., 4) as from `plane_axes` or `undone`; None if the axes are east and north.
    """
    if directions is None:
        return x, y
    d = directions
    return x * d[..., 0] + y * d[..., 2], x * d[..., 1] + y * d[..., 3]
