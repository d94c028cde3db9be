"""Placement of ships that tow arrays: the ways with the highest probability of hearing the target.

Start positions, courses and turns span the search space. The search begins with many ways on few
particles and goes on with fewer ways on more particles. At each stage it moves each way about in
ever smaller steps as long as that improves the result. The first choice takes the tried ways that
are best together. After that, ships are placed in turn, each given what all others have missed.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from drift.evidence.sensors import unknown
from drift.planning.arrays import heard, ways
from drift.planning.arrays.heard import Hearer
from drift.planning.arrays.ways import Sea, Ways
from drift.planning.search import planning_tracks
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from geo.array import Array

BINS = 24  # most time bins when ways are compared
COARSE, FINE = (
    0.1,
    0.02,
)  # `share` of heard.missed, at first and at last
TRIED = 640  # ways that are tried at first
# Of each stage: particles, ways that are kept, rounds of local search, `share` of heard.missed.
STAGES = ((150, 160, 0, COARSE), (600, 12, 2, COARSE), (1_500, 4, 2, 0.05), (4_000, 2, 1, FINE))
FIRST = 1  # stage on whose particles the ways of all ships are first chosen together
STARTS = 40  # ways of the first ship from which this first choice starts
# first steps: share of the start area's size, course [deg], share of the way before the turn
STEPS = (0.10, 12.0, 0.15)
TURNS = 3  # most rounds in which all ships are placed again
WORTH = 1e-3  # relative gain of a round below which the search ends
POOL = 4  # best ways of each ship that are kept as alternatives


@dataclass(frozen=True, eq=False)
class Placed:
    """A ship and its chosen way."""

    sea: Sea
    way: Ways  # one
    value: float  # probability that this ship alone hears the target
    adds: float  # probability that it adds to the other ships


@dataclass(frozen=True, eq=False)
class Placement:
    """The chosen ways of all ships and their value."""

    placed: tuple[Placed, ...]
    # probability that any of them hears the target, on the particles on which they were placed
    value: float
    standard_error: float  # of `value`, as a mean over these particles
    particles: int
    # other plans and their values on the same particles
    alternatives: tuple[tuple[str, float], ...] = ()


Tell = Callable[[float], None]


def best_ways(
    seas: Sequence[Sea], tracks: Tracks, seed: int, tell: Tell = lambda share: None
) -> Placement:
    """Return the best ways that are found for the ships.

    Args:
        seas: where and when each ship may tow.
        tracks: planning particles; their weights sum to 1.
        seed: of the ways that are tried at first.
        tell: callback that receives the progress, 0 to 1.

    Raises:
        ValueError: a ship has no feasible way.
    """
    tracks = planning_tracks.coarser(tracks, BINS)
    levels = [_sampled(tracks, count) for count, *_ in STAGES]
    total = len(seas) * (TURNS if len(seas) > 1 else 1)
    chosen: list[Ways | None] = [None] * len(seas)
    pools: list[list[Ways]] = [[] for _ in seas]
    hearers_by_stage = [[heard.hearer(sea, level) for level in levels] for sea in seas]
    done = 0

    def weight_left(number: int, stage: int) -> Array:
        """Return weight times what all other ships miss at a stage, (m, factors)."""
        hearers = [own[stage] for own in hearers_by_stage]
        others = [
            None if other == number or way is None else heard.missed(hearers[other], way, FINE)[0]
            for other, way in enumerate(chosen)
        ]
        return levels[stage].weight[:, None] * besides(hearers, others, number)

    def report_progress() -> None:
        """Report the progress."""
        nonlocal done
        done += 1
        tell(min(done / total, 1.0))

    tried = [_initial_ways(sea, tracks.time, seed + number) for number, sea in enumerate(seas)]
    for number, way in enumerate(
        _first_choice([own[FIRST] for own in hearers_by_stage], tried, levels[FIRST].weight)
    ):
        chosen[number] = way
    value = _value(hearers_by_stage, chosen, levels[-1])
    for _ in range(TURNS if len(seas) > 1 else 1):
        before = value
        for number, sea in enumerate(seas):
            old = chosen[number]
            assert old is not None
            weights = [weight_left(number, stage) for stage in range(len(levels))]
            pool = _local_search(
                sea,
                hearers_by_stage[number],
                weights,
                ways.join_ways([old, *pools[number], tried[number]]),
            )
            chosen[number] = pool[0]
            new = _value(hearers_by_stage, chosen, levels[-1])
            if new > value or not pools[number]:
                value, pools[number] = max(new, value), pool
            if new < value:
                chosen[number] = old
            report_progress()
        if value < before * (1 + WORTH):
            break
    tell(1.0)
    return _placement(
        seas, hearers_by_stage, [way for way in chosen if way is not None], pools, levels[-1]
    )


def _first_choice(hearers: Sequence[Hearer], tried: Sequence[Ways], weight: Array) -> list[Ways]:
    """Return the tried ways, one for each ship, that are best together.

    The search starts from each of the best ways of the first ship. Each ship in turn then takes its
    own best way, given what all others miss.
    """
    missed = [
        heard.missed(hearer, some, COARSE) for hearer, some in zip(hearers, tried, strict=True)
    ]
    best, best_indices = -math.inf, [0] * len(tried)
    value_alone = (1 - missed[0]).reshape(len(tried[0]), -1) @ (
        weight[:, None] * hearers[0].chances
    ).ravel()
    for first in np.argsort(-value_alone, kind="stable")[
        : STARTS if len(tried) > 1 else 1
    ].tolist():
        taken: list[int | None] = [first] + [None] * (len(tried) - 1)
        value = 0.0
        for _ in range(TURNS):
            for k in (*range(1, len(tried)), 0):
                own = [None if at is None else missed[j][at] for j, at in enumerate(taken)]
                left = (weight[:, None] * besides(hearers, own, k)).ravel()
                values = missed[k].reshape(len(tried[k]), -1) @ left
                taken[k], value = int(np.argmin(values)), float(weight.sum() - values.min())
        if value > best:
            best, best_indices = value, [at for at in taken if at is not None]
    return [some.take(np.array([at])) for some, at in zip(tried, best_indices, strict=True)]


def _sampled(tracks: Tracks, count: int) -> Tracks:
    """Return at most `count` of the particles."""
    return tracks if count >= tracks.m else planning_tracks.sample(tracks, count)


def besides(hearers: Sequence[Hearer], missed: Sequence[Array | None], number: int) -> Array:
    """Return the probability that all other arrays miss each particle, shape (m, factors).

    Arrays of one group (equal key) share an unknown; it is averaged over after multiplying their
    misses.

    Args:
        hearers: all arrays.
        missed: of each array the probability of missing, (m, factors); None: not placed.
        number: index of the array that is left out.

    Returns:
        The probability by value of the left-out array's unknown, times the probability of that
            value.
    """
    keys = [unknown.key(hearer.sea.tow.sensor) for hearer in hearers]
    others_miss, own_group = np.ones((hearers[number].tracks.m, 1)), hearers[number].chances
    for key in dict.fromkeys(keys):
        members = [k for k, other in enumerate(keys) if other == key]
        part = np.ones((len(others_miss), hearers[members[0]].chances.size))
        for k in members:
            one = missed[k]
            if k != number and one is not None:
                part *= one
        if key == keys[number]:
            own_group = part * own_group
        else:
            others_miss *= (part @ hearers[members[0]].chances)[:, None]
    return np.asarray(others_miss * own_group)


def together(hearers: Sequence[Hearer], missed: Sequence[Array]) -> Array:
    """Return the probability that all arrays miss each particle, shape (m,).

    Args:
        hearers: all arrays.
        missed: of each array the probability of missing, (m, factors).
    """
    return np.asarray((besides(hearers, missed, 0) * missed[0]).sum(axis=1))


def worth(hearer: Hearer, some: Ways, weight: Array, share: float) -> Array:
    """Return the weight that each way hears, shape (c,).

    Args:
        hearer: the array and the particles.
        some: candidate ways (c).
        weight: of each particle and value of the unknown, (m, factors).
        share: accuracy of the detection model, as in `heard.missed`.
    """
    return np.asarray(
        (1 - heard.missed(hearer, some, share)).reshape(len(some), -1) @ weight.ravel()
    )


def _initial_ways(sea: Sea, time: Array, seed: int, many: int = TRIED) -> Ways:
    """Return feasible ways spread over the search space by a Halton sequence.

    Raises ValueError if none of the points is feasible.
    """
    points = qmc.Halton(5, seed=seed).random(16 * many)
    west, south, east, north = sea.begins.shape.bounds
    x, y = west + (east - west) * points[:, 0], south + (north - south) * points[:, 1]
    lon, lat = sphere.destination(*sea.middle, x, y)
    low, sector = (
        (sea.tow.courses[0], np.mod(sea.tow.courses[1] - sea.tow.courses[0], 2 * math.pi))
        if sea.tow.courses
        else (0.0, 2 * math.pi)
    )
    course, second = (low + sector * points[:, k] for k in (2, 3))
    turn = 0.15 + 0.7 * points[:, 4]
    two = Ways(lon, lat, course, second, turn)
    one = ways.straight(two)
    kinds = [one] if sea.tow.legs == 1 else [one, two]
    feasible = []
    for kind in kinds:
        which = np.flatnonzero(ways.possible(sea, kind, time))[: many // len(kinds)]
        feasible.append(kind.take(which))
    tried = ways.join_ways(feasible)
    if not len(tried):
        raise ValueError(
            f"{sea.tow.name} has no track: none of {16 * many:,} from its start area keeps to its courses and its area, clear of "
            "land, for half an hour"
        )
    return tried


def _local_search(
    sea: Sea, hearers: Sequence[Hearer], weights: Sequence[Array], start: Ways
) -> list[Ways]:
    """Return the best ways that the stages of local search find, best first."""
    candidates = start
    west, south, east, north = sea.begins.shape.bounds
    size = math.sqrt((east - west) * (north - south))
    scale = np.array([STEPS[0] * size, math.radians(STEPS[1]), STEPS[2]])
    for stage, (_, many, rounds, share) in enumerate(STAGES):
        candidates, values = _best(
            candidates, worth(hearers[stage], candidates, weights[stage], share), many
        )
        for _ in range(rounds):
            moved, of = _neighbours(sea, candidates, scale)
            good = ways.possible(sea, moved, hearers[stage].tracks.time)
            moved, of = moved.take(np.flatnonzero(good)), of[good]
            new_values = (
                worth(hearers[stage], moved, weights[stage], share) if len(moved) else np.empty(0)
            )
            better = False
            for k in range(len(candidates)):
                own = np.flatnonzero(of == k)
                if own.size and new_values[own].max() > values[k]:
                    best = own[np.argmax(new_values[own])]
                    values[k], better = new_values[best], True
                    candidates = _replace_way(candidates, k, moved, int(best))
            if not better:
                scale = scale / 2
        scale = scale / 2 if rounds else scale
    candidates, _ = _best(candidates, values, POOL)
    return [candidates.take(np.array([k])) for k in range(len(candidates))]


def _best(some: Ways, values: Array, many: int) -> tuple[Ways, Array]:
    """Return the ways of highest value, best first, and their values."""
    order = np.argsort(-values, kind="stable")[:many]
    return some.take(order), values[order]


def _replace_way(some: Ways, k: int, others: Ways, other: int) -> Ways:
    """Return ways with number k replaced by another one."""
    columns = []
    for name in Ways.__dataclass_fields__:
        column = getattr(some, name).copy()
        column[k] = getattr(others, name)[other]
        columns.append(column)
    return Ways(*columns)


def _neighbours(sea: Sea, some: Ways, scale: Array) -> tuple[Ways, Array]:
    """Return each way moved in every direction, and the index of the way it came from."""
    step, turned, share = scale
    moved, origin = [], []
    numbers = np.arange(len(some))

    def add(
        lon: Array, lat: Array, course: Array, second: Array, turn: Array, which: Array
    ) -> None:
        moved.append(Ways(lon, lat, course, second, np.clip(turn, 0.02, 1.0)).take(which))
        origin.append(numbers[which])

    all_ways = numbers
    for east, north in (
        (1, 0),
        (-1, 0),
        (0, 1),
        (0, -1),
        (0.7, 0.7),
        (-0.7, 0.7),
        (0.7, -0.7),
        (-0.7, -0.7),
    ):
        lon, lat = sphere.destination(some.lon, some.lat, east * step, north * step)
        add(lon, lat, some.course, some.second, some.turn, all_ways)
    bent = np.flatnonzero(some.turn < 1)
    for sign in (-1, 1):
        course, second = some.course + sign * turned, some.second + sign * turned
        # turn the whole way about its start
        add(some.lon, some.lat, course, second, some.turn, all_ways)
        if bent.size:
            add(some.lon, some.lat, course, some.second, some.turn, bent)
            add(some.lon, some.lat, some.course, second, some.turn, bent)
            add(
                some.lon,
                some.lat,
                some.course,
                some.second,
                np.minimum(some.turn + sign * share, 0.98),
                bent,
            )
    if sea.tow.legs == 2:
        unbent = np.flatnonzero(some.turn >= 1)
        for sign in (-1, 1):
            if unbent.size:
                add(
                    some.lon,
                    some.lat,
                    some.course,
                    some.course + sign * 4 * turned,
                    np.full(len(some), 0.5),
                    unbent,
                )
    return ways.join_ways(moved), np.concatenate(origin)


def _value(
    hearers_by_stage: Sequence[Sequence[Hearer]], chosen: Sequence[Ways | None], level: Tracks
) -> float:
    """Return the probability that any of the placed arrays hears the target."""
    some = [
        (own[-1], heard.missed(own[-1], way, FINE)[0])
        for own, way in zip(hearers_by_stage, chosen, strict=True)
        if way is not None
    ]
    return float((1 - together(*zip(*some, strict=True))) @ level.weight)


def _placement(
    seas: Sequence[Sea],
    hearers_by_stage: Sequence[Sequence[Hearer]],
    chosen: Sequence[Ways],
    pools: Sequence[Sequence[Ways]],
    level: Tracks,
) -> Placement:
    """Return the placement with the value of each ship and of the alternatives."""
    last = [hearers[-1] for hearers in hearers_by_stage]
    own = [heard.missed(hearer, way, FINE)[0] for hearer, way in zip(last, chosen, strict=True)]
    all_miss = together(last, own)
    value = float((1 - all_miss) @ level.weight)
    error = math.sqrt(max(float(((1 - all_miss - value) ** 2) @ level.weight**2), 0.0))
    placed = []
    others: list[tuple[str, float]] = []
    for k, (sea, way) in enumerate(zip(seas, chosen, strict=True)):
        rest = besides(last, own, k)
        alone = float((1 - own[k] @ last[k].chances) @ level.weight)
        placed.append(Placed(sea, way, alone, float((rest.sum(axis=1) - all_miss) @ level.weight)))
        instead = (
            [(f"{sea.tow.name} on its next best way", pools[k][1])] if len(pools[k]) > 1 else []
        )
        begins = _middle(sea, level.time)
        if begins is not None:
            instead.append(
                (f"{sea.tow.name} straight on from the middle of its start area", begins)
            )
        for name, other in instead:
            left = (rest * heard.missed(last[k], other, FINE)[0]).sum(axis=1)
            others.append((name, float((1 - left) @ level.weight)))
    return Placement(tuple(placed), value, error, level.m, tuple(others))


def _middle(sea: Sea, time: Array) -> Ways | None:
    """Return the way without planning: from the area's middle, straight on a permitted course.

    None if no such way is feasible.
    """
    centre = sea.begins.shape.representative_point()
    lon, lat = sphere.destination(*sea.middle, centre.x, centre.y)
    low = sea.tow.courses[0] if sea.tow.courses else 0.0
    wide = np.mod(sea.tow.courses[1] - low, 2 * math.pi) if sea.tow.courses else 2 * math.pi
    course = low + wide * (np.arange(8) + 0.5) / 8
    some = Ways(np.full(8, float(lon)), np.full(8, float(lat)), course, course, np.ones(8))
    which = np.flatnonzero(ways.possible(sea, some, time))
    return some.take(which[:1]) if which.size else None
