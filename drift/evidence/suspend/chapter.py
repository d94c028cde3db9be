"""Output files for a decision to suspend: a text and a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.evidence.suspend import decision
from drift.evidence.suspend import text as suspend_text
from drift.evidence.suspend.decision import Suspension
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Imprint
from drift.products.report import leaves as report_leaves


@dataclass(frozen=True)
class SuspensionOutputs:
    """The data from which the files and pictures are made."""

    suspension: Suspension
    imprint: Imprint
    synthetic: bool  # whether winds or currents are synthetic
    lost: float  # probability of particles on no map


def _picture(matter: SuspensionOutputs, path: Path) -> None:
    # imported here, since importing Matplotlib takes a second
    from drift.evidence.suspend import map as suspend_map

    suspend_map.plot_suspension(matter.suspension, path, matter.imprint)


FILES: dict[str, Callable[[SuspensionOutputs, Stamped], Contents]] = {
    "suspend.txt": lambda matter, stamped: suspend_text.suspension_text(
        matter.suspension,
        matter.imprint.title,
        stamped["run_id"],
        synthetic=matter.synthetic,
        lost=matter.lost,
    ),
}
PICTURES: dict[str, Callable[[SuspensionOutputs, Path], None]] = {
    "suspend.png": _picture,
}


def suspension_bundle(matter: SuspensionOutputs) -> OutputBundle:
    """Return the outputs for a decision to suspend."""
    leaves = (lambda: [report_leaves.text_leaf("For the decision to suspend", file="suspend.txt")],)
    numbers = {"suspension": decision.summary_of_decision(matter.suspension)}
    return OutputBundle(
        numbers, bind_outputs(FILES, matter), bind_outputs(PICTURES, matter), leaves=leaves
    )
