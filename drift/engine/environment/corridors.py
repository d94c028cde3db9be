"""Checks that lane corridors and loitering areas do not touch land.

The corridor of a lane is the area that particles on any side of it can reach. It lies between the
lines across it at its two nodes, which depend on the lanes before and after it
(drift.engine.motion.steering.lanes). The check covers every lane that may come before and after,
and U-turns that a route makes. Each combination is a quadrilateral of great circles. In the
gnomonic projection about the lane's middle its sides are straight; there it is tested against every
edge of the full coast. The antimeridian and the poles therefore need no special cases.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from drift.engine.motion.steering import lanes
from drift.engine.motion.steering.lanes import Network, Route
from geo import polyline, sphere
from geo.array import Array
from geo.coast import edges as shoreline
from geo.coast.edges import Coast
from geo.errors import UserError
from geo.notation import NMI

# Shoreline edges are straight in longitude and latitude, and at most 2.4 km: a great circle leaves
# them by less than this up to 85 degrees of latitude. Positions of particles are stored to 9 mm.
CLEAR = 10.0  # [m] that must lie between a corridor and the coast
HALF_EDGE = shoreline.LONGEST_EDGE * sphere.UNIT  # [rad] more than from an edge's middle to its end
# In strips of latitude from west to east, edges that follow each other are near each other: most
# such blocks are far from a lane.
BLOCK = 256
STRIP = np.radians(0.25)


@dataclass(frozen=True)
class Shore:
    """A coast with its edges on the unit sphere, in blocks of BLOCK edges with bounding balls."""

    coast: Coast
    ends: Array  # (m, 2, 3)
    middle: Array  # (m, 3) about halfway between the ends
    centre: Array  # (b, 3)
    reach: Array  # (b,) radius of the ball about `centre` that holds all middles of a block

    @classmethod
    def of(cls, coast: Coast) -> "Shore":
        """Return the edges of a coast in blocks."""
        lon, lat = (
            shoreline.shoreline_edges(coast)[:, k::2] * sphere.UNIT for k in (0, 1)
        )  # [rad] (m, 2)
        order = np.lexsort((lon[:, 0], np.floor(lat[:, 0] / STRIP)))
        ends = _vectors(lon[order], lat[order])
        middle = ends.mean(axis=1)
        begin = np.arange(0, len(middle), BLOCK)
        if not begin.size:
            return cls(coast, ends, middle, middle, np.empty(0))
        count = np.diff(np.append(begin, len(middle)))
        centre = np.add.reduceat(middle, begin) / count[:, None]
        away = np.linalg.norm(middle - np.repeat(centre, count, axis=0), axis=1)
        return cls(coast, ends, middle, centre, np.maximum.reduceat(away, begin))


def refuse_lanes(network: Network, coast: Coast, routes: Sequence[Route] = ()) -> None:
    """Raise UserError, with a line for each lane, if the corridors of lanes touch land.

    Args:
        network: of the lanes.
        coast: in full detail.
        routes: of the case; they matter if they turn back on a lane.

    Raises:
        UserError: if a corridor touches land.
        ValueError: if the coast does not cover the network.
    """
    wrong = []
    for lane, width, where in touching(network, Shore.of(coast), routes):
        a, b = (network.name[int(node[lane])] for node in (network.start, network.end))
        wrong.append(
            f'lane "{a} - {b}": its corridor, {width} wide, touches land {where}; make it narrower or move a node'
        )
    if wrong:
        raise UserError(*wrong)


def touching(
    network: Network, shore: Shore, routes: Sequence[Route] = ()
) -> Iterator[tuple[int, str, str]]:
    """Yield the number of each lane whose corridor touches land, its width and the place, as text.

    Raises ValueError where the coast does not cover the network.
    """
    coast = shore.coast
    for lane, corners in swept(network, routes).items():
        _check_covered(coast, np.concatenate([corners.reshape(-1, 2), _halfway(corners)]))
        a, b = (int(node[lane]) for node in (network.start, network.end))
        touched = _first_contact(network.lon[[a, b]], network.lat[[a, b]], corners, shore)
        if touched is None and not shoreline.is_land(
            coast, *_binary(network.lon[a], network.lat[a])
        ):
            continue
        lon, lat, away = touched or (float(network.lon[a]), float(network.lat[a]), 0.0)
        where = f"near [{np.degrees(sphere.wrap(lon)):.3f}, {np.degrees(lat):.3f}]"
        off = f"{away / NMI:.2g} nmi off its middle" if away > CLEAR else "on its middle"
        yield lane, _width(network, lane, corners), f"{where}, {off}"


def refuse_area(place: str, ring: Sequence[tuple[float, float]], coast: Coast) -> None:
    """Raise UserError if an area touches land.

    Args:
        place: name of the area in messages.
        ring: corners (lon, lat) [deg] in order; edges are straight in longitude and latitude.
        coast: in full detail.
    """
    lon = polyline.unwrap([corner[0] for corner in ring])
    area = shapely.Polygon(np.column_stack([lon, [corner[1] for corner in ring]]))
    _check_covered(coast, np.radians(shapely.get_coordinates(area)))
    shapely.prepare(area)
    units = shoreline.shoreline_edges(coast)
    degrees = sphere.to_degrees(units).reshape(-1, 2, 2)
    degrees[:, 0, 0] = sphere.near_degrees(degrees[:, 0, 0], (lon.min() + lon.max()) / 2)
    degrees[:, 1, 0] = sphere.near_degrees(degrees[:, 1, 0], degrees[:, 0, 0])
    west, south, east, north = area.bounds
    low, high = degrees.min(axis=1), degrees.max(axis=1)
    near = (low[:, 0] <= east) & (high[:, 0] >= west) & (low[:, 1] <= north) & (high[:, 1] >= south)
    lines = shapely.linestrings(degrees[near])
    touched = lines[shapely.intersects(area, lines)]
    if touched.size:
        # The message names the land deepest inside: an islet in the middle is easily missed.
        worst = touched[np.argmax(shapely.distance(area.exterior, touched))]
        inside = shapely.intersection(area, worst).centroid
        at = (float(sphere.wrap_degrees(inside.x)), float(inside.y))
    elif shoreline.is_land(coast, *_binary(*np.radians(ring[0]))).any():
        at = ring[0]
    else:
        return
    raise UserError(
        f"{place}: touches land near [{at[0]:.3f}, {at[1]:.3f}]; move its corners into the water"
    )


def swept(network: Network, routes: Sequence[Route] = ()) -> dict[int, Array]:
    """Return the corridor of each lane by its number: corners (lon, lat) [rad] of quadrilaterals,
    (q, 4, 2).

    Each lies between the lines across the lane at its nodes, for every lane that may come before
    and after, or none, and for the legs of routes. Corners: side -1 and 1 at one node, side 1 and
    -1 at the other.
    """
    quads: dict[int, list[Array]] = {lane: [] for lane in range(network.start.size)}
    begins, ends = _lines_across(network)
    for way, lane in enumerate(lanes.lane_directions(network)[2]):
        quads[int(lane)] += [np.concatenate([a, b[::-1]]) for a in begins[way] for b in ends[way]]
    for route in routes:
        lon, lat = lanes.displaced(route, [-1.0, 1.0])
        node = [lanes.number(network, name) for name in route.node]
        for j in range(len(node) - 1):
            a, b = (np.column_stack([lon[:, k], lat[:, k]]) for k in (j, j + 1))
            quads[lanes.between(network, node[j], node[j + 1])].append(np.concatenate([a, b[::-1]]))
    return {lane: np.array(found) for lane, found in quads.items()}


def _lines_across(network: Network) -> tuple[list[list[Array]], list[list[Array]]]:
    """Return the lines across the corridor at the begin and at the end of each way in
    `lanes.directed`.

    A line is given by its ends (lon, lat) [rad] on side -1 and 1, shape (2, 2).
    """
    start, end, lane = lanes.lane_directions(network)
    half = network.width[lane] / 2
    places = [(network.lon[node], network.lat[node]) for node in (start, end)]
    ahead, behind = (
        lanes.bearing(*places[0], *places[1]),
        lanes.bearing(*places[1], *places[0]) + np.pi,
    )
    p, w = np.nonzero((end[:, None] == start) & (start[:, None] != end))  # way w may follow way p
    joint = _lines(network, start[w], behind[p], ahead[w], half[p], half[w])
    first = _lines(network, start, ahead, ahead, half, half)
    last = _lines(network, end, behind, behind, half, half)
    ways = range(start.size)
    return [[first[k], *joint[w == k]] for k in ways], [[last[k], *joint[p == k]] for k in ways]


def _lines(
    network: Network, node: Array, arriving: Array, leaving: Array, before: Array, after: Array
) -> Array:
    """Return lines across the corridor at nodes, (c, 2, 2), as defined by `lanes.across`."""
    half, toward = lanes.line_across_corridor(arriving, leaving, before, after)
    away = half * np.array([[-1.0], [1.0]])
    ends = sphere.destination(
        network.lon[node], network.lat[node], away * np.sin(toward), away * np.cos(toward)
    )
    return np.stack(ends, axis=-1).swapaxes(0, 1)


def _width(network: Network, lane: int, corners: Array) -> str:
    """Return a corridor's width as text: of the lane, and at its nodes if it is much wider
    there.
    """
    lon, lat = corners[..., 0], corners[..., 1]
    most = max(
        float(sphere.distance(lon[:, k], lat[:, k], lon[:, k + 1], lat[:, k + 1]).max())
        for k in (0, 2)
    )
    text = f"{network.width[lane] / NMI:.3g} nmi"
    return (
        f"{text} (up to {most / NMI:.2g} nmi at its nodes)"
        if most > 1.1 * network.width[lane]
        else text
    )


def _check_covered(coast: Coast, points: Array) -> None:
    """Raise ValueError if the coast is not known around points (lon, lat) [rad], shape (..., 2)."""
    lon, lat = _binary(points[..., 0], points[..., 1])
    x, y = (lon.astype(np.int64) - coast.lon0) % sphere.TURN, lat.astype(np.int64) - coast.lat0
    if not ((x < coast.nx << coast.shift) & (y >= 0) & (y < coast.ny << coast.shift)).all():
        raise ValueError(
            "a leg or an edge leads beyond the box of its corners, in which the coast is known; give more corners"
        )


def _halfway(corners: Array) -> Array:
    """Return the points (lon, lat) [rad] halfway along corridor sides, where they are nearest to a
    pole.
    """
    x, y, z = (_vectors(*corners[:, :2].T) + _vectors(*corners[:, :1:-1].T)).reshape(-1, 3).T
    return np.column_stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])


def _binary(lon: npt.ArrayLike, lat: npt.ArrayLike) -> tuple[Array, Array]:
    """Return positions [rad] as binary angles."""
    return sphere.to_binary(np.degrees(lon)), sphere.to_binary(np.degrees(lat))


def _first_contact(
    lon: Array, lat: Array, corners: Array, shore: Shore
) -> tuple[float, float, float] | None:
    """Return the innermost contact of a corridor with the coast: lon, lat [rad], distance [m]; or
    None.

    The distance is from the centre line. lon, lat: [rad] of the lane's nodes; corners: of its
    quadrilaterals, (q, 4, 2).
    """
    line = _vectors(lon, lat)
    up = line.sum(axis=0) / np.linalg.norm(line.sum(axis=0))
    across = np.cross(line[0], line[1])
    across /= np.linalg.norm(across)
    # columns: unit vectors along the lane, across it, up
    frame = np.stack([np.cross(across, up), across, up], axis=1)
    points = _plane(_vectors(corners[..., 0], corners[..., 1]) @ frame)
    # Every path leads from a point of one line across to one of the other, so all paths lie in the
    # convex hull of the corners.
    hulls = shapely.convex_hull(shapely.multipoints(points))
    corridor = shapely.union_all(hulls).buffer(CLEAR / sphere.RADIUS)
    x0, y0, x1, y1 = corridor.bounds
    # The plane's four lines that bound the corridor are planes through the Earth's centre; these
    # are their normals.
    sides = np.array([[1, 0, -x0], [-1, 0, x1], [0, 1, -y0], [0, -1, y1]])
    sides = sides @ frame.T / np.linalg.norm(sides, axis=1)[:, None]
    blocks = np.flatnonzero(
        (shore.centre @ sides.T > -(shore.reach + HALF_EDGE)[:, None]).all(axis=1)
    )
    near = (blocks[:, None] * BLOCK + np.arange(BLOCK)).ravel()
    near = near[near < len(shore.middle)]
    near = near[(shore.middle[near] @ sides.T > -HALF_EDGE).all(axis=1)]
    lines = shapely.linestrings(_plane(shore.ends[near] @ frame))
    shapely.prepare(corridor)
    lines = lines[shapely.intersects(corridor, lines)]
    if not lines.size:
        return None
    middle = shapely.LineString(_plane(line @ frame))
    a, b = shapely.shortest_line(middle, lines[np.argmin(shapely.distance(middle, lines))]).coords
    x, y, z = frame @ np.array([[*a, 1.0], [*b, 1.0]]).T
    (_, lon), (_, lat) = places = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    return float(lon), float(lat), float(sphere.distance(places[0][0], places[1][0], lon, lat))


def _vectors(lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
    """Return positions [rad], shape (...), as unit vectors, shape (..., 3)."""
    return np.stack(sphere.vector(lon, lat), axis=-1)


def _plane(vectors: Array) -> Array:
    """Return vectors, shape (..., 3), in the gnomonic projection about their third axis, shape
    (..., 2).
    """
    return np.asarray(vectors[..., :2] / vectors[..., 2:])
