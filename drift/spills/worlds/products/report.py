"""Items of report.html for a spill: stretches by objects over time, finds, and the account."""

from collections.abc import Sequence

from drift.products.maps.marks import Mark
from drift.products.report import leaves
from drift.products.report.leaves import Leaf

TOLD = [
    ("name", "Stretch", "words"),
    ("access", "Access", "words"),
    ("number_10", "Objects at the end: 10 % quantile", "number"),
    ("number_90", "90 % quantile", "number"),
    ("expected", "On average", "number"),
    ("expected_se", "+- of the average (sampling)", "number"),
    ("ever", "Any ever, without the found ones", "share"),
    ("first_50", "First arrival, median", "time"),
]


FINDS = [
    ("number", "Find", "count"),
    ("name", "Name", "words"),
    ("time", "Time", "time"),
    ("stretch", "Stretch", "words"),
    ("position", "Position", "words"),
    ("class", "Class", "words"),
    ("by", "By", "words"),
    ("probability_beforehand", "Expected there", "share"),
    ("tail", "Here or less likely", "share"),
    ("odd", "Odd", "words"),
    ("none_of_ours", "Not this spill", "share"),
]
BEFOREHAND = (
    "Expected there: the probability, given all evidence before it, that the next find is on that "
    "stretch (at sea: within its radius). Here or less likely: that it is on that stretch or on "
    "one that is at most as likely; under 2 % the find is odd. Not this spill: the probability that it is not from this "
    "spill, 0 if the case does not set `false`. "
)


def spill_leaves(finds: Sequence[Mark], silence: str | None, headline: str) -> list[Leaf]:
    """Return the report items of a spill and its finds.

    Args:
        finds: where objects were found.
        silence: up to when the absence of reports is evidence, as text; None: no evidence.
        headline: text at the top of the report.
    """
    words = f"Assumed: {silence}." if silence else ""
    shown = [leaves.marks_leaf("Finds", finds, (), "find")] if finds else []
    listed = (
        [leaves.table_leaf("Finds, one by one", FINDS, file="finds.csv", note=BEFOREHAND + words)]
        if finds
        else []
    )
    quiet = [leaves.text_leaf("Absence of finds", words=words)] if silence and not finds else []
    return [
        leaves.headline_leaf(headline, first=True),
        leaves.shapes_leaf(
            "Washup by stretch",
            "washup.geojson",
            "stretch",
            told=TOLD,
            graded=("washup_times.csv", "segment", "expected"),
        ),
        *shown,
        *listed,
        *quiet,
        leaves.table_leaf(
            "Washup by stretch, at the end",
            [
                ("rank", "Rank", "count"),
                ("rank_per_km", "Rank per km", "count"),
                ("position", "Position", "words"),
                ("near", "Nearest town", "words"),
                ("near_across_water", "Across water", "words"),
                *TOLD,
                ("length_km", "Length, km", "number"),
                ("expected_per_km", "On average per km", "number"),
            ],
            file="washup.csv",
            note=(
                "Worst first, by the average number. Long stretches collect more objects, so "
                "there is also a rank by number per km."
            )
            + (" All numbers are of objects not yet found." if finds else ""),
            unfolded=True,
        ),
        leaves.table_leaf(
            "Account of all objects",
            [
                ("time", "Time", "time"),
                ("fate", "Fate", "words"),
                ("number_10", "10 % chance of at most", "number"),
                ("number_50", "50 %", "number"),
                ("number_90", "90 %", "number"),
                ("expected", "On average", "number"),
                ("expected_se", "+- of the average (sampling)", "number"),
            ],
            file="totals.csv",
            by_time="time",
        ),
        leaves.table_leaf(
            "Unknowns before and after the finds",
            [
                ("unknown", "Unknown", "words"),
                ("unit", "Unit", "words"),
                ("prior_mean", "Mean before", "words"),
                ("prior_10%", "10 %", "words"),
                ("prior_90%", "90 %", "words"),
                ("posterior_mean", "Mean after the finds", "words"),
                ("posterior_10%", "10 %", "words"),
                ("posterior_90%", "90 %", "words"),
            ],
            file="unknowns.csv",
        ),
    ]
