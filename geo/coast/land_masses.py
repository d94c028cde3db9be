"""Land masses: which polygons of a coast belong together, and which land mass a place lies on.

Polygons that touch form one land mass, and so do polygons that a user's bridges connect. Two parts
of one mainland that the edge of the box separates are two land masses, unless `of_whole` gets
polygons of the whole Earth that contain both.

Distances for finding the nearest polygon are in degrees, with longitudes scaled by the cosine of
the middle latitude. For a place on land the result is exact, because it lies in a polygon.
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

SEVERAL = -1  # number for stretches that lie on several land masses
MOST = 0.9  # share of its length with which a stretch lies on one land mass
ABUTMENT = 1_000.0  # [m] largest distance of the end of a bridge from land

Ints = npt.NDArray[np.int64]
LonLat = tuple[float, float]


@dataclass(frozen=True)
class LandMasses:
    """The polygons of a coast, and the land mass of each."""

    polygons: Array  # shapely polygons [deg], unwrapped
    mass: Ints  # (n,) number of the land mass of each polygon
    bridges: tuple[tuple[LonLat, LonLat], ...] = ()  # ends [deg] of connections between polygons
    box: Box | None = None  # box to which the polygons are cut; None: they are complete
    squeeze: float = 1.0  # scale of longitudes for finding the nearest polygon
    middle: float = 0.0  # [deg] longitude about which longitudes are unwrapped

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Search tree of the polygons in the scaled plane."""
        return shapely.STRtree(_scale_longitudes(self.polygons, self.squeeze))

    @cached_property
    def sides(self) -> tuple[shapely.STRtree, Ints]:
        """Search tree of the sides of all polygons in the scaled plane, and the polygon of each.

        Searching among sides is fast; searching among polygons walks around a whole mainland each
        time. Polygons do not overlap, so a place on land is nearest to a side of its own polygon.
        """
        rings, owner = shapely.get_rings(self.tree.geometries, return_index=True)
        corners, ring = shapely.get_coordinates(rings, return_index=True)
        joined = ring[1:] == ring[:-1]
        lines = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1)[joined])
        return shapely.STRtree(lines), np.asarray(owner[ring[:-1][joined]], np.int64)


def build_land_masses(
    polygons: Array, bridges: Sequence[tuple[LonLat, LonLat]] = (), box: Box | None = None
) -> LandMasses:
    """Return the land masses of polygons.

    Args:
        polygons: land polygons [deg].
        bridges: pairs of positions [deg], each on or near land, which a bridge, dam or ford
            connects.
        box: to which the polygons are cut; None if they are complete.

    Raises:
        UserError: a bridge ends far from land.
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
    pairs = [_touching_pairs(land)]
    if bridges:
        ends = [
            [_abutment_polygon(land, end, number) for end in ends]
            for number, ends in enumerate(bridges, 1)
        ]
        pairs.append(np.array(ends).T)
    return replace(land, mass=_connected_groups(len(polygons), np.concatenate(pairs, axis=1)))


def _touching_pairs(land: LandMasses) -> Array:
    """Return the pairs (2, m) of polygons that touch."""
    shapes = land.tree.geometries
    one, other = land.tree.query(shapes)
    order = shapely.get_num_coordinates(shapes)
    larger = (order[one] > order[other]) | ((order[one] == order[other]) & (one < other))
    one, other = one[larger], other[larger]
    shapely.prepare(shapes)  # pairs are ordered larger first: a mainland has many islands near it
    return np.asarray(np.stack([one, other])[:, shapely.intersects(shapes[one], shapes[other])])


def _abutment_polygon(land: LandMasses, end: LonLat, number: int) -> int:
    """Return the polygon on which a bridge ends; raise UserError if no land is near."""
    polygon, lon, lat, away = nearest_land(land, *end)
    if away > ABUTMENT:
        raise UserError(
            f"spill.bridges, number {number}: its end at {notation.position(*end)} lies {away / 1000:.1f} km from the "
            f"nearest land, at {notation.position(lon, lat)}; at most {ABUTMENT / 1000:g} km is allowed; move it, or leave it out if it lies beyond the domain"
        )
    return polygon


def _connected_groups(count: int, pairs: Array) -> Ints:
    """Return the group number of each of `count` items, given pairs (2, m) in the same group."""
    links = sparse.coo_array((np.ones(pairs.shape[1]), (pairs[0], pairs[1])), (count, count))
    return np.asarray(csgraph.connected_components(links, directed=False)[1], np.int64)


def nearest_land(land: LandMasses, lon: float, lat: float) -> tuple[int, float, float, float]:
    """Return (polygon, lon [deg], lat [deg], distance [m]) of the land nearest to a place.

    On land it is the place itself. There must be land.
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


def mass_of_places(land: LandMasses, lon: Array, lat: Array) -> Ints:
    """Return the land mass nearest to each place [deg], shape (n,)."""
    lon = land.middle + sphere.wrap_degrees(np.asarray(lon) - land.middle)
    tree, polygon = land.sides
    return np.asarray(
        land.mass[polygon[tree.nearest(shapely.points(lon * land.squeeze, lat))]], np.int64
    )


def mass_of_stretches(land: LandMasses, coast: Coast, of_edge: Array, count: int) -> Ints:
    """Return the land mass of each stretch of coast, shape (count,).

    It is SEVERAL if no land mass has at least the share MOST of the stretch's length.

    Args:
        land: the land masses.
        coast: whose edges form the stretches.
        of_edge: stretch of every shoreline edge, shape (edges,).
        count: number of stretches.
    """
    edge = shoreline.shoreline_edges(coast)
    if not len(edge):
        return np.empty(0, np.int64)
    a, b = np.radians(edge * (360.0 / sphere.TURN)).reshape(-1, 2, 2).swapaxes(0, 1)
    length = sphere.distance(*a.T, *b.T)
    mass = _mass_of_edges(land, edge)
    at = np.stack([of_edge, mass], axis=1)
    pairs, row = np.unique(at, axis=0, return_inverse=True)
    length_on_mass = np.bincount(row.reshape(-1), length, len(pairs))
    total_length = np.bincount(of_edge, length, count)
    order = np.lexsort((-length_on_mass, pairs[:, 0]))
    first = order[np.unique(pairs[order, 0], return_index=True)[1]]
    found = np.full(count, SEVERAL, np.int64)
    stretch = pairs[first, 0]
    found[stretch] = np.where(
        length_on_mass[first] >= MOST * total_length[stretch], pairs[first, 1], SEVERAL
    )
    return found


def _mass_of_edges(land: LandMasses, edge: Array) -> Ints:
    """Return the land mass of each shoreline edge; consecutive edges are of the same polygon."""
    begins = np.ones(len(edge), bool)
    begins[1:] = (edge[1:, :2] != edge[:-1, 2:]).any(axis=1)
    first = edge[begins].astype(np.int64)
    # longitude differences along the shorter arc
    half = (first[:, 2:] - first[:, :2]).astype(np.int32).astype(np.int64) // 2
    middle = (first[:, :2] + half) * (360.0 / sphere.TURN)
    of_run = mass_of_places(land, middle[:, 0], middle[:, 1])
    return np.asarray(of_run[np.cumsum(begins) - 1])


def masses_at_edge(land: LandMasses) -> frozenset[int]:
    """Return the land masses that reach the edge of their box and may continue beyond it."""
    return frozenset(land.mass[_polygons_at_edge(land)].tolist())


def _polygons_at_edge(land: LandMasses) -> Ints:
    """Return the polygons that reach the edge of the box."""
    if land.box is None or land.box.east - land.box.west >= 360:
        return np.empty(0, np.int64)
    west, south, east, north = shapely.bounds(land.polygons).T
    box = land.box
    return np.flatnonzero(
        (west <= box.west) | (south <= box.south) | (east >= box.east) | (north >= box.north)
    )


def of_whole(land: LandMasses, whole: Callable[[], Array]) -> LandMasses:
    """Return the land masses with those merged that are connected beyond the edge of the box.

    whole: returns the polygons [deg] of the whole source; it is called only if two land masses
    reach the edge.
    """
    cut = _polygons_at_edge(land)
    if len(np.unique(land.mass[cut])) < 2:
        return land
    entire = np.asarray(whole())
    across, tree = (
        _connected_groups(len(entire), _antimeridian_pairs(entire)),
        shapely.STRtree(entire),
    )
    points = shapely.transform(
        shapely.point_on_surface(land.polygons[cut]),
        lambda xy: np.stack([sphere.wrap_degrees(xy[:, 0]), xy[:, 1]], axis=1),
    )
    found = []
    for turn in (-360.0, 0.0, 360.0):  # longitudes of a file may run from 0 to 360
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
    joined = _connected_groups(2 * count + len(entire), pairs)[:count]
    return replace(land, mass=joined)


def _antimeridian_pairs(polygons: Array) -> Array:
    """Return the pairs (2, m) of polygons that continue each other across the antimeridian."""
    west, _, east, _ = shapely.bounds(polygons).T
    left, right = np.flatnonzero(west <= -180 + 1e-6), np.flatnonzero(east >= 180 - 1e-6)
    pairs = [np.empty((2, 0), np.int64)]
    turned = shapely.transform(polygons[left], lambda xy: xy + np.array([360.0, 0.0]))
    for k, shape in zip(left, turned, strict=True):
        touched = right[shapely.intersects(polygons[right], shape)]
        pairs.append(np.stack([np.full(len(touched), k), touched]))
    return np.concatenate(pairs, axis=1)


def _scale_longitudes(polygons: Array, squeeze: float) -> Array:
    return np.asarray(shapely.transform(polygons, lambda xy: xy * [squeeze, 1.0]))
