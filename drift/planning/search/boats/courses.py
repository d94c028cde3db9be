"""Ways of a boat by sea: out of harbour, to its search, round land across its legs, and home.

A boat keeps its distance from the shore and from water that is too shallow, except in harbour. From
a base too near to land it takes the shortest way to the sea where it can keep its distance. From a
base on land it starts at the nearest water within HARBOUR. Aircraft fly straight and do not use
this module.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from drift.evidence.filter.records import Unit
from drift.planning.search.boats import seas
from drift.planning.search.boats.seas import Sea
from drift.planning.search.planning_tracks import Plane
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.polyline import LonLat

HARBOUR = 1852.0  # [m] largest distance from a boat's base to the water where it starts
# margin of the region over the longest straight way: its ellipse of ways half as long again fits
ROOM = 0.56
LEAST_ROOM = 5_000.0  # [m] smallest margin of the region
SCRAP = 100.0  # [m] shortest piece of a leg that is searched
# longest way to the next piece: FAR_ROUND times the straight distance plus ROUND_MORE
FAR_ROUND = 3.0
ROUND_MORE = 4_000.0  # [m]
SEAM = 0.01  # [m] width of gaps that rounding may leave between tiles of the barrier
SAMPLES = 7  # along each side of a rectangle, to estimate how much of it is sea


@dataclass(frozen=True)
class Harbour:
    """A boat's port, with the distances of all nodes from it.

    approach: way from the first point in the water to where the boat can keep its distance; at
    least that one point.
    """

    place: LonLat
    approach: Array  # (k, 2) [m]
    ashore: float  # [m] from the place to the first point of the approach
    # [m] length of the approach, on which the boat does not keep its distance or depth
    close: float
    far: Array  # (nodes,) [m] from the place
    before: Array  # (nodes,) predecessor of each node on the way from the place
    filled: Array  # (ny, nx) [m] the same distances, extrapolated to nodes on land


@dataclass(frozen=True)
class Course:
    """The sea of a boat and its harbours."""

    sea: Sea
    out: Harbour
    home: Harbour
    box: Box  # of its region

    def arrival(self, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
        """Return the length [m] of the way from the base to positions [rad].

        For a position on land the way leads to the nearest water, then straight on.
        """
        x, y = self.sea.plane.flat(lon, lat)
        points = np.column_stack([np.ravel(x), np.ravel(y)])
        return seas.sampled(self.sea, self.out.filled, points).reshape(np.shape(x))

    def share(self, lon: Array, lat: Array) -> Array:
        """Return the share of positions [rad], (c, n), that the boat can reach by sea, (c,)."""
        x, y = self.sea.plane.flat(lon, lat)
        ny, nx = self.sea.open.shape
        column, row = (
            np.rint((v - w) / self.sea.step).astype(int)
            for v, w in ((x, self.sea.west), (y, self.sea.south))
        )
        inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
        distance_there = self.out.far[np.clip(row, 0, ny - 1) * nx + np.clip(column, 0, nx - 1)]
        return np.asarray((inside & np.isfinite(distance_there)).mean(axis=1))


@dataclass(frozen=True)
class Sailed:
    """Legs cut at the coast and joined by ways round it."""

    lon: Array  # (k,) [deg]
    lat: Array
    searching: Array  # bool (k - 1,)
    elapsed: Array  # (k,) [s] since the first point
    cut: tuple[int, ...]  # indices of the original legs that are cut or left out
    out: float  # [m] upper bound of the way from the base to the first point
    # [m] upper bound of the way from the last point to the port of return; inf: no way
    home: float


def prepare(
    unit: Unit,
    land: Callable[[Box], Array],
    places: Array,
    shallow: Callable[[Box], Array] | None = None,
) -> tuple[Course | None, str]:
    """Return a boat's course in the region that it may search, and remarks on it.

    Args:
        unit: the boat.
        land: returns the land polygons [deg] in a box.
        places: lon, lat [deg] of the region that it may search, shape (n, 2).
        shallow: returns the polygons [deg] of water that is too shallow for the boat.

    Returns:
        The course, None if no land is near, and remarks for users.

    Raises:
        ValueError: the boat cannot get there by sea; the message is for users.
    """
    ends = np.array([unit.base, unit.return_to])
    lonlat = np.radians(np.concatenate([ends, places]))
    vector = np.stack(
        [
            np.cos(lonlat[:, 1]) * np.cos(lonlat[:, 0]),
            np.cos(lonlat[:, 1]) * np.sin(lonlat[:, 0]),
            np.sin(lonlat[:, 1]),
        ]
    )
    x, y, z = vector.mean(axis=1)
    plane = Plane(math.atan2(y, x), math.atan2(z, math.hypot(x, y)))
    flat = np.column_stack(plane.flat(*lonlat.T))
    farthest = np.hypot(*(flat[None, 2:] - flat[:2, None]).T).max()
    margin = max(ROOM * float(farthest), LEAST_ROOM)
    region = seas.region(plane, flat, margin)
    polygons = land(region.box)
    shoals = None if shallow is None else shallow(region.box)
    sea = seas.build_sea(polygons, region, unit.clear_of_land, shoals)
    if sea is None:
        return None, ""
    inshore = sea
    if sea.keeps > seas.CLEAR or (shoals is not None and len(shoals)):
        inshore = (
            seas.build_sea(polygons, region) or seas.build_sea(polygons, region, 0.0, shoals) or sea
        )
    main_water = _main_water(sea, flat[2:])
    out = home = _harbour(sea, inshore, unit.base, main_water)
    sentences = [_remarks("starts from", out, sea)]
    if unit.return_to != unit.base:
        home = _harbour(sea, inshore, unit.return_to, main_water)
        sentences.append(_remarks("returns to", home, sea))
    return Course(sea, out, home, region.box), " ".join(
        sentence for sentence in sentences if sentence
    )


def _main_water(sea: Sea, targets: Array) -> Array:
    """Return the nodes of the water that holds most of some places [m], bool (nodes,)."""
    ny, nx = sea.open.shape
    column, row = (
        np.rint((targets[:, k] - (sea.west, sea.south)[k]) / sea.step).astype(int) for k in (0, 1)
    )
    node = np.clip(row, 0, ny - 1) * nx + np.clip(column, 0, nx - 1)
    node = node[sea.open.ravel()[node]]
    part = np.bincount(sea.part[node]) if node.size else np.bincount(sea.part[sea.open.ravel()])
    return np.asarray((sea.part == int(part.argmax())) & sea.open.ravel())


def _harbour(sea: Sea, inshore: Sea, place: LonLat, main_water: Array) -> Harbour:
    """Return a harbour; raise ValueError if it has no way to the water of `main`."""
    point = sea.flat(*np.array([place]).T)[0]
    node, approach, ashore = (
        seas.nearest_visible_node(sea, np.where(main_water, 0.0, np.inf), point),
        point[None],
        0.0,
    )
    if node is None:
        # Allow a way through waters in which the boat cannot keep its distance.
        navigable = (
            np.isin(inshore.part, np.unique(inshore.part[main_water])) & inshore.open.ravel()
        )
        node = seas.nearest_visible_node(inshore, np.where(navigable, 0.0, np.inf), point)
        if node is None:
            node = _nearest(inshore, navigable, point)
            ashore = (
                math.inf
                if node is None
                else float(seas.apart(sea, point[None], _node(sea, node)[None])[0])
            )
            if node is None or ashore > max(HARBOUR, 3 * sea.step):
                raise ValueError(
                    f"no route by sea leads from {notation.position(*place)} to its search area: the nearest water "
                    f"with such a route is {ashore / 1852:.1f} nmi away; at most {HARBOUR / 1852:.0f} nmi is allowed"
                )
            approach = _node(sea, node)[None]
        far, before = seas.distances(inshore, node)
        gate = int(np.argmin(np.where(main_water, far, np.inf)))
        approach = seas.pulled_taut(
            inshore, np.concatenate([approach, seas.along(inshore, before, gate)])
        )
        node = gate
    narrow = seas.length(sea, approach)
    straight = float(np.hypot(*(_node(sea, node) - approach[-1])))
    far, before = seas.distances(sea, node)
    far = far + (ashore + narrow + straight)
    # To visible nodes, the straight line is shorter than the way over nodes.
    direct = ashore + narrow + np.hypot(*(sea.nodes - approach[-1]).T)
    lengths = np.where(
        np.isfinite(far) & seas.visible_nodes(sea, approach[-1]), np.minimum(far, direct), far
    )
    return Harbour(place, approach, ashore, narrow, far, before, seas.filled(sea, lengths))


def _nearest(sea: Sea, nodes: Array, point: Array) -> int | None:
    """Return which of some nodes, bool (nodes,), is nearest to a point [m]; None: no nodes."""
    candidates = np.flatnonzero(nodes)
    if not candidates.size:
        return None
    return int(candidates[np.argmin(np.hypot(*(sea.nodes[candidates] - point).T))])


def _node(sea: Sea, node: int) -> Array:
    """Return the position (2,) [m] of a node."""
    nx = sea.open.shape[1]
    return np.array([sea.west + sea.step * (node % nx), sea.south + sea.step * (node // nx)])


def _remarks(verb: str, harbour: Harbour, sea: Sea) -> str:
    """Return remarks on a harbour; "" if there are none."""
    sentences = []
    if harbour.ashore > 2 * sea.step:
        sentences.append(
            f"{verb} the nearest water, {harbour.ashore / 1852:.2f} nmi from its base: "
            f"{notation.position(*harbour.place)} lies on land in this coastline, or too near to it."
        )
    if harbour.close > 2 * sea.step:
        sentences.append(
            f"{harbour.close / 1852:.1f} nmi of its way out of harbour, or in, are nearer to land, or shallower, than "
            "the case allows."
        )
    return " ".join(sentences)


def way(course: Course, harbour: Harbour, point: LonLat) -> Array | None:
    """Return the way (k, 2) [deg] from a harbour to a position [deg]; None if there is none."""
    sea = course.sea
    end = sea.flat(*np.array([point]).T)[0]
    node = seas.nearest_visible_node(sea, harbour.far, end)
    if node is None:
        return None
    nodes = seas.along(sea, harbour.before, node)
    path = seas.pulled_taut(sea, np.concatenate([harbour.approach[-1:], nodes, end[None]]))
    return _unwrap(sea.round(np.concatenate([harbour.approach[:-1], path])))


def out_and_home(
    course: Course, first: LonLat, last: LonLat
) -> tuple[tuple[LonLat, ...], tuple[LonLat, ...]]:
    """Return the way out to a first position [deg], and the way home from a last one.

    If the boat cannot get to a position (such as the centre, on an island, of an area without
    legs), the way leads to the nearest reachable place.
    """
    ways = []
    for harbour, place in ((course.out, first), (course.home, last)):
        path = way(course, harbour, place)
        if path is None:
            point = course.sea.flat(*np.array([place]).T)[0]
            node = _nearest(course.sea, np.isfinite(harbour.far), point)
            assert node is not None  # the harbour's own node is reachable
            x, y = course.sea.round(_node(course.sea, node)[None])[0]
            path = way(course, harbour, (float(x), float(y)))
        assert path is not None  # the boat can get to this node
        ways.append(tuple((float(x), float(y)) for x, y in path))
    return ways[0], ways[1][::-1]


def distances(course: Course, harbour: Harbour, points: Array) -> Array:
    """Return upper bounds [m] of the ways from a harbour to points, shape (n,); inf: no way.

    Args:
        course: of the boat.
        harbour: of the course.
        points: [m], shape (n, 2).
    """
    sea, gate = course.sea, harbour.approach[-1]
    nodes = [seas.nodes_near(sea, harbour.far, point) for point in points]
    # For each point, try the straight way and the ways over nearby nodes.
    counts = np.array([len(node) for node in nodes], int)
    node, own = (
        np.concatenate([np.empty(0, int), *nodes]),
        np.repeat(np.arange(len(points)), counts),
    )
    places, numbers = np.concatenate([points, sea.at(node), gate[None]]), np.arange(len(points))
    begin = np.concatenate([np.full(len(points), len(places) - 1), own])
    end = np.concatenate([numbers, len(points) + np.arange(len(node))])
    visible = seas.sees(sea, places, begin, end)
    shortest = np.full(len(points), math.inf)
    lengths = harbour.far[node] + np.hypot(*(places[end[len(points) :]] - points[own]).T)
    np.minimum.at(shortest, own, np.where(visible[len(points) :], lengths, math.inf))
    straight = visible[: len(points)] & np.isfinite(shortest)
    return np.where(
        straight, harbour.ashore + harbour.close + np.hypot(*(points - gate).T), shortest
    )


def crosses(course: Course, lon: Array, lat: Array) -> bool:
    """Return True if legs through points [deg] may come near land or leave the region."""
    points = course.sea.flat(lon, lat)
    hull = shapely.MultiPoint(points).convex_hull
    return not course.sea.holds(points) or bool(
        course.sea.tree.query(hull, predicate="intersects").size
    )


def sail(
    course: Course,
    several: Sequence[tuple[Array, Array]],
    search_speed: float,
    transit_speed: float,
) -> list[Sailed | None]:
    """Return the legs of several searches as a boat can sail them.

    A piece of a leg is left out if it is shorter than SCRAP, if going to it takes longer than
    searching it, or if no way to it is near.

    Args:
        course: of the boat.
        several: points (lon, lat) [deg] of each search.
        search_speed: [m/s].
        transit_speed: [m/s].

    Returns:
        The legs of each search; None if no piece is left.
    """
    sea = course.sea
    flat = [sea.flat(*points) for points in several]
    legs = _pieces(sea, [points if sea.holds(points) else points[:0] for points in flat])
    cut = [{k for k, (_, whole) in enumerate(pieces) if not whole} for pieces in legs]
    parts = [
        [
            (k, piece)
            for k, (ends, _) in enumerate(pieces)
            for piece in ends
            if len(ends) == 1 or _size(piece) >= SCRAP
        ]
        for pieces in legs
    ]
    out = np.full(len(several), math.inf)
    while unreached := [n for n, pieces in enumerate(parts) if pieces and math.isinf(out[n])]:
        out[unreached] = distances(
            course, course.out, np.array([parts[n][0][1][0] for n in unreached])
        )
        for n in unreached:
            if math.isinf(out[n]):
                cut[n].add(parts[n].pop(0)[0])
    sailable = [n for n, pieces in enumerate(parts) if pieces]
    home = np.full(len(several), math.inf)
    result: list[Sailed | None] = [None] * len(several)
    ways = _ways_between_pieces(sea, parts, transit_speed / search_speed)
    if sailable:
        last = [parts[n][ways[n][-1][0] if ways[n] else 0][1][1] for n in sailable]
        home[sailable] = distances(course, course.home, np.array(last))
    for n in sailable:
        used = {0, *(j for j, _ in ways[n])}
        cut[n] |= {k for j, (k, _) in enumerate(parts[n]) if j not in used}
        points, searching = [parts[n][0][1]], [True]
        for j, way in ways[n]:
            points += [way[1:], parts[n][j][1][1:]]
            searching += [False] * (len(way) - 1) + [True]
        searched = np.array(searching)
        position = _unwrap(sea.round(np.concatenate(points)))
        steps = sphere.distance(*np.radians(position[:-1].T), *np.radians(position[1:].T))
        # Times are whole seconds, as in a case file, so that the scored plan is exactly the written
        # one.
        durations = np.maximum(
            np.ceil(steps / np.where(searched, search_speed, transit_speed)), 1.0
        )
        elapsed = np.concatenate([[0.0], np.cumsum(durations)])
        lon, lat = position.T
        result[n] = Sailed(
            lon, lat, searched, elapsed, tuple(sorted(cut[n])), float(out[n]), float(home[n])
        )
    return result


def _size(piece: Array) -> float:
    """Return the length [m] of a piece, given by its ends (2, 2) [m]."""
    return float(np.hypot(*(piece[1] - piece[0])))


def _ways_between_pieces(
    sea: Sea, several: Sequence[Sequence[tuple[int, Array]]], speeds: float
) -> list[list[tuple[int, Array]]]:
    """Return, for each search, which pieces follow the first one, and the ways to them.

    The ways are (k, 2) [m]. several: for each piece of each search, the index of its leg and its
    ends (2, 2) [m]; speeds: speed of transit over that of search.
    """
    pieces = [piece for parts in several for _, piece in parts]
    search = [n for n, parts in enumerate(several) for _ in parts]
    leg = [k for parts in several for k, _ in parts]
    # longest way that is worth sailing to search a piece
    far = [_size(piece) * speeds for piece in pieces]
    first = np.cumsum([0, *(len(parts) for parts in several)])
    ways_known: dict[tuple[int, int], Array | None] = {}
    while True:
        # Assume that pieces can be reached until the opposite is known: many ways are then computed
        # in one call.
        links, last = [], 0
        for j in range(1, len(pieces)):
            gap = math.dist(pieces[last][1], pieces[j][0])
            if search[j] != search[last]:
                last = j
            elif gap <= max(far[j], 1.0) and ways_known.get((last, j), pieces[j]) is not None:
                links.append((last, j, gap))
                last = j
        asked = [link for link in links if link[:2] not in ways_known]
        if not asked:
            break
        begin, end = (
            np.array([pieces[i][1] for i, _, _ in asked]),
            np.array([pieces[j][0] for _, j, _ in asked]),
        )
        straight = np.array([link[2] for link in asked])
        most = np.minimum(FAR_ROUND * straight + ROUND_MORE, [far[j] for _, j, _ in asked])
        ways = seas.short_ways(
            sea, begin, end, most, np.array([leg[i] == leg[j] for i, j, _ in asked])
        )
        for k, (i, j, _) in enumerate(asked):
            # else the pieces touch
            ways_known[i, j] = ways[k] if straight[k] > 1.0 else begin[k : k + 1]
    result: list[list[tuple[int, Array]]] = [[] for _ in several]
    for i, j, _ in links:
        way = ways_known[i, j]
        assert way is not None
        result[search[j]].append((j - int(first[search[j]]), way))
    return result


def _pieces(sea: Sea, several: Sequence[Array]) -> list[list[tuple[list[Array], bool]]]:
    """Return the pieces clear of land of each leg of each search, and whether the leg is uncut.

    Pieces are given by their ends (2, 2) [m]. several: points (n, 2) [m] of each search.
    """
    legs: list[list[tuple[list[Array], bool]]] = [[] for _ in several]
    search = np.repeat(np.arange(len(several)), [len(points) for points in several])
    number = np.flatnonzero(search[1:] == search[:-1])
    if not number.size:
        return legs
    leg_of, x, y = seas.great_circles(sea, np.concatenate(several), number, number + 1)
    lines = shapely.linestrings(np.column_stack(sea.plane.flat(x, y)), indices=leg_of)
    leg, tile = sea.tree.query(lines, predicate="intersects")
    dry, dry_leg = shapely.get_parts(
        shapely.intersection(lines[leg], sea.skin[tile]), return_index=True
    )
    dry_leg, dry = leg[dry_leg[shapely.get_type_id(dry) == 1]], dry[shapely.get_type_id(dry) == 1]
    ends = [shapely.line_locate_point(lines[dry_leg], shapely.get_point(dry, k)) for k in (0, -1)]
    # begin and end of each piece along its leg
    bounds = [[0.0, float(length)] for length in shapely.length(lines)]
    for k in np.unique(dry_leg):
        of_leg = dry_leg == k
        first, last = np.minimum(*ends)[of_leg], np.maximum(*ends)[of_leg]
        order = np.argsort(first)
        begin = np.concatenate([[0.0], np.maximum.accumulate(last[order])])
        end = np.append(first[order], bounds[k][1])
        bounds[k] = np.column_stack([begin, end])[end - begin > SEAM].ravel().tolist()
    line = np.repeat(lines, [len(pairs) for pairs in bounds])
    points = shapely.get_coordinates(
        shapely.line_interpolate_point(line, np.concatenate(bounds))
    ).reshape(-1, 2, 2)
    for k, of_leg in enumerate(
        np.split(points, np.cumsum([len(pairs) // 2 for pairs in bounds])[:-1])
    ):
        legs[search[number[k]]].append((list(of_leg), not (dry_leg == k).any()))
    return legs


def _unwrap(place: Array) -> Array:
    """Return positions (k, 2) [deg] with continuous longitudes."""
    return np.column_stack([np.degrees(np.unwrap(np.radians(place[:, 0]))), place[:, 1]])


def on_land(polygons: Array, lon: npt.ArrayLike, lat: npt.ArrayLike) -> float:
    """Return the length [m] of great circles through positions that lies on land.

    Args:
        polygons: land [deg].
        lon: of the positions [deg].
        lat: of the positions [deg].
    """
    x, y = sphere.track(np.radians(lon), np.radians(lat), 500.0)
    x = np.degrees(np.unwrap(x))
    line = np.column_stack([x, np.degrees(y)])
    total = 0.0
    for turn in (-360.0, 0.0, 360.0):
        way = shapely.LineString(line + np.array([turn, 0.0]))
        candidates = (
            polygons[shapely.intersects(shapely.box(*way.bounds), polygons)]
            if len(polygons)
            else polygons
        )
        overlap = shapely.intersection(way, candidates)
        for part in shapely.get_parts(shapely.get_parts(overlap)):
            a = np.radians(np.array(part.coords))
            if len(a) > 1:
                total += float(sphere.distance(*a[:-1].T, *a[1:].T).sum())
            elif len(a) == 1:
                total += 1e-3  # it touches land
    return total
