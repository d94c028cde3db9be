"""Output files of a patrol plan: schedule, table, [[patrol]] tables and a map."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from drift.planning.patrols import files as patrol_files
from drift.planning.patrols import planner as patrol_planner
from drift.planning.patrols import report
from drift.planning.patrols.planner import PatrolPlan
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting
from drift.spills.worlds import renewal
from drift.spills.worlds.products import chapter as spill_chapter
from drift.spills.worlds.renewal import SpillResult


@dataclass(frozen=True)
class PatrolOutputs:
    """What the output files and the map of a patrol plan are made from."""

    plan: PatrolPlan
    after: SpillResult
    setting: Setting
    synthetic: bool  # winds or currents are made up


def _picture(matter: PatrolOutputs, path: Path) -> None:
    # here: Matplotlib takes a second to import
    """Draw patrols.png."""
    from drift.spills.worlds.products import map as washup_map

    after, setting = matter.after, matter.setting
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


FILES: dict[str, Callable[[PatrolOutputs, Stamped], Contents]] = {
    "patrols.txt": lambda matter, stamped: patrol_files.patrol_text(
        matter.plan, matter.after, matter.setting.imprint.title, stamped["run_id"], matter.synthetic
    ),
    "patrols.csv": lambda matter, stamped: patrol_files.csv(
        matter.plan, matter.after, stamped["run_id"]
    ),
    "patrols.geojson": lambda matter, stamped: patrol_files.lines(
        matter.plan, matter.after, stamped
    ),
    "patrols.toml": lambda matter, stamped: patrol_files.toml(matter.plan, matter.after),
}
# written only if a stretch is longer than a team's daily length
LEFT_OUT_FILES: dict[str, Callable[[PatrolOutputs, Stamped], Contents]] = {
    "patrols_left_out.csv": lambda matter, stamped: patrol_files.left_out(
        matter.plan, matter.after, stamped["run_id"]
    ),
}
PICTURES: dict[str, Callable[[PatrolOutputs, Path], None]] = {
    "patrols.png": _picture,
}


def chapter(matter: PatrolOutputs) -> OutputBundle:
    """Return the output files of a patrol plan."""
    numbers = {"patrol_plan": patrol_files.summary_of_patrols(matter.plan)}
    files = bind_outputs(FILES, matter) | (
        bind_outputs(LEFT_OUT_FILES, matter) if matter.plan.left_out else {}
    )
    warnings = (*matter.plan.notes, *patrol_files.too_long(matter.plan, matter.after))
    leaves = (partial(report.patrol_leaves, matter.plan),)
    return OutputBundle(
        numbers, files, bind_outputs(PICTURES, matter), warnings=warnings, leaves=leaves
    )
