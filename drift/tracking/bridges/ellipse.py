"""Ellipses that contain a given probability of a normal distribution on the Earth.

A bivariate normal has the probability p within the ellipse x' C^-1 x = -2 log(1 - p). The
distribution is normal in the tangent plane of its mean, so the ellipse contains p exactly. It is
laid on the sphere along great circles (exponential map). Its area is that in the plane; an ellipse
with semi-axes of 300 nmi is smaller on the sphere by 0.06 %.
"""

import math

import numpy as np

from geo import sphere
from geo.array import Array
from geo.notation import NMI

CORNERS = 180  # of a polygon; its area is 0.02 % smaller than the ellipse's


def _factor(share: float) -> float:
    """Return -2 log(1 - p): the square of the ellipse's size in standard deviations."""
    if not 0 < share < 1:
        raise ValueError(f"probability {share:g} must lie between 0 and 1, like 0.5 or 0.95")
    return -2 * math.log1p(-share)


def polygon(
    lon: float, lat: float, covariance: Array, share: float, corners: int = CORNERS
) -> Array:
    """Return the ellipse about a mean that contains a share of the probability.

    Args:
        lon: of the mean [rad].
        lat: of the mean [rad].
        covariance: east and north [m2], shape (2, 2).
        share: of the probability, 0 to 1.
        corners: number of corners.

    Returns:
        Lon and lat [deg], shape (corners, 2), anticlockwise; the first corner is not repeated.
            Longitudes are continuous at 180 degrees.

    Raises:
        ValueError: `share` is outside 0 to 1.
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
    """Return the area [nmi2] of the ellipse that contains a share of the probability.

    Args:
        covariance: [m2], shape (..., 2, 2).
        share: of the probability, 0 to 1; outside it raises ValueError.
    """
    spread = np.sqrt(np.maximum(np.linalg.det(covariance), 0.0))
    return np.asarray(np.pi * _factor(share) * spread / NMI**2)


def axes(covariance: Array) -> tuple[Array, Array, Array]:
    """Return the standard deviations [m] along and across the ellipse's axes, and its direction.

    Args:
        covariance: east and north [m2], shape (..., 2, 2).

    Returns:
        Along the long axis, across it, and the direction of the long axis [rad] clockwise from
            north, from 0 up to half a turn.
    """
    value, vector = np.linalg.eigh(covariance)
    std = np.sqrt(np.maximum(value, 0.0))
    return (
        std[..., 1],
        std[..., 0],
        np.asarray(np.arctan2(vector[..., 0, 1], vector[..., 1, 1]) % np.pi),
    )


def held(offset: Array, covariance: Array) -> Array:
    """Return the share that the ellipse through a position contains.

    It is uniform on 0 to 1 if the distribution is correct.

    Args:
        offset: east and north of the mean [m], shape (..., 2).
        covariance: [m2], shape (..., 2, 2).
    """
    solved = np.linalg.solve(covariance, offset[..., None])[..., 0]
    return np.asarray(-np.expm1(-0.5 * (offset * solved).sum(-1)))
