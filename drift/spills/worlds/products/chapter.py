"""Output files of a spill besides its forecast: washup by stretch, account, finds, unknowns."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting
from drift.products.maps.marks import Mark
from drift.spills.worlds import renewal, unknowns, verdict
from drift.spills.worlds.products import headline, report
from drift.spills.worlds.products import tables as washup_tables
from drift.spills.worlds.renewal import SpillResult


@dataclass(frozen=True)
class SpillOutputs:
    """The inputs of the spill's files and picture."""

    after: SpillResult
    setting: Setting


def _plot_washup(outputs: SpillOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.spills.worlds.products import map as washup_map

    after = outputs.after
    walked = [
        washup_map.Patrolled(
            patrol["name"], patrol["time"], patrol["detection"], patrol["segments"]
        )
        for patrol in renewal.rows_of_patrols(after.spill, after.segments)
    ]
    washup_map.plot_washup(
        after.washup,
        after.segments,
        path,
        outputs.setting,
        finds=find_marks(after),
        patrols=washup_map.Patrols(walked),
        warning=renewal.joined_warnings(after),
        silence=renewal.silence_of_spill(after),
    )


def find_marks(after: SpillResult) -> list[Mark]:
    """Return the finds as marks, each labelled by its number."""
    known = after.posterior.known.finds
    at = [
        verdict.find_position(after.spill, after.segments, k, find) for k, find in enumerate(known)
    ]
    return [Mark(*place, f"{k}") for k, place in enumerate(at, 1)]


FILES: dict[str, Callable[[SpillOutputs, Stamped], Contents]] = {
    "washup.nc": lambda outputs, stamped: outputs.after.washup,
    "washup.csv": lambda outputs, stamped: washup_tables.washup_csv(
        outputs.after.washup, stamped["run_id"]
    ),
    "washup_times.csv": lambda outputs, stamped: washup_tables.washup_times_csv(
        outputs.after.washup, stamped["run_id"]
    ),
    "totals.csv": lambda outputs, stamped: washup_tables.totals_csv(
        outputs.after.washup, stamped["run_id"]
    ),
    "washup.geojson": lambda outputs, stamped: washup_tables.washup_geojson(
        outputs.after.washup, outputs.after.segments, stamped
    ),
    "unknowns.csv": lambda outputs, stamped: unknowns.unknowns_csv(
        renewal.rows_of_unknowns(outputs.after),
        outputs.after.posterior.effective,
        stamped["run_id"],
    ),
}
# only for a spill with finds
FIND_FILES: dict[str, Callable[[SpillOutputs, Stamped], Contents]] = {
    "finds.csv": lambda outputs, stamped: verdict.finds_csv(
        renewal.rows_of_finds(outputs.after), outputs.after.posterior.effective, stamped["run_id"]
    ),
}
PICTURES: dict[str, Callable[[SpillOutputs, Path], None]] = {
    "washup.png": _plot_washup,
}


def spill_bundle(outputs: SpillOutputs) -> OutputBundle:
    """Return the output bundle of a spill."""
    after = outputs.after
    files = bind_outputs(FILES, outputs) | (
        bind_outputs(FIND_FILES, outputs) if after.spill.finds else {}
    )
    words = headline.washup_headline(after.washup)
    leaves = (
        lambda: report.spill_leaves(find_marks(after), renewal.silence_of_spill(after), words),
    )
    return OutputBundle(
        renewal.summary_of_spill(after), files, bind_outputs(PICTURES, outputs), leaves=leaves
    )
