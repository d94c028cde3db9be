"""Check the rest of a case after rejecting some of its tables, so that all errors are reported at
once.

What is rejected is taken out, or something harmless stands in for it under its name, and what is
left goes through the checks that a sound case goes through. A mistake that only follows from what
was taken out is dropped.
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

Place = tuple[int | str, ...]  # of something in the tables of a case, as pydantic has it
ROUNDS = 6  # of taking out what is rejected; each leaves less
# nothing fits or misses a run without these
NEEDED = ("start", "end", "duration", "direction", "spill", "family")
LISTS = (*SEARCH, "find", "patrol", "patrol_unit", *QUANTITIES, "scenario")
# what sorties ask of a scenario
STEERING = ("phase", "vessel", "distress", "overdue", "arrival_radius", "motion")
KEPT = ("search_object", "source_level")  # what sorties and sensors ask of one that drifts
PLACE = {"at": [0.0, 0.0], "error": "1 nmi"}
STILL = {"constant": {"east": 0.0, "north": 0.0}}
STORY = re.compile(r'scenario "([^"]*)"')
UNKNOWN = re.compile(r'unknown key "([^"]*)"(?:; did you mean "([^"]*)")?')


@dataclass(frozen=True)
class Rest:
    """The remaining tables of a case; lacking: keys of the file from which something was removed."""

    data: dict[str, Any]
    own: int  # scenarios that no family makes
    lacking: frozenset[str] = frozenset()
    stand_ins: frozenset[str] = frozenset()  # names of scenarios
    # of tables of which a key was dropped, and of values under another key
    doubtful: frozenset[Place] = frozenset()

    def without(self, *keys: str) -> "Rest":
        """Return the rest without some keys."""
        kept = {key: value for key, value in self.data.items() if key not in keys}
        return replace(self, data=kept, lacking=self.lacking | set(keys))


def mistakes(
    data: Mapping[str, Any],
    refused: ValidationError | UserError,
    path: Path,
    text: str,
    schema: type[CaseTable],
) -> list[str]:
    """Return what else is wrong with a case, a line each.

    Args:
        data: its tables as read.
        refused: the errors found first.
        path: of the file, from whose folder others are named.
        text: of the file.
        schema: of its tables.
    """
    try:
        rest = Rest(_named(family.expanded(dict(data))), own=len(data.get("scenario", [])))
    except (ValueError, TypeError):  # which is among the mistakes already
        return []
    lines: list[str] = []
    error: ValidationError | UserError = refused
    for _ in range(ROUNDS):
        after = _taken_out(rest, error)
        if after is None or after == rest:
            break
        rest = after
        try:
            build.build_case(
                schema.model_validate(rest.data, context={"whole": schema}), path, text
            )
            break
        except ValidationError as more:
            said = zip(more.errors(), messages.lines(more, rest.data), strict=True)
            new = [line for mistake, line in said if not _under(mistake["loc"], rest.doubtful)]
            error = more
        except UserError as more:
            new = list(more.lines)
            error = more
        except (ValueError, OverflowError):
            break
        lines += [line for line in new if not _follows(line, rest)]
    return lines


def _named(data: dict[str, Any]) -> dict[str, Any]:
    """Return tables whose members of lists have the names that messages give to those without one."""
    for key in SEARCH:
        if isinstance(data.get(key), list):
            data[key] = [
                {"name": f"{key} {number}", **one} if isinstance(one, dict) else one
                for number, one in enumerate(data[key], 1)
            ]
    return data


def _taken_out(rest: Rest, error: ValidationError | UserError) -> Rest | None:
    """Return the rest without the rejected tables; None where nothing can be checked without them."""
    if isinstance(error, UserError):
        return _with_stand_ins(
            rest, [match[1] for line in error.lines if (match := STORY.match(line))]
        )
    told = [
        (mistake["loc"], mistake["msg"].removeprefix("Value error, ")) for mistake in error.errors()
    ]
    keys = [(loc, match) for loc, message in told if (match := UNKNOWN.match(message))]
    places = [loc for loc, message in told if not UNKNOWN.match(message)]
    if any(loc and loc[0] in NEEDED for loc, _ in told):
        return None
    if any(
        loc[:1] == ("scenario",) and loc[1:2] >= (rest.own,) for loc, _ in told
    ):  # a family's: all of it is at fault
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
            rest = _without_stories(rest.without(key))
        elif key == "scenario":
            rest = (
                _with_stand_ins(rest, _names(rest.data[key], at))
                if one_of_many
                else _without_stories(rest)
            )
        elif key in QUANTITIES and one_of_many:
            rest = _with_still(rest, key, at)
        elif one_of_many:
            left = [one for number, one in enumerate(rest.data[key]) if number not in at]
            rest = replace(rest, data={**rest.data, key: left}, lacking=rest.lacking | {key})
        else:
            rest = rest.without(key)
    rest = _with_stand_ins(
        rest, [match[1] for loc, line in told if not loc and (match := STORY.match(line))]
    )
    return rest.without(*SEARCH, "plan", "resampling") if "sensor" in rest.lacking else rest


def _with_known_keys(rest: Rest, unknown: Sequence[tuple[Place, re.Match[str]]]) -> Rest:
    """Return the rest with unknown keys under the name that they probably mean, and without the
    others.
    """
    data, lacking, doubtful = rest.data, set(rest.lacking), set(rest.doubtful)
    for loc, match in unknown:
        key, meant = match.groups()
        table = _at(data, loc)
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
            doubtful |= {loc[:2], (*loc[:1], _called(rest.data, loc))} if loc else set()
        data = _put(data, loc, renamed)
    return replace(rest, data=data, lacking=frozenset(lacking), doubtful=frozenset(doubtful))


def _called(data: Any, loc: Place) -> str:
    """Return the name of the member of a list in which a place is, "" without one."""
    member = _at(data, loc[:2])
    return str(member.get("name", "")) if isinstance(member, dict) else ""


def _under(loc: Place, places: frozenset[Place]) -> bool:
    """Return whether a value exists at one of some places, or inside it."""
    return any(loc[:size] in places for size in range(1, len(loc) + 1))


def _at(node: Any, loc: Sequence[int | str]) -> Any:
    """Return the value at a place; None where there is no such place."""
    for part in loc:
        try:
            node = node[part]
        except (KeyError, IndexError, TypeError):
            return None
    return node


def _put(node: Any, loc: Sequence[int | str], value: Any) -> Any:
    """Return tables and lists with a new value at an existing place."""
    if not loc:
        return value
    first, *others = loc
    if isinstance(node, dict):
        return {**node, first: _put(node[first], others, value)}
    return [_put(one, others, value) if number == first else one for number, one in enumerate(node)]


def _names(stories: Sequence[Any], at: set[int]) -> list[str]:
    """Return the names of scenarios at some places, "" for those without one."""
    return [
        str(one.get("name", "")) if isinstance(one, dict) else ""
        for k, one in enumerate(stories)
        if k in at
    ]


def _with_stand_ins(rest: Rest, names: Sequence[str]) -> Rest:
    """Return the rest with plain drift in place of scenarios, under their names."""
    stories = rest.data.get("scenario")
    if not isinstance(stories, list):
        return rest
    there = _names(stories, set(range(len(stories))))
    new = [name for name in dict.fromkeys(names) if name in there and name not in rest.stand_ins]
    if not new:
        return rest
    changed, steers = [], False
    for number, one in enumerate(stories, 1):
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
    data.pop("family", None)  # its scenarios stand among the others
    rest = replace(
        rest, data=data, lacking=rest.lacking | {"scenario"}, stand_ins=rest.stand_ins | set(new)
    )
    return rest.without(*SEARCH, "plan", "resampling") if steers else rest


def _without_stories(rest: Rest) -> Rest:
    """Return the rest with one plain scenario in place of all, and without the keys that need them."""
    data = {**rest.data, "scenario": [{"name": "drift", "object": "water", "position": PLACE}]}
    data.pop("family", None)
    return replace(
        rest, data=data, lacking=rest.lacking | {"scenario"}, stand_ins=frozenset({"drift"})
    ).without(*SEARCH, "plan", "resampling")


def _with_still(rest: Rest, quantity: str, at: set[int]) -> Rest:
    """Return the rest with zero fields in place of some sources of a quantity, under their names."""
    sources = []
    for number, one in enumerate(rest.data[quantity]):
        name = one.get("name") if isinstance(one, dict) else None
        named = (
            {"name": name} if isinstance(name, str) and name.strip() and name.isprintable() else {}
        )
        add = {"add": True} if isinstance(one, dict) and one.get("add") is True else {}
        sources.append({**STILL, **named, **add} if number in at else one)
    return replace(rest, data={**rest.data, quantity: sources}, lacking=rest.lacking | {quantity})


def _follows(line: str, rest: Rest) -> bool:
    """Return whether an error may only follow from what was removed."""
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
    told = any(f'scenario "{name}"' in line for name in rest.stand_ins)
    told |= any(
        line.startswith(f'{place[0]} "{place[1]}"') for place in rest.doubtful if len(place) == 2
    )
    return told or any(line.startswith(start) for start, why in begins.items() if why)
