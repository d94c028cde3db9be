"""Mistakes of a case, each with its line in the text and the field of the form that it is about."""

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any

from drift.apps.serve.fields import form, form_sources, search_fields
from drift.case.values import messages
from geo.errors import UserError

HEADER = re.compile(r"\s*\[(\[?)\s*([\w.\"' -]+?)\s*\]?\]\s*(#.*)?$")
KEY = re.compile(r"\s*([\w.\"'-]+(?:\s*\.\s*[\w\"'-]+)*)\s*=")
NO_PLACE = "the place is missing: type it, or press the button and click on the map"
# what a message about a whole scenario asks for, the field for it, and its words in the form
MISSING = {
    ": object is missing": ("object", "what is adrift is missing: choose it in the list"),
    "exactly one of position": (
        "position.at",
        NO_PLACE,
    ),
}
# what a message asks for that has fields of its own, the field, and its words in the form
FORCING = {
    "has no current: add": (
        "current",
        "the current is missing: choose how you know it, and type it",
    ),
    "with the wind and there is none": (
        "wind",
        "the wind is missing: choose how you know it, and type it",
    ),
}
EMPTY = re.compile(r'"" is not a time;.*')
NO_TIME = "the time is missing: type it like 211830ZNOV26, or like +6 h (after the start)"
EMPTY_PLACE = re.compile(r'position "" is empty;.*')
UNSET = ("is missing and has no default", "is missing: type it")
LINE = re.compile(r"\(?at line (\d+), column \d+\)?")


def message_of(line: str, text: str) -> dict[str, Any]:
    """Return a mistake with the line of the text and the field of the form that it is about.

    What is missing is put in the words of the form, which knows no tables and no TOML.
    """
    if found := LINE.search(line):
        return {"message": line, "line": int(found[1]), "field": None}
    try:
        fields, places = _fields_and_lines(text)
    except UserError:
        return {"message": line, "line": None, "field": None}
    field = fields.get(_longest(line, fields))
    message = EMPTY_PLACE.sub(NO_PLACE, EMPTY.sub(NO_TIME, line)).replace(*UNSET)
    for words, (own, plain) in MISSING.items():
        if field and words in line:
            field, message = f"{field}.{own}", plain
    for words, (own, plain) in FORCING.items():
        if words in line:
            field, message = own, plain
    return {"message": message, "line": places.get(_longest(line, places)), "field": field}


@lru_cache(maxsize=1)
def _fields_and_lines(text: str) -> tuple[dict[str, str], dict[str, int]]:
    """Return the fields of a text and the lines of its tables and keys, by how messages name them.

    A text has many mistakes, and parsing the largest takes a second.
    """
    data = form.parse_text(text)
    number = len(data["scenario"]) if isinstance(data.get("scenario"), list) else 0
    names = [*form.names_of_fields(number), *search_fields.names_of(data)]
    fields = {messages.where(search_fields.place_of(name), data): name for name in names}
    # the tables that fields are in, such as a scenario or its position
    for name in list(fields.values()):
        place = search_fields.place_of(name)
        for size in range(len(place) - 1, 0, -1):
            fields.setdefault(messages.where(place[:size], data), ".".join(map(str, place[:size])))
    for quantity in form_sources.SOURCES:
        for k, _ in enumerate(data.get(quantity) or [()]):
            fields[messages.where((quantity, k), data)] = quantity
    places = {messages.where(place, data): k for place, k in _lines_of_places(text)}
    return fields | _fields_by_other_words(data), places


def _fields_by_other_words(data: Mapping[str, Any]) -> dict[str, str]:
    """Return the fields that messages about a spill name in words of their own."""
    finds = search_fields.rows_of(data, "find")
    words = {"spill.objects": "spill.class.0.number"}
    words |= {"[spill] track": "spill.track", "[spill] loss": "spill.loss.0.begin"}
    for k, find in enumerate(finds if isinstance(finds, list) else ()):
        if isinstance(find, dict):
            words[str(find.get("name", f"find {k + 1}"))] = f"find.{k}"
    return words


def _longest(line: str, places: Mapping[str, Any]) -> str:
    """Return the longest place that a message begins with."""
    begun = (
        one for one in places if line.startswith(one) and line[len(one) : len(one) + 1] in ":. "
    )
    return max(begun, key=len, default="")


def _lines_of_places(text: str) -> Iterator[tuple[search_fields.Place, int]]:
    """Yield the keys and list indices of tables and keys, each with its line from 1.

    Lines inside texts of several lines may be taken for keys, as only messages depend on it.
    """
    counts: dict[str, int] = {}
    above: search_fields.Place = ()
    for k, line in enumerate(text.split("\n"), 1):
        if header := HEADER.match(line):
            names = [part.strip(" \"'") for part in header[2].split(".")]
            dotted = ".".join(names)
            if header[1]:
                counts[dotted] = counts.get(dotted, -1) + 1
            above = ()
            for size, name in enumerate(names, 1):
                number = counts.get(".".join(names[:size]))
                above += (name,) if number is None else (name, number)
            yield above, k
        elif key := KEY.match(line):
            yield (*above, *(part.strip(" \"'") for part in key[1].split("."))), k
