"""A plain case, a raft in a steady current, of which a test states only what it is about.

Tests of the text of a case file itself (places in messages, comments, order) write their own text.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import drift

PLAIN: dict[str, Any] = {
    "title": "trial",
    "start": "2026-11-21T00:00Z",
    "duration": "6 h",
    "particles": 500,
    "coast": {"source": "none"},
    "current": {"constant": {"speed": "0.5 kn", "toward": 90}},
}
RAFT = {
    "name": "raft",
    "object": "water",
    "position": {"at": "27 30N 088 00W", "std": "1 nmi"},
}
REPEATED = ("current", "wind", "scenario")  # in double brackets, also where there is one


def text(*more: str, **tables: Any) -> str:
    """Return the text of the plain case with other keys and tables.

    Args:
        *more: text at the end, after the tables.
        **tables: keys and tables in place of the plain ones; None leaves one out. Keys of a
            `scenario` stand beside those of the raft.
    """
    scenario = tables.pop("scenario", {})
    if isinstance(scenario, Mapping):
        scenario = {key: one for key, one in {**RAFT, **scenario}.items() if one is not None}
    case = {**PLAIN, **tables, "scenario": scenario}
    keys, ends = [], []
    for key, value in case.items():
        if value is None:
            continue
        several = value if isinstance(value, list) else [value]
        if not several or not isinstance(several[0], Mapping):
            keys.append(f"{key} = {_value(value)}")
            continue
        brackets = "[[{}]]" if several is value or key in REPEATED else "[{}]"
        for table in several:
            ends += [brackets.format(key), *_rows(table)]
    return "\n".join([*keys, *ends, *more, ""])


def write(folder: Path, *more: str, **tables: Any) -> Path:
    """Write the plain case with other keys and tables into a folder; return its path."""
    path = folder / "case.toml"
    path.write_text(text(*more, **tables), encoding="utf-8")
    return path


def load(folder: Path, *more: str, **tables: Any) -> drift.Case:
    """Return the plain case with other keys and tables, in a file of a folder."""
    return drift.load(write(folder, *more, **tables))


def _rows(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(key)} = {_value(value)}" for key, value in table.items()]


def _key(key: str) -> str:
    return key if key.isascii() and key.replace("-", "_").isidentifier() else json.dumps(key)


def _value(value: Any) -> str:
    """Return a value as TOML."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_rows(value)) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, bool | int | float):
        return str(value).lower()
    return json.dumps(str(value), ensure_ascii=False)
