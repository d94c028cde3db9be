"""A rectangle for each unit: those that together find most of particles that move.

Each unit in turn is given the rectangle that adds most to what the others find (block-coordinate ascent), again and again, from
several beginnings. A rectangle is sought among many drawn where the particles are, then around the best of them in ever
smaller steps (an evolution strategy): first with its legs smeared out, on few particles, then with its legs as flown, on many.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.motion.scenario import Survival
from drift.planner import availability as reaches
from drift.planner import baselines, bound, candidates, joint, rectangle
from drift.planner import planning_tracks as record
from drift.planner.candidates import Choice, Plan, Stage
from drift.planner.courses import Course
from drift.planner.planning_tracks import Plane, Tracks
from drift.planner.records import Alternative, Tasking
from drift.planner.rectangle import ACROSS, ALONG, ASPECT, SPACING, TURN, WAIT, Crew, Flown, X, Y
from drift.search.records import PlanSpec, Unit
from geo import sphere
from kernels import noise, rectangles, sweeps

Array = npt.NDArray[Any]

BINS = 10  # of time, at most, while legs are smeared out
FEW, MORE, MANY = 2_500, 8_000, 10_000  # particles of the first, second and third stage
BEGINNINGS = 3
KICKS = 8  # times that two units of the best plan are tasked anew
ROUNDS = 4  # of all units in the first stage, at most
DRAWN = 768  # rectangles at the beginning of a search
PATIENCE = 5e-3  # share of what is found that an hour of waiting must add
PRICES = (0.0, 0.1, 0.3, 1.0)  # of being too near, one after the other
NEAR = 0.998  # of what a plan was worth, which a new rectangle may cost where that saves waiting
SLACK = rectangle.SHORTEST  # [s] that waiting leaves for search
CHILDREN, PARENTS = 96, 12


@dataclass(frozen=True)
class Proposal:
    """What each unit is to do, by takeoff, and what that would find on the tracks that it was made on."""

    taskings: tuple[Tasking, ...]
    seen: float
    alternatives: tuple[Alternative, ...]


def plan(
    tracks: Tracks,
    units: Sequence[Unit],
    spec: PlanSpec,
    seed: int,
    survival: Sequence[Survival | None],
    tell: Callable[[float], None] | None = None,
    at_sea: Mapping[str, Course] | None = None,
) -> Proposal:
    """Return one sortie for each unit that can search, so that together they find most of the tracks' particles.

    survival: of each scenario; used where spec.objective is "alive". tell: called with the share that is done. at_sea: the
    courses of boats near land, by name of unit; all others go straight on.
    """
    at_sea = at_sea or {}
    tell = tell or (lambda share: None)
    rng = noise.generator(seed)
    plane = record.plane(tracks)
    factor, nodes = joint.nodes(units)
    crews = _crews(units, spec, plane, float(tracks.time[0]), factor, at_sea)

    def stage(some: Tracks, executed: bool) -> Stage:
        return Stage(some.m, _swarm(some, spec, survival, plane), some.weight, nodes, executed, spec.separation)

    coarse = record.coarser(tracks, BINS)
    few, more = (stage(record.sample(coarse, min(tracks.m, n)), False) for n in (FEW, MORE))
    found = _begun(crews, few, spec.separation > 0, rng, tell)
    polished = _polished([begun for _, begun in found[:6]], crews, more, rng)
    tell(0.7)
    many, whole = stage(record.sample(tracks, min(tracks.m, MANY)), True), stage(tracks, True)
    best = _as_flown(polished, crews, many, rng)
    tell(0.9)
    best = candidates.moved(best, whole)
    chosen = [choice for choice in best if choice is not None]
    if not chosen:
        return Proposal((), 0.0, ())
    gain = joint.worth([choice.find for choice in chosen], nodes)
    alone = _alone(crews, few, many, rng)
    ignoring = [("each unit where it alone finds most, ignoring the others", candidates.moved(alone, whole))]
    others = [*(ignoring if len(crews) > 1 else []), *baselines.by_hand(crews, many, whole)]
    alternatives = tuple(baselines.against(name, rival, gain, tracks.weight, nodes) for name, rival in others)
    tell(1.0)
    return Proposal(candidates.taskings(chosen, tracks.weight, nodes), float(tracks.weight @ gain), alternatives)


def _crews(
    units: Sequence[Unit], spec: PlanSpec, plane: Plane, zero: float, factor: Array, at_sea: Mapping[str, Course]
) -> list[Crew]:
    """Return the units with when and where each can search; zero: of the tracks' time [s since 1970]; factor: of W at the nodes."""
    crews = []
    for u, unit in enumerate(units):
        course, reach = at_sea.get(unit.name), reaches.reach(unit, spec, (plane.lon, plane.lat))
        if course is not None:
            reach = replace(reach, way=course.arrival)
        crews.append(rectangle.crew(unit, reach, plane, zero, factor[u], course))
    return crews


def _begun(
    crews: list[Crew], few: Stage, apart: bool, rng: np.random.Generator, tell: Callable[[float], None]
) -> list[tuple[float, Plan]]:
    """Return plans from several beginnings, with legs smeared out on few particles: (what each finds, plan), the best first.

    apart: whether units must keep apart. They would shut each other out: they are first moved apart by a price, then by force.
    """
    prices = [*(PRICES if apart else ()), *[math.inf] * ROUNDS]
    found: list[tuple[float, Plan]] = []
    for k in range(BEGINNINGS):
        begun: Plan = [None] * len(crews)
        order = _order(crews, rng, k)
        for price in prices:
            before = candidates.value(begun, few)
            for u in order:
                drawn = DRAWN if begun[u] is None else DRAWN // 3
                begun = _improve(begun, u, crews, replace(few, price=price), rng, drawn, 4)
            if math.isinf(price) and candidates.value(begun, few) < before * 1.002:
                break
        found.append((candidates.value(begun, few), begun))
        tell(0.3 * (k + 1) / BEGINNINGS)
    found.sort(key=lambda one: -one[0])
    for k in range(KICKS if len(crews) > 1 else 0):
        kicked = _kick(found[0][1], crews, few, rng, prices[: -ROUNDS + 1])
        found.append((candidates.value(kicked, few), kicked))
        found.sort(key=lambda one: -one[0])
        tell(0.3 + 0.3 * (k + 1) / KICKS)
    return found


def _polished(plans: list[Plan], crews: list[Crew], more: Stage, rng: np.random.Generator) -> Plan:
    """Return the best of some plans, the best two of which have been improved on more particles."""
    again = sorted((candidates.moved(begun, more) for begun in plans), key=lambda one: -candidates.value(one, more))
    polished = []
    for now in again[:2]:
        for _ in range(2):
            for u in range(len(crews)):
                now = _improve(now, u, crews, more, rng, 0, 3)
        polished.append((candidates.value(now, more), now))
    return max(polished, key=lambda one: one[0])[1]


def _as_flown(plan: Plan, crews: list[Crew], many: Stage, rng: np.random.Generator) -> Plan:
    """Return a plan improved with its legs as they are flown."""
    best = candidates.moved(plan, many)
    for turn in range(2):
        for u in range(len(crews)):
            best = _settle(best, u, crews, many, rng, 3 if turn == 0 else 2)
            if best[u] is None:
                best = _improve(best, u, crews, many, rng, DRAWN // 3, 3)
    return best


def _alone(crews: list[Crew], few: Stage, many: Stage, rng: np.random.Generator) -> Plan:
    """Return each unit's choice as if no other searched."""
    none: Plan = [None] * len(crews)
    alone: Plan = []
    for u in range(len(crews)):
        begun = _improve(none, u, crews, few, rng, DRAWN, 4)
        alone.append(_settle(candidates.moved(begun, many), u, crews, many, rng, 2)[u])
    return alone


def _swarm(tracks: Tracks, spec: PlanSpec, survival: Sequence[Survival | None], plane: Plane) -> rectangles.Swarm:
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    value = np.where(tracks.adrift, bound.worth(tracks, survival, spec.objective), -1.0)
    return rectangles.swarm(tracks.time - tracks.time[0], x, y, value, tracks.scenario)


def _order(crews: Sequence[Crew], rng: np.random.Generator, k: int) -> list[int]:
    """Return the order in which units are first given something: the strongest first, then at random."""
    strength = [crew.widest * crew.unit.search_speed * crew.reach.search for crew in crews]
    return sorted(range(len(crews)), key=lambda u: -strength[u]) if k == 0 else rng.permutation(len(crews)).tolist()


def _kick(now: Plan, crews: Sequence[Crew], stage: Stage, rng: np.random.Generator, prices: Sequence[float]) -> Plan:
    """Return the plan with two units tasked anew from nothing, the others moved along."""
    gone = rng.permutation(len(crews))[:2].tolist()
    kicked: Plan = [None if u in gone else choice for u, choice in enumerate(now)]
    for u in gone:
        kicked = _improve(kicked, u, crews, replace(stage, price=prices[0]), rng, DRAWN // 2, 3)
    for price in prices:
        for u in rng.permutation(len(crews)).tolist():
            drawn = DRAWN // 2 if kicked[u] is None else 0
            kicked = _improve(kicked, u, crews, replace(stage, price=price), rng, drawn, 3)
    return kicked


def _improve(
    now: Plan, u: int, crews: Sequence[Crew], stage: Stage, rng: np.random.Generator, drawn: int, times: int
) -> Plan:
    """Return the plan with unit u's rectangle replaced where a better one is found."""
    score, rows, old = _scorer(now, u, crews[u], stage, lambda left: _draw(crews[u], stage, left, rng, drawn))
    if len(rows) == 0:
        return now
    scores = score(rows)
    for turn in range(times):
        keep = np.argsort(-scores, kind="stable")[:PARENTS]
        rows, scores = rows[keep], scores[keep]
        children = _vary(rows[rng.integers(len(rows), size=CHILDREN)], crews[u], rng, 0.5**turn)
        rows, scores = np.concatenate([rows, children]), np.concatenate([scores, score(children)])
    return _accept(now, u, crews[u], stage, rows, scores, old)


def _settle(now: Plan, u: int, crews: Sequence[Crew], stage: Stage, rng: np.random.Generator, times: int) -> Plan:
    """Return the plan with unit u's rectangle moved a little, and commenced at its best corner."""
    score, rows, old = _scorer(now, u, crews[u], stage, lambda left: np.empty((0, 8)))
    if len(rows) == 0:
        return now
    rows = np.repeat(rows, 4, axis=0)
    rows[:, ALONG], rows[:, ACROSS] = [1, 1, -1, -1], [1, -1, 1, -1]
    scores = score(rows)
    for turn in range(times):
        keep = np.argsort(-scores, kind="stable")[:4]
        rows, scores = rows[keep], scores[keep]
        children = _vary(rows[rng.integers(len(rows), size=24)], crews[u], rng, 0.25 * 0.5**turn)
        rows, scores = np.concatenate([rows, children]), np.concatenate([scores, score(children)])
    return _accept(now, u, crews[u], stage, rows, scores, old)


def _scorer(
    now: Plan, u: int, crew: Crew, stage: Stage, draw: Callable[[Array], Array]
) -> tuple[Callable[[Array], Array], Array, Choice | None]:
    """Return how rectangles of unit u score beside the others, rectangles to begin with, and the one it has."""
    rest = [choice for k, choice in enumerate(now) if choice is not None and k != u]
    old = now[u]
    time = old.find.time if old else math.inf
    before, later = joint.others([choice.find for choice in rest], time, stage.nodes, stage.m)
    left = stage.weight[:, None] * before
    rows = draw(left.sum(axis=1))
    if old:
        rows = np.concatenate([old.row[None, :], rows])
    smeared = not stage.executed or crew.random

    level = candidates.value(now, stage) or 1.0

    def score(rows: Array) -> Array:
        flown = rectangle.fly(crew, rows, stage.executed)
        good = flown.possible.copy()
        cost = np.zeros(len(rows))
        for choice in rest:
            near = candidates.near(choice, rows, flown, stage)
            if math.isinf(stage.price):
                good &= near == 0
            else:
                cost += stage.price * near / np.sqrt(flown.length * flown.width + 1)
        scores = np.full(len(rows), -1.0)
        at = np.flatnonzero(good)
        if len(at) == 0:
            return scores
        if smeared:
            table, coverage = rectangle.smeared(crew, rows[at], Flown(*(v[at] for v in flown)))
            scores[at] = rectangles.gains(
                stage.swarm, crew.random, table, coverage, crew.factor, rectangle.STEP, crew.curve, left, later
            )
        else:
            paths = [rectangle.path(crew, rows[k], flown, int(k)) for k in at]
            scores[at] = sweeps.gains(stage.swarm, crew.table, paths, crew.width, crew.factor, left, later)
        return np.where(good, np.maximum(scores * (1 - PATIENCE * rows[:, WAIT] / 3600) - level * cost, -0.5), -1.0)

    return score, rows, old


def _accept(now: Plan, u: int, crew: Crew, stage: Stage, rows: Array, scores: Array, old: Choice | None) -> Plan:
    """Return the plan with the best rectangle for unit u, unless the plan is worth less with it."""
    best = int(np.argmax(scores))
    if scores[best] <= -1:
        return now if old is None else [*now[:u], None, *now[u + 1 :]]
    new: Plan = [*now[:u], candidates.choose(crew, rows[best], stage), *now[u + 1 :]]
    # With worth that falls the score takes the order of sorties for fixed: the whole tells.
    if math.isfinite(stage.price):
        return new
    return (
        new
        if old is None or scores[0] < 0 or candidates.value(new, stage) >= NEAR * candidates.value(now, stage)
        else now
    )


def _draw(crew: Crew, stage: Stage, left: Array, rng: np.random.Generator, count: int) -> Array:
    """Return rectangles, (count, 8), round particles that are left, at times when they can be searched."""
    if count == 0 or left.sum() <= 0 or not crew.reach.spans:
        return np.empty((0, 8))
    edges = stage.swarm.time.shape[0]
    share = np.cumsum(left) / left.sum()
    i = np.minimum(np.searchsorted(share, rng.random(count)), stage.m - 1)
    x, y = (v.reshape(stage.m, edges) for v in (stage.swarm.x, stage.swarm.y))
    arrival = crew.reach.arrival(*crew.plane.round(x[i, edges // 2], y[i, edges // 2]))
    slack = np.maximum(crew.reach.spans[-1][1] - SLACK - arrival, 0.0)
    wait = np.where(rng.random(count) < 0.5, 0.0, rng.random(count) * slack)
    start, duration = crew.reach.slot(arrival + wait)
    middle = np.clip(np.searchsorted(stage.swarm.time, start - crew.zero + duration / 2) - 1, 0, edges - 1)
    # A corner is tried beside the middle: half of the centres lie between two particles.
    j = np.minimum(np.searchsorted(share, rng.random(count)), stage.m - 1)
    between = np.where(rng.random(count) < 0.5, 0.0, rng.random(count) * 0.5)
    rows = np.zeros((count, 8))
    rows[:, X] = x[i, middle] + between * (x[j, middle] - x[i, middle])
    rows[:, Y] = y[i, middle] + between * (y[j, middle] - y[i, middle])
    rows[:, TURN] = rng.random(count) * math.pi
    rows[:, SPACING] = np.log(max(crew.widest, 1.0)) + rng.uniform(-1.2, 1.6, count)
    rows[:, SPACING] = np.maximum(rows[:, SPACING], math.log(max(crew.unit.least_spacing, 1.0)))
    rows[:, ASPECT] = rng.uniform(-0.5, 1.8, count)
    rows[:, WAIT] = wait
    rows[:, ALONG], rows[:, ACROSS] = rng.choice([-1.0, 1.0], (2, count))
    return rows


def _vary(rows: Array, crew: Crew, rng: np.random.Generator, size: float) -> Array:
    """Return rectangles near others: steps are shares of their own size."""
    new = rows.copy()
    count = len(rows)
    step = rng.standard_normal((count, 6)) * size
    step *= rng.random((count, 6)) < 0.6  # some numbers stay, so that one can be bettered without the others
    side = np.sqrt(np.exp(rows[:, SPACING]) * crew.unit.search_speed * crew.reach.search)
    new[:, X] += 0.3 * side * step[:, 0]
    new[:, Y] += 0.3 * side * step[:, 1]
    new[:, TURN] += 0.5 * step[:, 2]
    new[:, SPACING] = np.maximum(new[:, SPACING] + 0.3 * step[:, 3], math.log(max(crew.unit.least_spacing, 1.0)))
    new[:, ASPECT] += 0.5 * step[:, 4]
    new[:, WAIT] = np.maximum(new[:, WAIT] + 5400.0 * step[:, 5], 0.0)
    new[:, ALONG] *= np.where(rng.random(count) < 0.1, -1, 1)
    new[:, ACROSS] *= np.where(rng.random(count) < 0.1, -1, 1)
    return new
