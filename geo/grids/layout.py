"""Layouts: where the points of a variable lie, and their geometry.

Points lie on longitude and latitude axes, in a projection's plane, on a curvilinear grid, or on
triangles. `locate.py` finds the layout of a variable in a file; `regrid.py` makes interpolation
weights from it.

Angles are degrees. Longitudes are unwrapped where neighbours matter, so they may leave [-180, 180).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError

Index = NDArray[np.int64]


@dataclass(frozen=True)
class Axes:
    """A rectilinear grid: lon (nx,) and lat (ny,) [deg], both ascending.

    columns, rows: their indices in the file. round: the columns span the globe, with no longitude
    repeated.
    """

    lon: Array
    lat: Array
    columns: Index
    rows: Index
    round: bool


@dataclass(frozen=True)
class Plane:
    """A grid in a projection's plane.

    x (nx,), y (ny,): in the projection's unit (m or deg), monotonic, in file order. columns, rows:
    their indices in the file. turn: period of x (360 for a rotated pole, whose x is an angle), 0
    for none.
    """

    x: Array
    y: Array
    columns: Index
    rows: Index
    projection: Transformer  # from (x, y) to (lon, lat)
    turn: float = 0.0

    def to_lonlat(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return (lon, lat) [deg] of points of the plane."""
        lon, lat = self.projection.transform(x, y)
        return np.asarray(lon), np.asarray(lat)

    def to_plane(self, lon: Array, lat: Array) -> tuple[Array, Array]:
        """Return (x, y) of points [deg]; inf outside the projection's domain."""
        x, y = self.projection.transform(lon, lat, direction="INVERSE")
        if self.turn:
            middle = (self.x[0] + self.x[-1]) / 2
            x = middle + (np.asarray(x) - middle + self.turn / 2) % self.turn - self.turn / 2
        return np.asarray(x), np.asarray(y)


@dataclass(frozen=True)
class Curved:
    """A curvilinear grid: lon, lat (ny, nx) [deg]; columns, rows: their indices in the file.

    angle: (ny, nx) [rad] of the grid's x axis from east, if the file has it. joined: (nx,) whether
    each column is a neighbour of the next one (the last one of the first); None: all but the last.
    mirror: (nx,) columns that the last row's points face across the fold of a tripolar grid, -1 for
    none.
    """

    lon: Array
    lat: Array
    columns: Index
    rows: Index
    angle: Array | None = None
    joined: NDArray[np.bool_] | None = None
    mirror: Index | None = None


@dataclass(frozen=True)
class Triangles:
    """Triangles: lon, lat (n,) [deg] of nodes, cells (m, 3) indices of nodes.

    first: index in the file of point 0. With lonc, latc (m,), values are at the cells' centres, and
    cells may have more corners, (m, k), padded with -1. projection: from the plane whose axes the
    components follow to (lon, lat); None if they follow none.
    """

    lon: Array
    lat: Array
    cells: Index
    first: int
    lonc: Array | None = None
    latc: Array | None = None
    projection: Transformer | None = None

    def to_plane(self, lon: Array, lat: Array) -> tuple[Array, Array]:
        """Return (x, y) of points [deg] in the plane of its projection."""
        assert self.projection is not None
        x, y = self.projection.transform(lon, lat, direction="INVERSE")
        return np.asarray(x), np.asarray(y)


Layout = Axes | Plane | Curved | Triangles

FEW = 16  # [columns] shorter gaps between needed columns are read as well
WIDE = 20.0  # [deg of longitude] extents of wider cells are computed exactly
UNIFORM = 0.01  # share of a cell: an axis whose coordinates jitter by less counts as uniform


def uniform(values: Array) -> bool:
    """Return True if an axis' steps are equal except for rounding errors in its storage."""
    line = np.linspace(values[0], values[-1], len(values))
    return bool(
        np.abs(values - line).max() <= UNIFORM * (values[-1] - values[0]) / (len(values) - 1)
    )


def points(layout: Layout) -> tuple[Array, Array]:
    """Return (lon, lat) [deg] of every point with a value, in the shape of the values."""
    if isinstance(layout, Axes):
        lon, lat = np.meshgrid(layout.lon, layout.lat)
        return lon, lat
    if isinstance(layout, Plane):
        return layout.to_lonlat(*np.meshgrid(layout.x, layout.y))
    if isinstance(layout, Triangles) and layout.lonc is not None and layout.latc is not None:
        return layout.lonc, layout.latc
    return layout.lon, layout.lat


def spacing(layout: Layout) -> float:
    """Return the distance between neighbouring points [deg of a great circle].

    It is the median in the finer direction. Raises UserError if no two neighbours have coordinates.
    """
    if isinstance(layout, Triangles):
        pair = layout.cells[:, [0, 1]], layout.cells[:, [1, 2]], layout.cells[:, [2, 0]]
        a, b = np.concatenate(pair).T
        edges = _angles_between(layout.lon[a], layout.lat[a], layout.lon[b], layout.lat[b])
        return _quantile(10, edges)  # small elements near the coast matter, single slivers do not
    lon, lat = points(layout)
    # 250,000 points are enough for a median
    step = max(1, lon.shape[0] // 500), max(1, lon.shape[1] // 500)
    across = _angles_between(
        lon[:: step[0], :-1], lat[:: step[0], :-1], lon[:: step[0], 1:], lat[:: step[0], 1:]
    )
    along = _angles_between(
        lon[:-1, :: step[1]], lat[:-1, :: step[1]], lon[1:, :: step[1]], lat[1:, :: step[1]]
    )
    return min(_quantile(50, across), _quantile(50, along))


def _quantile(percent: float, distances: Array) -> float:
    """Return a quantile of the finite distances; raise UserError if there are none."""
    finite = distances[np.isfinite(distances)]
    if not finite.size:
        raise UserError(
            "no two neighbouring points have a longitude and a latitude: there is no grid"
        )
    return float(np.percentile(finite, percent))


def _angles_between(lon1: Array, lat1: Array, lon2: Array, lat2: Array) -> Array:
    """Return distances between points [deg] in degrees of a great circle; NaN between equal points."""
    metres = sphere.distance(*(np.radians(v) for v in (lon1, lat1, lon2, lat2)))
    metres = np.where(metres > 0, metres, np.nan)
    return np.asarray(np.degrees(metres / sphere.RADIUS))


def joins(curved: Curved) -> NDArray[np.bool_]:
    """Return which columns of a curvilinear grid are neighbours of the next one, shape (nx,).

    The last column's next one is the first.
    """
    if curved.joined is not None:
        return curved.joined
    return np.asarray(np.arange(curved.lon.shape[1]) < curved.lon.shape[1] - 1)


def cells(curved: Curved, rows: Index) -> Index:
    """Return the corners of the cells between rows and the next ones, shape (rows, cells, 4).

    Corners are indices of raveled points.
    """
    nx = curved.lon.shape[1]
    left = np.nonzero(joins(curved))[0]
    right, row = (left + 1) % nx, np.asarray(rows)[:, None] * nx
    return np.stack((row + left, row + right, row + nx + right, row + nx + left), -1)


def fold_cells(curved: Curved) -> Index:
    """Return the corners of the cells across the fold of a tripolar grid, shape (cells, 4).

    Corners are indices of raveled points.
    """
    if curved.mirror is None:
        return np.empty((0, 4), np.int64)
    ny, nx = curved.lon.shape
    left = np.nonzero(joins(curved))[0]
    right = (left + 1) % nx
    facing = np.stack((left, right, curved.mirror[right], curved.mirror[left]), -1)
    return np.asarray(facing[(facing >= 0).all(axis=1)] + (ny - 1) * nx)


def extents(lon: Array, lat: Array) -> tuple[Array, Array, Array, Array]:
    """Return (west, width, south, north) [deg] of cells whose edges are great circles.

    Cells with a missing corner get NaN. A cell that contains a pole is 360 wide. The poleward bulge
    of edges is bounded by that of an edge at the cell's highest latitude, as wide as the cell.

    lon, lat: corners in cyclic order (m, k) [deg].
    """
    phi, lam = np.radians(lat), np.radians(lon)
    middle = np.degrees(
        np.arctan2((np.cos(phi) * np.sin(lam)).sum(1), (np.cos(phi) * np.cos(lam)).sum(1))
    )[:, None]
    unwrapped = sphere.wrap_degrees(lon - middle)
    # a pole has no longitude
    unwrapped = np.where(np.abs(lat) > 90.0 - 1e-6, 0.0 * unwrapped, unwrapped)
    with np.errstate(invalid="ignore"):
        around = (
            np.abs(sphere.wrap_degrees(np.roll(unwrapped, -1, axis=1) - unwrapped).sum(axis=1))
            > 180.0
        )
        width = np.where(around, 360.0, np.ptp(unwrapped, axis=1))
        half = np.cos(np.radians(np.minimum(width, 180.0) / 2))
        south, north = lat.min(axis=1), lat.max(axis=1)
        upper = np.degrees(np.arctan2(np.sin(np.radians(north)), np.cos(np.radians(north)) * half))
        lower = np.degrees(np.arctan2(np.sin(np.radians(south)), np.cos(np.radians(south)) * half))
        upper = np.where(around & (north + south > 0), 90.0, np.where(north > 0, upper, north))
        lower = np.where(around & (north + south < 0), -90.0, np.where(south < 0, lower, south))
    return middle[:, 0] + unwrapped.min(axis=1), width, lower, upper


def _points_in_box(lon: Array, lat: Array, box: Box, margin: float) -> NDArray[np.bool_]:
    """Return which points [deg] lie in a box grown by a margin [deg of a great circle]."""
    south, north = box.south - margin, box.north + margin
    cosine = np.cos(np.radians(min(89.0, max(abs(south), abs(north)))))
    grown = box.grown(margin / cosine, margin)
    with np.errstate(invalid="ignore"):
        inside = (lat >= grown.south) & (lat <= grown.north)
        return np.asarray(inside & ((lon - grown.west) % 360.0 <= grown.east - grown.west))


def crop(layout: Layout, box: Box | None) -> Layout | None:
    """Return the part of a layout that covers a box, with two more nodes on every side.

    None if they do not overlap.
    """
    if box is None:
        return layout
    if isinstance(layout, Axes):
        return _crop_axes(layout, box)
    if isinstance(layout, Curved):
        return _crop_curved(layout, box)
    if isinstance(layout, Triangles):
        return _crop_triangles(layout, box)
    lon, lat = points(layout)
    inside = _points_in_box(lon, lat, box, 3 * spacing(layout))
    if not inside.any():
        return None
    j, i = np.nonzero(inside.any(axis=1))[0], np.nonzero(inside.any(axis=0))[0]
    rows, columns = slice(j[0], j[-1] + 1), slice(i[0], i[-1] + 1)
    return replace(
        layout,
        x=layout.x[columns],
        y=layout.y[rows],
        columns=layout.columns[columns],
        rows=layout.rows[rows],
    )


def _crop_axes(axes: Axes, box: Box) -> Axes | None:
    dlat, dlon = float(np.median(np.diff(axes.lat))), float(np.median(np.diff(axes.lon)))
    south = int(np.searchsorted(axes.lat, box.south, "right")) - 2
    north = int(np.searchsorted(axes.lat, box.north, "left")) + 1
    rows = np.arange(max(south, 0), min(north, len(axes.lat) - 1) + 1)
    if box.south > axes.lat[-1] + dlat or box.north < axes.lat[0] - dlat or len(rows) < 2:
        return None
    n = len(axes.lon)
    if axes.round:
        west = (box.west - axes.lon[0]) % 360.0 + axes.lon[0]
        east = west + box.east - box.west
        turns = int((east - axes.lon[0]) // 360.0)
        first = int(np.searchsorted(axes.lon, west, "right")) - 2
        last = int(np.searchsorted(axes.lon, east - 360.0 * turns, "left")) + n * turns + 1
        k = np.arange(n) if last - first + 1 >= n else np.arange(first, last + 1)
    else:
        near = (axes.lon - box.west + 2 * dlon) % 360.0 <= box.east - box.west + 4 * dlon
        columns = np.nonzero(near)[0]
        if len(columns) == 0:
            return None
        k = np.arange(columns[0], columns[-1] + 1)
        k = (
            np.arange(max(0, min(k[0], n - 2)), k[-1] + 1)
            if len(k) > 1
            else np.arange(max(k[0] - 1, 0), k[0] + 1)
        )
        if len(k) < 2:
            k = np.arange(0, 2)
    goes_round = axes.round and len(k) == n
    return Axes(
        axes.lon[k % n] + 360.0 * (k // n),
        axes.lat[rows],
        axes.columns[k % n],
        axes.rows[rows],
        goes_round,
    )


def _crop_curved(curved: Curved, box: Box) -> Curved | None:
    """Return the cells that overlap a box, and one more row and column on each side; None for none.

    For a grid that spans the globe, the columns may be in up to three pieces.
    """
    margin = 3 * spacing(curved)
    grown = box.grown(
        margin / np.cos(np.radians(min(89.0, max(abs(box.south), abs(box.north)) + margin))), margin
    )
    ny, nx = curved.lon.shape
    lowest, highest = np.fmin.reduce(curved.lat, axis=1), np.fmax.reduce(curved.lat, axis=1)
    # near the poles, edges bulge far poleward
    lowest, highest = (
        np.where(lowest < -75.0, -90.0, lowest),
        np.where(highest > 75.0, 90.0, highest),
    )
    with np.errstate(invalid="ignore"):
        near_rows = (np.fmin(lowest[:-1], lowest[1:]) <= grown.north) & (
            np.fmax(highest[:-1], highest[1:]) >= grown.south
        )
    row_needed, column_needed = np.zeros(ny, bool), np.zeros(nx, bool)
    lon, lat = np.ravel(curved.lon), np.ravel(curved.lat)
    band = np.nonzero(near_rows)[0]
    # 64 rows at a time, to save memory
    for rows in [band[k : k + 64] for k in range(0, len(band), 64)]:
        corners = cells(curved, rows).reshape(-1, 4)
        met = corners[_overlap_box(lon[corners], lat[corners], grown)]
        row_needed[met // nx] = column_needed[met % nx] = True
    corners = fold_cells(curved)
    met = corners[_overlap_box(lon[corners], lat[corners], grown)]
    row_needed[met // nx] = column_needed[met % nx] = True
    if not row_needed.any():
        return None
    j = np.nonzero(row_needed)[0]
    part = slice(max(j[0] - 1, 0), j[-1] + 2)
    order = _pieces(column_needed, bool(joins(curved)[-1]))
    joined = joins(curved)[order] & (np.roll(order, -1) == (order + 1) % nx)
    mirror = None
    if curved.mirror is not None and part.stop >= ny:
        place = np.full(nx + 1, -1)
        place[order] = np.arange(len(order))
        mirror = place[curved.mirror[order]]
    return replace(
        curved,
        lon=curved.lon[part][:, order],
        lat=curved.lat[part][:, order],
        columns=curved.columns[order],
        rows=curved.rows[part],
        angle=None if curved.angle is None else curved.angle[part][:, order],
        joined=joined,
        mirror=mirror,
    )


def _overlap_box(lon: Array, lat: Array, box: Box) -> NDArray[np.bool_]:
    """Return which cells with corners (m, k) [deg] overlap a box.

    Edges of cells up to WIDE bulge poleward by at most width^2 / 16; a tenth is added for the next
    order. Extents of wider cells are computed exactly.
    """
    unwrapped = sphere.wrap_degrees(lon - lon[:, :1])
    low = unwrapped.min(axis=1)
    west, width, south, north = (
        lon[:, 0] + low,
        unwrapped.max(axis=1) - low,
        lat.min(axis=1),
        lat.max(axis=1),
    )
    with np.errstate(invalid="ignore"):
        bulge = np.degrees(1.1 * np.radians(width) ** 2 / 16)
        south, north = south - bulge, north + bulge
        wide = np.nonzero(width > WIDE)[0]
        west[wide], width[wide], south[wide], north[wide] = extents(lon[wide], lat[wide])
        inside = (north >= box.south) & (south <= box.north) & (north - south < 90.0)
        inside &= (west + width - box.west) % 360.0 <= box.east - box.west + width
    return np.asarray(inside)


def _pieces(needed: NDArray[np.bool_], around: bool) -> Index:
    """Return the needed columns and one more on both sides, in order, leaving out up to three gaps.

    The first column follows the widest gap, so that columns on both sides of the seam stay
    together.
    """
    n = len(needed)
    beside = np.roll(needed, 1) | np.roll(needed, -1)
    if not around:
        beside[0], beside[-1] = needed[1], needed[-2]
    chosen = np.nonzero(needed | beside)[0]
    gap = (np.roll(chosen, -1) - chosen - 1) % n  # number of columns left out after each column
    widest = np.argsort(gap, kind="stable")[::-1][:3]
    widest = widest[gap[widest] >= FEW]
    if len(widest) == 0:
        return np.arange(n)
    start = int(chosen[widest[0]] + gap[widest[0]] + 1)
    left_out = np.zeros(n, bool)
    for k in widest:
        left_out[(chosen[k] + 1 + np.arange(gap[k])) % n] = True
    order = (start + np.arange(n)) % n
    return np.asarray(order[~left_out[order]], np.int64)


def _crop_triangles(mesh: Triangles, box: Box) -> Triangles | None:
    margin = 3 * spacing(mesh)
    corners = np.where(mesh.cells < 0, mesh.cells[:, :1], mesh.cells)
    # Cells are tested by their extents, not by their corners, because an element may be larger than
    # the whole case.
    grown = box.grown(
        margin / max(0.02, np.cos(np.radians(max(abs(box.south), abs(box.north))))), margin
    )
    meets = _overlap_box(mesh.lon[corners], mesh.lat[corners], grown)
    kept = np.nonzero(meets)[0]
    if len(kept) == 0:
        return None
    # values are at centres, so all nodes are kept
    if mesh.lonc is not None and mesh.latc is not None:
        part = slice(int(kept[0]), int(kept[-1]) + 1)
        return replace(
            mesh,
            cells=mesh.cells[part],
            first=mesh.first + part.start,
            lonc=mesh.lonc[part],
            latc=mesh.latc[part],
        )
    low, high = int(mesh.cells[kept].min()), int(mesh.cells[kept].max()) + 1
    return replace(
        mesh,
        lon=mesh.lon[low:high],
        lat=mesh.lat[low:high],
        cells=mesh.cells[kept] - low,
        first=mesh.first + low,
    )
