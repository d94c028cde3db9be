"""Check the other tables of a case that has invalid ones, so that all errors are reported at once.

Invalid tables are removed, or replaced by valid stand-ins with the same name; the rest is then
checked like a normal case. Errors that only follow from a removed table are dropped.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from drift.case import build
from drift.case.scenario import family
from drift.case.schema import SEARCH, CaseTable
from drift.case.values import messages
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES

Place = tuple[int | str, ...]  # keys and list indices of a value in a case, as in pydantic's `loc`
ROUNDS = 6  # most rounds of removing invalid tables
# keys without which nothing else can be checked
NEEDED = ("start", "end", "duration", "direction", "spill", "family")
LISTS = (*SEARCH, "find", "patrol", "patrol_unit", *QUANTITIES, "scenario")
# keys of a steering scenario, on which sorties depend; a stand-in cannot replace these
STEERING = ("phase", "vessel", "distress", "overdue", "arrival_radius", "motion")
KEPT = ("search_object", "source_level")  # keys that sorties and sensors need from a stand-in
PLACE = {"at": [0.0, 0.0], "error": "1 nmi"}
STILL = {"constant": {"east": 0.0, "north": 0.0}}
STORY = re.compile(r'scenario "([^"]*)"')
UNKNOWN = re.compile(r'unknown key "([^"]*)"(?:; did you mean "([^"]*)")?')


@dataclass(frozen=True)
class Rest:
    """The remaining tables of a case; lacking: keys of the file from which something was removed."""

    data: dict[str, Any]
    own: int  # number of scenarios outside families
    lacking: frozenset[str] = frozenset()
    stand_ins: frozenset[str] = frozenset()  # names of replaced scenarios
    # places of tables from which a key was dropped, and of renamed keys
    doubtful: frozenset[Place] = frozenset()

    def without(self, *keys: str) -> "Rest":
        """Return the rest without these keys of the file."""
        kept = {key: value for key, value in self.data.items() if key not in keys}
        return replace(self, data=kept, lacking=self.lacking | set(keys))


def further_mistakes(
    data: Mapping[str, Any],
    refused: ValidationError | UserError,
    path: Path,
    text: str,
    context: Mapping[str, Any],
) -> list[str]:
    """Return the further errors of an invalid case, one line each.

    Args:
        data: its tables as read.
        refused: the errors found first.
        path: the case file; relative paths start from its folder.
        text: text of the file.
        context: validation context of the case's tables; `whole` is their class.
    """
    try:
        rest = Rest(
            _name_tables(family.expand_families(dict(data))), own=len(data.get("scenario", []))
        )
    except (ValueError, TypeError):  # already among the mistakes
        return []
    schema: type[CaseTable] = context["whole"]
    lines: list[str] = []
    error: ValidationError | UserError = refused
    for _ in range(ROUNDS):
        after = _remove_rejected(rest, error)
        if after is None or after == rest:
            break
        rest = after
        try:
            build.build_case(schema.model_validate(rest.data, context=context), path, text)
            break
        except ValidationError as more:
            said = zip(more.errors(), messages.lines(more, rest.data), strict=True)
            new = [line for mistake, line in said if not _is_inside(mistake["loc"], rest.doubtful)]
            error = more
        except UserError as more:
            new = list(more.lines)
            error = more
        except (ValueError, OverflowError):
            break
        lines += [line for line in new if not _is_consequence(line, rest)]
    return lines


def _name_tables(data: dict[str, Any]) -> dict[str, Any]:
    """Name the unnamed tables of lists by kind and number, as messages do."""
    for key in SEARCH:
        if isinstance(data.get(key), list):
            data[key] = [
                {"name": f"{key} {number}", **one} if isinstance(one, dict) else one
                for number, one in enumerate(data[key], 1)
            ]
    return data


def _remove_rejected(rest: Rest, error: ValidationError | UserError) -> Rest | None:
    """Return the rest without the rejected tables; None if nothing can be checked without them."""
    if isinstance(error, UserError):
        return _with_stand_ins(
            rest, [match[1] for line in error.lines if (match := STORY.match(line))]
        )
    findings = [
        (mistake["loc"], mistake["msg"].removeprefix("Value error, ")) for mistake in error.errors()
    ]
    keys = [(loc, match) for loc, message in findings if (match := UNKNOWN.match(message))]
    places = [loc for loc, message in findings if not UNKNOWN.match(message)]
    if any(loc and loc[0] in NEEDED for loc, _ in findings):
        return None
    if any(
        loc[:1] == ("scenario",) and loc[1:2] >= (rest.own,) for loc, _ in findings
    ):  # the error is in a scenario of a family: the whole family is invalid
        return None
    rest = _with_known_keys(rest, keys)
    for key in dict.fromkeys(str(place[0]) for place in places if place):
        if isinstance(rest.data.get(key), dict) and key in LISTS:  # [wind] in place of [[wind]]
            rest = replace(rest, data={**rest.data, key: [rest.data[key]]})
            continue
        at = {
            place[1]
            for place in places
            if place[0:1] == (key,) and len(place) > 1 and isinstance(place[1], int)
        }
        one_of_many = key in LISTS and isinstance(rest.data.get(key), list) and at
        if key in ("voyage", "tracker"):
            rest = _with_one_scenario(rest.without(key))
        elif key == "scenario":
            rest = (
                _with_stand_ins(rest, _names(rest.data[key], at))
                if one_of_many
                else _with_one_scenario(rest)
            )
        elif key in QUANTITIES and one_of_many:
            rest = _with_zero_fields(rest, key, at)
        elif one_of_many:
            left = [one for number, one in enumerate(rest.data[key]) if number not in at]
            rest = replace(rest, data={**rest.data, key: left}, lacking=rest.lacking | {key})
        else:
            rest = rest.without(key)
    rest = _with_stand_ins(
        rest, [match[1] for loc, line in findings if not loc and (match := STORY.match(line))]
    )
    return rest.without(*SEARCH, "plan", "resampling") if "sensor" in rest.lacking else rest


def _with_known_keys(rest: Rest, unknown: Sequence[tuple[Place, re.Match[str]]]) -> Rest:
    """Return the rest with unknown keys renamed as suggested, or removed without a suggestion."""
    data, lacking, doubtful = rest.data, set(rest.lacking), set(rest.doubtful)
    for loc, match in unknown:
        key, meant = match.groups()
        table = _value_at(data, loc)
        if not isinstance(table, dict):
            continue
        renamed = {
            meant if one == key and meant and meant not in table else one: value
            for one, value in table.items()
        }
        if meant and meant not in table:
            doubtful.add((*loc, meant))
        else:
            renamed.pop(key, None)
            lacking |= {key} if not loc else set()
            doubtful |= {loc[:2], (*loc[:1], _name_of_item(rest.data, loc))} if loc else set()
        data = _replace_value(data, loc, renamed)
    return replace(rest, data=data, lacking=frozenset(lacking), doubtful=frozenset(doubtful))


def _name_of_item(data: Any, loc: Place) -> str:
    """Return the name of the list item that contains a place; "" if it has none."""
    member = _value_at(data, loc[:2])
    return str(member.get("name", "")) if isinstance(member, dict) else ""


def _is_inside(loc: Place, places: frozenset[Place]) -> bool:
    """Return whether a place is one of some places, or inside one."""
    return any(loc[:size] in places for size in range(1, len(loc) + 1))


def _value_at(node: Any, loc: Sequence[int | str]) -> Any:
    """Return the value at a place; None if there is no such place."""
    for part in loc:
        try:
            node = node[part]
        except (KeyError, IndexError, TypeError):
            return None
    return node


def _replace_value(node: Any, loc: Sequence[int | str], value: Any) -> Any:
    """Return a copy of tables and lists with a new value at an existing place."""
    if not loc:
        return value
    first, *others = loc
    if isinstance(node, dict):
        return {**node, first: _replace_value(node[first], others, value)}
    return [
        _replace_value(one, others, value) if number == first else one
        for number, one in enumerate(node)
    ]


def _names(scenarios: Sequence[Any], at: set[int]) -> list[str]:
    """Return the names of the scenarios with given indices; "" for a scenario without a name."""
    return [
        str(one.get("name", "")) if isinstance(one, dict) else ""
        for k, one in enumerate(scenarios)
        if k in at
    ]


def _with_stand_ins(rest: Rest, names: Sequence[str]) -> Rest:
    """Return the rest with stand-ins (plain drift) for the scenarios with these names."""
    scenarios = rest.data.get("scenario")
    if not isinstance(scenarios, list):
        return rest
    there = _names(scenarios, set(range(len(scenarios))))
    new = [name for name in dict.fromkeys(names) if name in there and name not in rest.stand_ins]
    if not new:
        return rest
    changed, steers = [], False
    for number, one in enumerate(scenarios, 1):
        name = str(one.get("name", "")) if isinstance(one, dict) else ""
        if name not in new:
            changed.append(one)
            continue
        own = one if isinstance(one, dict) else {}
        steers |= any(key in own for key in STEERING)
        kept = {key: own[key] for key in KEPT if key in own}
        changed.append(
            {"name": name or f"scenario {number}", "object": "water", "position": PLACE, **kept}
        )
    data = {**rest.data, "scenario": changed}
    data.pop("family", None)  # its scenarios are already in the list
    rest = replace(
        rest, data=data, lacking=rest.lacking | {"scenario"}, stand_ins=rest.stand_ins | set(new)
    )
    return rest.without(*SEARCH, "plan", "resampling") if steers else rest


def _with_one_scenario(rest: Rest) -> Rest:
    """Return the rest with one plain scenario in place of all, without tables that refer to any."""
    data = {**rest.data, "scenario": [{"name": "drift", "object": "water", "position": PLACE}]}
    data.pop("family", None)
    return replace(
        rest, data=data, lacking=rest.lacking | {"scenario"}, stand_ins=frozenset({"drift"})
    ).without(*SEARCH, "plan", "resampling")


def _with_zero_fields(rest: Rest, quantity: str, at: set[int]) -> Rest:
    """Return the rest with zero fields as stand-ins for some sources of a quantity."""
    sources = []
    for number, one in enumerate(rest.data[quantity]):
        name = one.get("name") if isinstance(one, dict) else None
        named = (
            {"name": name} if isinstance(name, str) and name.strip() and name.isprintable() else {}
        )
        add = {"add": True} if isinstance(one, dict) and one.get("add") is True else {}
        sources.append({**STILL, **named, **add} if number in at else one)
    return replace(rest, data={**rest.data, quantity: sources}, lacking=rest.lacking | {quantity})


def _is_consequence(line: str, rest: Rest) -> bool:
    """Return whether an error may only be a consequence of a removed or replaced table."""
    gone = rest.lacking
    begins = {
        "uncertainty": gone.intersection(QUANTITIES),
        "expect": gone.intersection({"output"}),
        "draught": gone.intersection({"depth"}),
        "resampling": gone.intersection({"contact", "scenario"}),
        "plan": gone.intersection({"sortie", "contact", "unit"}),
        "unit": gone.intersection({"plan", "sortie"}),
        "tow": gone.intersection({"plan"}),
        "find": gone.intersection({"patrol"}),
        "patrol_unit": gone.intersection({"find", "patrol"}),
    }
    findings = any(f'scenario "{name}"' in line for name in rest.stand_ins)
    findings |= any(
        line.startswith(f'{place[0]} "{place[1]}"') for place in rest.doubtful if len(place) == 2
    )
    return findings or any(line.startswith(start) for start, why in begins.items() if why)
