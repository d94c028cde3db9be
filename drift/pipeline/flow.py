"""Run a case from input to output files: environment, prior, simulation with filter, products.

`run` is the entry point of a forward forecast, `origin` that of a backward run of a spill. A run
is simulated in one piece here, or in shards by `drift.pipeline.shards`.
"""

import contextlib
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal, Unpack, overload

import numpy as np

from drift.case.record import Case
from drift.engine.environment import ambient, environment
from drift.engine.environment.ambient import Flow
from drift.engine.environment.environment import Environment
from drift.engine.motion import changes, scene, simulate
from drift.engine.motion.errors.buoys import BuoyTrack, PointReport
from drift.engine.motion.forcing import Sources
from drift.engine.motion.spool import SnapshotStore
from drift.engine.particles import life
from drift.engine.particles.columns import Columns
from drift.engine.particles.ensemble import Ensemble
from drift.evidence.filter import account
from drift.evidence.filter.account import UpdateCallback
from drift.evidence.filter.products import chapter as search_chapter
from drift.evidence.filter.products import particles_left
from drift.evidence.filter.products import tables as search_tables
from drift.evidence.filter.standing import SearchStatus
from drift.evidence.filter.updates import Updates
from drift.evidence.posterior import chapter as posterior_chapter
from drift.evidence.posterior import tables as posterior_tables
from drift.evidence.posterior.records import Posteriors
from drift.evidence.suspend import chapter as suspend_chapter
from drift.evidence.suspend import decision
from drift.evidence.suspend.further import Planned
from drift.forecast import build as forecast_build
from drift.forecast import by_member, effective, mapped, off_grid, survey
from drift.forecast.by_member import Members
from drift.forecast.products import chapter as forecast_chapter
from drift.forecast.products import dataset
from drift.forecast.tracks import Trajectories
from drift.pipeline import buoy_effect, report_effect, run_metadata, run_setup, states
from drift.pipeline.result import Result
from drift.pipeline.run_options import (
    Job,
    JobOptions,
    Options,
    ProgressCallback,
    RunOptions,
    open_job,
    serialized,
)
from drift.pipeline.run_setup import Setup, Start
from drift.pipeline.shards import cluster, divide, fingerprint, shelf, spilled
from drift.pipeline.shards import run as shards_run
from drift.products.files import publication, writer
from drift.products.files.chapter import OutputBundle, join_contents
from drift.products.maps.imprint import Setting
from drift.spills.backtrack import backward
from drift.spills.backtrack import chapter as backtrack_chapter
from drift.spills.worlds import evidence, renewal
from drift.spills.worlds.products import chapter as spill_chapter
from drift.spills.worlds.renewal import DriftedRun, SpillResult
from drift.spills.worlds.strandings import Landings
from drift.spills.worlds.worlds import Proposal, Worlds
from geo.array import Array
from geo.coast.segments import Segments
from geo.errors import UserError
from kernels.runtime import runtime

REPORT = "report.html"
COMMAND = "command"  # key of the summary: the command that made the results
# warnings go to standard error unless the calling program configures logging
LOG = logging.getLogger("drift")


@overload
def run(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    resume: Literal[False] = False,
    **options: Unpack[RunOptions],
) -> Result: ...
@overload
def run(
    case: Case,
    out: str | os.PathLike[str],
    *,
    resume: bool,
    **options: Unpack[RunOptions],
) -> Result | None: ...


@serialized
def run(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    resume: bool = False,
    **options: Unpack[RunOptions],
) -> Result | None:
    """Forecast a case; with `out`, write the results there, complete or not at all.

    Args:
        case: made by `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        resume: if `out` holds the results of exactly this run, do nothing and return None. If it
            holds results of another run, log what changed and replace them. If a run in shards was
            stopped there, compute only the missing shards.
        **options: see `drift.pipeline.run_options.RunOptions`.

    Returns:
        The forecast: `probability` (time, lat, lon) adds up to 1 over the cells of each time, minus
            the probability outside the grid;
        `tables` (pandas), `areas` (geopandas), `particles`, `summary`, `plot()`, `save()`. None
        only with `resume`.

    Raises:
        UserError: a mistake in the input, one line for each (`error.lines`): `out` holds something
            else, the backend or number of threads is not available, the forcing does not cover the
            run, too many particles are lost.
    """
    if resume and out is None:
        raise UserError(
            "resume = True needs out: without an output folder there is nothing to resume from"
        )
    if resume:
        options["overwrite"] = True
    job = open_run(case, out, options)
    if resume and _holds_this_run(job):
        assert job.out is not None
        if shelf.unfinished(job.out):  # a run was killed between writing results and cleaning up
            shelf.clear(job.out, fingerprint.fingerprint_of(case, job.where, 1))
        return None
    with open_result(
        job
    ) as made:  # the shards stay locked against other runs until results are written
        result = replace(made, saved=_save)
        write_results(result, job)
    if job.out is not None:
        shelf.clear(job.out)
    return result


def open_run(case: Case, out: str | os.PathLike[str] | None, options: RunOptions) -> Job:
    """Return the job of a run: backend "auto" becomes that of an unfinished run to the same
    folder."""
    asked = Options(out, **options)
    return open_job(
        case, replace(asked, backend=shelf.resumed_backend(asked.backend, out, asked.client))
    )


def _holds_this_run(job: Job) -> bool:
    """Return whether the output folder holds results of exactly this run; log what differs."""
    assert job.out is not None
    before = publication.summary(job.out, writer.SUMMARY)
    if before is None:
        return False
    changed = run_metadata.changed_inputs(job.case, job.where, before)
    if before.get(COMMAND) != "run":
        changed.append("the command")
    if changed:
        LOG.warning(
            "%s holds results of another run: %s changed since; they are replaced once the new ones are complete",
            job.out,
            " and ".join(changed),
        )
    return not changed


@dataclass(frozen=True)
class FinishedRun:
    """A simulated run before its products are made; particles are read from its snapshots."""

    setup: Setup
    snapshots: SnapshotStore
    updates: Updates | None = None
    posteriors: Posteriors | None = None
    after: SpillResult | None = None
    begun: SearchStatus | None = None


@dataclass(frozen=True)
class WholeRun(FinishedRun):
    """A simulated run in one piece, with the ensemble at its start and at its end."""

    begin: Start = field(kw_only=True)
    done: DriftedRun = field(kw_only=True)


def forecast_job(job: Job, noted: UpdateCallback | None = None) -> Result:
    """Return the forecast of a job's case; `noted` is the update callback of `simulate_run`."""
    with open_result(job, noted) as result:
        return result


@contextlib.contextmanager
def open_result(job: Job, noted: UpdateCallback | None = None) -> Iterator[Result]:
    """Yield the forecast of a job's case; its particles can be read until the context closes."""
    many = _number_of_shards(job)
    with contextlib.ExitStack() as stack:
        if many > 1 or job.client is not None:
            ended = (
                _simulate_spill_in_shards(job, many, stack)
                if job.case.spill
                else _simulate_in_shards(job, many, stack, noted)
            )
        else:
            with job.clock.phase("start"):
                begin = run_setup.prepare(job.case, job.where)
            ended = simulate_run(job, begin, stack, noted)
        yield build_result(job, ended)


def _number_of_shards(job: Job) -> int:
    """Return the number of shards of a run: that of the unfinished run it resumes, if memory
    allows."""
    workers = None if job.client is None else cluster.workers_of(job.client)
    many = divide.number_of_shards(job.case, job.memory, job.shards, workers)
    if many > 1:
        shelf.check_room(job.out, shelf.bytes_of_shards(job.case, job.case.particles))
    if job.shards or job.out is None or not shelf.unfinished(job.out):
        return many
    before = (
        shelf.stored_shard_count(job.out, fingerprint.fingerprint_of(job.case, job.where, many))
        or many
    )
    return before if job.memory is None else max(before, many)


def _simulate_in_shards(
    job: Job, many: int, stack: contextlib.ExitStack, noted: UpdateCallback | None
) -> FinishedRun:
    """Simulate a run in shards; its particles can be read until the stack closes."""
    with job.clock.phase("start"):
        mark = fingerprint.fingerprint_of(job.case, job.where, many)
        if job.client is not None:
            stack.callback(cluster.release, job.client)
        deal = (
            None
            if job.client is None
            else partial(cluster.check_shard_starts, job.client, job.case, job.opened, mark)
        )
        divided = divide.prepare(job.case, job.where, many, deal)
    stack.enter_context(contextlib.closing(divided.setup.scene.forcing))
    with job.clock.phase("drift"):
        done = stack.enter_context(shards_run.move_shards(job, divided, mark, noted))
    return FinishedRun(
        divided.setup, done.snapshots, done.updates, done.posteriors, begun=done.begun
    )


def _simulate_spill_in_shards(job: Job, many: int, stack: contextlib.ExitStack) -> FinishedRun:
    """Simulate a spill in shards and weight its worlds by the finds."""
    case, where = job.case, job.where
    with job.clock.phase("start"):
        run = spilled.prepare(case, where, many)
        stack.enter_context(contextlib.closing(run.setup.scene.forcing))
        stretches = run_setup.stretches(case, where, run.worlds)
    if job.client is not None:
        stack.callback(cluster.release, job.client)
    rounds = stack.enter_context(spilled.open_rounds(job, run))

    def moved(drawn: Worlds, seed: int, number: int) -> DriftedRun:
        with job.clock.phase("drift"):
            drifted = rounds.moved(drawn, seed, number)
        stack.enter_context(drifted.snapshots)
        return drifted

    def renewed(proposal: Proposal, number: int) -> DriftedRun:
        buoys = run.setup.scene.buoys
        return moved(*run_setup.renewed(case, where, proposal, number, buoys), number)

    done, after = _weight_by_finds(job, stretches, moved(run.worlds, case.seed, 0), renewed)
    return FinishedRun(run.setup, done.snapshots, after=after)


def _weight_by_finds(
    job: Job,
    stretches: Segments | None,
    first: DriftedRun,
    renewed: Callable[[Proposal, int], DriftedRun],
) -> tuple[DriftedRun, SpillResult]:
    """Return the run and posterior of a spill after iterated importance sampling by its finds.

    `renewed` simulates a new set of worlds; see `drift.spills.worlds.renewal.iterate_importance_sampling`.
    """
    case, coast = job.case, job.where.coast
    assert case.spill is not None
    assert coast is not None
    assert stretches is not None
    with job.clock.phase("finds"):
        return renewal.iterate_importance_sampling(
            case.period, case.spill, coast, stretches, first, renewed
        )


def simulate_run(
    job: Job, begin: Start, stack: contextlib.ExitStack, noted: UpdateCallback | None = None
) -> WholeRun:
    """Simulate a run in one piece.

    Args:
        job: the case, its environment and its options.
        begin: the initial ensemble, scene and clock.
        stack: particles can be read until it closes.
        noted: called after each update by a sortie, contact or sensor.
    """
    case, where = job.case, job.where
    with job.clock.phase("start"):
        stretches = run_setup.stretches(case, where, begin.worlds)
    begun = _initial_status(case, begin.ensemble)
    (done, updates, posteriors), after = _simulate_ensemble(job, begin, stack, noted), None
    if case.spill:

        def renewed(proposal: Proposal, number: int) -> DriftedRun:
            """Draw new worlds of a spill from a proposal and simulate their objects."""
            return _simulate_ensemble(
                job, run_setup.restart_from_proposal(case, where, begin, proposal, number), stack
            )[0]

        done, after = _weight_by_finds(job, stretches, done, renewed)
    return WholeRun(
        begin, done.snapshots, updates, posteriors, after, begun, begin=begin, done=done
    )


def build_result(job: Job, run: FinishedRun) -> Result:
    """Return the forecast, tracks and summary of a simulated run while its particles are
    readable."""
    case, where, setup, snapshots = job.case, job.where, run.setup, run.snapshots
    after, updates, posteriors = run.after, run.updates, run.posteriors
    names = [scenario.name for scenario in case.scenarios]
    job.tell("map", 0.0)
    with job.clock.phase("products"):
        (end,) = survey.survey_outputs(snapshots.outputs[-1:], len(names), snapshots.deal)
        is_land = scene.land_of(setup.scene)
        forecast = forecast_build.build_forecast(
            snapshots.outputs,
            scenarios=names,
            is_land=is_land,
            shares=case.areas,
            grid=case.grid,
            tell=partial(job.tell, "map"),
            deal=snapshots.deal,
        )
        tracks = _sample_tracks(case, where, snapshots)
    summary = run_metadata.summary_of_run(case, where, end, setup, job.clock.seconds)
    member_told = _results_by_member(setup.spec.members, run)
    if member_told is not None:
        summary |= {"members": by_member.summary_of_members(member_told)}
    buoys = setup.scene.buoys
    if buoys is not None and case.drifters:
        with job.clock.phase("drifters"):
            summary["drifters"] = buoy_effect.summary_of_buoys(case, where, buoys)
    if buoys is not None and case.reports:
        with job.clock.phase("reports"):
            summary["reports"] = report_effect.summary_of_reports(case, where, buoys)
    off_map = off_grid.fixed_grid_warnings(forecast.data)
    summary["warnings"] = particles_left.few_particles_warnings(
        forecast.data, case.particles, updates, case.contacts
    )
    summary["warnings"] += off_map
    if after is not None:
        summary |= renewal.summary_of_spill(after)
        # The map's effective sample is the same worlds: if they are few, one warning is enough.
        few = effective.Count(after.posterior.effective, what="worlds").few
        summary["warnings"] = [
            *renewal.spill_warnings(after),
            *([] if few else summary["warnings"]),
        ]
    summary["warnings"] += environment.warnings(where)
    summary["warnings"] += run_metadata.case_warnings(case)
    if "reports" in summary:
        summary["warnings"] += summary["reports"].pop("warnings")
    if updates is not None:
        summary |= {"search": search_tables.summary_of_search(updates)}
    if changes.any_changes(case.scenarios):
        summary["states"] = states.summary_of_states(snapshots, case.scenarios)
    if posteriors is not None:
        summary |= posterior_tables.summary(posteriors)
    on = run_metadata.with_coast(
        run_metadata.map_setting(case, where, dataset.displayed_scenarios(forecast.data))
    )
    flown = updates.sorties if updates else ()
    # Keep the sampled field, not the dataset: a dataset passed in by the caller can be freed.
    flows = ambient.over(
        _forcing_of_likeliest(case, where), mapped.box(forecast.data), forecast.data["time"].values
    )
    over = (
        partial(search_chapter.overlay, flown, case.contacts, sensors=case.sensors),
        partial(_overlay_flows, flows),
        *([partial(_overlay_buoys, case.drifters)] if case.drifters else []),
        *([partial(_overlay_reports, case.reports)] if case.reports else []),
    )
    return Result(
        case,
        forecast,
        tracks,
        summary,
        on,
        over,
        after,
        updates,
        run.begun,
        posteriors,
        flows,
        member_told,
    )


def _results_by_member(names: Sequence[str], run: FinishedRun) -> Members | None:
    """Return the results by member of a forcing ensemble; None without an ensemble."""
    if not names:
        return None
    by_world = None
    if run.after is not None and run.after.worlds.member is not None:
        by_world = np.bincount(run.after.worlds.member, run.after.posterior.weight, len(names))
    return by_member.told(names, run.snapshots.outputs[-1], by_world)


def _forcing_of_likeliest(case: Case, where: Environment) -> Sources:
    """Return the winds and currents of the scenario with the highest prior probability."""
    return where.scenarios[
        max(range(len(case.scenarios)), key=lambda number: case.scenarios[number].weight)
    ]


def _overlay_flows(found: Mapping[str, Flow], time: Any) -> Any:
    """Return the map overlay (`drift.products.maps.overlay.Overlay`) of winds and currents."""
    from drift.engine.environment import layers  # imported late: Matplotlib takes a second

    return layers.flows(found, time)


def _overlay_buoys(buoys: Sequence[BuoyTrack], time: Any) -> Any:
    """Return the map overlay of drifting buoys."""
    from drift.engine.environment import layers

    return layers.buoy_tracks(buoys, time)


def _overlay_reports(reports: Sequence[PointReport], time: Any) -> Any:
    """Return the map overlay of winds and currents reported on scene."""
    from drift.engine.environment import layers

    return layers.reports_on_scene(reports, time)


def _initial_status(case: Case, ensemble: Ensemble) -> SearchStatus | None:
    """Return the search status before any sortie or contact; None if the case does not report
    it."""
    if not run_setup.reports_search_status(case):
        return None
    columns = {"log_weight": ensemble.log_weight.to_numpy(), "release": ensemble.release.to_numpy()}
    return account.initial_status(
        run_setup.ensemble_spec(case), Columns.held(ensemble.blocks, columns)
    )


def _simulate_ensemble(
    job: Job, begin: Start, stack: contextlib.ExitStack, noted: UpdateCallback | None = None
) -> tuple[DriftedRun, Updates | None, Posteriors | None]:
    """Simulate an ensemble; return the run, its search updates and its posteriors.

    Closes the forcing. Snapshots of the outputs can be read until the stack closes.
    """
    case = job.case
    outputs = case.period.seconds(case.outputs)
    with job.clock.phase("drift"), contextlib.closing(begin.scene.forcing):
        landings = (
            Landings(begin.ensemble, begin.scene.place.beach.stay > 0) if case.spill else None
        )
        watch = landings.watch if landings and landings.refloats else None
        beliefs = run_setup.beliefs(case, begin)
        search = run_setup.build_search_filter(case, begin, beliefs, noted)
        moments = simulate.run(
            begin.ensemble,
            begin.scene,
            begin.clock,
            outputs,
            partial(job.tell, "drift"),
            watch,
            search,
        )
        spool = SnapshotStore.of_run(
            case.period,
            begin.ensemble,
            moments,
            len(outputs),
            worlds=landings is not None,
            more=landings.note if landings else None,
        )
        snapshots = stack.enter_context(spool)
        run_setup.check_end(
            case, job.where, begin, snapshots, search.unsearched if search else None
        )
    done = DriftedRun(begin.ensemble.seed, snapshots, begin.worlds)
    return done, search.updates if search else None, beliefs.posteriors if beliefs else None


def write_results(
    result: Result, job: Job, *, more: Sequence[OutputBundle] = (), planned: Planned | None = None
) -> None:
    """Write all output files of a forecast to the job's folder, if it has one: all files or none.

    Args:
        result: the forecast.
        job: its job.
        more: bundles of outputs derived from the forecast, such as a plan.
        planned: sorties still to be flown, if this forecast assumes that they find nothing.
    """
    if job.out is not None:
        with job.clock.phase("write"):
            _write(
                result,
                job.out,
                overwrite=job.overwrite,
                report=job.tell,
                more=more,
                planned=planned,
            )


def _save(result: Result, out: Path, overwrite: bool) -> None:
    """Write a finished run's results as `run` would have written them to its `out`."""
    writer.check_folder(out, overwrite, (*forecast_chapter.FILES, *forecast_chapter.PICTURES))
    _write(result, out, overwrite=overwrite, report=lambda phase, share: None)


def _write(
    result: Result,
    out: Path,
    *,
    overwrite: bool,
    report: ProgressCallback,
    more: Sequence[OutputBundle] = (),
    planned: Planned | None = None,
) -> None:
    report("write", 0.0)
    case, after, updates = result.case, result.aftermath, result.updates
    failed = on = result.setting
    if planned is not None:
        failed = replace(
            on, imprint=replace(on.imprint, title=f"If this plan finds nothing: {case.title}")
        )
    # A plan's folder also holds a forecast: that of the plan finding nothing.
    # The writer adds run_id itself.
    facts = {name: words for name, words in on.imprint.attributes.items() if name != "run_id"}
    chapters = [
        run_metadata.metadata_bundle(
            case, facts, {COMMAND: "plan" if more else "run", **result.summary}
        )
    ]
    chapters.append(OutputBundle(leaves=(partial(_environment_items, result, on),)))
    if "drifters" in result.summary:
        chapters.append(buoy_effect.buoys_bundle(result.summary["drifters"], case.drifters))
    if "reports" in result.summary:
        chapters.append(report_effect.reports_bundle(result.summary["reports"], case.reports))
    if after is not None:
        chapters.append(spill_chapter.spill_bundle(spill_chapter.SpillOutputs(after, on)))
    if updates is not None:
        # A plan's forecast has no outputs at the times of its sorties: plan.png shows them.
        search_matter = search_chapter.SearchOutputs(
            updates, case.contacts, result.forecast, failed, case.sensors
        )
        chapters.append(search_chapter.search_bundle(search_matter, mapped=planned is None))
    if result.posteriors is not None:
        chapters.append(
            posterior_chapter.posterior_bundle(
                posterior_chapter.PosteriorOutputs(result.posteriors, failed)
            )
        )
    if result.members is not None:
        chapters.append(by_member.chapter(result.members))
    chapters += more
    if basis := suspension_basis(result, planned):
        lost = decision.off_map(result.forecast.data)
        suspend_matter = suspend_chapter.SuspensionOutputs(
            basis, on.imprint, run_metadata.has_synthetic_forcing(case), lost
        )
        chapters.append(suspend_chapter.suspension_bundle(suspend_matter))
    # Small maps omit legs and contacts, which would hide the map; sensor lines are few.
    sensors = (
        [partial(search_chapter.overlay, (), (), sensors=case.sensors)]
        if case.sensors.telling
        else []
    )
    # the forecast of a plan's failure shows the time after the plan
    mapped_at = failed if planned is None else replace(failed, opens=None)
    forecast_matter = forecast_chapter.ForecastOutputs(
        result.forecast, result.trajectories, mapped_at, result.overlays, sensors, failed.opens
    )
    chapters.insert(0, forecast_chapter.forecast_bundle(forecast_matter))
    shown = failed
    if planned is not None:  # the report opens as the plan begins, before it can fail
        shown = replace(failed, imprint=replace(on.imprint, title=f"Plan: {case.title}"))
        chapters.append(OutputBundle(leaves=(_plan_items,)))
    publish_outputs(out, chapters, shown, overwrite=overwrite, tell=partial(report, "write"))


def _plan_items() -> list[Any]:
    """Return the report's remark on the maps after a plan's searches."""
    from drift.products.report import leaves  # imported late: Matplotlib takes a second

    words = "The maps after each planned search assume that it found nothing."
    return [leaves.headline_leaf(words)]


def _environment_items(result: Result, on: Setting) -> list[Any]:
    """Return the report's items on starting positions, itineraries, winds and currents."""
    # imported late: Matplotlib takes a second
    from drift.engine.environment import report as environment_report
    from drift.products.report import leaves

    begun = (
        [leaves.marks_leaf("Where it began", on.marks, on.lines, "start")]
        if on.marks or on.lines
        else []
    )
    ways, flows = (
        environment_report.itineraries(result.case.scenarios),
        environment_report.flows(result.flows),
    )
    return [*begun, *ways, *flows]


def publish_outputs(
    out: Path,
    chapters: Sequence[OutputBundle],
    on: Setting,
    *,
    overwrite: bool,
    tell: Callable[[float], None],
) -> None:
    """Write output bundles and their report; a picture that fails is left out with a warning.

    Args:
        out: the folder of the results.
        chapters: the output bundles.
        on: title, attribution and marks of every map.
        overwrite: whether existing results are replaced.
        tell: called with the share of the files written, 0 to 1.
    """
    from drift.products.maps import page  # imported late: Matplotlib takes a second
    from drift.products.report import page as report_page

    joined = join_contents(chapters)
    pictures = {name: page.warn_on_failure(draw) for name, draw in joined.pictures.items()}

    @cache
    def report_items() -> list[Any]:
        return [leaf for leaves in joined.leaves for leaf in leaves()]

    def write_report(path: Path) -> None:
        report_page.write(path, report_items(), on, joined.warnings)

    def prepare_report() -> None:
        # what fails here fails again as the report is written, and is a warning then
        with contextlib.suppress(*page.FAILURES), page.literal_text():
            report_items()

    drawn = replace(joined, pictures=pictures, digests={REPORT: page.warn_on_failure(write_report)})
    writer.write(
        out,
        [drawn],
        overwrite=overwrite,
        processes=runtime.threads(),
        tell=tell,
        meanwhile=prepare_report,
    )


def suspension_basis(result: Result, planned: Planned | None = None) -> decision.Suspension | None:
    """Return the basis for a decision to suspend the search; `planned` are sorties not yet flown.

    None without sorties and survival times, and for a backward run.
    """
    case, begun = result.case, result.begun
    if begun is None or case.direction < 0:
        return None
    return decision.build_decision(
        case.scenarios, case.start, begun, result.updates, result.forecast.data, planned
    )


@serialized
def origin(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    **options: Unpack[JobOptions],
) -> backward.Origin:
    """Run a spill backward from its finds, to the probable place and time of its release.

    The result is a rough backtrack: confirm it with a forward run weighted by the finds.

    Args:
        case: with a `[spill]` and at least one `[[find]]`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Returns:
        The distribution of the release: its map, time and mean position, and the information that
            the finds give on it [bit].

    Raises:
        UserError: a mistake in the input, one line for each (`error.lines`): the case has no spill,
            or no find can have come from the domain of the run.
    """
    if case.spill is None:
        raise UserError(
            f"{case.path.name}: has no [spill]; an origin is estimated from the [[find]]s of a spill"
        )
    job = open_job(case, Options(out, **options))
    where = job.where
    assert where.coast is not None
    with job.clock.phase("read"):
        segments = evidence.cut_stretches(case.spill, where.coast)
        places = [
            evidence.stretch_of_find(find, segments, where.coast) for find in case.spill.finds
        ]
    with job.clock.phase("drift"):
        spec, cut = run_setup.ensemble_spec(case), run_setup.clock_spec(case)
        release = backward.estimate_origin(
            case.spill, spec, cut, where, segments, places, progress=partial(job.tell, "drift")
        )
    if job.out is not None:
        matter = backtrack_chapter.OriginOutputs(
            release, case.spill.finds, run_metadata.map_setting(case, where)
        )
        run = OutputBundle(
            facts=run_metadata.file_attributes(case, where),
            warnings=tuple(run_metadata.case_warnings(case)),
        )
        end = OutputBundle(
            {"wall_time_s": job.clock.seconds},
            leaves=(lambda: [run_metadata.case_text_item(case)],),
        )
        chapters = [run, backtrack_chapter.origin_bundle(matter), end]
        publish_outputs(
            job.out,
            chapters,
            matter.setting,
            overwrite=job.overwrite,
            tell=partial(job.tell, "write"),
        )
    return release


trace = origin  # its former name


def _sample_tracks(case: Case, where: Environment, snapshots: SnapshotStore) -> Trajectories:
    """Return the tracks of a subsample of particles, evenly spaced by index.

    Before it was resampled, a particle has the track of its ancestors.
    """
    living: Array | None = None
    if case.resampling.below > 0:  # spare slots have no weight and no track
        living = np.concatenate(
            [part.blocks.places[part.probability > 0] for part in snapshots.outputs[-1].parts()]
        )
    many = snapshots.n if living is None else living.size
    slot = np.unique(np.linspace(0, many - 1, min(case.trajectories, snapshots.n)).astype(int))
    slot = slot if living is None else living[slot]
    way = snapshots.follow(slot)
    release, since, edge = snapshots.at_end(("release", "status_since", "edge"), slot)
    over = life.has_stopped(way["status"][:, -1])
    ended, edge = np.where(over, since, -1), np.where(over, edge, -1)
    times = np.array([snapshots.time(k) for k in range(len(snapshots))])
    at = way["lon"], way["lat"], way["status"], way["probability"]
    scenario = way["scenario"][:, -1]
    scalars = ambient.scalars_along(where.scenarios, times, scenario, way["lon"], way["lat"])
    return Trajectories(times, slot, scenario, *at, release, ended, edge, scalars)
