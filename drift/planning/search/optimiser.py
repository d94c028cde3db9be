"""Optimiser: one search rectangle for each unit, so that together they find most particles.

Each unit in turn gets the rectangle that adds most to what the others find (block-coordinate
ascent), repeatedly and from several starts. The search for a rectangle begins with many random ones
among the particles, then varies the best of them in ever smaller steps (an evolution strategy):
first with legs smeared out, on few particles, then with legs as flown, on many. Standard patterns
(drift.planning.search.drawn) compete with that plan, and form another plan of their own. The plan
that is proposed is chosen on particles that no plan was made on.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.engine.motion.scenario import Survival
from drift.evidence.filter.records import PlanSpec, Unit
from drift.planning.search import baselines, bound, candidates, drawn, joint, rectangle
from drift.planning.search import planning_tracks as record
from drift.planning.search.boats import availability
from drift.planning.search.boats.courses import Course
from drift.planning.search.candidates import Choice, Plan, Stage
from drift.planning.search.planning_tracks import Plane, Tracks
from drift.planning.search.records import Alternative, Tasking
from drift.planning.search.rectangle import (
    ACROSS,
    ALONG,
    ASPECT,
    SPACING,
    TURN,
    WAIT,
    Crew,
    Sweeps,
    X,
    Y,
)
from geo import sphere
from geo.array import Array
from kernels.maths import noise
from kernels.planning import rectangles, sweeps

BINS = 10  # most time bins while legs are smeared out, if all particles drift
STEERED = 30  # the same if some steer, because those turn
FEW, MORE, MANY = 2_500, 8_000, 10_000  # particles in the first, second and third stage
BEGINNINGS = 3
KICKS = 8  # how often two units of the best plan are replanned from scratch
ROUNDS = 4  # most rounds over all units in the first stage
DRAWN = 768  # random rectangles at the start of a search
PATIENCE = 5e-3  # relative gain that an hour of waiting must add
PRICES = (0.0, 0.1, 0.3, 1.0)  # prices of being too near to another unit, in turn
NEAR = 0.998  # a new rectangle that saves waiting may lower the plan's value to this share
FILLED = 0.9  # a boat that uses less of its search time gets a new rectangle
# every JUDGES-th particle, in the order of strata, is kept for choosing among plans
JUDGES = 3
CHILDREN, PARENTS = 96, 12  # rectangles in each generation


@dataclass(frozen=True)
class Proposal:
    """Taskings by takeoff, and their value on the tracks on which they were planned."""

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
    """Return one sortie for each unit that can search, which together find most particles.

    Args:
        tracks: planning particles.
        units: that may search.
        spec: of the plan.
        seed: of the optimiser's random numbers.
        survival: of each scenario; used if `spec.objective` is "alive".
        tell: callback that receives the progress, 0 to 1.
        at_sea: courses of boats near land, by name of unit; all other units go straight.
    """
    at_sea = at_sea or {}
    tell = tell or (lambda share: None)
    rng = noise.generator(seed)
    plane = record.plane(tracks)
    factor, nodes = joint.nodes(units)
    crews = _crews(units, spec, plane, float(tracks.time[0]), factor, at_sea)

    def stage(sampled: Tracks, executed: bool) -> Stage:
        """Return the stage of some tracks."""
        swarm = swarm_of(sampled, spec, survival, plane)
        return Stage(sampled.m, swarm, sampled.weight, nodes, executed, spec.separation)

    making, judging = _split_tracks(tracks)
    coarse_tracks = record.coarser(making, BINS if tracks.turn is None else STEERED)
    coarse, finer = (
        stage(record.sample(coarse_tracks, min(making.m, n)), False) for n in (FEW, MORE)
    )
    starts = _starts(crews, coarse, spec.separation > 0, rng, tell)
    smeared = _polished([start for _, start in starts[:6]], crews, finer, rng)
    tell(0.6)
    few, executed = (stage(record.sample(making, min(making.m, n)), True) for n in (FEW, MANY))
    judge, full = stage(judging, True), stage(tracks, True)
    made = _as_flown(smeared, crews, executed, rng)
    tell(0.7)
    improved = _try_standard_patterns(
        candidates.at_stage(made, executed), crews, few, executed, rng
    )
    tell(0.8)
    by_hand = _try_standard_patterns([None] * len(crews), crews, few, executed, rng)
    tell(0.9)
    best = max(
        (candidates.at_stage(one, judge) for one in (made, improved, by_hand)),
        key=lambda one: candidates.value(one, judge),
    )
    if not any(best):
        return Proposal((), 0.0, ())
    alone = _alone(crews, coarse, executed, rng)
    ignoring = [("each unit at its own best place, ignoring the others", alone)]
    drawn_by_hand = ("patterns drawn by hand, one unit after the other", by_hand)
    others = [
        *(ignoring if len(crews) > 1 else []),
        *baselines.by_hand(crews, executed),
        drawn_by_hand,
    ]
    for _, rival in others[:-1]:
        best = _better(best, candidates.at_stage(rival, judge), crews, executed, judge, rng)
    chosen = [choice for choice in candidates.at_stage(best, full) if choice is not None]
    gain = joint.worth([choice.find for choice in chosen], nodes)
    alternatives = tuple(
        baselines.alternative(name, candidates.at_stage(rival, full), gain, full)
        for name, rival in others
    )
    tell(1.0)
    return Proposal(candidates.taskings(chosen, full), float(tracks.weight @ gain), alternatives)


def _split_tracks(tracks: Tracks) -> tuple[Tracks, Tracks]:
    """Split the tracks into those for making plans and those for choosing one.

    Both are unbiased samples.
    """
    judges = np.arange(tracks.m) % JUDGES == JUDGES // 2
    making, judging = (np.sort(tracks.strata[some]) for some in (~judges, judges))
    if not tracks.weight[making].sum() > 0 or not tracks.weight[judging].sum() > 0:
        return tracks, tracks
    return record.take(tracks, making, tracks.weight[making]), record.take(
        tracks, judging, tracks.weight[judging]
    )


def _crews(
    units: Sequence[Unit],
    spec: PlanSpec,
    plane: Plane,
    zero: float,
    factor: Array,
    at_sea: Mapping[str, Course],
) -> list[Crew]:
    """Return the units with when and where each can search.

    zero: first time of the tracks [s since 1970]; factor: of the sweep width at each joint node,
    (units, nodes).
    """
    crews = []
    for u, unit in enumerate(units):
        course, available = (
            at_sea.get(unit.name),
            availability.of_unit(unit, spec, (plane.lon, plane.lat)),
        )
        if course is not None:
            available = replace(available, way=course.arrival)
        crews.append(rectangle.crew(unit, available, plane, zero, factor[u], course))
    return crews


def _starts(
    crews: list[Crew],
    coarse: Stage,
    apart: bool,
    rng: np.random.Generator,
    tell: Callable[[float], None],
) -> list[tuple[float, Plan]]:
    """Return (value, plan) from several starts, best first, on few particles.

    Legs are smeared out. apart: whether units must keep apart. Forbidding it from the start would
    shut units out. So a growing price moves them apart first, and only then is nearness forbidden.
    """
    prices = [*(PRICES if apart else ()), *[math.inf] * ROUNDS]
    starts: list[tuple[float, Plan]] = []
    for k in range(BEGINNINGS):
        current: Plan = [None] * len(crews)
        order = _order(crews, rng, k)
        for price in prices:
            before = candidates.value(current, coarse)
            for u in order:
                drawn = DRAWN if current[u] is None else DRAWN // 3
                current = _improve(current, u, crews, replace(coarse, price=price), rng, drawn, 4)
            if math.isinf(price) and candidates.value(current, coarse) < before * 1.002:
                break
        starts.append((candidates.value(current, coarse), current))
        tell(0.3 * (k + 1) / BEGINNINGS)
    starts.sort(key=lambda candidate: -candidate[0])
    for k in range(KICKS if len(crews) > 1 else 0):
        kicked = _kick(starts[0][1], crews, coarse, rng, prices[: -ROUNDS + 1])
        starts.append((candidates.value(kicked, coarse), kicked))
        starts.sort(key=lambda candidate: -candidate[0])
        tell(0.3 + 0.3 * (k + 1) / KICKS)
    return starts


def _polished(plans: list[Plan], crews: list[Crew], finer: Stage, rng: np.random.Generator) -> Plan:
    """Return the better of the two best plans after improving both on more particles."""
    staged = (candidates.at_stage(start, finer) for start in plans)
    ranked = sorted(staged, key=lambda candidate: -candidates.value(candidate, finer))
    polished = []
    for current in ranked[:2]:
        for _ in range(2):
            for u in range(len(crews)):
                current = _improve(current, u, crews, finer, rng, 0, 3)
        polished.append((candidates.value(current, finer), current))
    return max(polished, key=lambda candidate: candidate[0])[1]


def _as_flown(plan: Plan, crews: list[Crew], executed: Stage, rng: np.random.Generator) -> Plan:
    """Return a plan improved with its legs as flown.

    Smeared-out legs also search over land. A boat whose legs end at the coast with time left gets a
    new rectangle.
    """
    best = candidates.at_stage(plan, executed)
    for turn in range(2):
        for u in range(len(crews)):
            best = _settle(best, u, crews, executed, rng, 3 if turn == 0 else 2)
            if best[u] is None or (turn == 0 and _filled(best[u]) < FILLED):
                best = _improve(best, u, crews, executed, rng, DRAWN // 3, 3)
    return best


def _filled(choice: Choice | None) -> float:
    """Return the share of its search time that a unit uses."""
    if choice is None or choice.flown.sailed[0] is None:
        return 1.0
    crew, flown = choice.crew, choice.flown
    _, room = crew.available.slot(crew.zero + float(flown.start[0]))
    return float(flown.duration[0]) / float(room)


def _try_standard_patterns(
    plan: Plan, crews: list[Crew], few: Stage, executed: Stage, rng: np.random.Generator
) -> Plan:
    """Return a plan in which units fly standard patterns where that raises the POS.

    The strongest unit comes first.
    """
    best = list(plan)
    for u in _order(crews, rng, 0):
        others = [*best[:u], None, *best[u + 1 :]]
        for choice in drawn.best(best, u, crews[u], few, executed):
            tried: Plan = [*others[:u], choice, *others[u + 1 :]]
            if not choice.flown.possible[0] or not candidates.apart(tried, executed):
                continue
            settled = _settle(tried, u, crews, executed, rng, 2)
            best = max([best, settled], key=lambda one: candidates.value(one, executed))
    return best


def _better(
    plan: Plan,
    rival: Plan,
    crews: list[Crew],
    executed: Stage,
    judge: Stage,
    rng: np.random.Generator,
) -> Plan:
    """Return the better of a plan and of an improved rival; the judging particles decide.

    In the rival, units need not keep apart. If it finds more, its best sorties stay, units too near
    to them get new rectangles, and all are improved. On the judging particles the result is never
    worse than a rival that keeps the separation.
    """
    if candidates.value(rival, judge) <= candidates.value(plan, judge):
        return plan
    separated: Plan = [None] * len(crews)
    alone = [0.0 if choice is None else candidates.value([choice], judge) for choice in rival]
    for u in np.argsort(alone)[::-1].tolist():
        tried: Plan = [*separated[:u], rival[u], *separated[u + 1 :]]
        separated = tried if candidates.apart(tried, judge) else separated
    improved = candidates.at_stage(_as_flown(separated, crews, executed, rng), judge)
    return max([plan, separated, improved], key=lambda made: candidates.value(made, judge))


def _alone(crews: list[Crew], coarse: Stage, executed: Stage, rng: np.random.Generator) -> Plan:
    """Return each unit's choice as if no other unit searched."""
    empty: Plan = [None] * len(crews)
    alone: Plan = []
    for u in range(len(crews)):
        start = _improve(empty, u, crews, coarse, rng, DRAWN, 4)
        alone.append(_settle(candidates.at_stage(start, executed), u, crews, executed, rng, 2)[u])
    return alone


def swarm_of(
    tracks: Tracks, spec: PlanSpec, survival: Sequence[Survival | None], plane: Plane
) -> rectangles.Swarm:
    """Return tracks in the kernels' layout: positions on the plane and worth of finding."""
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    value = np.where(tracks.adrift, bound.worth(tracks, survival, spec.objective), -1.0)
    turn = None if tracks.turn is None else tracks.turn - tracks.time[0]
    flow = None
    if tracks.flow is not None:
        flow = *record.velocity(tracks, plane, x, y), np.nan_to_num(tracks.flow[2])
    return rectangles.swarm(tracks.time - tracks.time[0], x, y, value, tracks.scenario, turn, flow)


def _order(crews: Sequence[Crew], rng: np.random.Generator, k: int) -> list[int]:
    """Return the order in which units get their first rectangles.

    In start 0 the strongest comes first; in the others the order is random.
    """
    strength = [crew.widest * crew.unit.search_speed * crew.available.search for crew in crews]
    return (
        sorted(range(len(crews)), key=lambda u: -strength[u])
        if k == 0
        else rng.permutation(len(crews)).tolist()
    )


def _kick(
    current: Plan,
    crews: Sequence[Crew],
    stage: Stage,
    rng: np.random.Generator,
    prices: Sequence[float],
) -> Plan:
    """Return the plan with two units replanned from scratch and the others then improved."""
    redone = rng.permutation(len(crews))[:2].tolist()
    kicked: Plan = [None if u in redone else choice for u, choice in enumerate(current)]
    for u in redone:
        kicked = _improve(kicked, u, crews, replace(stage, price=prices[0]), rng, DRAWN // 2, 3)
    for price in prices:
        for u in rng.permutation(len(crews)).tolist():
            drawn = DRAWN // 2 if kicked[u] is None else 0
            kicked = _improve(kicked, u, crews, replace(stage, price=price), rng, drawn, 3)
    return kicked


def _improve(
    current: Plan,
    u: int,
    crews: Sequence[Crew],
    stage: Stage,
    rng: np.random.Generator,
    drawn: int,
    times: int,
) -> Plan:
    """Return the plan with unit u's rectangle replaced if a better one is found."""
    score, rows, present, value = _scorer(
        current, u, crews[u], stage, lambda left: _draw(crews[u], stage, left, rng, drawn)
    )
    if len(rows) == 0:
        return current
    scores = score(rows)
    for turn in range(times):
        keep = np.argsort(-scores, kind="stable")[:PARENTS]
        rows, scores = rows[keep], scores[keep]
        children = _vary(rows[rng.integers(len(rows), size=CHILDREN)], crews[u], rng, 0.5**turn)
        rows, scores = np.concatenate([rows, children]), np.concatenate([scores, score(children)])
    return _accept(current, u, crews[u], stage, rows, scores, present, value)


def _settle(
    current: Plan, u: int, crews: Sequence[Crew], stage: Stage, rng: np.random.Generator, times: int
) -> Plan:
    """Return the plan with unit u's rectangle moved a little and started at its best corner."""
    present = current[u]
    crew = crews[u] if present is None else present.crew
    score, rows, present, value = _scorer(current, u, crew, stage, lambda left: np.empty((0, 8)))
    if len(rows) == 0:
        return current
    rows = np.repeat(rows, 4, axis=0)
    rows[:, ALONG], rows[:, ACROSS] = [1, 1, -1, -1], [1, -1, 1, -1]
    scores = score(rows)
    for turn in range(times):
        keep = np.argsort(-scores, kind="stable")[:4]
        rows, scores = rows[keep], scores[keep]
        children = _vary(rows[rng.integers(len(rows), size=24)], crew, rng, 0.25 * 0.5**turn)
        rows, scores = np.concatenate([rows, children]), np.concatenate([scores, score(children)])
    return _accept(current, u, crew, stage, rows, scores, present, value)


def _scorer(
    current: Plan, u: int, crew: Crew, stage: Stage, draw: Callable[[Array], Array]
) -> tuple[Callable[[Array], Array], Array, Choice | None, float]:
    """Return a scoring function for rectangles of unit u, start rectangles, its own, and the plan's
    value.

    draw: returns rectangles, given the probability of each particle that the others leave, (m,).
    """
    others = [choice for k, choice in enumerate(current) if choice is not None and k != u]
    present = current[u]
    time = present.find.time if present else math.inf
    undetected_share, later = joint.others(
        [choice.find for choice in others], time, stage.nodes, stage.m
    )
    undetected = stage.weight[:, None] * undetected_share
    rows = draw(undetected.sum(axis=1))
    # as kernels read them, once for all rectangles
    factor, undetected, later = (
        np.ascontiguousarray(v, np.float32) for v in joint.by_factor(crew.factor, undetected, later)
    )
    if present:
        rows = np.concatenate([present.row[None, :], rows])
    smeared = not stage.executed or crew.random

    value = candidates.value(current, stage)
    level = value or 1.0

    def score(rows: Array) -> Array:
        """Return the gain of rectangles beside those of the other units, shape (c,)."""
        flown = rectangle.fly(crew, rows, stage.executed)
        allowed = flown.possible.copy()
        cost = np.zeros(len(rows))
        near = candidates.too_near(others, rows, flown, stage)
        if math.isinf(stage.price):
            allowed &= np.all(near == 0, axis=0)
        else:
            for own in near:
                cost += stage.price * own / np.sqrt(flown.length * flown.width + 1)
        scores = np.full(len(rows), -1.0)
        scored = np.flatnonzero(allowed)
        if len(scored) == 0:
            return scores
        if smeared:
            table, coverage = rectangle.smeared(
                crew, rows[scored], Sweeps(*(v[scored] for v in flown))
            )
            scores[scored] = rectangles.gains(
                stage.swarm,
                crew.random,
                table,
                coverage,
                factor,
                rectangle.STEP,
                crew.curve,
                undetected,
                later,
            )
        else:
            paths = [rectangle.path(crew, rows[k], flown, int(k)) for k in scored]
            scores[scored] = sweeps.gains(
                stage.swarm, crew.table, paths, crew.width, factor, undetected, later
            )
        return np.where(
            allowed,
            np.maximum(scores * (1 - PATIENCE * rows[:, WAIT] / 3600) - level * cost, -0.5),
            -1.0,
        )

    return score, rows, present, value


def _accept(
    current: Plan,
    u: int,
    crew: Crew,
    stage: Stage,
    rows: Array,
    scores: Array,
    present: Choice | None,
    value: float,
) -> Plan:
    """Return the plan with unit u's best rectangle, unless that lowers its value `value`."""
    best = int(np.argmax(scores))
    if scores[best] <= -1:
        return current if present is None else [*current[:u], None, *current[u + 1 :]]
    improved: Plan = [*current[:u], candidates.choose(crew, rows[best], stage), *current[u + 1 :]]
    if math.isfinite(stage.price) or present is None or scores[0] < 0:
        return improved
    # Where worth falls with time, scores assume a fixed order of sorties: only the plan's value
    # decides.
    better = candidates.value(improved, stage) >= NEAR * value
    return improved if better else current


def _draw(
    crew: Crew, stage: Stage, undetected: Array, rng: np.random.Generator, count: int
) -> Array:
    """Return random rectangles, (count, 8), about undetected particles.

    undetected: probability of each particle, (m,), that it exists and the other units miss it.
    """
    if count == 0 or undetected.sum() <= 0 or not crew.available.spans:
        return np.empty((0, 8))
    edges = stage.swarm.time.shape[0]
    share = np.cumsum(undetected) / undetected.sum()
    i = np.minimum(np.searchsorted(share, rng.random(count)), stage.m - 1)
    x, y = (stage.swarm.at_edges(v) for v in (stage.swarm.x, stage.swarm.y))
    arrival = crew.available.arrival(*crew.plane.round(x[edges // 2, i], y[edges // 2, i]))
    slack = np.maximum(crew.available.spans[-1][1] - crew.shortest - arrival, 0.0)
    wait = np.where(rng.random(count) < 0.5, 0.0, rng.random(count) * slack)
    start, duration = crew.available.slot(arrival + wait)
    middle = np.clip(
        np.searchsorted(stage.swarm.time, start - crew.zero + duration / 2) - 1, 0, edges - 1
    )
    # Half of the centres are particles; the others lie between two particles.
    j = np.minimum(np.searchsorted(share, rng.random(count)), stage.m - 1)
    between = np.where(rng.random(count) < 0.5, 0.0, rng.random(count) * 0.5)
    rows = np.zeros((count, 8))
    rows[:, X] = x[middle, i] + between * (x[middle, j] - x[middle, i])
    rows[:, Y] = y[middle, i] + between * (y[middle, j] - y[middle, i])
    rows[:, TURN] = rng.random(count) * math.pi
    rows[:, SPACING] = np.log(max(crew.widest, 1.0)) + rng.uniform(-1.2, 1.6, count)
    rows[:, SPACING] = np.maximum(rows[:, SPACING], math.log(max(crew.unit.least_spacing, 1.0)))
    rows[:, ASPECT] = rng.uniform(-0.5, 1.8, count)
    rows[:, WAIT] = wait
    rows[:, ALONG], rows[:, ACROSS] = rng.choice([-1.0, 1.0], (2, count))
    return rows


def _vary(rows: Array, crew: Crew, rng: np.random.Generator, size: float) -> Array:
    """Return randomly varied rectangles.

    size: of the steps, as a share of the rectangles' own sizes.
    """
    varied = rows.copy()
    count = len(rows)
    step = rng.standard_normal((count, 6)) * size
    # leave some parameters unchanged, so that one can improve without the others
    step *= rng.random((count, 6)) < 0.6
    side = np.sqrt(np.exp(rows[:, SPACING]) * crew.unit.search_speed * crew.available.search)
    varied[:, X] += 0.3 * side * step[:, 0]
    varied[:, Y] += 0.3 * side * step[:, 1]
    varied[:, TURN] += 0.5 * step[:, 2]
    varied[:, SPACING] = np.maximum(
        varied[:, SPACING] + 0.3 * step[:, 3], math.log(max(crew.unit.least_spacing, 1.0))
    )
    varied[:, ASPECT] += 0.5 * step[:, 4]
    varied[:, WAIT] = np.maximum(varied[:, WAIT] + 5400.0 * step[:, 5], 0.0)
    later = varied[:, WAIT] - rows[:, WAIT]  # a drifting frame has moved on by then
    varied[:, X] += crew.manner.east * later
    varied[:, Y] += crew.manner.north * later
    varied[:, ALONG] *= np.where(rng.random(count) < 0.1, -1, 1)
    varied[:, ACROSS] *= np.where(rng.random(count) < 0.1, -1, 1)
    return varied
