"""What report.html shows of a spill: stretches of coast by what lies there over time, finds, and the account."""

from collections.abc import Sequence

from drift.maps.marks import Mark
from drift.report import leaves
from drift.report.leaves import Leaf

TOLD = [
    ("name", "Stretch", "words"), ("access", "Access", "words"), ("expected", "Objects, at the end", "number"), ("expected_se", "± (standard error)", "number"),
    ("number_10", "10 % chance of at most", "number"), ("number_90", "90 % chance of at most", "number"), ("ever", "Any ever", "share"),
    ("first_50", "First arrival, median", "time"),
]  # fmt: skip


def of(finds: Sequence[Mark]) -> list[Leaf]:
    """Return the leaves of a spill and its finds."""
    shown = [leaves.marked("Finds", finds, (), "find")] if finds else []
    return [
        leaves.shapes(
            "Washup by stretch", "washup.geojson", "stretch", told=TOLD, graded=("washup_times.csv", "segment", "expected")
        ),
        *shown,
        leaves.table(
            "Washup by stretch, at the end",
            [("rank", "Rank", "count"), ("position", "Position", "words"), *TOLD, ("length_km", "Length, km", "number")],
            file="washup.csv",
            note="Worst first.",
        ),
        leaves.table(
            "Account of all objects",
            [
                ("time", "Time", "time"), ("fate", "Fate", "words"), ("expected", "Expected", "number"), ("expected_se", "± (standard error)", "number"),
                ("number_10", "10 %", "number"), ("number_50", "50 %", "number"), ("number_90", "90 %", "number"),
            ],
            file="totals.csv",
            by_time="time",
        ),
        leaves.table(
            "What is not known of the spill",
            [
                ("unknown", "Unknown", "words"), ("unit", "Unit", "words"), ("prior_mean", "Mean before", "words"), ("prior_10%", "10 %", "words"),
                ("prior_90%", "90 %", "words"), ("posterior_mean", "Mean after the finds", "words"), ("posterior_10%", "10 %", "words"),
                ("posterior_90%", "90 %", "words"),
            ],
            file="unknowns.csv",
        ),
    ]  # fmt: skip
