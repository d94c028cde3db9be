"""The fields of a form, read from the text of a case and written into it.

The text stays the truth: a change of a field keeps all comments, the order and all other keys.
Keys that no field shows stay as they are. After each change the text is parsed again by another
library and compared with what it should be, so a change is made exactly or rejected.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from datetime import date, datetime
from typing import Any

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError

from drift.apps.serve.fields import form_sources, nodes, search_fields, spill_fields
from drift.case.values import fields as case_fields
from drift.case.values import toml_text, units
from geo import notation
from geo.errors import UserError

LARGEST = 2**20  # [bytes] of a text, as of a case
MOST_CHANGES = 100
MOST_SCENARIOS = 50  # that a form shows
STARTS = ("position", "trackline", "area")  # tables of a scenario that say where it went adrift
TOP = ("title", "start", "duration", "particles", "coast.source")
SCENARIO = (
    "name",
    "weight",
    "object",
    "search_object",
    "position.at",
    "position.time",
    "position.error",
    "position.until",
    "trackline.waypoints",
    "trackline.speed",
    "trackline.cross_track",
    "trackline.departure",
    "area.polygon",
    "area.time",
    "area.until",
)
LISTS = ("trackline.waypoints", "area.polygon")
OWN = (*search_fields.TABLES, *search_fields.SINGLE)  # tables of the step "Search"
RELEASE = tuple(name for name in SCENARIO if name.partition(".")[0] in STARTS)  # also of a spill
OF_SPILL = tuple(f"spill.{name}" for name in RELEASE)
IN_SCENARIO = re.compile(r"scenario\.(\d{1,2})\.(.+)")
NUMBERS = ("particles", "weight")
NEW = """\
# Written by the form of drift serve. You can change this text too: both stay in step.
title = "New search"
start = "{start}" # UTC
duration = "24 h"
particles = 100_000

[output]
every = "3 h"

[[scenario]]
name = "last known position"
"""


def new_text(now: np.datetime64) -> str:
    """Return the text of a new case that starts at `now`; it still needs a position and so on."""
    return NEW.format(start=notation.format_dtg(now))


def parse_text(text: str) -> dict[str, Any]:
    """Return the tables of a text; raise UserError, with the line, if it is not TOML."""
    try:
        return toml_text.parse_toml(text)
    except (ValueError, RecursionError) as error:
        raise UserError(f"not valid TOML: {error}") from None


def read_fields(text: str) -> dict[str, Any]:
    """Return what a form shows of a text.

    Args:
        text: text of a case.

    Returns:
        `fields`: by name, such as "scenario.0.position.at", each with its `value`, and `read`, the
        value in SI units, degrees or UTC if it is valid. A field that the form cannot show has
        `in_text` instead. `unknown`: keys that only the text shows. `scenarios`: their number.
        `spill`: whether it is a case of a spill.

    Raises:
        UserError: the text is not TOML.
    """
    data = parse_text(text)
    scenarios = data.get("scenario")
    number = len(scenarios) if isinstance(scenarios, list) else 0
    start = _read("start", data.get("start"), None)
    shown = {name: _shown(data, name, start) for name in names_of_fields(number)}
    spill = data.get("spill")
    unknown = [
        *(
            key
            for key in data
            if key not in {"scenario", "coast", *OWN, *form_sources.SOURCES, *TOP}
        ),
        *_unknown_of_scenarios(scenarios),
        *(_unknown_of_start("spill", spill, RELEASE) if isinstance(spill, dict) else ()),
        *(f"coast.{key}" for key in _keys(data.get("coast")) if key != "source"),
        *(name for name in form_sources.SOURCES if shown[name].get("in_text")),
        *search_fields.hidden_keys(data),
    ]
    return {"fields": shown, "unknown": unknown, "scenarios": number, "spill": "spill" in data}


def names_of_fields(scenarios: int) -> list[str]:
    """Return the names of all fields of a case with so many scenarios."""
    own = (
        f"scenario.{k}.{name}" for k in range(min(scenarios, MOST_SCENARIOS)) for name in SCENARIO
    )
    return [*TOP, *form_sources.SOURCES, *own, *OF_SPILL]


def set_fields(text: str, changes: Sequence[Mapping[str, Any]]) -> str:
    """Return a text with changed fields.

    Args:
        text: text of a case.
        changes: each with a `field` and its new `value`; None removes the key.

    Raises:
        UserError: a field does not exist or is set in the text, a value has another kind, or the
            text is not TOML.
    """

    def work(document: Any, data: dict[str, Any]) -> None:
        for change in changes:
            _change(document, data, change.get("field"), change.get("value"))

    return _changed_text(text, work)


def add_table(text: str, table: str, row: Mapping[str, Any]) -> str:
    """Return a text with one more table of a list of tables, such as "sortie".

    Raises:
        UserError: as `set_fields`.
    """

    def work(document: Any, data: dict[str, Any]) -> None:
        for node in (document, data):
            search_fields.add_row(node, table, deepcopy(row))

    return _changed_text(text, work)


def turn(text: str, spill: bool) -> str:
    """Return the text of a search for one object as that of a spill, or the other way.

    Raises:
        UserError: as `set_fields`, or the case has what the other kind cannot have.
    """
    into = spill_fields.turn_into_spill if spill else spill_fields.turn_into_search

    def work(document: Any, data: dict[str, Any]) -> None:
        for node in (document, data):
            into(node)

    return _changed_text(text, work)


def _changed_text(text: str, work: Callable[[Any, dict[str, Any]], None]) -> str:
    """Return a text after the same work on its document and on its plain tables."""
    data = parse_text(text)
    try:
        document: Any = tomlkit.parse(text)
        work(document, data)
        made = tomlkit.dumps(document)
    except (TOMLKitError, AttributeError, IndexError, KeyError, TypeError) as error:
        raise UserError(
            f"the form cannot make this change ({error}); make it in the text"
        ) from None
    if parse_text(made) != data:
        raise UserError("the form cannot make this change; make it in the text")
    return made


def _change(document: Any, data: dict[str, Any], field: object, value: Any) -> None:
    """Change one field in a document and in the plain tables."""
    if isinstance(field, str) and search_fields.is_field(field):
        search_fields.check_value(field, value)
        search_fields.check_place(data, field)
        for node in (document, data):
            search_fields.set_key(node, field, deepcopy(value))
        return
    if not isinstance(field, str) or (
        field not in {*TOP, *form_sources.SOURCES, *OF_SPILL} and not _is_of_scenario(field)
    ):
        raise UserError(f"there is no field {str(field)[:100]!r}")
    if field in form_sources.SOURCES:
        form_sources.check_source(field, value)
        for node in (document, data):
            form_sources.set_source(node, field, deepcopy(value))
        return
    _check_value(field, value)
    place = search_fields.place_of(field)
    if place[0] == "scenario":
        many = data.get("scenario", [])
        if not isinstance(many, list) or int(place[1]) > len(many):
            raise UserError(f"{field}: there is no such scenario")
        if "spill" in data and not many:
            raise UserError(f"{field}: a spill has no scenario; its place is that of [spill]")
    if place[0] in ("scenario", "spill") and _shown(data, field, None).get("in_text"):
        raise UserError(f"{field} is set in the text; change it there")
    for node in (document, data):
        _set_key(node, place, deepcopy(value))


def _is_of_scenario(field: str) -> bool:
    match = IN_SCENARIO.fullmatch(field)
    return match is not None and match[2] in SCENARIO and int(match[1]) < MOST_SCENARIOS


def _check_value(field: str, value: Any) -> None:
    """Reject a value that a field cannot hold; whether it makes sense, the check says."""
    name = field.rpartition(".")[2]
    if value is None:
        return
    if any(field.endswith(one) for one in LISTS):
        if not isinstance(value, list) or not 1 <= len(value) <= 1000:
            raise UserError(f"{field}: give a list of positions")
        values = value
    elif name in NUMBERS and isinstance(value, int | float) and not isinstance(value, bool):
        if not abs(value) < 1e15:  # neither is NaN
            raise UserError(f"{field}: {value} is too large a number")
        return
    else:
        values = [value]
    for one in values:
        search_fields.check_words(field, one)


def _set_key(node: Any, place: search_fields.Place, value: Any) -> None:
    """Set or remove one key of the tables, or of a document of tomlkit with its comments."""
    *above, last = place
    if place[0] == "scenario":
        _set_key_of_scenario(node, int(place[1]), place[2:], value)
        return
    if place[0] == "spill":
        if value is not None:
            spill_fields.clear_other_starts(node["spill"], str(place[1]))
        _set_key_of_start(node["spill"], node, place[1:], value)
        return
    for part in above:
        if part not in node:
            if value is None:
                return
            node[part] = nodes.table_beside(node, value={})
        node = node[part]
    nodes.put(node, last, value)


def _set_key_of_scenario(node: Any, number: int, rest: search_fields.Place, value: Any) -> None:
    many = node.get("scenario")
    if many is None:
        many = node["scenario"] = nodes.list_of_tables(node)
    if number == len(many):
        made = nodes.table_beside(node, {}, inline=False)
        many.append(made)
    one = many[number]
    if len(rest) == 1:
        nodes.put(one, rest[0], value)
        return
    if value is not None:  # it went adrift in one way only
        for other in STARTS:
            if other != rest[0] and other in one:
                del one[other]
    _set_key_of_start(one, node, rest, value)


def _set_key_of_start(one: Any, node: Any, rest: search_fields.Place, value: Any) -> None:
    """Set or remove a key of the table that says where a scenario or a spill went adrift."""
    start, key = rest
    if start not in one:
        if value is None:
            return
        one[start] = nodes.table_beside(node, {})
    nodes.put(one[start], key, value)
    if not one[start]:
        del one[start]


def _keys(table: Any) -> list[str]:
    return list(table) if isinstance(table, dict) else []


def _unknown_of_scenarios(scenarios: Any) -> list[str]:
    """Return the keys of scenarios that no field shows."""
    if not isinstance(scenarios, list):
        return [] if scenarios is None else ["scenario"]
    found = []
    for k, one in enumerate(scenarios):
        found += _unknown_of_start(f"scenario.{k}", one, SCENARIO)
        found += [f"scenario.{k}.{key}" for key in _keys(one) if key not in {*SCENARIO, *STARTS}]
    return found


def _unknown_of_start(place: str, one: Any, names: Sequence[str]) -> list[str]:
    """Return the keys of the tables that say where it went adrift that no field shows."""
    found = []
    for start in (key for key in _keys(one) if key in STARTS):
        if not isinstance(one[start], dict):
            found.append(f"{place}.{start}")
        found += [
            f"{place}.{start}.{part}"
            for part in _keys(one[start])
            if f"{start}.{part}" not in names
        ]
    return found


def _shown(data: Any, field: str, start: Any) -> dict[str, Any]:
    """Return what a form shows of a field."""
    if field in form_sources.SOURCES:
        many = data.get(field)
        return (
            {"in_text": True}
            if (own := form_sources.read_source(many, field)) is None
            else {"value": own or None}
        )
    value = data
    for part in search_fields.place_of(field):
        if isinstance(value, list) and isinstance(part, int):
            value = value[part] if part < len(value) else None
        elif isinstance(value, dict):
            value = value.get(part)
        elif value is not None:
            return {"in_text": True}
    if isinstance(value, datetime | date):
        value = value.isoformat()
    name = field.rpartition(".")[2]
    read = None if value is None else _read(name, value, start)
    if name == "at" and read is not None and not isinstance(value, str):
        value = notation.position(*read)
    if isinstance(value, list) and any(field.endswith(one) for one in LISTS):
        if read is not None:
            value = [
                one if isinstance(one, str) else notation.position(*at)
                for one, at in zip(value, read, strict=True)
            ]
        elif not all(isinstance(one, str) for one in value):
            return {"in_text": True}
    elif isinstance(value, bool) or not (value is None or nodes.plain(value)):
        return {"in_text": True}
    return {"value": value} if read is None else {"value": value, "read": read}


def _time(value: Any, start: Any) -> str:
    instant = units.time(value)
    if isinstance(instant, np.timedelta64):
        instant = np.datetime64(start.rstrip("Z"), "s") + instant
    return f"{instant}Z"


def _length(value: Any) -> float:
    return units.quantity(value, "m", "distance", "5 nmi")


def _position(value: Any) -> list[float]:
    return list(units.position(value))


READ: dict[str, Callable[[Any, Any], Any]] = {
    "at": lambda value, start: _position(value),
    "waypoints": lambda value, start: [_position(one) for one in value],
    "polygon": lambda value, start: [_position(one) for one in value],
    "start": _time,
    "time": _time,
    "departure": _time,
    "until": _time,
    "error": lambda value, start: _length(value),
    "cross_track": lambda value, start: _length(value),
    "duration": lambda value, start: case_fields.interval(value),
}


def _read(name: str, value: Any, start: Any) -> Any:
    """Return a value in SI units, degrees or UTC; None if it is invalid or is not read."""
    if name not in READ or value is None:
        return None
    try:
        return READ[name](value, start)
    except (ValueError, TypeError, AttributeError, OverflowError):
        return None
