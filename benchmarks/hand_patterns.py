"""Legs that a planner would draw by hand, for plans to be compared with.

Each unit flies one sortie, one unit after the other, on what the units before it leave. Two
families:

drawn: the patterns of the IAMSAR Manual, Vol. II, chapter 5 (expanding square, sector, parallel
track, creeping line), laid out at the mean position or at the densest spot, on the ground or in a
frame that drifts with the objects there. Of the few sizes and spacings that a planner would try,
the one that finds most of few particles is flown, of those that keep units apart as the plan must.

chased: legs from one densest spot of what is left to the next (chase), to and fro against the drift
there (against), or with a tiny expanding square at each (squares).

All are laid out on the tracks that they are given; what they find may be scored on others.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from drift.engine.motion.scenario import Survival
from drift.evidence.filter.records import PlanSpec, Unit
from drift.planning.search import joint, optimiser, rectangle
from drift.planning.search import planning_tracks as record
from drift.planning.search.boats import availability
from drift.planning.search.planning_tracks import Tracks
from drift.planning.search.rectangle import Crew
from geo import sphere
from kernels.planning import sweeps

DRAWN = ("square", "sector", "parallel", "creeping")
CHASED = ("chase", "against", "squares")
FEW = 4000  # particles on which legs are laid out
SPACINGS = (0.5, 0.7, 1.0, 1.5, 2.5, 4.0)  # [sweep widths]
SECTORS = (1, 2, 4, 8)  # how often a sector search of three sectors is flown
MOST_POINTS = 2000  # of a pattern
LONGEST = 3.0  # length over width of a creeping line's area


@dataclass(frozen=True)
class Cloud:
    """Few particles on the plane, by which legs are laid out."""

    time: np.ndarray  # [s] (edges,)
    x: np.ndarray  # [m] (edges, m)
    y: np.ndarray

    def at(self, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (2, m) [m] and velocities [m/s] at a time [s]."""
        k = int(np.clip(np.searchsorted(self.time, now, side="right") - 1, 0, len(self.time) - 2))
        long = self.time[k + 1] - self.time[k]
        part = (now - self.time[k]) / long
        before, after = np.stack([self.x[k], self.y[k]]), np.stack([self.x[k + 1], self.y[k + 1]])
        return before + part * (after - before), (after - before) / long


@dataclass(frozen=True)
class Flight:
    """The legs of a unit."""

    crew: Crew
    nodes: np.ndarray  # (n, 4): time [s], x, y [m], whether the leg to the next searches


def fly(tracks: Tracks, units: Sequence[Unit], spec: PlanSpec, manner: str) -> list[Flight]:
    """Return the legs of all units that have legs, laid out by hand in a manner of DRAWN or CHASED."""
    plane = record.plane(tracks)
    factor, weights = joint.nodes(units)
    few = record.sample(tracks, min(tracks.m, FEW))
    cloud = Cloud(few.time - few.time[0], *plane.flat(few.lon * sphere.UNIT, few.lat * sphere.UNIT))
    swarm = optimiser.swarm_of(few, spec, [None] * (int(few.scenario.max()) + 1), plane)
    left = np.outer(few.weight, weights)
    flights: list[Flight] = []
    for u, unit in enumerate(units):
        # it has no legs; its legs would have to wait for the day
        if unit.law.kind == "random" or unit.daylight:
            continue
        can = availability.of_unit(unit, spec, (plane.lon, plane.lat))
        crew = rectangle.crew(unit, can, plane, float(tracks.time[0]), factor[u])
        if manner in CHASED:
            paths = [_chased(crew, cloud, left.sum(axis=1), manner)]
        else:
            paths = list(_drawn(crew, cloud, left.sum(axis=1), manner))
        paths = [path for path in paths if len(path) > 1 and _clear(path, flights, spec.separation)]
        if not paths:
            continue
        later = np.zeros_like(left)
        gains = sweeps.gains(swarm, crew.table, paths, crew.width, crew.factor, left, later)
        best = Flight(crew, paths[int(np.argmax(gains))])
        chance, _ = sweeps.found(swarm, crew.table, best.nodes, crew.width, crew.factor)
        left = left * (1 - chance)
        flights.append(best)
    return flights


def _clear(nodes: np.ndarray, flights: Sequence[Flight], separation: float) -> bool:
    """Return whether what legs enclose keeps a distance [m] from what others enclose that are flown
    at the same time.
    """
    if separation <= 0:
        return True
    hull = shapely.MultiPoint(nodes[:, 1:3]).convex_hull
    near = False
    for other in flights:
        begins = float(max(nodes[0, 0], other.nodes[0, 0]))
        ends = float(min(nodes[-1, 0], other.nodes[-1, 0]))
        beside = float(hull.distance(shapely.MultiPoint(other.nodes[:, 1:3]).convex_hull))
        near |= begins < ends + rectangle.CLEAR and beside < separation
    return not near


def find(
    flights: Sequence[Flight],
    tracks: Tracks,
    units: Sequence[Unit],
    spec: PlanSpec,
    survival: Sequence[Survival | None],
) -> np.ndarray:
    """Return what flights find of each particle of tracks (m,), which need not be those that they
    were laid out on.
    """
    if not flights:
        return np.zeros(tracks.m)
    swarm = optimiser.swarm_of(tracks, spec, survival, flights[0].crew.plane)
    finds = []
    for flight in flights:
        crew, nodes = flight.crew, flight.nodes
        chance, worth = sweeps.found(swarm, crew.table, nodes, crew.width, crew.factor)
        finds.append(joint.Find((nodes[0, 0] + nodes[-1, 0]) / 2, chance, worth))
    return joint.worth(finds, joint.nodes(units)[1])


def _end(crew: Crew) -> float:
    """Return when a unit's search must end [s]."""
    return crew.available.spans[-1][1] - crew.zero


def _arrival(crew: Crew, spot: np.ndarray) -> float:
    """Return when a unit can be at a spot [m] at the earliest [s]."""
    return float(crew.available.arrival(*crew.plane.round(*spot))) - crew.zero


def _densest(here: np.ndarray, mass: np.ndarray, cell: float) -> np.ndarray:
    """Return which particles are in the cell of a grid that holds most, bool (m,)."""
    _, which = np.unique(np.floor(here / cell).astype(np.int64), axis=1, return_inverse=True)
    which = which.ravel()
    return np.asarray(which == int(np.argmax(np.bincount(which, mass))))


def _drawn(crew: Crew, cloud: Cloud, mass: np.ndarray, kind: str) -> Iterator[np.ndarray]:
    """Yield nodes of one pattern in several sizes, at two places, in two frames."""
    width, speed = crew.widest, crew.unit.search_speed
    base = np.array([float(v) for v in crew.plane.flat(*crew.available.base)])
    for densest in (False, True):
        spot = base
        for _ in range(2):  # where it is when the unit is there
            here, flow = cloud.at(min(max(_arrival(crew, spot), 0.0), _end(crew)))
            size = math.sqrt(width * speed * crew.available.search)
            some = _densest(here, mass, size) if densest else np.ones(len(mass), bool)
            share = np.where(some, mass, 0.0)
            share = share / share.sum()
            spot = here @ share
        start = max(_arrival(crew, spot), 0.0)
        search = min(crew.available.search, _end(crew) - start)
        if search < 60:
            continue
        middle, drift = spot + flow @ share * search / 2, flow @ share
        off = here - spot[:, None]
        axis = np.linalg.eigh((off * share) @ off.T)[1][:, -1]
        course = drift / max(float(np.hypot(*drift)), 1e-9)
        for moving in (False, True):
            frame = drift if moving else np.zeros(2)
            if np.hypot(*frame) > 0.8 * speed:
                continue
            datum = spot if moving or kind in ("square", "sector") else middle
            for points in PATTERNS[kind](speed * search, width):
                for way in (axis, course):
                    turned = points @ np.array([way, [way[1], -way[0]]])
                    begun = max(_arrival(crew, datum + turned[0]), 0.0)
                    shift = frame * (begun - start)
                    nodes = _timed(
                        datum + shift + turned, frame, begun, min(begun + search, _end(crew)), speed
                    )
                    if len(nodes) > 1:
                        yield nodes


def _timed(
    points: np.ndarray, frame: np.ndarray, start: float, end: float, speed: float
) -> np.ndarray:
    """Return nodes of legs through points (n, 2) of a frame that moves [m/s] from a start on, cut
    off at an end.
    """
    legs = np.diff(points, axis=0)
    along, rest = legs @ frame, speed**2 - float(frame @ frame)
    # |leg + frame t| = speed t
    took = (along + np.sqrt(along**2 + (legs**2).sum(axis=1) * rest)) / rest
    time = start + np.concatenate([[0.0], np.cumsum(took)])
    ground = points + frame * (time - start)[:, None]
    keep = int(np.searchsorted(time, end))
    if keep < len(time) and keep > 0:
        part = (end - time[keep - 1]) / (time[keep] - time[keep - 1])
        last = ground[keep - 1] + part * (ground[keep] - ground[keep - 1])
        time, ground = np.append(time[:keep], end), np.vstack([ground[:keep], last])
    fits = np.concatenate([[True], np.diff(time) > 1e-3])
    return np.column_stack([time[fits], ground[fits], np.ones(fits.sum())])


def _squares(track: float, width: float) -> Iterator[np.ndarray]:
    """Yield expanding squares that are as long as a track [m]."""
    for spacing in SPACINGS:
        count = min(math.ceil(2 * math.sqrt(track / (spacing * width))) + 1, MOST_POINTS)
        reach = (np.arange(count) // 2 + 1) * spacing * width
        step = reach[:, None] * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])[np.arange(count) % 4]
        yield np.vstack([[0.0, 0.0], np.cumsum(step, axis=0)])


def _sectors(track: float, width: float) -> Iterator[np.ndarray]:
    """Yield sector searches: three equilateral triangles through the datum, flown again turned by
    30 degrees.
    """
    for times in SECTORS:
        radius = track / 9 / times
        points = [np.zeros(2)]
        for number in range(3 * times):
            out = math.radians(240 * (number % 3) + 30 * (number // 3))
            points += [
                radius * np.array([math.cos(a), math.sin(a)]) for a in (out, out + math.pi / 3)
            ]
            points.append(np.zeros(2))
        yield np.array(points)


def _parallels(track: float, width: float, ratio: float = 1.0) -> Iterator[np.ndarray]:
    """Yield parallel legs of areas that are `ratio` times as wide as long."""
    for spacing in SPACINGS:
        step = spacing * width
        legs = max(round(math.sqrt(track * ratio / step)), 1)
        half = max((track + step) / legs - step, step) / 2
        if legs > MOST_POINTS:
            continue
        ends = np.where(np.arange(legs) % 2 == 0, -half, half)
        across = np.repeat((np.arange(legs) - (legs - 1) / 2) * step, 2)
        yield np.column_stack([np.column_stack([ends, -ends]).ravel(), across])


def _creeping(track: float, width: float) -> Iterator[np.ndarray]:
    """Yield creeping lines: legs across an area that is LONGEST times as long as wide."""
    for points in _parallels(track, width, LONGEST):
        yield points[:, ::-1]


PATTERNS: dict[str, Callable[[float, float], Iterator[np.ndarray]]] = {
    "square": _squares,
    "sector": _sectors,
    "parallel": _parallels,
    "creeping": _creeping,
}


def _chased(crew: Crew, cloud: Cloud, mass: np.ndarray, manner: str) -> np.ndarray:
    """Return nodes of legs that chase the densest spot of what is left."""
    width, speed, can = crew.widest, crew.unit.search_speed, crew.available
    base = np.array([float(v) for v in crew.plane.flat(*can.base)])
    hope, now, end = mass.copy(), can.leaves - crew.zero, _end(crew)
    nodes: list[tuple[float, float, float, float]] = []
    spot, until = base, end
    while now < end - 60:
        here, way = cloud.at(now)
        cell = np.floor(here / (3 * width)).astype(np.int64)
        _, which = np.unique(cell, axis=1, return_inverse=True)
        which = which.ravel()
        held = np.bincount(which, hope)
        if not nodes:  # fly to the densest spot, and be there when it is
            best = which == int(np.argmax(held))
            spot = here[:, best].mean(axis=1)
            now += float(np.hypot(*(spot - base))) / crew.unit.transit_speed
            if now >= end:
                break
            spot, until = cloud.at(now)[0][:, best].mean(axis=1), min(now + can.search, end)
            nodes.append((now, *spot, 1.0))
            continue
        middle = np.array([np.bincount(which, v) for v in here]) / np.bincount(which)
        gone = np.hypot(*(middle - spot[:, None]))
        best = which == int(np.argmax(held / (gone + 3 * width)))
        goal, flow = here[:, best].mean(axis=1), way[:, best].mean(axis=1)
        turn = flow / max(float(np.hypot(*flow)), 1e-9)
        legs = [goal - spot]
        if manner == "against":
            legs += [-6 * width * turn, np.array([-turn[1], turn[0]]) * width, 3 * width * turn]
        elif manner == "squares":
            sizes, ways = (
                (0.3, 0.3, 0.6, 0.6, 0.9, 0.9),
                ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 0), (0, 1)),
            )
            legs += [r * width * np.array(d) for r, d in zip(sizes, ways, strict=True)]
        for leg in legs:
            long = float(np.hypot(*leg))
            share = min(1.0, (until - now) * speed / max(long, 1e-9))
            if long * share < 1.0:
                continue
            spot, now = spot + leg * share, now + long * share / speed
            nodes.append((now, *spot, 1.0))
            hope[
                np.hypot(*(cloud.at(min(now, cloud.time[-1]))[0] - spot[:, None])) < 0.7 * width
            ] *= 0.4
        if nodes[-1][0] < now + 1e-9 and len(legs) == 1 and float(np.hypot(*legs[0])) < 1.0:
            now += 60.0  # it is there already
        hope[best] *= 0.5
        if now >= until - 1:
            break
    return np.array(nodes).reshape(-1, 4)
