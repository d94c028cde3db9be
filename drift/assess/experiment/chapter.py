"""The output files of an experiment: tables and a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drift.assess.experiment import text
from drift.assess.experiment.record import Experiment
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Imprint


@dataclass(frozen=True)
class ExperimentOutputs:
    """The inputs of the experiment's files and picture."""

    found: Experiment
    imprint: Imprint


def _plot(outputs: ExperimentOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.assess.experiment import map as experiment_map

    experiment_map.plot_experiment(outputs.found, path, outputs.imprint)


FILES: dict[str, Callable[[ExperimentOutputs, Stamped], Contents]] = {
    "experiment.csv": lambda outputs, stamped: text.experiment_table(outputs.found),
    "experiment_runs.csv": lambda outputs, stamped: text.runs_csv(outputs.found),
}
TRACKING: dict[str, Callable[[ExperimentOutputs, Stamped], Contents]] = {  # of tracking cases
    "experiment_times.csv": lambda outputs, stamped: text.curves_csv(outputs.found),
}
PICTURES: dict[str, Callable[[ExperimentOutputs, Path], None]] = {"experiment.png": _plot}


def experiment_bundle(outputs: ExperimentOutputs, attributes: dict[str, str]) -> OutputBundle:
    """Return the output files of an experiment; `attributes` are its provenance texts by name."""
    numbers = {"experiment": text.summary_of_experiment(outputs.found)}
    files = {**FILES, **(TRACKING if outputs.found.tracking is not None else {})}
    return OutputBundle(
        numbers, bind_outputs(files, outputs), bind_outputs(PICTURES, outputs), facts=attributes
    )
