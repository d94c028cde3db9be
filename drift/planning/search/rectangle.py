"""Rectangles that a unit searches by parallel sweeps or another pattern: parameters to tracks.

A rectangle is a row (x, y, orientation, log spacing, log of length over width, wait, along,
across): centre [m] on the plane, orientation [rad], seconds of wait beyond the earliest arrival,
and the corner of commencement (-1 or 1 each, as in drift.evidence.filter.patterns). The number of
legs is whole: n legs of L - S and n - 1 cross legs of S are n L - S of track, which uses the whole
search time. For a square or a sector search the centre is its datum and the corner its handedness.
If a crew's frame drifts, the centre is that of the frame at the begin of the search.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drift.evidence.filter import patterns
from drift.evidence.filter.detection import laws
from drift.evidence.filter.patterns import Pattern
from drift.evidence.filter.records import Unit
from drift.planning.search import manners
from drift.planning.search.boats import courses
from drift.planning.search.boats.availability import Availability
from drift.planning.search.boats.courses import Course, Sailed
from drift.planning.search.manners import PLAIN, Manner
from drift.planning.search.planning_tracks import Plane
from geo import polyline
from geo.array import Array
from geo.polyline import Legs

X, Y, TURN, SPACING, ASPECT, WAIT, ALONG, ACROSS = range(8)
SHORTEST = 600.0  # [s] shortest search worth a sortie, for a unit that can search for longer
CLEAR = 300.0  # [s] from the end of one search to the begin of one beside it
SLIMMEST = 2.0  # a leg's rectangle is at least so many spacings long
LEAST_SEA = 0.3  # least share of a boat's rectangle that is sea
FITS = 5  # most lengths tried until legs cut at the coast use the available time
FULL = 0.97  # share of the available time at which that search ends
STEP = 0.01  # of coverage in the table of detection probability
MOST = 12.0  # largest coverage in that table
CORNERS = np.array([[1, 1, -1, -1], [1, -1, 1, -1]])  # sides of a rectangle's corners


@dataclass(frozen=True)
class Crew:
    """A unit in the form that the optimiser uses."""

    unit: Unit
    available: Availability
    plane: Plane
    zero: float  # [s since 1970] that times are counted from
    # sweep width [m] by scenario, (scenarios,); if some steer, by state as well, (2, scenarios)
    width: Array
    factor: Array  # (nodes,) of the sweep width, at the joint nodes of all unknown factors
    curve: Array  # detection probability at multiples of STEP of coverage
    # lateral range curve of a law without a rate: range / W, chance, ...; None: it has a rate
    table: Array | None
    course: Course | None = None  # of a boat near land; None: straight on
    manner: Manner = PLAIN  # how it lays its legs

    @property
    def random(self) -> bool:
        """Whether it searches at random, without legs."""
        return laws.formulas_of(self.unit.law).detects == "anywhere"

    @property
    def shortest(self) -> float:
        """Shortest search that is worth a sortie [s]; all of its search time if that is less."""
        return min(SHORTEST, self.available.search)

    @property
    def widest(self) -> float:
        """Greatest sweep width [m]."""
        return float(np.max(self.width))


def crew(
    unit: Unit,
    available: Availability,
    plane: Plane,
    zero: float,
    factor: Array,
    course: Course | None = None,
) -> Crew:
    """Return a unit in the form that the optimiser uses.

    Args:
        unit: of the case.
        available: when the unit can search where.
        plane: of the plan.
        zero: first time of the tracks [s since 1970].
        factor: of the sweep width at each joint node, shape (nodes,).
        course: of a boat near land; None: straight on.
    """
    curve = laws.pod(unit.law, np.arange(round(MOST / STEP) + 1) * STEP)
    table = None
    if laws.formulas_of(unit.law).detects == "abeam":
        table = np.column_stack(laws.range_curve(unit.law)).ravel()
    width = np.array(
        [unit.sweep_width, unit.width_under_way] if unit.width_under_way else unit.sweep_width
    )
    return Crew(unit, available, plane, zero, width, factor, curve, table, course)


class Sweeps(NamedTuple):
    """Rectangles as they would be flown, shape (c,) each."""

    start: Array  # [s] after the crew's zero
    duration: Array  # [s] of search; for a boat including the ways round land
    legs: Array
    spacing: Array  # [m]
    length: Array  # [m]
    width: Array
    possible: Array  # bool
    # of objects: nodes of a boat's legs, cut at the coast, as `path` returns them; None: they are
    # whole
    sailed: Array
    moved: Array  # [m] (c, 2) drift of the frame, east and north, during the search
    sea: Array  # share of the rectangle that is sea within the unit's reach


def fly(crew: Crew, rows: Array, corner: bool = False) -> Sweeps:
    """Return rectangles as they would be flown in the time that is available.

    Args:
        crew: the unit.
        rows: rectangles, shape (c, 8).
        corner: True: times are those at the commence search point; False: at the centre.
    """
    manner, spacing = crew.manner, np.exp(rows[:, SPACING])
    x, y = rows[:, X], rows[:, Y]
    legs = length = width = np.zeros(len(rows))
    start, duration = legs, legs
    for turn in range(3 if corner else 1):
        if turn and manner.pattern == "parallel":
            x, y = _commence(rows, length, spacing, legs)
        start, duration = crew.available.slot(
            crew.available.arrival(*crew.plane.round(x, y)) + rows[:, WAIT]
        )
        track = crew.unit.search_speed * duration
        if not turn:
            ratio = np.exp(rows[:, ASPECT])
            legs, spacing, length, width = manners.PATTERNS[manner.pattern].size(
                track, spacing, ratio
            )
        if manner.pattern == "parallel":
            length = (track + spacing) / legs
    possible = (
        (duration >= crew.shortest)
        & (length >= SLIMMEST * spacing)
        & (spacing >= crew.unit.least_spacing)
    )
    none = np.full(len(rows), None, object)
    moved = np.outer(duration, [manner.east, manner.north])
    sizes = legs, spacing, length, width
    sea = np.ones(len(rows))
    flown = Sweeps(start - crew.zero, duration, *sizes, possible, none, moved, sea)
    return _at_sea(crew, rows, flown, corner)


def _at_sea(crew: Crew, rows: Array, flown: Sweeps, sailed: bool) -> Sweeps:
    """Return rectangles of a boat; those that are mostly land become impossible.

    sailed: whether legs are cut at the coast and fitted to the boat's time. Rectangles of other
    units are unchanged.
    """
    if crew.course is None:
        return flown
    sea = share(crew, rows, flown)
    possible = flown.possible & (sea >= LEAST_SEA)
    flown = flown._replace(possible=possible, sea=sea)
    if not sailed or crew.random:
        return flown
    which = np.flatnonzero(possible)
    legs = [legs_of(crew, rows[k], flown, int(k)) for k in which]
    crossed = [courses.crosses(crew.course, np.array(own.lon), np.array(own.lat)) for own in legs]
    whole = np.flatnonzero(np.logical_not(crossed))
    in_time = np.zeros(len(which), bool)
    in_time[whole] = _in_time(crew, flown.start[which[whole]], [legs[k] for k in whole])
    if not crew.manner.plain:
        possible[which] = in_time
        return flown
    flown = Sweeps(*(np.array(values) for values in flown))
    _sail(crew, rows, flown, which[~in_time].tolist())
    return flown


def _in_time(crew: Crew, start: Array, legs: Sequence[Legs]) -> Array:
    """Return whether a boat can reach legs in time and get home from their end, bool (n,).

    start: when each begins [s after the crew's zero], shape (n,).
    """
    course = crew.course
    assert course is not None
    first, last = (
        course.sea.flat([own.lon[k] for own in legs], [own.lat[k] for own in legs]) for k in (0, -1)
    )
    there = courses.distances(course, course.out, first) / crew.unit.transit_speed
    home = courses.distances(course, course.home, last)
    return (crew.available.leaves + there <= crew.zero + start) & np.isfinite(home)


def _sail(crew: Crew, rows: Array, flown: Sweeps, which: list[int]) -> None:
    """Cut rectangles' legs at the coast, and choose the length that uses the available time.

    flown: changed in place; a rectangle of which no length fits becomes impossible. which: indices
    of rectangles.
    """
    uncut = flown._replace(length=flown.length.copy())
    most = np.full(len(rows), crew.shortest)
    flown.possible[which] = False
    for _ in range(FITS):
        which = [k for k in which if uncut.length[k] >= SLIMMEST * flown.spacing[k]]
        if not which:
            return
        sailed = cut_at_coast(crew, [laid(crew, rows[k], uncut, k) for k in which])
        again = []
        for k, sailing in zip(which, sailed, strict=True):
            if sailing is None or math.isinf(sailing.home):
                continue
            there = crew.available.leaves + sailing.out / crew.unit.transit_speed
            start, room = (float(v) for v in crew.available.slot(there + rows[k, WAIT]))
            took = float(sailing.elapsed[-1])
            sought = float(np.diff(sailing.elapsed)[sailing.searching].sum())
            if took <= room and sought > most[k]:
                most[k] = sought
                flown.length[k], flown.start[k], flown.duration[k] = (
                    uncut.length[k],
                    start - crew.zero,
                    took,
                )
                flown.possible[k] = True
                x, y = crew.plane.flat(np.radians(sailing.lon), np.radians(sailing.lat))
                flown.sailed[k] = np.column_stack(
                    [flown.start[k] + sailing.elapsed, x, y, np.append(sailing.searching, False)]
                )
            if not FULL * room <= took <= room:
                uncut.length[k] *= 0.995 * room / took
                again.append(k)
        which = again


class Laid(NamedTuple):
    """A rectangle on the sphere, with its orientation in the half turn from north."""

    centre: tuple[float, float]  # (lon, lat) [deg]
    turn: float  # [rad] orientation, 0 to pi
    corner: tuple[int, int]
    pattern: Pattern


def laid(crew: Crew, row: Array, flown: Sweeps, k: int) -> Laid:
    """Return rectangle k as flown, with its begin rounded up to a whole second."""
    turn, corner = float(row[TURN]) % (2 * math.pi), (int(row[ALONG]), int(row[ACROSS]))
    if turn >= math.pi:  # legs run both ways
        turn, corner = turn - math.pi, (-corner[0], -corner[1])
    lon, lat = (math.degrees(float(v)) for v in crew.plane.round(row[X], row[Y]))
    start, size = (
        math.ceil(crew.zero + float(flown.start[k])),
        (float(flown.length[k]), float(flown.width[k])),
    )
    spacing, speed = float(flown.spacing[k]), crew.unit.search_speed
    return Laid(
        (lon, lat),
        turn,
        corner,
        patterns.parallel((lon, lat), *size, turn, spacing, start, speed, corner),
    )


def legs_of(crew: Crew, row: Array, flown: Sweeps, k: int) -> Legs:
    """Return the legs of search k on the sphere, in whole seconds, before cuts at the coast."""
    if crew.manner.plain:
        return laid(crew, row, flown, k).pattern.legs
    nodes = path(crew, row, flown, k)
    return polyline.legs_through(
        crew.zero + nodes[:, 0], *np.degrees(crew.plane.round(nodes[:, 1], nodes[:, 2]))
    )


def cut_at_coast(crew: Crew, rectangles: Sequence[Laid]) -> list[Sailed | None]:
    """Return a boat's legs of several rectangles cut at the coast; None: no leg is left."""
    assert crew.course is not None
    legs = [
        (np.array(rectangle.pattern.legs.lon), np.array(rectangle.pattern.legs.lat))
        for rectangle in rectangles
    ]
    return courses.sail(crew.course, legs, crew.unit.search_speed, crew.unit.transit_speed)


def share(crew: Crew, rows: Array, flown: Sweeps) -> Array:
    """Return the share of each rectangle that is sea within the unit's reach, shape (c,)."""
    if crew.course is None:
        return np.ones(len(rows))
    ticks = (np.arange(courses.SAMPLES) + 0.5) / courses.SAMPLES - 0.5
    along, across = (
        v.ravel()[None, :] * size[:, None]
        for v, size in zip(np.meshgrid(ticks, ticks), (flown.length, flown.width), strict=True)
    )
    sin, cos = np.sin(rows[:, TURN])[:, None], np.cos(rows[:, TURN])[:, None]
    x, y = (
        rows[:, X, None] + along * sin + across * cos,
        rows[:, Y, None] + along * cos - across * sin,
    )
    return crew.course.share(*crew.plane.round(x, y))


def _commence(rows: Array, length: Array, spacing: Array, legs: Array) -> tuple[Array, Array]:
    """Return (x, y) [m] of the commence search points, each of shape (c,).

    Args:
        rows: rectangles, shape (c, 8).
        length: of the rectangles [m], shape (c,).
        spacing: of the legs [m], shape (c,).
        legs: number of legs, shape (c,).
    """
    along = rows[:, ALONG] * (length - spacing) / 2
    across = rows[:, ACROSS] * (legs - 1) / 2 * spacing
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    return rows[:, X] + along * sin + across * cos, rows[:, Y] + along * cos - across * sin


def smeared(crew: Crew, rows: Array, flown: Sweeps) -> tuple[Array, Array]:
    """Return rectangles for kernels.planning.rectangles, (c, 9), and their coverage.

    Coverage is by scenario (c, scenarios), or by state and scenario (c, 2, scenarios), as
    `crew.width`.
    """
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    duration = np.maximum(flown.duration, 1.0)
    table = np.column_stack(
        [
            rows[:, X],
            rows[:, Y],
            sin,
            cos,
            flown.length,
            flown.width,
            flown.start,
            duration,
            -rows[:, ACROSS],
        ]
    )
    # Land saves a boat about as much search time as going round it costs.
    track = crew.unit.search_speed * duration * flown.sea
    swept = track / np.maximum(flown.length * flown.width, 1.0)
    return table, crew.width * swept.reshape(-1, *[1] * crew.width.ndim)


def path(crew: Crew, row: Array, flown: Sweeps, k: int) -> Array:
    """Return the nodes of rectangle k, shape (n, 4).

    Columns: time [s after zero], x, y [m], and whether the leg to the next node searches.
    """
    if flown.sailed[k] is not None:
        return np.asarray(flown.sailed[k])
    legs, spacing, manner, speed = (
        int(flown.legs[k]),
        float(flown.spacing[k]),
        crew.manner,
        crew.unit.search_speed,
    )
    pattern = manners.PATTERNS[manner.pattern]
    along, across = pattern.points(
        legs, spacing, float(flown.length[k]), float(row[ALONG]), float(row[ACROSS])
    )
    sin, cos = math.sin(row[TURN]), math.cos(row[TURN])
    x, y, start = (
        row[X] + along * sin + across * cos,
        row[Y] + along * cos - across * sin,
        float(flown.start[k]),
    )
    if not manner.plain:
        begin = math.ceil(crew.zero + start) - crew.zero
        return manners.ground(x, y, manner, begin, float(flown.duration[k]), speed)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(along), np.diff(across)))])
    return np.column_stack([start + way / speed, x, y, np.ones(2 * legs)])


def _hull(rows: Array, flown: Sweeps) -> tuple[Array, Array]:
    """Return rectangles that enclose the whole search, with the drift of its frame.

    Returns:
        Centres and half sides [m], shape (2, c) each. Sides are along and across the rows'
            orientation.
    """
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    east, north = flown.moved.T
    side = np.stack(
        [
            flown.length + np.abs(east * sin + north * cos),
            flown.width + np.abs(east * cos - north * sin),
        ]
    )
    return np.stack([rows[:, X] + east / 2, rows[:, Y] + north / 2]), side / 2


def apart(rows: Array, flown: Sweeps, others: Array, beside: Sweeps) -> Array:
    """Return the distances [m] of rectangles from others, shape (k, c).

    They are inf if they are not searched at the same time. If they overlap it is minus the shortest
    displacement that separates them.

    Args:
        rows: rectangles, shape (c, 8).
        flown: the same as they would be flown.
        others: the other rectangles, shape (k, 8).
        beside: the same as they would be flown.
    """
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    (centre, half), (place, size) = _hull(rows, flown), _hull(others, beside)
    half, size = half[:, None], size[:, :, None]
    own_sin, own_cos = (np.array([[f(t)] for t in others[:, TURN]]) for f in (math.sin, math.cos))
    dx, dy = place[:, :, None] - centre[:, None]
    # Express the corners of each in the other's axes: along, across.
    nearest = np.full(dx.shape, np.inf)
    # largest gap along any axis (separating axes)
    deepest = np.full(dx.shape, -np.inf)
    # orientation of the other rectangle, relative to each
    turn_sin, turn_cos = own_sin * cos - own_cos * sin, own_cos * cos + own_sin * sin
    there = dx * sin + dy * cos, dx * cos - dy * sin
    back = -dx * own_sin - dy * own_cos, -dx * own_cos + dy * own_sin
    a, b = CORNERS[:, :, None, None]
    for (along, across), mine, yours, s in (
        (there, half, size, turn_sin),
        (back, size, half, -turn_sin),
    ):
        u, v = a * yours[0], b * yours[1]
        at = np.stack([along + u * turn_cos - v * s, across + u * s + v * turn_cos], axis=1)
        gap = np.maximum(np.abs(at) - mine, 0)
        nearest = np.minimum(nearest, np.hypot(gap[:, 0], gap[:, 1]).min(axis=0))
        deepest = np.maximum(
            deepest, np.maximum(at.min(axis=0) - mine, -mine - at.max(axis=0)).max(axis=0)
        )
    start, end = beside.start[:, None], (beside.start + beside.duration)[:, None]
    together = (flown.start < end + CLEAR) & (start < flown.start + flown.duration + CLEAR)
    return np.where(together, np.where(deepest < 0, deepest, nearest), np.inf)
