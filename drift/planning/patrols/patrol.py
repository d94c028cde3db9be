"""The next patrols of a spill: planned on its forecast, and written with it."""

import os
from typing import Unpack

from drift.case.record import Case
from drift.engine.environment import coastline
from drift.pipeline import flow, run_metadata
from drift.pipeline.result import Result
from drift.pipeline.run_options import RunOptions, serialized
from drift.pipeline.shards import shelf
from drift.planning.patrols import access, chapter
from drift.planning.patrols import planner as patrol_planner
from drift.planning.patrols.planner import PatrolPlan
from drift.spills.worlds import evidence
from geo.coast import shore
from geo.errors import UserError


@serialized
def patrol(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    **options: Unpack[RunOptions],
) -> tuple[PatrolPlan, Result]:
    """Plan the next patrols of a spill; with `out`, write them and the forecast, complete or not at
    all.

    Args:
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Returns:
        The plan and the forecast: stretches by team and day, expected number of objects found with
            a bound; the `drift.Result` of the
        spill.

    Raises:
        UserError: what a user can change, one line for each mistake (`error.lines`): the case has
            no `[spill]` or `[[patrol_unit]]`, or what `drift.run` rejects.
    """
    if case.spill is None or not case.spill.teams:
        raise UserError(
            f"{case.path.name}: has no [[patrol_unit]] to plan with: "
            "give each its length a day, detection and first patrol"
        )
    job = flow.open_run(case, out, options)
    assert job.where.coast is not None
    segments = evidence.cut_stretches(case.spill, job.where.coast)
    asked = case.coast
    walkable = access.of_teams(
        case.spill.teams,
        segments,
        coastline.land_reader(job.where.coast, asked),
        lambda: shore.read_whole_land(asked.source, asked.lakes),
    )
    # before the drift, because it may reject the case
    patrol_planner.patrols(case.period, segments, walkable)
    with flow.open_result(job) as result:
        after = result.aftermath
        assert after is not None
        job.tell("plan", 0.0)
        with job.clock.phase("plan"):
            plan = patrol_planner.plan(after, walkable)
        if job.out is not None:
            setting = run_metadata.with_coast(run_metadata.map_setting(case, job.where))
            patrols = chapter.chapter(
                chapter.PatrolOutputs(
                    plan, after, setting, run_metadata.has_synthetic_forcing(case)
                )
            )
            flow.write_results(result, job, more=[patrols])
    if job.out is not None:
        shelf.clear(job.out)
    return plan, result
