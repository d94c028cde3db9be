"""What the warm process answers about the searches of a text: fields, patterns and contacts.

The patterns are those of the program itself: the page draws them and derives none. A row with a
mistake has no shapes; the others are drawn without it.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drift.apps.serve.fields import form, mistakes, search_fields
from drift.case import file as case_file
from drift.case.record import Case
from drift.evidence.filter import shapes
from drift.evidence.filter.detection import laws, sweep_width
from drift.evidence.filter.records import Sortie
from geo import notation, polyline
from geo.array import Array
from geo.errors import UserError
from geo.notation import NMI

OF_ROW = re.compile(r"(sortie|contact|unit|find|patrol|patrol_unit)\.(\d+)(?:\.|$)")
DIGITS = 5  # of a degree: a metre


def search(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the searches of a text, and what a map shows of them.

    Args:
        request: `text` of a case, and its `path`.

    Returns:
        What `search_fields.read_rows` returns, and `shapes`: of each sortie, contact and base of a
        unit by its number in the text, if the case can be read; `search_objects` of the sweep
        width tables.
    """
    path, text = Path(request["path"]), request["text"]
    data = form.parse_text(text)
    told = search_fields.read_rows(data)
    found: dict[str, dict[int, Any]] = {"sortie": {}, "contact": {}, "unit": {}}
    case = readable_case(path, text)
    if case is not None:
        numbers = {table: _numbers(data, table) for table in found}
        for sortie in case.sorties:
            found["sortie"][numbers["sortie"][sortie.name]] = sortie_shapes(sortie)
        for contact in case.contacts:
            if contact.name in numbers["contact"]:  # one of a series has another name
                found["contact"][numbers["contact"][contact.name]] = [
                    {"shape": kind, "points": _points(points)}
                    for kind, points in shapes.contact(contact)
                ]
        for unit in case.units:
            found["unit"][numbers["unit"][unit.name]] = _points(np.array(unit.base))
    return {**told, "shapes": found, "search_objects": list(sweep_width.objects())}


def readable_case(path: Path, text: str) -> Case | None:
    """Return the case of a text without the rows that have mistakes; None if it has others."""
    try:
        return case_file.load_text(path, text)
    except UserError as error:
        rows = set()
        for line in error.lines:
            message = mistakes.message_of(line.removeprefix(f"{path.name}: "), text)
            row = OF_ROW.match(message["field"] or "")
            if row is None:
                return None
            rows.add((row[1], int(row[2])))
    gone = [{"field": f"{table}.{k}", "value": None} for table, k in sorted(rows, reverse=True)]
    try:
        return case_file.load_text(path, form.set_fields(text, gone))
    except UserError:
        return None


def _numbers(data: Mapping[str, Any], table: str) -> dict[str, int]:
    """Return the number of each row by its name."""
    rows = data.get(table, [])
    return {
        str(row.get("name", f"{table} {k + 1}")): k
        for k, row in enumerate(rows)
        if isinstance(row, dict)
    }


def sortie_shapes(sortie: Sortie) -> dict[str, Any]:
    """Return the outline and legs of a sortie, its times, its track and its POD."""
    outline = shapes.searched(sortie)
    track = 0.0
    if sortie.legs is not None:
        track = float(polyline.lengths(sortie.legs)[np.array(sortie.legs.searching)].sum())
    return {
        "outline": None if outline is None else _points(outline),
        "legs": [
            {"searching": bool(searching), "points": _points(points)}
            for searching, points in shapes.flown(sortie)
        ],
        "start": f"{sortie.start.astype('datetime64[s]')}Z",
        "end": f"{sortie.end.astype('datetime64[s]')}Z",
        "period": f"{notation.format_dtg(sortie.start)} to {notation.format_dtg(sortie.end)}",
        "track_nmi": round(track / NMI, 1),
        "legs_number": 0 if sortie.legs is None else len(sortie.legs.searching),
        "pod": _pod(sortie),
    }


def _pod(sortie: Sortie) -> float | None:
    """Return the POD of a sortie's effort in its area, in the first scenario; None: not known."""
    if sortie.coverage:
        coverage = sortie.coverage[0]
    elif np.isfinite(sortie.spacing) and sortie.spacing > 0 and np.isfinite(sortie.sweep_width[0]):
        coverage = sortie.sweep_width[0] / sortie.spacing
    else:
        return None
    return round(float(laws.pod(sortie.law, coverage)), 4)


def _points(points: Array) -> list[Any]:
    rounded: list[Any] = np.round(points, DIGITS).tolist()
    return rounded
