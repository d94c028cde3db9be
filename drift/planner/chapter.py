"""What a plan hands out: the search action plan, routes and shapes for plotters, tables for the case, its map, a sheet for each unit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from drift.forecast.build import Forecast
from drift.maps.imprint import Setting
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.planner import files as plan_files
from drift.planner import text as plan_text
from drift.planner.records import Plan
from geo.box import Box


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    plan: Plan
    forecast: Forecast  # of the plan's failure
    setting: Setting
    taken: Sequence[str]  # names of the sorties that the case has
    land: Callable[[Box], Any] | None  # gives its polygons in a box [deg]; None: there is none
    synthetic: bool  # winds or currents are made up


def _text(one: Matter, stamped: Stamped) -> str:
    plan = one.plan
    notes = [
        f"{name} is not sent: it cannot search in this period, or would add nothing."
        for name in plan.idle
        if not any(words.startswith(f"{name} is not sent") for words in plan.said)
    ]
    title, run = one.setting.imprint.title, stamped["run_id"]
    return plan_text.text(plan, title, run, [*notes, *plan.said], synthetic=one.synthetic)


def _map(one: Matter, path: Path) -> None:
    from drift.planner import map as plan_map  # here: Matplotlib takes a second to import

    on = one.setting
    plan_map.draw(
        one.forecast, one.plan, path, on.imprint, polygons=on.polygons, marks=on.marks, particles=on.particles
    )


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "plan.txt": _text,
    "plan.gpx": lambda one, stamped: plan_files.gpx(one.plan, one.setting.imprint.title, stamped["run_id"]),
    "plan.kml": lambda one, stamped: plan_files.kml(one.plan, one.setting.imprint.title, stamped["run_id"]),
    "plan.geojson": lambda one, stamped: plan_files.geojson(one.plan, stamped),
    "plan.json": lambda one, stamped: {"run_id": stamped["run_id"], **plan_files.numbers(one.plan)},
    "plan.toml": lambda one, stamped: plan_files.toml(one.plan, one.taken),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "plan.png": _map,
}


def chapter(one: Matter) -> Chapter:
    """Return the chapter of a plan."""
    return Chapter(
        {}, bound(FILES, one), bound(PICTURES, one) | _sheets(one), warnings=tuple(plan_text.rough(one.plan))
    )


def _sheets(one: Matter) -> dict[str, Callable[[Path], None]]:
    """Return, by name, what draws the sheets of the units, plan-A-1.png and so on."""
    from drift.planner import unit_sheet

    draw = partial(unit_sheet.draw, one.plan)
    polygons = one.land(unit_sheet.box(one.plan)) if one.land and one.plan.taskings else ()
    return {
        name: partial(draw, which, imprint=one.setting.imprint, number=number, polygons=polygons)
        for name, which, number in unit_sheet.pages(one.plan)
    }
