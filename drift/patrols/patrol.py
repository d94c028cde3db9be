"""The next patrols of a spill: planned on its forecast, and written with it."""

import os
from collections.abc import Mapping
from typing import Any

from drift import facts, flow, turns
from drift.case.file import Case
from drift.flow import Report, Result
from drift.patrols import chapter
from drift.patrols import planner as patrol_planner
from drift.patrols.planner import PatrolPlan
from drift.spill import evidence
from geo.errors import UserError


@turns.in_turn
def patrol(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    *,
    datasets: Mapping[str, Any] | None = None,
    threads: int | None = None,
    backend: str = "cpu",
    overwrite: bool = False,
    report: Report | None = None,
) -> tuple[PatrolPlan, Result]:
    """Plan the next patrols of a spill; with `out`, write them and the forecast, complete or not at all.

    Raises UserError for all that the user can mend.
    """
    tell, out = report or (lambda phase, share: None), flow.folder(out)
    if case.spill is None or not case.spill.teams:
        raise UserError(
            f"{case.path.name}: has no [[patrol_unit]] to plan with: give each its length a day, detection and first patrol"
        )
    where, clock = flow.opened(case, datasets, out, threads, backend, overwrite, tell)
    assert where.coast is not None
    patrol_planner.patrols(
        case, case.spill, evidence.cut(case.spill, where.coast)
    )  # before the drift: it may be refused
    result = flow.forecasted(case, where, clock, tell)
    after = result.aftermath
    assert after is not None
    tell("plan", 0.0)
    with clock.phase("plan"):
        made = patrol_planner.plan(after)
    if out is not None:
        tell("write", 0.0)
        on = facts.with_coast(facts.setting(case, where))
        patrols = chapter.chapter(chapter.Matter(made, after, on, facts.synthetic(case)))
        flow.write(result, where, out, clock, more=[patrols], overwrite=overwrite)
    return made, result
