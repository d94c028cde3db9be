"""Draw the particles that go back from the finds of a spill: start, time and weight.

Every find has particles of every class that it may be of, the same number in each world. They begin
where and when their object was found. At sea that is about its position. Ashore it is a little off
the beach, at a time of arrival drawn from the distribution of waiting times for a report, and
weighted by the patrols that missed the object. Particles for which no place in water is drawn have
no weight.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.models import drift
from drift.engine.motion.objects.leeway import AIR_IN_WATER
from drift.engine.motion.period import Period
from drift.engine.particles import ensemble as record
from drift.engine.particles.ensemble import Ensemble
from drift.spills.worlds import evidence, release
from drift.spills.worlds.records import Find, Kind, Spill
from drift.spills.worlds.worlds import Worlds
from geo import sphere
from geo.array import Array, Real
from geo.coast import edges as shoreline
from geo.coast.edges import Coast
from geo.coast.segments import Segments
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.runtime import runtime
from kernels.step import prior as kernel

OFFING = (50.0, 100.0)  # [m] off the beach where the track of a find ashore begins
FEWEST = 10  # particles for each find, class and world
TRIES = 64  # rounds of drawing a place in water
SECOND = np.timedelta64(1, "s")


@dataclass(frozen=True)
class Group:
    """Slots of particles that go back from one find as objects of one class, world after world."""

    find: int  # number of the find
    kind: int  # number of the class
    share: float  # probability that the find is of the class
    first: int  # first slot
    count: int  # slots of each world


@dataclass(frozen=True)
class Beaches:
    """The coast, its segments, and the segment of each find."""

    coast: Coast | None
    segments: Segments | None  # None only if all finds are at sea
    of_find: Sequence[int]  # number of a segment, -1 at sea


def draw_backward_particles(
    spec: EnsembleSpec,
    spill: Spill,
    worlds: Worlds,
    beaches: Beaches,
    per_find: int,
    rng: np.random.Generator,
) -> tuple[Ensemble, list[Group]]:
    """Return the particles of a backward run, all pending, and their groups by find and class.

    Args:
        spec: ensemble of the run; its period starts at the last find and runs backward.
        spill: the spill with its finds.
        worlds: worlds of the backward run.
        beaches: the coast with the segments of the finds.
        per_find: particles of a find in a world, at least FEWEST of each class that it may be of.
        rng: generator of places and waiting times.

    Returns:
        The ensemble and its groups.
    """
    groups, bounds = _groups(spill, worlds.size, per_find)
    ensemble = _equip(spec, spill, worlds, groups, bounds)
    _place(ensemble, spec.period, spill, beaches, worlds, groups, rng)
    return ensemble, groups


def _groups(spill: Spill, worlds: int, per_find: int) -> tuple[list[Group], tuple[int, ...]]:
    """Return the groups, sorted by class, and the bounds of the classes' slots."""
    groups, bounds = [], [0]
    for k, kind in enumerate(spill.kinds):
        first = bounds[-1]
        for f, find in enumerate(spill.finds):
            share = kind.share if find.kind is None else float(find.kind == kind.name)
            if share > 0:
                count = max(round(per_find * share), FEWEST)
                groups.append(Group(f, k, share, first, count))
                first += worlds * count
        bounds.append(first)
    return groups, tuple(bounds)


def _equip(
    spec: EnsembleSpec, spill: Spill, worlds: Worlds, groups: list[Group], bounds: tuple[int, ...]
) -> Ensemble:
    """Return an ensemble with worlds, leeway and errors for every class."""
    seed = noise.seed_for(spec.seed, Purpose.BACKWARD)  # independent of the forward run's noise
    ensemble, key = record.empty(seed, bounds, release.columns_of_worlds(worlds)), noise.key(seed)
    world = np.concatenate(
        [np.repeat(np.arange(worlds.size, dtype=np.int32), group.count) for group in groups]
    )
    ensemble.world.from_numpy(world)
    factor = runtime.upload(worlds.windage.astype(np.float32))
    for kind, slots in zip(spill.kinds, ensemble.slots, strict=True):
        if slots.first == slots.last:
            continue
        drift.draw_leeway(ensemble, slots, key, kind.object)
        if kind.object.immersion is not None:
            kernel.draw_immersion(
                *slots, ensemble.own["down_slope"], *key, *kind.object.immersion, AIR_IN_WATER
            )
        for name in drift.LEEWAY:
            kernel.scale_windage(*slots[:2], ensemble.own[name], ensemble.world, factor)
        drift.draw_errors(ensemble, slots, key, spec.errors.unbiased())
    release.copy_world_values(ensemble, worlds)
    return ensemble


def _place(
    ensemble: Ensemble,
    period: Period,
    spill: Spill,
    beaches: Beaches,
    worlds: Worlds,
    groups: list[Group],
    rng: np.random.Generator,
) -> None:
    """Set position, release time and log weight of every particle.

    It begins where and when its object was found at sea, or went ashore.
    """
    lon, lat = np.zeros(ensemble.n, np.int32), np.zeros(ensemble.n, np.int32)
    release, log_weight = np.zeros(ensemble.n, np.int32), np.zeros(ensemble.n, np.float32)
    coast, segments = beaches.coast, beaches.segments
    edges = shoreline.shoreline_edges(coast) if coast else np.empty((0, 4), np.int32)
    for group in groups:
        find, segment = spill.finds[group.find], beaches.of_find[group.find]
        shape = (worlds.size, group.count)
        slots = slice(group.first, group.first + shape[0] * shape[1])
        # [s] backward from the last find
        start = np.full(shape, (period.start - find.time) / SECOND)
        if segment < 0:
            x, y, wet = _at_sea(find, coast, shape[0] * shape[1], rng)
        else:
            assert segments is not None
            assert coast is not None
            x, y, wet = _off_beach(
                edges[segments.of_edge == segment], coast, shape[0] * shape[1], rng
            )
            rate = float(evidence.reporting_rates(spill.reporting, segments)[segment])
            wait = _wait(find, spill, rate, worlds, group.count, rng)
            log_weight[slots] = _log_missed(find, spill, segments, segment, wait).ravel()
            start += wait
        lon[slots], lat[slots], release[slots] = x, y, np.rint(start).ravel()
        log_weight[slots][~wet] = -np.inf
    for column, values in zip(
        ("lon", "lat", "release", "log_weight"), (lon, lat, release, log_weight), strict=True
    ):
        getattr(ensemble, column).from_numpy(values)


def _at_sea(
    find: Find, coast: Coast | None, n: int, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return places [binary angle] about a find, and whether each is in water.

    The find's radius is the standard deviation of each component.
    """
    lon, lat = np.empty(n, np.int32), np.empty(n, np.int32)
    dry = np.arange(n)
    for _ in range(TRIES):
        shift = find.radius * rng.standard_normal((2, dry.size))
        x, y = sphere.destination(np.radians(find.lon), np.radians(find.lat), *shift)
        lon[dry], lat[dry] = sphere.to_binary(np.degrees(x)), sphere.to_binary(np.degrees(y))
        dry = dry[shoreline.is_land(coast, lon[dry], lat[dry])] if coast else dry[:0]
        if not dry.size:
            break
    return lon, lat, ~np.isin(np.arange(n), dry)


def _off_beach(
    edges: Array, coast: Coast, n: int, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return places [binary angle] a little off edges, and whether each is in water.

    They are uniform along the edges.
    """
    scale = np.cos(edges[:, 1] * sphere.UNIT)  # a unit of longitude in units of latitude
    east = (edges[:, 2].astype(np.int64) - edges[:, 0]).astype(np.int32) * scale
    north = edges[:, 3].astype(np.float64) - edges[:, 1]
    length = np.hypot(east, north)
    lon, lat = np.empty(n, np.int32), np.empty(n, np.int32)
    dry = np.arange(n)
    for _ in range(TRIES):
        k = rng.choice(len(edges), dry.size, p=length / length.sum())
        along = rng.random(dry.size)
        # [m] to either side
        offing = rng.uniform(*OFFING, dry.size) * rng.choice((-1.0, 1.0), dry.size)
        off = offing / (length[k] * sphere.RADIUS * sphere.UNIT)  # in lengths of the edge
        x = edges[k, 0] + np.rint((along * east[k] - off * north[k]) / scale[k]).astype(np.int64)
        y = edges[k, 1] + np.rint(along * north[k] + off * east[k]).astype(np.int32)
        lon[dry], lat[dry] = x.astype(np.int32), y
        dry = dry[shoreline.is_land(coast, lon[dry], lat[dry])]
        if not dry.size:
            break
    return lon, lat, ~np.isin(np.arange(n), dry)


def _wait(
    find: Find, spill: Spill, rate: float, worlds: Worlds, count: int, rng: np.random.Generator
) -> Real:
    """Return times [s] from going ashore to being found, (worlds, count).

    They are at most the time since the earliest release. Objects are reported or removed at
    constant rates, so the times are exponential; they are uniform for a find of which only the
    latest time is known. rate: of reports on the segment [1/s], before each world's factor.
    """
    longest = float((find.time - spill.prior.release_start) / SECOND)
    u = rng.random((worlds.size, count))
    if find.latest:
        return u * longest
    rates = np.maximum(rate * worlds.reporting + spill.reporting.removal, 1e-9 / longest)
    return np.asarray(-np.log1p(u * np.expm1(-rates * longest)[:, None]) / rates[:, None])


def _log_missed(find: Find, spill: Spill, segments: Segments, segment: int, wait: Real) -> Real:
    """Return the log probability that patrols missed an object on a segment, (worlds, n).

    wait: how long the object lay there before its find [s], (worlds, n).
    """
    log_missed = np.zeros(wait.shape)
    for patrol in spill.patrols:
        before = (find.time - patrol.time) / SECOND
        if (
            patrol.name != find.by
            and before > 0
            and segment in evidence.stretches_of_patrol(patrol, segments)
        ):
            with np.errstate(divide="ignore"):
                log_missed += np.where(wait > before, np.log1p(-patrol.detection), 0.0)
    return log_missed


def probability_not_sunk(kind: Kind, time: Real, age: Real) -> Real:
    """Return the probability that an object has not sunk at an age, (worlds, n).

    Args:
        kind: class of the object.
        time: each world's half-life or median time of sinking [s], (worlds,).
        age: time since the object went adrift [s], (worlds, n).

    Returns:
        Probabilities, (worlds, n).
    """
    if kind.sinking is None:
        return np.ones(age.shape)
    relative = np.maximum(age, 1e-9) / time[:, None]
    if kind.sinking.spread > 0:
        return np.asarray(special.ndtr(-np.log(relative) / kind.sinking.spread))
    return np.asarray(np.exp2(-relative))
