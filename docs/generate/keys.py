"""The reference of keys: every table and key of a case file, as the reader itself has them.

Names, order, types, bounds and defaults come from the models of drift.case. What a key means comes
from the string below it there, or from the table of the page that describes its topic.
"""

import inspect
import re
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from drift.case import schema
from drift.case.forcing import sources, uncertainty
from drift.case.scenario import behaviour, change, family, hazard, itinerary, network, waypoints
from drift.case.scenario import scenario as scenarios
from drift.case.search import barrier, contact, look, pattern, plan, presence, sensor, sortie
from drift.case.tracking import bridge, tracker, tracking
from drift.case.values import fields

Model = type[BaseModel]

# Where a topic's page has a table of keys: page and heading.
PAGES: dict[Model, tuple[str, str]] = {
    sources.SourceTable: ("forcing.md", "# Winds, currents and Stokes drift"),
    uncertainty.UncertaintyTable: ("errors.md", "## Keys"),
    uncertainty.CurrentErrorTable: ("errors.md", "## Keys"),
    uncertainty.WindErrorTable: ("errors.md", "## Keys"),
    scenarios.ScenarioTable: ("search_keys.md", "## `[[scenario]]`"),
    hazard.HazardTable: ("targets.md", "### `hazard`"),
    change.ChangeTable: ("changes.md", "## `[[scenario.change]]`"),
    sortie.SortieTable: ("search_keys.md", "## `[[sortie]]`"),
    pattern.RegionTable: ("search_keys.md", "### `area`"),
    contact.SeenInTable: ("search_keys.md", "### `area`"),
    pattern.PatternTable: ("search_keys.md", "### `pattern`"),
    sortie.WatchTable: ("search_keys.md", "### `watch`"),
    sortie.MarkerTable: ("search_keys.md", "### `marker`"),
    sensor.SensorTable: ("search_keys.md", "## How it sees"),
    sensor.ConditionsTable: ("search_keys.md", "### `sweep_width`"),
    contact.ContactTable: ("search_keys.md", "## `[[contact]]`"),
    contact.PlaceTable: ("search_keys.md", "### `position`"),
    contact.BearingTable: ("search_keys.md", "### `bearing`"),
    contact.RangeTable: ("search_keys.md", "### `range`"),
    look.LookTable: ("search_keys.md", "## `[[look]]`"),
    presence.PresenceTable: ("search_keys.md", "## `[[presence]]`"),
    barrier.BarrierTable: ("search_keys.md", "## `[[barrier]]`"),
    barrier.LineTable: ("search_keys.md", "## `[[line]]`"),
    plan.UnitTable: ("search_keys.md", "## `[[unit]]`"),
    plan.PlanTable: ("search_keys.md", "## `[plan]`"),
    schema.DepthTable: ("search_keys.md", "## `[depth]`"),
    plan.ResamplingTable: ("search_keys.md", "## `[resampling]`"),
    itinerary.CourseTable: ("targets.md", "### `course`"),
    itinerary.ActsTable: ("targets.md", "### `behaviour`"),
    waypoints.TrackTable: ("targets.md", "### `track`"),
    waypoints.VoyageTable: ("targets.md", "### `voyage`"),
    waypoints.LanesTable: ("targets.md", "### `lanes`"),
    itinerary.LoiterTable: ("targets.md", "### `loiter`"),
    waypoints.BridgeTable: ("targets.md", "### `bridge`"),
    waypoints.PointTable: ("targets.md", "### Way points"),
    itinerary.DistressTable: ("targets.md", "## Distress"),
    itinerary.VesselTable: ("targets.md", "## `vessel`"),
    family.FamilyTable: ("targets.md", "### `[[family]]`"),
    family.AxisTable: ("targets.md", "### `[family.axis.NAME]`"),
}
# of keys on their page
PREFIXES = {uncertainty.CurrentErrorTable: "current.", uncertainty.WindErrorTable: "wind."}

# What validators take, which are no quantities with a unit: by where they are defined.
TAKEN = {
    "units.time": 'time, `"211830ZNOV26"`, `"2026-11-21T18:30Z"` or `"+6 h"`',
    "units.position": 'position, `"27 50N 088 36W"` or `[lon, lat]`',
    "units.spread_rate": 'spread rate, `"12 nmi/sqrt(h)"`',
    "fields._label": "text",
    "fields.count": "whole number",
    "fields.direction": "degrees true",
    "fields.share": "share, 0 to 1",
    "fields._sector": "`[from, to]`, degrees true, clockwise",
    "fields._jibe": 'a rate per hour, or `"0.04 /h"`',
    "fields.rate": 'rate, `"0.2 /day"`',
    "schema._step": '`"auto"`, or a duration in whole seconds',
    "schema._lakes": "`true`, `false` or a file",
    "schema._particles": "whole number above 0",
    "shares.percents": "percentages in ascending order",
    "grid._spacing": '`"0.02 deg"`, or a length',
    "sources._as_tuple": "a path, pattern or address, or several",
    "sources._parameters": "a table of numbers",
    "sources._indices_as_text": "a table of names",
    "survival.celsius": 'temperature, `"12 degC"`',
    "spill._number": "whole number, or `[fewest, most]`",
    "spill._rates": "a table of rates by kind of shore",
    "spill._release_duration": 'duration, `"2 h"`',
    "scenario._motion": '`"drift"`',
    "objects._search_object": "an object of the sweep width tables",
    "family._check_values": "a list, or a table by label",
    "family._check_weights": "a list of weights, or a table by label",
    "family._check_label_list": "a list of texts",
    "spreads._course": "uncertain direction",
    "spreads._times": "uncertain time",
    "expect._percent": "percentage",
    "bridge._percents": "percentages",
    "bridge._correlation": "-1 to 1, or two rows of two",
    "contact.CourseSeenTable.<lambda>": 'angle, `"10 deg"`',
    "sonar.decibels.<locals>.check": 'decibels, `"6 dB"`',
    "sonar.source_level": "decibels, or rows of speed and decibels",
    "sonar._source_levels": "decibels, rows of speed and decibels, or a table of either by scenario",
    "sonar._noise": "decibels, rows of bearing and decibels, or a table",
    "sonar._gain": "decibels, rows of relative bearing and decibels, or a table",
    "sonar._rate_of_loss": 'absorption, `"0.02 dB/km"`',
    "sonar._zone": "`[inner range, outer range, gain]`",
    "sonar._frequency": 'frequency, `"50 Hz"`',
    "sonar._sound_speed": 'speed of sound, `"1500 m/s"`',
    "processing._processors": "whole number, or tables",
    "processing._sensors": "a list of names, and of tables",
    "route._list_as_nodes": "names of nodes, or `{ from, via, to }`",
}
ANGLES = (
    (fields.Longitude, 'longitude, `-88.5` or `"88 30W"`'),
    (fields.Latitude, 'latitude, `27.9` or `"27 54N"`'),
)
ELSEWHERE = {
    "below",
    "table, below",
    "as above",
    "the same",
    "an object of the table above",
}  # cells that point at their page
TYPES = {
    str: "text",
    bool: "`true` or `false`",
    int: "whole number",
    float: "number",
    Any: "see what",
}


def attributes(model: Model) -> dict[str, str]:
    """Return what the strings below the fields of a model, and of those it extends, say of its
    keys.
    """
    # here: the suite is collected without the extra `docs`
    from sphinx.pycode import ModuleAnalyzer

    found: dict[str, str] = {}
    for parent in reversed(model.__mro__):
        if issubclass(parent, BaseModel) and parent.__module__.startswith("drift."):
            told = ModuleAnalyzer.for_module(parent.__module__).find_attr_docs()
            found |= {
                name: " ".join(lines).strip()
                for (owner, name), lines in told.items()
                if owner == parent.__name__
            }
    return found


def table(docs: Path, page: str, heading: str) -> dict[str, tuple[str, str, str]]:
    """Return value, default and meaning by key of the first table of keys under a heading of a
    page.
    """
    text = (docs / page).read_text(encoding="utf-8")
    _, found, below = (
        text.partition(f"\n{heading}\n") if not text.startswith(heading) else ("", heading, text)
    )
    assert found, f"{page} has no heading {heading}"
    match = re.search(r"^\| key \|.*\n\|[-|]+\n((?:\|.*\n)*)", below, flags=re.MULTILINE)
    assert match, f"{page}, {heading}: no table of keys"
    rows: dict[str, tuple[str, str, str]] = {}
    for line in match[1].splitlines():
        cells = [
            cell.strip()
            for cell in re.split(r"(?<!\\)\|", line.strip().removeprefix("|").removesuffix("|"))
        ]
        for key in re.findall(r"`([^`]+)`", cells[0]):
            value, default, what = (moved(cell, page) for cell in cells[1:])
            rows[key] = (value, default, what)
    return rows


def moved(text: str, page: str) -> str:
    """Return a text of a page with its links as a page one folder below has them."""
    text = re.sub(r"\]\((#[^)]+)\)", rf"]({page}\1)", text)
    return re.sub(r"\]\((?!https?:)([^)]+)\)", r"](../\1)", text)


def inner(annotation: Any) -> list[Model]:
    """Return the models that a type holds."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in typing.get_args(annotation) for model in inner(part)]


def _free(function: Any) -> dict[str, Any]:
    """Return the variables that a function closes over, by name."""
    return dict(inspect.getclosurevars(function).nonlocals) if inspect.isfunction(function) else {}


def _taken(function: Any) -> str:
    """Return what a validator takes, in words; "" for one that leaves that to the type."""
    for kind, words in ANGLES:
        if function is kind.__metadata__[0].func:
            return words
    name = f"{function.__module__.rsplit('.', 1)[-1]}.{function.__qualname__}"
    if name in TAKEN:
        return TAKEN[name]
    free = _free(function)
    if {"unit", "what", "example"} <= free.keys():
        what, example = free["what"], free["example"]
        unit = f" [{free['unit']}]" if free["unit"] else ""
        return f'{what}{unit}, `"{example}"`'
    if "single" in free:
        one = _taken(free["single"])
        if "_ordered" in name:
            return f"{one}, or `[low, high]`"
        return f"{one}, or two" if "pair_of" in name else f"uncertain {one}"
    return ""


def bounds(metadata: list[Any]) -> str:
    """Return the limits that a field's type states beside its validator."""
    words = []
    for one in metadata:
        for name, said in (("gt", "above"), ("ge", "at least"), ("lt", "below"), ("le", "at most")):
            if (limit := getattr(one, name, None)) is not None:
                words.append(f"{said} {limit:,g}")
        for name, said in (("min_length", "at least"), ("max_length", "at most")):
            if (limit := getattr(one, name, None)) is not None:
                words.append(f"{said} {limit} of them")
        words += [nested for nested in [bounds(getattr(one, "metadata", []))] if nested]
    return ", ".join(words)


def value(annotation: Any, metadata: list[Any] = []) -> str:  # noqa: B006
    """Return in words what a key takes."""
    for one in metadata:
        if hasattr(one, "func") and (said := _taken(one.func)):
            limits = bounds(metadata)
            return f"{said}; {limits}" if limits else said
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return value(parts[0], list(parts[1:]))
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(value(part) for part in parts if part is not type(None)))
    if origin is typing.Literal:
        return ", ".join(f'`"{part}"`' for part in parts)
    if models := inner(annotation):
        one = "a table" if origin is not list else "tables"
        return one if len(models) == 1 else " or ".join(f"`{model.__name__}`" for model in models)
    limits = bounds(metadata)
    if origin in (list, tuple):
        said = f"a list of: {value(parts[0])}"
    elif origin is dict:
        said = "a table by name"
    else:
        said = TYPES.get(annotation, "see what")
    return f"{said}; {limits}" if limits else said


def default(field: Any) -> str:
    """Return what holds where a key is left out."""
    if field.is_required():
        return "needed"
    given = field.get_default(call_default_factory=True)
    if given is None or given is PydanticUndefined or isinstance(given, BaseModel):
        return ""
    if isinstance(given, bool):
        return f"`{str(given).lower()}`"
    if isinstance(given, str):
        return f'`"{given}"`' if given else ""
    if isinstance(given, np.timedelta64):
        return "the start"
    if isinstance(given, int | float):
        unit = next(
            (_free(one.func).get("unit", "") for one in field.metadata if hasattr(one, "func")), ""
        )
        return f"{given:,.10g} {unit}".strip()
    if isinstance(given, tuple) and given and all(isinstance(one, int | float) for one in given):
        return f"`[{', '.join(f'{one:g}' for one in given)}]`"
    return ""


def rows(model: Model, docs: Path) -> list[tuple[str, str, str, str]]:
    """Return key, value, default and meaning of each key of a model; refuse a key of which nothing
    is said.
    """
    own, page = attributes(model), {}
    for parent in reversed(model.__mro__):
        if parent in PAGES:
            page |= table(docs, *PAGES[parent])
    prefix, found = PREFIXES.get(model, ""), []
    for name, field in model.model_fields.items():
        key = field.alias or name
        value_told, default_told, what = page.get(prefix + key, ("", "", ""))
        if name in own:  # what stands beside the key itself goes before the page
            value_told, default_told, what = "", "", own[name]
        taken = (
            value_told
            if value_told and value_told not in ELSEWHERE
            else value(field.annotation, field.metadata)
        )
        otherwise = default(field)
        if otherwise == "needed":
            what = re.sub(r"^needed(?:[:,;] *|$)", "", what)
        if not (what or value_told):
            raise LookupError(
                f"{model.__module__}.{model.__name__}.{key}: neither a string below it nor a page says what it is"
            )
        found.append(
            (key, taken, otherwise if otherwise == "needed" else default_told or otherwise, what)
        )
    return found


def places(top: Model) -> dict[Model, list[str]]:
    """Return the models below one, in the order of the file, with the places where each may stand."""
    found: dict[Model, list[str]] = {}

    def walk(model: Model, path: str) -> None:
        found.setdefault(model, []).append(path)
        if len(found[model]) > 1:
            return
        for name, field in model.model_fields.items():
            for one in inner(field.annotation):
                walk(one, f"{path}.{field.alias or name}".lstrip("."))

    walk(top, "")
    return found


def _first(model: Model) -> str:
    told = inspect.cleandoc(model.__doc__ or "").split("\n\n")[0].replace("\n", " ")
    return re.sub(r"^(?:An?|The) \[.*?\]* ?(?:table|about table)? as written[.;:] *", "", told)


def anchor(path: str) -> str:
    """Return the anchor of a table's section, by its first place."""
    return f"table-{path or 'case'}"


def _table(model: Model, docs: Path, path: str, sections: Mapping[Model, list[str]]) -> str:
    """Return the keys of a table as a list of definitions, which a narrow page can show too; each
    key has an anchor.
    """
    parts = []
    for (key, taken, otherwise, what), field in zip(
        rows(model, docs), model.model_fields.values(), strict=True
    ):
        held = [one for one in inner(field.annotation) if one in sections]
        if taken in ("a table", "tables") and held:
            taken = f"[{taken}](#{anchor(sections[held[0]][0])})"
        told = "; ".join(
            part
            for part in (taken, "" if otherwise in ("", "needed") else f"default {otherwise}")
            if part
        )
        told = f"{told} (needed)" if otherwise == "needed" else told
        words = (what[:1].upper() + what[1:]).replace("\\|", "|") if what else ""
        told = told.replace("\\|", "|")
        name = f"{path or 'case'}-{key}".replace(".", "-")
        parts.append(f"`{key}`{{#{name}}}\n: {f'{told}. {words}' if words else told}")
    return "\n\n".join(parts)


def section(model: Model, sections: Mapping[Model, list[str]], listed: bool, docs: Path) -> str:
    """Return the section of a table of the case file; listed: whether it may come several times."""
    paths = sections[model]
    deep = "." in paths[0]
    names = [
        f"`{path}`" if deep else f"`[[{path}]]`" if listed else f"`[{path}]`" for path in paths
    ]
    parts = [
        f"({anchor(paths[0])})=\n{'###' if deep else '##'} {names[0] if deep else ', '.join(names)}",
        _first(model),
    ]
    if deep and len(paths) > 1:
        parts.append("The same: " + ", ".join(f"`{other}`" for other in paths[1:]) + ".")
    if model in PAGES:
        page, _ = PAGES[model]
        title = (docs / page).read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        parts.append(f"More: [{title}](../{page}).")
    return "\n\n".join(part for part in [*parts, _table(model, docs, paths[0], sections)] if part)


def many(top: Model, path: str) -> bool:
    """Return whether a table is one of a list."""
    field = next(f for name, f in top.model_fields.items() if (f.alias or name) == path)
    return typing.get_origin(field.annotation) is list


INTRODUCTION = """# Keys of a case

Every table and key of a case file, made from what reads it: an unknown key is refused, with the nearest known one. A number without a
unit is in the unit in brackets. `drift check CASE` says how a case was understood. The values that come often are explained at the head of
[Searches, key by key](../search_keys.md). Three more kinds of file have keys: [networks of lanes](#lane-networks), [bridges](#bridge-files) and [tracking cases](#tracking-files).

## The case itself

These stand at the head of the file, before the first table."""


def page(docs: Path) -> str:
    """Return the page of all keys."""
    top = schema.CaseTable
    sections = places(top)
    parts = [INTRODUCTION, _table(top, docs, "", sections)]
    for model, paths in sections.items():
        if model is not top:
            parts.append(
                section(model, sections, "." not in paths[0] and many(top, paths[0]), docs)
            )
    # How units and sorties see stands in a table that is read apart.
    width = sensor.ConditionsTable
    parts += [
        "### `sortie.sweep_width`, `unit.sweep_width`",
        _first(width),
        _table(width, docs, "sweep_width", {}),
    ]
    for title, words, model in (
        (
            "Lane networks",
            "The file that `network` of lanes names ([Targets that steer](../targets.md#lane-networks)).",
            network.NetworkTable,
        ),
        (
            "Bridge files",
            "The file of `drift bridge` ([Bridges](../bridges.md)).",
            bridge.BridgeTable,
        ),
        (
            "Tracking files",
            "The case of `drift experiment` ([Tracking](../tracking.md)).",
            tracking.TrackingTable,
        ),
    ):
        name = title.split()[0].lower().removesuffix("s")
        own = {one: [f"{name}-{path[0]}"] for one, path in _apart(model).items()}
        parts += [f"## {title}", words, _table(model, docs, name, own)]
        for one, (path,) in own.items():
            if one is not model:
                heading = f"({anchor(path)})=\n### `{path.partition('-')[2]}` of {title.lower()}"
                parts += [heading, _first(one), _table(one, docs, path, own)]
    return "\n\n".join(parts) + "\n"


def _apart(model: Model) -> dict[Model, list[str]]:
    """Return the tables that the section of a file beside the case tells, with the places where
    each may stand.
    """
    beside = {model.__module__, behaviour.__name__, tracker.__name__}
    return {one: path for one, path in places(model).items() if one.__module__ in beside}


def count() -> int:
    """Return the number of keys that the page tells."""
    models = [*places(schema.CaseTable), sensor.ConditionsTable]
    for model in (network.NetworkTable, bridge.BridgeTable, tracking.TrackingTable):
        models += [*_apart(model)]
    return sum(len(model.model_fields) for model in models)
