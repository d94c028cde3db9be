"""The fields of a spill: its release, classes, losses along a track, finds, patrols and teams.

`drift.apps.serve.fields.search_fields` reads and writes them as all rows of a form. Here stands what
is special: a class has a number of objects in place of a share, the points of a ship's track are
lines of text, and the place of an object that is sought can become that of a release.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from drift.apps.serve.fields import nodes
from geo import notation
from geo.errors import UserError

KEYS = (
    "objects",
    "track",
    "ship",
    "clock_error",
    "release_std",
    "release_duration",
    "destroyed",
    "windage_bias",
    "worlds",
    "stretches.length",
    "reporting.until",
)
TABLES: dict[str, tuple[str, ...]] = {
    "spill.class": (
        "name",
        "number",
        "object",
        "object.immersion",
        "sinking.half_life",
        "sinking.waterlogged",
        "sinking.spread",
    ),
    "spill.loss": ("begin", "length", "share"),
    "find": (
        "name",
        "at",
        "stretch",
        "time",
        "by_time",
        "at_sea",
        "radius",
        "class",
        "by",
        "false",
    ),
    "patrol": ("name", "stretches", "between", "time", "detection"),
    "patrol_unit": (
        "name",
        "base",
        "reach",
        "stretches",
        "crosses_water",
        "length",
        "detection",
        "first",
        "days",
    ),
}
# values that may be [lowest, highest]
RANGES = (
    "spill.objects",
    "spill.destroyed",
    "spill.class.number",
    "spill.class.object.immersion",
    "spill.class.sinking.half_life",
    "spill.class.sinking.waterlogged",
    "spill.loss.begin",
    "spill.loss.length",
)
STARTS = ("position", "trackline", "area", "track")  # that say where a spill went adrift
OF_TRACK = ("track", "ship", "clock_error", "loss")
DIGITS = 6  # of a share that is computed from numbers
# what a case of the other kind cannot have, and in what words
OF_SEARCH = {"family": "families", "sortie": "sorties", "contact": "contacts", "unit": "units"}
OF_SPILL = {"find": "finds", "patrol": "patrols", "patrol_unit": "teams"}
FIRST_CLASS = {"name": "container", "object": {"immersion": [0.6, 0.9]}}
MADE = {"worlds": 1000, "windage_bias": 0.3}  # of a new spill
TITLES = ("New search", "New spill")  # of new cases


def shares_of_classes(rows: Sequence[Any]) -> list[float] | None:
    """Return the shares of all classes; None if they cannot be read as numbers."""
    given = [row.get("share") if isinstance(row, Mapping) else None for row in rows]
    known = [one for one in given if one is not None]
    if not rows or not all(_is_number(one) for one in known):
        return None
    missing = len(given) - len(known)
    left = max(0.0, 1 - sum(known)) / max(missing, 1)
    return [left if one is None else float(one) for one in given]


def numbers_of_classes(spill: Any) -> list[Any]:
    """Return the number of objects of each class: one, [fewest, most], or None if unknown."""
    rows = spill.get("class") if isinstance(spill, Mapping) else None
    if not isinstance(rows, list):
        return []
    pair = _pair_of(spill.get("objects"))
    shares = shares_of_classes(rows)
    if pair is None or shares is None:
        return [None] * len(rows)
    return [_one_or_two([round(share * one) for one in pair]) for share in shares]


def set_number(node: Any, number: int, value: Any) -> None:
    """Set how many objects of a class were lost: the number of all, and the shares of all classes.

    Args:
        node: tables of a case, or a document of tomlkit.
        number: of the class.
        value: one number, or [fewest, most]; None: unknown, which only a first class can be.

    Raises:
        UserError: the value is no number of objects.
    """
    spill = node["spill"]
    rows = spill["class"]
    before = [_pair_of(one) or [0, 0] for one in numbers_of_classes(spill)]
    if value is None:
        before[number] = [0, 0]
    else:
        pair = _pair_of(value)
        if pair is None or not 0 <= pair[0] <= pair[1]:
            raise UserError(
                f"spill.class.{number}.number: {_spelled(value)} is no number of objects; write it "
                'like 120, or "100 to 140"'
            )
        before[number] = pair
    total = [sum(column) for column in zip(*before, strict=True)]
    if total[1] <= 0:
        nodes.put(spill, "objects", None)
        return
    spill["objects"] = _one_or_two(total)
    if len(rows) == 1:
        nodes.put(rows[0], "share", None)
        return
    for row, pair in zip(rows, before, strict=True):
        row["share"] = round(sum(pair) / sum(total), DIGITS)


def add_class(node: Any, made: Any) -> None:
    """Add a class of no objects yet; those before it keep their numbers, in place."""
    rows = node["spill"]["class"]
    shares = shares_of_classes(rows)
    if rows and shares is not None:
        for row, share in zip(rows, shares, strict=True):
            row["share"] = round(share, DIGITS)
        made["share"] = 0
    rows.append(made)


def remove_class(node: Any, number: int) -> None:
    """Remove a class; the others keep their numbers of objects, in place."""
    kept = numbers_of_classes(node["spill"])
    del kept[number], node["spill"]["class"][number]
    if len(kept) and None not in kept:
        set_number(node, 0, kept[0])


def _pair_of(value: Any) -> list[int] | None:
    """Return whole numbers [fewest, most]; None if a value is neither one nor two of them."""
    pair = value if isinstance(value, list) else [value, value]
    if len(pair) != 2 or not all(_is_number(one) and one == round(one) for one in pair):
        return None
    return [int(one) for one in pair]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9


def _one_or_two(pair: Sequence[int]) -> Any:
    return pair[0] if pair[0] == pair[1] else list(pair)


def _spelled(value: Any) -> str:
    return " to ".join(map(str, value)) if isinstance(value, list) else repr(value)


def shown_track(value: Any) -> Any:
    """Return a ship's track as a form shows it: its file, or a line "position, time" a point."""
    if isinstance(value, str):
        return value
    if not isinstance(value, list):
        return None
    lines = []
    for point in value:
        if not isinstance(point, Mapping) or not point.keys() <= {"at", "time"}:
            return None
        at, time = point.get("at", ""), point.get("time", "")
        if not isinstance(at, str):
            try:
                at = notation.position(*at)
            except (TypeError, ValueError):
                return None
        lines.append(f"{at}, {time.isoformat() if hasattr(time, 'isoformat') else time}")
    return lines


def written_track(beside: Any, value: Any) -> Any:
    """Return a ship's track as the case has it."""
    if not isinstance(value, list):
        return value
    points = [[part.strip() for part in line.rpartition(",")] for line in value]
    rows = [{"at": at, "time": time} if comma else {"at": time} for at, comma, time in points]
    return nodes.rows_beside(beside, rows)


def clear_other_starts(spill: Any, start: str) -> None:
    """Remove what says in another way where a spill went adrift."""
    for other in STARTS:
        if other != start and other in spill:
            for key in OF_TRACK if other == "track" else (other,):
                nodes.put(spill, key, None)
    if start == "track":
        nodes.put(spill, "release_duration", None)


def turn_into_spill(node: Any) -> None:
    """Turn a search for one object into a spill, with its place, in place.

    Raises:
        UserError: the case has what a spill cannot have.
    """
    scenarios = node.get("scenario", [])
    if "spill" in node:
        raise UserError("this case is a spill already")
    _check_simple(node, OF_SEARCH, "a spill")
    if not isinstance(scenarios, list) or len(scenarios) > 1:
        raise UserError("a case with several scenarios cannot become a spill; begin a new case")
    one = dict(scenarios[0]) if scenarios else {}
    more = sorted(one.keys() - {"name", "object", "weight", *STARTS[:3]})
    if more:
        raise UserError(
            f"scenario.0.{more[0]} has no place in a spill; remove it in the text first"
        )
    kind = {"name": "cargo", "object": one["object"]} if "object" in one else FIRST_CLASS
    starts = {start: one[start] for start in STARTS if start in one}
    for key in ("scenario", "particles"):
        nodes.put(node, key, None)
    _change_title(node, *TITLES)
    made = node["spill"] = nodes.table_beside(node, {**MADE, **starts}, inline=False)
    made["class"] = nodes.list_of_tables(node)
    made["class"].append(_with_inline_tables(node, kind))


def turn_into_search(node: Any) -> None:
    """Turn a spill into the search for one object, with its place, in place.

    Raises:
        UserError: the case has what a search cannot have.
    """
    spill = node.get("spill")
    if not isinstance(spill, Mapping):
        raise UserError("this case is no spill")
    _check_simple(node, OF_SPILL, "a search for one object")
    kinds = spill.get("class", [])
    if len(kinds) > 1 or "track" in spill:
        what = "several classes" if len(kinds) > 1 else "a ship's track"
        raise UserError(f"a spill with {what} cannot become a search; begin a new case")
    one: dict[str, Any] = {"name": "last known position"}
    if kinds and isinstance(kinds[0].get("object"), str):
        one["object"] = kinds[0]["object"]
    one |= {start: spill[start] for start in STARTS if start in spill}
    del node["spill"]
    _change_title(node, *reversed(TITLES))
    node["scenario"] = nodes.list_of_tables(node)
    node["scenario"].append(_with_inline_tables(node, one))


def _change_title(node: Any, old: str, new: str) -> None:
    """Change the title that a new case has."""
    if node.get("title") == old:
        node["title"] = new


def _check_simple(node: Any, rows: Mapping[str, str], into: str) -> None:
    found = [words for key, words in rows.items() if key in node]
    if found:
        raise UserError(
            f"the case has {' and '.join(found)}, which {into} cannot have: remove them first, or "
            "begin a new case"
        )


def _with_inline_tables(beside: Any, row: Mapping[str, Any]) -> Any:
    """Return a table whose inner tables are inline."""
    made = nodes.table_beside(beside, {}, inline=False)
    for key, one in row.items():
        made[key] = nodes.table_beside(beside, one) if isinstance(one, Mapping) else one
    return made
