"""A form changes the text of a case (tomlkit) and its plain tables in the same way."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import tomlkit

LARGEST = 2**63  # whole numbers of TOML are smaller


def plain(value: Any) -> bool:
    """Return whether a form can show a value: text, a flag, or a number that JSON can hold."""
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, str) or (isinstance(value, int) and abs(value) < LARGEST)


def put(table: Any, key: str | int, value: Any) -> None:
    """Set a key, or remove it if the value is None."""
    if value is None:
        if key in table:
            del table[key]
    else:
        table[key] = value


def table_beside(beside: Any, value: Mapping[str, Any], inline: bool = True) -> Any:
    """Return a table of the kind of the node beside it: of tomlkit, or a dict."""
    if type(beside) is dict:
        return dict(value)
    made: Any = tomlkit.inline_table() if inline else tomlkit.table()
    made.update(value)
    return made


def list_of_tables(beside: Any) -> Any:
    """Return an empty list of tables, [[...]]."""
    return [] if type(beside) is dict else tomlkit.aot()


def rows_beside(beside: Any, rows: Sequence[Mapping[str, Any]]) -> Any:
    """Return a list with one row per line."""
    if type(beside) is dict:
        return [dict(row) for row in rows]
    made = tomlkit.array()
    for row in rows:
        made.append(table_beside(beside, row))
    return made.multiline(True)


def begin_after_blank_line(table: Any) -> None:
    """Have a new table of a document begin after a blank line."""
    if isinstance(table, tomlkit.items.Table):
        table.trivia.indent = "\n"
