"""What a plan of towed arrays hands out: its text, [[sortie]] tables for the case, its figures and its picture."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from drift.arrays import placement_text
from drift.forecast.build import Forecast
from drift.maps.imprint import Setting
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.report import leaves
from drift.report.leaves import Leaf
from drift.search.updates import Updates


@dataclass(frozen=True)
class Matter:
    """What the files and the picture are made from."""

    plan: Any  # a drift.arrays.planner.ArrayPlan
    forecast: Forecast  # of its hearing nothing
    updates: Updates | None
    setting: Setting
    taken: Sequence[str]  # names of the sorties that the case has


def _picture(matter: Matter, path: Path) -> None:
    from drift.arrays import layers  # here: Matplotlib takes a second to import
    from drift.search import map as search_map

    assert matter.updates is not None
    own = layers.plan(matter.plan.placement.placed, matter.plan.sorties)
    setting = replace(matter.setting, overlays=(*matter.setting.overlays, lambda time: own))
    sorties = sorted(matter.plan.sorties, key=lambda sortie: (sortie.start, sortie.end))
    search_map.draw(matter.forecast, sorties, (), matter.updates, path, setting, page=1)


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "arrays.txt": lambda matter, stamped: placement_text.text(
        matter.plan, matter.setting.imprint.title, stamped["run_id"]
    ),
    "arrays.toml": lambda matter, stamped: placement_text.toml(matter.plan, matter.taken),
    "arrays.json": lambda matter, stamped: {"run_id": stamped["run_id"], **placement_text.numbers(matter.plan)},
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "arrays.png": _picture,
}


def chapter(matter: Matter) -> Chapter:
    """Return the chapter of a plan of towed arrays."""
    return Chapter(
        {"arrays": placement_text.numbers(matter.plan)}, bound(FILES, matter), bound(PICTURES, matter),
        leaves=(partial(_leaves, matter),),
    )  # fmt: skip


def _leaves(matter: Matter) -> list[Leaf]:
    return [leaves.text("Towed arrays", file="arrays.txt")]
