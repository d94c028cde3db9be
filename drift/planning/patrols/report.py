"""What report.html shows of a plan of patrols: the stretches that are visited, and the schedule."""

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
    ("day_km", "Its day, km", "number"),
    ("stretch", "Stretch", "words"),
    ("position", "Position", "words"),
    ("length_km", "Length, km", "number"),
    ("lying", "Objects lying there", "number"),
]


def patrol_leaves(plan: PatrolPlan) -> list[Leaf]:
    """Return the leaves of a plan of patrols."""
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
                    note="Lying there: on the team's first patrol. Cut them shorter ([spill.stretches]), and they are planned too.",
                )
            ]
            if plan.left_out
            else []
        ),
        leaves.text_leaf("Schedule", file="patrols.txt"),
    ]
