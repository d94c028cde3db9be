"""A run in shards: each is moved, or read where it is finished; then all are one run again."""

import contextlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from drift.engine.motion import prior
from drift.engine.motion.spool import ShardFile, SnapshotStore
from drift.engine.particles import weights
from drift.engine.particles.ensemble import Layout
from drift.evidence.filter import meeting
from drift.evidence.filter.account import Noted
from drift.evidence.filter.meeting import Redrawing
from drift.evidence.filter.records import Look
from drift.evidence.filter.standing import Standing
from drift.evidence.filter.updates import Updates
from drift.evidence.posterior.records import Posteriors
from drift.pipeline import run_setup
from drift.pipeline.run_options import Job, Report
from drift.pipeline.shards import cluster, shelf, stretch
from drift.pipeline.shards.divide import Divided
from drift.pipeline.shards.told import Told, columns, together
from drift.pipeline.shards.unit import From, Unit
from drift.pipeline.shards.work import LOG, Gone, Work
from geo.errors import UserError


@dataclass(frozen=True)
class Moved:
    """A run whose shards have been moved."""

    snapshots: SnapshotStore
    updates: Updates | None
    posteriors: Posteriors | None
    begun: Standing | None


@dataclass
class _Way:
    """A run on its way from stretch to stretch."""

    layout: Layout  # of the whole run
    number: int = 0  # of the present stretch
    since: From | None = None  # where it begins; None: at the run's start
    # log mean likelihoods of doubtful contacts, by their numbers
    known: dict[int, float] = field(default_factory=dict)
    stretches: list[Sequence[ShardFile]] = field(default_factory=list)
    events: int = 0  # after which it was last asked whether particles are drawn anew


@contextlib.contextmanager
def move_shards(
    job: Job, run: Divided, mark: Mapping[str, str], noted: Noted | None
) -> Iterator[Moved]:
    """Give what the particles of a run were like at all output times, and what was told on the way.

    mark: the run's fingerprint.
    """
    case, job = job.case, replace(job, tell=_rising(job.tell))
    need, slices = shelf.need(case, run.layout.bounds[-1]), shelf.slices(case, run.setup.scene)
    with (
        shelf.open_shelf(job.out, mark, need, slices) as kept,
        shelf.stored(job.where, kept),
    ):
        try:
            way, told = _all(job, run, kept, mark, noted)
        except Gone as gone:
            LOG.warning("%s of the previous run is missing: it starts again", gone)
            kept.begin_anew()
            way, told = _all(job, run, kept, mark, noted)
        last = way.stretches[-1]
        with SnapshotStore(way.stretches) as spool:
            blocks = way.layout.blocks
            unsearched = (
                columns(last, blocks, ["unsearched"]) if "unsearched" in last[0].notes else None
            )
            with _dropped_if_refused(kept):
                run_setup.check_end(case, job.where, run.setup, spool, unsearched)
            posteriors = told.beliefs.posteriors if told.beliefs else None
            yield Moved(spool, told.updates(last, way.layout), posteriors, told.begun)


def _all(
    job: Job, run: Divided, kept: Work, mark: Mapping[str, str], noted: Noted | None
) -> tuple[_Way, Told]:
    """Move all stretches of all shards."""
    way, told = _Way(run.layout), None
    while True:
        units = _units(job, run, kept, way)
        reels = _stretch(job, run, kept, mark, units)
        way.stretches.append(reels)
        if told is None:
            told = Told(job.case, run.setup, reels, way.layout, noted)
        with _dropped_if_refused(kept):
            told.take(reels, way.layout)
        result = stretch.result(reels[0])
        if result.over:
            return way, told
        _go_on(job, run, kept, way, units, told)


@contextlib.contextmanager
def _dropped_if_refused(kept: Work) -> Iterator[None]:
    """Keep nothing of a run that is refused: the same command would only be refused again."""
    try:
        yield
    except UserError:
        kept.drop()
        raise


def _units(job: Job, run: Divided, kept: Work, way: _Way) -> list[Unit]:
    """Return the units of the present stretch."""
    parts = way.layout.shards(run.many)
    firsts = np.cumsum([0, *(part.bounds[-1] for part in parts)]).tolist()
    return [
        Unit(
            job.case,
            run.setup.clock,
            part,
            number,
            first,
            way.number,
            _of_shard(kept, way.since, first, last),
            way.known,
            run.setup.guide,
        )
        for number, (part, (first, last)) in enumerate(
            zip(parts, itertools.pairwise(firsts), strict=True)
        )
    ]


def _of_shard(kept: Work, since: From | None, first: int, last: int) -> From | None:
    """Return where a shard of some slots goes on, with no more states than it needs."""
    if since is None:
        return None
    least, most = first, last - 1
    if since.drawn:
        ancestors = kept.read(since.drawn).noted("ancestors", first, last)
        least, most = int(ancestors.min()), int(ancestors.max())
    return replace(
        since,
        states=tuple(state for state in since.states if state[1] <= most and least < state[2]),
    )


def _stretch(
    job: Job, run: Divided, kept: Work, mark: Mapping[str, str], units: Sequence[Unit]
) -> list[ShardFile]:
    """Return the reels of a stretch of all shards, moved or read where they are finished."""
    many, (begun, end) = len(units), _span(job, run, units[0])

    def tell(done: int, share: float) -> None:
        """Say how far the run is; share: how far the shard after those that are done is."""
        own = min(max(share - begun, 0.0), end - begun)
        job.tell("drift", begun + (done * (end - begun) + own) / many)

    if job.client is not None:
        missing = [unit for unit in units if not kept.finished(unit.name)]
        cluster.move_shards_on_cluster(
            job.client, kept, mark, missing, lambda done: tell(many - len(missing) + int(done), 0.0)
        )
    return [
        unit.move(run.setup.scene, job.where, partial(tell, unit.number), kept) for unit in units
    ]


def _rising(tell: Report) -> Report:
    """Return the same that never goes back: a step before which shards meet is made twice."""
    most = 0.0

    def told(phase: str, share: float) -> None:
        nonlocal most
        most = max(most, share)
        tell(phase, most)

    return told


def _span(job: Job, run: Divided, unit: Unit) -> tuple[float, float]:
    """Return the shares of the run's time at which a stretch begins and will end, to a step."""
    case, duration = job.case, run.setup.clock.duration
    begun = unit.since.time if unit.since else 0
    asked = [
        contact.time
        for k, contact in enumerate(case.contacts)
        if contact.belief < 1 and k not in (unit.known or {})
    ]
    if case.resampling.below > 0:
        asked += [contact.time for contact in case.contacts] + [
            sortie.end for sortie in case.sorties
        ]
        asked += [
            what.time if isinstance(what, Look) else what.end for what in case.sensors.telling
        ]
    stops = [time for time in map(case.period.elapsed, asked) if time > begun]
    return begun / duration, min([*stops, duration]) / duration


def _go_on(
    job: Job, run: Divided, kept: Work, way: _Way, units: Sequence[Unit], told: Told
) -> None:
    """Let all shards meet at the end of a stretch, and go on to the next."""
    reels, before = way.stretches[-1], way.since
    result, states = (
        stretch.result(reels[0]),
        [(unit.state, unit.first, unit.first + unit.n) for unit in units],
    )
    if result.since is not None and (before is None or result.since != before.time):
        way.since = From(result.since, tuple(states))
    if result.contact is not None:
        weighed = {
            name: weights.merged(
                [
                    stretch.weighed(reel, name, unit.layout.blocks)
                    for reel, unit in zip(reels, units, strict=True)
                ]
            )
            for name in ("before", "after")
        }
        way.known = {
            **way.known,
            result.contact: meeting.log_mean(weighed["before"], weighed["after"]),
        }
    elif len(told.account.updates) > way.events:
        way.events = len(told.account.updates)
        assert way.since is not None
        way.since = _drawn_anew(job, run, kept, way, told, way.since)
    if before is not None and before is not way.since:
        for name, _, _ in before.states:
            kept.remove(name)
    way.number += 1


def _drawn_anew(job: Job, run: Divided, kept: Work, way: _Way, told: Told, since: From) -> From:
    """Draw all particles again at the end of a stretch if too few of them count; return where the
    next goes on.
    """
    name, layout = f"drawn-{way.number:03}", way.layout
    target = prior.counts_of(run.setup.spec)
    redrawing = Redrawing(job.case.seed, job.case.resampling, target)

    def fill(reel: ShardFile) -> None:
        states = [kept.read(name) for name, _, _ in since.states]
        drawn = redrawing.anew(together(states, "particle log_weight"), layout, way.events)
        reel.note("bounds", np.array(layout.bounds if drawn is None else drawn.layout.bounds))
        if drawn is not None:
            begun = (
                together(states, "lineage")
                if "lineage" in states[0].notes
                else np.arange(layout.bounds[-1])
            )
            for what, values in (("log_weight", drawn.log_weight), ("spare", drawn.spare)):
                reel.note(what, values)
            reel.note("ancestors", drawn.ancestors.astype(np.int32))
            reel.note("lineage", begun[drawn.ancestors].astype(np.int32))

    reel = kept.reel(name, layout.bounds[-1], fill)
    if "ancestors" not in reel.notes:
        return since
    bounds = tuple(reel.noted("bounds").tolist())
    way.layout = layout if bounds == layout.bounds else Layout(bounds, bounds[:-1], layout.block)
    told.account.drawn_anew(
        reel.noted("log_weight"), reel.noted("lineage"), way.layout, sum(target)
    )
    return replace(since, drawn=name)
