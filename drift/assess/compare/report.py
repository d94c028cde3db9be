"""What report.html shows of a comparison: where each case has more, and every figure with its
standard error.
"""

from collections.abc import Sequence

import numpy as np

from drift.assess.compare import text
from drift.assess.compare.record import Contrast
from drift.products.maps.imprint import Setting
from drift.products.report import leaves
from drift.products.report.leaves import Leaf

TENTH = 0.1  # share of the probability in the cells that end the colours of its map


def comparison_leaves(found: Contrast, begun: Sequence[Setting]) -> list[Leaf]:
    """Return the leaves of a comparison; begun: where A and where B began."""
    data = found.data
    a, b, more = (
        data[name].values.astype(np.float64)
        for name in ("probability_a", "probability_b", "difference")
    )
    stories = {
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
        leaves.maps(
            "Probability",
            np.array(found.times),
            data["lon"].values,
            data["lat"].values,
            stories,
            area,
            [_top(values / area, values) for values in a],
        ),
        *_begun(begun),
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
            note=f"Errors are of chance alone, on common random numbers.{given}",
        ),
        leaves.text_leaf("In words", file="compare.txt"),
    ]


def _begun(begun: Sequence[Setting]) -> list[Leaf]:
    """Return where the cases began, once where they began alike."""
    places = [(on.marks, on.lines) for on in begun]
    named = {"it": places[0]} if places[0] == places[1] else dict(zip("AB", places, strict=True))
    return [
        leaves.marked(f"Where {name} began", *where, "start")
        for name, where in named.items()
        if any(where)
    ]


def _top(density: np.ndarray, mass: np.ndarray) -> float:
    """Return the density [1/m2] above which cells hold a tenth of the probability; 1 where there is
    none.
    """
    order = np.argsort(-density.ravel(), kind="stable")
    held = np.cumsum(mass.ravel()[order])
    return (
        float(density.ravel()[order][np.searchsorted(held, TENTH * held[-1])])
        if held[-1] > 0
        else 1.0
    )
