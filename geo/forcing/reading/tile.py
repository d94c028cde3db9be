"""A tile: two components on their own points, converted to true east and north on a regular grid.

If the points already form a regular longitude-latitude grid, values are used unchanged. Otherwise
each component is interpolated from its own points with the weights of `regrid.py` (so a staggered
grid needs no averaging first). The interpolation error is measured on the first slice.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.forcing.quantity import QUANTITIES
from geo.forcing.reading import slices
from geo.forcing.reading.component import Component
from geo.forcing.survey import Survey
from geo.grids import cost, layout, regrid, rotation, target
from geo.grids import grid as grids
from geo.grids.grid import Grid
from geo.grids.layout import Axes, Curved, Layout, Plane, Triangles, uniform

Values = NDArray[np.float32]


# [deg] on grids that reach beyond this latitude, vectors are interpolated in one polar frame
ABOUT_POLE = 85.0
# the row at a pole is consistent if its mean vector has at least this share of the largest speed
AGREES = 0.9


@dataclass(frozen=True)
class Tile:
    """How the two components of a source become vectors on a regular grid.

    layouts: points of the two components. matrices: interpolation weights, None if values are used
    unchanged. directions: (nlat, columns, 4) unit vectors of the components' axes, None if these
    are east and north. dry: points whose zeros are land, per component. about_pole: lon and lat of
    each point [rad] if vectors are interpolated in a polar frame, otherwise None.
    """

    grid: Grid
    components: tuple[Component, Component]
    layouts: tuple[Layout, Layout]
    matrices: tuple[sp.csr_matrix, sp.csr_matrix] | None
    directions: NDArray[np.float32] | None
    dry: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None
    notes: tuple[str, ...]
    about_pole: tuple[Array, Array] | None = None


@dataclass(frozen=True)
class Examined:
    """A tile and what its first slice shows.

    missing: share of nodes without a value; empty: all slices looked at are blank; strange: number
    of undeclared fill values.
    """

    tile: Tile
    missing: float
    empty: bool
    strange: int
    notes: tuple[str, ...]


def build_tile(
    components: tuple[Component, Component],
    layouts: tuple[Layout, Layout],
    axes: str,
    box: Box | None,
    onto: Grid | None = None,
) -> Tile:
    """Return the tile for two components and their (cropped) points.

    Args:
        components: of the source.
        layouts: their points.
        axes: "true", "grid" or "?".
        box: needed area; None for all.
        onto: the regular grid to interpolate to; None to choose one.
    """
    first, second = layouts
    notes: list[str] = []
    grid = regular(first, second) if onto is None else None
    matrices = None
    if grid is None:
        grid, coarser = target.choose(layouts, box) if onto is None else (onto, False)
        # a grid's own axes reverse direction at the fold of a tripolar grid
        sign = 1.0 if axes == "true" else -1.0
        weights = regrid.weights(first, grid, sign)
        matrices = (
            weights,
            weights if _identical(first, second) else regrid.weights(second, grid, sign),
        )
        kind = {
            Axes: "rectilinear",
            Plane: "projected",
            Curved: "curvilinear",
            Triangles: "triangular",
        }[type(first)]
        notes.append(
            f"{kind} grid regridded to a regular one of {grid.nlon} x {grid.nlat} nodes, "
            f"{grid.dlon:.4g} x {grid.dlat:.4g} degrees"
            + (
                f", coarser than wanted to stay under {target.MOST_NODES:,} nodes"
                if coarser
                else ""
            )
        )
        if not _same_points(first, second):
            notes.append(
                "the components have different points (a staggered grid): each is regridded from its own"
            )
    directions = _axis_directions(grid, layouts, matrices, axes, notes)
    about_pole = None
    if (
        matrices is not None
        and directions is None
        and np.abs(grid.lat).max() > ABOUT_POLE
        and not _is_scalar(components)
        and _same_points(first, second)
    ):
        lon, lat = layout.points(first)
        about_pole = np.radians(lon), np.radians(lat)
    return Tile(grid, components, layouts, matrices, directions, None, tuple(notes), about_pole)


def domain(tile: Tile) -> NDArray[np.bool_] | None:
    """Return the nodes (nlat, columns) inside the source's own domain; None if all are.

    For a triangular mesh it is None as well: the mesh ends at the coast, so a node outside it may
    be land.
    """
    if tile.matrices is None or any(isinstance(layout, Triangles) for layout in tile.layouts):
        return None
    has_weights = [m.getnnz(axis=1) > 0 for m in tile.matrices]
    inside = (has_weights[0] & has_weights[1]).reshape(tile.grid.nlat, -1)
    return np.concatenate([inside, inside[:, :1]], axis=1) if tile.grid.seamless else inside


def _identical(first: Layout, second: Layout) -> bool:
    """Return True if two layouts are bitwise equal; equal projections may not be recognized."""
    if type(first) is not type(second):
        return False
    pairs = ((getattr(first, field.name), getattr(second, field.name)) for field in fields(first))
    return all(
        a is b or (isinstance(a, np.ndarray | int | float) and np.array_equal(a, b))
        for a, b in pairs
    )


def _same_points(first: Layout, second: Layout) -> bool:
    """Return True if two components have the same points."""
    pairs = list(zip(layout.points(first), layout.points(second), strict=True))
    return all(
        a.shape == b.shape and np.allclose(a, b, atol=1e-6, equal_nan=True) for a, b in pairs
    )


def regular(first: Layout, second: Layout) -> Grid | None:
    """Return the regular grid that both layouts already form; None if they do not."""
    if not (isinstance(first, Axes) and isinstance(second, Axes)):
        return None
    if first.lon.shape != second.lon.shape or first.lat.shape != second.lat.shape:
        return None
    if not (
        np.allclose(first.lon, second.lon, atol=1e-6)
        and np.allclose(first.lat, second.lat, atol=1e-6)
    ):
        return None
    around = np.concatenate((first.lon, first.lon[:1] + 360.0)) if first.round else first.lon
    if not (uniform(around) and uniform(first.lat)):
        return None
    nlon, nlat = len(around), len(first.lat)
    return Grid(
        float(first.lon[0]),
        float(first.lat[0]),
        float(around[-1] - around[0]) / (nlon - 1),
        float(first.lat[-1] - first.lat[0]) / (nlat - 1),
        nlon,
        nlat,
    )


def _axis_directions(
    grid: Grid,
    layouts: tuple[Layout, Layout],
    matrices: tuple[sp.csr_matrix, sp.csr_matrix] | None,
    axes: str,
    notes: list[str],
) -> NDArray[np.float32] | None:
    first = layouts[0]
    if (
        matrices is None
        or isinstance(first, Axes)
        or (isinstance(first, Triangles) and first.projection is None)
    ):
        return None  # the axes are east and north, or the mesh has none
    if axes == "true":
        notes.append("components are true east and north as they stand")
        return None
    assumed = (
        ' (assumed: set variables.axes = "true" if they are east and north)' if axes == "?" else ""
    )
    lon, lat = grids.nodes(grid)
    if isinstance(first, Plane | Triangles):
        result = rotation.plane_axes(first, lon, lat)
        how = "the projection's axes"
    else:  # each component has its own axis: at a fold the two may come from different sides
        second = layouts[1] if isinstance(layouts[1], Curved) else first
        x, y = (
            rotation.carried_axis(
                matrix, item.lon, item.lat, _x_axis_angle(item) + quarter, lon, lat
            )
            for matrix, item, quarter in (
                (matrices[0], first, 0.0),
                (matrices[1], second, np.pi / 2),
            )
        )
        result = rotation.undone(x, y)
        how = "the grid's own axes"
    turned = np.degrees(np.arctan2(result[..., 1], result[..., 0]))
    turned = turned[np.isfinite(turned)]
    low, high = np.percentile(turned, (5, 95)) if turned.size else (np.nan, np.nan)
    notes.append(
        f"vectors rotated from {how} ({low:.1f} to {high:.1f} degrees from east) to true east and north{assumed}"
    )
    return result


def _x_axis_angle(item: Curved) -> Array:
    """Return the angle [rad] of a curvilinear grid's x axis from east at its points."""
    return (
        item.angle
        if item.angle is not None
        else rotation.curved_angle(item.lon, item.lat, layout.joins(item))
    )


def _read_components(tile: Tile, i: int) -> tuple[Array, Array, int]:
    """Return both components of slice i at their own points, and the number of undeclared fills."""
    values, strange = [], 0
    for k in (0, 1):
        value, count = slices.read_component_slice(tile.components[k], tile.layouts[k], i)
        if tile.dry is not None:
            value[tile.dry[k]] = np.nan
        values.append(value)
        strange += count
    return values[0], values[1], strange


def _interpolate(tile: Tile, x: Array, y: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return components (nlat, columns) interpolated to the grid, still along their own axes."""
    if tile.matrices is None:
        return np.asarray(x, np.float32), np.asarray(y, np.float32)
    shape = (tile.grid.nlat, tile.grid.columns)
    a, b = (
        regrid.regrid_values(m, v).reshape(shape)
        for m, v in zip(tile.matrices, (x, y), strict=True)
    )
    if tile.about_pole is not None:
        common = sphere.to_pole(*tile.about_pole, x, y)
        east, north = (
            regrid.regrid_values(m, v).reshape(shape)
            for m, v in zip(tile.matrices, common, strict=True)
        )
        rows = np.abs(tile.grid.lat) > ABOUT_POLE
        lon, lat = np.radians(tile.grid.lon[: tile.grid.columns]), tile.grid.lat[rows][:, None]
        a[rows], b[rows] = sphere.from_pole(lon, lat, east[rows], north[rows])
    return a, b


def _to_vectors(tile: Tile, x: NDArray[np.float32], y: NDArray[np.float32]) -> Values:
    """Rotate interpolated components to east and north; NaN where either is missing."""
    result = np.empty((tile.grid.nlat, tile.grid.nlon, 2), np.float32)
    own = tile.grid.columns
    result[:, :own, 0], result[:, :own, 1] = rotation.rotate_vectors(x, y, tile.directions)
    if own < tile.grid.nlon:
        result[:, own:] = result[:, :1]
    result[np.isnan(result).any(axis=2)] = np.nan
    if tile.grid.seamless and not _is_scalar(tile.components):
        for row, inner in ((0, 1), (-1, -2)):
            if abs(tile.grid.lat[row]) > 90.0 - 1e-6:
                result[row] = _pole_row(
                    result[row], result[inner], tile.grid.lon, float(tile.grid.lat[row])
                )
    return result


def _is_scalar(components: tuple[Component, Component]) -> bool:
    return QUANTITIES[components[0].quantity].scalar


def _pole_row(own: Values, inner: Values, lon: Array, lat: float) -> Values:
    """Return the row at a pole, where all columns are one point: one vector for all meridians.

    Files store it in several ways. If the columns of a file disagree, the vector is the mean of
    the adjacent row.

    Args:
        own: east and north [m/s] in the row at the pole, shape (nlon, 2).
        inner: those in the adjacent row, shape (nlon, 2).
    Args:
        own: east and north [m/s] of the row of the pole, shape (nlon, 2).
        inner: those of the row before it, shape (nlon, 2).
        lon: of the columns [deg], shape (nlon,).
        lat: of the pole, 90 or -90 [deg].
    """

    def mean(row: Values) -> Array:
        """Return the mean vector [m/s], in the frame of the prime meridian."""
        each = np.stack(sphere.to_pole(np.radians(lon), lat, *row.astype(float).T), axis=-1)[:-1]
        known = np.isfinite(each).all(axis=1)
        return np.asarray(each[known].mean(axis=0) if known.any() else np.full(2, np.nan))

    vector = mean(own)
    if not np.hypot(*vector) >= AGREES * np.nanmax(np.append(np.hypot(*own.T), 0.0)):
        vector = mean(inner)
    return np.stack(sphere.from_pole(np.radians(lon), lat, *vector), axis=-1).astype(np.float32)


def read_tile(tile: Tile, i: int) -> Values:
    """Return slice i: float32 (nlat, nlon, 2), true east and north [m/s], NaN missing.

    It is safe to call from any thread.
    """
    x, y, _ = _read_components(tile, i)
    return _to_vectors(tile, *_interpolate(tile, x, y))


def examine(tile: Tile, count: int, seen: Survey) -> Examined:
    """Examine the first slice: missing share, land nodes, and the cost of regridding.

    Args:
        tile: to examine; its `dry` is set in the result.
        count: number of slices of the source.
        seen: the survey of the source.
    """
    notes: list[str] = []
    if seen.dry:
        tile = replace(tile, dry=_dry_points(tile, seen.looked_at))
    x, y, strange = _read_components(tile, 0)
    if strange:
        notes.append(
            f"{strange} values of the first slice are fill values that the file does not declare: missing"
        )
    a, b = _interpolate(tile, x, y)
    first = _to_vectors(tile, a, b)
    missing = float(np.isnan(first[..., 0]).mean())
    empty = missing == 1.0 and not any(
        np.isfinite(read_tile(tile, i)).any() for i in {count // 2, count - 1} - {0}
    )
    if tile.matrices is not None and missing < 1.0:
        notes.append(cost.describe_cost(tile.grid, tile.layouts, (a, b), (x, y)))
    return Examined(tile, missing, empty, strange, tuple(notes))


def _dry_points(
    tile: Tile, looked_at: tuple[int, ...]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the points of each component that are exactly zero, or missing, in all these slices."""
    zero = [still(tile, i) for i in looked_at]
    return np.logical_and.reduce([u for u, _ in zero]), np.logical_and.reduce([v for _, v in zero])


def still(tile: Tile, i: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the points of each component that are exactly zero, or missing, in slice i."""
    values = _read_components(tile, i)[:2]
    u, v = (
        slices.still(value / c.factor, c, i) | np.isnan(value)
        for value, c in zip(values, tile.components, strict=True)
    )
    return (u & v, u & v) if u.shape == v.shape else (u, v)
