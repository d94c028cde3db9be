"""Distances of drifters from the shore of a case, where its particles come ashore.

A drifter that lies still for hours has run aground, or it was moored, caught in fishing gear or
taken aboard. Only the first is drift. They are distinguished by the distance from the case's shore.
"""

import numpy as np
import numpy.typing as npt
from scipy import spatial

from drift.engine.environment.environment_spec import Coast
from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.coast import edges, shore

# [m] near the shore: shorelines err by hundreds of metres, and tidal flats are kilometres wide
NEAR = 5000.0
# [m] from the shore: a drifter still here for some hours is aground, not in slack water
BESIDE = 1000.0
TILE = 10  # [deg] width of the tiles in which land is read
# points on each edge; edges are at most 2.4 km long, so a distance of 1 km errs by 5 % at most
PARTS = 4
METRES = np.radians(1.0) * sphere.RADIUS  # [m] of a degree of latitude


def distance_from_shore(
    coast: Coast, lon: npt.ArrayLike, lat: npt.ArrayLike, farthest: float
) -> Array:
    """Return the distance of places [deg], (n,), from a case's shore [m], (n,).

    It is 0 on land, and inf beyond `farthest` [m], or if the case has no coast.

    Raises:
        UserError: the shoreline cannot be read.
    """
    lon, lat = (np.atleast_1d(np.asarray(values, np.float64)) for values in (lon, lat))
    distance = np.full(lon.size, np.inf)
    if coast.source == "none":
        return distance
    corner = np.floor(np.stack([sphere.wrap_degrees(lon), lat]) / TILE).astype(int) * TILE
    corner[1] = np.minimum(corner[1], 90 - TILE)  # the pole belongs to the tile below it
    for west, south in np.unique(corner, axis=1).T.tolist():
        inside = np.flatnonzero((corner[0] == west) & (corner[1] == south))
        distance[inside] = _off_in_tile(coast, west, south, lon[inside], lat[inside], farthest)
    return distance


def _off_in_tile(
    coast: Coast, west: int, south: int, lon: Array, lat: Array, farthest: float
) -> Array:
    """Return the distance from the shore of places in a tile, given by its south-west corner [deg].

    See `off_shore`.
    """
    tile = Box(float(west), float(south), float(west + TILE), float(min(south + TILE, 90)))
    margin = farthest / METRES
    highest = min(float(np.abs(lat).max()), 85.0)
    box = tile.grown(margin / float(np.cos(np.radians(highest))), margin)
    land = shore.read_land(coast.source, box, coast.lakes)
    if not land.polygons.size:
        return np.full(lon.size, np.inf)
    lines = edges.build_coast(land, box)
    tree = spatial.KDTree(_along(edges.shoreline_edges(lines)))
    places = np.stack(sphere.vector(np.radians(lon), np.radians(lat)), axis=1)
    chord, _ = tree.query(places, distance_upper_bound=farthest / sphere.RADIUS)
    distance = chord * sphere.RADIUS
    distance[edges.is_land(lines, sphere.to_binary(lon), sphere.to_binary(lat))] = 0.0
    return np.asarray(distance)


def _along(edge: Array) -> Array:
    """Return points on edges (m, 4) [binary angles] as unit vectors, (PARTS m, 3)."""
    a, b = sphere.to_degrees(edge[:, :2]), sphere.to_degrees(edge[:, 2:])
    b[:, 0] = sphere.near_degrees(b[:, 0], a[:, 0])
    share = (np.arange(PARTS) / PARTS)[:, None, None]
    points = np.radians(a + share * (b - a)).reshape(-1, 2)
    return np.stack(sphere.vector(points[:, 0], points[:, 1]), axis=1)


def near_shore(coast: Coast, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
    """Return which places [deg], (n,), lie on a case's land or within NEAR of its shore.

    Raises:
        UserError: the shoreline cannot be read.
    """
    return distance_from_shore(coast, lon, lat, NEAR) <= NEAR
