"""Weights inside cells of curved grids and of triangles, found by running over cells, not by searching for points.

A tile is finer than its source, so every cell holds a few of its nodes: those in the cell's own box are tried.
"""

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from geo.grid import Grid
from geo.layout import Array, Curved, Index, Triangles

CHUNK = 2_000_000  # candidate pairs of cell and node handled at a time


def of_curved(curved: Curved, grid: Grid) -> sp.csr_matrix:
    ny, nx = curved.lon.shape
    index = np.arange(ny * nx).reshape(ny, nx)
    if _closes(curved):
        index = np.concatenate((index, index[:, :1]), axis=1)
    corners = np.stack((index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]), axis=-1).reshape(-1, 4)
    lon, lat = np.ravel(curved.lon), np.ravel(curved.lat)
    parts: list[tuple[Index, Index, Array]] = []
    for cell, node, x, y, px, py in _candidates(lon[corners], lat[corners], grid):
        s, t = _inverse_bilinear(px, py, x, y)
        hit = (s >= -1e-6) & (s <= 1 + 1e-6) & (t >= -1e-6) & (t <= 1 + 1e-6)
        s, t = np.clip(s[hit], 0, 1), np.clip(t[hit], 0, 1)
        parts.append((node[hit], corners[cell[hit]], np.stack(((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t), 1)))
    return _assemble(parts, grid, ny * nx)


def _closes(curved: Curved) -> bool:
    """Whether the last column lies one step before the first: a grid that goes round the Earth."""
    step = (np.diff(curved.lon, axis=1) + 180.0) % 360.0 - 180.0
    seam = (curved.lon[:, 0] - curved.lon[:, -1] + 180.0) % 360.0 - 180.0
    turns = np.nansum(step, axis=1) + seam
    fair = np.abs(seam) < 2 * np.nanmedian(np.abs(step), axis=1)
    return bool(np.nanmedian(np.abs(turns)) > 350.0 and np.mean(fair) > 0.5)


def of_triangles(mesh: Triangles, grid: Grid) -> sp.csr_matrix:
    """Linear in triangles of nodes; of centred values, in the three triangles of a centre and two of its nodes.

    Values at nodes are then weighted means of the elements round them, with Holmes and Connell's (1989,
    doi:10.2514/6.1989-1932) pseudo-Laplacian weights, which are exact for linear fields.
    """
    if mesh.lonc is None or mesh.latc is None:
        return _linear(mesh.lon, mesh.lat, mesh.cells, grid)
    count = len(mesh.cells)
    lon, lat = np.concatenate((mesh.lonc, mesh.lon)), np.concatenate((mesh.latc, mesh.lat))
    centre = np.arange(count)
    fans = []
    for k in range(mesh.cells.shape[1]):  # polygons of fewer corners end in -1
        a, b = mesh.cells[:, k], mesh.cells[:, (k + 1) % mesh.cells.shape[1]]
        b = np.where(b < 0, mesh.cells[:, 0], b)
        fans.append(np.stack((centre, count + a, count + b), 1)[a >= 0])
    at_nodes = _pseudo_laplacian(mesh)
    spread = sp.vstack((sp.identity(count, format="csr"), at_nodes), format="csr")
    return sp.csr_matrix(_linear(lon, lat, np.concatenate(fans), grid) @ spread)


def _pseudo_laplacian(mesh: Triangles) -> sp.csr_matrix:
    """Return the matrix (nodes, elements) of means of the elements round each node, exact for linear fields."""
    assert mesh.lonc is not None
    assert mesh.latc is not None
    n, corner = len(mesh.lon), mesh.cells >= 0
    element, node = np.nonzero(corner)[0], mesh.cells[corner]
    dx = ((mesh.lonc[element] - mesh.lon[node] + 180.0) % 360.0 - 180.0) * np.cos(np.radians(mesh.lat[node]))
    dy = mesh.latc[element] - mesh.lat[node]

    def total(values: Array) -> Array:
        return np.asarray(np.bincount(node, values, n), float)

    rx, ry, xx, yy, xy = total(dx), total(dy), total(dx * dx), total(dy * dy), total(dx * dy)
    with np.errstate(invalid="ignore", divide="ignore"):
        det = xx * yy - xy * xy
        lx, ly = (xy * ry - yy * rx) / det, (xy * rx - xx * ry) / det
        usable = np.isfinite(lx) & np.isfinite(ly) & (det > 1e-6 * xx * yy)
    lx, ly = np.where(usable, lx, 0.0), np.where(usable, ly, 0.0)
    weight = np.clip(1 + lx[node] * dx + ly[node] * dy, 1e-3, 2.0)  # clipped where a node has them on one side
    return sp.csr_matrix((weight / total(weight)[node], (node, element)), shape=(n, len(mesh.cells)))


def _linear(lon: Array, lat: Array, cells: Index, grid: Grid) -> sp.csr_matrix:
    parts: list[tuple[Index, Index, Array]] = []
    for cell, node, x, y, px, py in _candidates(lon[cells], lat[cells], grid):
        det = (y[:, 1] - y[:, 2]) * (x[:, 0] - x[:, 2]) + (x[:, 2] - x[:, 1]) * (y[:, 0] - y[:, 2])
        with np.errstate(invalid="ignore", divide="ignore"):
            a = ((y[:, 1] - y[:, 2]) * (px - x[:, 2]) + (x[:, 2] - x[:, 1]) * (py - y[:, 2])) / det
            b = ((y[:, 2] - y[:, 0]) * (px - x[:, 2]) + (x[:, 0] - x[:, 2]) * (py - y[:, 2])) / det
            hit = (a >= -1e-9) & (b >= -1e-9) & (a + b <= 1 + 1e-9)
        share = np.clip(np.stack((a[hit], b[hit], 1 - a[hit] - b[hit]), 1), 0, 1)
        parts.append((node[hit], cells[cell[hit]], share))
    return _assemble(parts, grid, len(lon))


Candidates = tuple[Index, Index, Array, Array, Array, Array]


def _candidates(lon: Array, lat: Array, grid: Grid) -> Iterator[Candidates]:
    """Yield every pair of a cell and a node inside the cell's own box, in chunks.

    lon, lat: corners (m, k) [deg]. Yields (cell, node, corner x, corner y, node x, node y), x and y in steps of
    the grid from its first node, x unwrapped round the cell. Cells with missing corners or wider than 90
    degrees (a pole inside, a tripolar grid's fold) are passed over.
    """
    x0 = (lon[:, :1] - grid.lon0) % 360.0
    x = (x0 + (lon - lon[:, :1] + 180.0) % 360.0 - 180.0) / grid.dlon
    y = (lat - grid.lat0) / grid.dlat
    fine = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    with np.errstate(invalid="ignore"):
        fine &= (np.ptp(x, axis=1) * grid.dlon < 90.0) & (y.max(axis=1) >= 0) & (y.min(axis=1) <= grid.nlat - 1)
    chosen = np.nonzero(fine)[0]
    turn = 360.0 / grid.dlon
    for shift in (-turn, 0.0) if not grid.seamless else (0.0,):
        cells = chosen
        xs = x[cells] + shift
        low_x, high_x = np.ceil(xs.min(axis=1) - 1e-6), np.floor(xs.max(axis=1) + 1e-6)
        if not grid.seamless:
            low_x, high_x = np.maximum(low_x, 0), np.minimum(high_x, grid.nlon - 1)
        low_y = np.maximum(np.ceil(y[cells].min(axis=1) - 1e-6), 0)
        high_y = np.minimum(np.floor(y[cells].max(axis=1) + 1e-6), grid.nlat - 1)
        wide, high = (high_x - low_x + 1).astype(np.int64), (high_y - low_y + 1).astype(np.int64)
        count = np.where((wide > 0) & (high > 0), wide * high, 0)
        edges = np.searchsorted(np.cumsum(count), np.arange(0, count.sum() + CHUNK, CHUNK))
        for a, b in zip(edges, [*edges[1:], len(cells)], strict=True):
            part = np.arange(a, b)[count[a:b] > 0]
            if len(part) == 0:
                continue
            which = np.repeat(part, count[part])
            rank = np.arange(len(which)) - np.repeat(np.cumsum(count[part]) - count[part], count[part])
            i, j = low_x[which] + rank % wide[which], low_y[which] + rank // wide[which]
            column = i.astype(np.int64) % grid.columns if grid.seamless else i.astype(np.int64)
            node = j.astype(np.int64) * grid.columns + column
            yield cells[which], node, xs[which], y[cells][which], i, j


def _inverse_bilinear(px: Array, py: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Return (s, t) of points in quadrilaterals with corners (00, 10, 11, 01), by Newton's method."""
    s, t = np.full(len(px), 0.5), np.full(len(px), 0.5)
    for _ in range(8):  # quadratic: convex cells settle in four
        fx = (1 - s) * (1 - t) * x[:, 0] + s * (1 - t) * x[:, 1] + s * t * x[:, 2] + (1 - s) * t * x[:, 3] - px
        fy = (1 - s) * (1 - t) * y[:, 0] + s * (1 - t) * y[:, 1] + s * t * y[:, 2] + (1 - s) * t * y[:, 3] - py
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


def _assemble(parts: list[tuple[Index, Index, Array]], grid: Grid, count: int) -> sp.csr_matrix:
    """Build the matrix, keeping for a node on a shared edge the first cell that holds it."""
    size = grid.nlat * grid.columns
    if not parts:
        return sp.csr_matrix((size, count))
    node = np.concatenate([p[0] for p in parts])
    corner, share = np.concatenate([p[1] for p in parts]), np.concatenate([p[2] for p in parts])
    node, first = np.unique(node, return_index=True)
    corner, share = corner[first], share[first]
    k = corner.shape[1]
    matrix = sp.csr_matrix((share.ravel(), (np.repeat(node, k), corner.ravel())), shape=(size, count))
    matrix.eliminate_zeros()
    return matrix
