"""Output files of a beam allocation: tables, numbers and a timeline chart."""

from collections.abc import Callable
from pathlib import Path

from drift.planning.arrays import processing_text
from drift.planning.plans import PlanOutputs
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.report import leaves


def _text(matter: PlanOutputs, stamped: Stamped) -> str:
    """Return processing.txt."""
    plan = matter.plan
    title, run = matter.setting.imprint.title, stamped["run_id"]
    return processing_text.processing_as_text(
        plan.allocation, plan.hearing, plan.names, title, run, processing_text.notes(plan)
    )


def _csv(matter: PlanOutputs, stamped: Stamped) -> str:
    """Return processing.csv."""
    plan = matter.plan
    return processing_text.csv(plan.allocation, plan.hearing, plan.names, stamped["run_id"])


def _picture(matter: PlanOutputs, path: Path) -> None:
    # here: Matplotlib takes a second to import
    """Draw processing.png."""
    from drift.planning.arrays import map as processing_map

    plan = matter.plan
    lines = processing_text.pod(plan), processing_text.begun_anew(plan)
    processing_map.plot_processing(
        plan.allocation, plan.hearing, plan.names, path, matter.setting.imprint, lines
    )


FILES: dict[str, Callable[[PlanOutputs, Stamped], Contents]] = {
    "processing.txt": _text,
    "processing.csv": _csv,
    "processing.json": lambda matter, stamped: {
        "run_id": stamped["run_id"],
        **processing_text.plan_numbers(matter.plan),
    },
}
PICTURES: dict[str, Callable[[PlanOutputs, Path], None]] = {
    "processing.png": _picture,
}


def chapter(matter: PlanOutputs) -> OutputBundle:
    """Return the output files of a beam allocation."""
    numbers = processing_text.plan_numbers(matter.plan)
    return OutputBundle(
        {"processing": {key: value for key, value in numbers.items() if key != "slots"}},
        bind_outputs(FILES, matter),
        bind_outputs(PICTURES, matter),
        leaves=(lambda: [leaves.text_leaf("Processing", file="processing.txt")],),
    )
