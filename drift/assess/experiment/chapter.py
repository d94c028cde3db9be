"""What is handed out of an experiment: tables and a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.assess.experiment import text
from drift.assess.experiment.record import Experiment
from drift.products.files.chapter import Chapter, Contents, Stamped, bound
from drift.products.maps.imprint import Imprint


@dataclass(frozen=True)
class ExperimentOutputs:
    """What the files and the picture are made from."""

    found: Experiment
    imprint: Imprint


def _picture(matter: ExperimentOutputs, path: Path) -> None:
    # here: Matplotlib takes a second to import
    from drift.assess.experiment import map as experiment_map

    experiment_map.plot_experiment(matter.found, path, matter.imprint)


FILES: dict[str, Callable[[ExperimentOutputs, Stamped], Contents]] = {
    "experiment.csv": lambda matter, stamped: text.experiment_table(matter.found),
    "experiment_runs.csv": lambda matter, stamped: text.runs(matter.found),
}
TRACKING: dict[str, Callable[[ExperimentOutputs, Stamped], Contents]] = {  # of tracking cases
    "experiment_times.csv": lambda matter, stamped: text.times(matter.found),
}
PICTURES: dict[str, Callable[[ExperimentOutputs, Path], None]] = {"experiment.png": _picture}


def chapter(matter: ExperimentOutputs, attributes: dict[str, str]) -> Chapter:
    """Return the chapter of an experiment."""
    numbers = {"experiment": text.summary_of_experiment(matter.found)}
    files = {**FILES, **(TRACKING if matter.found.tracking is not None else {})}
    return Chapter(numbers, bound(files, matter), bound(PICTURES, matter), facts=attributes)
