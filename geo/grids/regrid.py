"""Sparse weights that interpolate values from any layout to a regular grid.

Interpolation is bilinear inside cells of structured grids and linear inside triangles. The weights
are computed once; each slice then costs one product with the matrix. A node gets the weighted mean
of present values if their weights add up to at least one half, otherwise it is missing. So land
keeps its outline to within half a source cell.
"""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from geo.array import Array
from geo.grids import cell_weights
from geo.grids import grid as grids
from geo.grids.grid import Grid
from geo.grids.layout import Axes, Curved, Index, Layout, Plane

WET = 0.5  # least total weight of present values for a node to have a value


def weights(layout: Layout, grid: Grid, mirrored: float = 1.0) -> sp.csr_matrix:
    """Return the matrix (nodes, points) that interpolates raveled values to raveled grid nodes.

    The last column of a seamless grid, which repeats the first, is not included. Rows of nodes
    outside the layout are empty; other rows add up to 1, except at the fold of a tripolar grid.

    Args:
        layout: of the source.
        grid: the target.
        mirrored: sign of weights on points beyond the fold.
    """
    if isinstance(layout, Axes):
        matrix = _axes_weights(layout, grid)
    elif isinstance(layout, Plane):
        matrix = _plane_weights(layout, grid)
    elif isinstance(layout, Curved):
        matrix = cell_weights.of_curved(layout, grid, mirrored)
    else:
        matrix = cell_weights.of_triangles(layout, grid)
    return matrix.astype(np.float32)


def regrid_values(matrix: sp.csr_matrix, values: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return values at a layout's points interpolated to a grid's nodes.

    A node is NaN if too few values are present.

    Args:
        matrix: from `weights`.
        values: at the points, NaN for missing.

    Returns:
        Values at the nodes, shape (nodes,).
    """
    source = np.ravel(values).astype(np.float32)
    present = np.isfinite(source)
    total = matrix @ np.where(present, source, np.float32(0))
    plain = matrix if matrix.data.min(initial=0) >= 0 else abs(matrix)
    weight = plain @ present.astype(np.float32)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(
            np.where(weight >= WET - 1e-4, total / weight, np.float32(np.nan)), np.float32
        )


def _locate_on_line(nodes: Array, where: Array) -> tuple[Index, Array, NDArray[np.bool_]]:
    """Return (i, fraction, inside) of positions along monotonic nodes; i: lower index of a pair."""
    falling = nodes[0] > nodes[-1]
    up = nodes[::-1] if falling else nodes
    slack = 1e-5 * (up[-1] - up[0]) / (len(up) - 1)
    inside = (where >= up[0] - slack) & (where <= up[-1] + slack)
    where = np.clip(np.where(inside, where, up[0]), up[0], up[-1])
    i = np.clip(np.searchsorted(up, where, "right") - 1, 0, len(up) - 2)
    fraction = (where - up[i]) / (up[i + 1] - up[i])
    if falling:
        return len(up) - 2 - i, 1 - fraction, inside
    return i, fraction, inside


def _linear_weights(nodes: Array, where: Array, count: int) -> sp.csr_matrix:
    """Return the matrix of linear interpolation along one axis.

    Nodes beyond `count` wrap around to the first ones.
    """
    i, fraction, inside = _locate_on_line(nodes, where)
    k = np.arange(len(where))
    keep = np.nonzero(inside)[0]
    row = np.concatenate((k[keep], k[keep]))
    column = np.concatenate((i[keep], i[keep] + 1)) % count
    data = np.concatenate((1 - fraction[keep], fraction[keep]))
    return sp.csr_matrix((data, (row, column)), shape=(len(where), count))


def _axes_weights(axes: Axes, grid: Grid) -> sp.csr_matrix:
    """Return bilinear weights in a rectilinear grid, shape (nodes, points)."""
    lon = np.concatenate((axes.lon, axes.lon[:1] + 360.0)) if axes.round else axes.lon
    east = lon[0] + (grid.lon[: grid.columns] - lon[0] + 1e-7) % 360.0 - 1e-7
    matrix = sp.kron(
        _linear_weights(axes.lat, grid.lat, len(axes.lat)),
        _linear_weights(lon, east, len(axes.lon)),
        format="csr",
    )
    matrix.eliminate_zeros()
    return matrix


def _plane_weights(plane: Plane, grid: Grid) -> sp.csr_matrix:
    """Return bilinear weights in a projection's plane, shape (nodes, points)."""
    x, y = (np.ravel(v) for v in plane.to_plane(*grids.nodes(grid)))
    i, fx, inside_x = _locate_on_line(plane.x, x)
    j, fy, inside_y = _locate_on_line(plane.y, y)
    keep = np.nonzero(inside_x & inside_y)[0]
    i, fx, j, fy = i[keep], fx[keep], j[keep], fy[keep]
    corner = (
        (0, 0, (1 - fx) * (1 - fy)),
        (0, 1, fx * (1 - fy)),
        (1, 0, (1 - fx) * fy),
        (1, 1, fx * fy),
    )
    column = np.concatenate([(j + dj) * len(plane.x) + i + di for dj, di, _ in corner])
    data = np.concatenate([weight for _, _, weight in corner])
    matrix = sp.csr_matrix(
        (data, (np.tile(keep, 4), column)), shape=(x.size, len(plane.x) * len(plane.y))
    )
    matrix.eliminate_zeros()
    return matrix
