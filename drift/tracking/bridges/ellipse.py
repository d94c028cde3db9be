"""Ellipses that hold a given probability of a normal law on the Earth, as polygons, and their
areas.

A bivariate normal holds p within the ellipse x' C^-1 x = -2 log(1 - p). The law is normal in the
tangent plane of its mean, so that the ellipse holds p exactly, and is laid on the sphere along
great circles (exponential map). Its area is that in the plane: an ellipse with semi-axes of 300 nmi
is smaller on the sphere by 0.06 %.
"""

import math

import numpy as np

from geo import sphere
from geo.array import Array
from geo.notation import NMI

CORNERS = 180  # of a polygon: its area is 0.02 % below the ellipse's


def _factor(share: float) -> float:
    """Return -2 log(1 - p): the square of the ellipse's size in standard deviations."""
    if not 0 < share < 1:
        raise ValueError(f"probability {share:g} must lie between 0 and 1, like 0.5 or 0.95")
    return -2 * math.log1p(-share)


def polygon(
    lon: float, lat: float, covariance: Array, share: float, corners: int = CORNERS
) -> Array:
    """Return the ellipse about a mean that holds a share of the probability, (corners, 2), lon and
    lat [deg].

    lon, lat: of the mean [rad]. covariance: east and north [m2], (2, 2). The corners go round
    anticlockwise, the first is not repeated. Longitudes run on without a jump at 180 degrees.
    Raises ValueError for a share outside 0 to 1.
    """
    value, vector = np.linalg.eigh(covariance)
    turn = 2 * np.pi * np.arange(corners) / corners
    axes = vector * np.sqrt(np.maximum(value, 0.0) * _factor(share))
    if np.linalg.det(vector) < 0:
        axes[:, 0] = -axes[:, 0]
    east, north = axes @ np.stack([np.cos(turn), np.sin(turn)])
    x, y = sphere.destination(lon, lat, east, north)
    return np.column_stack([sphere.near_degrees(np.degrees(x), np.degrees(lon)), np.degrees(y)])


def area(covariance: Array, share: float) -> Array:
    """Return the area [nmi2] of the ellipse that holds a share; covariance: [m2], (..., 2, 2).

    Raises as `polygon`.
    """
    spread = np.sqrt(np.maximum(np.linalg.det(covariance), 0.0))
    return np.asarray(np.pi * _factor(share) * spread / NMI**2)


def axes(covariance: Array) -> tuple[Array, Array, Array]:
    """Return the standard deviations [m] along and across the ellipse's long axis, and its
    direction [rad, clockwise from north].

    covariance: east and north [m2], (..., 2, 2). The direction is from 0 up to half a turn.
    """
    value, vector = np.linalg.eigh(covariance)
    std = np.sqrt(np.maximum(value, 0.0))
    return (
        std[..., 1],
        std[..., 0],
        np.asarray(np.arctan2(vector[..., 0, 1], vector[..., 1, 1]) % np.pi),
    )


def held(offset: Array, covariance: Array) -> Array:
    """Return the share that the ellipse through a place holds, which is uniform on 0 to 1 where the
    law is true.

    offset: east and north of the mean [m], (..., 2). covariance: (..., 2, 2).
    """
    solved = np.linalg.solve(covariance, offset[..., None])[..., 0]
    return np.asarray(-np.expm1(-0.5 * (offset * solved).sum(-1)))
