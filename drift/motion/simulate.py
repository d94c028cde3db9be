"""The clock: moves an ensemble through the forcing, step by step on a fixed lattice, from one output to the next.

Lattice steps are whole seconds long and counted from 1970, so that noise, keyed by the number of the step, does not
depend on where a run begins, on its outputs or on how it is cut up. Releases and outputs fall where they may: a particle
moves from its release on, an output inside a step is interpolated along it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from drift.motion import ensemble as record
from drift.motion.ensemble import Ensemble
from drift.motion.forcing import Forcing
from drift.motion.status import Status
from geo import sphere
from kernels import advance as kernel
from kernels import bridge, noise
from kernels.noise import Purpose

Array = npt.NDArray[Any]
Progress = Callable[[float], None]
Watch = Callable[[int], None]

LADDER = (3600, 1800, 1200, 900, 600, 450, 300, 240, 180, 120, 60, 30, 15)  # [s] steps that "auto" chooses from
RUNGS = ((0, 1), (1, 5), (5, 9), (9, 13))  # of the ladder that are tried together: often the first one will do
FEWEST = 100  # particles on which a percentile is worth something
TRIAL_SIZE = 1000  # particles whose error decides on the step: the rank of their percentile errs by 0.7 %
TRIAL_SPAN = 86_400  # [s] over which it is measured
DAY = 86_400


@dataclass(frozen=True)
class Clock:
    """The time of a run: from start, `duration` seconds forward (direction +1) or backward (-1), in lattice steps."""

    start: int  # [s since 1970]
    duration: int  # [s]
    direction: int
    step: int  # [s]
    phase: int = 0  # [s] lattice points lie at phase + k step

    def steps(self) -> Iterator[tuple[int, int, kernel.Step]]:
        """Return (low, high) [s since 1970] and the step, in the order of the run, covering start to end."""
        inside = (self.start - self.phase) % self.step  # how far the start lies above its lattice point
        if self.direction > 0:
            low, elapsed = self.start - inside, -inside
        else:
            low = self.start - inside - (self.step if inside == 0 else 0)
            elapsed = -(low + self.step - self.start)
        while elapsed < self.duration:
            number = (low - self.phase) // self.step
            yield low, low + self.step, kernel.Step(number, elapsed, self.step, self.direction)
            low += self.direction * self.step
            elapsed += self.step


@dataclass(frozen=True)
class Scene:
    """What does not change in a run and every scenario needs to move: forcing, physics, and the place."""

    forcing: Forcing
    physics: tuple[kernel.Physics, ...]  # one a scenario
    place: kernel.Place

    def advance(self, ensemble: Ensemble, low: int, high: int, step: kernel.Step) -> None:
        """Move all slots over one step, in place."""
        self.forcing.set(low, high)
        for move in self._movers(ensemble, step.direction):
            move(step)

    def _movers(self, ensemble: Ensemble, direction: int) -> tuple[kernel.Move, ...]:
        """Return what moves each scenario of an ensemble; made once, and kept with the forcing as long as that is open."""
        key = id(self), id(ensemble), direction
        if key not in self.forcing.movers:
            each = zip(ensemble.scenarios, self.forcing.ranges, self.physics, strict=True)
            made = tuple(
                kernel.mover(ensemble, slots, self.forcing.tiles, ranges, physics, self.place, direction)
                for slots, ranges, physics in each
            )
            self.forcing.movers[key] = (self, ensemble), made  # a name of what is no more could be given again
        moves: tuple[kernel.Move, ...] = self.forcing.movers[key][1]
        return moves

    def without_noise(self) -> "Scene":
        """Return the same scene in which nothing is left to chance, and what comes ashore stays there."""
        still = self.place._replace(beach=kernel.Beach(), sinks=False, divergence=False)
        return replace(self, physics=tuple(kernel.Physics() for _ in self.physics), place=still)


@dataclass(frozen=True)
class Moment:
    """The ensemble as it is at one time, on the host."""

    elapsed: int  # [s] since the run's start
    lon: Array  # int32 binary angle (n,)
    lat: Array
    status: Array  # int32 (n,)
    log_weight: Array | None = None  # float32 (n,) at that time; None: those of the end of the run
    ancestors: Array | None = None  # int64 (n,): of the moment before, where particles have been drawn anew since


Place = Callable[[Ensemble, tuple[Array, Array] | None, int], tuple[Array, Array]]


class Filter(Protocol):
    """What looks at an ensemble while it moves, and changes weights: see drift.search.filter.Search."""

    def stops(self, after: int, until: int) -> list[int]:
        """Return the times in (after, until] at which something takes effect [s after start]."""

    def before(self, elapsed: int, duration: int) -> None:
        """Make ready for a step, for which the forcing is set."""

    def advance(self, low: int, high: int, step: kernel.Step) -> None:
        """Move what else moves over a step."""

    def take_effect(self, time: int, place: Place) -> None:
        """Change weights by what ends or is seen at a time; place: gives where an ensemble's particles were then."""

    def watch(self, until: int) -> None:
        """Look on until the end of the step that has just been made."""

    def after(self, until: int) -> None:
        """Draw particles anew at the end of a step, if need be."""

    def log_weight(self, time: int) -> Array:
        """Return the weights as they stand at a time."""

    def ancestors(self) -> Array | None:
        """Return whose offspring the particles are since it was last asked; None: they are themselves."""


def run(
    ensemble: Ensemble,
    scene: Scene,
    clock: Clock,
    outputs: Array,
    progress: Progress | None = None,
    watch: Watch | None = None,
    search: Filter | None = None,
) -> Iterator[Moment]:
    """Yield the ensemble at each output time [s since start, ascending, shape (m,)], moving it in place.

    progress is told the share of the run that is done, after every step; watch when the step began [s since start]; search
    looks on and changes weights.
    """

    def here(which: Ensemble, before: Any, time: int) -> tuple[Array, Array]:
        return which.lon.to_numpy(), which.lat.to_numpy()

    due = [int(t) for t in outputs]
    if search:
        for time in search.stops(-1, 0):
            search.take_effect(time, here)
    while due and due[0] <= 0:
        lon, lat = here(ensemble, None, 0)
        yield _moment(ensemble, lon, lat, due.pop(0), search)
    for low, high, step in clock.steps():
        end = step.elapsed + step.duration
        within = [t for t in due if t <= end]
        stops = search.stops(max(step.elapsed, 0), end) if search else []
        inside = [t for t in (*within, *stops) if t < end]
        before = here(ensemble, None, 0) if inside else None
        if search:
            scene.forcing.set(low, high)
            search.before(step.elapsed, step.duration)
            search.advance(low, high, step)
        scene.advance(ensemble, low, high, step)

        known: dict[
            int, tuple[Any, int]
        ] = {}  # where contacts have asked particles to have been in this step, and when

        def place(
            which: Ensemble, begin: Any, time: int, step: kernel.Step = step, own: Any = before, known: Any = known
        ) -> Any:
            """Return where an ensemble's particles, which began this step somewhere, were at a time in it."""
            begin = own if which is ensemble else begin
            if begin is None or time == step.elapsed + step.duration:
                return here(which, None, time)
            begin, since = known.get(id(which), (begin, step.elapsed))
            found = _inside(which, scene, clock, begin, step, time, since, 0 if which is ensemble else which.n)
            known[id(which)] = found, time
            return found

        if watch:
            watch(step.elapsed)
        for t in sorted({*within, *stops}):
            if search and t in stops:
                search.take_effect(t, place)
            if t in within:
                due.pop(0)
                lon, lat = here(ensemble, None, 0)
                if t < end:  # an output does not tie down what comes after it
                    begin, since = known.get(id(ensemble), (before, step.elapsed))
                    assert begin is not None
                    lon, lat = begin if t == since else _inside(ensemble, scene, clock, begin, step, t, since)
                yield _moment(ensemble, lon, lat, t, search)
        if search:
            search.watch(end)
            if end < clock.duration:  # the last outputs show the particles as they were when it ended
                search.after(end)
        if progress:
            progress(min(end / clock.duration, 1.0))


def _inside(
    ensemble: Ensemble,
    scene: Scene,
    clock: Clock,
    before: tuple[Array, Array],
    step: kernel.Step,
    time: int,
    since: int,
    debris: int = 0,
) -> tuple[Array, Array]:
    """Return positions at a time inside a step that has just been made: on each particle's bridge between its ends.

    before: where they were at `since`, the step's begin or a time in it. debris: tells it apart from the object, 0, which has the same seed.
    """
    end = step.elapsed + step.duration
    release, ended, status = (c.to_numpy() for c in (ensemble.release, ensemble.ended, ensemble.status))
    left = np.maximum(since, release)
    there = np.where(status == Status.ADRIFT, end, np.minimum(ended, end))
    afloat = ensemble.afloat.to_numpy()  # what refloats begins to move within the step
    left = np.where(afloat < there, np.maximum(left, afloat), left)
    lasting = np.maximum(there - left, 1)
    share = np.clip((time - left) / lasting, 0.0, 1.0)
    diffusivity = np.repeat([p.diffusivity for p in scene.physics], np.diff(ensemble.bounds))
    variance = 2 * diffusivity * share * (1 - share) * lasting
    spread = np.where(status == Status.ADRIFT, np.sqrt(variance), 0.0)
    after = ensemble.lon.to_numpy(), ensemble.lat.to_numpy()
    moment = (clock.start + clock.direction * time) % 2**31
    seed = noise.seed_for(ensemble.seed, Purpose.DEBRIS_BRIDGE, debris) if debris else ensemble.seed
    lon, lat = bridge.between(before, after, share, spread, seed, moment, scene.place.coast)
    return lon, lat


def _moment(ensemble: Ensemble, lon: Array, lat: Array, time: int, search: Filter | None) -> Moment:
    """Return positions with the status that each particle had at that time, and its weight as far as it was known."""
    release, ended, status = (c.to_numpy() for c in (ensemble.release, ensemble.ended, ensemble.status))
    over = (status != Status.ADRIFT) & (status != Status.PENDING)
    status = np.where(over & (ended > time) | (status == Status.PENDING), int(Status.ADRIFT), status)
    waits = (status == Status.ADRIFT) & (ensemble.afloat.to_numpy() > np.maximum(time, release))
    status = np.where(waits, int(Status.ASHORE), status)  # it refloats later in this step
    status = np.where(release > time, int(Status.PENDING), status)
    weight, ancestors = (search.log_weight(time), search.ancestors()) if search else (None, None)
    return Moment(time, lon, lat, status.astype(np.int32), weight, ancestors)


@dataclass(frozen=True)
class Trial:
    """Why "auto" chose a step: the 95th percentile of the error [m a day] of each step tried."""

    step: int
    errors: dict[int, float]


def choose_step(
    ensemble: Ensemble, scene: Scene, clock: Clock, divisor: int, origin: int, longest: float, tolerance: float
) -> Trial:
    """Return the largest step of the ladder whose error stays under a tolerance [m a day].

    The ladder's steps divide `divisor` [s], the forcing's interval, and are at most `longest` [s]; lattices pass through
    `origin` [s since 1970], one of its times. The error of a step is the distance between tracks of a sample with that
    step and with half of it, noise off, over at most a day: its 95th percentile among those adrift to the end with both
    (step halving; Hairer, Norsett and Wanner 1993, II.4), or ashore if hardly any is.
    """
    ladder = [s for s in LADDER if divisor % s == 0 and s <= longest] or [_largest_divisor(divisor, longest)]
    chosen = np.unique(np.linspace(0, ensemble.n - 1, min(TRIAL_SIZE, ensemble.n)).astype(np.int64))
    release = ensemble.release.to_numpy()[chosen]
    span = min(clock.duration, TRIAL_SPAN + int(release.max()))
    errors: dict[int, float] = {}
    for first, last in RUNGS:
        rungs = ladder[first:last]
        steps = sorted({*rungs, *(_half(s) for s in rungs)})
        ends, elapsed = _march(
            ensemble, scene.without_noise(), chosen, steps, Clock(clock.start, span, clock.direction, 1, origin)
        )
        days = np.maximum(elapsed - np.maximum(release, 0), 3600) / DAY
        for step in rungs:
            coarse, fine = ends[step], ends[_half(step)]
            adrift = (coarse[2] == Status.ADRIFT) & (fine[2] == Status.ADRIFT)
            if adrift.sum() < FEWEST:  # most went ashore: where they did so counts
                adrift = (coarse[2] <= Status.ASHORE) & (fine[2] <= Status.ASHORE)
            apart = sphere.distance(*(x[adrift] * sphere.UNIT for x in (*coarse[:2], *fine[:2])))
            errors[step] = float(np.percentile(apart / days[adrift], 95)) if adrift.any() else 0.0
            if errors[step] <= tolerance:
                return Trial(step, errors)
    return Trial(ladder[-1], errors)


def _march(
    ensemble: Ensemble, scene: Scene, chosen: Array, steps: list[int], clock: Clock
) -> tuple[dict[int, tuple[Array, Array, Array]], int]:
    """Return where a sample ends (lon, lat, status) with each step, and after how long [s].

    All go through the forcing side by side, in stretches that every step divides, so that it is read once.
    """
    if not steps:
        return {}, 0
    stretch = int(np.lcm.reduce(steps))
    trials = {step: record.sample(ensemble, chosen) for step in steps}
    elapsed = 0
    for low, high, whole in Clock(clock.start, clock.duration, clock.direction, stretch, clock.phase % stretch).steps():
        for step, trial in trials.items():
            for k in range(stretch // step):
                begin = low + k * step if clock.direction > 0 else high - (k + 1) * step
                part = kernel.Step(0, whole.elapsed + k * step, step, clock.direction)
                scene.advance(trial, begin, begin + step, part)
        elapsed = whole.elapsed + stretch
    return {s: (t.lon.to_numpy(), t.lat.to_numpy(), t.status.to_numpy()) for s, t in trials.items()}, elapsed


def _half(step: int) -> int:
    """Return half a step, or the largest other share of it in whole seconds."""
    return step // 2 if step % 2 == 0 else step // 3 if step % 3 == 0 else 1


def _largest_divisor(number: int, most: float) -> int:
    """Return the largest whole number of seconds, at most a quarter of an hour, that divides `number`."""
    return next(s for s in range(int(max(min(most, 900, number), 1)), 0, -1) if number % s == 0)
