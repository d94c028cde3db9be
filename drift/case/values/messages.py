"""Convert pydantic's validation errors to messages for the author of a case file."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

LONGEST = 200  # longest name that a message shows in full


def lines(error: ValidationError, data: Mapping[str, Any]) -> tuple[str, ...]:
    """Return one line per error: 'scenario "raft".position.at: what is wrong'.

    Args:
        error: pydantic's error.
        data: the case file's tables as read, from which the names of scenarios and sources come.
    """
    complaints = []
    for mistake in error.errors(include_url=False):
        place, what = where(mistake["loc"], data), _message_of(mistake)
        if (
            mistake["type"] == "list_type"
            and isinstance(mistake["input"], Mapping)
            and mistake["loc"]
        ):
            what = f"must be a list of tables, [[{mistake['loc'][-1]}]] in place of [{mistake['loc'][-1]}]; given one table"
        complaints.append(f"{place}: {what}" if place else what)
    return tuple(complaints)


def where(loc: Sequence[int | str], data: Any) -> str:
    """Return a place in the case file as text; list items appear by name, else by number.

    Args:
        loc: keys and list indices from the top of the file.
        data: the case file's tables as read.
    """
    place, value = "", data
    for part in loc:
        value = _inside(value, part)
        if isinstance(part, int):
            name = value.get("name") if isinstance(value, Mapping) else None
            place += (
                f' "{name if len(name) <= LONGEST else f"{name[:40]}..."}"'
                if isinstance(name, str)
                else f" {part + 1}"
            )
        else:
            place += f".{part}" if place else part
    return place


def _inside(value: Any, part: int | str) -> Any:
    try:
        return value[part]
    except (KeyError, IndexError, TypeError):
        return None


def _message_of(complaint: Mapping[str, Any]) -> str:
    kind, context = complaint["type"], complaint.get("ctx", {})
    if kind == "value_error":
        return str(context["error"])
    if kind == "missing":
        return "is missing and has no default"
    try:
        given = repr(complaint["input"])
    except ValueError:  # Python spells no whole number of more than 4300 digits
        given = "a number of too many digits"
    given = given if len(given) <= 60 else given[:57] + "..."
    if kind == "literal_error":
        return f"{given} is not allowed; write {context['expected']}"
    message = complaint["msg"].replace("Input should be", "must be")
    return f"{message[0].lower()}{message[1:]}; given {given}"
