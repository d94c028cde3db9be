"""The wind and the current of a form: one source each, as reported, by time or from files."""

from collections.abc import Mapping
from datetime import date, datetime
from typing import Any

import tomlkit

from drift.apps.serve.fields import nodes, search_fields
from geo.errors import UserError

SOURCES = {"wind": "from", "current": "toward"}  # and the key of their direction
KINDS = ("constant", "table", "files")
READING = ("variables", "depth", "times")  # how files are read, as `drift fetch` writes it
# errors of typed winds and currents, which have none by default (docs/errors.md)
TYPED = {
    "current": {"std": "0.3 m/s", "time": "11 h"},
    "wind": {"std": "2 m/s", "time": "12 h"},
}
TYPED_NOTE = "how wrong what was typed may be (docs/errors.md)"


def check_source(field: str, value: Any) -> None:
    """Reject a wind or current that is not one of a form."""
    if value is None:
        return
    if not isinstance(value, dict) or value.get("kind") not in KINDS:
        raise UserError(f"{field}: give its kind: {', '.join(KINDS)}")
    kind = value["kind"]
    direction = SOURCES[field]
    rows = [value] if kind == "constant" else value.get("rows" if kind == "table" else "files")
    if not isinstance(rows, list) or not 1 <= len(rows) <= 500:
        raise UserError(f"{field}: give 1 to 500 {'rows' if kind == 'table' else 'files'}")
    for row in rows:
        if kind == "files":
            search_fields.check_words(field, row)
            continue
        wanted = {"speed", direction} | ({"time"} if kind == "table" else {"kind"})
        if not isinstance(row, dict) or row.keys() != wanted:
            raise UserError(f"{field}: give {' and '.join(sorted(wanted - {'kind'}))}")
        for name in ("speed", "time"):
            if name in wanted:
                search_fields.check_words(f"{field}.{name}", row[name])
        _check_direction(f"{field}.{direction}", row[direction])


def _check_direction(field: str, value: Any) -> None:
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e6:
        return
    search_fields.check_words(field, value)


def set_source(node: Any, quantity: str, value: Any) -> None:
    """Set the one source of a quantity, and the default errors of typed ones."""
    check_free(node, quantity)
    many = node.get(quantity)
    if value is None:
        node.pop(quantity, None)
        _set_typed_error(node, quantity, False)
        return
    kind = value.pop("kind")
    written = value if kind == "constant" else value["rows" if kind == "table" else "files"]
    if not many:
        if many is not None:
            del node[quantity]
        many = node[quantity] = nodes.list_of_tables(node)
        many.append(nodes.table_beside(node, {}, inline=False))
        many[0]["name"] = "forecast" if kind == "files" else "on scene"
    one = many[0]
    before = _files_of(one)
    for old in KINDS:
        if old != kind and old in one:
            del one[old]
    if kind != "files" or not set(before) & set(written):  # no file is left that they are of
        for key in READING:
            nodes.put(one, key, None)
    if kind == "table":
        written = nodes.rows_beside(node, written)
    elif kind == "constant":
        written = nodes.table_beside(node, written)
    elif len(written) == 1:
        written = written[0]
    one[kind] = written
    _set_typed_error(node, quantity, kind != "files")


def check_free(node: Any, quantity: str) -> None:
    """Reject a change of a source that only the text shows."""
    many = node.get(quantity)
    if many is not None and read_source(many, quantity) is None:
        raise UserError(f"{quantity} is set in the text; change it there")


def put_files(node: Any, quantity: str, table: Mapping[str, Any]) -> None:
    """Set the one source of a quantity to files, with how they are read."""
    set_source(node, quantity, {"kind": "files", "files": [table["files"]]})
    one = node[quantity][0]
    one["name"] = table["name"]
    for key in READING:
        value = table.get(key)
        nodes.put(one, key, nodes.table_beside(node, value) if isinstance(value, dict) else value)


def _files_of(one: Any) -> list[Any]:
    written = one.get("files", [])
    return written if isinstance(written, list) else [written]


def _set_typed_error(node: Any, quantity: str, typed: bool) -> None:
    """State the error of what is typed, unless the text states one; files have defaults."""
    errors = node.get("uncertainty")
    if typed and errors is None:
        errors = node["uncertainty"] = nodes.table_beside(node, {}, inline=False)
        if isinstance(errors, tomlkit.items.Table):
            errors.comment(TYPED_NOTE)
    if not isinstance(errors, dict):
        return
    if typed and quantity not in errors:
        errors[quantity] = nodes.table_beside(node, TYPED[quantity])
    elif not typed and errors.get(quantity) == TYPED[quantity]:
        del errors[quantity]
        if not errors:
            del node["uncertainty"]


def read_source(many: Any, quantity: str) -> dict[str, Any] | None:
    """Return the one source of a quantity as a form shows it, {} for none; None: only as text."""
    if not many and isinstance(many, list | None):
        return {}
    if not isinstance(many, list) or len(many) != 1 or not isinstance(many[0], dict):
        return None
    one, direction = many[0], SOURCES[quantity]
    kinds = [kind for kind in KINDS if kind in one]
    allowed = {"name", *kinds, *(READING if kinds == ["files"] else ())}
    if len(kinds) != 1 or not one.keys() <= allowed:
        return {} if one.keys() <= {"name"} else None
    kind = kinds[0]
    written = one[kind]
    if kind == "files":
        files = _files_of(one)
        if not isinstance(files, list) or not all(isinstance(file, str) for file in files):
            return None
        return {"kind": kind, "files": [str(file) for file in files]}
    rows = [written] if kind == "constant" else written
    wanted = {"speed", direction} | ({"time"} if kind == "table" else set())
    if not isinstance(rows, list) or not all(
        isinstance(row, dict) and row.keys() == wanted for row in rows
    ):
        return None
    shown = [{name: _plain(row[name]) for name in sorted(wanted)} for row in rows]
    if not all(nodes.plain(value) for row in shown for value in row.values()):
        return None
    return {"kind": kind, **shown[0]} if kind == "constant" else {"kind": kind, "rows": shown}


def _plain(value: Any) -> Any:
    return value.isoformat() if isinstance(value, datetime | date) else value
