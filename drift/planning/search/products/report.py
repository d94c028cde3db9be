"""What report.html shows of a plan: where each unit goes, and what the plan is worth."""

from drift.planning.search.products import files
from drift.planning.search.products import text as plan_text
from drift.planning.search.records import Plan
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from geo import notation

SPAN = ("on_scene", "off_scene")
TOLD = [
    ("unit", "Unit", "words"),
    ("on_scene", "On scene", "time"),
    ("off_scene", "Off scene", "time"),
    ("pos", "POS", "share"),
    ("length_nmi", "Length, nmi", "number"),
    ("width_nmi", "Width, nmi", "number"),
    ("spacing_nmi", "Track spacing, nmi", "number"),
    ("legs", "Legs", "count"),
    ("creep_deg", "Creep, deg true", "number"),
    ("search_speed_kn", "Search speed, kn", "stated"),
]


def plan_leaves(plan: Plan) -> list[Leaf]:
    """Return the leaves of a plan."""
    file = "plan.geojson"
    told = [
        *TOLD[:4],
        *([("pos_ashore", "of it ashore", "share")] if plan.spec.ashore else []),
        *TOLD[4:],
    ]
    rows = [
        [row["area"], *(row[name] for name, _, _ in told)]
        for row in files.plan_as_json(plan)["taskings"]
    ]
    begin, until = (notation.format_dtg(time) for time in (plan.spec.begin, plan.spec.until))
    units = f"{len(rows)} sub-area{'s' * (len(rows) != 1)}"
    return [
        leaves.headline_leaf(f"The plan, {begin} to {until}, {units}: {plan_text.worth(plan)}."),
        leaves.shapes_leaf(
            "Planned areas",
            file,
            "planned",
            where={"shape": "area"},
            span=SPAN,
            label="area",
            told=TOLD,
            frame=True,
        ),
        leaves.shapes_leaf(
            "Planned legs", file, "planned_legs", where={"shape": ["legs", "round"]}, told=TOLD
        ),
        leaves.shapes_leaf(
            "Ways out and home", file, "planned_transit", where={"shape": "transit"}, shown=False
        ),
        leaves.shapes_leaf(
            "Commence search points",
            file,
            "planned_point",
            where={"shape": "csp"},
            told=[("area", "Area", "words")],
        ),
        leaves.table_leaf(
            "Units of the plan",
            [("area", "Area", "words"), *told],
            rows=rows,
            note=plan_text.stranded(plan),
            unfolded=True,
        ),
        leaves.text_leaf("Search action plan", file="plan.txt", unfolded=True),
    ]
