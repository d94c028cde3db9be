"""Distances over land: the shortest path that never leaves a polygon.

In a polygon without holes, the triangles between two places form one sleeve, and the funnel
algorithm (Lee and Preparata 1984, doi:10.1002/net.3230140304) finds the shortest path through it
exactly. Around a lake there are several sleeves. The one along the shortest chain of edge midpoints
is taken, so the path may be longer than the shortest.

The plane is gnomonic about the place from which distances are measured, so great circles are
straight. Coasts are first simplified to a thousandth of the reach, which changes a path by about as
much; inlets deeper than that remain.
"""

import itertools
from collections.abc import Sequence

import numpy as np
import shapely
from scipy import sparse
from scipy.sparse import csgraph

from geo import sphere
from geo.array import Array, Real
from geo.coast.land_masses import LandMasses, LonLat

FARTHEST = 1_000_000.0  # [m] largest reach
DETAIL = 1e-3  # tolerance of simplified coasts, as a share of the reach
LINKS = 300  # least number of parts into which the shores of land with lakes are divided
TURNS = (-360.0, 0.0, 360.0)

Plane = tuple[float, float]


def overland_distances(
    land: LandMasses, base: LonLat, places: Sequence[LonLat], reach: float
) -> Real:
    """Return distances [m] over land and bridges from a base to places, shape (n,).

    Args:
        land: the land masses, with bridges.
        base: position on land [deg].
        places: positions [deg].
        reach: largest distance of interest [m], at most FARTHEST; beyond it the result is inf.
    """
    found = np.full(len(places), np.inf)
    flat = sphere.distance(
        *np.radians(base), *np.radians(np.asarray(places, float).reshape(-1, 2)).T
    )
    near = np.flatnonzero(flat <= reach)
    ground = _land_in_reach(land, base, reach)
    if not near.size or not ground:
        return found
    ends = [end for bridge in land.bridges for end in bridge]
    spots = [base, *ends, *(places[int(k)] for k in near)]
    points = _to_gnomonic(base, np.array(spots, float))
    owner = shapely.STRtree(ground).nearest(shapely.points(points))
    # the base and the ends of bridges: paths from these to all places on their polygon are needed
    firm = 1 + len(ends)
    links: list[tuple[int, int, float]] = []
    for b in range(len(land.bridges)):
        i = 1 + 2 * b
        links.append(
            (i, i + 1, float(sphere.distance(*np.radians(spots[i]), *np.radians(spots[i + 1]))))
        )
    for number in np.unique(owner[:firm]):
        here = np.flatnonzero(owner == number)
        mesh = _Mesh(ground[number])
        for begin in here[here < firm]:
            others = here[(here >= firm) | (here > begin)]
            for k, way in zip(others, mesh.lengths(points[begin], points[others]), strict=True):
                links.append((int(begin), int(k), max(way, 1e-3)))  # 0 would mean no link
    if not links:
        return found
    begins, to, length = zip(*links, strict=True)
    graph = sparse.coo_array((length, (begins, to)), (len(spots), len(spots))).tocsr()
    ways = csgraph.dijkstra(graph, directed=False, indices=0)[firm:]
    found[near] = np.where(ways <= reach, ways, np.inf)
    return found


def _land_in_reach(land: LandMasses, base: LonLat, reach: float) -> list[shapely.Polygon]:
    """Return the polygons of land within reach in the gnomonic plane of a base [m], simplified."""
    width = np.degrees(reach / sphere.RADIUS) * 1.01
    # widest longitude of a circle: asin(sin r / cos lat); around a pole it is all longitudes
    wide = np.sin(np.radians(width)) / max(np.cos(np.radians(base[1])), 1e-9)
    wide = np.degrees(np.arcsin(wide)) if wide < 1 else 180.0
    box = shapely.box(
        base[0] - wide, max(base[1] - width, -90), base[0] + wide, min(base[1] + width, 90)
    )
    parts = []
    for turn in TURNS:
        turned = shapely.transform(box, lambda xy, turn=turn: xy + np.array([turn, 0.0]))
        near = shapely.intersects(shapely.box(*shapely.bounds(land.polygons).T), turned)
        parts.append(shapely.intersection(land.polygons[near], turned))
    pieces = shapely.get_parts(shapely.get_parts(np.concatenate(parts)))
    pieces = pieces[(shapely.get_type_id(pieces) == 3) & ~shapely.is_empty(pieces)]
    if not pieces.size:
        return []
    plane = shapely.transform(pieces, lambda xy: _to_gnomonic(base, xy))
    # join what the antimeridian cuts
    plane = shapely.get_parts(shapely.union_all(shapely.make_valid(plane)))
    simple = shapely.make_valid(shapely.simplify(plane, DETAIL * reach, preserve_topology=True))
    single = shapely.get_parts(simple)
    return [piece for piece in single if piece.geom_type == "Polygon" and piece.area > 0]


def _to_gnomonic(base: LonLat, places: Array) -> Array:
    """Return places [deg], (n, 2), in the gnomonic plane of a base [m]."""
    centre = np.radians(base)
    east, north = sphere.offset(centre[0], centre[1], *np.radians(places).T)
    arc = np.hypot(east, north) / sphere.RADIUS
    scale = np.where(arc > 1e-9, np.tan(np.minimum(arc, 1.5)) / np.maximum(arc, 1e-9), 1.0)
    return np.asarray(np.stack([east * scale, north * scale], axis=1))


def _length_on_earth(points: Array) -> float:
    """Return the length [m] on the Earth of a polyline in the gnomonic plane."""
    ray = np.column_stack([points / sphere.RADIUS, np.ones(len(points))])
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    chord = np.linalg.norm(np.diff(ray, axis=0), axis=1)
    return float(sphere.RADIUS * np.sum(2 * np.arcsin(np.minimum(chord / 2, 1.0))))


class _Mesh:
    """A polygon in triangles, their shared sides, and the distances between midpoints of these."""

    def __init__(self, polygon: shapely.Polygon) -> None:
        # small triangles, so that chains of midpoints find the shorter way around a lake
        if len(polygon.interiors):
            polygon = shapely.segmentize(polygon, polygon.length / LINKS)
        triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
        clockwise = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) < 0
        corners[clockwise] = corners[clockwise, ::-1]
        self._tree = shapely.STRtree(triangles)
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 2)
        _, point = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
        _, side = np.unique(np.sort(point.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
        order = np.argsort(side.reshape(-1), kind="stable")
        same = np.flatnonzero(np.diff(side.reshape(-1)[order]) == 0)
        one, other = order[same], order[same + 1]
        # For each shared side: its ends, right and left as seen when leaving its first triangle;
        # and both triangles.
        self._gate = ends[one]
        self._between = np.stack([one // 3, other // 3], axis=1)
        self._middle = self._gate.mean(axis=1)
        self._of_triangle: list[list[int]] = [[] for _ in triangles]
        for gate, pair in enumerate(self._between):
            for triangle in pair:
                self._of_triangle[triangle].append(gate)
        links = [pair for gates in self._of_triangle for pair in itertools.combinations(gates, 2)]
        i, j = np.array(links, np.int64).reshape(-1, 2).T
        apart = np.linalg.norm(self._middle[i] - self._middle[j], axis=1) + 1e-6
        self._links = (apart, i, j)

    def lengths(self, begin: Array, ends: Array) -> list[float]:
        """Return the lengths [m] of the shortest paths from a point to others; inf for none."""
        if not len(ends):
            return []
        first = int(self._tree.nearest(shapely.Point(begin)))
        last = self._tree.nearest(shapely.points(ends))
        away, before = self._distances_to_midpoints(begin, self._of_triangle[first])
        found = []
        for end, triangle in zip(ends, last, strict=True):
            if triangle == first:
                found.append(_length_on_earth(np.array([begin, end])))
                continue
            gates = [gate for gate in self._of_triangle[triangle] if np.isfinite(away[gate])]
            ways = [
                self._shortest_line(begin, end, self._sleeve(first, gate, before)) for gate in gates
            ]
            found.append(min((_length_on_earth(way) for way in ways), default=np.inf))
        return found

    def _distances_to_midpoints(self, begin: Array, gates: list[int]) -> tuple[Array, Array]:
        """Return distances from a point to the midpoints of shared sides, and predecessors.

        The predecessor of a side is the side before it on the path, -1 for none.
        """
        apart, i, j = self._links
        count = len(self._gate)
        out = np.linalg.norm(self._middle[gates] - begin, axis=1) + 1e-6
        row, column = np.concatenate([i, np.full(len(gates), count)]), np.concatenate([j, gates])
        graph = sparse.coo_array(
            (np.concatenate([apart, out]), (row, column)), (count + 1, count + 1)
        ).tocsr()
        away, before = csgraph.dijkstra(
            graph, directed=False, indices=count, return_predecessors=True
        )
        return away[:count], np.where(before[:count] == count, -1, before[:count])

    def _sleeve(self, first: int, gate: int, before: Array) -> list[tuple[Array, Array]]:
        """Return the right and left ends of the shared sides from a triangle to a side."""
        chain = [gate]
        while before[chain[-1]] >= 0:
            chain.append(int(before[chain[-1]]))
        passed, here = [], first
        for number in reversed(chain):
            a, b = self._between[number]
            right, left = self._gate[number]
            passed.append((right, left) if here == a else (left, right))
            here = b if here == a else a
        return passed

    @staticmethod
    def _shortest_line(begin: Array, end: Array, gates: Sequence[tuple[Array, Array]]) -> Array:
        """Return the corners of the shortest line between two points through gates in order."""
        right, left = [*(gate[0] for gate in gates), end], [*(gate[1] for gate in gates), end]
        # tight: the gates whose right and left end bound the funnel
        line, apex, tight = [begin], begin, [0, 0]
        bound, k = [begin, begin], 0
        while k < len(right):
            for side, ends, sign in ((0, right, 1.0), (1, left, -1.0)):
                new = ends[k]
                if sign * _signed_area(apex, bound[side], new) < 0:
                    continue  # the point would widen the funnel
                if (bound[side] == apex).all() or sign * _signed_area(
                    apex, bound[1 - side], new
                ) < 0:
                    bound[side], tight[side] = new, k
                    continue
                # the point crosses over: the other side's end is a corner of the line
                apex = bound[1 - side]
                line.append(apex)
                k = tight[1 - side]
                bound, tight = [apex, apex], [k, k]
                break
            k += 1
        line.append(end)
        return np.array(line)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _signed_area(a: Array, b: Array, c: Array) -> float:
    """Return twice the area of a triangle, positive if its corners run anticlockwise."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
