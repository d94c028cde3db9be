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
from drift.spills.worlds.renewal import Aftermath


@dataclass(frozen=True)
class SpillOutputs:
    """The inputs of the spill's files and picture."""

    after: Aftermath
    setting: Setting


def _plot_washup(outputs: SpillOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.spills.worlds.products import map as washup_map

    after = outputs.after
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
        outputs.setting,
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
    "washup.nc": lambda outputs, stamped: outputs.after.washup,
    "washup.csv": lambda outputs, stamped: washup_tables.stretches(
        outputs.after.washup, stamped["run_id"]
    ),
    "washup_times.csv": lambda outputs, stamped: washup_tables.times(
        outputs.after.washup, stamped["run_id"]
    ),
    "totals.csv": lambda outputs, stamped: washup_tables.totals(
        outputs.after.washup, stamped["run_id"]
    ),
    "washup.geojson": lambda outputs, stamped: washup_tables.lines(
        outputs.after.washup, outputs.after.segments, stamped
    ),
    "unknowns.csv": lambda outputs, stamped: unknowns.unknowns_csv(
        renewal.unknown(outputs.after), outputs.after.posterior.effective, stamped["run_id"]
    ),
}
# only for a spill with finds
FIND_FILES: dict[str, Callable[[SpillOutputs, Stamped], Contents]] = {
    "finds.csv": lambda outputs, stamped: verdict.csv(
        renewal.told(outputs.after), outputs.after.posterior.effective, stamped["run_id"]
    ),
}
PICTURES: dict[str, Callable[[SpillOutputs, Path], None]] = {
    "washup.png": _plot_washup,
}


def chapter(outputs: SpillOutputs) -> OutputBundle:
    """Return the output bundle of a spill."""
    after = outputs.after
    files = bind_outputs(FILES, outputs) | (
        bind_outputs(FIND_FILES, outputs) if after.spill.finds else {}
    )
    words = headline.washup_headline(after.washup)
    leaves = (lambda: report.spill_leaves(finds(after), renewal.silence(after), words),)
    return OutputBundle(
        renewal.summary_of_spill(after), files, bind_outputs(PICTURES, outputs), leaves=leaves
    )
