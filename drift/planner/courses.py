"""How a boat gets about: out of harbour, to where it searches, round what lies across its legs, and home.

A boat keeps its distance from the shore, and from water that is too shallow for it, but where it leaves harbour: from a base that is
too near to land it goes by the shortest way to the sea that it keeps to, and a base that the coast takes for land it leaves from
the nearest water within HARBOUR. Aircraft fly straight on and need nothing of this.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from drift.planner import seas
from drift.planner.planning_tracks import Plane
from drift.planner.seas import Sea
from drift.search.records import Unit
from geo import notation, sphere
from geo.box import Box
from geo.polyline import Place

Array = npt.NDArray[Any]

HARBOUR = 1852.0  # [m] from its base to where a boat takes to the water, at most
ROOM = 0.56  # of the farthest straight way, about it: ways half as long again do not leave the region (an ellipse)
LEAST_ROOM = 5_000.0  # [m]
SCRAP = 100.0  # [m] pieces of legs that are shorter are left out
FAR_ROUND = 3.0  # times the straight way and ROUND_MORE, beyond which the way to the next piece is not looked for
ROUND_MORE = 4_000.0  # [m]
SEAM = 0.01  # [m] between tiles of the barrier, which their rounding may leave
SAMPLES = 7  # along each side of a rectangle, to tell how much of it is sea


@dataclass(frozen=True)
class Harbour:
    """A place from which a boat sets out, or to which it returns, and how far all is from it."""

    place: Place
    approach: Array  # (k, 2) [m] way from where it takes to the water to where it is in the sea that it keeps to, at least that point
    ashore: float  # [m] from the place to the first point of the approach
    close: float  # [m] of the approach that are nearer to land, or shallower, than it keeps
    far: Array  # (nodes,) [m] from the place
    before: Array  # (nodes,) by which node
    filled: Array  # (ny, nx) [m]


@dataclass(frozen=True)
class Course:
    """The sea of a boat and its harbours."""

    sea: Sea
    out: Harbour
    home: Harbour
    box: Box  # of its region

    def arrival(self, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
        """Return the length [m] of the way from the base to positions [rad], on land that to the nearest water and on."""
        x, y = self.sea.plane.flat(lon, lat)
        points = np.column_stack([np.ravel(x), np.ravel(y)])
        return seas.sampled(self.sea, self.out.filled, points).reshape(np.shape(x))

    def share(self, lon: Array, lat: Array) -> Array:
        """Return which share of positions [rad], (c, n), are at sea where it can get, (c,)."""
        x, y = self.sea.plane.flat(lon, lat)
        ny, nx = self.sea.open.shape
        column, row = (
            np.rint((v - w) / self.sea.step).astype(int) for v, w in ((x, self.sea.west), (y, self.sea.south))
        )
        inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
        there = self.out.far[np.clip(row, 0, ny - 1) * nx + np.clip(column, 0, nx - 1)]
        return np.asarray((inside & np.isfinite(there)).mean(axis=1))


@dataclass(frozen=True)
class Sailed:
    """Legs cut at the coast and joined by ways round it."""

    lon: Array  # (k,) [deg]
    lat: Array
    searching: Array  # bool (k - 1,)
    elapsed: Array  # (k,) [s] since the first point
    cut: tuple[int, ...]  # which of the legs it was given are cut, or left out, from 0
    out: float  # [m] that the way from the base to the first point does not exceed
    home: float  # [m] likewise from the last point to where it returns; inf without a way


def prepare(
    unit: Unit, land: Callable[[Box], Array], places: Array, shallow: Callable[[Box], Array] | None = None
) -> tuple[Course | None, str]:
    """Return a boat's course to where it may have to search, and what to say of it; None where no land is near.

    land: returns the polygons [deg] of the land in a box; places: (n, 2) lon, lat [deg] of the region that it may search; shallow: likewise of
    what is too shallow for it.
    Raises ValueError where it cannot get there by sea, saying why.
    """
    ends = np.array([unit.base, unit.return_to])
    every = np.radians(np.concatenate([ends, places]))
    vector = np.stack(
        [np.cos(every[:, 1]) * np.cos(every[:, 0]), np.cos(every[:, 1]) * np.sin(every[:, 0]), np.sin(every[:, 1])]
    )
    x, y, z = vector.mean(axis=1)
    plane = Plane(math.atan2(y, x), math.atan2(z, math.hypot(x, y)))
    flat = np.column_stack(plane.flat(*every.T))
    away = np.hypot(*(flat[None, 2:] - flat[:2, None]).T).max()
    room = max(ROOM * float(away), LEAST_ROOM)
    where = seas.region(plane, flat, room)
    polygons = land(where.box)
    shoals = None if shallow is None else shallow(where.box)
    sea = seas.build(polygons, where, unit.clear_of_land, shoals)
    if sea is None:
        return None, ""
    close = sea
    if sea.keeps > seas.CLEAR or (shoals is not None and len(shoals)):
        close = seas.build(polygons, where) or seas.build(polygons, where, 0.0, shoals) or sea
    main = _main(sea, flat[2:])
    out = home = _harbour(sea, close, unit.base, main)
    said = [_said("leaves", out, sea)]
    if unit.return_to != unit.base:
        home = _harbour(sea, close, unit.return_to, main)
        said.append(_said("returns to", home, sea))
    return Course(sea, out, home, where.box), " ".join(words for words in said if words)


def _main(sea: Sea, targets: Array) -> Array:
    """Return the nodes of the water in which most of some places [m] lie, bool (nodes,)."""
    ny, nx = sea.open.shape
    column, row = (np.rint((targets[:, k] - (sea.west, sea.south)[k]) / sea.step).astype(int) for k in (0, 1))
    node = np.clip(row, 0, ny - 1) * nx + np.clip(column, 0, nx - 1)
    node = node[sea.open.ravel()[node]]
    part = np.bincount(sea.part[node]) if node.size else np.bincount(sea.part[sea.open.ravel()])
    return np.asarray((sea.part == int(part.argmax())) & sea.open.ravel())


def _harbour(sea: Sea, close: Sea, place: Place, main: Array) -> Harbour:
    """Return a harbour; raise ValueError where it has no way to the water of `main`."""
    point = sea.flat(*np.array([place]).T)[0]
    node, approach, ashore = seas.joined(sea, np.where(main, 0.0, np.inf), point), point[None], 0.0
    if node is None:
        # Through narrower waters than it keeps to, where there are such
        there = np.isin(close.part, np.unique(close.part[main])) & close.open.ravel()
        node = seas.joined(close, np.where(there, 0.0, np.inf), point)
        if node is None:
            node = _nearest(close, there, point)
            ashore = math.inf if node is None else float(seas.apart(sea, point[None], _node(sea, node)[None])[0])
            if node is None or ashore > max(HARBOUR, 3 * sea.step):
                raise ValueError(
                    f"no way by sea leads from {notation.position(*place)} to where it is to search: the nearest water from which one does is "
                    f"{ashore / 1852:.1f} nmi away, and it may be {HARBOUR / 1852:.0f} nmi"
                )
            approach = _node(sea, node)[None]
        far, before = seas.distances(close, node)
        gate = int(np.argmin(np.where(main, far, np.inf)))
        approach = seas.pulled(close, np.concatenate([approach, seas.along(close, before, gate)]))
        node = gate
    narrow = seas.length(sea, approach)
    straight = float(np.hypot(*(_node(sea, node) - approach[-1])))
    far, before = seas.distances(sea, node)
    far = far + (ashore + narrow + straight)
    # Where nothing is in the way the straight line is known: shorter than that over the nodes
    direct = ashore + narrow + np.hypot(*(sea.nodes - approach[-1]).T)
    known = np.where(np.isfinite(far) & seas.seen(sea, approach[-1]), np.minimum(far, direct), far)
    return Harbour(place, approach, ashore, narrow, far, before, seas.filled(sea, known))


def _nearest(sea: Sea, nodes: Array, point: Array) -> int | None:
    """Return the nearest of some nodes, bool (nodes,), to a point [m]."""
    some = np.flatnonzero(nodes)
    if not some.size:
        return None
    return int(some[np.argmin(np.hypot(*(sea.nodes[some] - point).T))])


def _node(sea: Sea, node: int) -> Array:
    nx = sea.open.shape[1]
    return np.array([sea.west + sea.step * (node % nx), sea.south + sea.step * (node // nx)])


def _said(verb: str, one: Harbour, sea: Sea) -> str:
    """Return what is to be told of a harbour."""
    told = []
    if one.ashore > 2 * sea.step:
        told.append(
            f"{verb} the nearest water, {one.ashore / 1852:.2f} nmi off: {notation.position(*one.place)} is land on this coast, or too near to it."
        )
    if one.close > 2 * sea.step:
        told.append(
            f"{one.close / 1852:.1f} nmi of its way out of harbour, or in, are nearer to land, or shallower, than it keeps."
        )
    return " ".join(told)


def way(course: Course, harbour: Harbour, point: Place) -> Array | None:
    """Return the way (k, 2) of lon, lat [deg] from a harbour to a position [deg]; None without one."""
    sea = course.sea
    end = sea.flat(*np.array([point]).T)[0]
    node = seas.joined(sea, harbour.far, end)
    if node is None:
        return None
    nodes = seas.along(sea, harbour.before, node)
    found = seas.pulled(sea, np.concatenate([harbour.approach[-1:], nodes, end[None]]))
    return _unwrapped(sea.round(np.concatenate([harbour.approach[:-1], found])))


def both(course: Course, first: Place, last: Place) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
    """Return the ways from the base to a position [deg], and from another to where a boat returns.

    Of a position where it cannot get (the centre of an area without legs, on an island), to the nearest place where it can.
    """
    made = []
    for harbour, place in ((course.out, first), (course.home, last)):
        found = way(course, harbour, place)
        if found is None:
            point = course.sea.flat(*np.array([place]).T)[0]
            node = _nearest(course.sea, np.isfinite(harbour.far), point)
            assert node is not None  # the harbour's own
            x, y = course.sea.round(_node(course.sea, node)[None])[0]
            found = way(course, harbour, (float(x), float(y)))
        assert found is not None
        made.append(tuple((float(x), float(y)) for x, y in found))
    return made[0], made[1][::-1]


def distance(course: Course, harbour: Harbour, point: Place) -> float:
    """Return a length [m] that the way from a harbour to a position [deg] does not exceed; inf without a way."""
    return float(distances(course, harbour, course.sea.flat(*np.array([point]).T))[0])


def distances(course: Course, harbour: Harbour, points: Array) -> Array:
    """Return lengths [m] that the ways from a harbour to points (n, 2) [m] do not exceed, (n,); inf without a way."""
    sea, gate = course.sea, harbour.approach[-1]
    nodes = [seas.around(sea, harbour.far, point) for point in points]
    # Of each the straight way, and those over nodes near by
    many = np.array([len(node) for node in nodes], int)
    node, own = np.concatenate([np.empty(0, int), *nodes]), np.repeat(np.arange(len(points)), many)
    places, each = np.concatenate([points, sea.at(node), gate[None]]), np.arange(len(points))
    begin = np.concatenate([np.full(len(points), len(places) - 1), own])
    end = np.concatenate([each, len(points) + np.arange(len(node))])
    seen = seas.sees(sea, places, begin, end)
    over = np.full(len(points), math.inf)
    lengths = harbour.far[node] + np.hypot(*(places[end[len(points) :]] - points[own]).T)
    np.minimum.at(over, own, np.where(seen[len(points) :], lengths, math.inf))
    straight = seen[: len(points)] & np.isfinite(over)
    return np.where(straight, harbour.ashore + harbour.close + np.hypot(*(points - gate).T), over)


def crosses(course: Course, lon: Array, lat: Array) -> bool:
    """Whether legs through points [deg] come near to land, or lead out of the region."""
    points = course.sea.flat(lon, lat)
    hull = shapely.MultiPoint(points).convex_hull
    return not course.sea.holds(points) or bool(course.sea.tree.query(hull, predicate="intersects").size)


def sail(
    course: Course, several: Sequence[tuple[Array, Array]], search_speed: float, transit_speed: float
) -> list[Sailed | None]:
    """Return several searches' legs through points (lon, lat) [deg] as a boat can sail them; None where it can sail none of them.

    A piece is left out where it is shorter than SCRAP, where going to it takes longer than searching it, and where no way is near.
    """
    sea = course.sea
    flat = [sea.flat(*points) for points in several]
    legs = _pieces(sea, [points if sea.holds(points) else points[:0] for points in flat])
    cut = [{k for k, (_, whole) in enumerate(own) if not whole} for own in legs]
    parts = [
        [(k, one) for k, (ends, _) in enumerate(own) for one in ends if len(ends) == 1 or _size(one) >= SCRAP]
        for own in legs
    ]
    out = np.full(len(several), math.inf)
    while asked := [n for n, own in enumerate(parts) if own and math.isinf(out[n])]:
        out[asked] = distances(course, course.out, np.array([parts[n][0][1][0] for n in asked]))
        for n in asked:
            if math.isinf(out[n]):
                cut[n].add(parts[n].pop(0)[0])
    can = [n for n, own in enumerate(parts) if own]
    home = np.full(len(several), math.inf)
    made: list[Sailed | None] = [None] * len(several)
    ways = _between(sea, parts, transit_speed / search_speed)
    if can:
        last = [parts[n][ways[n][-1][0] if ways[n] else 0][1][1] for n in can]
        home[can] = distances(course, course.home, np.array(last))
    for n in can:
        kept = {0, *(j for j, _ in ways[n])}
        cut[n] |= {k for j, (k, _) in enumerate(parts[n]) if j not in kept}
        points, searching = [parts[n][0][1]], [True]
        for j, way in ways[n]:
            points += [way[1:], parts[n][j][1][1:]]
            searching += [False] * (len(way) - 1) + [True]
        seen = np.array(searching)
        place = _unwrapped(sea.round(np.concatenate(points)))
        steps = sphere.distance(*np.radians(place[:-1].T), *np.radians(place[1:].T))
        # Whole seconds, as a case file has them, so that what is scored is what is told
        lasts = np.maximum(np.ceil(steps / np.where(seen, search_speed, transit_speed)), 1.0)
        elapsed = np.concatenate([[0.0], np.cumsum(lasts)])
        made[n] = Sailed(place[:, 0], place[:, 1], seen, elapsed, tuple(sorted(cut[n])), float(out[n]), float(home[n]))
    return made


def _size(piece: Array) -> float:
    return float(np.hypot(*(piece[1] - piece[0])))


def _between(sea: Sea, several: Sequence[Sequence[tuple[int, Array]]], speeds: float) -> list[list[tuple[int, Array]]]:
    """Return for each search the pieces that are reached after its first, by number, and the ways (k, 2) [m] there from the one before.

    several: of each search the number of the leg and the ends (2, 2) [m] of each piece; speeds: of transit to search.
    """
    pieces = [piece for parts in several for _, piece in parts]
    search = [n for n, parts in enumerate(several) for _ in parts]
    leg = [k for parts in several for k, _ in parts]
    far = [_size(piece) * speeds for piece in pieces]  # that it is worth going, to search it
    first = np.cumsum([0, *(len(parts) for parts in several)])
    known: dict[tuple[int, int], Array | None] = {}
    while True:
        # A piece is taken to be reached until it is known that it is not: few questions, of many ways each
        string, last = [], 0
        for j in range(1, len(pieces)):
            away = math.dist(pieces[last][1], pieces[j][0])
            if search[j] != search[last]:
                last = j
            elif away <= max(far[j], 1.0) and known.get((last, j), pieces[j]) is not None:
                string.append((last, j, away))
                last = j
        asked = [gap for gap in string if gap[:2] not in known]
        if not asked:
            break
        begin, end = np.array([pieces[i][1] for i, _, _ in asked]), np.array([pieces[j][0] for _, j, _ in asked])
        straight = np.array([gap[2] for gap in asked])
        most = np.minimum(FAR_ROUND * straight + ROUND_MORE, [far[j] for _, j, _ in asked])
        ways = seas.nears(sea, begin, end, most, np.array([leg[i] == leg[j] for i, j, _ in asked]))
        for k, (i, j, _) in enumerate(asked):
            known[i, j] = ways[k] if straight[k] > 1.0 else begin[k : k + 1]  # there is nothing to go
    found: list[list[tuple[int, Array]]] = [[] for _ in several]
    for i, j, _ in string:
        way = known[i, j]
        assert way is not None
        found[search[j]].append((j - int(first[search[j]]), way))
    return found


def _pieces(sea: Sea, several: Sequence[Array]) -> list[list[tuple[list[Array], bool]]]:
    """Return for each leg of searches through points (n, 2) [m] its pieces that are clear, as their ends (2, 2) [m], and whether it is whole."""
    legs: list[list[tuple[list[Array], bool]]] = [[] for _ in several]
    search = np.repeat(np.arange(len(several)), [len(points) for points in several])
    number = np.flatnonzero(search[1:] == search[:-1])
    if not number.size:
        return legs
    which, x, y = seas.followed(sea, np.concatenate(several), number, number + 1)
    lines = shapely.linestrings(np.column_stack(sea.plane.flat(x, y)), indices=which)
    leg, tile = sea.tree.query(lines, predicate="intersects")
    dry, met = shapely.get_parts(shapely.intersection(lines[leg], sea.skin[tile]), return_index=True)
    met, dry = leg[met[shapely.get_type_id(dry) == 1]], dry[shapely.get_type_id(dry) == 1]
    ends = [shapely.line_locate_point(lines[met], shapely.get_point(dry, k)) for k in (0, -1)]
    wet = [[0.0, float(length)] for length in shapely.length(lines)]  # where land ends and begins again along each leg
    for k in np.unique(met):
        own = met == k
        first, last = np.minimum(*ends)[own], np.maximum(*ends)[own]
        order = np.argsort(first)
        begin = np.concatenate([[0.0], np.maximum.accumulate(last[order])])
        end = np.append(first[order], wet[k][1])
        wet[k] = np.column_stack([begin, end])[end - begin > SEAM].ravel().tolist()
    line = np.repeat(lines, [len(at) for at in wet])
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, np.concatenate(wet))).reshape(-1, 2, 2)
    for k, own in enumerate(np.split(points, np.cumsum([len(at) // 2 for at in wet])[:-1])):
        legs[search[number[k]]].append((list(own), not (met == k).any()))
    return legs


def _unwrapped(place: Array) -> Array:
    """Return positions (k, 2) [deg] with longitudes that run on."""
    return np.column_stack([np.degrees(np.unwrap(np.radians(place[:, 0]))), place[:, 1]])


def on_land(polygons: Array, lon: npt.ArrayLike, lat: npt.ArrayLike) -> float:
    """Return how many metres of a way of great circles through positions [deg] lie on land: polygons [deg], by Shapely."""
    x, y = sphere.track(np.radians(lon), np.radians(lat), 500.0)
    x = np.degrees(np.unwrap(x))
    line = np.column_stack([x, np.degrees(y)])
    total = 0.0
    for turn in (-360.0, 0.0, 360.0):
        way = shapely.LineString(line + np.array([turn, 0.0]))
        near = polygons[shapely.intersects(shapely.box(*way.bounds), polygons)] if len(polygons) else polygons
        dry = shapely.intersection(way, near)
        for part in shapely.get_parts(shapely.get_parts(dry)):
            a = np.radians(np.array(part.coords))
            if len(a) > 1:
                total += float(sphere.distance(*a[:-1].T, *a[1:].T).sum())
            elif len(a) == 1:
                total += 1e-3  # it touches
    return total
