"""The whole flow on one page: case -> environment -> prior -> forecast and filter -> products -> files."""

import contextlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift import facts, start
from drift.backtrack import backward
from drift.backtrack import chapter as backtrack_chapter
from drift.case.record import Case
from drift.forecast import build as forecast_build
from drift.forecast import chapter as forecast_chapter
from drift.forecast import effective, off_grid
from drift.forecast.build import Forecast
from drift.forecast.tracks import Trajectories
from drift.job import Job, Report, Stopwatch, in_turn, opened
from drift.motion import ensemble as record
from drift.motion import life, scene, simulate
from drift.motion.environment import Environment
from drift.motion.spool import Spool
from drift.output import writer
from drift.output.chapter import Chapter, joined
from drift.search import chapter as search_chapter
from drift.search import particles_left
from drift.search import tables as search_tables
from drift.search.standing import Standing, standing
from drift.search.updates import Updates
from drift.spill import chapter as spill_chapter
from drift.spill import evidence, renewal
from drift.spill.renewal import Aftermath, Drifted
from drift.spill.strandings import Landings
from drift.spill.worlds import Proposal
from drift.start import Start
from drift.suspend import chapter as suspend_chapter
from drift.suspend import decision
from drift.suspend.further import Planned
from geo.errors import UserError
from kernels import deposit


@dataclass(frozen=True)
class Result:
    """A forecast, the numbers about it, and its subsample's tracks."""

    case: Case
    forecast: Forecast
    trajectories: Trajectories
    summary: dict[str, Any]
    aftermath: Aftermath | None = None  # of a spill: its washup, finds and unknowns
    updates: Updates | None = None  # what sorties and contacts did
    begun: Standing | None = None  # how a search stood before any of them; None: no sorties, no survival times

    @property
    def probability(self) -> xr.DataArray:
        """Probability that the object is in a cell (time, lat, lon)."""
        return self.forecast.probability

    @property
    def washup(self) -> xr.Dataset | None:
        """What comes ashore where and when (see drift.spill.washup); None without a spill."""
        return self.aftermath.washup if self.aftermath else None


@in_turn
def run(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    overwrite: bool = False,
    report: Report | None = None,
) -> Result:
    """Forecast a case; with `out`, write the results there, complete or not at all.

    datasets: the xarray.Datasets that the case's sources name; they are only read, and not kept. report is told what is
    being done and how much of it is done. Raises UserError for all that the user can mend.
    """
    job = opened(case, out, datasets, threads, backend, overwrite, report)
    result = forecasted(job)
    if job.out is not None:
        job.tell("write", 0.0)
        write(result, job.where, job.out, job.clock, overwrite=overwrite)
    return result


def forecasted(job: Job) -> Result:
    """Return the forecast of a job's case."""
    case, where, clock, tell = job.case, job.where, job.clock, job.tell
    with clock.phase("start"):
        begin = start.prepare(case, where)
        stretches = None
        if case.spill and where.coast and begin.worlds:
            stretches = renewal.stretches(case.period, case.spill, where.coast, begin.worlds)
    outputs = case.period.seconds(case.outputs)
    begun = None
    if not case.spill and (case.sorties or any(scenario.survival for scenario in case.scenarios)):
        log_weight, ess = begin.ensemble.log_weight.to_numpy(), record.weighed(begin.ensemble).ess
        begun = standing(case.start, begin.ensemble, log_weight, None, ess)
    seen: list[Updates] = []  # what sorties and contacts did, by drift
    with contextlib.ExitStack() as stack:

        def drifted(begin: Start) -> Drifted:
            """Move an ensemble through the run, keeping what it was like at every output."""
            stack.callback(begin.scene.forcing.close)
            with clock.phase("drift"):
                landings = Landings(begin.ensemble, begin.scene.place.beach.stay > 0)
                search = start.search(case, begin)
                moments = simulate.run(
                    begin.ensemble, begin.scene, begin.clock, outputs, partial(tell, "drift"), landings.watch, search
                )
                spool = Spool(case.period, begin.ensemble, moments, len(outputs), worlds=case.spill is not None)
                snapshots = stack.enter_context(spool)
            start.check_end(case, where, begin, snapshots[-1], search)
            if search:
                seen.append(search.updates)
            return Drifted(begin.ensemble, snapshots, landings, begin.worlds)

        def renewed(proposal: Proposal, number: int) -> Drifted:
            """Draw a spill's worlds anew, and move their objects through the run."""
            nonlocal begin
            begin = start.renew(case, where, begin, proposal, number)
            return drifted(begin)

        done, after = drifted(begin), None
        if case.spill and stretches and where.coast:
            with clock.phase("finds"):
                done, after = renewal.settle(case.period, case.spill, where.coast, stretches, done, renewed)
        snapshots, updates = done.snapshots, seen[-1] if seen else None
        account = record.account(done.ensemble, snapshots[-1].status)
        tell("map", 0.0)
        with clock.phase("products"):
            names = [scenario.name for scenario in case.scenarios]
            is_land = scene.land_of(begin.scene)
            made = forecast_build.build(
                snapshots, scenarios=names, is_land=is_land, deposit=deposit.deposit, shares=case.areas, grid=case.grid
            )
            tracks = _trajectories(case, done.ensemble, snapshots)
    numbers = facts.numbers(case, where, account, begin, clock.seconds)
    numbers["warnings"] = particles_left.of_run(made.data, case.particles, updates) + off_grid.warnings(made.data)
    if after is not None:
        numbers |= renewal.numbers(after)
        few = effective.Count(after.posterior.effective, what="worlds").few  # the maps' worlds are the same
        numbers["warnings"] = [*renewal.warnings(after), *([] if few else numbers["warnings"])]
    if updates is not None:
        numbers |= {"search": search_tables.numbers(updates)}
    return Result(case, made, tracks, numbers, after, updates, begun)


def write(
    result: Result,
    where: Environment,
    out: Path,
    clock: Stopwatch,
    *,
    more: Sequence[Chapter] = (),
    planned: Planned | None = None,
    overwrite: bool = False,
) -> None:
    """Write all that a forecast hands out, complete or not at all.

    more: chapters of what was made from the forecast. planned: sorties that are still to be flown, where it is the
    forecast of their failure.
    """
    with clock.phase("write"):
        case, after, updates, told = result.case, result.aftermath, result.updates, suspension(result, planned)
        on = facts.with_coast(facts.setting(case, where))
        failed = on
        if planned is not None:
            failed = replace(on, imprint=replace(on.imprint, title=f"If this plan finds nothing: {case.title}"))
        chapters = [facts.chapter(case, where, result.summary)]
        if after is not None:
            chapters.append(spill_chapter.chapter(spill_chapter.Matter(after, on)))
        if updates is not None:
            # A plan's forecast has no outputs at the times of its sorties: plan.png shows them.
            matter = search_chapter.Matter(updates, case.contacts, result.forecast, failed)
            chapters.append(search_chapter.chapter(matter, mapped=planned is None))
        chapters += more
        if told is not None:
            lost = decision.off_map(result.forecast.data)
            chapters.append(
                suspend_chapter.chapter(suspend_chapter.Matter(told, on.imprint, facts.synthetic(case), lost))
            )
        searches = [partial(search_chapter.overlay, updates.sorties if updates else (), case.contacts)]
        chapters.append(
            forecast_chapter.chapter(forecast_chapter.Matter(result.forecast, result.trajectories, failed, searches))
        )
        publish(out, chapters, overwrite=overwrite)


def publish(out: Path, chapters: Sequence[Chapter], *, overwrite: bool) -> None:
    """Write chapters; a picture that cannot be drawn is left out, with a warning."""
    from drift.maps import page  # here: Matplotlib takes a second to import

    whole = joined(chapters)
    pictures = {name: page.kept(draw) for name, draw in whole.pictures.items()}
    writer.write(out, [replace(whole, pictures=pictures)], overwrite=overwrite)


def suspension(result: Result, planned: Planned | None = None) -> decision.Suspension | None:
    """Return what a decision to suspend rests on; None where there are neither sorties nor survival times. planned: not yet flown."""
    case, begun = result.case, result.begun
    if begun is None or case.direction < 0:
        return None
    return decision.build(case.scenarios, case.start, begun, result.updates, result.forecast.data, planned)


@in_turn
def origin(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    overwrite: bool = False,
    report: Report | None = None,
) -> backward.Origin:
    """Run a spill backward from its finds to where and when it may have been released; with `out`, write what it found.

    It proposes where to look: the answer is a forward run weighted by the finds. Raises UserError for all that the user
    can mend.
    """
    if case.spill is None:
        raise UserError(f"{case.path.name}: has no [spill]; an origin is told from the [[find]]s of a spill")
    job = opened(case, out, datasets, threads, backend, overwrite, report)
    where = job.where
    assert where.coast is not None
    with job.clock.phase("read"):
        segments = evidence.cut(case.spill, where.coast)
        places = [evidence.place(find, segments, where.coast) for find in case.spill.finds]
    with job.clock.phase("drift"):
        spec, cut = start.ensemble_spec(case), start.clock_spec(case)
        found = backward.backward(case.spill, spec, cut, where, segments, places, progress=partial(job.tell, "drift"))
    if job.out is not None:
        matter = backtrack_chapter.Matter(found, case.spill.finds, facts.setting(case, where))
        run = Chapter(facts=facts.attributes(case, where))
        chapters = [run, backtrack_chapter.chapter(matter), Chapter({"wall_time_s": job.clock.seconds})]
        publish(job.out, chapters, overwrite=overwrite)
    return found


trace = origin  # its name before


def _trajectories(case: Case, ensemble: record.Ensemble, snapshots: Spool) -> Trajectories:
    """Return the tracks of slots spread evenly over the ensemble; of what was drawn anew, its ancestors' before that."""
    last = snapshots[-1]
    count = min(case.trajectories, last.lon.size)
    slots = np.arange(last.lon.size)
    if case.resampling.below > 0:  # without those to spare
        slots = np.flatnonzero(last.probability)
    slot = slots[np.unique(np.linspace(0, slots.size - 1, count).astype(int))]
    ancestor, columns = slot, []
    for k in range(len(snapshots) - 1, -1, -1):
        one = snapshots[k]
        columns.append((one.lon[ancestor], one.lat[ancestor], one.status[ancestor], one.probability[ancestor]))
        drawn = snapshots.ancestors[k]
        ancestor = ancestor if drawn is None else drawn[ancestor]
    lon, lat, status, weight = (np.stack(column[::-1], axis=1) for column in zip(*columns, strict=True))
    lives, edge = life.read(ensemble), ensemble.edge.to_numpy()
    over = life.over(last.status)
    ended, edge = (np.where(over, values, -1)[slot] for values in (lives.since, edge))
    times = np.array([snapshots.time(k) for k in range(len(snapshots))])
    return Trajectories(times, slot, last.scenario[slot], lon, lat, status, weight, lives.release[slot], ended, edge)
