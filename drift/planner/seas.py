"""Where a boat may go: the sea of a region, kept off the shore, and the shortest ways on it.

The shore of full resolution, grown by the distance that a boat keeps from it, is the barrier. Whether a straight way is clear of
it is told exactly, by the integers of `kernels.coast`; straight is a great circle, which is followed in pieces. Distances from
a place come from Dijkstra's algorithm (SciPy) on a grid with sixteen directions, none of whose arcs touches the barrier:
such a distance is never too short, and at most 2.8 % too long, but for what hides between the nodes. A way is then pulled taut among
the corners of the barrier that are near it, with Dijkstra on their visibility graph, so that it turns at corners alone.
The way round what lies across a leg is sought among all corners of an ellipse: it is the shortest there is.
Works on a plane round the region's middle, some 500 km wide at the most; refuses nothing.
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

from drift.planner.planning_tracks import Plane
from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast import shore
from geo.coast.shore import Shore
from kernels import coast as crossing

Array = npt.NDArray[Any]

CLEAR = 25.0  # [m] that every boat keeps from the shore: a way that touches it is none
ROUNDING = 2.0  # [m] more, for what a straight piece of PIECE is off its great circle in longitude and latitude
SKIN = 10.0  # [m] outside the barrier: where ways turn and legs are cut, so that both are clear of it
PIECE = 4_000.0  # [m] up to 80 degrees of latitude straight to 1.8 m: L^2 tan(lat) / (8 R)
FINEST = 75.0  # [m] between nodes, at least
NODES = 600_000  # at most
ARCS = ((1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))  # (east, north); their opposites too
CORNERS = 240  # that a way is pulled taut among, at most
FEW = 64  # of a way round what cuts a leg, which is looked for often
BAND = 3.0  # [nodes] from a way in which it is pulled taut
RAYS = 4096  # by which it is told what a point sees
TILE = 200  # vertices of a piece of the barrier, at most


@dataclass(frozen=True)
class Sea:
    """The sea of a region, on a plane [m]."""

    plane: Plane
    keeps: float  # [m] from the shore
    wet: crossing.DeviceCoast  # its land is the barrier
    skin: Array  # shapely polygons [m]: the barrier and SKIN round it, in pieces
    tree: shapely.STRtree  # of the skin
    corners: Array  # (c, 2) [m] convex corners of the skin, in open water
    near: spatial.KDTree  # of the corners
    west: float  # [m] of node (0, 0)
    south: float
    step: float  # [m] between nodes
    open: Array  # bool (ny, nx): a node is in the water
    graph: sparse.csr_array  # (ny * nx, ny * nx) lengths of clear arcs [m], each in one direction
    part: Array  # int (ny * nx,) number of the water that a node belongs to

    def flat(self, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
        """Return points (n, 2) [m] of positions [deg]."""
        x, y = self.plane.flat(np.radians(lon), np.radians(lat))
        return np.column_stack([x, y])

    def round(self, points: Array) -> Array:
        """Return positions (n, 2) of lon, lat [deg] of points [m]."""
        return np.asarray(np.degrees(np.column_stack(self.plane.round(points[:, 0], points[:, 1]))))

    def holds(self, points: Array) -> bool:
        """Whether points (n, 2) [m] are all in the region."""
        ny, nx = self.open.shape
        low = np.array([self.west, self.south])
        return bool(np.all((points >= low) & (points <= low + self.step * (np.array([nx, ny]) - 1))))

    def at(self, node: Array) -> Array:
        """Return places [m] of nodes, (n, 2)."""
        nx = self.open.shape[1]
        return np.column_stack([self.west + self.step * (node % nx), self.south + self.step * (node // nx)])

    @property
    def nodes(self) -> Array:
        """Places of all nodes [m], (ny * nx, 2)."""
        ny, nx = self.open.shape
        x, y = np.meshgrid(self.west + self.step * np.arange(nx), self.south + self.step * np.arange(ny))
        return np.column_stack([x.ravel(), y.ravel()])


@dataclass(frozen=True)
class Region:
    """A rectangle of a plane, and the box that holds it."""

    plane: Plane
    low: Array  # (2,) [m]
    high: Array
    box: Box


def region(plane: Plane, places: Array, margin: float) -> Region:
    """Return the region of places (n, 2) [m] on a plane and a margin [m] about them."""
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    rim = np.linspace(0, 1, 33)
    edge = low + (high - low) * np.concatenate(
        [np.column_stack(v) for v in ((rim, 0 * rim), (rim, 0 * rim + 1), (0 * rim, rim), (0 * rim + 1, rim))]
    )
    lon, lat = (np.degrees(v) for v in plane.round(*edge.T))
    middle = math.degrees(plane.lon)
    lon = sphere.near_degrees(lon, middle)
    west = sphere.wrap_degrees(float(lon.min()))
    box = Box(west, float(lat.min()), west + float(np.ptp(lon)), float(lat.max()))
    return Region(plane, low, high, box.grown(0.1, 0.1))


def build(
    polygons: Sequence[Any] | Array, where: Region, keeps: float = 0.0, shoals: Array | None = None
) -> Sea | None:
    """Return the sea of a region; None without land in it.

    polygons: of the land [deg], full resolution; keeps: distance [m] from the shore, CLEAR at the least; shoals: polygons [deg] of
    water that is too shallow.
    """
    plane, low, high, box = where.plane, where.low, where.high, where.box
    keeps = max(keeps, CLEAR)
    far = float(np.abs([low, high]).max())
    grown = [_grown(shore.clip(np.asarray(polygons, object), box), plane, keeps + ROUNDING, far)]
    if shoals is not None and len(shoals):
        grown.append(_grown(shore.clip(shoals, box), plane, ROUNDING, 0.0))
    frame = shapely.box(*(low - 2 * SKIN), *(high + 2 * SKIN))
    whole = shapely.intersection(shapely.union_all(np.concatenate(grown)), frame)
    barrier = _polygons(whole)
    if not barrier.size:
        return None
    skin = _polygons(shapely.union_all(shapely.buffer(barrier, SKIN, join_style="mitre", mitre_limit=2.0)))
    centre = (box.west + box.east) / 2

    def back(points: Array) -> Array:
        x, y = (np.degrees(v) for v in plane.round(*points.T))
        return np.column_stack([sphere.near_degrees(x, centre), y])

    degrees = shapely.transform(shapely.segmentize(barrier, 1000.0), back)
    device = crossing.upload(shoreline.build(Shore(degrees, "barrier"), box))
    step = max(FINEST, math.sqrt(float(np.prod(high - low)) / NODES))
    nx, ny = (int(v) + 1 for v in np.floor((high - low) / step))
    x, y = np.meshgrid(low[0] + step * np.arange(nx), low[1] + step * np.arange(ny))
    open_ = _wet(device, plane, np.column_stack([x.ravel(), y.ravel()])).reshape(ny, nx)
    graph = _graph(device, plane, x, y, open_, step)
    corners = _convex(skin)
    corners = corners[np.all((corners > low) & (corners < high), axis=1)]
    corners = corners[_wet(device, plane, corners)]
    pieces = _tiles(skin)
    return Sea(
        plane=plane, keeps=keeps, wet=device, skin=pieces, tree=shapely.STRtree(pieces), corners=corners,
        near=spatial.KDTree(corners.reshape(-1, 2)), west=float(low[0]), south=float(low[1]), step=step, open=open_, graph=graph,
        part=csgraph.connected_components(graph, directed=False)[1],
    )  # fmt: skip


def _grown(polygons: Array, plane: Plane, by: float, far: float) -> Array:
    """Return polygons [deg] on the plane, grown by a distance [m]: at least by that everywhere up to `far` from its origin."""
    if not polygons.size:
        return polygons

    def flat(points: Array) -> Array:
        return np.column_stack(plane.flat(*np.radians(points.T)))

    # Across the way to the origin the plane is too long by c / sin(c): a distance on it is less on the sphere
    angle = min(math.sqrt(2) * far / sphere.RADIUS, 1.0)
    shapes = shapely.transform(shapely.segmentize(polygons, 0.01), flat)
    made = shapely.buffer(
        shapes, by * (angle / math.sin(angle) if angle > 0 else 1.0), join_style="mitre", mitre_limit=2.0
    )
    return np.asarray(made)


def _polygons(shape: Any) -> Array:
    parts = shapely.get_parts(shapely.get_parts(shape))
    return np.asarray(parts[(shapely.get_type_id(parts) == 3) & ~shapely.is_empty(parts)])


def _tiles(polygons: Array) -> Array:
    """Return polygons cut up, so that none has many vertices."""
    done, rest = [], polygons
    while rest.size:
        many = shapely.get_num_coordinates(rest) > TILE
        done.append(rest[~many])
        rest = rest[many]
        west, south, east, north = shapely.bounds(rest).T
        wide = east - west > north - south
        x, y = np.where(wide, (west + east) / 2, east), np.where(wide, north, (south + north) / 2)
        lower = shapely.intersection(rest, shapely.box(west, south, x, y))
        upper = shapely.intersection(rest, shapely.box(np.where(wide, x, west), np.where(wide, south, y), east, north))
        rest = _polygons(np.concatenate([lower, upper]))
    return np.concatenate(done) if done else polygons


def _convex(polygons: Array) -> Array:
    """Return the corners at which a taut way may turn round polygons, (c, 2)."""
    rings = shapely.get_rings(shapely.orient_polygons(polygons))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    found = []
    for k in np.split(np.arange(len(points)), np.flatnonzero(np.diff(ring)) + 1):
        own = points[k[:-1]]  # the last is the first
        before, after = own - np.roll(own, 1, axis=0), np.roll(own, -1, axis=0) - own
        # Outer rings run counterclockwise, holes clockwise: land is to the left of both
        found.append(own[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > 0])
    return np.concatenate(found) if found else np.empty((0, 2))


def _binary(plane: Plane, points: Array) -> tuple[Array, Array]:
    lon, lat = plane.round(points[:, 0], points[:, 1])
    return sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat))


def _wet(device: crossing.DeviceCoast, plane: Plane, points: Array) -> Array:
    return np.asarray(crossing.wet(device, *_binary(plane, points)), bool)


def _graph(
    device: crossing.DeviceCoast, plane: Plane, x: Array, y: Array, open_: Array, step: float
) -> sparse.csr_array:
    """Return the lengths of the arcs between nodes that are clear of the barrier."""
    ny, nx = open_.shape
    lon, lat = _binary(plane, np.column_stack([x.ravel(), y.ravel()]))
    number = np.arange(ny * nx).reshape(ny, nx)
    rows, columns, lengths = [], [], []
    for east, north in ARCS:
        here = (slice(max(-north, 0), ny - max(north, 0)), slice(0, nx - east))
        there = (slice(max(north, 0), ny - max(-north, 0)), slice(east, nx))
        both = open_[here] & open_[there]
        a, b = number[here][both], number[there][both]
        free = np.isinf(crossing.meets(device, lon[a], lat[a], lon[b] - lon[a], lat[b] - lat[a]))
        rows.append(a[free])
        columns.append(b[free])
        lengths.append(np.full(int(free.sum()), step * math.hypot(east, north)))
    ends = np.concatenate(rows), np.concatenate(columns)
    return sparse.csr_array((np.concatenate(lengths), ends), shape=(ny * nx, ny * nx))


def wet(sea: Sea, points: Array) -> Array:
    """Return whether points (n, 2) [m] are in the water, bool (n,)."""
    return _wet(sea.wet, sea.plane, points)


def clear(sea: Sea, begin: Array, end: Array) -> Array:
    """Return whether great circles between points [m], (n, 2) each, keep clear of the barrier, bool (n,); begins are in the water."""
    number = np.arange(len(begin))
    return sees(sea, np.concatenate([begin, end]), number, number + len(begin))


def sees(sea: Sea, points: Array, i: Array, j: Array) -> Array:
    """Return whether great circles from points[i] to points[j] [m], (n,) each, keep clear; those from which they begin are in the water."""
    if not len(i):
        return np.zeros(0, bool)
    which, lon, lat = followed(sea, points, i, j)
    x, y = sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat))
    step = np.flatnonzero(which[1:] == which[:-1])
    hit = np.isfinite(crossing.meets(sea.wet, x[step], y[step], x[step + 1] - x[step], y[step + 1] - y[step]))
    return np.asarray(np.bincount(which[step], hit, len(i)) == 0)


def followed(sea: Sea, points: Array, i: Array, j: Array) -> tuple[Array, Array, Array]:
    """Return which great circle, from 0, and (lon, lat) [rad] of points at most PIECE apart along those from points[i] to points[j] [m]."""
    lon, lat = sea.plane.round(*points.T)
    # On the plane lengths are at least what they are on the sphere
    count = np.maximum(np.ceil(np.hypot(*(points[j] - points[i]).T) / PIECE).astype(int), 1)
    which = np.repeat(np.arange(len(i)), count + 1)
    k = np.arange(len(which)) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    end = np.where(k == count[which], j[which], i[which])
    x, y = lon[end], lat[end]
    between = (k > 0) & (k < count[which])
    if between.any():
        share, a, b = (k / count[which])[between], i[which[between]], j[which[between]]
        east, north = sphere.offset(lon[a], lat[a], lon[b], lat[b])
        x[between], y[between] = sphere.destination(lon[a], lat[a], share * east, share * north)
    return which, x, y


def length(sea: Sea, points: Array) -> float:
    """Return the length [m] of great circles through points (n, 2) [m]."""
    lon, lat = sea.plane.round(*points.T)
    return float(sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]).sum())


def apart(sea: Sea, a: Array, b: Array) -> Array:
    """Return distances [m] on the sphere between points [m], (n, 2) each."""
    return np.asarray(sphere.distance(*sea.plane.round(*a.T), *sea.plane.round(*b.T)))


def taut(sea: Sea, begin: Array, end: Array, corners: Array) -> Array | None:
    """Return the shortest way (k, 2) from a point to another that turns at some of these corners only; None without one."""
    return _taut(sea, [np.concatenate([[begin, end], corners])])[0][0]


def _taut(sea: Sea, several: Sequence[Array]) -> list[tuple[Array | None, float]]:
    """Return for each set of points (k, 2) the shortest way from the first to the second by others of it, None without one, and its length."""
    points = np.concatenate(several)
    size = np.array([len(one) for one in several])
    begin = np.cumsum(size) - size
    pairs = [_pairs(int(n)) for n in size]
    i, j = (np.concatenate([pair[k] + at for pair, at in zip(pairs, begin, strict=True)]) for k in (0, 1))
    free = sees(sea, points, i, j)
    i, j = i[free], j[free]
    graph = sparse.csr_array((np.maximum(apart(sea, points[i], points[j]), 1e-3), (i, j)), shape=(len(points),) * 2)
    far, before = csgraph.dijkstra(graph, directed=False, indices=begin, return_predecessors=True)
    found: list[tuple[Array | None, float]] = []
    for row, at in enumerate(begin):
        way = [int(at) + 1]
        while before[row, way[-1]] >= 0:
            way.append(int(before[row, way[-1]]))
        found.append((points[way[::-1]] if way[-1] == at else None, float(far[row, at + 1])))
    return found


@functools.cache
def _pairs(count: int) -> tuple[Array, Array]:
    """Return all pairs of so many numbers, the lower first: asked for often, and for few counts."""
    i, j = np.triu_indices(count, 1)
    return i, j


def near(sea: Sea, begin: Array, end: Array, most: float, blocked: bool = False) -> Array | None:
    """Return the shortest way between points [m] that are near each other; None if it is longer than `most` [m]. See `nears`."""
    return nears(sea, begin[None], end[None], np.array([most]), np.array([blocked]))[0]


def nears(sea: Sea, begin: Array, end: Array, most: Array, blocked: Array) -> list[Array | None]:
    """Return the shortest ways between pairs of points [m], (n, 2) each, that are near each other; None for one longer than `most` [m].

    All ways of at most a length lie in the ellipse whose foci are their ends: with all of its corners the way is the shortest. Where
    there are more than FEW, those nearest to the straight line are tried, and a longer way may be found, or none. blocked: it is known
    that the straight line is.
    """
    found: list[Array | None] = [None] * len(begin)
    straight = np.hypot(*(end - begin).T)
    left = np.flatnonzero(straight <= most)
    ask = left[~blocked[left]]
    direct = ask[clear(sea, begin[ask], end[ask])]
    for k in direct:
        found[k] = np.stack([begin[k], end[k]])
    left = np.setdiff1d(left, direct)
    for times, more in ((1.15, 0.0), (1.5, 200.0), (2.5, 1000.0), (math.inf, 0.0)):
        if not left.size:
            break
        reach = np.minimum(times * straight[left] + more, most[left])
        sets, last = [], reach == most[left]
        middle = (begin[left] + end[left]) / 2
        for row, at in enumerate(sea.near.query_ball_point(middle, reach / 2)):
            a, b, points = begin[left[row]], end[left[row]], sea.corners[np.array(at, int)]
            points = points[np.hypot(*(points - a).T) + np.hypot(*(points - b).T) <= reach[row]]
            if len(points) > FEW:
                last[row] = True
                away = shapely.distance(shapely.points(points), shapely.LineString([a, b]))
                points = points[np.argsort(away, kind="stable")[:FEW]]
            sets.append(np.concatenate([[a, b], points]))
        for k, most_of, (way, size) in zip(left, reach, _taut(sea, sets), strict=True):
            if size <= most_of:
                found[k] = way
                last[left == k] = True
        left = left[~last]
    return found


def distances(sea: Sea, begin: int) -> tuple[Array, Array]:
    """Return how far [m] each node is from a node by sea (inf where there is no way), and by which node the way comes, (n,) each."""
    far, before = csgraph.dijkstra(sea.graph, directed=False, indices=begin, return_predecessors=True)
    return np.asarray(far), np.asarray(before)


def along(sea: Sea, before: Array, node: int) -> Array:
    """Return the way (k, 2) [m] over nodes to a node, from where distances were reckoned."""
    way = [node]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return sea.nodes[way[::-1]]


def pulled(sea: Sea, way: Array) -> Array:
    """Return a way (k, 2) [m], all of it clear, pulled taut: the shortest that passes land on the same sides, if not a shorter."""
    way = way[np.concatenate([[True], np.any(np.diff(way, axis=0) != 0, axis=1)])]
    if len(way) < 2:
        return way
    way = _shortcut(sea, way)
    for _ in range(4):
        corners = _beside(sea, way)
        # The turns that it has are kept: a way is found always, and it is no longer than this one
        found = taut(sea, way[0], way[-1], np.concatenate([way[1:-1], corners]))
        if found is None or length(sea, found) > length(sea, way) - 1.0:
            return way if found is None else found
        way = found
    return way


def _shortcut(sea: Sea, way: Array) -> Array:
    """Return a way with what can be cut short by straight lines cut out: from each point to the farthest that it sees."""
    kept, k = [0], 0
    while k < len(way) - 1:
        rest = way[k + 1 :]
        seen = np.flatnonzero(clear(sea, np.broadcast_to(way[k], rest.shape), rest))
        k += 1 + int(seen.max(initial=0))
        kept.append(k)
    return way[kept]


def _beside(sea: Sea, way: Array) -> Array:
    """Return the corners nearest to a way, as many as are tried."""
    band, line = BAND * sea.step, shapely.LineString(way)
    if not len(sea.corners):
        return sea.corners
    bounds = shapely.bounds(line)
    within = np.all((sea.corners > bounds[:2] - band) & (sea.corners < bounds[2:] + band), axis=1)
    points = sea.corners[within]
    away = shapely.distance(shapely.points(points), line)
    return points[np.argsort(away, kind="stable")[:CORNERS]]


def seen(sea: Sea, point: Array) -> Array:
    """Return which nodes a point [m] sees, bool (nodes,): by RAYS rays, between which a rock may hide.

    What is reckoned with it is only where to look; ways and times of a plan are told by `clear`.
    """
    nodes = sea.nodes
    lon, lat = sea.plane.round(*point)
    east, north = sphere.offset(lon, lat, *sea.plane.round(*nodes.T))
    away = np.hypot(east, north)
    bearing = np.arange(RAYS) * (2 * math.pi / RAYS)
    count = math.ceil(float(away.max()) / PIECE) + 1
    far = np.arange(count + 1) * PIECE
    x, y = sphere.destination(lon, lat, np.outer(np.sin(bearing), far), np.outer(np.cos(bearing), far))
    x, y = sphere.to_binary(np.degrees(x)), sphere.to_binary(np.degrees(y))
    a, b = (x[:, :-1].ravel(), y[:, :-1].ravel()), (x[:, 1:].ravel(), y[:, 1:].ravel())
    met = crossing.meets(sea.wet, *a, b[0] - a[0], b[1] - a[1]).astype(float)
    ends = met.reshape(RAYS, count) * PIECE + far[:-1]
    reach = ends.min(axis=1)
    reach = np.minimum(np.minimum(np.roll(reach, 1), np.roll(reach, -1)), reach)
    which = np.rint(np.arctan2(east, north) * (RAYS / (2 * math.pi))).astype(int) % RAYS
    return np.asarray(away < reach[which])


def filled(sea: Sea, far: Array) -> Array:
    """Return distances of nodes, (ny, nx): where there is none (on land, say) that of the nearest that has one, and straight on."""
    grid = far.reshape(sea.open.shape)
    lost = ~np.isfinite(grid)
    if lost.all():
        return grid
    away, (row, column) = ndimage.distance_transform_edt(lost, return_indices=True)
    return np.asarray(grid[row, column] + sea.step * away)


def sampled(sea: Sea, grid: Array, points: Array) -> Array:
    """Return how far [m] points (n, 2) [m] are by filled distances of the four nodes round each."""
    ny, nx = grid.shape
    column = np.clip(np.floor((points[:, 0] - sea.west) / sea.step).astype(int), 0, nx - 2)
    row = np.clip(np.floor((points[:, 1] - sea.south) / sea.step).astype(int), 0, ny - 2)
    best = np.full(len(points), np.inf)
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        x, y = sea.west + sea.step * (column + j), sea.south + sea.step * (row + i)
        best = np.minimum(best, grid[row + i, column + j] + np.hypot(points[:, 0] - x, points[:, 1] - y))
    return best


def around(sea: Sea, far: Array, point: Array) -> Array:
    """Return the nodes about a point [m] that have a distance."""
    ny, nx = sea.open.shape
    column, row = (math.floor((v - w) / sea.step) for v, w in zip(point, (sea.west, sea.south), strict=True))
    j, i = np.meshgrid(np.arange(column - 2, column + 4), np.arange(row - 2, row + 4))
    node = (i * nx + j)[(j >= 0) & (j < nx) & (i >= 0) & (i < ny)]
    return np.asarray(node[np.isfinite(far[node])])


def joined(sea: Sea, far: Array, point: Array) -> int | None:
    """Return the node by which a point [m] is nearest to where distances were reckoned from, of those that it sees near by; None without."""
    node = around(sea, far, point)
    places = sea.at(node)
    # Nodes are in the water: a point on land sees none
    total = np.where(
        clear(sea, np.broadcast_to(point, places.shape), places), far[node] + np.hypot(*(places - point).T), np.inf
    )
    if not np.isfinite(total).any():
        return None
    return int(node[np.argmin(total)])
