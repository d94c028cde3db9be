"""The simulation loop: moves an ensemble through its scene, step by step, from output to output.

Steps lie on the clock's lattice. Releases and outputs may fall inside a step: a particle moves from
its release on, and an output inside a step is interpolated on the step's curve
(kernels.step.curve).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from drift.engine.motion.clock import Clock, Timed
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scene import Begin, Kept, Scene
from drift.engine.particles import life
from drift.engine.particles.ensemble import Ensemble, Layout
from geo.array import Array
from kernels.step import advance as kernel

Progress = Callable[[float], None]
Watch = Callable[[int], None]


@dataclass(frozen=True)
class Moment:
    """The state of the ensemble at one time, on the host."""

    elapsed: int  # [s] since the run's start
    lon: Array  # int32 binary angle (n,)
    lat: Array
    status: Array  # int32 (n,)
    layout: Layout  # of slots by scenario
    log_weight: Array | None = None  # float32 (n,) at that time; None: those of the end of the run
    # (n,) slots in the whole run at the moment before, if particles were resampled since
    ancestors: Array | None = None
    # int32 (n,) initial particle from which each descends; None: itself
    lineage: Array | None = None


# Returns lon, lat [binary angle] of an ensemble's particles at a time [s after start]. Arguments:
# the ensemble, its scene, where its particles began the step that contains the time, and the time.
# The third argument is None for the run's own ensemble, whose begin is known.
PositionsAt = Callable[[Ensemble, Scene, Begin | None, int], tuple[Array, Array]]


class Filter(Protocol):
    """An observer that changes the weights of a moving ensemble, as
    drift.evidence.filter.filter.SearchFilter.
    """

    def stops(self, after: int, until: int, step: kernel.Step | None = None) -> list[int]:
        """Return the times in (after, until] at which an update takes effect [s after start].

        step: the step between the two times.
        """

    def rests(self, step: kernel.Step) -> bool:
        """Return whether a step is irrelevant to the filter, so that no other method need be
        called.
        """

    def before(self, step: kernel.Step) -> bool:
        """Prepare for a step whose forcing is set; return whether the step's begin must be kept."""

    def moved(self, begin: Begin | None) -> None:
        """Record where the particles began the last step, and move the filter's own ensembles over
        it.
        """

    def apply_evidence(self, time: int, place: PositionsAt) -> None:
        """Update weights by the evidence that ends or occurs at a time.

        place: returns where an ensemble's particles were at that time.
        """

    def watch(self, until: int) -> None:
        """Continue observation until the end of the last step."""

    def after(self, until: int) -> None:
        """Resample particles at the end of a step if necessary."""

    def weights(self, time: int) -> tuple[Array, Array | None, Array | None]:
        """Return `log_weight`, `ancestors` and `lineage` of `Moment` at a time."""


@dataclass
class _Within:
    """Positions inside the last step; times must be requested in ascending order.

    Positions sampled for evidence are kept: a particle's bridge to the end of the step continues
    from there.
    """

    own: Ensemble  # the run's own ensemble
    clock: Clock
    step: kernel.Step
    begin: Begin | None  # where the run's particles began the step, if it was kept
    kept: dict[int, Kept] = field(default_factory=dict)  # by ensemble's id

    @property
    def end(self) -> int:
        """When the step ends [s after the run's start]."""
        return int(self.step.elapsed + self.step.duration)

    def at(
        self, which: Ensemble, scene: Scene, begin: Begin | None, time: int
    ) -> tuple[Array, Array]:
        """Return and keep lon, lat of an ensemble's particles at a time inside the step."""
        places = self.look(which, scene, begin, time)
        if time < self.end:
            self.kept[id(which)] = Kept(*places, time)
        return places

    def look(
        self, which: Ensemble, scene: Scene, begin: Begin | None, time: int
    ) -> tuple[Array, Array]:
        """Like `at`, but do not condition later positions on this sample."""
        begin = self.begin if which is self.own else begin
        if begin is None or time == self.end:
            return _current_positions(which)
        kept = self.kept.get(id(which))
        if kept is not None and kept.since == time:
            return kept.lon, kept.lat
        return scene.between(which, begin, kept, self.step, time, self.clock.start)


def _current_positions(which: Ensemble) -> tuple[Array, Array]:
    return which.lon.to_numpy(), which.lat.to_numpy()


def run(
    ensemble: Ensemble,
    scene: Scene,
    clock: Clock,
    outputs: Array,
    progress: Progress | None = None,
    watch: Watch | None = None,
    search: Filter | None = None,
    since: int | None = None,
) -> Iterator[Moment]:
    """Yield the ensemble at each output time, moving it in place.

    Args:
        ensemble: at the time `since`.
        scene: in which it moves.
        clock: of the run.
        outputs: times [s since start], ascending, shape (m,).
        progress: takes the share of the run that is done.
        watch: takes the time at which each step began [s since start].
        search: filter that changes weights.
        since: begin of the step from which to continue [s since start]; None: the run's start.
    """
    due = [int(t) for t in outputs if since is None or t > since]
    if search and since is None:
        for time in search.stops(-1, 0):
            search.apply_evidence(time, lambda which, *_: _current_positions(which))
    while since is None and due and due[0] <= 0:
        yield _moment(ensemble, partial(_current_positions, ensemble), due.pop(0), search)
    steps = (timed for timed in clock.steps() if since is None or timed.step.elapsed >= since)
    at_once = 1 if watch else scene.at_once(ensemble)
    for first, last in _batch_steps(steps, partial(_can_join, scene.forcing, at_once, due, search)):
        low, high, step = first
        end = last.step.elapsed + step.duration
        count = 1 + (last.step.elapsed - step.elapsed) // step.duration
        watching = search if search and not search.rests(step) else None
        shown = {t for t in due if t <= end}
        stops = set(watching.stops(max(step.elapsed, 0), end, step)) if watching else set()
        inside = any(t < end for t in shown | stops)
        if watching:
            scene.forcing.set(low, high)
            inside |= watching.before(step)
        begin = scene.advance(ensemble, low, high, step, keep=inside, count=count)
        within = _Within(ensemble, clock, last.step, begin)
        if watching:
            watching.moved(begin)
        if watch:
            watch(step.elapsed)
        for t in sorted(shown | stops):
            if watching and t in stops:
                watching.apply_evidence(t, within.at)
            while due and due[0] == t:
                yield _moment(
                    ensemble, partial(within.look, ensemble, scene, None, t), due.pop(0), search
                )
        if watching:
            watching.watch(end)
            # outputs after the last step show the particles at its end
            if end < clock.duration:
                watching.after(end)
        if progress:
            progress(min(end / clock.duration, 1.0))


def _batch_steps(
    steps: Iterable[Timed], joins: Callable[[Timed, Timed, Timed], bool]
) -> Iterator[tuple[Timed, Timed]]:
    """Yield the first and the last of the steps that are computed together; joins: whether a step
    joins them.
    """
    made: tuple[Timed, Timed] | None = None
    for timed in steps:
        if made is not None and joins(*made, timed):
            made = made[0], timed
            continue
        if made is not None:
            yield made
        made = timed, timed
    if made is not None:
        yield made


def _can_join(
    forcing: Forcing,
    at_once: int,
    due: list[int],
    search: Filter | None,
    first: Timed,
    last: Timed,
    timed: Timed,
) -> bool:
    """Return whether a step is computed together with the steps `first` to `last` before it.

    This requires that nothing is needed before its end and that all steps use the same forcing
    slices.
    """
    step, begun = timed.step, first.step
    return (
        step.duration == begun.duration
        and step.number == last.step.number + step.direction
        and step.elapsed - begun.elapsed < at_once * step.duration
        and not (due and due[0] < step.elapsed + step.duration)
        and (search is None or (search.rests(begun) and search.rests(step)))
        and forcing.same_slices((first.low, first.high), (timed.low, timed.high))
    )


def _moment(
    ensemble: Ensemble, look: Callable[[], tuple[Array, Array]], time: int, search: Filter | None
) -> Moment:
    """Return positions, statuses and weights as known at a time."""
    # first, so that the columns it reads are freed before new ones are allocated
    status = life.read_lives(ensemble).at(time)
    if search is None:
        return Moment(time, *look(), status, ensemble.layout)
    weights = search.weights(time)
    return Moment(time, *look(), status, ensemble.layout, *weights)
