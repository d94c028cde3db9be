"""What a spill hands out besides its forecast.

That is the washup by stretch of coast, the account, and its unknowns.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.products.files.chapter import Chapter, Contents, Stamped, bound
from drift.products.maps.imprint import Setting
from drift.products.maps.marks import Mark
from drift.spills.worlds import renewal, unknowns, verdict
from drift.spills.worlds.products import headline, report
from drift.spills.worlds.products import tables as washup_tables
from drift.spills.worlds.renewal import Aftermath


@dataclass(frozen=True)
class SpillOutputs:
    """What the files and pictures are made from."""

    after: Aftermath
    setting: Setting


def _washup(matter: SpillOutputs, path: Path) -> None:
    # imported here, for Matplotlib takes a second
    from drift.spills.worlds.products import map as washup_map

    after = matter.after
    walked = [
        washup_map.Patrolled(
            patrol["name"], patrol["time"], patrol["detection"], patrol["segments"]
        )
        for patrol in renewal.patrols(after.spill, after.segments)
    ]
    washup_map.plot_washup(
        after.washup,
        after.segments,
        path,
        matter.setting,
        finds=finds(after),
        patrols=washup_map.Patrols(walked),
        warning=renewal.warning(after),
        silence=renewal.silence(after),
    )


def finds(after: Aftermath) -> list[Mark]:
    """Return the finds as marks, each labelled by its number."""
    known = after.posterior.known.finds
    at = [verdict.position(after.spill, after.segments, k, find) for k, find in enumerate(known)]
    return [Mark(*place, f"{k}") for k, place in enumerate(at, 1)]


FILES: dict[str, Callable[[SpillOutputs, Stamped], Contents]] = {
    "washup.nc": lambda matter, stamped: matter.after.washup,
    "washup.csv": lambda matter, stamped: washup_tables.stretches(
        matter.after.washup, stamped["run_id"]
    ),
    "washup_times.csv": lambda matter, stamped: washup_tables.times(
        matter.after.washup, stamped["run_id"]
    ),
    "totals.csv": lambda matter, stamped: washup_tables.totals(
        matter.after.washup, stamped["run_id"]
    ),
    "washup.geojson": lambda matter, stamped: washup_tables.lines(
        matter.after.washup, matter.after.segments, stamped
    ),
    "unknowns.csv": lambda matter, stamped: unknowns.unknowns_csv(
        renewal.unknown(matter.after), matter.after.posterior.effective, stamped["run_id"]
    ),
}
# Of a spill with finds.
FIND_FILES: dict[str, Callable[[SpillOutputs, Stamped], Contents]] = {
    "finds.csv": lambda matter, stamped: verdict.csv(
        renewal.told(matter.after), matter.after.posterior.effective, stamped["run_id"]
    ),
}
PICTURES: dict[str, Callable[[SpillOutputs, Path], None]] = {
    "washup.png": _washup,
}


def chapter(matter: SpillOutputs) -> Chapter:
    """Return the chapter of a spill."""
    after = matter.after
    files = bound(FILES, matter) | (bound(FIND_FILES, matter) if after.spill.finds else {})
    words = headline.washup_headline(after.washup)
    leaves = (lambda: report.spill_leaves(finds(after), renewal.silence(after), words),)
    return Chapter(renewal.summary_of_spill(after), files, bound(PICTURES, matter), leaves=leaves)
