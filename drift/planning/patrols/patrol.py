"""Plan the next patrols of a spill and write them with its forecast."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Unpack

from drift.case.record import Case
from drift.engine.environment import coastline
from drift.pipeline import flow
from drift.pipeline.result import Result
from drift.pipeline.run_options import Job, RunOptions, serialized
from drift.planning import plans
from drift.planning.patrols import access, chapter, files
from drift.planning.patrols import planner as patrol_planner
from drift.planning.patrols.planner import PatrolPlan
from drift.planning.plans import Planner, Proposal
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
    made = plans.propose(PLANNER, case, out, **options)
    return made.plan, made.result


def _check(case: Case) -> None:
    """Raise UserError unless the patrols of a case can be planned."""
    if case.spill is None or not case.spill.teams:
        raise UserError(
            f"{case.path.name}: has no [[patrol_unit]] to plan with: "
            "add one with length a day, detection and first patrol for each team"
        )


@contextmanager
def _propose(job: Job) -> Iterator[Proposal]:
    """Yield the patrols of a job with what is reported of them."""
    case = job.case
    assert case.spill is not None
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
        yield Proposal(
            plan,
            result,
            case,
            facts=files.patrol_facts(plan, after),
            numbers=files.summary_of_patrols(plan),
            texts={"Patrols": "patrols.txt"},
            outputs=[chapter.chapter],
        )


PLANNER = Planner(_check, _propose)
