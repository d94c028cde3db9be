"""What-if comparison: run two cases on common random numbers, and report how they differ.

Both runs have the same slots, seed, step, grid and output times, so a difference comes from the
cases and hardly from chance. Each difference has a standard error for the chance that is left
(drift.assess.compare.units).
"""

import contextlib
import math
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np

from drift.assess.compare import chapter, dataset, detection, figures, pairing, units, washup
from drift.assess.compare.figures import Figures
from drift.assess.compare.maps import Maps, paired_maps
from drift.assess.compare.record import Contrast
from drift.assess.compare.units import Difference, SamplingUnits
from drift.case.record import Case
from drift.engine.motion import scene
from drift.engine.particles.snapshot import Snapshot
from drift.forecast import build as forecast_build
from drift.forecast.build import Forecast
from drift.pipeline import flow, run_setup
from drift.pipeline.flow import WholeRun
from drift.pipeline.result import Result
from drift.pipeline.run_options import (
    Job,
    JobOptions,
    Options,
    ProgressCallback,
    open_job,
    serialized,
)
from drift.pipeline.run_setup import Start
from drift.planning.search import planner
from drift.planning.search.records import Plan
from drift.products.files import writer
from geo.array import Array
from geo.cells import Cells


@serialized
def compare(
    a: Case,
    b: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    plan: bool = False,
    **options: Unpack[JobOptions],
) -> Contrast:
    """Run two cases on common random numbers and return how B differs from A.

    B takes the particles of each scenario, the seed and the grid of A. If A has no grid, one that
    holds both clouds is chosen. With `out`, write the results into that folder too.

    Args:
        a: case A, from `drift.load` or `drift.vary`.
        b: case B, likewise.
        out: folder for the results, written completely or not at all; None: nothing is written.
        plan: whether to plan the next search of each case as well, and compare the plans.
        **options: as in `drift.run`.

    Returns:
        Both results, and `differences`: a pandas.DataFrame of each figure of A, of B, their
        difference and its standard error (sampling only), in the row's `unit` (SI), by time; `data`
        has the maps.

    Raises:
        UserError: the cases cannot run on the same particles, or `drift.run` rejects one; one line
            for each mistake (`error.lines`).
    """
    shared_options = Options(out, **options)
    if out is not None:
        writer.check_folder(
            Path(out), shared_options.overwrite, (*chapter.FILES, *chapter.PICTURES)
        )
    case_a, case_b = pairing.pair_cases(a, b)
    for case in (case_a, case_b) if plan else ():
        planner.check(case)

    def job_of(case: Case, name: str) -> Job:
        named = {spec.dataset for spec in case.sources}
        own = {key: data for key, data in (shared_options.datasets or {}).items() if key in named}
        return open_job(
            case,
            replace(
                shared_options,
                out=None,
                datasets=own,
                report=_named_report(shared_options.report, name),
            ),
        )

    job_a, job_b = job_of(case_a, "A"), job_of(case_b, "B")
    start_a, start_b, notes = _prepare_both(job_a, job_b)
    sampling_units = (
        units.units_of_worlds(a.spill.worlds)
        if a.spill
        else units.units_of_particles(start_a.ensemble)
    )
    logs = detection.SortieLog(sampling_units), detection.SortieLog(sampling_units)
    with contextlib.ExitStack() as stack:
        run_a = flow.simulate_run(job_a, start_a, stack, logs[0].note)
        run_b = flow.simulate_run(job_b, start_b, stack, logs[1].note)
        times = pairing.common_output_times(case_a, case_b)
        grid = a.grid or forecast_build.grid_of(
            [*_snapshots_at(run_a, times), *_snapshots_at(run_b, times)], len(case_a.scenarios)
        )
        result_a, result_b = (
            flow.build_result(replace(job, case=replace(job.case, grid=grid)), run)
            for job, run in ((job_a, run_a), (job_b, run_b))
        )
        job_a.tell("compare", 0.0)
        rows, pictures = _differences_by_time(
            run_a, run_b, result_a, result_b, times, grid, sampling_units
        )
        rows += _differences_of_run(run_a, run_b, logs, sampling_units)
    plans = None
    if plan:
        plans, more = _plan_both(job_a, job_b, start_a.clock.step, sampling_units)
        rows += more
    data = dataset.build_comparison(times, grid, pictures, rows)
    found = Contrast(
        result_a, result_b, tuple(times), tuple(rows), data, start_a.clock.step, plans, tuple(notes)
    )
    if out is not None:
        job_a.tell("write", 0.0)
        chapters = chapter.comparison_bundles(found, (job_a, job_b))
        setting, tell = chapter.setting(found, (job_a, job_b)), partial(job_a.tell, "write")
        flow.publish_outputs(
            Path(out), chapters, setting, overwrite=shared_options.overwrite, tell=tell
        )
    return found


def _plan_both(
    job_a: Job, job_b: Job, step: int, sampling_units: SamplingUnits
) -> tuple[tuple[Plan, Plan], list[Difference]]:
    """Plan the next search of both cases, and return the plans and the differences of their POS.

    step: time step of both [s]. Each plan is made on particles of its own, and executed on the
    paired particles of its case.
    """

    def plan_of(job: Job) -> tuple[Plan, Figures]:
        log = detection.SortieLog(sampling_units)
        found, _, _ = planner.scheme(replace(job, case=replace(job.case, step=step)), log.note)
        return found, detection.pos_of_plan(log, found)

    (plan_a, a), (plan_b, b) = plan_of(job_a), plan_of(job_b)
    return (plan_a, plan_b), units.differences(job_a.case.plan.until, a, b, sampling_units)


def _named_report(report: ProgressCallback | None, name: str) -> ProgressCallback | None:
    """Return a progress callback that adds the case's name to the phase."""
    return report and (lambda phase, share: report(f"{name}: {phase}", share))


def _prepare_both(job_a: Job, job_b: Job) -> tuple[Start, Start, list[str]]:
    """Return the starts of two runs with a common step, and notes on noise that is not common.

    The step divides the steps of both cases.
    """
    starts: list[Start] = []
    try:
        for job in (job_a, job_b):
            with job.clock.phase("start"):
                starts.append(run_setup.prepare(job.case, job.where))
    except BaseException:
        for start in starts:
            start.scene.forcing.close()
        raise
    # the greatest common divisor, so that steps of both still end at the times of their files
    step = math.gcd(*(start.clock.step for start in starts))
    breaks = tuple(sorted({time for start in starts for time in start.clock.breaks}))
    straight = min(start.clock.straight for start in starts)
    a, b = (
        replace(
            start,
            clock=replace(
                start.clock,
                step=step,
                phase=start.clock.phase % step,
                breaks=breaks,
                straight=straight,
            ),
        )
        for start in starts
    )
    notes = []
    if a.clock.phase != b.clock.phase:
        notes.append(
            "the forcing files of the two cases have different times, so their steps differ: the "
            "errors of wind and current are not common to both, and standard errors are larger"
        )
    return a, b, notes


def _snapshots_at(run: WholeRun, times: list[np.datetime64]) -> list[Snapshot]:
    """Return the snapshots of a run at some of its output times."""
    spool = run.snapshots
    return [spool[k] for k in range(len(spool)) if spool.time(k) in times]


def _differences_by_time(
    run_a: WholeRun,
    run_b: WholeRun,
    a: Result,
    b: Result,
    times: list[np.datetime64],
    grid: Cells,
    sampling_units: SamplingUnits,
) -> tuple[list[Difference], list[Maps]]:
    """Return the differences of figures, and the maps, at each output that both runs have."""
    rows: list[Difference] = []
    pictures: list[Maps] = []
    land = _land_mask(run_a, grid)
    # The shares of a spill's classes are fixed, so they are no figures.
    names = () if a.case.spill else tuple(scenario.name for scenario in a.case.scenarios)
    for time in times:
        at_a, at_b = _output_at(run_a, a, time), _output_at(run_b, b, time)
        at_time = a.forecast.data.isel(time=at_a.place)
        origin = float(at_time["mean_lon"]), float(at_time["mean_lat"])
        figures_a, figures_b = (
            figures.status_shares(at.snapshot, names, sampling_units)
            | figures.mean_position(at.snapshot, sampling_units, origin)
            | figures.area_figures(at.snapshot, at.forecast, at.place, sampling_units)
            for at in (at_a, at_b)
        )
        rows += units.differences(time, figures_a, figures_b, sampling_units, figures.SHIFT)
        kernels = [
            float(at.forecast.data["particles_per_kernel"].values[at.place]) for at in (at_a, at_b)
        ]
        width = float(np.nanmean(kernels)) if np.isfinite(kernels).any() else 1.0
        pictures.append(
            paired_maps(at_a.snapshot, at_b.snapshot, sampling_units, grid, land, width)
        )
    return rows, pictures


class _Output(NamedTuple):
    """One output of a run: its particles, its forecast and its index."""

    snapshot: Snapshot
    forecast: Forecast
    place: int  # index among the outputs of the run


def _output_at(run: WholeRun, result: Result, time: np.datetime64) -> _Output:
    spool = run.snapshots
    place = next(k for k in range(len(spool)) if spool.time(k) == time)
    return _Output(spool[place], result.forecast, place)


def _land_mask(run: WholeRun, grid: Cells) -> Array | None:
    """Return which cells are land, bool (nlat, nlon); None if none is."""
    is_land: Callable[[Array, Array], Array] | None = scene.land_of(run.begin.scene)
    if is_land is None:
        return None
    lon, lat = grid.centres()
    land = np.asarray(is_land(lon.ravel(), lat.ravel()), bool).reshape(grid.shape)
    return land if land.any() else None


def _differences_of_run(
    run_a: WholeRun,
    run_b: WholeRun,
    logs: tuple[detection.SortieLog, detection.SortieLog],
    sampling_units: SamplingUnits,
) -> list[Difference]:
    """Return the differences of figures of the whole run: POS of sorties, or objects ashore."""
    end = run_a.snapshots.time(len(run_a.snapshots) - 1)
    if run_a.after and run_b.after:
        a = washup.washup_figures(run_a.after, run_a.done.seed)
        b = washup.washup_figures(run_b.after, run_b.done.seed)
        both = (
            washup.with_missing_as_zero(a, b, sampling_units.size),
            washup.with_missing_as_zero(b, a, sampling_units.size),
        )
        rows = units.differences(end, both[0], both[1], sampling_units)
        return [rows[0], *sorted(rows[1:], key=lambda row: -abs(row.difference))] if rows else rows
    names = tuple(name for name in logs[0].found if name in logs[1].found)
    return units.differences(end, logs[0].figures(names), logs[1].figures(names), sampling_units)
