"""The next patrols of a spill: planned on its forecast, and written with it."""

import os
from collections.abc import Mapping
from typing import Any

from drift.case.record import Case
from drift.engine.environment import coastline
from drift.pipeline import flow, run_metadata
from drift.pipeline.result import Result
from drift.pipeline.run_options import Options, Report, in_turn, open_job
from drift.pipeline.shards import shelf
from drift.planning.patrols import access, chapter
from drift.planning.patrols import planner as patrol_planner
from drift.planning.patrols.planner import PatrolPlan
from drift.spills.worlds import evidence
from geo.coast import shore
from geo.errors import UserError


@in_turn
def patrol(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    overwrite: bool = False,
    report: Report | None = None,
    memory: float | None = None,
    shards: int | None = None,
    client: Any = None,
) -> tuple[PatrolPlan, Result]:
    """Plan the next patrols of a spill; with `out`, write them and the forecast, complete or not at all.

    Args:
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        datasets: the xarray.Datasets that sources of the case with `dataset = "name"` name, by that name; they are only
            read, and not kept.
        threads: threads of the CPU; None, or more than there are: all. No number of them changes a bit of the results.
        backend: where particles move: "cpu", "cuda", "vulkan", "metal", or "auto" for a graphics card where one is worth it.
            A process keeps the backend and the threads that it began with.
        overwrite: whether results that `out` holds are replaced, once the new ones are complete.
        report: is called with what is being done ("read", "drift", "map", "write" ..) and the share of it that is done, 0 to
            1; `drift.progress` makes one. An exception that it raises ends the run.
        memory: memory that the run may take [GiB]; None: half of what is free. A run that needs more is moved in shards.
        shards: into how many parts the particles are cut, moved one after another; None: as the memory asks. No number of
            them changes a bit of the results.
        client: a dask.distributed.Client whose workers move the shards; `out` is to lie where all of them see it.

    Returns:
        The plan and the forecast: stretches by team and day, expected number of objects found with a bound; the `drift.Result` of the
        spill.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`): the case has no `[spill]` or
            `[[patrol_unit]]`, or what `drift.run` rejects.
    """
    if case.spill is None or not case.spill.teams:
        raise UserError(
            f"{case.path.name}: has no [[patrol_unit]] to plan with: "
            "give each its length a day, detection and first patrol"
        )
    job = open_job(
        case,
        Options(out, datasets, threads, shelf.settled(backend, out, client), overwrite, report, memory, shards, client),
    )
    assert job.where.coast is not None
    segments = evidence.cut_stretches(case.spill, job.where.coast)
    asked = case.coast
    walkable = access.of_teams(
        case.spill.teams,
        segments,
        coastline.lands(job.where.coast, asked),
        lambda: shore.whole(asked.source, asked.lakes),
    )
    patrol_planner.patrols(case.period, segments, walkable)  # before the drift, because it may reject the case
    with flow.kept(job) as result:
        after = result.aftermath
        assert after is not None
        job.tell("plan", 0.0)
        with job.clock.phase("plan"):
            plan = patrol_planner.plan(after, walkable)
        if job.out is not None:
            setting = run_metadata.with_coast(run_metadata.setting(case, job.where))
            patrols = chapter.chapter(chapter.PatrolOutputs(plan, after, setting, run_metadata.synthetic(case)))
            flow.write(result, job, more=[patrols])
    if job.out is not None:
        shelf.clear(job.out)
    return plan, result
