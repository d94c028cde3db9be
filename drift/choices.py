"""Rectangles chosen for units, what they find at a stage of the optimiser, and the taskings that they become."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import patterns, rectangle, together
from drift import reach as reaches
from drift.rectangle import ACROSS, ALONG, TURN, Crew, Flown, X, Y
from drift.sortie import Sortie
from drift.tasking import Tasking
from drift.together import Find
from geo import sphere
from kernels import rectangles, sweeps

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Stage:
    """Particles and how a rectangle is scored on them."""

    m: int
    swarm: rectangles.Swarm
    weight: Array  # (m,)
    nodes: Array  # (nodes,) weights of the joint nodes
    executed: bool  # legs as flown; else smeared out
    separation: float  # [m]
    price: float = (
        math.inf
    )  # share of what is found that being too near costs, by its share of a unit's size; inf: forbidden


@dataclass(frozen=True)
class Choice:
    """A unit's rectangle, and what it finds."""

    crew: Crew
    row: Array
    flown: Flown
    find: Find


Plan = list[Choice | None]  # one a unit; None: it cannot search, or has not been given anything


def choose(crew: Crew, row: Array, stage: Stage) -> Choice:
    """Return a rectangle with what it finds at this stage."""
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
    return Choice(crew, row, flown, Find(float(flown.start[0] + flown.duration[0] / 2), chance, worth))


def moved(plan: Plan, stage: Stage) -> Plan:
    """Return the same rectangles with what they find at another stage; those that are not possible there are dropped."""
    made = [choice and choose(choice.crew, choice.row, stage) for choice in plan]
    return [choice if choice and choice.flown.possible[0] else None for choice in made]


def value(plan: Plan, stage: Stage) -> float:
    """Return what a plan finds at a stage."""
    finds = [choice.find for choice in plan if choice is not None]
    return float(stage.weight @ together.worth(finds, stage.nodes)) if finds else 0.0


def near(choice: Choice, rows: Array, flown: Flown, stage: Stage) -> Array:
    """Return by how much [m] rectangles are too near another unit's, 0 where they are not."""
    if stage.separation <= 0:
        return np.zeros(len(rows))
    return np.maximum(stage.separation - rectangle.apart(rows, flown, choice.row, choice.flown), 0.0)


def taskings(chosen: Sequence[Choice], weight: Array, nodes: Array) -> tuple[Tasking, ...]:
    """Return rectangles as they are flown, in the order of their middles; each POS given that those before failed."""
    ordered = sorted(chosen, key=lambda choice: choice.find.time)
    left = np.broadcast_to(nodes, ordered[0].find.chance.shape).copy()
    made = []
    for choice in ordered:
        missed = left * (1 - choice.find.chance)
        made.append(_tasking(choice, float(1 - weight @ missed.sum(axis=1) / (weight @ left.sum(axis=1)))))
        left = missed
    return tuple(made)


def _tasking(choice: Choice, pos: float) -> Tasking:
    crew, row, flown = choice.crew, choice.row, choice.flown
    unit, turn = crew.unit, float(row[TURN]) % (2 * math.pi)
    corner = (int(row[ALONG]), int(row[ACROSS]))
    if turn >= math.pi:  # legs run both ways: the orientation is that of the half turn from north
        turn, corner = turn - math.pi, (-corner[0], -corner[1])
    spacing, legs = float(flown.spacing[0]), int(flown.legs[0])
    length, width, start = float(flown.length[0]), float(flown.width[0]), crew.zero + float(flown.start[0])
    lon, lat = (float(v) for v in crew.plane.round(row[X], row[Y]))
    centre = (math.degrees(lon), math.degrees(lat))
    # Whole seconds, as a case file has them: later to begin.
    start = math.ceil(start)
    pattern = patterns.parallel(centre, length, width, turn, spacing, start, unit.search_speed, corner)
    end = min(start + float(flown.duration[0]), crew.reach.spans[-1][1]) if crew.random else pattern.legs.time[-1]
    first, last = ((math.radians(pattern.legs.lon[k]), math.radians(pattern.legs.lat[k])) for k in (0, -1))
    coverage = tuple(w * unit.search_speed * float(flown.duration[0]) / (length * width) for w in unit.sweep_width)
    sortie = Sortie(
        name=unit.name, kind=unit.kind, start=reaches.moment(start), end=reaches.moment(math.ceil(end)), law=unit.law,
        sweep_width=unit.sweep_width, shape=unit.shape, group=unit.group, area=pattern.area,
        coverage=coverage if crew.random else (), legs=None if crew.random else pattern.legs,
        speed=unit.search_speed, altitude=unit.altitude, spacing=spacing,
    )  # fmt: skip
    home = end + float(sphere.distance(*last, *np.radians(unit.return_to))) / unit.transit_speed
    there = float(sphere.distance(*crew.reach.base, *first)) / unit.transit_speed
    return Tasking(
        unit=unit, round=1, sortie=sortie, takeoff=reaches.moment(max(math.floor(start - there), math.ceil(crew.reach.leaves))), on_scene=sortie.start,
        off_scene=sortie.end, home=reaches.moment(math.ceil(home)), centre=centre, length=length, width=width,
        orientation=turn, creep=(turn - corner[1] * math.pi / 2) % (2 * math.pi), spacing=spacing, legs=legs, pos=pos,
    )  # fmt: skip
