"""Pages of report.html for a search plan: the units' areas and the plan's value."""

from drift.planning.search.products import files
from drift.planning.search.products import text as plan_text
from drift.planning.search.records import Plan
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from geo import notation

SPAN = ("on_scene", "off_scene")
COLUMNS = [
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
    """Return the report pages of a search plan."""
    file = "plan.geojson"
    columns = [
        *COLUMNS[:4],
        *([("pos_ashore", "of it ashore", "share")] if plan.spec.ashore else []),
        *COLUMNS[4:],
    ]
    rows = [
        [row["area"], *(row[name] for name, _, _ in columns)]
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
            told=COLUMNS,
            frame=True,
        ),
        leaves.shapes_leaf(
            "Planned legs", file, "planned_legs", where={"shape": ["legs", "round"]}, told=COLUMNS
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
            [("area", "Area", "words"), *columns],
            rows=rows,
            note=plan_text.stranded(plan),
            unfolded=True,
        ),
        leaves.text_leaf("Search action plan", file="plan.txt", unfolded=True),
    ]
