"""The section of report.html on a search: layers of the map, and tables of updates."""

from collections.abc import Sequence

from drift.evidence.filter.records import Contact, Sensors, Sortie
from drift.evidence.filter.updates import Updates, merge_unlikely_scenarios
from drift.products.report import leaves
from drift.products.report.leaves import Leaf
from geo import notation

FILE = "sorties.geojson"
SORTIE = [
    ("unit", "Unit", "words"),
    ("start", "Start", "time"),
    ("end", "End", "time"),
    ("pod", "POD", "share"),
    ("poc", "POC", "share"),
    ("pos", "POS", "share"),
]
SEEN = [
    ("time", "Time", "time"),
    ("start", "From", "time"),
    ("end", "To", "time"),
    ("log_evidence", "ln evidence", "number"),
]


def search_leaves(
    updates: Updates, sorties: Sequence[Sortie], contacts: Sequence[Contact], sensors: Sensors
) -> list[Leaf]:
    """Return the report items of a search; sorties: those that have been flown."""
    shown: list[Leaf] = []
    if sorties:
        of_sortie = {"kind": "sortie", "name": [sortie.name for sortie in sorties]}
        shown += [
            leaves.shapes_leaf(
                "Sorties",
                FILE,
                "searched",
                where={**of_sortie, "shape": ["area", "zones", "point"]},
                when=leaves.DURING,
                label="name",
                told=SORTIE,
            ),
            leaves.shapes_leaf(
                "Legs flown",
                FILE,
                "legs",
                where={**of_sortie, "shape": "legs"},
                when=leaves.DURING,
                told=SORTIE,
            ),
            leaves.shapes_leaf(
                "Transits",
                FILE,
                "transit",
                where={**of_sortie, "shape": "transit"},
                when=leaves.DURING,
                shown=False,
            ),
        ]
    if contacts:
        shown.append(
            leaves.shapes_leaf(
                "Contacts",
                FILE,
                "contact",
                where={"kind": "contact"},
                when=leaves.SINCE,
                label="name",
                told=SEEN,
            )
        )
    if sensors.telling:
        fields = {"kind": ["look", "presence"]}
        shown += [
            leaves.shapes_leaf(
                "Looks and presences", FILE, "field", where=fields, when=leaves.DURING, told=SEEN
            ),
            leaves.shapes_leaf(
                "Barriers",
                FILE,
                "barrier",
                where={"kind": "barrier"},
                when=leaves.DURING,
                label="name",
                told=SEEN,
            ),
        ]
    if sensors.lines:
        told = [("probability", "Crossed, in the end", "share")]
        shown.append(
            leaves.shapes_leaf(
                "Lines asked about", FILE, "line", where={"kind": "line"}, label="name", told=told
            )
        )
    if updates.all:
        shown += _found_so_far(updates)
        shown += [_updates(any(sortie.planned for sortie in updates.sorties)), _scenarios(updates)]
    return shown


def _found_so_far(updates: Updates) -> list[Leaf]:
    """Return a sentence with the cumulative POS; none without sorties."""
    done = [update.cumulative[-1] for update in updates.all if update.cumulative is not None]
    if not done:
        return []
    planned = any(sortie.planned for sortie in updates.sorties)
    who = "The searches so far and those planned" if planned else "The searches so far"
    words = f"{who} would have found it with a probability of {notation.percent(float(done[-1]))} (cumulative POS)."
    return [leaves.headline_leaf(words)]


def _updates(planned: bool) -> Leaf:
    """Return the table of updates; planned: whether some sorties are not yet flown."""
    columns = [
        ("time", "Time", "time"),
        ("name", "What", "words"),
        ("kind", "Kind", "words"),
        *([("status", "Status", "words")] if planned else []),
        ("pod", "POD", "share"),
        ("poc", "POC", "share"),
        ("pos", "POS", "share"),
        ("pos_ashore", "of it ashore", "share"),
        ("pos_cumulative", "POS so far", "share"),
        ("log_evidence", "ln evidence", "number"),
        ("ess_after", "Effective particles after", "count"),
    ]
    note = "POD: probability of detection inside the area; POC: that the object was inside; POS: that it was found. In order of time."
    return leaves.table_leaf(
        "Sorties, contacts and sensors",
        columns,
        file="sorties.csv",
        where={"scenario": "all"},
        by_time="time",
        note=note,
        unfolded=True,
    )


def _scenarios(updates: Updates) -> Leaf:
    """Return the table of scenarios: the probability of each before and after each update."""
    of_shown = merge_unlikely_scenarios(updates)
    columns = [("", "Scenario", "words"), ("", "Before", "share")]
    columns += [
        ("", f"{notation.day_time(update.time)} {update.name}", "share") for update in of_shown.all
    ]
    rows = [
        [name, float(of_shown.prior[k]), *(float(update.posterior[k]) for update in of_shown.all)]
        for k, name in enumerate(of_shown.scenarios)
    ]
    return leaves.table_leaf(
        "Scenarios", columns, rows=rows, note="Probability of each scenario after each update."
    )
