"""What a plan of patrols hands out: the schedule, a table, [[patrol]] tables for the case, and its picture."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from drift.maps.imprint import Setting
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.patrols import files as patrol_files
from drift.patrols import planner as patrol_planner
from drift.patrols.planner import PatrolPlan
from drift.spill import chapter as spill_chapter
from drift.spill import renewal
from drift.spill.renewal import Aftermath


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    plan: PatrolPlan
    after: Aftermath
    setting: Setting
    synthetic: bool  # winds or currents are made up


def _patrols(one: Matter, path: Path) -> None:
    from drift.spill import map as washup_map  # here: Matplotlib takes a second to import

    after, on = one.after, one.setting
    planned = [
        washup_map.Patrolled(slot.team.name, slot.when, slot.team.detection, [visit.segment for visit in visits])
        for slot, visits in patrol_planner.by_patrol(one.plan)
    ]
    setting = replace(on, imprint=replace(on.imprint, title=f"Planned patrols: {on.imprint.title}"))
    washup_map.draw(
        after.washup, after.segments, path, setting, finds=spill_chapter.finds(after),
        patrols=washup_map.Patrols(planned, "planned patrol", near=True), warning=renewal.warning(after),
    )  # fmt: skip


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "patrols.txt": lambda one, stamped: patrol_files.text(
        one.plan, one.after, one.setting.imprint.title, stamped["run_id"], one.synthetic
    ),
    "patrols.csv": lambda one, stamped: patrol_files.csv(one.plan, one.after, stamped["run_id"]),
    "patrols.toml": lambda one, stamped: patrol_files.toml(one.plan, one.after),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "patrols.png": _patrols,
}


def chapter(one: Matter) -> Chapter:
    """Return the chapter of a plan of patrols."""
    return Chapter({"patrol_plan": patrol_files.numbers(one.plan)}, bound(FILES, one), bound(PICTURES, one))
