"""What is handed out of an experiment: tables and a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.maps.imprint import Imprint
from drift.output.chapter import Chapter, Contents, Stamped, bound
from drift.tracker import text
from drift.tracker.experiment import Outcome


@dataclass(frozen=True)
class Matter:
    """What the files and the picture are made from."""

    found: Outcome
    imprint: Imprint


def _errors(matter: Matter, path: Path) -> None:
    from drift.tracker import errors_map  # here: Matplotlib takes a second to import

    errors_map.draw(matter.found, path, matter.imprint)


FILES: dict[str, Callable[[Matter, Stamped], Contents]] = {
    "experiment.csv": lambda matter, stamped: text.table(matter.found),
    "experiment_runs.csv": lambda matter, stamped: text.runs(matter.found),
    "experiment_times.csv": lambda matter, stamped: text.times(matter.found),
}
PICTURES: dict[str, Callable[[Matter, Path], None]] = {"experiment.png": _errors}


def chapter(matter: Matter, attributes: dict[str, str]) -> Chapter:
    """Return the chapter of an experiment."""
    numbers = {"experiment": text.numbers(matter.found)}
    return Chapter(numbers, bound(FILES, matter), bound(PICTURES, matter), facts=attributes)
