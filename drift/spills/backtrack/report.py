"""Items of report.html for a backward run: release place by time, and the figures."""

from collections.abc import Sequence

import numpy as np

from drift.products.maps.marks import Mark
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from drift.spills.backtrack import backward, text
from drift.spills.backtrack.backward import Origin


def origin_leaves(origin: Origin, finds: Sequence[Mark]) -> list[Leaf]:
    """Return the report items of a backward run and of its finds."""
    area = np.broadcast_to(backward.cell_area(origin)[:, None], origin.probability.shape[1:])
    all_times = np.broadcast_to(origin.probability.sum(axis=0), origin.probability.shape)
    layers = {
        "At any time": all_times,
        "In this interval": origin.probability,
        "In this interval, before the finds": origin.prior,
    }
    top = float((all_times / area).max(initial=0.0)) or 1.0
    return [
        leaves.maps_leaf(
            "Release", origin.time, origin.lon, origin.lat, layers, area, [top] * len(origin.time)
        ),
        leaves.marks_leaf("Finds", finds, (), "find", frame=True),
        leaves.table_leaf(
            "Release",
            [("", "Figure", "words"), ("", "Value", "words")],
            rows=[
                [name.capitalize(), words]
                for name, words in text.origin_facts(backward.summary_of_origin(origin)).items()
            ],
            note="Rough backtrack; confirm with a forward run.",
        ),
    ]
