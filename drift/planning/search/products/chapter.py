"""Output files of a search plan: text, routes, shapes, case tables, a map and unit sheets."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from drift.engine.motion import changes
from drift.planning.plans import PlanOutputs
from drift.planning.search.products import files as plan_files
from drift.planning.search.products import report
from drift.planning.search.products import text as plan_text
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from geo.box import Box

CHANGED = "POS and POD use the sweep widths before any change of state. If the object is harder to see after it (capsized, in the water), both are too high."


def _text(matter: PlanOutputs, stamped: Stamped) -> str:
    """Return plan.txt."""
    plan = matter.plan
    notes = [
        f"{name} is not sent: it cannot search in this period, or would add nothing."
        for name in plan.idle
        if not any(words.startswith(f"{name} is not sent") for words in plan.said)
    ]
    if changes.any_changes(matter.case.scenarios):
        notes.append(CHANGED)
    title, run = matter.setting.imprint.title, stamped["run_id"]
    return plan_text.plan_text(plan, title, run, [*notes, *plan.said], synthetic=matter.synthetic)


def _map(matter: PlanOutputs, path: Path) -> None:
    # here: Matplotlib takes a second to import
    """Draw plan.png."""
    from drift.planning.search.products import map as plan_map

    plan_map.plot_plan(matter.result.forecast, matter.plan, path, matter.setting)


FILES: dict[str, Callable[[PlanOutputs, Stamped], Contents]] = {
    "plan.txt": _text,
    "plan.gpx": lambda matter, stamped: plan_files.gpx(
        matter.plan, matter.setting.imprint.title, stamped["run_id"]
    ),
    "plan.kml": lambda matter, stamped: plan_files.kml(
        matter.plan, matter.setting.imprint.title, stamped["run_id"]
    ),
    "plan.geojson": lambda matter, stamped: plan_files.geojson(matter.plan, stamped),
    "plan.json": lambda matter, stamped: {
        "run_id": stamped["run_id"],
        **plan_files.plan_as_json(matter.plan),
    },
    "plan.toml": lambda matter, stamped: plan_files.toml(
        matter.plan, [sortie.name for sortie in matter.case.sorties]
    ),
}
PICTURES: dict[str, Callable[[PlanOutputs, Path], None]] = {
    "plan.png": _map,
}


def chapter(matter: PlanOutputs, land: Callable[[Box], Any] | None) -> OutputBundle:
    """Return the output files of a search plan.

    land: returns the land polygons in a box [deg]; None: the case has no coast.
    """
    return OutputBundle(
        {},
        bind_outputs(FILES, matter),
        bind_outputs(PICTURES, matter) | _sheets(matter, land),
        leaves=(partial(report.plan_leaves, matter.plan),),
        warnings=tuple(plan_text.rough(matter.plan)),
    )


def _sheets(
    matter: PlanOutputs, land: Callable[[Box], Any] | None
) -> dict[str, Callable[[Path], None]]:
    """Return, by file name, the functions that draw unit sheets (plan-A-1.png and so on)."""
    from drift.planning.search.products import unit_sheet

    draw = partial(unit_sheet.plot_unit_sheet, matter.plan)
    polygons = land(unit_sheet.box(matter.plan)) if land and matter.plan.taskings else ()
    return {
        name: partial(draw, which, imprint=matter.setting.imprint, number=number, polygons=polygons)
        for name, which, number in unit_sheet.pages(matter.plan)
    }
