"""Items of report.html for a comparison: maps of both cases and their difference, and figures."""

from collections.abc import Sequence

import numpy as np

from drift.assess.compare import text
from drift.assess.compare.record import Contrast
from drift.products.maps.imprint import Setting
from drift.products.report import leaves
from drift.products.report.leaves import Leaf

TENTH = 0.1  # share of the probability in the densest cells, which all get the darkest colour


def comparison_leaves(found: Contrast, begun: Sequence[Setting]) -> list[Leaf]:
    """Return the report items of a comparison; begun: the map settings of A and of B."""
    data = found.data
    a, b, more = (
        data[name].values.astype(np.float64)
        for name in ("probability_a", "probability_b", "difference")
    )
    layers = {
        "A": a,
        "B": b,
        "More in B than in A": np.maximum(more, 0),
        "More in A than in B": np.maximum(-more, 0),
    }
    area = data["cell_area"].values
    columns = [
        ("time", "Time", "time"),
        ("quantity", "Quantity", "words"),
        ("name", "Of", "words"),
        ("unit", "Unit", "words"),
        ("a", "A", "number"),
        ("b", "B", "number"),
        ("difference", "B less A", "number"),
        ("error", "± (standard error)", "number"),
    ]
    names = [list(row) for row in zip("AB", found.names, found.given, strict=True)]
    given = f" {text.words_given(found)}." if set(found.given) != {"nothing"} else ""
    return [
        leaves.maps_leaf(
            "Probability",
            np.array(found.times),
            data["lon"].values,
            data["lat"].values,
            layers,
            area,
            [_top_density(values / area, values) for values in a],
        ),
        *_start_leaves(begun),
        leaves.table_leaf(
            "The two cases",
            [("", "Case", "words"), ("", "What it is", "words"), ("", "Weighed by", "words")],
            rows=names,
        ),
        leaves.table_leaf(
            "Differences",
            columns,
            file="compare.csv",
            by_time="time",
            note=f"Errors are sampling errors, on common random numbers.{given}",
        ),
        leaves.text_leaf("In words", file="compare.txt"),
    ]


def _start_leaves(begun: Sequence[Setting]) -> list[Leaf]:
    """Return maps of where the cases start, a single one if they start at the same places."""
    places = [(on.marks, on.lines) for on in begun]
    named = {"it": places[0]} if places[0] == places[1] else dict(zip("AB", places, strict=True))
    return [
        leaves.marks_leaf(f"Where {name} began", *where, "start")
        for name, where in named.items()
        if any(where)
    ]


def _top_density(density: np.ndarray, mass: np.ndarray) -> float:
    """Return the density [1/m2] that the densest cells with a tenth of the probability exceed.

    It is 1 if there is no probability.
    """
    order = np.argsort(-density.ravel(), kind="stable")
    cumulative = np.cumsum(mass.ravel()[order])
    return (
        float(density.ravel()[order][np.searchsorted(cumulative, TENTH * cumulative[-1])])
        if cumulative[-1] > 0
        else 1.0
    )
