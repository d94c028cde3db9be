"""Output files of a patrol plan: schedule, table, [[patrol]] tables and a map."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from drift.planning.patrols import files as patrol_files
from drift.planning.patrols import planner as patrol_planner
from drift.planning.patrols import report
from drift.planning.plans import PlanOutputs
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.spills.worlds import renewal
from drift.spills.worlds.products import chapter as spill_chapter
from drift.spills.worlds.renewal import SpillResult


def _after(matter: PlanOutputs) -> SpillResult:
    """Return the spill's result."""
    assert matter.result.aftermath is not None
    return matter.result.aftermath


def _picture(matter: PlanOutputs, path: Path) -> None:
    # here: Matplotlib takes a second to import
    """Draw patrols.png."""
    from drift.spills.worlds.products import map as washup_map

    after, setting = _after(matter), matter.setting
    planned = [
        washup_map.Patrolled(
            slot.team.name, slot.when, slot.team.detection, [visit.segment for visit in visits]
        )
        for slot, visits in patrol_planner.by_patrol(matter.plan)
    ]
    imprint = replace(setting.imprint, title=f"Planned patrols: {setting.imprint.title}")
    warnings = [
        *renewal.spill_warnings(after),
        *matter.plan.notes,
        *patrol_files.too_long(matter.plan, after, most=0),
    ]
    washup_map.plot_washup(
        after.washup,
        after.segments,
        path,
        replace(setting, imprint=imprint),
        finds=spill_chapter.find_marks(after),
        patrols=washup_map.Patrols(planned, "planned patrol", near=True),
        warning="; ".join(warnings),
    )


FILES: dict[str, Callable[[PlanOutputs, Stamped], Contents]] = {
    "patrols.txt": lambda matter, stamped: patrol_files.patrol_text(
        matter.plan,
        _after(matter),
        matter.setting.imprint.title,
        stamped["run_id"],
        matter.synthetic,
    ),
    "patrols.csv": lambda matter, stamped: patrol_files.csv(
        matter.plan, _after(matter), stamped["run_id"]
    ),
    "patrols.geojson": lambda matter, stamped: patrol_files.lines(
        matter.plan, _after(matter), stamped
    ),
    "patrols.toml": lambda matter, stamped: patrol_files.toml(matter.plan, _after(matter)),
}
# written only if a stretch is longer than a team's daily length
LEFT_OUT_FILES: dict[str, Callable[[PlanOutputs, Stamped], Contents]] = {
    "patrols_left_out.csv": lambda matter, stamped: patrol_files.left_out(
        matter.plan, _after(matter), stamped["run_id"]
    ),
}
PICTURES: dict[str, Callable[[PlanOutputs, Path], None]] = {
    "patrols.png": _picture,
}


def chapter(matter: PlanOutputs) -> OutputBundle:
    """Return the output files of a patrol plan."""
    numbers = {"patrol_plan": patrol_files.summary_of_patrols(matter.plan)}
    files = bind_outputs(FILES, matter) | (
        bind_outputs(LEFT_OUT_FILES, matter) if matter.plan.left_out else {}
    )
    warnings = (*matter.plan.notes, *patrol_files.too_long(matter.plan, _after(matter)))
    leaves = (partial(report.patrol_leaves, matter.plan),)
    return OutputBundle(
        numbers, files, bind_outputs(PICTURES, matter), warnings=warnings, leaves=leaves
    )
