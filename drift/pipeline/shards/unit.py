"""The unit of work of a run in shards: one stretch of one shard (see `stretch`)."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drift.case.record import Case
from drift.engine.environment.environment import Environment
from drift.engine.motion import prior, simulate
from drift.engine.motion.clock import Clock
from drift.engine.motion.errors.buoys import Buoys
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scene import Scene
from drift.engine.motion.spool import ShardFile
from drift.engine.particles.ensemble import Layout
from drift.evidence.filter.debris.guide import Guide
from drift.evidence.filter.filter import SearchFilter
from drift.evidence.filter.meeting import Resampled
from drift.evidence.posterior.source import Particles
from drift.pipeline import run_setup
from drift.pipeline.buoys import share_with_buoys
from drift.pipeline.run_setup import Start
from drift.pipeline.shards import stretch
from drift.pipeline.shards.stretch import Stop, Stretch
from drift.pipeline.shards.work import Work
from geo.array import Array


@dataclass(frozen=True)
class ResumePoint:
    """The stored states from which a shard resumes."""

    time: int  # [s after start]
    states: tuple[
        tuple[str, int, int], ...
    ]  # of each shard of the previous stretch: file, first slot, slot after the last
    drawn: str = ""  # file of the resampled particles; "": they were not resampled


@dataclass(frozen=True)
class Unit:
    """A stretch of a shard: a `drift.pipeline.shards.work.Task`."""

    case: Case
    opened: Case  # whose environment the run has: see drift.pipeline.run_options.Job
    clock: Clock
    layout: Layout
    number: int  # of the shard
    first: int  # its first slot in the whole run
    stretch: int = 0
    since: ResumePoint | None = None  # None: the run's start
    # log mean likelihoods of doubtful contacts, by number
    known: Mapping[int, float] | None = None
    guide: Guide | None = None  # proposal toward the finds of debris
    buoys: Buoys | None = None  # errors at the drifting buoys
    of: str = ""  # the fingerprint of the run determines it alone

    @property
    def n(self) -> int:
        """Number of particles."""
        return self.layout.bounds[-1]

    @property
    def name(self) -> str:
        """Name of its file, without suffix."""
        return f"shard-{self.number:05}-{self.stretch:03}"

    @property
    def state(self) -> str:
        """Name of the file of its state at the end, without suffix."""
        return _state_of(self.number, self.stretch)

    def move(
        self, scene: Scene, where: Environment, tell: simulate.Progress | None, kept: Work
    ) -> ShardFile:
        """Return the file of the stretch's outputs and updates; see `Task.move`."""

        def fill(reel: ShardFile) -> None:
            with kept.also(self.state, self.n) as state:
                self._fill(scene, where, tell, kept, reel, state)

        return kept.reel(self.name, self.n, fill)

    def _fill(
        self,
        scene: Scene,
        where: Environment,
        tell: simulate.Progress | None,
        kept: Work,
        reel: ShardFile,
        state: ShardFile,
    ) -> None:
        case, spec = self.case, run_setup.spec_of(self.case, where)
        if tell:
            tell(0.0)
        with contextlib.closing(Forcing(list(where.scenarios), case.direction)) as forcing:
            own = share_with_buoys(replace(scene, forcing=forcing), self.buoys)
            if self.since is None:
                ensemble = prior.draw_ensemble(spec, scene.place.coast, self.layout).ensemble
            else:
                if self.guide is not None:
                    spec, own = self.guide.spec(spec), self.guide.scene(own)
                ensemble = prior.empty(spec, self.layout)
            begin = Start(
                spec=spec,
                dry=(),
                scene=own,
                clock=self.clock,
                trial=None,
                guide=self.guide,
                ensemble=ensemble,
            )
            if self.since is None:
                run_setup.weigh_by_buoys(self.buoys, ensemble)
                begin = run_setup.apply_guide(case, where, begin)
            spec, own, ensemble = begin.spec, begin.scene, begin.ensemble
            read = (
                Particles(spec, ensemble, own.steering)
                if run_setup.reports_posteriors(case)
                else None
            )
            time = None if self.since is None else self.since.time
            stretch_record = Stretch(
                reel, state, stretch.contacts_of(spec, case.contacts), self.known or {}, time, read
            )
            if self.since is None and self.stretch == 0 and run_setup.needs_whole_ensemble(case):
                stretch_record.drawn(ensemble.log_weight.to_numpy(), ensemble.release.to_numpy())
            search = stretch_record.search = run_setup.build_search_filter(
                case, begin, meeting=stretch_record, resumed=time is not None
            )
            if search is not None and self.since is not None:
                _restore(search, kept, self.since, self.first)
            outputs = case.period.seconds(case.outputs)
            moments = simulate.run(
                ensemble, own, self.clock, outputs, tell, search=search, since=time
            )
            with contextlib.suppress(Stop):
                reel.record(case.period, moments)
                reel.record_end(ensemble, case.period.duration)
                stretch_record.over()
            # break the reference cycle, which only the garbage collector would free
            stretch_record.search = None


def _state_of(number: int, stretch: int) -> str:
    """Return the name of the file of a shard's state at the end of a stretch."""
    return f"state-{number:05}-{stretch:03}"


def _restore(search: SearchFilter, kept: Work, since: ResumePoint, first: int) -> None:
    """Load the stored state of a shard into its new search filter.

    Args:
        search: the filter of the shard.
        kept: the store of finished shards.
        since: the states to read, and the resampled particles.
        first: slot of the shard's first particle in the run.
    """
    n, slots = search.ensemble.n, np.arange(first, first + search.ensemble.n)
    drawn = kept.read(since.drawn) if since.drawn else None
    if drawn is not None:
        slots = drawn.noted("ancestors", first, first + n)
    least, most = slots.min(), slots.max()
    states = [(kept.read(name), a, b) for name, a, b in since.states if a <= most and least < b]
    begun = states[0][0]
    for name in begun.notes:
        if not name.startswith("marker "):
            search.load(name, _gather_column(name, states, slots))
    for number, marker in enumerate(search.markers):
        marker.go_on(begun.noted(f"marker {number}").reshape(-1, 3))
    search.resume(since.time)
    if drawn is not None:
        log_weight, spare = (
            drawn.noted(name, first, first + n) for name in ("log_weight", "spare")
        )
        search.begin_anew(Resampled(slots, log_weight, spare, search.ensemble.layout), since.time)


def _gather_column(name: str, states: Sequence[tuple[ShardFile, int, int]], slots: Array) -> Array:
    """Return a column at given slots (n,) of the run, read from the states of their shards."""
    kind, size = states[0][0].notes[name][1:]
    values = np.empty((size // (states[0][2] - states[0][1]), slots.size), kind)
    for reel, first, last in states:
        which = np.flatnonzero((first <= slots) & (slots < last))
        if which.size:
            own = slots[which] - first
            least, most = int(own.min()), int(own.max()) + 1
            for k, row in enumerate(values):
                begin = k * (last - first)
                row[which] = reel.noted(name, begin + least, begin + most)[own - least]
    return values.ravel()
