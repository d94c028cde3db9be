"""Observations as normal distributions in a plane, and their product.

Stroupe, Martin and Balch 2000, Merging Gaussian distributions for object localization in
multi-robot systems; equations 0.1 to 0.8 of Borovies 2007. This suits two bearings and ranges of
one position at one time. For targets that move between observations, or silent sensors, use clouds.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geo.array import Array


@dataclass(frozen=True)
class Gaussian:
    """A normal distribution of a position in a plane, east and north [m]."""

    mean: Array  # (2,)
    covariance: Array  # (2, 2)

    def __post_init__(self) -> None:
        """Raise ValueError unless the covariance is symmetric and positive definite."""
        if (
            not np.allclose(self.covariance, self.covariance.T)
            or not (np.linalg.eigvalsh(self.covariance) > 0).all()
        ):
            raise ValueError(
                f"{self.covariance.tolist()} is no covariance: it must be symmetric and positive definite"
            )


class Axes(NamedTuple):
    """Axes of the ellipse of one standard deviation."""

    major: float  # [m]
    minor: float  # [m]
    angle: float  # [rad] of the major axis, from north to east, 0 to pi


def observed(east: float, north: float, major: float, minor: float, angle: float) -> Gaussian:
    """Return the distribution of an observation.

    Args:
        east: of the position [m].
        north: of the position [m].
        major: standard deviation along the axis [m].
        minor: standard deviation across the axis [m].
        angle: of the axis from north to east [rad].
    """
    turned = np.array([[np.sin(angle), np.cos(angle)], [np.cos(angle), -np.sin(angle)]])
    return Gaussian(np.array([east, north]), turned @ np.diag([major**2, minor**2]) @ turned.T)


def merged(first: Gaussian, second: Gaussian) -> Gaussian:
    """Return the distribution of a position given two independent observations."""
    gain = np.linalg.solve(first.covariance + second.covariance, first.covariance).T
    covariance = first.covariance - gain @ first.covariance
    return Gaussian(first.mean + gain @ (second.mean - first.mean), (covariance + covariance.T) / 2)


def axes(of: Gaussian) -> Axes:
    """Return the axes of a distribution."""
    variance, direction = np.linalg.eigh(of.covariance)
    angle = float(np.arctan2(direction[0, 1], direction[1, 1])) % np.pi
    return Axes(float(np.sqrt(variance[1])), float(np.sqrt(variance[0])), angle)
