"""Density of a particle cloud by Parzen windows, and the smallest areas that contain a share.

Parzen 1962, On estimation of a probability density function and mode. The windows are normal, with
the width of Scott's rule for weighted particles (Scott 2015, Multivariate density estimation). The
grid's axes are those of the cloud, in which windows are products. Cells hold the windows'
integrals, so no window falls between cells, however narrow the cloud is and whatever its direction.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import special, stats

from drift.forecast import areas as outlines
from drift.tracking.tracker import path
from geo import sphere
from geo.array import Array

FINE = 4  # cells per window width
MOST = 1000  # most cells along an axis
ALONE = 0.5  # share of its own window that counts at a particle without neighbours
# fall of the log density beside the cloud, below the least value at a particle
FLOOR = 4.0
AT_ONCE = 20_000  # particles processed at once, to limit memory
BEYOND = 4.0  # margin of the grid beyond the outermost particles [window widths]
SAME = 0.01  # [m] rounding within which particles are at one position
LEAST = 10.0  # [m] least window width


@dataclass(frozen=True)
class Grid:
    """Cells along two axes in a tangent plane.

    The plane preserves distances and directions from its origin.
    """

    lon: float  # [rad]
    lat: float  # [rad]
    # (2, 2): columns are axes (east, north), the second a right angle anticlockwise of the first
    axes: Array
    x: Array  # [m] edges along the first, ascending, equidistant (nx + 1,)
    y: Array  # [m] along the second (ny + 1,)

    def middles(self) -> tuple[Array, Array]:
        """Return the cell centres [m] along both axes, (nx,) and (ny,)."""
        return (self.x[1:] + self.x[:-1]) / 2, (self.y[1:] + self.y[:-1]) / 2

    def places(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return (lon, lat) [rad] of points [m] of the plane."""
        east, north = self.axes @ np.stack([x.ravel(), y.ravel()])
        lon, lat = sphere.destination(self.lon, self.lat, east, north)
        return lon.reshape(x.shape), lat.reshape(x.shape)

    def areas(self) -> Array:
        """Return the area [m2] of each cell on the Earth, (ny, nx); 0 beyond the antipode."""
        apart = np.hypot(*np.meshgrid(*self.middles())) / sphere.RADIUS
        shrunk = np.where(apart < np.pi, np.sinc(apart / np.pi), 0.0)
        return np.asarray(shrunk * (self.x[1] - self.x[0]) * (self.y[1] - self.y[0]))

    def degrees(self, ring: Array) -> Array:
        """Return a ring [m] (n, 2) of the plane in degrees, with continuous longitudes.

        A ring around a pole is cut opposite the cloud and closed along the pole.
        """
        lon, lat = (np.degrees(v) for v in self.places(ring[:, 0], ring[:, 1]))
        lon = np.unwrap(np.append(np.degrees(self.lon), lon), period=360.0)[1:]
        if abs(lon[-1] - lon[0]) > 180.0:
            lon, lat = self._cut(lon, lat)
        return np.stack([lon, lat], axis=1)

    def _cut(self, lon: Array, lat: Array) -> tuple[Array, Array]:
        """Return a ring [deg] around a pole as one that begins and ends at a common meridian.

        Nested rings then have longitudes of the same turn.
        """
        turn, west = np.copysign(360.0, lon[-1] - lon[0]), np.degrees(self.lon) - 180.0
        side = np.floor((lon - west) / 360.0)
        k = int(np.flatnonzero(np.diff(side))[0])
        seam = west + 360.0 * max(side[k], side[k + 1])
        there = lat[k] + (lat[k + 1] - lat[k]) * (seam - lon[k]) / (lon[k + 1] - lon[k])
        lon, lat = (
            np.append(lon[k + 1 : -1], lon[: k + 1] + turn),
            np.append(lat[k + 1 : -1], lat[: k + 1]),
        )
        begin, pole = west if turn > 0 else west + 360.0, np.copysign(90.0, self.lat)
        ends = np.array([begin, begin + turn])
        lon = np.concatenate([ends[:1], lon + (begin - seam), ends[1:], ends[::-1], ends[:1]])
        return lon, np.concatenate([[there], lat, [there, pole, pole, there]])


@dataclass(frozen=True)
class Surface:
    """Density of a cloud in cells and at its particles."""

    grid: Grid
    height: Array  # [1/m2] (ny, nx); 0 on land
    # its logarithm, at least `floor`, with a border of that value (ny + 2, nx + 2)
    field: Array
    at_particles: Array  # [1/m2] (m,), density of the other particles
    weight: Array  # of the particles (m,), of sum 1


@dataclass(frozen=True)
class Region:
    """The smallest area that contains a share."""

    area: float  # [m2]
    outline: shapely.MultiPolygon  # [deg], unwrapped


def surface(
    place: Array, weight: Array, dry: Callable[[Array, Array], Array] | None = None
) -> Surface:
    """Return the density of particles, which must lie within a hemisphere.

    Args:
        place: unit vectors of the particles, shape (n, 3).
        weight: of the particles, shape (n,).
        dry: returns whether positions (lon, lat) [rad] are on land. Cells with their centre on land
            get density 0, unless all particles are in such cells.
    """
    lon, lat = np.radians(path.degrees(np.average(place, axis=0, weights=weight)))
    own = np.radians(path.degrees(place))
    points, weight = _distinct(
        np.stack(sphere.offset(lon, lat, own[0], own[1])), weight / weight.sum()
    )
    axes, width = _windows(points, weight)
    along = axes.T @ points
    grid = Grid(
        float(lon), float(lat), axes, *(_edges(*one) for one in zip(along, width, strict=True))
    )
    area = grid.areas()
    height = np.divide(
        _probability_in_cells(grid, along, width, weight),
        area,
        out=np.zeros(area.shape),
        where=area > 0,
    )
    wet = (
        np.ones(area.shape, bool)
        if dry is None
        else ~dry(*grid.places(*np.meshgrid(*grid.middles())))
    )
    x, y = (
        np.searchsorted(edges, own) - 1 for edges, own in zip((grid.x, grid.y), along, strict=True)
    )
    if not wet[y, x].any():
        wet[:] = True
    floor = float(np.log(height[y, x].min()) - FLOOR)
    field = np.pad(
        np.log(np.maximum(np.where(wet, height, 0.0), np.exp(floor))), 1, constant_values=floor
    )
    there = np.exp(outlines.interpolated(_lattice(grid), field, *along))
    cell = (grid.x[1] - grid.x[0]) * (grid.y[1] - grid.y[0])
    own_window = weight / (2 * np.pi * width.prod()) * cell / area[y, x]
    others = np.maximum((there - own_window) / np.maximum(1 - weight, ALONE), ALONE * there)
    others = np.maximum(
        others, np.exp(floor + FLOOR / 2)
    )  # keeps contours from reaching cell centres ashore
    return Surface(grid, np.where(wet, height, 0.0), field, others, weight)


def _lattice(grid: Grid) -> outlines.Lattice:
    """Return the cell centres, and one more row of centres all around."""
    x, y = (
        np.concatenate([[v[0] - d], v, [v[-1] + d]]) for v in grid.middles() for d in [v[1] - v[0]]
    )
    return outlines.Lattice(x, y, (float(x[1] - x[0]), float(y[1] - y[0])), grid.degrees)


def _windows(points: Array, weight: Array) -> tuple[Array, Array]:
    """Return the axes (2, 2) of a cloud, and the window width [m] along each.

    points: (2, n) [m]; weight: (n,), of sum 1.
    """
    squares = float((weight**2).sum())
    apart = points - (points @ weight)[:, None]
    # at least 0.5, the value for two particles; one particle has no spread
    spread, axes = np.linalg.eigh((apart * weight) @ apart.T / max(1 - squares, 0.5))
    axes[:, 1] *= np.sign(np.linalg.det(axes))
    return axes, np.maximum(np.sqrt(np.maximum(spread, 0.0)) * squares ** (1 / 6), LEAST)


def _edges(values: Array, width: float) -> Array:
    """Return cell edges that cover values [m] and their windows."""
    low, high = values.min() - BEYOND * width, values.max() + BEYOND * width
    return np.linspace(low, high, min(int(np.ceil((high - low) * FINE / width)), MOST) + 1)


def _probability_in_cells(grid: Grid, own: Array, width: Array, weight: Array) -> Array:
    """Return the probability in cells (ny, nx) of windows about points (2, n) [m]."""
    total = np.zeros((len(grid.y) - 1, len(grid.x) - 1))
    for some in np.array_split(np.arange(len(weight)), -(-len(weight) // AT_ONCE)):
        x, y = (
            np.diff(special.ndtr((edges[:, None] - own[k, some]) / width[k]), axis=0)
            for k, edges in enumerate((grid.x, grid.y))
        )
        total += (y * weight[some]) @ x.T
    return total


def _distinct(points: Array, weight: Array) -> tuple[Array, Array]:
    """Return positions (2, m) [m] and weights (m,), with those at one position merged.

    Duplicates that have not parted carry no more information than one. The window width depends on
    the number of distinct positions.
    """
    points, weight = points[:, weight > 0], weight[weight > 0]
    _, first, which = np.unique(
        np.round(points / SAME), axis=1, return_index=True, return_inverse=True
    )
    return points[:, first], np.bincount(which.ravel(), weights=weight)


def areas(found: Surface, shares: Sequence[float]) -> dict[float, Region]:
    """Return the smallest area that contains each share.

    It is where the density exceeds that at the remaining particles (Hyndman 1996, Computing and
    graphing highest density regions). The density at a particle is that of all others, so smoothing
    by the windows does not change the share that an area contains.

    Args:
        found: density of a cloud.
        shares: 0 to 1.
    """
    lattice = _lattice(found.grid)
    order = np.argsort(-found.at_particles, kind="stable")
    cumulative = np.cumsum(found.weight[order])
    regions = {}
    for share in shares:
        least = found.at_particles[order[np.searchsorted(cumulative, share)]]
        regions[share] = Region(*outlines.contour(lattice, found.field, float(np.log(least))))
    return regions


def holds(found: Region, place: Array) -> Array:
    """Return whether unit vectors (n, 3) are within a region, shape (n,)."""
    lon, lat = path.degrees(place)
    west, _, east, _ = found.outline.bounds
    return np.asarray(
        shapely.contains_xy(found.outline, sphere.near_degrees(lon, (west + east) / 2), lat)
    )


def along(
    values: Array, weight: Array, width: float, at: Array, period: float | None = None
) -> Array:
    """Return the density of a scalar at some values, by normal windows.

    Args:
        values: shape (n,).
        weight: of the values, shape (n,).
        width: standard deviation of the windows.
        at: where the density is evaluated, shape (m,).
        period: of a periodic quantity such as a course; windows should be much narrower.
    """
    apart = at[:, None] - values
    if period is not None:
        apart = (apart + period / 2) % period - period / 2
    return np.asarray(stats.norm.pdf(apart, scale=width) @ (weight / weight.sum()))
