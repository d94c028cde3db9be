"""What-if: two cases run on the same random numbers, and what differs between them.

Both have the same slots, seed, step, grid and output times, so that a difference is of the cases
and hardly of chance; how much of it chance may be is told with each (drift.assess.compare.units).
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
from drift.assess.compare.maps import Maps, maps
from drift.assess.compare.record import Contrast
from drift.assess.compare.units import Difference, Units
from drift.case.record import Case
from drift.engine.motion import scene
from drift.engine.particles.snapshot import Snapshot
from drift.forecast import build as forecast_build
from drift.forecast.build import Forecast
from drift.pipeline import flow, run_setup
from drift.pipeline.flow import Moved
from drift.pipeline.result import Result
from drift.pipeline.run_options import Job, JobOptions, Options, Report, in_turn, open_job
from drift.pipeline.run_setup import Start
from drift.planning.search import planner
from drift.planning.search.records import Plan
from drift.products.files import writer
from geo.array import Array
from geo.cells import Cells


@in_turn
def compare(
    a: Case,
    b: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    plan: bool = False,
    **options: Unpack[JobOptions],
) -> Contrast:
    """Run two cases on the same random numbers and say how b differs from a; with `out`, write that
    there.

    b takes the particles of each scenario, the seed and the grid of a; without a grid one is chosen
    that holds both.

    Args:
        a, b: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        plan: whether the next search of each is planned too, and what the plans find compared.
        **options: as in `drift.run`.

    Returns:
        Both results, and `differences`: a pandas.DataFrame of each figure of a, of b, their
        difference and its standard error by chance alone, in the row's `unit` (SI), by time; `data`
        has the maps.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`): cases that
            cannot be held to the same particles, and what `drift.run` rejects.
    """
    asked = Options(out, **options)
    if out is not None:
        writer.check_folder(Path(out), asked.overwrite, (*chapter.FILES, *chapter.PICTURES))
    case_a, case_b = pairing.paired(a, b)
    for case in (case_a, case_b) if plan else ():
        planner.check(case)

    def job_of(case: Case, name: str) -> Job:
        named = {spec.dataset for spec in case.sources}
        own = {key: data for key, data in (asked.datasets or {}).items() if key in named}
        return open_job(
            case, replace(asked, out=None, datasets=own, report=_of(asked.report, name))
        )

    job_a, job_b = job_of(case_a, "A"), job_of(case_b, "B")
    begin_a, begin_b, notes = _begun(job_a, job_b)
    drawn = units.of_worlds(a.spill.worlds) if a.spill else units.of_particles(begin_a.ensemble)
    logs = detection.Log(drawn), detection.Log(drawn)
    with contextlib.ExitStack() as stack:
        run_a = flow.simulate_run(job_a, begin_a, stack, logs[0].note)
        run_b = flow.simulate_run(job_b, begin_b, stack, logs[1].note)
        times = pairing.common(case_a, case_b)
        grid = a.grid or forecast_build.grid_of(
            [*_at(run_a, times), *_at(run_b, times)], len(case_a.scenarios)
        )
        result_a, result_b = (
            flow.build_result(replace(job, case=replace(job.case, grid=grid)), run)
            for job, run in ((job_a, run_a), (job_b, run_b))
        )
        job_a.tell("compare", 0.0)
        rows, pictures = _by_time(run_a, run_b, result_a, result_b, times, grid, drawn)
        rows += _of_run(run_a, run_b, logs, drawn)
    plans = None
    if plan:
        plans, more = _planned(job_a, job_b, begin_a.clock.step, drawn)
        rows += more
    data = dataset.build_comparison(times, grid, pictures, rows)
    found = Contrast(
        result_a, result_b, tuple(times), tuple(rows), data, begin_a.clock.step, plans, tuple(notes)
    )
    if out is not None:
        job_a.tell("write", 0.0)
        chapters = chapter.chapters(found, (job_a, job_b))
        setting, tell = chapter.setting(found, (job_a, job_b)), partial(job_a.tell, "write")
        flow.publish(Path(out), chapters, setting, overwrite=asked.overwrite, tell=tell)
    return found


def _planned(
    job_a: Job, job_b: Job, step: int, drawn: Units
) -> tuple[tuple[Plan, Plan], list[Difference]]:
    """Return the next search of each of two cases, and the difference of what they find; step [s]
    of both.

    Each is planned on particles of its own and executed on those of its case, which come in pairs.
    """

    def one(job: Job) -> tuple[Plan, Figures]:
        log = detection.Log(drawn)
        found, _, _ = planner.scheme(replace(job, case=replace(job.case, step=step)), log.note)
        return found, detection.of_plan(log, found)

    (plan_a, a), (plan_b, b) = one(job_a), one(job_b)
    return (plan_a, plan_b), units.differences(job_a.case.plan.until, a, b, drawn)


def _of(report: Report | None, name: str) -> Report | None:
    """Return a report that says of which case it tells."""
    return report and (lambda phase, share: report(f"{name}: {phase}", share))


def _begun(job_a: Job, job_b: Job) -> tuple[Start, Start, list[str]]:
    """Return the starts of two runs, in a step that divides both; and why their steps share no
    random numbers.
    """
    begun: list[Start] = []
    try:
        for job in (job_a, job_b):
            with job.clock.phase("start"):
                begun.append(run_setup.prepare(job.case, job.where))
    except BaseException:
        for begin in begun:
            begin.scene.forcing.close()
        raise
    # so that both still end at the times of their files
    step = math.gcd(*(begin.clock.step for begin in begun))
    breaks = tuple(sorted({time for begin in begun for time in begin.clock.breaks}))
    straight = min(begin.clock.straight for begin in begun)
    a, b = (
        replace(
            begin,
            clock=replace(
                begin.clock,
                step=step,
                phase=begin.clock.phase % step,
                breaks=breaks,
                straight=straight,
            ),
        )
        for begin in begun
    )
    notes = []
    if a.clock.phase != b.clock.phase:
        notes.append(
            "steps end at the times of each case's own files, and these differ: errors of wind and current have random "
            "numbers of their own in each case, and standard errors are larger for it"
        )
    return a, b, notes


def _at(run: Moved, times: list[np.datetime64]) -> list[Snapshot]:
    """Return the snapshots of a run at some of its output times."""
    spool = run.snapshots
    return [spool[k] for k in range(len(spool)) if spool.time(k) in times]


def _by_time(
    run_a: Moved,
    run_b: Moved,
    a: Result,
    b: Result,
    times: list[np.datetime64],
    grid: Cells,
    drawn: Units,
) -> tuple[list[Difference], list[Maps]]:
    """Return the differences of figures and of maps at each output of both."""
    rows: list[Difference] = []
    pictures: list[Maps] = []
    land = _land(run_a, grid)
    # The classes of a spill keep their shares, whatever becomes of them.
    names = () if a.case.spill else tuple(scenario.name for scenario in a.case.scenarios)
    for time in times:
        at_a, at_b = _output(run_a, a, time), _output(run_b, b, time)
        own = a.forecast.data.isel(time=at_a.place)
        origin = float(own["mean_lon"]), float(own["mean_lat"])
        told_a, told_b = (
            figures.shares(at.snapshot, names, drawn)
            | figures.position(at.snapshot, drawn, origin)
            | figures.areas(at.snapshot, at.forecast, at.place, drawn)
            for at in (at_a, at_b)
        )
        rows += units.differences(time, told_a, told_b, drawn, figures.SHIFT)
        kernels = [
            float(at.forecast.data["particles_per_kernel"].values[at.place]) for at in (at_a, at_b)
        ]
        width = float(np.nanmean(kernels)) if np.isfinite(kernels).any() else 1.0
        pictures.append(maps(at_a.snapshot, at_b.snapshot, drawn, grid, land, width))
    return rows, pictures


class _Output(NamedTuple):
    """An output of a run: its particles, and its place among those of the forecast."""

    snapshot: Snapshot
    forecast: Forecast
    place: int  # among the outputs of the run


def _output(run: Moved, result: Result, time: np.datetime64) -> _Output:
    spool = run.snapshots
    place = next(k for k in range(len(spool)) if spool.time(k) == time)
    return _Output(spool[place], result.forecast, place)


def _land(run: Moved, grid: Cells) -> Array | None:
    """Return which cells are land, bool (nlat, nlon); None where none is."""
    is_land: Callable[[Array, Array], Array] | None = scene.land_of(run.begin.scene)
    if is_land is None:
        return None
    lon, lat = grid.centres()
    land = np.asarray(is_land(lon.ravel(), lat.ravel()), bool).reshape(grid.shape)
    return land if land.any() else None


def _of_run(
    run_a: Moved, run_b: Moved, logs: tuple[detection.Log, detection.Log], drawn: Units
) -> list[Difference]:
    """Return the differences of figures of the run as a whole."""
    end = run_a.snapshots.time(len(run_a.snapshots) - 1)
    if run_a.after and run_b.after:
        a = washup.figures(run_a.after, run_a.done.seed)
        b = washup.figures(run_b.after, run_b.done.seed)
        both = washup.with_all(a, b, drawn.size), washup.with_all(b, a, drawn.size)
        rows = units.differences(end, both[0], both[1], drawn)
        return [rows[0], *sorted(rows[1:], key=lambda row: -abs(row.difference))] if rows else rows
    names = tuple(name for name in logs[0].found if name in logs[1].found)
    return units.differences(end, logs[0].figures(names), logs[1].figures(names), drawn)
