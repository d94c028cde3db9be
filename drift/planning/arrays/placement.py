"""Where ships are to tow their arrays, so that they are the likeliest to hear the target.

Ways are looked for in the plan's whole space of begins, courses and turns: many at first on few
particles, and ever fewer on ever more, each moved about in ever smaller steps as long as that is
better. Of the ways that are tried at first those are taken that are the best together; then ships
are placed in turns, each for what all others have missed.
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

BINS = 24  # most bins of time in which ways are compared
COARSE, FINE = (
    0.1,
    0.02,
)  # parts of a relative way in which excess is taken once, as shares of the range, at first and at last
TRIED = 640  # ways that are tried at first
# Particles, ways that are kept, rounds of moving them about, parts.
STAGES = ((150, 160, 0, COARSE), (600, 12, 2, COARSE), (1_500, 4, 2, 0.05), (4_000, 2, 1, FINE))
FIRST = 1  # stage on whose particles all ships' ways are first chosen together
STARTS = 40  # ways of the first ship from which that begins
# first steps: of the size of where it may begin, degrees of course, of the turn's share
STEPS = (0.10, 12.0, 0.15)
TURNS = 3  # most times that all ships are placed again
WORTH = 1e-3  # share of the value by which placing a ship again is worth it
POOL = 4  # ways of each ship that alternatives are made of


@dataclass(frozen=True, eq=False)
class Placed:
    """A ship with the way that it is to go."""

    sea: Sea
    way: Ways  # one
    value: float  # probability that it hears the target, by itself
    adds: float  # what it adds to all others


@dataclass(frozen=True, eq=False)
class Placement:
    """Where ships are to tow."""

    placed: tuple[Placed, ...]
    # probability that any of them hears the target, on the particles on which they were placed
    value: float
    standard_error: float  # of `value`, as a mean over these
    particles: int
    # other plans and their values on the same particles
    alternatives: tuple[tuple[str, float], ...] = ()


Tell = Callable[[float], None]


def best_ways(
    seas: Sequence[Sea], tracks: Tracks, seed: int, tell: Tell = lambda share: None
) -> Placement:
    """Return the best ways that are found for ships among particles, whose weights have the sum 1.

    Raises ValueError where a ship has no way at all.
    """
    tracks = planning_tracks.coarser(tracks, BINS)
    levels = [_sampled(tracks, count) for count, *_ in STAGES]
    total = len(seas) * (TURNS if len(seas) > 1 else 1)
    chosen: list[Ways | None] = [None] * len(seas)
    pools: list[list[Ways]] = [[] for _ in seas]
    every = [[heard.hearer(sea, level) for level in levels] for sea in seas]
    done = 0

    def left(number: int, stage: int) -> Array:
        """Return what all other ships have missed of the particles of a stage, times their weights,
        (m, factors).
        """
        hearers = [own[stage] for own in every]
        others = [
            None if other == number or way is None else heard.missed(hearers[other], way, FINE)[0]
            for other, way in enumerate(chosen)
        ]
        return levels[stage].weight[:, None] * besides(hearers, others, number)

    def told() -> None:
        nonlocal done
        done += 1
        tell(min(done / total, 1.0))

    tried = [_tried(sea, tracks.time, seed + number) for number, sea in enumerate(seas)]
    for number, way in enumerate(
        _begun([own[FIRST] for own in every], tried, levels[FIRST].weight)
    ):
        chosen[number] = way
    value = _value(every, chosen, levels[-1])
    for _ in range(TURNS if len(seas) > 1 else 1):
        before = value
        for number, sea in enumerate(seas):
            old = chosen[number]
            assert old is not None
            weights = [left(number, stage) for stage in range(len(levels))]
            pool = _refined(
                sea, every[number], weights, ways.join_ways([old, *pools[number], tried[number]])
            )
            chosen[number] = pool[0]
            new = _value(every, chosen, levels[-1])
            if new > value or not pools[number]:
                value, pools[number] = max(new, value), pool
            if new < value:
                chosen[number] = old
            told()
        if value < before * (1 + WORTH):
            break
    tell(1.0)
    return _placement(seas, every, [way for way in chosen if way is not None], pools, levels[-1])


def _begun(hearers: Sequence[Hearer], tried: Sequence[Ways], weight: Array) -> list[Ways]:
    """Return ways of all ships that are good together, of those that were tried.

    From each of the best ways of the first on, each ship in turn takes the best of its own for what
    all others miss.
    """
    missed = [
        heard.missed(hearer, some, COARSE) for hearer, some in zip(hearers, tried, strict=True)
    ]
    best, found = -math.inf, [0] * len(tried)
    alone = (1 - missed[0]).reshape(len(tried[0]), -1) @ (
        weight[:, None] * hearers[0].chances
    ).ravel()
    for first in np.argsort(-alone, kind="stable")[: STARTS if len(tried) > 1 else 1].tolist():
        taken: list[int | None] = [first] + [None] * (len(tried) - 1)
        value = 0.0
        for _ in range(TURNS):
            for k in (*range(1, len(tried)), 0):
                own = [None if at is None else missed[j][at] for j, at in enumerate(taken)]
                left = (weight[:, None] * besides(hearers, own, k)).ravel()
                values = missed[k].reshape(len(tried[k]), -1) @ left
                taken[k], value = int(np.argmin(values)), float(weight.sum() - values.min())
        if value > best:
            best, found = value, [at for at in taken if at is not None]
    return [some.take(np.array([at])) for some, at in zip(tried, found, strict=True)]


def _sampled(tracks: Tracks, count: int) -> Tracks:
    return tracks if count >= tracks.m else planning_tracks.sample(tracks, count)


def besides(hearers: Sequence[Hearer], missed: Sequence[Array | None], number: int) -> Array:
    """Return the probability that all arrays but one miss each particle, with each value of that
    one's unknown (m, factors).

    missed: of each array, (m, factors); None: it is nowhere. Arrays of one key share an unknown,
    which is averaged after multiplying; the chances of that array's values are in what is returned.
    """
    keys = [unknown.key(hearer.sea.tow.sensor) for hearer in hearers]
    whole, own = np.ones((hearers[number].tracks.m, 1)), hearers[number].chances
    for key in dict.fromkeys(keys):
        members = [k for k, other in enumerate(keys) if other == key]
        part = np.ones((len(whole), hearers[members[0]].chances.size))
        for k in members:
            one = missed[k]
            if k != number and one is not None:
                part *= one
        if key == keys[number]:
            own = part * own
        else:
            whole *= (part @ hearers[members[0]].chances)[:, None]
    return np.asarray(whole * own)


def together(hearers: Sequence[Hearer], missed: Sequence[Array]) -> Array:
    """Return the probability that all arrays miss each particle (m,); missed: of each, (m,
    factors).
    """
    return np.asarray((besides(hearers, missed, 0) * missed[0]).sum(axis=1))


def worth(hearer: Hearer, some: Ways, weight: Array, share: float) -> Array:
    """Return the weight that each way hears, float64 (c,).

    weight: with the chances of its unknown's values in it, (m, factors); share: as heard.missed
    takes it.
    """
    return np.asarray(
        (1 - heard.missed(hearer, some, share)).reshape(len(some), -1) @ weight.ravel()
    )


def _tried(sea: Sea, time: Array, seed: int, many: int = TRIED) -> Ways:
    """Return ways that are possible, spread over all of them; raise ValueError where none is found."""
    points = qmc.Halton(5, seed=seed).random(16 * many)
    west, south, east, north = sea.begins.shape.bounds
    x, y = west + (east - west) * points[:, 0], south + (north - south) * points[:, 1]
    lon, lat = sphere.destination(*sea.middle, x, y)
    low, wide = (
        (sea.tow.courses[0], np.mod(sea.tow.courses[1] - sea.tow.courses[0], 2 * math.pi))
        if sea.tow.courses
        else (0.0, 2 * math.pi)
    )
    course, second = (low + wide * points[:, k] for k in (2, 3))
    turn = 0.15 + 0.7 * points[:, 4]
    two = Ways(lon, lat, course, second, turn)
    one = ways.straight(two)
    kinds = [one] if sea.tow.legs == 1 else [one, two]
    found = []
    for kind in kinds:
        which = np.flatnonzero(ways.possible(sea, kind, time))[: many // len(kinds)]
        found.append(kind.take(which))
    whole = ways.join_ways(found)
    if not len(whole):
        raise ValueError(
            f"{sea.tow.name} has no way: none of {16 * many:,} from where it may begin keeps to its courses and its area, clear of "
            "land, for half an hour"
        )
    return whole


def _refined(
    sea: Sea, every: Sequence[Hearer], weights: Sequence[Array], begun: Ways
) -> list[Ways]:
    """Return the best ways that are found from some, best first."""
    kept = begun
    west, south, east, north = sea.begins.shape.bounds
    size = math.sqrt((east - west) * (north - south))
    scale = np.array([STEPS[0] * size, math.radians(STEPS[1]), STEPS[2]])
    for stage, (_, many, rounds, share) in enumerate(STAGES):
        kept, values = _best(kept, worth(every[stage], kept, weights[stage], share), many)
        for _ in range(rounds):
            moved, of = _moved(sea, kept, scale)
            good = ways.possible(sea, moved, every[stage].tracks.time)
            moved, of = moved.take(np.flatnonzero(good)), of[good]
            found = worth(every[stage], moved, weights[stage], share) if len(moved) else np.empty(0)
            better = False
            for k in range(len(kept)):
                own = np.flatnonzero(of == k)
                if own.size and found[own].max() > values[k]:
                    best = own[np.argmax(found[own])]
                    values[k], better = found[best], True
                    kept = _with(kept, k, moved, int(best))
            if not better:
                scale = scale / 2
        scale = scale / 2 if rounds else scale
    kept, _ = _best(kept, values, POOL)
    return [kept.take(np.array([k])) for k in range(len(kept))]


def _best(some: Ways, values: Array, many: int) -> tuple[Ways, Array]:
    order = np.argsort(-values, kind="stable")[:many]
    return some.take(order), values[order]


def _with(some: Ways, k: int, others: Ways, other: int) -> Ways:
    columns = []
    for name in Ways.__dataclass_fields__:
        column = getattr(some, name).copy()
        column[k] = getattr(others, name)[other]
        columns.append(column)
    return Ways(*columns)


def _moved(sea: Sea, some: Ways, scale: Array) -> tuple[Ways, Array]:
    """Return each way moved about in each direction, and of which way each is made."""
    step, turned, share = scale
    found, of = [], []
    numbers = np.arange(len(some))

    def add(
        lon: Array, lat: Array, course: Array, second: Array, turn: Array, which: Array
    ) -> None:
        found.append(Ways(lon, lat, course, second, np.clip(turn, 0.02, 1.0)).take(which))
        of.append(numbers[which])

    every = numbers
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
        add(lon, lat, some.course, some.second, some.turn, every)
    bent = np.flatnonzero(some.turn < 1)
    for sign in (-1, 1):
        course, second = some.course + sign * turned, some.second + sign * turned
        # the whole way turned about its begin
        add(some.lon, some.lat, course, second, some.turn, every)
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
        whole = np.flatnonzero(some.turn >= 1)
        for sign in (-1, 1):
            if whole.size:
                add(
                    some.lon,
                    some.lat,
                    some.course,
                    some.course + sign * 4 * turned,
                    np.full(len(some), 0.5),
                    whole,
                )
    return ways.join_ways(found), np.concatenate(of)


def _value(
    every: Sequence[Sequence[Hearer]], chosen: Sequence[Ways | None], level: Tracks
) -> float:
    some = [
        (own[-1], heard.missed(own[-1], way, FINE)[0])
        for own, way in zip(every, chosen, strict=True)
        if way is not None
    ]
    return float((1 - together(*zip(*some, strict=True))) @ level.weight)


def _placement(
    seas: Sequence[Sea],
    every: Sequence[Sequence[Hearer]],
    chosen: Sequence[Ways],
    pools: Sequence[Sequence[Ways]],
    level: Tracks,
) -> Placement:
    """Return the plan of chosen ways, with what each is worth and what others would be."""
    last = [hearers[-1] for hearers in every]
    own = [heard.missed(hearer, way, FINE)[0] for hearer, way in zip(last, chosen, strict=True)]
    whole = together(last, own)
    value = float((1 - whole) @ level.weight)
    error = math.sqrt(max(float(((1 - whole - value) ** 2) @ level.weight**2), 0.0))
    placed = []
    others: list[tuple[str, float]] = []
    for k, (sea, way) in enumerate(zip(seas, chosen, strict=True)):
        rest = besides(last, own, k)
        alone = float((1 - own[k] @ last[k].chances) @ level.weight)
        placed.append(Placed(sea, way, alone, float((rest.sum(axis=1) - whole) @ level.weight)))
        instead = (
            [(f"{sea.tow.name} on its next best way", pools[k][1])] if len(pools[k]) > 1 else []
        )
        begins = _middle(sea, level.time)
        if begins is not None:
            instead.append((f"{sea.tow.name} from the middle of its area on", begins))
        for name, other in instead:
            left = (rest * heard.missed(last[k], other, FINE)[0]).sum(axis=1)
            others.append((name, float((1 - left) @ level.weight)))
    return Placement(tuple(placed), value, error, level.m, tuple(others))


def _middle(sea: Sea, time: Array) -> Ways | None:
    """Return what one would do without a plan: begin in the middle, and go straight on a course
    that may be steered.
    """
    centre = sea.begins.shape.representative_point()
    lon, lat = sphere.destination(*sea.middle, centre.x, centre.y)
    low = sea.tow.courses[0] if sea.tow.courses else 0.0
    wide = np.mod(sea.tow.courses[1] - low, 2 * math.pi) if sea.tow.courses else 2 * math.pi
    course = low + wide * (np.arange(8) + 0.5) / 8
    some = Ways(np.full(8, float(lon)), np.full(8, float(lat)), course, course, np.ones(8))
    which = np.flatnonzero(ways.possible(sea, some, time))
    return some.take(which[:1]) if which.size else None
