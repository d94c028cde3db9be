"""Sparse weights that carry values from any layout to a regular grid: a slice then costs one product.

Bilinear inside cells of structured grids, linear inside triangles. Weights are made once. A node whose weight on
present values is at least one half takes their weighted mean; else it is missing: land keeps its outline within
half a source cell.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from geo import layout as lay
from geo.box import Box
from geo.grid import Grid
from geo.layout import Array, Axes, Curved, Index, Layout, Plane, Triangles
from geo.locate import uniform

FINER = 2.0  # times the source's resolution (NorKyst-800: 0.7 % rms error; 1.9 % at its own resolution)
MOST_NODES = 4_000_000  # of a tile: 32 MB a slice
WET = 0.5  # weight on present values from which a node is present
POLEWARD = 89.0  # [deg] beyond which east and north lose their meaning
CHUNK = 2_000_000  # candidate pairs of cell and node handled at a time


def target(layouts: Sequence[Layout], box: Box | None) -> tuple[Grid, bool]:
    """Return the regular grid to carry layouts to, and whether MOST_NODES made it coarser than wanted."""
    first = layouts[0]
    if all(isinstance(item, Axes) for item in layouts):
        grid = _target_of_axes([item for item in layouts if isinstance(item, Axes)])
    else:
        step = min(lay.spacing(item) for item in layouts) / FINER
        lon, lat = (np.ravel(v) for v in lay.points(first))
        if isinstance(first, Triangles):
            lon, lat = first.lon[np.unique(first.cells)], first.lat[np.unique(first.cells)]
        present = np.isfinite(lon) & np.isfinite(lat)
        lon, lat = lon[present], lat[present]
        south, north = max(float(lat.min()), -POLEWARD), min(float(lat.max()), POLEWARD)
        if box is not None:
            south, north = max(south, box.south - 2 * step), min(north, box.north + 2 * step)
        least = 0.0 if south < 0 < north else min(abs(south), abs(north))
        dlon = step / max(0.02, np.cos(np.radians(least)))  # fine enough at the widest parallel
        west, width = _hull(lon, 4 * FINER * dlon)
        if box is not None and box.east - box.west < 350.0:
            offset = (box.west - 2 * dlon - west + 180.0) % 360.0 - 180.0
            end = min(width, offset + box.east - box.west + 4 * dlon)
            west, width = west + max(offset, 0.0), end - max(offset, 0.0)
        grid = _grid(west, south, width, max(north - south, step), dlon, step)
    coarser = np.sqrt(grid.nlon * grid.nlat / MOST_NODES)
    if coarser > 1:
        width, height = (grid.nlon - 1) * grid.dlon, (grid.nlat - 1) * grid.dlat
        grid = _grid(grid.lon0, grid.lat0, width, height, grid.dlon * coarser, grid.dlat * coarser)
    return grid, bool(coarser > 1)


def _grid(west: float, south: float, width: float, height: float, dlon: float, dlat: float) -> Grid:
    nlat = max(2, int(np.ceil(height / dlat - 1e-6)) + 1)
    if width >= 360.0 - 1e-9:
        n = int(np.ceil(360.0 / dlon - 1e-6))
        return Grid(-180.0, south, 360.0 / n, height / (nlat - 1), n + 1, nlat)
    nlon = max(2, int(np.ceil(width / dlon - 1e-6)) + 1)
    west = (west + 180.0) % 360.0 - 180.0
    return Grid(west, south, max(width, dlon) / (nlon - 1), height / (nlat - 1), nlon, nlat)


def _hull(lon: Array, gap: float) -> tuple[float, float]:
    """Return (west, width) of the shortest arc of the circle that holds all longitudes; 360 where no gap is left."""
    turned = np.unique(np.round(lon % 360.0, 9))
    gaps = np.diff(np.concatenate((turned, turned[:1] + 360.0)))
    widest = int(np.argmax(gaps))
    if gaps[widest] <= gap:
        return -180.0, 360.0
    west = float(turned[(widest + 1) % len(turned)])
    return west, float(360.0 - gaps[widest])


def _target_of_axes(several: Sequence[Axes]) -> Grid:
    """Keep an axis that is uniform and shared; make half the median step of one that is not."""
    first = several[0]

    def line(key: str) -> tuple[float, float, float]:
        all_values = [getattr(a, key) for a in several]
        values = all_values[0]
        shared = all(len(v) == len(values) and np.allclose(v, values, atol=1e-6) for v in all_values)
        low, high = max(float(v[0]) for v in all_values), min(float(v[-1]) for v in all_values)
        if shared and uniform(values):
            return low, high, (high - low) / (len(values) - 1)
        step = min(float(np.percentile(np.diff(v), 25)) for v in all_values) / FINER
        return low, high, step

    west, east, dlon = line("lon")
    south, north, dlat = line("lat")
    width = 360.0 if first.round else east - west
    if first.round:
        grid = _grid(west, south, 360.0, north - south, dlon, dlat)
        return Grid(west, south, grid.dlon, grid.dlat, grid.nlon, grid.nlat)
    return _grid(west, south, width, north - south, dlon, dlat)


def weights(layout: Layout, grid: Grid) -> sp.csr_matrix:
    """Return the matrix (nodes, points) that interpolates raveled values at points to raveled nodes of a grid.

    A seamless grid's last column is left out of the nodes: it repeats the first. Rows of nodes outside the
    layout are empty; other rows add up to 1.
    """
    if isinstance(layout, Axes):
        matrix = _of_axes(layout, grid)
    elif isinstance(layout, Plane):
        matrix = _of_plane(layout, grid)
    elif isinstance(layout, Curved):
        matrix = _of_curved(layout, grid)
    else:
        matrix = _of_triangles(layout, grid)
    return matrix.astype(np.float32)


def columns(grid: Grid) -> int:
    """Return how many columns of a grid are its own: all but the one that a seamless grid repeats."""
    return grid.nlon - 1 if grid.seamless else grid.nlon


def carry(matrix: sp.csr_matrix, values: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return values at a layout's points carried to a grid's own nodes, missing where too little is present."""
    source = np.ravel(values).astype(np.float32)
    present = np.isfinite(source)
    total = matrix @ np.where(present, source, np.float32(0))
    weight = matrix @ present.astype(np.float32)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(weight >= WET - 1e-4, total / weight, np.float32(np.nan)), np.float32)


def widen(values: NDArray[np.float32], grid: Grid) -> NDArray[np.float32]:
    """Return values with the first column repeated where the grid is seamless."""
    if grid.seamless and values.shape[1] == grid.nlon - 1:
        values = np.concatenate((values, values[:, :1]), axis=1)
    return np.asarray(values, np.float32)


def _line(nodes: Array, where: Array) -> tuple[Index, Array, NDArray[np.bool_]]:
    """Return (i, fraction, inside) of points along monotonic nodes, i being the lower index in the nodes' order."""
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


def _band(nodes: Array, where: Array, count: int) -> sp.csr_matrix:
    """Return the matrix of linear interpolation along one axis; nodes beyond `count` wrap to the first ones."""
    i, fraction, inside = _line(nodes, where)
    k = np.arange(len(where))
    keep = np.nonzero(inside)[0]
    row = np.concatenate((k[keep], k[keep]))
    column = np.concatenate((i[keep], i[keep] + 1)) % count
    data = np.concatenate((1 - fraction[keep], fraction[keep]))
    return sp.csr_matrix((data, (row, column)), shape=(len(where), count))


def _of_axes(axes: Axes, grid: Grid) -> sp.csr_matrix:
    lon = np.concatenate((axes.lon, axes.lon[:1] + 360.0)) if axes.round else axes.lon
    east = lon[0] + (grid.lon[: columns(grid)] - lon[0] + 1e-7) % 360.0 - 1e-7
    matrix = sp.kron(_band(axes.lat, grid.lat, len(axes.lat)), _band(lon, east, len(axes.lon)), format="csr")
    matrix.eliminate_zeros()
    return matrix


def nodes(grid: Grid) -> tuple[Array, Array]:
    """Return (lon, lat) [deg] of a grid's own nodes, shape (nlat, columns)."""
    lon, lat = np.meshgrid(grid.lon[: columns(grid)], grid.lat)
    return lon, lat


def _of_plane(plane: Plane, grid: Grid) -> sp.csr_matrix:
    x, y = (np.ravel(v) for v in plane.to_plane(*nodes(grid)))
    i, fx, inside_x = _line(plane.x, x)
    j, fy, inside_y = _line(plane.y, y)
    keep = np.nonzero(inside_x & inside_y)[0]
    i, fx, j, fy = i[keep], fx[keep], j[keep], fy[keep]
    corner = ((0, 0, (1 - fx) * (1 - fy)), (0, 1, fx * (1 - fy)), (1, 0, (1 - fx) * fy), (1, 1, fx * fy))
    column = np.concatenate([(j + dj) * len(plane.x) + i + di for dj, di, _ in corner])
    data = np.concatenate([weight for _, _, weight in corner])
    matrix = sp.csr_matrix((data, (np.tile(keep, 4), column)), shape=(x.size, len(plane.x) * len(plane.y)))
    matrix.eliminate_zeros()
    return matrix


def _of_curved(curved: Curved, grid: Grid) -> sp.csr_matrix:
    ny, nx = curved.lon.shape
    index = np.arange(ny * nx).reshape(ny, nx)
    corners = np.stack((index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]), axis=-1).reshape(-1, 4)
    lon, lat = np.ravel(curved.lon), np.ravel(curved.lat)
    parts = []
    for cell, node, x, y, px, py in _candidates(lon[corners], lat[corners], grid):
        s, t = _inverse_bilinear(px, py, x, y)
        hit = (s >= -1e-6) & (s <= 1 + 1e-6) & (t >= -1e-6) & (t <= 1 + 1e-6)
        s, t = np.clip(s[hit], 0, 1), np.clip(t[hit], 0, 1)
        parts.append((node[hit], corners[cell[hit]], np.stack(((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t), 1)))
    return _assemble(parts, grid, ny * nx)


def _of_triangles(mesh: Triangles, grid: Grid) -> sp.csr_matrix:
    """Linear in triangles of nodes; of centred values, in the three triangles of a centre and two of its nodes.

    Values at nodes are then weighted means of the elements round them, with Holmes and Connell's (1989,
    doi:10.2514/6.1989-1932) pseudo-Laplacian weights, which are exact for linear fields.
    """
    if mesh.lonc is None or mesh.latc is None:
        return _linear(mesh.lon, mesh.lat, mesh.cells, grid)
    count = len(mesh.cells)
    lon, lat = np.concatenate((mesh.lonc, mesh.lon)), np.concatenate((mesh.latc, mesh.lat))
    centre = np.arange(count)
    fans = [np.stack((centre, count + mesh.cells[:, a], count + mesh.cells[:, b]), 1) for a, b in ((0, 1), (1, 2), (2, 0))]
    at_nodes = _pseudo_laplacian(mesh)
    spread = sp.vstack((sp.identity(count, format="csr"), at_nodes), format="csr")
    return sp.csr_matrix(_linear(lon, lat, np.concatenate(fans), grid) @ spread)


def _pseudo_laplacian(mesh: Triangles) -> sp.csr_matrix:
    """Return the matrix (nodes, elements) of means of the elements round each node, exact for linear fields."""
    assert mesh.lonc is not None and mesh.latc is not None
    n, element = len(mesh.lon), np.repeat(np.arange(len(mesh.cells)), 3)
    node = mesh.cells.ravel()
    dx = ((mesh.lonc[element] - mesh.lon[node] + 180.0) % 360.0 - 180.0) * np.cos(np.radians(mesh.lat[node]))
    dy = mesh.latc[element] - mesh.lat[node]

    def total(values: Array) -> Array:
        return np.bincount(node, values, n)

    rx, ry, xx, yy, xy = total(dx), total(dy), total(dx * dx), total(dy * dy), total(dx * dy)
    with np.errstate(invalid="ignore", divide="ignore"):
        det = xx * yy - xy * xy
        lx, ly = (xy * ry - yy * rx) / det, (xy * rx - xx * ry) / det
        usable = np.isfinite(lx) & np.isfinite(ly) & (det > 1e-6 * xx * yy)
    lx, ly = np.where(usable, lx, 0.0), np.where(usable, ly, 0.0)
    weight = np.clip(1 + lx[node] * dx + ly[node] * dy, 1e-3, 2.0)  # clipped where a node has them on one side
    return sp.csr_matrix((weight / total(weight)[node], (node, element)), shape=(n, len(mesh.cells)))


def _linear(lon: Array, lat: Array, cells: Index, grid: Grid) -> sp.csr_matrix:
    parts = []
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
            column = i.astype(np.int64) % columns(grid) if grid.seamless else i.astype(np.int64)
            node = j.astype(np.int64) * columns(grid) + column
            yield cells[which], node, xs[which], y[cells][which], i, j


def _inverse_bilinear(px: Array, py: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Return (s, t) of points in quadrilaterals with corners (00, 10, 11, 01), by Newton's method."""
    s, t = np.full(len(px), 0.5), np.full(len(px), 0.5)
    for _ in range(8):  # quadratic: convex cells settle in four
        fx = (1 - s) * (1 - t) * x[:, 0] + s * (1 - t) * x[:, 1] + s * t * x[:, 2] + (1 - s) * t * x[:, 3] - px
        fy = (1 - s) * (1 - t) * y[:, 0] + s * (1 - t) * y[:, 1] + s * t * y[:, 2] + (1 - s) * t * y[:, 3] - py
        xs, xt = (1 - t) * (x[:, 1] - x[:, 0]) + t * (x[:, 2] - x[:, 3]), (1 - s) * (x[:, 3] - x[:, 0]) + s * (x[:, 2] - x[:, 1])
        ys, yt = (1 - t) * (y[:, 1] - y[:, 0]) + t * (y[:, 2] - y[:, 3]), (1 - s) * (y[:, 3] - y[:, 0]) + s * (y[:, 2] - y[:, 1])
        det = xs * yt - xt * ys
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            ds, dt = (fx * yt - fy * xt) / det, (fy * xs - fx * ys) / det
            s, t = np.clip(s - ds, -9, 9), np.clip(t - dt, -9, 9)
    return s, t


def _assemble(parts: list[tuple[Index, Index, Array]], grid: Grid, count: int) -> sp.csr_matrix:
    """Build the matrix, keeping for a node on a shared edge the first cell that holds it."""
    size = grid.nlat * columns(grid)
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
