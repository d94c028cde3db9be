"""What a decision to suspend is handed: a text and a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.maps.imprint import Imprint
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.suspend import decision
from drift.suspend import text as suspend_text
from drift.suspend.decision import Suspension


@dataclass(frozen=True)
class Matter:
    """What the files and pictures are made from."""

    told: Suspension
    imprint: Imprint
    synthetic: bool  # winds or currents are made up
    lost: float  # probability that is on no map


def _picture(one: Matter, path: Path) -> None:
    from drift.suspend import map as suspend_map  # here: Matplotlib takes a second to import

    suspend_map.draw(one.told, path, one.imprint)


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "suspend.txt": lambda one, stamped: suspend_text.text(
        one.told, one.imprint.title, stamped["run_id"], synthetic=one.synthetic, lost=one.lost
    ),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {
    "suspend.png": _picture,
}


def chapter(one: Matter) -> Chapter:
    """Return the chapter of a decision to suspend."""
    return Chapter({"suspension": decision.numbers(one.told)}, bound(FILES, one), bound(PICTURES, one))
