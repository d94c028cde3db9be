"""What is handed out of posteriors: a table, numbers of the summary, and a picture.

It is a chapter of its own, neither the forecast's nor the search's: a run in which targets steer has priors to tell
before anything was searched, and a forecast knows of no updates.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drift.maps.imprint import Setting
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.posterior import tables
from drift.posterior.records import Posteriors
from drift.report import leaves


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    posteriors: Posteriors
    setting: Setting


def _draw(matter: Matter, path: Path) -> None:
    from drift.posterior import map as posterior_map  # imported here, for Matplotlib takes a second

    posterior_map.draw(matter.posteriors, path, matter.setting)


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "posteriors.csv": lambda matter, stamped: tables.csv(matter.posteriors, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "posteriors.png": _draw,
}


def chapter(matter: Matter) -> Chapter:
    """Return the chapter of posteriors."""
    numbers = {"posteriors": tables.numbers(matter.posteriors)}
    return Chapter(numbers, bound(FILES, matter), bound(PICTURES, matter), leaves=(_leaves,))


def _leaves() -> list[Any]:
    columns = [
        ("time", "Time", "time"), ("name", "After", "words"), ("quantity", "Quantity", "words"), ("unit", "Unit", "words"),
        ("value", "Value", "words"), ("share", "Share", "share"), ("mean", "Mean", "words"), ("std", "Standard deviation", "words"),
        ("q05", "5 %", "words"), ("q50", "Median", "words"), ("q95", "95 %", "words"),
    ]  # fmt: skip
    note = "Of all stories together; posteriors.csv has those of each."
    return [
        leaves.table(
            "What is believed besides places", columns, file="posteriors.csv", where={"scenario": "all"}, note=note
        )
    ]
