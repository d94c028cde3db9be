"""The sea that a boat may use, at its distance from the shore, and the shortest ways on it.

The barrier is the shore in full resolution, grown by the distance that the boat keeps.
`kernels.step.coast` tests exactly, in integers, whether a straight way is clear of the barrier; a
straight way is a great circle, followed in pieces. Distances from a place come from Dijkstra's
algorithm (SciPy) on a grid with sixteen directions, whose arcs do not touch the barrier. Such a
distance is never too short, and at most 2.8 % too long, except for passages narrower than the grid.
A way is then shortened among the nearby corners of the barrier, with Dijkstra's algorithm on their
visibility graph, so that it turns only at corners. Ways round land across a leg use all corners in
an ellipse, and so are the shortest possible. All this works on a plane about the region's centre,
at most some 500 km wide; this module raises no errors for users.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage, sparse, spatial
from scipy.sparse import csgraph

from drift.planning.search.planning_tracks import Plane
from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import shore
from geo.coast.shore import Shore
from kernels.step import coast as crossing

CLEAR = 25.0  # [m] least distance of every boat from the shore; touching ways are not clear
# [m] added to that: straight pieces in longitude and latitude deviate from the great circle
ROUNDING = 2.0
SKIN = 10.0  # [m] distance from the barrier at which ways turn and legs are cut
# [m] longest piece; up to 80 degrees of latitude it is straight to 1.8 m: L^2 tan(lat) / (8 R)
PIECE = 4_000.0
FINEST = 75.0  # [m] smallest distance between nodes
NODES = 600_000  # most nodes
# (east, north); their opposites too
ARCS = ((1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))
CORNERS = 240  # most corners when a way is pulled taut
FEW = 64  # most corners for a way round land across a leg; these are computed often
BAND = 3.0  # [nodes] distance up to which corners count when a way is pulled taut
RAYS = 4096  # rays from a point that decide which nodes are visible
TILE = 200  # most vertices of a piece of the barrier


@dataclass(frozen=True)
class Sea:
    """The sea of a region, on a plane [m]."""

    plane: Plane
    keeps: float  # [m] distance that the boat keeps from the shore
    wet: crossing.DeviceCoast  # a coast whose land is the barrier
    skin: Array  # shapely polygons [m]: the barrier and SKIN round it, in pieces
    tree: shapely.STRtree  # of the skin
    corners: Array  # (c, 2) [m] convex corners of the skin, in open water
    near: spatial.KDTree  # of the corners
    west: float  # [m] x of node (0, 0)
    south: float  # [m] y of node (0, 0)
    step: float  # [m] between nodes
    open: Array  # bool (ny, nx): a node is in the water
    graph: sparse.csr_array  # (ny * nx, ny * nx) lengths of clear arcs [m], each in one direction
    part: Array  # int (ny * nx,) number of the connected water to which a node belongs

    def flat(self, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
        """Return points (n, 2) [m] of positions [deg]."""
        x, y = self.plane.flat(np.radians(lon), np.radians(lat))
        return np.column_stack([x, y])

    def round(self, points: Array) -> Array:
        """Return positions (n, 2), lon and lat [deg], of points (n, 2) [m]."""
        return np.asarray(np.degrees(np.column_stack(self.plane.round(points[:, 0], points[:, 1]))))

    def holds(self, points: Array) -> bool:
        """Return True if all points (n, 2) [m] are in the region."""
        ny, nx = self.open.shape
        low = np.array([self.west, self.south])
        return bool(
            np.all((points >= low) & (points <= low + self.step * (np.array([nx, ny]) - 1)))
        )

    def at(self, node: Array) -> Array:
        """Return positions [m] of nodes, shape (n, 2)."""
        nx = self.open.shape[1]
        return np.column_stack(
            [self.west + self.step * (node % nx), self.south + self.step * (node // nx)]
        )

    @property
    def nodes(self) -> Array:
        """Positions of all nodes [m], shape (ny * nx, 2)."""
        ny, nx = self.open.shape
        x, y = np.meshgrid(
            self.west + self.step * np.arange(nx), self.south + self.step * np.arange(ny)
        )
        return np.column_stack([x.ravel(), y.ravel()])


@dataclass(frozen=True)
class Region:
    """A rectangle on a plane, and the box that contains it."""

    plane: Plane
    low: Array  # (2,) [m]
    high: Array
    box: Box


def region(plane: Plane, places: Array, margin: float) -> Region:
    """Return the region of places on a plane.

    Args:
        plane: of the region.
        places: [m], shape (n, 2).
        margin: about the places [m].
    """
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    rim = np.linspace(0, 1, 33)
    edge = low + (high - low) * np.concatenate(
        [
            np.column_stack(v)
            for v in ((rim, 0 * rim), (rim, 0 * rim + 1), (0 * rim, rim), (0 * rim + 1, rim))
        ]
    )
    lon, lat = (np.degrees(v) for v in plane.round(*edge.T))
    middle = math.degrees(plane.lon)
    lon = sphere.near_degrees(lon, middle)
    west = sphere.wrap_degrees(float(lon.min()))
    box = Box(west, float(lat.min()), west + float(np.ptp(lon)), float(lat.max()))
    return Region(plane, low, high, box.grown(0.1, 0.1))


def build_sea(
    polygons: Sequence[Any] | Array, where: Region, keeps: float = 0.0, shoals: Array | None = None
) -> Sea | None:
    """Return the sea of a region; None if it contains no land.

    Args:
        polygons: land [deg] in full resolution.
        where: the region.
        keeps: distance from the shore [m], at least CLEAR.
        shoals: polygons [deg] of water that is too shallow.
    """
    plane, low, high, box = where.plane, where.low, where.high, where.box
    keeps = max(keeps, CLEAR)
    far = float(np.abs([low, high]).max())
    grown_parts = [
        _grown(shore.clip(np.asarray(polygons, object), box), plane, keeps + ROUNDING, far)
    ]
    if shoals is not None and len(shoals):
        grown_parts.append(_grown(shore.clip(shoals, box), plane, ROUNDING, 0.0))
    frame = shapely.box(*(low - 2 * SKIN), *(high + 2 * SKIN))
    blocked = shapely.intersection(shapely.union_all(np.concatenate(grown_parts)), frame)
    barrier = _polygons(blocked)
    if not barrier.size:
        return None
    skin = _polygons(
        shapely.union_all(shapely.buffer(barrier, SKIN, join_style="mitre", mitre_limit=2.0))
    )
    centre = (box.west + box.east) / 2

    def back(points: Array) -> Array:
        """Return positions [deg] of points on the plane."""
        x, y = (np.degrees(v) for v in plane.round(*points.T))
        return np.column_stack([sphere.near_degrees(x, centre), y])

    degrees = shapely.transform(shapely.segmentize(barrier, 1000.0), back)
    device = crossing.upload(shoreline.build_coast(Shore(degrees, "barrier"), box))
    step = max(FINEST, math.sqrt(float(np.prod(high - low)) / NODES))
    nx, ny = (int(v) + 1 for v in np.floor((high - low) / step))
    x, y = np.meshgrid(low[0] + step * np.arange(nx), low[1] + step * np.arange(ny))
    open_water = _wet(device, plane, np.column_stack([x.ravel(), y.ravel()])).reshape(ny, nx)
    graph = _graph(device, plane, x, y, open_water, step)
    corners = _convex(skin)
    corners = corners[np.all((corners > low) & (corners < high), axis=1)]
    corners = corners[_wet(device, plane, corners)]
    pieces = _tiles(skin)
    return Sea(
        plane=plane,
        keeps=keeps,
        wet=device,
        skin=pieces,
        tree=shapely.STRtree(pieces),
        corners=corners,
        near=spatial.KDTree(corners.reshape(-1, 2)),
        west=float(low[0]),
        south=float(low[1]),
        step=step,
        open=open_water,
        graph=graph,
        part=csgraph.connected_components(graph, directed=False)[1],
    )


def _grown(polygons: Array, plane: Plane, by: float, far: float) -> Array:
    """Return polygons [deg] on the plane, grown by at least a distance `by` [m].

    The distance holds within `far` [m] of the plane's origin.
    """
    if not polygons.size:
        return polygons

    def flat(points: Array) -> Array:
        """Return points on the plane of positions [deg]."""
        return np.column_stack(plane.flat(*np.radians(points.T)))

    # Across the direction of the origin, lengths on the plane are c / sin(c) times those on the
    # sphere.
    angle = min(math.sqrt(2) * far / sphere.RADIUS, 1.0)
    shapes = shapely.transform(shapely.segmentize(polygons, 0.01), flat)
    grown = shapely.buffer(
        shapes,
        by * (angle / math.sin(angle) if angle > 0 else 1.0),
        join_style="mitre",
        mitre_limit=2.0,
    )
    return np.asarray(grown)


def _polygons(shape: Any) -> Array:
    """Return the polygons in geometries and collections."""
    parts = shapely.get_parts(shapely.get_parts(shape))
    return np.asarray(parts[(shapely.get_type_id(parts) == 3) & ~shapely.is_empty(parts)])


def _tiles(polygons: Array) -> Array:
    """Return polygons cut into pieces of at most TILE vertices."""
    tiles, large = [], polygons
    while large.size:
        too_many = shapely.get_num_coordinates(large) > TILE
        tiles.append(large[~too_many])
        large = large[too_many]
        west, south, east, north = shapely.bounds(large).T
        wide = east - west > north - south
        x, y = np.where(wide, (west + east) / 2, east), np.where(wide, north, (south + north) / 2)
        lower = shapely.intersection(large, shapely.box(west, south, x, y))
        upper = shapely.intersection(
            large, shapely.box(np.where(wide, x, west), np.where(wide, south, y), east, north)
        )
        large = _polygons(np.concatenate([lower, upper]))
    return np.concatenate(tiles) if tiles else polygons


def _convex(polygons: Array) -> Array:
    """Return the corners at which a taut way may turn round polygons, shape (c, 2)."""
    rings = shapely.get_rings(shapely.orient_polygons(polygons))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    corners = []
    for vertices in np.split(np.arange(len(points)), np.flatnonzero(np.diff(ring)) + 1):
        ring_points = points[vertices[:-1]]  # the last vertex repeats the first
        before, after = (
            ring_points - np.roll(ring_points, 1, axis=0),
            np.roll(ring_points, -1, axis=0) - ring_points,
        )
        # Outer rings run counterclockwise and holes clockwise, so that land is to the left of both.
        corners.append(ring_points[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > 0])
    return np.concatenate(corners) if corners else np.empty((0, 2))


def _binary(plane: Plane, points: Array) -> tuple[Array, Array]:
    """Return (lon, lat) of points (n, 2) [m] as binary angles."""
    lon, lat = plane.round(points[:, 0], points[:, 1])
    return sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat))


def _wet(device: crossing.DeviceCoast, plane: Plane, points: Array) -> Array:
    """Return whether points (n, 2) [m] are in the water, bool (n,)."""
    return np.asarray(crossing.wet(device, *_binary(plane, points)), bool)


def _graph(
    device: crossing.DeviceCoast, plane: Plane, x: Array, y: Array, open_water: Array, step: float
) -> sparse.csr_array:
    """Return the lengths [m] of the arcs between nodes that are clear of the barrier."""
    ny, nx = open_water.shape
    lon, lat = _binary(plane, np.column_stack([x.ravel(), y.ravel()]))
    number = np.arange(ny * nx).reshape(ny, nx)
    rows, columns, lengths = [], [], []
    for east, north in ARCS:
        from_ = (slice(max(-north, 0), ny - max(north, 0)), slice(0, nx - east))
        to = (slice(max(north, 0), ny - max(-north, 0)), slice(east, nx))
        joined = open_water[from_] & open_water[to]
        a, b = number[from_][joined], number[to][joined]
        free = np.isinf(crossing.meets(device, lon[a], lat[a], lon[b] - lon[a], lat[b] - lat[a]))
        rows.append(a[free])
        columns.append(b[free])
        lengths.append(np.full(int(free.sum()), step * math.hypot(east, north)))
    ends = np.concatenate(rows), np.concatenate(columns)
    return sparse.csr_array((np.concatenate(lengths), ends), shape=(ny * nx, ny * nx))


def wet(sea: Sea, points: Array) -> Array:
    """Return whether points (n, 2) [m] are in the water, bool (n,)."""
    return _wet(sea.wet, sea.plane, points)


def _clear(sea: Sea, begin: Array, end: Array) -> Array:
    """Return whether great circles between points are clear of the barrier, bool (n,).

    Args:
        sea: of the boat.
        begin: first points [m], shape (n, 2); they must be in the water.
        end: last points [m], shape (n, 2).
    """
    number = np.arange(len(begin))
    return sees(sea, np.concatenate([begin, end]), number, number + len(begin))


def sees(sea: Sea, points: Array, i: Array, j: Array) -> Array:
    """Return whether great circles between points are clear of the barrier, bool (n,).

    Args:
        sea: of the boat.
        points: [m], shape (k, 2).
        i: indices of the first points, shape (n,); these must be in the water.
        j: indices of the last points, shape (n,).
    """
    if not len(i):
        return np.zeros(0, bool)
    circle, lon, lat = great_circles(sea, points, i, j)
    x, y = sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat))
    step = np.flatnonzero(circle[1:] == circle[:-1])
    hit = np.isfinite(
        crossing.meets(sea.wet, x[step], y[step], x[step + 1] - x[step], y[step + 1] - y[step])
    )
    return np.asarray(np.bincount(circle[step], hit, len(i)) == 0)


def great_circles(sea: Sea, points: Array, i: Array, j: Array) -> tuple[Array, Array, Array]:
    """Return points along great circles, at most PIECE apart.

    Args:
        sea: of the boat.
        points: [m], shape (k, 2).
        i: indices of the first points, shape (n,).
        j: indices of the last points, shape (n,).

    Returns:
        The index of each point's great circle, and its lon and lat [rad].
    """
    lon, lat = sea.plane.round(*points.T)
    # Lengths on the plane are never shorter than those on the sphere.
    count = np.maximum(np.ceil(np.hypot(*(points[j] - points[i]).T) / PIECE).astype(int), 1)
    circle = np.repeat(np.arange(len(i)), count + 1)
    k = np.arange(len(circle)) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    end = np.where(k == count[circle], j[circle], i[circle])
    x, y = lon[end], lat[end]
    between = (k > 0) & (k < count[circle])
    if between.any():
        share, a, b = (k / count[circle])[between], i[circle[between]], j[circle[between]]
        east, north = sphere.offset(lon[a], lat[a], lon[b], lat[b])
        x[between], y[between] = sphere.destination(lon[a], lat[a], share * east, share * north)
    return circle, x, y


def length(sea: Sea, points: Array) -> float:
    """Return the length [m] of great circles through points (n, 2) [m]."""
    lon, lat = sea.plane.round(*points.T)
    return float(sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]).sum())


def apart(sea: Sea, a: Array, b: Array) -> Array:
    """Return distances [m] on the sphere between points [m], (n, 2) each."""
    return np.asarray(sphere.distance(*sea.plane.round(*a.T), *sea.plane.round(*b.T)))


def taut(sea: Sea, begin: Array, end: Array, corners: Array) -> Array | None:
    """Return the shortest way between two points that turns only at given corners.

    Args:
        sea: of the boat.
        begin: first point [m], shape (2,).
        end: last point [m], shape (2,).
        corners: [m], shape (c, 2).

    Returns:
        The way [m], shape (k, 2); None if there is none.
    """
    return _taut(sea, [np.concatenate([[begin, end], corners])])[0][0]


def _taut(sea: Sea, several: Sequence[Array]) -> list[tuple[Array | None, float]]:
    """Return the shortest way (None: no way) and its length [m] for each set of points.

    The way leads from the first point of a set (k, 2) [m] to the second and turns only at others.
    """
    points = np.concatenate(several)
    size = np.array([len(group) for group in several])
    begin = np.cumsum(size) - size
    pairs = [_pairs(int(n)) for n in size]
    i, j = (
        np.concatenate([pair[k] + start for pair, start in zip(pairs, begin, strict=True)])
        for k in (0, 1)
    )
    free = sees(sea, points, i, j)
    i, j = i[free], j[free]
    graph = sparse.csr_array(
        (np.maximum(apart(sea, points[i], points[j]), 1e-3), (i, j)), shape=(len(points),) * 2
    )
    far, before = csgraph.dijkstra(graph, directed=False, indices=begin, return_predecessors=True)
    ways: list[tuple[Array | None, float]] = []
    for row, start in enumerate(begin):
        way = [int(start) + 1]
        while before[row, way[-1]] >= 0:
            way.append(int(before[row, way[-1]]))
        ways.append((points[way[::-1]] if way[-1] == start else None, float(far[row, start + 1])))
    return ways


@functools.cache
def _pairs(count: int) -> tuple[Array, Array]:
    """Return all pairs of `count` indices, the lower first.

    They are cached because few counts are needed very often.
    """
    i, j = np.triu_indices(count, 1)
    return i, j


def short_way(
    sea: Sea, begin: Array, end: Array, most: float, blocked: bool = False
) -> Array | None:
    """Return the shortest way between two near points [m]; None above a length `most` [m]."""
    return short_ways(sea, begin[None], end[None], np.array([most]), np.array([blocked]))[0]


def short_ways(
    sea: Sea, begin: Array, end: Array, most: Array, blocked: Array
) -> list[Array | None]:
    """Return the shortest ways between pairs of near points.

    All ways up to a length lie in the ellipse whose foci are their ends, so the shortest way among
    all corners in it is the shortest of all. If there are more than FEW corners, only those nearest
    to the straight line are tried; the result may then be a longer way, or none.

    Args:
        sea: of the boat.
        begin: first points [m], shape (n, 2).
        end: last points [m], shape (n, 2).
        most: longest allowed way [m], shape (n,).
        blocked: whether the straight line is known not to be clear, bool (n,).

    Returns:
        For each pair the way [m], shape (k, 2), or None.
    """
    ways: list[Array | None] = [None] * len(begin)
    straight = np.hypot(*(end - begin).T)
    open_pairs = np.flatnonzero(straight <= most)
    untested = open_pairs[~blocked[open_pairs]]
    sighted = untested[_clear(sea, begin[untested], end[untested])]
    for k in sighted:
        ways[k] = np.stack([begin[k], end[k]])
    open_pairs = np.setdiff1d(open_pairs, sighted)
    for times, more in ((1.15, 0.0), (1.5, 200.0), (2.5, 1000.0), (math.inf, 0.0)):
        if not open_pairs.size:
            break
        reach = np.minimum(times * straight[open_pairs] + more, most[open_pairs])
        sets, final = [], reach == most[open_pairs]
        middle = (begin[open_pairs] + end[open_pairs]) / 2
        for row, candidates in enumerate(sea.near.query_ball_point(middle, reach / 2)):
            a, b, points = (
                begin[open_pairs[row]],
                end[open_pairs[row]],
                sea.corners[np.array(candidates, int)],
            )
            points = points[np.hypot(*(points - a).T) + np.hypot(*(points - b).T) <= reach[row]]
            if len(points) > FEW:
                final[row] = True
                distance = shapely.distance(shapely.points(points), shapely.LineString([a, b]))
                points = points[np.argsort(distance, kind="stable")[:FEW]]
            sets.append(np.concatenate([[a, b], points]))
        for k, limit, (way, size) in zip(open_pairs, reach, _taut(sea, sets), strict=True):
            if size <= limit:
                ways[k] = way
                final[open_pairs == k] = True
        open_pairs = open_pairs[~final]
    return ways


def distances(sea: Sea, begin: int) -> tuple[Array, Array]:
    """Return distances [m] by sea from a node to all nodes, and the predecessor of each.

    A distance is inf if there is no way; both have the shape (nodes,).
    """
    far, before = csgraph.dijkstra(
        sea.graph, directed=False, indices=begin, return_predecessors=True
    )
    return np.asarray(far), np.asarray(before)


def along(sea: Sea, before: Array, node: int) -> Array:
    """Return the way (k, 2) [m] over nodes to a node, from the start of `distances`."""
    way = [node]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return sea.nodes[way[::-1]]


def pulled_taut(sea: Sea, way: Array) -> Array:
    """Return a clear way (k, 2) [m] pulled taut.

    It is at most as long as any way that passes land on the same sides.
    """
    way = way[np.concatenate([[True], np.any(np.diff(way, axis=0) != 0, axis=1)])]
    if len(way) < 2:
        return way
    way = _shortcut(sea, way)
    for _ in range(4):
        corners = _beside(sea, way)
        # The way's own turns are included, so that a way no longer than this one is always found.
        shorter = taut(sea, way[0], way[-1], np.concatenate([way[1:-1], corners]))
        if shorter is None or length(sea, shorter) > length(sea, way) - 1.0:
            return way if shorter is None else shorter
        way = shorter
    return way


def _shortcut(sea: Sea, way: Array) -> Array:
    """Return a way with each point joined straight to the farthest that is visible."""
    kept, k = [0], 0
    while k < len(way) - 1:
        ahead = way[k + 1 :]
        visible = np.flatnonzero(_clear(sea, np.broadcast_to(way[k], ahead.shape), ahead))
        k += 1 + int(visible.max(initial=0))
        kept.append(k)
    return way[kept]


def _beside(sea: Sea, way: Array) -> Array:
    """Return the corners nearest to a way, at most CORNERS of them."""
    band, line = BAND * sea.step, shapely.LineString(way)
    if not len(sea.corners):
        return sea.corners
    bounds = shapely.bounds(line)
    within = np.all((sea.corners > bounds[:2] - band) & (sea.corners < bounds[2:] + band), axis=1)
    points = sea.corners[within]
    distance = shapely.distance(shapely.points(points), line)
    return points[np.argsort(distance, kind="stable")[:CORNERS]]


def visible_nodes(sea: Sea, point: Array) -> Array:
    """Return which nodes are visible from a point [m], bool (nodes,).

    The test uses rays, between which a rock may hide. It serves only the search for rectangles;
    `_clear` decides on the ways and times of a plan.
    """
    nodes = sea.nodes
    lon, lat = sea.plane.round(*point)
    east, north = sphere.offset(lon, lat, *sea.plane.round(*nodes.T))
    distance = np.hypot(east, north)
    bearing = np.arange(RAYS) * (2 * math.pi / RAYS)
    count = math.ceil(float(distance.max()) / PIECE) + 1
    far = np.arange(count + 1) * PIECE
    x, y = sphere.destination(
        lon, lat, np.outer(np.sin(bearing), far), np.outer(np.cos(bearing), far)
    )
    x, y = sphere.to_binary(np.degrees(x)), sphere.to_binary(np.degrees(y))
    a, b = (x[:, :-1].ravel(), y[:, :-1].ravel()), (x[:, 1:].ravel(), y[:, 1:].ravel())
    share_met = crossing.meets(sea.wet, *a, b[0] - a[0], b[1] - a[1]).astype(float)
    ray_ends = share_met.reshape(RAYS, count) * PIECE + far[:-1]
    reach = ray_ends.min(axis=1)
    reach = np.minimum(np.minimum(np.roll(reach, 1), np.roll(reach, -1)), reach)
    ray = np.rint(np.arctan2(east, north) * (RAYS / (2 * math.pi))).astype(int) % RAYS
    return np.asarray(distance < reach[ray])


def filled(sea: Sea, far: Array) -> Array:
    """Return distances [m] of all nodes, shape (ny, nx).

    A node without a distance (such as one on land) gets that of the nearest node with one plus the
    straight line to it.
    """
    grid = far.reshape(sea.open.shape)
    missing = ~np.isfinite(grid)
    if missing.all():
        return grid
    distance, (row, column) = ndimage.distance_transform_edt(missing, return_indices=True)
    return np.asarray(grid[row, column] + sea.step * distance)


def sampled(sea: Sea, grid: Array, points: Array) -> Array:
    """Return distances [m] of points by the best of the four surrounding nodes, shape (n,).

    Args:
        sea: of the boat.
        grid: distances of nodes [m], from `filled`.
        points: [m], shape (n, 2).
    """
    ny, nx = grid.shape
    column = np.clip(np.floor((points[:, 0] - sea.west) / sea.step).astype(int), 0, nx - 2)
    row = np.clip(np.floor((points[:, 1] - sea.south) / sea.step).astype(int), 0, ny - 2)
    best = np.full(len(points), np.inf)
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        x, y = sea.west + sea.step * (column + j), sea.south + sea.step * (row + i)
        best = np.minimum(
            best, grid[row + i, column + j] + np.hypot(points[:, 0] - x, points[:, 1] - y)
        )
    return best


def nodes_near(sea: Sea, far: Array, point: Array) -> Array:
    """Return the nodes about a point [m] that have a finite distance, shape (k,)."""
    ny, nx = sea.open.shape
    column, row = (
        math.floor((v - w) / sea.step) for v, w in zip(point, (sea.west, sea.south), strict=True)
    )
    j, i = np.meshgrid(np.arange(column - 2, column + 4), np.arange(row - 2, row + 4))
    node = (i * nx + j)[(j >= 0) & (j < nx) & (i >= 0) & (i < ny)]
    return np.asarray(node[np.isfinite(far[node])])


def nearest_visible_node(sea: Sea, far: Array, point: Array) -> int | None:
    """Return the visible node over which a point [m] has the shortest distance.

    None if no node is visible.
    """
    node = nodes_near(sea, far, point)
    places = sea.at(node)
    # No node is visible from a point on land, because nodes are in the water.
    total = np.where(
        _clear(sea, np.broadcast_to(point, places.shape), places),
        far[node] + np.hypot(*(places - point).T),
        np.inf,
    )
    if not np.isfinite(total).any():
        return None
    return int(node[np.argmin(total)])
