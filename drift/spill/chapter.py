"""What a spill hands out besides its forecast: the washup by stretch of coast, the account of its objects, and its unknowns."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.maps.imprint import Setting
from drift.maps.marks import Mark
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.spill import renewal, unknowns
from drift.spill import tables as washup_tables
from drift.spill.renewal import Aftermath


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    after: Aftermath
    setting: Setting


def _washup(one: Matter, path: Path) -> None:
    from drift.spill import map as washup_map  # here: Matplotlib takes a second to import

    after, on = one.after, one.setting
    walked = [
        washup_map.Patrolled(told["name"], told["time"], told["detection"], told["segments"])
        for told in renewal.patrols(after.spill, after.segments)
    ]
    washup_map.draw(
        after.washup, after.segments, path, on.imprint, polygons=on.polygons, marks=on.marks, finds=finds(after), patrols=walked,
        warning=renewal.warning(after),
    )  # fmt: skip


def finds(after: Aftermath) -> list[Mark]:
    """Return the finds as marks, each labelled by its number."""
    return [Mark(*renewal.position(after, find), f"{k}") for k, find in enumerate(after.posterior.known.finds, 1)]


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "washup.nc": lambda one, stamped: one.after.washup,
    "washup.csv": lambda one, stamped: washup_tables.stretches(one.after.washup, stamped["run_id"]),
    "washup_times.csv": lambda one, stamped: washup_tables.times(one.after.washup, stamped["run_id"]),
    "totals.csv": lambda one, stamped: washup_tables.totals(one.after.washup, stamped["run_id"]),
    "washup.geojson": lambda one, stamped: washup_tables.geojson(one.after.washup, one.after.segments, stamped),
    "unknowns.csv": lambda one, stamped: unknowns.text(
        renewal.unknown(one.after), one.after.posterior.effective, stamped["run_id"]
    ),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "washup.png": _washup,
}


def chapter(one: Matter) -> Chapter:
    """Return the chapter of a spill."""
    return Chapter(renewal.numbers(one.after), bound(FILES, one), bound(PICTURES, one))
