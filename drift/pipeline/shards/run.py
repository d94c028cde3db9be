"""Simulate a run in shards, stretch by stretch, and join the shards to one result.

Finished stretches are read from the store. Between stretches, contacts are weighed and particles
resampled across all shards.
"""

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
from drift.engine.particles.snapshot import Deal, answer_here
from drift.evidence.filter import meeting
from drift.evidence.filter.account import UpdateCallback
from drift.evidence.filter.meeting import ResamplingRule
from drift.evidence.filter.records import Look
from drift.evidence.filter.standing import SearchStatus
from drift.evidence.filter.updates import Updates
from drift.evidence.posterior.records import Posteriors
from drift.pipeline import run_setup
from drift.pipeline.run_options import Job, ProgressCallback
from drift.pipeline.shards import cluster, shelf, stretch
from drift.pipeline.shards.divide import Divided
from drift.pipeline.shards.told import ShardedAccount, columns, join_column
from drift.pipeline.shards.unit import ResumePoint, Unit
from drift.pipeline.shards.work import LOG, Gone, Work
from geo.errors import UserError


@dataclass(frozen=True)
class Moved:
    """A run whose shards have been simulated."""

    snapshots: SnapshotStore
    updates: Updates | None
    posteriors: Posteriors | None
    begun: SearchStatus | None


@dataclass
class _RunProgress:
    """Progress of a run: its stretches so far, and where the next begins."""

    layout: Layout  # of the whole run
    number: int = 0  # of the present stretch
    since: ResumePoint | None = None  # states from which it resumes; None: the run's start
    # log mean likelihoods of doubtful contacts, by number
    known: dict[int, float] = field(default_factory=dict)
    stretches: list[Sequence[ShardFile]] = field(default_factory=list)
    events: int = 0  # number of updates when resampling was last considered


@contextlib.contextmanager
def move_shards(
    job: Job, run: Divided, mark: Mapping[str, str], noted: UpdateCallback | None
) -> Iterator[Moved]:
    """Simulate a run in shards; yield its snapshots, updates and posteriors.

    Args:
        job: the case, its environment and its options.
        run: the divided run.
        mark: the run's fingerprint.
        noted: called after each update.

    Raises:
        UserError: a step of the filter is rejected, too much is lost, or disk space is short.
    """
    case, job = job.case, replace(job, tell=_never_decreasing(job.tell))
    need, slices = (
        shelf.bytes_of_shards(case, run.layout.bounds[-1]),
        shelf.bytes_of_slices(case, run.setup.scene),
    )
    with (
        shelf.open_shelf(job.out, mark, need, slices) as kept,
        shelf.cache_forcing_in(job.where, kept),
    ):
        try:
            progress, records = _simulate_stretches(job, run, kept, mark, noted)
        except Gone as gone:
            LOG.warning("%s of the previous run is missing: it starts again", gone)
            kept.begin_anew()
            progress, records = _simulate_stretches(job, run, kept, mark, noted)
        last = progress.stretches[-1]
        deal: Deal = answer_here
        if job.client is not None:
            deal = partial(cluster.answer_on_workers, job.client, kept, mark)
        with SnapshotStore(progress.stretches, deal=deal) as spool:
            blocks = progress.layout.blocks
            unsearched = (
                columns(last, blocks, ["unsearched"]) if "unsearched" in last[0].notes else None
            )
            with _delete_store_if_rejected(kept):
                run_setup.check_end(case, job.where, run.setup, spool, unsearched)
            posteriors = records.beliefs.posteriors if records.beliefs else None
            yield Moved(spool, records.updates(last, progress.layout), posteriors, records.begun)


def _simulate_stretches(
    job: Job, run: Divided, kept: Work, mark: Mapping[str, str], noted: UpdateCallback | None
) -> tuple[_RunProgress, ShardedAccount]:
    """Simulate all stretches of all shards."""
    progress, records = _RunProgress(run.layout), None
    while True:
        units = _units(job, run, kept, progress)
        reels = _simulate_stretch(job, run, kept, mark, units)
        progress.stretches.append(reels)
        if records is None:
            records = ShardedAccount(job.case, run.setup, reels, progress.layout, noted)
        with _delete_store_if_rejected(kept):
            records.take(reels, progress.layout)
        result = stretch.result(reels[0])
        if result.over:
            return progress, records
        _prepare_next_stretch(job, run, kept, progress, units, records)


@contextlib.contextmanager
def _delete_store_if_rejected(kept: Work) -> Iterator[None]:
    """Delete the store if the run is rejected: the same command would be rejected again."""
    try:
        yield
    except UserError:
        kept.drop()
        raise


def _units(job: Job, run: Divided, kept: Work, progress: _RunProgress) -> list[Unit]:
    """Return the units of the present stretch."""
    parts = progress.layout.shards(run.many)
    firsts = np.cumsum([0, *(part.bounds[-1] for part in parts)]).tolist()
    return [
        Unit(
            job.case,
            job.opened,
            run.setup.clock,
            part,
            number,
            first,
            progress.number,
            _states_for_shard(kept, progress.since, first, last),
            progress.known,
            run.setup.guide,
            run.setup.scene.buoys,
        )
        for number, (part, (first, last)) in enumerate(
            zip(parts, itertools.pairwise(firsts), strict=True)
        )
    ]


def _states_for_shard(
    kept: Work, since: ResumePoint | None, first: int, last: int
) -> ResumePoint | None:
    """Return the states from which the shard of the slots first <= slot < last resumes."""
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


def _simulate_stretch(
    job: Job, run: Divided, kept: Work, mark: Mapping[str, str], units: Sequence[Unit]
) -> list[ShardFile]:
    """Return the reels of a stretch of all shards, moved or read where they are finished."""
    many, (begun, end) = len(units), _time_span(job, run, units[0])

    def tell(done: int, share: float) -> None:
        """Report the run's progress; `share` is that of the shard in progress."""
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


def _never_decreasing(tell: ProgressCallback) -> ProgressCallback:
    """Return a progress callback that never goes back, although steps may be repeated."""
    most = 0.0

    def report(phase: str, share: float) -> None:
        nonlocal most
        most = max(most, share)
        tell(phase, most)

    return report


def _time_span(job: Job, run: Divided, unit: Unit) -> tuple[float, float]:
    """Return the start and the expected end of a stretch, as shares of the run's duration."""
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


def _prepare_next_stretch(
    job: Job,
    run: Divided,
    kept: Work,
    progress: _RunProgress,
    units: Sequence[Unit],
    records: ShardedAccount,
) -> None:
    """Reduce over all shards at the end of a stretch, and prepare the next stretch.

    The reduction is the mean likelihood of a doubtful contact, or resampling.
    """
    reels, before = progress.stretches[-1], progress.since
    result, states = (
        stretch.result(reels[0]),
        [(unit.state, unit.first, unit.first + unit.n) for unit in units],
    )
    if result.since is not None and (before is None or result.since != before.time):
        progress.since = ResumePoint(result.since, tuple(states))
    if result.contact is not None:
        weighed = {
            name: weights.merge_weight_sums(
                [
                    stretch.weighed(reel, name, unit.layout.blocks)
                    for reel, unit in zip(reels, units, strict=True)
                ]
            )
            for name in ("before", "after")
        }
        progress.known = {
            **progress.known,
            result.contact: meeting.log_mean_likelihood(weighed["before"], weighed["after"]),
        }
    elif len(records.account.updates) > progress.events:
        progress.events = len(records.account.updates)
        assert progress.since is not None
        progress.since = _resample_if_needed(job, run, kept, progress, records, progress.since)
    if before is not None and before is not progress.since:
        for name, _, _ in before.states:
            kept.remove(name)
    progress.number += 1


def _resample_if_needed(
    job: Job,
    run: Divided,
    kept: Work,
    progress: _RunProgress,
    records: ShardedAccount,
    since: ResumePoint,
) -> ResumePoint:
    """Resample at the end of a stretch if the effective sample is too small.

    Return the states from which the next stretch resumes.
    """
    name, layout = f"drawn-{progress.number:03}", progress.layout
    target = prior.counts_of(run.setup.spec)
    redrawing = ResamplingRule(job.case.seed, job.case.resampling, target)

    def fill(reel: ShardFile) -> None:
        states = [kept.read(name) for name, _, _ in since.states]
        drawn = redrawing.anew(join_column(states, "particle log_weight"), layout, progress.events)
        reel.note("bounds", np.array(layout.bounds if drawn is None else drawn.layout.bounds))
        if drawn is not None:
            begun = (
                join_column(states, "history lineage")
                if "history lineage" in states[0].notes
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
    progress.layout = (
        layout if bounds == layout.bounds else Layout(bounds, bounds[:-1], layout.block)
    )
    records.account.drawn_anew(
        reel.noted("log_weight"), reel.noted("lineage"), progress.layout, sum(target)
    )
    return replace(since, drawn=name)
