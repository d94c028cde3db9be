"""Standard search patterns, as a planner would draw them by hand.

They are starting points of the optimiser and a benchmark for its plans. Each pattern is centred on
the mean position or on one of the densest spots of the remaining probability (both sides of a
strait are two of them). Its frame is fixed to the ground or drifts with the particles there. All
parameters come from tables of patterns, shapes and spacings.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from drift.planning.search import candidates, joint, manners, rectangle
from drift.planning.search.candidates import Choice, Plan, Stage
from drift.planning.search.manners import Manner
from drift.planning.search.rectangle import Crew
from geo.array import Array
from kernels.planning import sweeps

SPOTS = 3  # densest spots, beside the mean position
WAITS = (0.0, 0.3, 0.6)  # shares of the longest possible wait
SPACINGS = (0.6, 1.0, 1.6, 2.5, 4.0)  # [sweep widths]
TIMES = (1, 2, 4)  # repetitions of a sector search
# Patterns, with their lengths over widths and orientations [rad] off the cloud's longer axis: a
# parallel track in a square, along the cloud, and a creeping line, whose legs lie across it.
SHAPES = (
    ("parallel", 1.0, 0.0),
    ("parallel", 3.0, 0.0),
    ("parallel", 1 / 3, math.pi / 2),
    ("square", 1.0, 0.0),
    ("sector", 1.0, 0.0),
)
RESPACED = (1.6, 2.5, 4.0)  # factors on the spacing of the plan's own area, same centre
KEPT = 3  # best patterns of one unit that are tried on more particles


@dataclass(frozen=True)
class _Spot:
    """A spot where particles are dense when a unit arrives."""

    wait: float  # [s]
    start: float  # [s] begin of the search
    duration: float
    place: Array  # (2,) [m] at the begin of the search
    velocity: Array  # (2,) [m/s] mean of the particles there during the search
    axis: float  # [rad] of their longer axis, clockwise from north


def best(plan: Plan, u: int, crew: Crew, few: Stage, stage: Stage) -> list[Choice]:
    """Return the patterns of a unit that add most to the others' plan, best first.

    Args:
        plan: of all units; the entry of this unit may be None, or its present choice.
        u: index of the unit.
        crew: the unit, with plain legs.
        few: a stage of few particles, legs as flown, on which all patterns are tried.
        stage: the stage of the result.

    Returns:
        At most KEPT choices, each of another manner, that keep the separation from the other units
            at `few`.
    """
    if crew.random:
        return []
    own, known = plan[u], candidates.at_stage(plan, few)
    others = [choice.find for k, choice in enumerate(known) if choice is not None and k != u]
    left, later = joint.others(others, own.find.time if own else math.inf, few.nodes, few.m)
    undetected = few.weight[:, None] * left
    tried_patterns = list(_patterns(crew, few, undetected.sum(axis=1), own))
    factor, *remaining = joint.by_factor(crew.factor, undetected, later)
    ranked: list[tuple[float, Crew, Array]] = []
    for manner in dict.fromkeys(manner for manner, _ in tried_patterns):
        # Cutting hundreds of patterns at the coast would take minutes: try them uncut, and cut only
        # the best.
        crew_in_manner = replace(crew, manner=manner, course=None)
        rows = np.array([row for other, row in tried_patterns if other == manner])
        flown = rectangle.fly(crew_in_manner, rows, few.executed)
        allowed = flown.possible & (rectangle.share(crew, rows, flown) >= rectangle.LEAST_SEA)
        beside = [other for k, other in enumerate(plan) if other is not None and k != u]
        allowed &= np.all(candidates.too_near(beside, rows, flown, few) == 0, axis=0)
        which = np.flatnonzero(allowed)
        if not which.size:
            continue
        paths = [rectangle.path(crew_in_manner, rows[k], flown, int(k)) for k in which]
        gains = sweeps.gains(few.swarm, crew.table, paths, crew.width, factor, *remaining)
        k = int(np.argmax(gains))
        ranked.append((float(gains[k]), replace(crew, manner=manner), rows[which[k]]))
    ranked.sort(key=lambda one: -one[0])
    kept: list[Choice] = []
    for _, crew_in_manner, row in ranked:
        if (
            len(kept) < KEPT
            and rectangle.fly(crew_in_manner, row[None, :], stage.executed).possible[0]
        ):
            kept.append(candidates.choose(crew_in_manner, row, stage))
    return kept


def _patterns(
    crew: Crew, stage: Stage, mass: Array, own: Choice | None
) -> Iterator[tuple[Manner, Array]]:
    """Yield candidate patterns as manner and row.

    mass: remaining probability of each particle, (m,); own: the unit's present choice.
    """
    width, speed = max(crew.widest, 1.0), crew.unit.search_speed
    least = max(crew.unit.least_spacing, 1.0)
    for spot in _spots(crew, stage, mass):
        track = speed * spot.duration
        frames = [np.zeros(2)]
        if 0 < np.hypot(*spot.velocity) < manners.FASTEST * speed:
            frames.append(spot.velocity)
        for frame in frames:
            # A drifting frame is placed for the begin of the search, a fixed one for its middle.
            place = spot.place + (spot.velocity - frame) * spot.duration / 2
            for pattern, ratio, turn in SHAPES:
                spacings = [track / manners.SEARCH / times for times in TIMES]
                if pattern != "sector":
                    spacings = [max(share * width, least) for share in SPACINGS]
                manner = Manner(pattern, float(frame[0]), float(frame[1]))
                for spacing in spacings:
                    shape = [
                        spot.axis + turn,
                        math.log(spacing),
                        math.log(ratio),
                        spot.wait,
                        -1.0,
                        -1.0,
                    ]
                    yield manner, np.array([*place, *shape])
    if own is not None:
        for times in RESPACED if own.crew.manner.pattern != "sector" else ():
            row = own.row.copy()
            row[rectangle.SPACING] += math.log(times)
            yield own.crew.manner, row


def _spots(crew: Crew, stage: Stage, mass: Array) -> Iterator[_Spot]:
    """Yield the mean position and densest spots at times when the unit can search."""
    if mass.sum() <= 0 or not crew.available.spans:
        return
    edges = stage.swarm.time.shape[0]
    x, y, value = (
        stage.swarm.at_edges(v) for v in (stage.swarm.x, stage.swarm.y, stage.swarm.value)
    )
    arrival = float(
        crew.available.arrival(
            *crew.plane.round(*(float(mass @ v[edges // 2]) / mass.sum() for v in (x, y)))
        )
    )
    slack = max(crew.available.spans[-1][1] - crew.shortest - arrival, 0.0)
    for share in WAITS:
        begin, duration = (float(v) for v in crew.available.slot(arrival + share * slack))
        if duration < crew.shortest:
            continue
        start = begin - crew.zero
        first, last = (_moment(stage.swarm.time, at) for at in (start, start + duration))
        here, there = (
            np.stack([_at(x, *first), _at(y, *first)]),
            np.stack([_at(x, *last), _at(y, *last)]),
        )
        present_mass = np.where(_at(value, *first) >= 0, mass, 0.0)
        if present_mass.sum() <= 0:
            continue
        wait = share * slack
        middle = np.ones(stage.m, bool)
        for members in (
            middle,
            *_dense(here, present_mass, math.sqrt(crew.widest * crew.unit.search_speed * duration)),
        ):
            share_of_mass = np.where(members, present_mass, 0.0)
            share_of_mass = share_of_mass / share_of_mass.sum()
            place = here @ share_of_mass
            offset = here - place[:, None]
            _, axes = np.linalg.eigh((offset * share_of_mass) @ offset.T)
            velocity = (there @ share_of_mass - place) / duration
            yield _Spot(wait, start, duration, place, velocity, math.atan2(axes[0, 1], axes[1, 1]))


def _moment(time: Array, at: float) -> tuple[int, float]:
    """Return the bin of a time, and the elapsed share of that bin."""
    k = int(np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2))
    return k, float(np.clip((at - time[k]) / (time[k + 1] - time[k]), 0, 1))


def _at(values: Array, k: int, share: float) -> Array:
    """Return values interpolated within a bin."""
    return np.asarray(values[k] * (1 - share) + values[k + 1] * share, np.float64)


def _dense(here: Array, mass: Array, cell: float) -> Iterator[Array]:
    """Yield bool (m,): particles in each of the fullest cells that do not touch."""
    index, which = np.unique(
        np.floor(here / max(cell, 1.0)).astype(np.int64), axis=1, return_inverse=True
    )
    mass_of_cell, which = np.bincount(which.ravel(), mass), which.ravel()
    for _ in range(SPOTS):
        k = int(np.argmax(mass_of_cell))
        if mass_of_cell[k] <= 0:
            return
        yield which == k
        mass_of_cell[np.abs(index - index[:, k : k + 1]).max(axis=0) <= 1] = 0.0
