"""Candidate rectangles of units, their value at a stage of the optimiser, and taskings."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.evidence.filter import patterns
from drift.evidence.filter.records import Sortie
from drift.planning.search import joint, rectangle
from drift.planning.search.boats import availability, courses, swept
from drift.planning.search.boats.swept import Swept
from drift.planning.search.joint import Find
from drift.planning.search.records import Tasking
from drift.planning.search.rectangle import Crew, Sweeps
from geo import polyline
from geo.array import Array
from geo.polyline import LonLat
from kernels.planning import rectangles, sweeps

PART = 0.2  # share of a wait below which its cause is not reported


@dataclass(frozen=True)
class Stage:
    """Particles, and how rectangles are scored on them."""

    m: int
    swarm: rectangles.Swarm
    weight: Array  # (m,)
    nodes: Array  # (nodes,) weights of the joint nodes
    executed: bool  # True: legs are scored as flown; False: smeared out over the rectangle
    separation: float  # [m] that units keep apart
    # share of the gain lost if a rectangle is its own size too near to another; inf: forbidden
    price: float = math.inf


@dataclass(frozen=True)
class Choice:
    """A unit's rectangle, and its detection probabilities."""

    crew: Crew
    row: Array
    flown: Sweeps
    find: Find


Plan = list[Choice | None]  # one for each unit; None: it cannot search, or has no rectangle yet


def choose(crew: Crew, row: Array, stage: Stage) -> Choice:
    """Return a rectangle with its detection probabilities at a stage.

    Args:
        crew: the unit.
        row: the rectangle's parameters, shape (8,), see drift.planning.search.rectangle.
        stage: particles, and how rectangles are scored.
    """
    flown = rectangle.fly(crew, row[None, :], stage.executed)
    if stage.executed and not crew.random:
        chance, worth = sweeps.found(
            stage.swarm, crew.table, rectangle.path(crew, row, flown, 0), crew.width, crew.factor
        )
    else:
        table, coverage = rectangle.smeared(crew, row[None, :], flown)
        chance, worth = rectangles.found(
            stage.swarm, crew.random, table, coverage[0], crew.factor, rectangle.STEP, crew.curve
        )
    return Choice(
        crew, row, flown, Find(float(flown.start[0] + flown.duration[0] / 2), chance, worth)
    )


def at_stage(plan: Plan, stage: Stage) -> Plan:
    """Return the same rectangles scored at another stage; those impossible there are dropped."""
    chosen = [choice and choose(choice.crew, choice.row, stage) for choice in plan]
    return [choice if choice and choice.flown.possible[0] else None for choice in chosen]


def value(plan: Plan, stage: Stage) -> float:
    """Return the value of a plan at a stage."""
    finds = [choice.find for choice in plan if choice is not None]
    return float(stage.weight @ joint.worth(finds, stage.nodes)) if finds else 0.0


def too_near(others: Sequence[Choice], rows: Array, flown: Sweeps, stage: Stage) -> Array:
    """Return how much too near [m] rectangles are to other units', shape (k, c); 0: clear.

    Args:
        others: rectangles of the other units, k of them.
        rows: candidate rectangles, shape (c, 8).
        flown: the same as they would be flown.
        stage: with the separation that units keep.
    """
    if stage.separation <= 0 or not others:
        return np.zeros((len(others), len(rows)))
    beside = Sweeps(*map(np.concatenate, zip(*(other.flown for other in others), strict=True)))
    places = np.stack([other.row for other in others])
    return np.maximum(stage.separation - rectangle.apart(rows, flown, places, beside), 0.0)


def apart(plan: Plan, stage: Stage) -> bool:
    """Return True if units that search at the same time keep their separation."""
    chosen = [choice for choice in plan if choice is not None]
    return not any(
        np.any(too_near(chosen[:k], choice.row[None, :], choice.flown, stage) > 0)
        for k, choice in enumerate(chosen)
    )


def taskings(chosen: Sequence[Choice], stage: Stage) -> tuple[Tasking, ...]:
    """Return taskings in the order of the middle of their search.

    Each POS is conditional on the failure of the earlier searches.
    """
    ordered = sorted(chosen, key=lambda choice: choice.find.time)
    undetected = np.broadcast_to(stage.nodes, ordered[0].find.chance.shape).copy()
    result = []
    for choice in ordered:
        missed = undetected * (1 - choice.find.chance)
        before = float(stage.weight @ undetected.sum(axis=1))
        pos = 1 - float(stage.weight @ missed.sum(axis=1)) / before if before > 0 else 0.0
        result.append(replace(_tasking(choice, pos), waits=waits(choice, chosen, stage)))
        undetected = missed
    return tuple(result)


def waits(choice: Choice, chosen: Sequence[Choice], stage: Stage) -> str:
    """Return why a unit searches later than it could: daylight, separation, or better chances."""
    crew, start = choice.crew, float(choice.flown.start[0])
    row = choice.row.copy()
    row[rectangle.WAIT] = 0.0
    spans = crew.available.spans
    any_hour = replace(crew, available=replace(crew.available, spans=((-math.inf, spans[-1][1]),)))
    earliest = float(rectangle.fly(any_hour, row[None, :], stage.executed).start[0])
    at_once = rectangle.fly(crew, row[None, :], stage.executed)
    light = float(at_once.start[0])
    others = [other for other in chosen if other is not choice]
    close = too_near(others, row[None, :], at_once, stage)[:, 0] > 0
    near = [other.crew.unit.name for other, so in zip(others, close, strict=True) if so]
    if start - earliest < 1:
        return ""
    reasons = ["for daylight"] * (light - earliest >= PART * (start - earliest))
    if start - light >= PART * (start - earliest):
        night = any(light < begin - crew.zero <= start for begin, _ in spans)
        # it gets dark before the search is complete
        if night and at_once.duration[0] < (1 - PART) * choice.flown.duration[0]:
            reasons.append("for daylight")
        elif near:
            reasons.append(f"to keep clear of {' and '.join(near)}")
        else:
            reasons.append("more is found then")
    return ", then ".join(dict.fromkeys(reasons))


def _tasking(choice: Choice, pos: float) -> Tasking:
    """Return a rectangle as a tasking with its legs and times."""
    crew, flown, unit = choice.crew, choice.flown, choice.crew.unit
    laid = rectangle.laid(crew, choice.row, flown, 0)
    spacing, length, width = (float(v[0]) for v in (flown.spacing, flown.length, flown.width))
    legs, cut = rectangle.legs_of(crew, choice.row, flown, 0), tuple[int, ...]()
    searched = Swept(laid.centre, length, width, laid.turn, int(flown.legs[0]), 0, 1.0)
    if not crew.manner.plain:
        searched = _enclosing_area(choice, laid.turn)
    start = float(legs.time[0])
    if flown.sailed[0] is not None:
        (sailed,) = rectangle.cut_at_coast(crew, [laid])
        assert sailed is not None  # the same legs could be sailed before
        legs = polyline.legs_through(
            start + sailed.elapsed, sailed.lon, sailed.lat, sailed.searching.tolist()
        )
        assert crew.course is not None
        searched = swept.area(laid, sailed, length, spacing, crew.course.share)
        # Cross legs (every other leg of a pattern) and legs outside the area are not counted.
        across = round(searched.width / spacing)
        numbers = {k // 2 + 1 - searched.first for k in sailed.cut if k % 2 == 0}
        cut = tuple(sorted(number for number in numbers if 0 < number <= across))
    end = (
        min(start + float(flown.duration[0]), crew.available.spans[-1][1])
        if crew.random
        else legs.time[-1]
    )
    coverage, under_way = (
        tuple(w * unit.search_speed * float(flown.duration[0]) / (length * width) for w in widths)
        for widths in (unit.sweep_width, unit.width_under_way)
    )
    first, last = availability.moment(start), availability.moment(math.ceil(end))
    sortie = Sortie(
        name=unit.name,
        kind=unit.kind,
        start=first,
        end=last,
        law=unit.law,
        sweep_width=unit.sweep_width,
        width_under_way=unit.width_under_way,
        shape=unit.shape,
        group=unit.group,
        area=patterns.rectangle(
            searched.centre, searched.length, searched.width, searched.orientation
        ),
        coverage=coverage if crew.random else (),
        coverage_under_way=under_way if crew.random else (),
        legs=None if crew.random else legs,
        speed=unit.search_speed,
        altitude=unit.altitude,
        spacing=spacing,
        crossed=not crew.random and flown.sailed[0] is None and crew.manner.pattern == "parallel",
        planned=True,
    )
    ends = [(legs.lon[k], legs.lat[k]) for k in (0, -1)]
    ways: tuple[tuple[LonLat, ...], tuple[LonLat, ...]] = ((), ())
    if crew.course is not None:
        ways = courses.out_and_home(crew.course, *ends)
    way_out, way_home = (
        polyline.great_circle_length(way or straight) / unit.transit_speed
        for way, straight in zip(
            ways, ((unit.base, ends[0]), (ends[1], unit.return_to)), strict=True
        )
    )
    takeoff = availability.moment(
        max(math.floor(start - way_out), math.ceil(crew.available.leaves))
    )
    home = availability.moment(math.ceil(end + way_home))
    return Tasking(
        unit=unit,
        round=1,
        sortie=sortie,
        takeoff=takeoff,
        on_scene=sortie.start,
        off_scene=sortie.end,
        home=home,
        centre=searched.centre,
        length=searched.length,
        width=searched.width,
        orientation=searched.orientation,
        creep=(searched.orientation - laid.corner[1] * math.pi / 2) % (2 * math.pi),
        spacing=spacing,
        legs=searched.legs,
        pos=pos,
        out=ways[0],
        back=ways[1],
        cut=cut,
        swept=searched.share,
        manner=crew.manner,
    )


def _enclosing_area(choice: Choice, turn: float) -> Swept:
    """Return the rectangle that encloses a pattern and its outer sweeps, with the legs flown."""
    crew, flown = choice.crew, choice.flown
    nodes = rectangle.path(crew, choice.row, flown, 0)
    parallel = crew.manner.pattern == "parallel"
    margin = 0.0 if crew.manner.pattern == "sector" else float(flown.spacing[0])
    legs = int(flown.legs[0]) if parallel else len(nodes) - 1
    sin, cos = math.sin(turn), math.cos(turn)
    along, across = nodes[:, 1] * sin + nodes[:, 2] * cos, nodes[:, 1] * cos - nodes[:, 2] * sin
    (a, c), (length, width) = (
        ((v.max() + v.min()) / 2 for v in (along, across)),
        (np.ptp(v) for v in (along, across)),
    )
    lon, lat = (
        math.degrees(float(v)) for v in crew.plane.round(a * sin + c * cos, a * cos - c * sin)
    )
    return Swept((lon, lat), float(length) + margin, float(width) + margin, turn, legs, 0, 1.0)
