"""Land masses: which polygons of a coast are one piece of land, and on which of them a place lies.

Polygons that touch are one land mass, and so are those that a user's bridges join. Two pieces of
one mainland that the edge of the box divides are two, unless polygons of the whole Earth are handed
in that hold both.

Nearness is computed in degrees, longitudes shrunk by the cosine of the middle latitude: it decides
which polygon of several is nearest, and for a place on land, which is in one, it is exact.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely
from scipy import sparse
from scipy.sparse import csgraph

from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.edges import Coast
from geo.errors import UserError

SEVERAL = -1  # number of the land mass of what lies on several
MOST = 0.9  # share of a stretch's length that lies on one land mass, unless it lies on several
ABUTMENT = 1_000.0  # [m] farthest that the end of a bridge may lie off its land

Ints = npt.NDArray[np.int64]
LonLat = tuple[float, float]


@dataclass(frozen=True)
class LandMasses:
    """The polygons of a coast, and the land mass of each."""

    polygons: Array  # shapely polygons [deg], unwrapped
    mass: Ints  # (n,) number of the land mass of each polygon
    bridges: tuple[tuple[LonLat, LonLat], ...] = ()  # ends [deg] of what joins polygons
    box: Box | None = None  # to which the polygons are cut; None: they are all land
    squeeze: float = 1.0  # by which longitudes are multiplied to find what is nearest
    middle: float = 0.0  # [deg] about which longitudes are unwrapped

    @cached_property
    def tree(self) -> shapely.STRtree:
        """The polygons in the squeezed plane."""
        return shapely.STRtree(_squeezed(self.polygons, self.squeeze))

    @cached_property
    def sides(self) -> tuple[shapely.STRtree, Ints]:
        """The sides of all polygons in the squeezed plane, and the polygon of each.

        What is nearest to a place is found at once among sides; among polygons each question walks
        round a mainland. A place on land is nearest to a side of the polygon that it lies in, for
        polygons do not overlap.
        """
        rings, owner = shapely.get_rings(self.tree.geometries, return_index=True)
        corners, ring = shapely.get_coordinates(rings, return_index=True)
        joined = ring[1:] == ring[:-1]
        lines = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1)[joined])
        return shapely.STRtree(lines), np.asarray(owner[ring[:-1][joined]], np.int64)


def build_land_masses(
    polygons: Array, bridges: Sequence[tuple[LonLat, LonLat]] = (), box: Box | None = None
) -> LandMasses:
    """Return the land masses of polygons [deg]; box: to which they are cut.

    bridges: pairs of positions [deg], each on or beside land, that are one land mass by a bridge,
    dam or ford. Raises UserError for a bridge that ends far from land.
    """
    if not len(polygons):
        if bridges:
            raise UserError(
                "spill.bridges: the domain has no land for a bridge to join; delete bridges"
            )
        return LandMasses(polygons, np.empty(0, np.int64), box=box)
    west, south, east, north = shapely.total_bounds(polygons)
    squeeze = max(float(np.cos(np.radians((south + north) / 2))), 0.01)
    land = LandMasses(
        polygons, np.arange(len(polygons)), tuple(bridges), box, squeeze, float((west + east) / 2)
    )
    pairs = [_touching(land)]
    if bridges:
        ends = [
            [_abutment(land, end, number) for end in ends] for number, ends in enumerate(bridges, 1)
        ]
        pairs.append(np.array(ends).T)
    return replace(land, mass=_joined(len(polygons), np.concatenate(pairs, axis=1)))


def _touching(land: LandMasses) -> Array:
    """Return the pairs (2, m) of polygons that touch."""
    shapes = land.tree.geometries
    one, other = land.tree.query(shapes)
    order = shapely.get_num_coordinates(shapes)
    larger = (order[one] > order[other]) | ((order[one] == order[other]) & (one < other))
    one, other = one[larger], other[larger]
    shapely.prepare(shapes)  # of each pair the larger one: a mainland has many islands about it
    return np.asarray(np.stack([one, other])[:, shapely.intersects(shapes[one], shapes[other])])


def _abutment(land: LandMasses, end: LonLat, number: int) -> int:
    """Return the polygon on which a bridge ends; raise UserError where there is none."""
    polygon, lon, lat, away = nearest(land, *end)
    if away > ABUTMENT:
        raise UserError(
            f"spill.bridges, number {number}: its end at {notation.position(*end)} lies {away / 1000:.1f} km from the "
            f"nearest land, at {notation.position(lon, lat)}; at most {ABUTMENT / 1000:g} km is allowed; move it, or leave it out if it lies beyond the domain"
        )
    return polygon


def _joined(count: int, pairs: Array) -> Ints:
    """Return the number of the group of each of some things of which pairs (2, m) belong together."""
    links = sparse.coo_array((np.ones(pairs.shape[1]), (pairs[0], pairs[1])), (count, count))
    return np.asarray(csgraph.connected_components(links, directed=False)[1], np.int64)


def nearest(land: LandMasses, lon: float, lat: float) -> tuple[int, float, float, float]:
    """Return (polygon, lon [deg], lat [deg], distance [m]) of the land nearest to a place; on land
    it is the place itself.

    There must be land.
    """
    lon = land.middle + float(sphere.wrap_degrees(lon - land.middle))
    point = shapely.Point(lon * land.squeeze, lat)
    polygon = int(land.tree.nearest(point))
    shape = land.tree.geometries[polygon]
    if shapely.intersects(shape, point):
        return polygon, lon, lat, 0.0
    x, y = shapely.get_coordinates(shapely.shortest_line(shape, point))[0]
    away = sphere.distance(*np.radians([lon, lat, x / land.squeeze, y]))
    return polygon, float(x / land.squeeze), float(y), float(away)


def of_places(land: LandMasses, lon: Array, lat: Array) -> Ints:
    """Return the land mass that each place [deg] lies on, or that is nearest to it, shape (n,)."""
    lon = land.middle + sphere.wrap_degrees(np.asarray(lon) - land.middle)
    tree, polygon = land.sides
    return np.asarray(
        land.mass[polygon[tree.nearest(shapely.points(lon * land.squeeze, lat))]], np.int64
    )


def of_stretches(land: LandMasses, coast: Coast, of_edge: Array, count: int) -> Ints:
    """Return the land mass of each of some stretches, SEVERAL where none has MOST of its length,
    shape (count,).

    of_edge: (edges,) the stretch of every shoreline edge.
    """
    edge = shoreline.edges(coast)
    if not len(edge):
        return np.empty(0, np.int64)
    a, b = np.radians(edge * (360.0 / sphere.TURN)).reshape(-1, 2, 2).swapaxes(0, 1)
    length = sphere.distance(*a.T, *b.T)
    mass = _of_edges(land, edge)
    at = np.stack([of_edge, mass], axis=1)
    pairs, row = np.unique(at, axis=0, return_inverse=True)
    held = np.bincount(row.reshape(-1), length, len(pairs))
    whole = np.bincount(of_edge, length, count)
    order = np.lexsort((-held, pairs[:, 0]))
    first = order[np.unique(pairs[order, 0], return_index=True)[1]]
    found = np.full(count, SEVERAL, np.int64)
    stretch = pairs[first, 0]
    found[stretch] = np.where(held[first] >= MOST * whole[stretch], pairs[first, 1], SEVERAL)
    return found


def _of_edges(land: LandMasses, edge: Array) -> Ints:
    """Return the land mass of each shoreline edge: edges that follow one another are of one
    polygon.
    """
    begins = np.ones(len(edge), bool)
    begins[1:] = (edge[1:, :2] != edge[:-1, 2:]).any(axis=1)
    first = edge[begins].astype(np.int64)
    # longitudes the short way round
    half = (first[:, 2:] - first[:, :2]).astype(np.int32).astype(np.int64) // 2
    middle = (first[:, :2] + half) * (360.0 / sphere.TURN)
    of_run = of_places(land, middle[:, 0], middle[:, 1])
    return np.asarray(of_run[np.cumsum(begins) - 1])


def reaching_the_edge(land: LandMasses) -> frozenset[int]:
    """Return the land masses that reach the edge of the box to which they are cut, beyond which
    they may go on.
    """
    return frozenset(land.mass[_at_the_edge(land)].tolist())


def _at_the_edge(land: LandMasses) -> Ints:
    """Return the polygons that reach the edge of the box."""
    if land.box is None or land.box.east - land.box.west >= 360:
        return np.empty(0, np.int64)
    west, south, east, north = shapely.bounds(land.polygons).T
    box = land.box
    return np.flatnonzero(
        (west <= box.west) | (south <= box.south) | (east >= box.east) | (north >= box.north)
    )


def of_whole(land: LandMasses, whole: Callable[[], Array]) -> LandMasses:
    """Return the land masses with those joined that are one beyond the edge of the box.

    whole: returns the polygons [deg] of the
    whole source; it is asked only where two land masses reach the edge.
    """
    cut = _at_the_edge(land)
    if len(np.unique(land.mass[cut])) < 2:
        return land
    entire = np.asarray(whole())
    across, tree = _joined(len(entire), _across(entire)), shapely.STRtree(entire)
    points = shapely.transform(
        shapely.point_on_surface(land.polygons[cut]),
        lambda xy: np.stack([sphere.wrap_degrees(xy[:, 0]), xy[:, 1]], axis=1),
    )
    found = []
    for turn in (-360.0, 0.0, 360.0):  # a file may count longitudes from 0 to 360
        at = shapely.transform(points, lambda xy, turn=turn: xy + np.array([turn, 0.0]))
        found.append(tree.query(at, predicate="intersects"))
    piece, owner = np.concatenate(found, axis=1)
    count = len(land.polygons)
    pairs = np.concatenate(
        [
            np.stack([np.arange(count), count + land.mass]),
            np.stack([cut[piece], 2 * count + across[owner]]),
        ],
        axis=1,
    )
    joined = _joined(2 * count + len(entire), pairs)[:count]
    return replace(land, mass=joined)


def _across(polygons: Array) -> Array:
    """Return the pairs (2, m) of polygons that are one across the antimeridian, at which a source
    may cut land.
    """
    west, _, east, _ = shapely.bounds(polygons).T
    left, right = np.flatnonzero(west <= -180 + 1e-6), np.flatnonzero(east >= 180 - 1e-6)
    pairs = [np.empty((2, 0), np.int64)]
    turned = shapely.transform(polygons[left], lambda xy: xy + np.array([360.0, 0.0]))
    for k, shape in zip(left, turned, strict=True):
        touched = right[shapely.intersects(polygons[right], shape)]
        pairs.append(np.stack([np.full(len(touched), k), touched]))
    return np.concatenate(pairs, axis=1)


def _squeezed(polygons: Array, squeeze: float) -> Array:
    return np.asarray(shapely.transform(polygons, lambda xy: xy * [squeeze, 1.0]))
