"""A rectangle for each unit: those that together find most of particles that move.

Each unit in turn is given the rectangle that adds most to what the others find (block-coordinate ascent), again and again, from
several beginnings. A rectangle is sought among many drawn where the particles are, then around the best of them in ever
smaller steps (an evolution strategy): first with its legs smeared out, on few particles, then with its legs as flown, on many.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drift import bound, patterns, rectangle, together
from drift import reach as reaches
from drift import tracks as record
from drift.rectangle import ACROSS, ALONG, ASPECT, SPACING, TURN, WAIT, Crew, Flown, X, Y
from drift.sortie import PlanSpec, Sortie, Survival, Unit
from drift.tasking import Alternative, Tasking
from drift.together import Find
from drift.tracks import Plane, Tracks
from geo import sphere
from kernels import rectangles, sweeps

Array = npt.NDArray[Any]

BINS = 16  # of time, at most, while legs are smeared out
FEW, MORE, MANY = 3_000, 10_000, 16_000  # particles of the first, second and third stage
BEGINNINGS = 4
ROUNDS = 4  # of all units in the first stage, at most
DRAWN = 768  # rectangles at the beginning of a search
PATIENCE = 2e-3  # share of what is found that an hour of waiting must add
CHILDREN, PARENTS = 96, 12


@dataclass(frozen=True)
class Proposal:
    """What each unit is to do, by takeoff, and what that would find on the tracks that it was made on."""

    taskings: tuple[Tasking, ...]
    seen: float
    alternatives: tuple[Alternative, ...]


@dataclass(frozen=True)
class Stage:
    """Particles and how a rectangle is scored on them."""

    m: int
    swarm: rectangles.Swarm
    weight: Array  # (m,)
    nodes: Array  # (nodes,) weights of the joint nodes
    executed: bool  # legs as flown; else smeared out
    separation: float


@dataclass(frozen=True)
class Choice:
    """A unit's rectangle, and what it finds."""

    crew: Crew
    row: Array
    flown: Flown
    find: Find


Plan = list[Choice | None]  # one a unit; None: it cannot search, or has not been given anything


def plan(
    tracks: Tracks,
    units: Sequence[Unit],
    spec: PlanSpec,
    seed: int,
    survival: Sequence[Survival | None],
    tell: Callable[[float], None] | None = None,
) -> Proposal:
    """Return one sortie for each unit that can search, so that together they find most of the tracks' particles.

    survival: of each scenario; used where spec.objective is "alive". tell: called with the share that is done.
    """
    tell = tell or (lambda share: None)
    rng = np.random.Generator(np.random.Philox(key=seed))
    plane = record.plane(tracks)
    factor, nodes = together.nodes(units)
    place = (plane.lon, plane.lat)
    zero = float(tracks.time[0])
    crews = [
        rectangle.crew(unit, reaches.reach(unit, spec, place), plane, zero, factor[u]) for u, unit in enumerate(units)
    ]

    def stage(some: Tracks, executed: bool) -> Stage:
        return Stage(some.m, _swarm(some, spec, survival, plane), some.weight, nodes, executed, spec.separation)

    coarse = record.coarser(tracks, BINS)
    few, more = (stage(record.sample(coarse, min(tracks.m, n)), False) for n in (FEW, MORE))
    found: list[tuple[float, Plan]] = []
    for k in range(BEGINNINGS):
        begun: Plan = [None] * len(crews)
        order = _order(crews, rng, k)
        for turn in range(ROUNDS):
            before = _value(begun, few)
            for u in order:
                begun = _improve(begun, u, crews, few, rng, DRAWN if turn == 0 else DRAWN // 3, 4)
            if _value(begun, few) < before * 1.002:
                break
        found.append((_value(begun, few), begun))
        tell(0.5 * (k + 1) / BEGINNINGS)
    found.sort(key=lambda one: -one[0])
    polished = []
    for _, begun in found[:2]:
        now = _moved(begun, more)
        for _ in range(2):
            for u in range(len(crews)):
                now = _improve(now, u, crews, more, rng, 0, 3)
        polished.append((_value(now, more), now))
    tell(0.7)
    many, whole = stage(record.sample(tracks, min(tracks.m, MANY)), True), stage(tracks, True)
    best = _moved(max(polished, key=lambda one: one[0])[1], many)
    for turn in range(2):
        for u in range(len(crews)):
            best = _settle(best, u, crews, many, rng, 3 if turn == 0 else 2)
    tell(0.9)
    best = _moved(best, whole)
    chosen = [choice for choice in best if choice is not None]
    if not chosen:
        return Proposal((), 0.0, ())
    gain = together.worth([choice.find for choice in chosen], nodes)
    none: Plan = [None] * len(crews)
    alone: Plan = []
    for u in range(len(crews)):
        begun = _improve(none, u, crews, few, rng, DRAWN, 4)
        alone.append(_settle(_moved(begun, many), u, crews, many, rng, 2)[u])
    rivals = [("each unit where it alone finds most", _moved(alone, whole)), *_by_hand(crews, tracks, many, whole)]
    alternatives = tuple(_against(name, rival, gain, tracks.weight, nodes) for name, rival in rivals)
    tell(1.0)
    return Proposal(_taskings(chosen, tracks.weight, nodes), float(tracks.weight @ gain), alternatives)


def _swarm(tracks: Tracks, spec: PlanSpec, survival: Sequence[Survival | None], plane: Plane) -> rectangles.Swarm:
    x, y = plane.flat(tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT)
    value = np.where(tracks.adrift, bound.worth(tracks, survival, spec.objective), -1.0)
    return rectangles.swarm(tracks.time - tracks.time[0], x, y, value, tracks.scenario)


def _order(crews: Sequence[Crew], rng: np.random.Generator, k: int) -> list[int]:
    """Return the order in which units are first given something: the strongest first, then at random."""
    strength = [crew.widest * crew.unit.search_speed * crew.reach.search for crew in crews]
    return sorted(range(len(crews)), key=lambda u: -strength[u]) if k == 0 else rng.permutation(len(crews)).tolist()


def _improve(now: Plan, u: int, crews: Sequence[Crew], stage: Stage, rng: np.random.Generator, drawn: int, times: int) -> Plan:
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
    before, later = together.others([choice.find for choice in rest], time, stage.nodes, stage.m)
    left = stage.weight[:, None] * before
    rows = draw(left.sum(axis=1))
    if old:
        rows = np.concatenate([old.row[None, :], rows])
    smeared = not stage.executed or crew.random

    def score(rows: Array) -> Array:
        flown = rectangle.fly(crew, rows, stage.executed)
        good = flown.possible.copy()
        if stage.separation > 0:
            for choice in rest:
                good &= rectangle.apart(rows, flown, choice.row, choice.flown) >= stage.separation
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
        return np.where(good, scores * (1 - PATIENCE * rows[:, WAIT] / 3600), -1.0)

    return score, rows, old


def _accept(now: Plan, u: int, crew: Crew, stage: Stage, rows: Array, scores: Array, old: Choice | None) -> Plan:
    """Return the plan with the best rectangle for unit u, unless the plan is worth less with it."""
    best = int(np.argmax(scores))
    if scores[best] < 0:
        return now if old is None else [*now[:u], None, *now[u + 1 :]]
    new: Plan = [*now[:u], _choose(crew, rows[best], stage), *now[u + 1 :]]
    # With worth that falls the score takes the order of sorties for fixed: the whole tells.
    return new if old is None or _value(new, stage) >= _value(now, stage) or scores[0] < 0 else now


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


SLACK = rectangle.SHORTEST  # [s] that waiting leaves for search


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
    new[:, SPACING] = np.maximum(
        new[:, SPACING] + 0.3 * step[:, 3], math.log(max(crew.unit.least_spacing, 1.0))
    )
    new[:, ASPECT] += 0.5 * step[:, 4]
    new[:, WAIT] = np.maximum(new[:, WAIT] + 5400.0 * step[:, 5], 0.0)
    new[:, ALONG] *= np.where(rng.random(count) < 0.1, -1, 1)
    new[:, ACROSS] *= np.where(rng.random(count) < 0.1, -1, 1)
    return new


def _choose(crew: Crew, row: Array, stage: Stage) -> Choice:
    """Return a rectangle with what it finds at this stage."""
    flown = rectangle.fly(crew, row[None, :], stage.executed)
    if stage.executed and not crew.random:
        chance, worth = sweeps.found(stage.swarm, crew.table, rectangle.path(crew, row, flown, 0), crew.width, crew.factor)
    else:
        table, coverage = rectangle.smeared(crew, row[None, :], flown)
        chance, worth = rectangles.found(
            stage.swarm, crew.random, table, coverage[0], crew.factor, rectangle.STEP, crew.curve
        )
    return Choice(crew, row, flown, Find(float(flown.start[0] + flown.duration[0] / 2), chance, worth))


def _moved(plan: Plan, stage: Stage) -> Plan:
    """Return the same rectangles with what they find at another stage; those that are not possible there are dropped."""
    made = [choice and _choose(choice.crew, choice.row, stage) for choice in plan]
    return [choice if choice and choice.flown.possible[0] else None for choice in made]


def _value(plan: Plan, stage: Stage) -> float:
    """Return what a plan finds at a stage."""
    finds = [choice.find for choice in plan if choice is not None]
    return float(stage.weight @ together.worth(finds, stage.nodes)) if finds else 0.0


def _by_hand(crews: Sequence[Crew], tracks: Tracks, stage: Stage, whole: Stage) -> list[tuple[str, Plan]]:
    """Return the plan of manuals: one square round the mean position, cut into strips by effort, of the best size for that."""
    able, times = [], []
    for crew in crews:
        start, duration = crew.reach.slot(crew.reach.arrival(crew.plane.lon, crew.plane.lat))
        if duration >= rectangle.SHORTEST:
            able.append((crew, float(duration) * crew.unit.search_speed))
            times.append(float(start - crew.zero + duration / 2))
    if not able:
        return []
    edges = stage.swarm.time.shape[0]
    middle = int(np.clip(np.searchsorted(stage.swarm.time, np.mean(times)), 0, edges - 1))
    x, y = (float(stage.weight @ v.reshape(stage.m, edges)[:, middle]) for v in (stage.swarm.x, stage.swarm.y))
    effort = np.array([crew.widest * track for crew, track in able])
    sizes = []
    for size in np.sqrt(effort.sum()) * np.geomspace(0.4, 3.0, 12):
        strips, west = [], x - size / 2
        for (crew, track), share in zip(able, effort / effort.sum(), strict=True):
            wide = size * share
            legs = max(math.floor((track + wide) / size), 1)
            spacing = max(wide / legs, crew.unit.least_spacing, 1.0)
            row = np.array([west + wide / 2, y, 0.0, math.log(spacing), math.log(track / legs / (legs * spacing)), 0.0, -1.0, -1.0])
            strips.append(_choose(crew, row, stage))
            west += wide
        made: Plan = [choice if choice.flown.possible[0] else None for choice in strips]
        sizes.append((_value(made, stage), made))
    return [("one square round the mean position, shared out by effort", _moved(max(sizes, key=lambda one: one[0])[1], whole))]


def _against(name: str, rival: Plan, gain: Array, weight: Array, nodes: Array) -> Alternative:
    """Return another plan beside what this one finds of each particle."""
    finds = [choice.find for choice in rival if choice is not None]
    other = together.worth(finds, nodes) if finds else np.zeros_like(gain)
    difference = float(weight @ (gain - other))
    error = math.sqrt(float(weight**2 @ (gain - other - difference) ** 2))
    return Alternative(name, float(weight @ other), difference, error)


def _taskings(chosen: Sequence[Choice], weight: Array, nodes: Array) -> tuple[Tasking, ...]:
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
    end = start + float(flown.duration[0]) if crew.random else pattern.legs.time[-1]
    first, last = ((math.radians(pattern.legs.lon[k]), math.radians(pattern.legs.lat[k])) for k in (0, -1))
    coverage = tuple(
        w * unit.search_speed * float(flown.duration[0]) / (length * width) for w in unit.sweep_width
    )
    sortie = Sortie(
        name=unit.name, kind=unit.kind, start=reaches.moment(start), end=reaches.moment(math.ceil(end)), law=unit.law,
        sweep_width=unit.sweep_width, shape=unit.shape, group=unit.group, area=pattern.area,
        coverage=coverage if crew.random else (), legs=None if crew.random else pattern.legs,
        speed=unit.search_speed, altitude=unit.altitude, spacing=spacing,
    )  # fmt: skip
    home = end + float(sphere.distance(*last, *np.radians(unit.return_to))) / unit.transit_speed
    there = float(sphere.distance(*crew.reach.base, *first)) / unit.transit_speed
    return Tasking(
        unit=unit, round=1, sortie=sortie, takeoff=reaches.moment(math.floor(start - there)), on_scene=sortie.start,
        off_scene=sortie.end, home=reaches.moment(math.ceil(home)), centre=centre, length=length, width=width,
        orientation=turn, creep=(turn - corner[1] * math.pi / 2) % (2 * math.pi), spacing=spacing, legs=legs, pos=pos,
    )  # fmt: skip
