"""Rectangles that a unit can search by parallel sweeps, or by patterns in their place: from free
numbers to tracks.

A rectangle is a row (x, y, orientation, log spacing, log of length over width, wait, along,
across): centre [m] on the plane, orientation [rad], seconds waited beyond the earliest arrival, and
the corner of commencement (-1 or 1 each, as drift.evidence.filter.patterns). Legs are whole: n legs
of L - S and n - 1 cross legs of S are n L - S of track, which the search time fills. Of a square or
a sector search the centre is its datum and the corner its hand. Where a crew's manner drifts, the
centre is where the frame is when the search begins.
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
SHORTEST = 600.0  # [s] of search that is worth a sortie, of a unit that can search for longer
CLEAR = 300.0  # [s] that an area must have been left before one beside it is searched
SLIMMEST = 2.0  # a leg's rectangle is at least so many spacings long
LEAST_SEA = 0.3  # least share of a boat's rectangle that is sea
FITS = 5  # lengths that are tried until legs cut at the coast fill the time there is
FULL = 0.97  # share of the time that is full enough
STEP = 0.01  # of coverage in the tables of b
MOST = 12.0  # largest coverage there


@dataclass(frozen=True)
class Crew:
    """A unit as the optimiser takes it."""

    unit: Unit
    available: Availability
    plane: Plane
    zero: float  # [s since 1970] that times are counted from
    # sweep width [m] by scenario, (scenarios,); where some steer by state too, (2, scenarios)
    width: Array
    factor: Array  # (nodes,) of the sweep width, at the joint nodes of all unknown factors
    curve: Array  # b at multiples of STEP of coverage
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
        """The shortest search that is worth its sortie [s]: all of its time, where that is short."""
        return min(SHORTEST, self.available.search)

    @property
    def widest(self) -> float:
        """Its greatest sweep width [m]."""
        return float(np.max(self.width))


def crew(
    unit: Unit,
    available: Availability,
    plane: Plane,
    zero: float,
    factor: Array,
    course: Course | None = None,
) -> Crew:
    """Return a unit as the optimiser takes it."""
    curve = laws.pod(unit.law, np.arange(round(MOST / STEP) + 1) * STEP)
    table = None
    if laws.formulas_of(unit.law).detects == "abeam":
        table = np.column_stack(laws.range_curve(unit.law)).ravel()
    width = np.array(
        [unit.sweep_width, unit.width_under_way] if unit.width_under_way else unit.sweep_width
    )
    return Crew(unit, available, plane, zero, width, factor, curve, table, course)


class Sweeps(NamedTuple):
    """Rectangles as they would be flown, (c,) each."""

    start: Array  # [s] after the crew's zero
    duration: Array  # [s] of search; of a boat with the ways round what cuts its legs
    legs: Array
    spacing: Array  # [m]
    length: Array  # [m]
    width: Array
    possible: Array  # bool
    # of objects: nodes of a boat's legs, cut at the coast, as `path` returns them; None: they are
    # whole
    sailed: Array
    moved: Array  # [m] (c, 2) by which the frame goes east and north while they are searched


def fly(crew: Crew, rows: Array, corner: bool = False) -> Sweeps:
    """Return what becomes of rectangles when their search time is filled.

    corner: times by where they commence, not by their centres.
    """
    manner, spacing = crew.manner, np.exp(rows[:, SPACING])
    x, y = rows[:, X], rows[:, Y]
    legs = length = width = np.zeros(len(rows))
    start, duration = legs, legs
    for turn in range(3 if corner else 1):
        if turn and manner.pattern == "parallel":
            x, y = commence(rows, length, spacing, legs)
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
    flown = Sweeps(start - crew.zero, duration, legs, spacing, length, width, possible, none, moved)
    return _at_sea(crew, rows, flown, corner)


def _at_sea(crew: Crew, rows: Array, flown: Sweeps, sailed: bool) -> Sweeps:
    """Return rectangles of a boat, those that are mostly land being impossible.

    sailed: with legs as the boat can sail them in its time. Units that are no boats near land get
    theirs unchanged.
    """
    if crew.course is None:
        return flown
    possible = flown.possible & (share(crew, rows, flown) >= LEAST_SEA)
    flown = flown._replace(possible=possible)
    if not sailed or crew.random:
        return flown
    if not crew.manner.plain:
        for k in np.flatnonzero(possible):
            legs = legs_of(crew, rows[k], flown, int(k))
            clear = not courses.crosses(crew.course, np.array(legs.lon), np.array(legs.lat))
            possible[k] = clear and _in_time(crew, flown, legs, int(k))
        return flown
    flown = Sweeps(*(np.array(values) for values in flown))
    cross = []
    for k in np.flatnonzero(possible):
        legs = laid(crew, rows[k], flown, int(k)).pattern.legs
        if courses.crosses(crew.course, np.array(legs.lon), np.array(legs.lat)) or not _in_time(
            crew, flown, legs, int(k)
        ):
            cross.append(int(k))
    _sail(crew, rows, flown, cross)
    return flown


def _in_time(crew: Crew, flown: Sweeps, legs: Legs, k: int) -> bool:
    """Return whether a boat can be where legs begin when they do, and get home from where they end."""
    assert crew.course is not None
    first, last = ((legs.lon[j], legs.lat[j]) for j in (0, -1))
    there = courses.distance(crew.course, crew.course.out, first) / crew.unit.transit_speed
    home = courses.distance(crew.course, crew.course.home, last)
    return crew.available.leaves + there <= crew.zero + float(flown.start[k]) and math.isfinite(
        home
    )


def _sail(crew: Crew, rows: Array, flown: Sweeps, which: list[int]) -> None:
    """Give rectangles legs cut at the coast, and the length with which these fill their time.

    flown: changed in place; a rectangle of which no length fits becomes impossible. which: numbers
    of rectangles.
    """
    whole = flown._replace(length=flown.length.copy())
    most = np.full(len(rows), crew.shortest)
    flown.possible[which] = False
    for _ in range(FITS):
        which = [k for k in which if whole.length[k] >= SLIMMEST * flown.spacing[k]]
        if not which:
            return
        sailed = cut_at_coast(crew, [laid(crew, rows[k], whole, k) for k in which])
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
                    whole.length[k],
                    start - crew.zero,
                    took,
                )
                flown.possible[k] = True
                x, y = crew.plane.flat(np.radians(sailing.lon), np.radians(sailing.lat))
                flown.sailed[k] = np.column_stack(
                    [flown.start[k] + sailing.elapsed, x, y, np.append(sailing.searching, False)]
                )
            if not FULL * room <= took <= room:
                whole.length[k] *= 0.995 * room / took
                again.append(k)
        which = again


class Laid(NamedTuple):
    """A rectangle on the sphere, its legs in the half turn from north."""

    centre: tuple[float, float]  # (lon, lat) [deg]
    turn: float  # [rad] orientation, 0 to pi
    corner: tuple[int, int]
    pattern: Pattern


def laid(crew: Crew, row: Array, flown: Sweeps, k: int) -> Laid:
    """Return rectangle k as it is flown, in whole seconds as a case file has them: later to begin."""
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
    """Return the legs of search k on the sphere, before any is cut at the coast, in whole seconds
    to begin with.
    """
    if crew.manner.plain:
        return laid(crew, row, flown, k).pattern.legs
    nodes = path(crew, row, flown, k)
    return polyline.legs_through(
        crew.zero + nodes[:, 0], *np.degrees(crew.plane.round(nodes[:, 1], nodes[:, 2]))
    )


def cut_at_coast(crew: Crew, whole: Sequence[Laid]) -> list[Sailed | None]:
    """Return a boat's legs of several rectangles cut at the coast; None where it can sail none."""
    assert crew.course is not None
    legs = [
        (np.array(rectangle.pattern.legs.lon), np.array(rectangle.pattern.legs.lat))
        for rectangle in whole
    ]
    return courses.sail(crew.course, legs, crew.unit.search_speed, crew.unit.transit_speed)


def share(crew: Crew, rows: Array, flown: Sweeps) -> Array:
    """Return which share of rectangles is sea where the unit can get, (c,)."""
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


def commence(rows: Array, length: Array, spacing: Array, legs: Array) -> tuple[Array, Array]:
    """Return (x, y) [m] of the points where the searches commence."""
    along = rows[:, ALONG] * (length - spacing) / 2
    across = rows[:, ACROSS] * (legs - 1) / 2 * spacing
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    return rows[:, X] + along * sin + across * cos, rows[:, Y] + along * cos - across * sin


def smeared(crew: Crew, rows: Array, flown: Sweeps) -> tuple[Array, Array]:
    """Return rectangles for kernels.planning.rectangles, (c, 9), and their coverage.

    Coverage is by scenario (c, scenarios), or by state and scenario (c, 2, scenarios), as
    crew.width.
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
    # Land in a boat's rectangle costs it about as much time, going round, as it saves.
    track = crew.unit.search_speed * duration * share(crew, rows, flown)
    swept = track / np.maximum(flown.length * flown.width, 1.0)
    return table, crew.width * swept.reshape(-1, *[1] * crew.width.ndim)


def path(crew: Crew, row: Array, flown: Sweeps, k: int) -> Array:
    """Return the nodes of rectangle k, (n, 4).

    Columns: time [s after zero], x, y [m], whether the leg to the next searches.
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
        whole = math.ceil(crew.zero + start) - crew.zero
        return manners.ground(x, y, manner, whole, float(flown.duration[k]), speed)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(along), np.diff(across)))])
    return np.column_stack([start + way / speed, x, y, np.ones(2 * legs)])


def hull(rows: Array, flown: Sweeps) -> tuple[Array, Array]:
    """Return (centre, half of the sides) [m], (2, c) each, of rectangles that hold the whole
    search.

    Their orientation is that of the rows, sides are along it and across it.
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


def apart(rows: Array, flown: Sweeps, row: Array, other: Sweeps) -> Array:
    """Return the distance [m] of rectangles from one other, inf if they are not searched at the
    same time.

    Where they overlap it is minus the way that would part them.
    """
    sin, cos = np.sin(rows[:, TURN]), np.cos(rows[:, TURN])
    (centre, half), (place, beside) = hull(rows, flown), hull(row[None, :], other)
    own, size = np.array([math.sin(row[TURN]), math.cos(row[TURN])]), beside[:, 0]
    dx, dy = place - centre
    # Corners of each in the other's own directions: along, across.
    nearest = np.full(len(rows), np.inf)
    # gap along the direction that parts them most: separating axes
    deepest = np.full(len(rows), -np.inf)
    # of the other, seen from each
    turn_sin, turn_cos = own[0] * cos - own[1] * sin, own[1] * cos + own[0] * sin
    there = np.stack([dx * sin + dy * cos, dx * cos - dy * sin])
    back = np.stack([-dx * own[0] - dy * own[1], -dx * own[1] + dy * own[0]])
    for place, mine, yours, s in (
        (there, half, np.broadcast_to(size[:, None], half.shape), turn_sin),
        (back, np.broadcast_to(size[:, None], half.shape), half, -turn_sin),
    ):
        corners = []
        for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            u, v = a * yours[0], b * yours[1]
            corners.append(
                np.stack([place[0] + u * turn_cos - v * s, place[1] + u * s + v * turn_cos])
            )
        at = np.stack(corners)
        gap = np.maximum(np.abs(at) - mine, 0)
        nearest = np.minimum(nearest, np.hypot(gap[:, 0], gap[:, 1]).min(axis=0))
        deepest = np.maximum(
            deepest, np.maximum(at.min(axis=0) - mine, -mine - at.max(axis=0)).max(axis=0)
        )
    together = (flown.start < other.start[0] + other.duration[0] + CLEAR) & (
        other.start[0] < flown.start + flown.duration + CLEAR
    )
    return np.where(together, np.where(deepest < 0, deepest, nearest), np.inf)
