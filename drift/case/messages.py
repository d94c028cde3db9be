"""What pydantic found wrong in a case file, as lines for the person who wrote it."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError


def lines(error: ValidationError, data: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the complaints as 'scenario "raft".position.at: what is wrong', a line each.

    data: the case file's tables as read, so that scenarios and sources are called by their names.
    """
    told = []
    for found in error.errors(include_url=False):
        place, what = where(found["loc"], data), _what(found)
        told.append(f"{place}: {what}" if place else what)
    return tuple(told)


def where(loc: Sequence[int | str], data: Any) -> str:
    """Return a place in the case file: names instead of positions in a list where there are names."""
    place, here = "", data
    for part in loc:
        here = _inside(here, part)
        if isinstance(part, int):
            name = here.get("name") if isinstance(here, Mapping) else None
            place += f' "{name}"' if isinstance(name, str) else f" {part + 1}"
        else:
            place += f".{part}" if place else part
    return place


def _inside(here: Any, part: int | str) -> Any:
    try:
        return here[part]
    except (KeyError, IndexError, TypeError):
        return None


def _what(complaint: Mapping[str, Any]) -> str:
    kind, context = complaint["type"], complaint.get("ctx", {})
    if kind == "value_error":
        return str(context["error"])
    if kind == "missing":
        return "is missing and has no default"
    given = repr(complaint["input"])
    given = given if len(given) <= 60 else given[:57] + "..."
    if kind == "literal_error":
        return f"{given} is not allowed; write {context['expected']}"
    message = complaint["msg"].replace("Input should be", "must be")
    return f"{message[0].lower()}{message[1:]}; given {given}"
