"""Where a cloud is dense: Parzen's windows on its places, and the smallest areas that hold shares of it.

Parzen 1962, On estimation of a probability density function and mode. The windows are normal, of the width of Scott's rule by
the weights (Scott 2015, Multivariate density estimation); the areas are those of forecasts.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import stats

from drift.forecast import areas as outlines
from drift.tracker import path
from geo import sphere
from geo.array import Array
from geo.cells import Cells

CELLS = 160  # along the longer side
BEYOND = 4.0  # widths of a window beyond the outermost particles
SAME = 0.01  # [m] within which particles are at one place
LEAST = 10.0  # [m] a cloud on a line or at a point is taken to be so wide


@dataclass(frozen=True)
class Surface:
    """The probability of a cloud in cells."""

    cells: Cells
    mass: Array  # (nlat, nlon), of sum 1


@dataclass(frozen=True)
class Region:
    """The smallest area that holds a share."""

    area: float  # [m2]
    outline: shapely.MultiPolygon  # [deg], unwrapped


def surface(place: Array, weight: Array, dry: Callable[[Array, Array], Array] | None = None) -> Surface:
    """Return the density of particles at unit vectors (n, 3) with weights (n,), that lie within a hemisphere.

    dry: returns whether places (lon, lat) [rad] are on land; cells whose middles are have nothing, unless all are.
    """
    lon, lat = np.radians(path.degrees(np.average(place, axis=0, weights=weight)))
    own = np.radians(path.degrees(place))
    points, weight = _distinct(np.stack(sphere.offset(lon, lat, own[0], own[1])), weight)
    if len(weight) < 3 or np.linalg.eigvalsh(np.cov(points, aweights=weight))[0] < LEAST**2:
        corners = LEAST * np.array([[1, 1, -1, -1], [1, -1, 1, -1]])
        points, weight = (points[:, :, None] + corners[:, None]).reshape(2, -1), np.repeat(weight, 4)
    kernel = stats.gaussian_kde(points, weights=weight)
    pad = BEYOND * np.sqrt(np.diag(kernel.covariance))
    low, high = points.min(axis=1) - pad, points.max(axis=1) + pad
    cells = _cells(float(lon), float(lat), low, high)
    x, y = np.meshgrid(np.radians(cells.lon()), np.radians(cells.lat()))
    at = np.stack(sphere.offset(lon, lat, x.ravel(), y.ravel()))
    mass = kernel(at).reshape(cells.shape) * cells.area()[:, None]
    wet = mass if dry is None else np.where(dry(x, y), 0.0, mass)
    mass = wet if wet.any() else mass
    return Surface(cells, mass / mass.sum())


def effective(place: Array, weight: Array) -> float:
    """Return the effective number of particles at unit vectors (n, 3) with weights (n,); those of one place are one."""
    _, which = np.unique(np.round(place * sphere.RADIUS / SAME), axis=0, return_inverse=True)
    share = np.bincount(which.ravel(), weights=weight)
    return float(share.sum() ** 2 / (share**2).sum())


def _distinct(points: Array, weight: Array) -> tuple[Array, Array]:
    """Return places (2, m) [m] and weights (m,) with those of one place together: duplicates that have not parted tell no more than one.

    The width of the windows goes by how many there are.
    """
    _, first, which = np.unique(np.round(points / SAME), axis=1, return_index=True, return_inverse=True)
    return points[:, first], np.bincount(which.ravel(), weights=weight)


def _cells(lon: float, lat: float, low: Array, high: Array) -> Cells:
    """Return cells over a rectangle [m] of the plane that touches a place [rad]."""
    corners = np.array(
        [[low[0], 0, high[0], low[0], high[0], low[0], high[0]], [0, high[1], 0, low[1], low[1], high[1], high[1]]]
    )
    to = sphere.destination(lon, lat, *corners)
    west, east = (float(f((to[0] - lon + np.pi) % (2 * np.pi) - np.pi)) + lon for f in (np.min, np.max))
    south, north = (
        float(min(to[1].min(), lat + low[1] / sphere.RADIUS)),
        float(max(to[1].max(), lat + high[1] / sphere.RADIUS)),
    )
    south, north = max(south, -np.pi / 2), min(north, np.pi / 2)
    wide, high_ = (east - west) * np.cos((south + north) / 2), north - south
    side = max(wide, high_) / CELLS
    nlon, nlat = max(int(np.ceil(wide / side)), 3), max(int(np.ceil(high_ / side)), 3)
    width, height = (int(np.ceil(v / sphere.UNIT)) for v in ((east - west) / nlon, (north - south) / nlat))
    return Cells(int(np.floor(west / sphere.UNIT)), int(np.floor(south / sphere.UNIT)), width, height, nlon, nlat)


def areas(found: Surface, shares: Sequence[float]) -> dict[float, Region]:
    """Return the smallest area that holds each share."""
    _, sizes, shapes = outlines.outlined(found.cells, found.mass, shares)
    return {share: Region(float(size), shape) for share, size, shape in zip(shares, sizes, shapes, strict=True)}


def along(values: Array, weight: Array, width: float, at: Array, period: float | None = None) -> Array:
    """Return the density of a quantity (n,) with weights (n,) at values (m,), by normal windows of a standard deviation.

    period: of a quantity that comes back to where it began, like a course; the window should be much narrower.
    """
    apart = at[:, None] - values
    if period is not None:
        apart = (apart + period / 2) % period - period / 2
    return np.asarray(stats.norm.pdf(apart, scale=width) @ (weight / weight.sum()))
