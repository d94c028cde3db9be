"""Interpolation weights in the cells of a curvilinear grid or a mesh.

The target grid is finer than the source, so every source cell contains a few target nodes. So the
code loops over cells and tests the nodes in each cell's bounding box, instead of searching the cell
of each node.
"""

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from geo import sphere
from geo.array import Array
from geo.grids import layout
from geo.grids.grid import Grid
from geo.grids.layout import Curved, Index, Triangles

CHUNK = 2_000_000  # number of (cell, node) candidates handled at a time
# cosine of 60 degrees, the largest angle between a cell's middle and its corners; larger cells are
# left out
NEAR = 0.5
# tolerance, as a share of a cell, for nodes outside the grid's rim, which bulges against parallels
RIM = 0.01
SLACK = 1e-6  # tolerance for rounding errors, as a share of a cell

# (nodes, points, weights of points, distance of the node outside the cell)
Part = tuple[Index, Index, Array, Array]


def of_curved(curved: Curved, grid: Grid, mirrored: float = 1.0) -> sp.csr_matrix:
    """Return bilinear weights in the cells of a curvilinear grid, shape (nodes, points).

    Args:
        curved: the grid; cells across its seam and its fold are included.
        grid: the target grid.
        mirrored: sign of weights on points beyond the fold: -1 for components along the grid's own
            axes, which reverse there.
    """
    ny, nx = curved.lon.shape
    lon, lat = np.ravel(curved.lon), np.ravel(curved.lat)
    parts: list[Part] = []
    band = max(1, CHUNK // (8 * nx))
    for j in range(0, ny - 1, band):
        corners = layout.cells(curved, np.arange(j, min(j + band, ny - 1))).reshape(-1, 4)
        parts += _bilinear(lon, lat, corners, grid, np.ones(4))
    parts += _bilinear(
        lon, lat, layout.fold_cells(curved), grid, np.array([1.0, 1.0, mirrored, mirrored])
    )
    return _assemble(parts, grid, ny * nx)


def _bilinear(lon: Array, lat: Array, corners: Index, grid: Grid, sign: Array) -> list[Part]:
    """Return weights in cells with corners (m, 4), given as point indices in cyclic order.

    sign: of the weight on each corner, (4,).
    """
    parts: list[Part] = []
    for cell, node, x, y, px, py in _candidates(lon[corners], lat[corners], grid):
        s, t = _inverse_bilinear(px, py, x, y)
        outside = np.maximum(np.maximum(-s, s - 1), np.maximum(-t, t - 1))
        hit = outside <= RIM  # False where Newton's method failed
        s, t = np.clip(s[hit], 0, 1), np.clip(t[hit], 0, 1)
        share = np.stack(((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t), 1) * sign
        parts.append((node[hit], corners[cell[hit]], share, np.maximum(outside[hit], SLACK)))
    return parts


def of_triangles(mesh: Triangles, grid: Grid) -> sp.csr_matrix:
    """Return linear weights in triangles, shape (nodes of the grid, values).

    Values at mesh nodes are interpolated inside the mesh's triangles. Values at centres are
    interpolated inside triangles of a centre and two neighbouring nodes. A node's value is then
    the weighted mean of the elements around it, with the pseudo-Laplacian weights of Holmes and
    Connell (1989, doi:10.2514/6.1989-1932), which are exact for linear fields.
    """
    if mesh.lonc is None or mesh.latc is None:
        return _linear(mesh.lon, mesh.lat, mesh.cells, grid)
    count = len(mesh.cells)
    lon, lat = np.concatenate((mesh.lonc, mesh.lon)), np.concatenate((mesh.latc, mesh.lat))
    centre = np.arange(count)
    fans = []
    for k in range(mesh.cells.shape[1]):  # polygons with fewer corners are padded with -1
        a, b = mesh.cells[:, k], mesh.cells[:, (k + 1) % mesh.cells.shape[1]]
        b = np.where(b < 0, mesh.cells[:, 0], b)
        fans.append(np.stack((centre, count + a, count + b), 1)[a >= 0])
    at_nodes = _pseudo_laplacian(mesh)
    spread = sp.vstack((sp.identity(count, format="csr"), at_nodes), format="csr")
    return sp.csr_matrix(_linear(lon, lat, np.concatenate(fans), grid) @ spread)


def _pseudo_laplacian(mesh: Triangles) -> sp.csr_matrix:
    """Return the matrix (nodes, elements) that averages the elements around each node.

    It is exact for linear fields.
    """
    assert mesh.lonc is not None
    assert mesh.latc is not None
    n, corner = len(mesh.lon), mesh.cells >= 0
    element, node = np.nonzero(corner)[0], mesh.cells[corner]
    dx = sphere.wrap_degrees(mesh.lonc[element] - mesh.lon[node]) * np.cos(
        np.radians(mesh.lat[node])
    )
    dy = mesh.latc[element] - mesh.lat[node]

    def total(values: Array) -> Array:
        return np.asarray(np.bincount(node, values, n), float)

    rx, ry, xx, yy, xy = total(dx), total(dy), total(dx * dx), total(dy * dy), total(dx * dy)
    with np.errstate(invalid="ignore", divide="ignore"):
        det = xx * yy - xy * xy
        lx, ly = (xy * ry - yy * rx) / det, (xy * rx - xx * ry) / det
        usable = np.isfinite(lx) & np.isfinite(ly) & (det > 1e-6 * xx * yy)
    lx, ly = np.where(usable, lx, 0.0), np.where(usable, ly, 0.0)
    # out of range if all elements are on one side
    weight = np.clip(1 + lx[node] * dx + ly[node] * dy, 1e-3, 2.0)
    return sp.csr_matrix(
        (weight / total(weight)[node], (node, element)), shape=(n, len(mesh.cells))
    )


def _linear(lon: Array, lat: Array, cells: Index, grid: Grid) -> sp.csr_matrix:
    """Return linear weights in triangles (m, 3) of points [deg], shape (nodes, points)."""
    parts: list[Part] = []
    for cell, node, x, y, px, py in _candidates(lon[cells], lat[cells], grid):
        det = (y[:, 1] - y[:, 2]) * (x[:, 0] - x[:, 2]) + (x[:, 2] - x[:, 1]) * (y[:, 0] - y[:, 2])
        with np.errstate(invalid="ignore", divide="ignore"):
            a = ((y[:, 1] - y[:, 2]) * (px - x[:, 2]) + (x[:, 2] - x[:, 1]) * (py - y[:, 2])) / det
            b = ((y[:, 2] - y[:, 0]) * (px - x[:, 2]) + (x[:, 0] - x[:, 2]) * (py - y[:, 2])) / det
            hit = (a >= -1e-9) & (b >= -1e-9) & (a + b <= 1 + 1e-9)
        share = np.clip(np.stack((a[hit], b[hit], 1 - a[hit] - b[hit]), 1), 0, 1)
        parts.append((node[hit], cells[cell[hit]], share, np.full(hit.sum(), SLACK)))
    return _assemble(parts, grid, len(lon))


Candidates = tuple[Index, Index, Array, Array, Array, Array]


def _candidates(lon: Array, lat: Array, grid: Grid) -> Iterator[Candidates]:
    """Yield every pair of a cell and a node inside the cell's bounding box, in chunks.

    Args:
        lon: of the corners [deg], shape (m, k).
        lat: of the corners [deg], shape (m, k).
        grid: the target grid.

    Yields:
        (cell, node, corner x, corner y, node x, node y). x and y are gnomonic about the cell's
        middle. Great circles are straight there, so cells meet without gaps everywhere, also at the
        poles. Cells with missing corners or with corners more than 60 degrees from their middle are
        left out.
    """
    west, width, south, north = layout.extents(lon, lat)
    corner = _unit(np.radians(lon), np.radians(lat))
    middle = corner.mean(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle /= np.sqrt((middle**2).sum(axis=1))[:, None]
        cosines = (corner * middle[:, None]).sum(axis=2)
        usable = (cosines.min(axis=1) > NEAR) & (north >= grid.lat0) & (south <= grid.lat[-1])
    chosen = np.nonzero(usable)[0]
    corner, middle, cosines = corner[chosen], middle[chosen], cosines[chosen]
    east = np.stack((-middle[:, 1], middle[:, 0], np.zeros(len(chosen))), -1)
    level = np.hypot(middle[:, 0], middle[:, 1])[:, None]
    east = np.where(level > 0, east / np.where(level > 0, level, 1), (0.0, 1.0, 0.0))
    up = np.cross(middle, east)
    x, y = (
        (corner * east[:, None]).sum(axis=2) / cosines,
        (corner * up[:, None]).sum(axis=2) / cosines,
    )
    first, last = (west[chosen] - grid.lon0) % 360.0 / grid.dlon, width[chosen] / grid.dlon
    low_y = np.maximum(np.ceil((south[chosen] - grid.lat0) / grid.dlat - 1e-6), 0)
    high_y = np.minimum(np.floor((north[chosen] - grid.lat0) / grid.dlat + 1e-6), grid.nlat - 1)
    lam, phi = np.radians(grid.lon), np.radians(grid.lat)
    for shift in (-360.0 / grid.dlon, 0.0) if not grid.seamless else (0.0,):
        low_x, high_x = np.ceil(first + shift - 1e-6), np.floor(first + last + shift + 1e-6)
        if not grid.seamless:
            low_x, high_x = np.maximum(low_x, 0), np.minimum(high_x, grid.nlon - 1)
        wide, high = (high_x - low_x + 1).astype(np.int64), (high_y - low_y + 1).astype(np.int64)
        count = np.where((wide > 0) & (high > 0), wide * high, 0)
        edges = np.searchsorted(np.cumsum(count), np.arange(0, count.sum() + CHUNK, CHUNK))
        for a, b in zip(edges, [*edges[1:], len(chosen)], strict=True):
            part = np.arange(a, b)[count[a:b] > 0]
            if len(part) == 0:
                continue
            cell = np.repeat(part, count[part])
            rank = np.arange(len(cell)) - np.repeat(
                np.cumsum(count[part]) - count[part], count[part]
            )
            column = (low_x[cell] + rank % wide[cell]).astype(np.int64) % grid.columns
            row = (low_y[cell] + rank // wide[cell]).astype(np.int64)
            node = _unit(lam[column], phi[row])
            cosine = (node * middle[cell]).sum(axis=1)
            with np.errstate(invalid="ignore", divide="ignore"):
                px, py = (
                    (node * east[cell]).sum(axis=1) / cosine,
                    (node * up[cell]).sum(axis=1) / cosine,
                )
            px[cosine <= 0] = np.nan  # nodes on the far side of the Earth
            yield chosen[cell], row * grid.columns + column, x[cell], y[cell], px, py


def _unit(lam: Array, phi: Array) -> Array:
    """Return points [rad] as unit vectors (..., 3)."""
    return np.stack((np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)), axis=-1)


def _inverse_bilinear(px: Array, py: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Return (s, t) of points in quadrilaterals with corners (00, 10, 11, 01), by Newton's method."""
    s, t = np.full(len(px), 0.5), np.full(len(px), 0.5)
    for _ in range(8):  # quadratic convergence: convex cells need four iterations
        fx = (
            (1 - s) * (1 - t) * x[:, 0]
            + s * (1 - t) * x[:, 1]
            + s * t * x[:, 2]
            + (1 - s) * t * x[:, 3]
            - px
        )
        fy = (
            (1 - s) * (1 - t) * y[:, 0]
            + s * (1 - t) * y[:, 1]
            + s * t * y[:, 2]
            + (1 - s) * t * y[:, 3]
            - py
        )
        xs, xt = (
            (1 - t) * (x[:, 1] - x[:, 0]) + t * (x[:, 2] - x[:, 3]),
            (1 - s) * (x[:, 3] - x[:, 0]) + s * (x[:, 2] - x[:, 1]),
        )
        ys, yt = (
            (1 - t) * (y[:, 1] - y[:, 0]) + t * (y[:, 2] - y[:, 3]),
            (1 - s) * (y[:, 3] - y[:, 0]) + s * (y[:, 2] - y[:, 1]),
        )
        det = xs * yt - xt * ys
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            ds, dt = (fx * yt - fy * xt) / det, (fy * xs - fx * ys) / det
            s, t = np.clip(s - ds, -9, 9), np.clip(t - dt, -9, 9)
    return s, t


def _assemble(parts: list[Part], grid: Grid, count: int) -> sp.csr_matrix:
    """Return the matrix (nodes, count) of all parts.

    A node on an edge or a rim may be in several cells. The cell that it is least outside of is
    used, or the first one if several are equal.
    """
    size = grid.nlat * grid.columns
    if not parts:
        return sp.csr_matrix((size, count))
    node, outside = np.concatenate([p[0] for p in parts]), np.concatenate([p[3] for p in parts])
    corner, share = np.concatenate([p[1] for p in parts]), np.concatenate([p[2] for p in parts])
    order = np.lexsort((outside, node))
    node, first = np.unique(node[order], return_index=True)
    corner, share = corner[order[first]], share[order[first]]
    k = corner.shape[1]
    matrix = sp.csr_matrix(
        (share.ravel(), (np.repeat(node, k), corner.ravel())), shape=(size, count)
    )
    matrix.eliminate_zeros()
    return matrix
