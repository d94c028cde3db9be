"""Plan the next patrols of a spill and write them with its forecast."""

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
    """Plan the next patrols of a spill.

    With `out`, the plan is written together with the spill's forecast.

    Args:
        case: of `drift.load` or `drift.vary`.
        out: a folder for the results, written completely or not at all; None: nothing is written.
        **options: as in `drift.run`.

    Returns:
        The plan and the spill's forecast. The plan has stretches by team and day, and the expected
            number of objects found with a bound.

    Raises:
        UserError: the case has no `[spill]` or `[[patrol_unit]]`, or `drift.run` rejects it; one
            line for each mistake (`error.lines`).
    """
    if case.spill is None or not case.spill.teams:
        raise UserError(
            f"{case.path.name}: has no [[patrol_unit]] to plan with: "
            "add one with length a day, detection and first patrol for each team"
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
    # check the case before the drift, which takes long
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
