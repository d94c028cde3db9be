"""Particle clouds of many runs and ways of following, updated together by their sweeps."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drift.tracking.tracker import path
from drift.tracking.tracker import sweeps as sweeps_of
from drift.tracking.tracker.path import Path
from drift.tracking.tracker.records import METHODS, Behaviour, Filling, Tracker
from drift.tracking.tracker.sweeps import Sweeps, join_sweeps
from geo import sphere
from geo.array import Array
from kernels.maths import noise
from kernels.runtime import runtime, tables
from kernels.step.coast import DeviceCoast
from kernels.tracking import clouds, follower
from kernels.tracking.follower import Own

TOGETHER = 2**21  # particles processed at once: 290 MB


@dataclass(frozen=True)
class World:
    """One run: the tracker's path and the results of its sensors' sweeps."""

    tracker: Path
    sweeps: Sweeps


@dataclass(frozen=True)
class Estimates:
    """Estimates of the target at recorded rows, each (ways of following, runs, rows).

    NaN while no track is held.
    """

    place: Array  # unit vectors (..., 3)
    course: Array  # [rad] of the mean velocity
    speed: Array  # [m/s] mean of the particles' speeds
    velocity: Array  # [m/s] mean velocity, east and north (..., 2)
    count: Array  # particles
    # share of the cloud at higher density than at the target; NaN: not requested
    level: Array
    # (..., 7) estimate at the last detection: place, mean velocity [1/s] and time [s]
    fix: Array


@dataclass(frozen=True)
class Particles:
    """A cloud at a time."""

    place: Array  # unit vectors (n, 3)
    velocity: Array  # [1/s] (n, 3)
    weight: Array  # shares (n,)
    mode: Array  # kernels.tracking.follower.ACTING, SEEKING or HIDING


def follow(
    worlds: Sequence[World],
    trackers: Sequence[Tracker],
    size: int,
    seed: int,
    areas: bool = False,
    tell: Callable[[float], None] = lambda share: None,
    shore: DeviceCoast | None = None,
) -> Estimates:
    """Follow the target of every world in every way of following.

    Clouds of one world share their random numbers, whatever the way of following. If worlds are the
    same object, its sweeps are stored once.

    Args:
        worlds: one for each run.
        trackers: ways of following.
        size: particles of a cloud.
        seed: of the random numbers.
        areas: whether to compute `Estimates.level`.
        tell: callback that receives the progress, 0 to 1.
        shore: coast that particles avoid; None: no coast.
    """
    if size < 1:
        raise ValueError(f"a cloud needs a particle or more, not {size}")
    rows = max((int(world.sweeps.row.max(initial=-1)) + 1 for world in worlds), default=0)
    found = np.full((len(trackers), len(worlds), rows, len(clouds.FIELDS)), np.nan)
    step = max(TOGETHER // (size * len(trackers)), 1)
    for first in range(0, len(worlds), step):
        some = slice(first, first + step)
        batch = Clouds(worlds[some], trackers, size, seed, first, areas, shore).go()
        found[:, some, : batch.rows] = batch.fields
        tell(min((first + step) / len(worlds), 1.0))
    metres = sphere.RADIUS
    velocity = found[..., 3:5] * metres
    return Estimates(
        found[..., :3],
        np.arctan2(velocity[..., 0], velocity[..., 1]),
        found[..., 5] * metres,
        velocity,
        found[..., 6],
        found[..., 8],
        found[..., 12:],
    )


class Clouds:
    """The clouds of some worlds, in every way of following, on the device.

    All are at the same sweep of their worlds.
    """

    def __init__(
        self,
        worlds: Sequence[World],
        trackers: Sequence[Tracker],
        size: int,
        seed: int,
        run: int = 0,
        areas: bool = False,
        shore: DeviceCoast | None = None,
    ) -> None:
        """Start without tracks; run: index of the first world, key of its random numbers."""
        self.areas, self._shore = areas, shore
        distinct = {id(world): world for world in worlds}
        places = {key: k for k, key in enumerate(distinct)}
        which = np.array([places[id(world)] for world in worlds])
        ends = np.cumsum([0] + [len(world.sweeps) for world in distinct.values()])
        leg_ends = np.cumsum([0] + [len(world.tracker.time) for world in distinct.values()])
        n, many = len(worlds), len(worlds) * len(trackers)
        self.shape, self.size, self.seed = (len(trackers), n), size, seed
        self.rows = max((int(world.sweeps.row.max(initial=-1)) + 1 for world in worlds), default=0)
        self._sweeps = join_sweeps([world.sweeps for world in distinct.values()])
        self._begin, self._end = (
            np.tile(ends[which], len(trackers)),
            np.tile(ends[which + 1], len(trackers)),
        )
        integers = {
            "run": np.tile(run + np.arange(n), len(trackers)),
            "rules": np.repeat(np.arange(len(trackers)), n),
            "first": self._begin,
            "last": self._begin,
            "first_leg": np.tile(leg_ends[which], len(trackers)),
            "last_leg": np.tile(leg_ends[which + 1], len(trackers)),
            "first_row": np.arange(many) * self.rows,
            "count": np.zeros(many),
            "drawn": np.zeros(many),
        }
        floats = {
            "estimate": np.full((many, 5), -1.0),
            "lost": np.full(many, np.nan),
            "left": np.tile([-1.0, 0.0, -follower.NEVER], (many, 1)),
            "way": np.zeros((many, 3)),
        }
        self._tracks = {
            "track_real": tables.upload(
                _table(clouds.Track, clouds.Track.REAL, floats, np.float64)
            ),
            "track_whole": tables.upload(
                _table(clouds.Track, clouds.Track.WHOLE, integers, np.int32)
            ),
        }
        self._cloud = {
            "own_real": tables.empty(many * size, Own.REAL, np.float64),
            "own_whole": tables.empty(many * size, Own.WHOLE, np.int32),
        }
        swept = vars(self._sweeps)
        outcomes = {name: swept[name] for name in ("outcome", "row")}
        measurements = {name: column for name, column in swept.items() if name not in outcomes}
        self._fixed = (
            {"rule_real": tables.upload(_rules(trackers))},
            {
                "sweep_real": tables.upload(
                    _table(clouds.Sweep, clouds.Sweep.REAL, measurements, np.float64)
                ),
                "sweep_whole": tables.upload(
                    _table(clouds.Sweep, clouds.Sweep.WHOLE, outcomes, np.int32)
                ),
            },
            {"leg_real": tables.upload(legs([world.tracker for world in distinct.values()]))},
        )
        self._found = runtime.upload(np.full(max(many * self.rows, 1) * len(clouds.FIELDS), np.nan))

    def go(self, until: float = math.inf) -> "Clouds":
        """Update all clouds by their sweeps up to and including a time [s]."""
        tracks = self._tracks["track_whole"].to_numpy()
        first = tracks[:, clouds.Track.LAST].copy()
        time = self._sweeps.time
        last = [
            b + np.searchsorted(time[b:e], until, side="right")
            for b, e in zip(first, self._end, strict=True)
        ]
        tracks[:, clouds.Track.FIRST], tracks[:, clouds.Track.LAST] = first, last
        self._tracks["track_whole"].from_numpy(tracks)
        clouds.follow(
            self.areas,
            self.size,
            self.seed,
            self._cloud,
            self._tracks,
            *self._fixed,
            self._found,
            self._shore,
        )
        return self

    def hold(self, place: Array, velocity: Array, since: Array) -> None:
        """Set one particle in every cloud of a single way of following.

        Args:
            place: unit vectors, shape (worlds, 3).
            velocity: [1/s], shape (worlds, 3).
            since: when the particle is at this position and acts for the first time [s], shape
                (worlds,).
        """
        assert self.shape[0] == self.size == 1
        rate = np.linalg.norm(velocity, axis=1)
        onward = np.where(
            rate[:, None] > 0, velocity / np.maximum(rate, 1e-300)[:, None], path.frame(place).north
        )
        values = {"place": place, "way": onward, "rate": rate, "weight": np.ones(len(rate))}
        values |= dict.fromkeys(("since", "due", "free"), since)
        self._cloud["own_real"].from_numpy(_table(Own, Own.REAL, values, np.float64))
        tracks = self._tracks["track_whole"].to_numpy()
        tracks[:, clouds.Track.COUNT] = 1
        self._tracks["track_whole"].from_numpy(tracks)

    @property
    def fields(self) -> Array:
        """Recorded values by way of following, world, row and kernels.tracking.clouds.FIELDS."""
        values = self._found.to_numpy()[: math.prod(self.shape) * self.rows * len(clouds.FIELDS)]
        return np.asarray(values).reshape(*self.shape, self.rows, len(clouds.FIELDS))

    def particles(self, way: int, world: int, time: float) -> Particles:
        """Return the particles of a cloud at a time [s].

        The time must not be before its last sweep, nor after the next act of any particle.
        """
        return self.clouds(time)[way * self.shape[1] + world]

    def clouds(self, time: float) -> list[Particles]:
        """Return the particles of all clouds: worlds in order, for each way of following."""
        real, mode = (
            self._cloud["own_real"].to_numpy(),
            self._cloud["own_whole"].to_numpy()[:, Own.MODE],
        )
        counts = self._tracks["track_whole"].to_numpy()[:, clouds.Track.COUNT]
        spans = [slice(k * self.size, k * self.size + count) for k, count in enumerate(counts)]
        return [self._particles(real[some], mode[some], time) for some in spans]

    @staticmethod
    def _particles(real: Array, mode: Array, time: float) -> Particles:
        """Return particles from the device's columns, moved to a time [s]."""
        place, onward = (real[:, first : first + 3] for first in (Own.PLACE, Own.WAY))
        rate = real[:, Own.RATE, None]
        angle = rate * (time - real[:, Own.SINCE, None])
        c, s = np.cos(angle), np.sin(angle)
        weight = real[:, Own.WEIGHT]
        return Particles(
            place * c + onward * s, rate * (onward * c - place * s), weight / weight.sum(), mode
        )


def _table(kind: Any, width: int, values: Mapping[str, Array], dtype: type) -> Array:
    """Return a table of `width` columns; attributes of `kind` give the column of each name."""
    many = len(next(iter(values.values())))
    table: Array = np.zeros((many, width), dtype)
    for name, column in values.items():
        first = getattr(kind, name.upper())
        wide = column.shape[1] if column.ndim > 1 else 1
        table[:, first : first + wide] = column.reshape(many, wide)
    return table


def _rules(trackers: Sequence[Tracker]) -> Array:
    """Return the table of ways of following for kernels.tracking.follower.Rule."""
    table = []
    for tracker in trackers:
        law, filling = tracker.behaviour, tracker.filling
        soonest, latest = law.acts or (follower.NEVER, follower.NEVER)
        table.append(
            (
                law.change,
                law.seek,
                law.hide,
                law.leave,
                soonest,
                latest,
                law.spread,
                law.fastest / sphere.RADIUS,
                filling.partial,
                filling.bulk,
                METHODS[filling.method],
            )
        )
    return np.array(table, np.float64)


def legs(trackers: Sequence[Path]) -> Array:
    """Return the table of the trackers' paths, one after the other."""
    values = {
        "time": np.concatenate([way.time for way in trackers]),
        "place": np.concatenate([way.place for way in trackers]),
        "way": np.concatenate(
            [np.vstack([way.way, path.frame(way.place[-1:]).north]) for way in trackers]
        ),
        "rate": np.concatenate([np.append(way.rate, 0.0) for way in trackers]),
    }
    return _table(follower.Leg, follower.Leg.REAL, values, np.float64)


def wanders(
    begin: Path,
    law: Behaviour,
    tracker: Path,
    moments: Array,
    runs: int,
    seed: int,
    shore: DeviceCoast | None = None,
) -> list[Path]:
    """Return the paths of a target that acts, one for each run.

    The target moves as a particle does, with its own random numbers.

    Args:
        begin: path until its first act.
        law: its behaviour.
        tracker: path of the tracker, to which it reacts.
        moments: times [s], ascending, between which its path is straight.
        runs: number of paths.
        seed: of the random numbers.
        shore: coast that it avoids; None: no coast.
    """
    if law.acts is None:
        return [begin] * runs
    seed = noise.seed_for(seed, noise.Purpose.TARGET)
    due = np.array(
        [noise.generator(seed, noise.Purpose.TARGET, run).uniform(*law.acts) for run in range(runs)]
    )
    first = begin.at(due)
    marks = sweeps_of.marks(moments, begin)
    marks = replace(marks, row=np.arange(len(moments), dtype=np.int32))
    alone = Clouds(
        [World(tracker, marks)] * runs, [Tracker("target", law, Filling())], 1, seed, shore=shore
    )
    alone.hold(*first, due)
    found = alone.go().fields[0, ..., :3]
    ways = []
    for own, place, places in zip(due, first[0], found, strict=True):
        early, late = begin.time < own, moments > own
        time = np.concatenate([begin.time[early], [own], moments[late]])
        ways.append(Path(time, np.concatenate([begin.place[early], place[None], places[late]])))
    return ways


@dataclass(frozen=True)
class Errors:
    """Errors of estimates, each (ways of following, runs, rows)."""

    position: Array  # [m]
    carried: Array  # [m] of the last detection's estimate, carried forward
    course: Array  # [rad], 0 to pi
    speed: Array  # [m/s]


def carry_forward(fix: Array, time: Array) -> Array:
    """Return where the estimates at last detections are, moved on at their mean velocity.

    The second estimate of Borovies 2007, figure 55: apart from the cloud, whose mean stays behind
    when its particles take any course.

    Args:
        fix: place (unit vector), velocity [1/s] and time [s] of each, (..., 7).
        time: to which they are moved [s], (...).

    Returns:
        Unit vectors (..., 3); NaN where there was no detection.
    """
    place, way = fix[..., :3], fix[..., 3:6]
    way = way - place * np.sum(place * way, axis=-1, keepdims=True)  # along the sphere
    rate = np.linalg.norm(way, axis=-1, keepdims=True)
    angle = rate * (time - fix[..., 6])[..., None]
    onward = way / np.maximum(rate, 1e-300)
    moved = place * np.cos(angle) + onward * np.sin(angle)
    return np.asarray(moved / np.linalg.norm(moved, axis=-1, keepdims=True))


def errors(found: Estimates, time: Array, place: Array, velocity: Array) -> Errors:
    """Return the errors of estimates; that of one carried forward only while a track is held.

    Args:
        found: the estimates.
        time: of the rows [s], shape (runs, rows).
        place: of the target, unit vectors, shape (runs, rows, 3).
        velocity: of the target [1/s], shape (runs, rows, 3).
    """
    turned = np.angle(np.exp(1j * (found.course - path.course(place, velocity))))
    speed = np.linalg.norm(velocity, axis=-1) * sphere.RADIUS
    position, carried = (
        path.arc(where, place) * sphere.RADIUS
        for where in (found.place, carry_forward(found.fix, time))
    )
    carried = np.where(np.isfinite(position), carried, np.nan)
    return Errors(position, carried, np.abs(turned), np.abs(found.speed - speed))
