"""The coast for the kernels: shoreline edges in a uniform grid of cells, in binary angles.

Every polygon vertex is rounded to int32 binary angles (at most 5 mm away); after that, all geometry
in the lon-lat plane is exact integer arithmetic. For each cell the grid holds the edges that touch
it, the distance (in cells) to the nearest cell with an edge, and whether its reference point lies
on land. `build_coast` makes the grid; kernels.step.coast reads it, and so do the functions below
for single queries. A point exactly on an edge is on land. Outside the grid everything is water.

A box that extends beyond the box to which the polygons were cut is rejected: the cut would count as
coast.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage

from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.coast.shore import Shore

TURN = sphere.TURN
POLE = TURN // 4  # [unit] the north pole's binary latitude
FINEST = 17  # smallest shift: a cell of 2**17 units is 0.011 degrees, 1.2 km of latitude
COARSEST = 21  # largest shift: 0.18 degrees, less than geo.coast.shore.MARGIN
# [unit] 2.4 km, because stretches of coast consist of whole edges; kernels would allow 45 degrees
LONGEST_EDGE = 2**18
FAR = 127  # [cells] distances are capped at this number, so that they fit into seven bits
LAND = 128  # bit of a cell's byte: its reference point is on land

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Coast:
    """Shoreline edges by cell.

    Positions and lengths are in binary angle units; rows of cells run from south to north. cell:
    the low 7 bits are the chessboard distance to a cell with edges, the high bit says that the
    reference point is on land.
    """

    lon0: int  # south-west corner of cell (0, 0)
    lat0: int
    shift: int  # a cell is 2**shift units wide and high
    nx: int
    ny: int
    cell: npt.NDArray[np.uint8]  # (ny * nx,)
    start: npt.NDArray[np.int32]  # (ny * nx + 1,) index in `edge` of each cell's first edge
    # (n, 4) lon_a, lat_a, lon_b, lat_b; an edge is repeated for every cell that it touches
    edge: npt.NDArray[np.int32]
    # (n,) number of each shoreline edge, from 0, increasing along each shoreline
    edge_id: npt.NDArray[np.int32]
    reference: tuple[int, int]  # offset of the reference point in its cell
    polygons: Array  # shapely land polygons [deg], unwrapped around the box
    source: str
    cut: Box | None = None  # box to which the polygons are cut; None: they are complete


def build_coast(shore: Shore, box: Box, max_cells: int = 4_000_000) -> Coast:
    """Return the coast of a box.

    Args:
        shore: land polygons that cover the box.
        box: area of the grid, which is rounded outward to cells.
        max_cells: largest number of cells; fewer and larger cells are used above it.

    Raises:
        ValueError: the polygons are cut to a box that does not contain `box`.
    """
    # the shore is not cut in longitude, so the grid spans the globe as well
    if shore.box and shore.box.east - shore.box.west >= 360:
        box = Box(-180.0, box.south, 180.0, box.north)
    if shore.box and not (
        shore.box.west <= box.west
        and shore.box.east >= box.east
        and shore.box.south <= box.south
        and shore.box.north >= box.north
    ):
        raise ValueError(f"the shore is cut to {shore.box}, which does not hold {box}")
    for shift in range(FINEST, COARSEST + 1):
        west, south, nx, ny = _cells_over(box, shift)
        if nx * ny <= max_cells or shift == COARSEST:
            break
    globe = nx << shift == TURN
    edges = _split_edges(shore.polygons)
    edges -= np.array([west, south, west, south])
    shoreline = _drop_cuts(edges, globe, south)
    owner, cell = _touching_pairs(shoreline, shift, nx, ny, globe)
    order = np.argsort(cell, kind="stable")
    owner, cell = owner[order], cell[order]
    start = np.zeros(nx * ny + 1, np.int32)
    np.cumsum(np.bincount(cell, minlength=nx * ny), out=start[1:])
    reference = _reference_offset(shoreline[owner], cell, shift, nx)
    land = _land_of_references(edges, reference, shift, nx, ny)
    distance = _cells_to_edges((start[1:] == start[:-1]).reshape(ny, nx), globe)
    used, number = np.unique(owner, return_inverse=True)
    corner = np.array([west, south, west, south])
    return Coast(
        lon0=int(_wrap_to_int32(np.array(west))),
        lat0=south,
        shift=shift,
        nx=nx,
        ny=ny,
        cell=distance.ravel() | np.where(land, LAND, 0).astype(np.uint8),
        start=start,
        edge=_wrap_to_int32(shoreline[used] + corner)[number],
        edge_id=number.astype(np.int32),
        reference=reference,
        polygons=shore.polygons,
        source=shore.source,
        cut=shore.box,
    )


def _cells_to_edges(empty: npt.NDArray[np.bool_], globe: bool) -> npt.NDArray[np.uint8]:
    """Return the chessboard distance (ny, nx) from each cell to the nearest non-empty one.

    Distances are capped at FAR. globe: the columns span the globe, so distances cross its seam.
    """
    if empty.all():
        return np.full(empty.shape, FAR, np.uint8)
    columns = empty.shape[1]
    if globe:
        wide = np.concatenate([empty[:, columns - FAR :], empty, empty[:, :FAR]], axis=1)
        distance = ndimage.distance_transform_cdt(wide, "chessboard")[:, FAR : FAR + columns]
    else:
        distance = ndimage.distance_transform_cdt(empty, "chessboard")
    return np.asarray(np.minimum(distance, FAR).astype(np.uint8))


def is_land(coast: Coast, lon: npt.ArrayLike, lat: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Return whether points [binary angles] lie on land, exactly; a point on an edge is on land."""
    lon, lat = np.broadcast_arrays(np.asarray(lon, np.int32), np.asarray(lat, np.int32))
    shape, lon, lat = lon.shape, lon.ravel(), lat.ravel()
    x = (lon.astype(np.int64) - coast.lon0) % TURN
    y = lat.astype(np.int64) - coast.lat0
    column, row = x >> coast.shift, y >> coast.shift
    inside = np.flatnonzero((column < coast.nx) & (row >= 0) & (row < coast.ny))
    cell = (row * coast.nx + column)[inside]
    land = np.zeros(lon.size, bool)
    land[inside] = coast.cell[cell] >= LAND
    count = coast.start[cell + 1] - coast.start[cell]
    point = np.repeat(inside, count)
    listed = _concatenated_ranges(coast.start[cell], count)
    corner = 1 << coast.shift
    # all coordinates are relative to the cell's reference point
    px = x[point] % corner - coast.reference[0]
    py = y[point] % corner - coast.reference[1]
    ax = _angle_difference(coast.edge[listed, 0], lon[point]) + px
    ay = coast.edge[listed, 1].astype(np.int64) - lat[point] + py
    bx = _angle_difference(coast.edge[listed, 2], lon[point]) + px
    by = coast.edge[listed, 3].astype(np.int64) - lat[point] + py
    side_a, side_b = px * ay - py * ax, px * by - py * bx
    from_reference = ax * by - ay * bx
    from_point = from_reference + side_a - side_b
    within = (np.minimum(ax, bx) <= px) & (px <= np.maximum(ax, bx))
    within &= (np.minimum(ay, by) <= py) & (py <= np.maximum(ay, by))
    on_edge = (from_point == 0) & within
    crosses = (
        ((side_a > 0) != (side_b > 0))
        & ((from_reference > 0) != (from_point > 0))
        & (from_point != 0)
    )
    land ^= np.bincount(point[crosses], minlength=lon.size).astype(np.int64) % 2 == 1
    land[point[on_edge]] = True
    return land.reshape(shape)


def shoreline_edges(coast: Coast) -> npt.NDArray[np.int32]:
    """Return the shoreline edges ordered by their `edge_id`, shape (m, 4)."""
    ordered = np.empty((int(coast.edge_id.max(initial=-1)) + 1, 4), np.int32)
    ordered[coast.edge_id] = coast.edge
    return ordered


def covers(coast: Coast, box: Box) -> bool:
    """Return True if the grid covers a box, so that it contains all land there."""
    if coast.nx << coast.shift == TURN:
        wide_enough = True
    else:
        west = (round(box.west * TURN / 360) - coast.lon0) % TURN
        wide_enough = west + round((box.east - box.west) * TURN / 360) <= coast.nx << coast.shift
    south, north = (round(edge * TURN / 360) - coast.lat0 for edge in (box.south, box.north))
    return wide_enough and south >= 0 and north <= coast.ny << coast.shift


def nearest_coast(
    coast: Coast, lon_deg: float, lat_deg: float
) -> tuple[float, float, float] | None:
    """Return (lon [deg], lat [deg], distance [m]) of the nearest point of the coast in the grid.

    None if there is no coast. The nearest edge is found in a plane with longitudes scaled by the
    cosine of the point's latitude: exact nearby, off by some percent at 500 km.
    """
    nearest = _nearest_points(coast, lon_deg, lat_deg, 1)
    return _with_distance(lon_deg, lat_deg, *nearest[0]) if nearest else None


def nearest_water(
    coast: Coast, lon_deg: float, lat_deg: float
) -> tuple[float, float, float] | None:
    """Return (lon [deg], lat [deg], distance [m]) of water near a point.

    The water lies some 50 m off the coast if possible. A point in water is returned unchanged; None
    if no water is found.
    """
    lon, lat = sphere.to_binary(lon_deg), sphere.to_binary(lat_deg)
    if not is_land(coast, lon, lat):
        return lon_deg, lat_deg, 0.0
    bearing = np.arange(16) * np.pi / 8
    stretch = 1 / max(np.cos(np.deg2rad(lat_deg)), 0.01)
    for x, y in _nearest_points(coast, lon_deg, lat_deg, 32):
        for radius in (5400, 540, 54, 5, 2):  # [unit] of 9.3 mm
            lon = _wrap_to_int32(np.rint(x + radius * stretch * np.cos(bearing)).astype(np.int64))
            lat = np.rint(y + radius * np.sin(bearing)).astype(np.int32)
            wet = np.flatnonzero(~is_land(coast, lon, lat))
            if wet.size:
                candidates = [
                    _with_distance(lon_deg, lat_deg, int(lon[i]), int(lat[i])) for i in wet
                ]
                return min(candidates, key=lambda candidate: candidate[2])
    return None


def _nearest_points(
    coast: Coast, lon_deg: float, lat_deg: float, count: int
) -> list[tuple[float, float]]:
    """Return the nearest points [unit] on the `count` nearest edges."""
    lon, lat = sphere.to_binary(lon_deg), sphere.to_binary(lat_deg)
    edge = shoreline_edges(coast)
    if not len(edge):
        return []
    squeeze = np.cos(np.deg2rad(lat_deg))
    ax, bx = (_angle_difference(edge[:, i], lon) * squeeze for i in (0, 2))
    ay, by = (edge[:, i].astype(np.float64) - lat for i in (1, 3))
    dx, dy = bx - ax, by - ay
    along = np.clip(-(ax * dx + ay * dy) / (dx * dx + dy * dy + 1e-300), 0, 1)
    distance = np.hypot(ax + along * dx, ay + along * dy)
    best = np.argsort(distance)[:count]
    x = lon + (ax + along * dx)[best] / max(squeeze, 1e-9)
    y = lat + (ay + along * dy)[best]
    return list(zip(x.tolist(), y.tolist(), strict=True))


def _with_distance(
    lon_deg: float, lat_deg: float, lon: float, lat: float
) -> tuple[float, float, float]:
    """Return a point [unit] as (lon [deg], lat [deg], distance [m]) from a first point [deg]."""
    x = sphere.wrap_degrees(lon * 360 / TURN)
    y = lat * 360 / TURN
    return x, y, float(sphere.distance(*np.deg2rad([lon_deg, lat_deg, x, y])))


def _wrap_to_int32(units: Array) -> npt.NDArray[np.int32]:
    """Return binary angles wrapped into int32."""
    return (units & (TURN - 1)).astype(np.uint32).view(np.int32)


def _angle_difference(a: Array, b: Array) -> Ints:
    """Return a - b of binary angles along the shorter arc, as int64."""
    return np.asarray((a - b).astype(np.int32), np.int64)


def _concatenated_ranges(start: Array, count: Array) -> Ints:
    """Return start[i], start[i] + 1, ... (count[i] numbers) for every i, in one array."""
    ends = np.cumsum(count)
    return np.asarray(
        np.arange(int(ends[-1]) if ends.size else 0) + np.repeat(start - (ends - count), count),
        np.int64,
    )


def _cells_over(box: Box, shift: int) -> tuple[int, int, int, int]:
    """Return (west, south, columns, rows) of the cells that cover a box including its edges.

    West and south are in units; west is not wrapped.
    """
    size = 1 << shift
    units = TURN / 360.0
    west, east = (
        int(np.floor(box.west * units / size)),
        int(np.floor(box.east * units / size)) + 1,
    )
    south, north = (
        int(np.floor(box.south * units / size)),
        int(np.floor(box.north * units / size)) + 1,
    )
    if (east - west) * size >= TURN:
        west, east = -(TURN // 2 // size), TURN // 2 // size
    return west * size, south * size, east - west, north - south


def _split_edges(polygons: Array) -> Ints:
    """Return the polygons' edges [unit], shape (n, 4), split so that none exceeds LONGEST_EDGE.

    Longitudes are not wrapped.
    """
    points, ring = shapely.get_coordinates(shapely.get_rings(polygons), return_index=True)
    units = np.rint(points * (TURN / 360.0)).astype(np.int64)
    first = np.flatnonzero((ring[1:] == ring[:-1]) & (units[1:] != units[:-1]).any(axis=1))
    edge = np.concatenate([units[first], units[first + 1]], axis=1)
    # Few edges are long. Only those are halved repeatedly and put back in order among the others.
    long_edges = np.flatnonzero(_is_long(edge))
    part, owner = edge[long_edges], long_edges
    while (long := _is_long(part)).any():
        halves, owner = np.repeat(part, 1 + long, axis=0), np.repeat(owner, 1 + long)
        lower = np.flatnonzero(np.repeat(long, 1 + long))[::2]
        halves[lower, 2:] = halves[lower + 1, :2] = (halves[lower, :2] + halves[lower, 2:]) // 2
        part = halves
    if not long_edges.size:
        return np.asarray(edge, np.int64)
    count = np.ones(len(edge), np.int64)
    count[long_edges] = np.bincount(owner, minlength=len(edge))[long_edges]
    split = np.repeat(edge, count, axis=0)
    pieces = np.zeros(len(edge), bool)
    pieces[long_edges] = True
    split[np.repeat(pieces, count)] = part
    return np.asarray(split, np.int64)


def _is_long(edge: Ints) -> npt.NDArray[np.bool_]:
    """Return True for edges that are too long, shape (n,)."""
    wide, high = np.abs(edge[:, 2] - edge[:, 0]), np.abs(edge[:, 3] - edge[:, 1])
    return np.asarray(np.maximum(wide, high) >= LONGEST_EDGE, bool)


def _drop_cuts(edge: Ints, globe: bool, south: int) -> Ints:
    """Return the edges that are coast, without edges at a pole and cuts along a globe's seam."""
    rim = (np.abs(edge[:, 1] + south) == POLE) & (np.abs(edge[:, 3] + south) == POLE)
    if not globe:
        return np.asarray(edge[~rim] if rim.any() else edge, np.int64)
    seam = (edge[:, 0] == edge[:, 2]) & ((edge[:, 0] == 0) | (edge[:, 0] == TURN)) & ~rim
    ends, times = np.unique(edge[seam][:, [1, 3]], return_counts=True)
    # parts of the seam with land on one side only are coast
    odd = ends[times % 2 == 1].reshape(-1, 2)
    one_sided = np.stack([0 * odd[:, 0], odd[:, 0], 0 * odd[:, 0], odd[:, 1]], axis=1)
    return np.concatenate([edge[~(rim | seam)], one_sided])


def _upward(edge: Ints) -> tuple[Ints, Ints, Ints, Ints]:
    """Return the coordinates of the edges' ends, southern end first."""
    ax, ay, bx, by = (np.ascontiguousarray(column) for column in edge.T)
    down = ay > by
    return np.where(down, bx, ax), np.minimum(ay, by), np.where(down, ax, bx), np.maximum(ay, by)


def _touching_pairs(edge: Ints, shift: int, nx: int, ny: int, globe: bool) -> tuple[Ints, Ints]:
    """Return (edge, cell) for all pairs that touch.

    In each row of cells these are the columns between the points where the edge enters and leaves
    the row.
    """
    ax, ay, bx, by = _upward(edge)
    first, last = np.maximum(ay >> shift, 0), np.minimum(by >> shift, ny - 1)
    near = (np.minimum(ax, bx) >> shift < nx + globe) & (np.maximum(ax, bx) >= 0)
    count = np.where(near, np.maximum(last - first + 1, 0), 0)
    owner = np.repeat(np.arange(len(edge)), count)
    row = _concatenated_ranges(first, count)
    ax, ay, bx, by = ax[owner], ay[owner], bx[owner], by[owner]
    rise = np.maximum(by - ay, 1)
    enter = ax + (np.maximum(row << shift, ay) - ay) * (bx - ax) // rise
    leave = ax + (np.minimum((row + 1) << shift, by) - ay) * (bx - ax) // rise
    leave = np.where(by == ay, bx, leave)
    left = np.maximum(np.minimum(enter, leave) >> shift, 0)
    right = np.minimum(np.maximum(enter, leave) >> shift, nx - 1 + globe)
    count = np.maximum(right - left + 1, 0)
    cell = np.repeat(row * nx, count) + _concatenated_ranges(left, count) % nx
    return np.repeat(owner, count), cell


def _reference_offset(edge: Ints, cell: Ints, shift: int, nx: int) -> tuple[int, int]:
    """Return an offset of reference points in their cells with which none lies on an edge."""
    size = 1 << shift
    ax, bx = ((edge[:, i] - (cell % nx << shift)) for i in (0, 2))
    ay, by = ((edge[:, i] - (cell // nx << shift)) for i in (1, 3))
    for step in range(64):
        x, y = (size // 2 + 7919 * step) % size, (size // 2 + 104_729 * step + 1) % size
        on_line = (bx - ax) * (y - ay) == (by - ay) * (x - ax)
        on_line &= (np.minimum(ax, bx) <= x) & (x <= np.maximum(ax, bx))
        on_line &= (np.minimum(ay, by) <= y) & (y <= np.maximum(ay, by))
        if not on_line.any():
            return x, y
    raise ValueError("no reference point found that lies off every shoreline edge")


def _land_of_references(
    edge: Ints, reference: tuple[int, int], shift: int, nx: int, ny: int
) -> npt.NDArray[np.bool_]:
    """Return whether each cell's reference point is on land, by the parity of edges west of it."""
    ax, ay, bx, by = _upward(edge)
    x, y = reference
    first = np.maximum(-((y - ay) >> shift), 0)  # first row with reference latitude in [ay, by)
    last = np.minimum(-((y - by) >> shift) - 1, ny - 1)
    count = np.where(by > ay, np.maximum(last - first + 1, 0), 0)
    # few edges remain, because most lie between two reference latitudes
    owner = np.repeat(np.arange(len(edge)), count)
    row = _concatenated_ranges(first, count)
    ax, ay, bx, by = ax[owner], ay[owner], bx[owner], by[owner]
    crossing = ax + ((row << shift) + y - ay) * (bx - ax) // (by - ay)
    column = np.clip(((crossing - x) >> shift) + 1, 0, nx)
    toggles = np.bincount(row * (nx + 1) + column, minlength=ny * (nx + 1)).astype(np.uint8) & 1
    return np.asarray(
        np.bitwise_xor.accumulate(toggles.reshape(ny, nx + 1), axis=1)[:, :nx].ravel() == 1, bool
    )
