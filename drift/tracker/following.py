"""Clouds of many runs and ways of following, side by side, taken through their sweeps."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drift.tracker import path
from drift.tracker import sweeps as sweeps_of
from drift.tracker.path import Path
from drift.tracker.records import METHODS, Behaviour, Filling, Tracker
from drift.tracker.sweeps import Sweeps, joined
from geo import sphere
from geo.array import Array
from kernels import clouds, follower, noise, runtime
from kernels.coast import DeviceCoast

TOGETHER = 2**21  # particles that are held at once: 290 MB
VECTORS = ("own_place", "own_way", "own_scratch")  # columns of three numbers a particle


@dataclass(frozen=True)
class World:
    """One run: the tracker's way and what its sensors told."""

    tracker: Path
    sweeps: Sweeps


@dataclass(frozen=True)
class Estimates:
    """What clouds say of the target at what is recorded, each (ways of following, runs, rows); NaN: no track is held."""

    place: Array  # unit vectors (..., 3)
    course: Array  # [rad] of the mean velocity
    speed: Array  # [m/s] mean of the particles' speeds
    velocity: Array  # [m/s] mean velocity, east and north (..., 2)
    count: Array  # particles
    level: Array  # share of the cloud that lies where it is denser than at the target; NaN: not asked for


@dataclass(frozen=True)
class Particles:
    """A cloud at a time."""

    place: Array  # unit vectors (n, 3)
    velocity: Array  # [1/s] (n, 3)
    weight: Array  # shares (n,)
    mode: Array  # kernels.follower.ACTING, SEEKING or HIDING


def follow(
    worlds: Sequence[World], trackers: Sequence[Tracker], size: int, seed: int,
    areas: bool = False, tell: Callable[[float], None] = lambda share: None, shore: DeviceCoast | None = None,
) -> Estimates:  # fmt: skip
    """Follow the target of every world in every way; size: particles of a cloud.

    Worlds may be one object: its sweeps are then kept once. Clouds of one world share their random numbers, whatever
    the way of following. areas: whether levels are asked for. tell: takes the share that is done. shore: on whose land no particle is,
    None: anywhere.
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
    )


class Clouds:
    """The clouds of some worlds, in every way of following, on the device; all at the same sweep of their worlds."""

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
        """Have no track of anything yet; run: number of the first world, the key of its random numbers."""
        self.areas, self._shore = areas, shore
        distinct = {id(world): world for world in worlds}
        places = {key: k for k, key in enumerate(distinct)}
        which = np.array([places[id(world)] for world in worlds])
        ends = np.cumsum([0] + [len(world.sweeps) for world in distinct.values()])
        leg_ends = np.cumsum([0] + [len(world.tracker.time) for world in distinct.values()])
        n, many = len(worlds), len(worlds) * len(trackers)
        self.shape, self.size, self.seed = (len(trackers), n), size, seed
        self.rows = max((int(world.sweeps.row.max(initial=-1)) + 1 for world in worlds), default=0)
        self._sweeps = joined([world.sweeps for world in distinct.values()])
        self._begin, self._end = np.tile(ends[which], len(trackers)), np.tile(ends[which + 1], len(trackers))
        self._tracks = _columns(clouds.Tracks, "track", {
            "run": np.tile(run + np.arange(n), len(trackers)), "rules": np.repeat(np.arange(len(trackers)), n),
            "first": self._begin, "last": self._begin,
            "first_leg": np.tile(leg_ends[which], len(trackers)), "last_leg": np.tile(leg_ends[which + 1], len(trackers)),
            "first_row": np.arange(many) * self.rows, "count": np.zeros(many), "drawn": np.zeros(many),
            "estimate": np.full(5 * many, -1.0), "lost": np.full(many, np.nan), "left": np.tile([-1.0, 0.0, -follower.NEVER], many),
        })  # fmt: skip
        self._cloud = {
            name: runtime.empty(many * size * (3 if name in VECTORS else 1), law.dtype)
            for name, law in follower.Cloud.members.items()
        }
        self._fixed = (
            rules(trackers), _columns(clouds.Sweeps, "sweep", vars(self._sweeps)),
            legs([world.tracker for world in distinct.values()]),
        )  # fmt: skip
        self._found = runtime.upload(np.full(max(many * self.rows, 1) * len(clouds.FIELDS), np.nan))

    def go(self, until: float = math.inf) -> "Clouds":
        """Take all through their sweeps until a time [s], those at it too."""
        first = self._tracks["track_last"].to_numpy()
        time = self._sweeps.time
        last = [b + np.searchsorted(time[b:e], until, side="right") for b, e in zip(first, self._end, strict=True)]
        self._tracks["track_first"].from_numpy(first)
        self._tracks["track_last"].from_numpy(np.array(last, np.int32))
        clouds.follow(
            self.areas, self.size, self.seed, self._cloud, self._tracks, *self._fixed, self._found, self._shore
        )
        return self

    def hold(self, place: Array, velocity: Array, since: Array) -> None:
        """Have one particle in every cloud of the one way of following, that acts first when it is at a place.

        place, velocity [1/s]: (worlds, 3), since: when it is there [s] (worlds,).
        """
        assert self.shape[0] == self.size == 1
        rate = np.linalg.norm(velocity, axis=1)
        onward = np.where(rate[:, None] > 0, velocity / np.maximum(rate, 1e-300)[:, None], path.frame(place).north)
        for name, value in (("own_place", place), ("own_way", onward)):
            self._cloud[name].from_numpy(np.ascontiguousarray(value).reshape(-1))
        for name, value in (
            ("own_rate", rate),
            ("own_weight", np.ones(len(rate))),
            *((name, since) for name in ("own_since", "own_due", "own_free")),
        ):
            self._cloud[name].from_numpy(np.ascontiguousarray(value, np.float64))
        self._tracks["track_count"].from_numpy(np.ones(len(rate), np.int32))

    @property
    def fields(self) -> Array:
        """What is recorded so far, (ways of following, worlds, rows, kernels.clouds.FIELDS)."""
        values = self._found.to_numpy()[: math.prod(self.shape) * self.rows * len(clouds.FIELDS)]
        return np.asarray(values).reshape(*self.shape, self.rows, len(clouds.FIELDS))

    def particles(self, way: int, world: int, time: float) -> Particles:
        """Return the particles of a cloud at a time [s] that is not before its last sweep and before any acts."""
        return self.clouds(time)[way * self.shape[1] + world]

    def clouds(self, time: float) -> list[Particles]:
        """Return the same of all clouds, worlds side by side in each way of following."""
        held = {name: column.to_numpy() for name, column in self._cloud.items()}
        counts = self._tracks["track_count"].to_numpy()
        return [self._particles(held, slice(k * self.size, k * self.size + n), time) for k, n in enumerate(counts)]

    @staticmethod
    def _particles(held: dict[str, Array], some: slice, time: float) -> Particles:
        place, onward = (held[name].reshape(-1, 3)[some] for name in ("own_place", "own_way"))
        rate = held["own_rate"][some, None]
        angle = rate * (time - held["own_since"][some, None])
        c, s = np.cos(angle), np.sin(angle)
        weight = held["own_weight"][some]
        return Particles(
            place * c + onward * s, rate * (onward * c - place * s), weight / weight.sum(), held["own_mode"][some]
        )


def _columns(kind: Any, prefix: str, values: dict[str, Any]) -> dict[str, Any]:
    """Return device columns of a pack, by its members' names."""
    columns = {}
    for member, law in kind.members.items():
        dtype = np.int32 if law.dtype is follower.Ints.dtype else np.float64
        columns[member] = runtime.upload(np.ascontiguousarray(values[member.removeprefix(f"{prefix}_")], dtype))
    return columns


def rules(trackers: Sequence[Tracker]) -> dict[str, Any]:
    """Return the device columns of ways of following."""
    rows = []
    for tracker in trackers:
        law, filling = tracker.behaviour, tracker.filling
        soonest, latest = law.acts or (follower.NEVER, follower.NEVER)
        rows.append((
            law.change, law.seek, law.hide, law.leave, soonest, latest, law.spread, law.fastest / sphere.RADIUS,
            filling.partial, filling.bulk, METHODS[filling.method],
        ))  # fmt: skip
    names = [member.removeprefix("rule_") for member in follower.Rules.members]
    return _columns(follower.Rules, "rule", dict(zip(names, np.array(rows, np.float64).T, strict=True)))


def legs(trackers: Sequence[Path]) -> dict[str, Any]:
    """Return the device columns of the trackers' ways, one after the other."""
    values = {
        "time": np.concatenate([way.time for way in trackers]),
        "place": np.concatenate([way.place for way in trackers]),
        "way": np.concatenate([np.vstack([way.way, path.frame(way.place[-1:]).north]) for way in trackers]),
        "rate": np.concatenate([np.append(way.rate, 0.0) for way in trackers]),
    }
    return _columns(follower.Legs, "leg", values)


def wanders(
    begin: Path, law: Behaviour, tracker: Path, moments: Array, runs: int, seed: int, shore: DeviceCoast | None = None
) -> list[Path]:
    """Return the ways of a target that acts, one a run; begin: the way that it keeps to until its first act.

    moments: times [s], ascending, between which it is taken to go straight. It is moved as a particle is, by numbers of
    its own.
    """
    if law.acts is None:
        return [begin] * runs
    seed = noise.seed_for(seed, noise.Purpose.TARGET)
    due = np.array([noise.generator(seed, noise.Purpose.TARGET, run).uniform(*law.acts) for run in range(runs)])
    first = begin.at(due)
    marks = sweeps_of.marks(moments, begin)
    marks = replace(marks, row=np.arange(len(moments), dtype=np.int32))
    alone = Clouds([World(tracker, marks)] * runs, [Tracker("target", law, Filling())], 1, seed, shore=shore)
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
    """How far estimates are from the target, each (ways of following, runs, rows)."""

    position: Array  # [m]
    course: Array  # [rad], 0 to pi
    speed: Array  # [m/s]


def errors(found: Estimates, place: Array, velocity: Array) -> Errors:
    """Return how far estimates are from a target at places (runs, rows, 3) with velocities [1/s] there."""
    turned = np.angle(np.exp(1j * (found.course - path.course(place, velocity))))
    speed = np.linalg.norm(velocity, axis=-1) * sphere.RADIUS
    return Errors(path.arc(found.place, place) * sphere.RADIUS, np.abs(turned), np.abs(found.speed - speed))
