"""Pages of report.html for a patrol plan: the visited stretches and the schedule."""

from drift.planning.patrols.planner import PatrolPlan
from drift.products.report import leaves
from drift.products.report.leaves import Leaf

COLUMNS = [
    ("time", "Time", "time"),
    ("patrol_unit", "Team", "words"),
    ("stretch", "Stretch", "words"),
    ("position", "Position", "words"),
    ("access", "Access", "words"),
    ("length_km", "Length, km", "number"),
    ("lying", "Objects lying there", "number"),
    ("found", "Found, on average", "number"),
    ("found_se", "+- of the average (sampling)", "number"),
]
LEFT_OUT = [
    ("patrol_unit", "Team", "words"),
    ("day_km", "Team's daily length, km", "number"),
    ("stretch", "Stretch", "words"),
    ("position", "Position", "words"),
    ("length_km", "Length, km", "number"),
    ("lying", "Objects lying there", "number"),
]


def patrol_leaves(plan: PatrolPlan) -> list[Leaf]:
    """Return the report pages of a patrol plan."""
    visited = sorted({int(visit.segment) for visit in plan.visits})
    return [
        leaves.shapes_leaf(
            "Planned patrols",
            "washup.geojson",
            "patrol",
            where={"segment": visited},
            told=[("name", "Stretch", "words")],
            frame=True,
        ),
        leaves.table_leaf("Patrols", COLUMNS, file="patrols.csv", by_time="time", unfolded=True),
        *(
            [
                leaves.table_leaf(
                    "Left out: longer than a team's day",
                    LEFT_OUT,
                    file="patrols_left_out.csv",
                    note="Objects lying there at the team's first patrol. To have a stretch planned, cut it shorter ([spill.stretches]).",
                )
            ]
            if plan.left_out
            else []
        ),
        leaves.text_leaf("Schedule", file="patrols.txt"),
    ]
