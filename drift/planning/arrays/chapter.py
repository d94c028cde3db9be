"""Output files of a plan of towed arrays: text, [[sortie]] tables, numbers and a map."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from drift.planning.arrays import placement_text
from drift.planning.plans import PlanOutputs
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from geo import notation


def _picture(matter: PlanOutputs, path: Path) -> None:
    """Draw the search map with the plan's areas and turning points on it."""
    from drift.evidence.filter.products import map as search_map
    from drift.planning.arrays import layers  # here: Matplotlib takes a second to import

    assert matter.result.updates is not None
    own = layers.plan(matter.plan.placement.placed, matter.plan.sorties)
    setting = replace(matter.setting, overlays=(*matter.setting.overlays, lambda time: own))
    sorties = sorted(matter.plan.sorties, key=lambda sortie: (sortie.start, sortie.end))
    search_map.plot_searches(
        matter.result.forecast, sorties, (), matter.result.updates, path, setting, page=1
    )


FILES: dict[str, Callable[[PlanOutputs, Stamped], Contents]] = {
    "arrays.txt": lambda matter, stamped: placement_text.placement_as_text(
        matter.plan, matter.setting.imprint.title, stamped["run_id"]
    ),
    "arrays.toml": lambda matter, stamped: placement_text.toml(matter.plan),
    "arrays.json": lambda matter, stamped: {
        "run_id": stamped["run_id"],
        **placement_text.summary_of_placement(matter.plan),
    },
}
PICTURES: dict[str, Callable[[PlanOutputs, Path], None]] = {
    "arrays.png": _picture,
}


def chapter(matter: PlanOutputs) -> OutputBundle:
    """Return the output files of a plan of towed arrays."""
    return OutputBundle(
        {"arrays": placement_text.summary_of_placement(matter.plan)},
        bind_outputs(FILES, matter),
        bind_outputs(PICTURES, matter),
        leaves=(partial(_leaves, matter),),
    )


def _leaves(matter: PlanOutputs) -> list[Leaf]:
    """Return the plan's items of the report; the arrays' legs are in sorties.geojson."""
    pod = notation.percent(matter.plan.pos)
    until = notation.format_dtg(matter.plan.until)
    return [
        leaves.headline_leaf(
            f"The planned arrays hear it by {until} with a probability of {pod} (POD)."
        ),
        leaves.shapes_leaf(
            "Planned arrays",
            "sorties.geojson",
            "planned",
            where={"kind": "sortie", "status": "planned", "shape": "legs"},
            label="name",
            told=[
                ("start", "Begins", "time"),
                ("end", "Ends", "time"),
                ("poc", "POC", "share"),
                ("pod", "POD", "share"),
                ("pos", "POS", "share"),
            ],
            frame=True,
        ),
        leaves.text_leaf("Towed arrays", file="arrays.txt"),
    ]
