"""The whole flow on one page: case -> environment -> prior -> forecast and filter -> products -> files."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drift import facts, turns
from drift.backtrack import backward
from drift.backtrack import chapter as backtrack_chapter
from drift.case.file import Case
from drift.forecast import build as forecast_build
from drift.forecast import chapter as forecast_chapter
from drift.forecast import effective, off_grid
from drift.forecast.build import Forecast
from drift.forecast.tracks import Trajectories
from drift.motion import ensemble as record
from drift.motion import environment, prior, silence, simulate, start, weights
from drift.motion.environment import Environment
from drift.motion.snapshot import Snapshot
from drift.motion.spool import Spool
from drift.motion.start import Start
from drift.motion.status import Status
from drift.output import writer
from drift.output.chapter import Chapter, joined
from drift.search import chapter as search_chapter
from drift.search import particles_left
from drift.search import tables as search_tables
from drift.search.filter import Search
from drift.search.standing import Standing, standing
from drift.search.updates import Updates
from drift.spill import chapter as spill_chapter
from drift.spill import evidence, renewal
from drift.spill.renewal import Aftermath, Drifted
from drift.spill.strandings import Landings
from drift.suspend import chapter as suspend_chapter
from drift.suspend import decision
from drift.suspend.decision import Planned
from geo.errors import UserError
from geo.files import digest
from kernels import deposit, runtime

Report = Callable[[str, float], None]
LOST = (Status.OUTSIDE, Status.LEFT)


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
    def probability(self) -> Any:
        """Probability that the object is in a cell (time, lat, lon), an xarray.DataArray."""
        return self.forecast.probability

    @property
    def washup(self) -> Any:
        """What comes ashore where and when, an xarray.Dataset (see drift.spill.washup); None without a spill."""
        return self.aftermath.washup if self.aftermath else None


@dataclass
class Stopwatch:
    """Wall time by phase [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextlib.contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a phase."""
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


@turns.in_turn
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

    datasets: the xarray.Datasets that the case's sources name; they are only read, and not kept. report is told what is being
    done and how much of it is done. Raises UserError for all that the user can mend.
    """
    tell, out = report or (lambda phase, share: None), folder(out)
    where, clock = opened(case, datasets, out, threads, backend, overwrite, tell)
    result = forecasted(case, where, clock, tell)
    if out is not None:
        tell("write", 0.0)
        write(result, where, out, clock, overwrite=overwrite)
    return result


def folder(out: str | os.PathLike[str] | None) -> Path | None:
    """Return the folder for results that was named as text or as a path; None for none."""
    return None if out is None else Path(out)


def opened(
    case: Case,
    datasets: Mapping[str, Any] | None,
    out: Path | None,
    threads: int | None,
    backend: str,
    overwrite: bool,
    tell: Report,
) -> tuple[Environment, Stopwatch]:
    """Return the environment of a case, once it is sure that results can be written and Taichi runs; and the time that took."""
    if out is not None:
        writer.check_folder(out, overwrite, (*forecast_chapter.FILES, *forecast_chapter.PICTURES))
    digest.start(case.inputs)
    clock = Stopwatch()
    with clock.phase("taichi"):
        runtime.start(backend, threads)
    tell("read", 0.0)
    with clock.phase("read"):
        where = environment.open_for(case, datasets)
    return where, clock


def forecasted(case: Case, where: Environment, clock: Stopwatch, tell: Report) -> Result:
    """Return the forecast of a case in an environment that has been opened; Taichi has been started."""
    with clock.phase("start"):
        begin = start.prepare(case, where)
        stretches = renewal.stretches(case, case.spill, where, begin) if case.spill else None
    outputs = np.array([prior.elapsed(case, t) for t in case.outputs])
    begun = None
    if not case.spill and (case.sorties or any(scenario.survival for scenario in case.scenarios)):
        one, log_weight = begin.ensemble, begin.ensemble.log_weight.to_numpy()
        ess = weights.ess(log_weight)
        begun = standing(case.start, weights.relative(log_weight), one.release.to_numpy(), one.scenarios, None, ess)
    seen: list[Updates] = []  # what sorties and contacts did, by drift
    with contextlib.ExitStack() as stack:

        def drifted(begin: Start) -> Drifted:
            """Move an ensemble through the run, keeping what it was like at every output."""
            stack.callback(begin.scene.forcing.close)
            with clock.phase("drift"):
                landings = Landings(begin.ensemble, begin.scene.place.beach.stay > 0)
                search = Search(case, begin.ensemble, begin.scene) if case.sorties or case.contacts else None
                moments = simulate.run(
                    begin.ensemble, begin.scene, begin.clock, outputs, partial(tell, "drift"), landings.watch, search
                )
                snapshots = stack.enter_context(Spool(case, begin.ensemble, moments))
            check_lost(case, where, begin, snapshots[-1], search)
            if search:
                seen.append(search.updates)
            return Drifted(begin, snapshots, landings)

        done, after = drifted(begin), None
        if case.spill and stretches:
            with clock.phase("finds"):
                done, after = renewal.settle(case, case.spill, where, stretches, done, drifted)
        begin, snapshots, updates = done.start, done.snapshots, seen[-1] if seen else None
        account = record.account(begin.ensemble, snapshots[-1].status)
        tell("map", 0.0)
        with clock.phase("products"):
            names = [scenario.name for scenario in case.scenarios]
            is_land = start.land_of(begin.scene)
            made = forecast_build.build(
                snapshots, scenarios=names, is_land=is_land, deposit=deposit.deposit, shares=case.areas, grid=case.grid
            )
            tracks = _trajectories(case, begin.ensemble, snapshots)
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

    more: chapters of what was made from the forecast. planned: sorties that are still to be flown, where it is the forecast of their failure.
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


@turns.in_turn
def trace(
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
    tell, out = report or (lambda phase, share: None), folder(out)
    if case.spill is None:
        raise UserError(f"{case.path.name}: has no [spill]; an origin is told from the [[find]]s of a spill")
    where, clock = opened(case, datasets, out, threads, backend, overwrite, tell)
    assert where.coast is not None
    with clock.phase("read"):
        segments = evidence.cut(case.spill, where.coast)
        places = [evidence.place(find, segments, where.coast) for find in case.spill.finds]
    with clock.phase("drift"):
        found = backward.backward(case, where, segments, places, progress=partial(tell, "drift"))
    if out is not None:
        matter = backtrack_chapter.Matter(found, case.spill.finds, facts.setting(case, where))
        run = Chapter(facts=facts.attributes(case, where))
        chapters = [run, backtrack_chapter.chapter(matter), Chapter({"wall_time_s": clock.seconds})]
        publish(out, chapters, overwrite=overwrite)
    return found


def check_lost(case: Case, where: Environment, begin: Start, end: Snapshot, search: Search | None) -> None:
    """Refuse a run that lost more than the case allows, by weights as if no sortie had been flown.

    What is lost is a matter of the motion: a good search that finds nothing leaves what it could not reach, and is not to be refused
    for that.
    """
    if search is not None:
        end = replace(end, probability=record.shares(search.unsearched))
    by_status = np.bincount(end.status, end.probability, len(Status))
    lost = {status: float(by_status[status]) for status in LOST}
    if sum(lost.values()) <= case.max_lost:
        return
    box, silent = where.box, silence.told(silence.lost(begin.scene.forcing, begin.clock, begin.ensemble, end))
    raise UserError(
        f"{sum(lost.values()):.0%} of the probability was lost by the end: {lost[Status.OUTSIDE]:.0%} ran out of "
        f"forcing{f' (no value: {silent})' if silent else ''}, {lost[Status.LEFT]:.0%} left the domain ({box.west:.2f}..{box.east:.2f} E, {box.south:.2f}.."
        f"{box.north:.2f} N); at most {case.max_lost:.0%} may be (max_lost). Shorten the run, add a source, or widen "
        "[domain]"
    )


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
    release, ended, edge = (column.to_numpy()[slot] for column in (ensemble.release, ensemble.ended, ensemble.edge))
    over = (last.status[slot] != Status.ADRIFT) & (last.status[slot] != Status.PENDING)
    ended, edge = np.where(over, ended, -1), np.where(over, edge, -1)
    times = np.array([snapshots.time(k) for k in range(len(snapshots))])
    return Trajectories(times, slot, last.scenario[slot], lon, lat, status, weight, release, ended, edge)
