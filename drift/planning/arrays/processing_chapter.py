"""Output files of a beam allocation: tables, numbers and a timeline chart."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from drift.planning.arrays import processing_text
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting
from drift.products.report import leaves
from drift.products.report.leaves import Leaf


@dataclass(frozen=True)
class ProcessingOutputs:
    """What the output files and the chart of a beam allocation are made from."""

    plan: Any  # a drift.planning.arrays.processing_plan.ProcessingPlan
    setting: Setting


def _text(matter: ProcessingOutputs, stamped: Stamped) -> str:
    """Return processing.txt."""
    plan = matter.plan
    title, run = matter.setting.imprint.title, stamped["run_id"]
    return processing_text.processing_as_text(
        plan.allocation, plan.hearing, plan.names, title, run, processing_text.notes(plan)
    )


def _csv(matter: ProcessingOutputs, stamped: Stamped) -> str:
    """Return processing.csv."""
    plan = matter.plan
    return processing_text.csv(plan.allocation, plan.hearing, plan.names, stamped["run_id"])


def _picture(matter: ProcessingOutputs, path: Path) -> None:
    # here: Matplotlib takes a second to import
    """Draw processing.png."""
    from drift.planning.arrays import map as processing_map

    plan = matter.plan
    lines = processing_text.pod(plan), processing_text.begun_anew(plan)
    processing_map.plot_processing(
        plan.allocation, plan.hearing, plan.names, path, matter.setting.imprint, lines
    )


FILES: dict[str, Callable[[ProcessingOutputs, Stamped], Contents]] = {
    "processing.txt": _text,
    "processing.csv": _csv,
    "processing.json": lambda matter, stamped: {
        "run_id": stamped["run_id"],
        **processing_text.plan_numbers(matter.plan),
    },
}
PICTURES: dict[str, Callable[[ProcessingOutputs, Path], None]] = {
    "processing.png": _picture,
}


def chapter(matter: ProcessingOutputs) -> OutputBundle:
    """Return the output files of a beam allocation."""
    numbers = processing_text.plan_numbers(matter.plan)
    return OutputBundle(
        {"processing": {key: value for key, value in numbers.items() if key != "slots"}},
        bind_outputs(FILES, matter),
        bind_outputs(PICTURES, matter),
        leaves=(partial(_leaves, matter),),
    )


def _leaves(matter: ProcessingOutputs) -> list[Leaf]:
    """Return the allocation's page of the report."""
    return [leaves.text_leaf("Processing", file="processing.txt")]
