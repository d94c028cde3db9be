"""The output files of a budget: budget.csv, budget.png, and those of the consensus of models."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from drift.assess.budget import consensus, text
from drift.assess.budget.record import Budget
from drift.pipeline import run_metadata
from drift.pipeline.run_options import Job
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting
from geo import notation


@dataclass(frozen=True)
class BudgetOutputs:
    """The inputs of the budget's files and pictures."""

    found: Budget
    setting: Setting


def _plot(outputs: BudgetOutputs, path: Path) -> None:
    # imported here because Matplotlib takes a second
    from drift.assess.budget import map as budget_map

    budget_map.plot_budget(outputs.found, path, outputs.setting.imprint)


def _plot_consensus(outputs: BudgetOutputs, path: Path) -> None:
    from drift.assess.budget import map as budget_map

    assert outputs.found.consensus is not None
    budget_map.plot_consensus(outputs.found.consensus, path, outputs.setting)


def _agreed(outputs: BudgetOutputs) -> consensus.Consensus:
    assert outputs.found.consensus is not None
    return outputs.found.consensus


FILES: dict[str, Callable[[BudgetOutputs, Stamped], Contents]] = {
    "budget.csv": lambda outputs, stamped: text.budget_csv(outputs.found, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[BudgetOutputs, Path], None]] = {"budget.png": _plot}
CONSENSUS_FILES: dict[str, Callable[[BudgetOutputs, Stamped], Contents]] = {  # of several models
    "consensus.csv": lambda outputs, stamped: consensus.consensus_csv(
        _agreed(outputs), stamped["run_id"]
    ),
    "consensus.nc": lambda outputs, stamped: consensus.consensus_dataset(_agreed(outputs)),
}
CONSENSUS_PICTURES: dict[str, Callable[[BudgetOutputs, Path], None]] = {
    "consensus.png": _plot_consensus
}
NAMES = (*FILES, *PICTURES, *CONSENSUS_FILES, *CONSENSUS_PICTURES)


def budget_bundles(found: Budget, job: Job) -> list[OutputBundle]:
    """Return the output bundle of a budget; job: of its case without evidence."""
    on = run_metadata.with_coast(run_metadata.map_setting(job.case, job.where))
    attributes = run_metadata.file_attributes(job.case, job.where)
    # appended to the case, so that other times or particles give another run_id
    times = ", ".join(notation.iso(time) for time in found.times)
    words = f"# budget at {times} by {found.particles} particles"
    attributes["case"] = f"{attributes['case'].rstrip()}\n{words}\n"
    outputs = BudgetOutputs(found, replace(on, particles=found.particles))
    files, pictures = dict(FILES), dict(PICTURES)
    if found.consensus is not None:
        files |= CONSENSUS_FILES
        pictures |= CONSENSUS_PICTURES
    return [
        OutputBundle(
            {"budget": text.summary_of_budget(found)},
            bind_outputs(files, outputs),
            bind_outputs(pictures, outputs),
            attributes,
        )
    ]
