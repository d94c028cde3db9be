"""[[family]] tables: many scenarios in a few lines, as products of routes, speeds, times and so on.

Families are expanded to scenarios before validation, so that mistakes in a scenario are reported as
such. Mistakes of the family itself are reported here.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, PrivateAttr, ValidationError, model_validator

from drift.case.values import fields, units
from drift.engine.motion.steering.family import Axis, Family, InFamily
from geo import notation

MOST = 10_000  # scenarios of a case
OWN = ("name", "weight")  # keys of a scenario that the family sets
FINE, COARSE = 9, 4  # significant digits of evenly spaced values, and of their labels


def _check_labels(labels: Iterable[Any]) -> None:
    for label in labels:
        fields._label(label)


def _check_values(value: Any) -> Any:
    """Check that values are a list, or a table by label."""
    if not isinstance(value, dict | list) or not value:
        raise ValueError(
            f"{value!r} must be a list of values, or a table of values by their labels"
        )
    _check_labels(value if isinstance(value, dict) else ())
    return value


def _check_weights(value: Any) -> Any:
    """Check that weights are a list, or a table by label."""

    def one(weight: Any) -> float:
        number = units.quantity(weight, "", "weight", "0.5")
        if number < 0:
            raise ValueError(f"weight {weight!r} must be at least 0")
        return number

    if isinstance(value, dict):
        return {label: one(weight) for label, weight in value.items()}
    if isinstance(value, list):
        return [one(weight) for weight in value]
    raise ValueError(f"{value!r} must be a list with one weight per value, or a table by label")


def _check_label_list(value: Any) -> Any:
    """Check that labels are a list of text or numbers."""
    if not isinstance(value, list):
        raise ValueError(f"{value!r} must be a list with one label per value")
    named = [
        str(one) if isinstance(one, int | float) and not isinstance(one, bool) else one
        for one in value
    ]
    if strange := [one for one in named if not isinstance(one, str)]:
        raise ValueError(f"{strange[0]!r} is not a label; write text or a number")
    _check_labels(named)
    return named


class AxisTable(fields.Table):
    """A [family.axis.NAME] table as written: a key that varies, and its values."""

    key: fields.Label | None = None
    """The key of the scenario that varies: names of tables and numbers of list items, from 1,
    joined
    by points: `"phase.1.voyage.speed"`. Without `key`, each value is a table of keys, which are
    added to those of the scenario."""
    values: Annotated[Any, BeforeValidator(_check_values)] = None
    """The values: a list, or a table by label. Give either these, or `from` and `to`."""
    low: Annotated[Any, Field(alias="from")] = None
    """First of evenly spaced values: a number, a quantity or a time."""
    high: Annotated[Any, Field(alias="to")] = None
    """Last of the evenly spaced values, in the same unit."""
    count: fields.Count | None = None
    """Number of evenly spaced values, `from` and `to` included."""
    ranges: fields.Count | None = None
    """In place of `count`: number of adjacent ranges `[low, high]`, for keys that accept uncertain
    numbers or times.
    """
    weights: Annotated[Any, BeforeValidator(_check_weights)] = None
    """Relative probability of each value: a list, or a table by label; equal if not given."""
    labels: Annotated[Any, BeforeValidator(_check_label_list)] = None
    """Label of each value in tables and in the scenarios' names; if not given, the value itself or
    its number.
    """

    @model_validator(mode="after")
    def whole(self) -> "AxisTable":
        """Reject missing or doubly given values, and weights or labels that do not match them."""
        spaced = {"from": self.low, "to": self.high, "count": self.count, "ranges": self.ranges}
        given = [name for name, value in spaced.items() if value is not None]
        if self.values is not None and given:
            raise ValueError(f"give values, or from and to; found values and {' and '.join(given)}")
        if self.values is None and not (
            self.low is not None and self.high is not None and len(given) == 3
        ):
            found = " and ".join(given) or "none"
            raise ValueError(
                f"give values, or from and to with count, or from and to with ranges; found {found}"
            )
        if self.labels is not None and isinstance(self.values, dict):
            raise ValueError("labels: values in a table have labels already; leave labels out")
        many = self._many()
        if many > MOST:
            raise ValueError(f"{many:,} values; at most {MOST:,} scenarios are allowed")
        labels = [label for label, _ in self.taken("value")]
        for name, own in (("weights", self.weights), ("labels", self.labels)):
            if isinstance(own, list) and len(own) != many:
                raise ValueError(f"{name}: {len(own)} given for {many} values; give one per value")
        if isinstance(self.weights, dict) and {*self.weights} != {*labels}:
            raise ValueError(
                f"weights: given for {_quote_names(self.weights)}; give one for each value: {_quote_names(labels)}"
            )
        if many and math.fsum(self.shares(labels)) <= 0:
            raise ValueError("weights add up to 0; at least one must be above 0")
        if twice := next((label for k, label in enumerate(labels) if label in labels[:k]), None):
            raise ValueError(
                f'two values have the label "{twice}"; give distinct labels, one per value'
            )
        if self.key is None:
            for label, value in self.taken("value"):
                if not isinstance(value, dict):
                    raise ValueError(
                        f'value "{label}" is not a table of keys; give key, the key that the values set'
                    )
        return self

    def _many(self) -> int:
        if self.values is not None:
            return len(self.values)
        least, name = (1, "ranges") if self.count is None else (2, "count")
        many = self.ranges if self.count is None else self.count
        assert many is not None
        if many < least:
            raise ValueError(f"{name} {many} must be at least {least}")
        return many

    def taken(self, name: str) -> list[tuple[str, Any]]:
        """Return (label, value) of each value; `name` of the axis makes labels of unnamed
        values."""
        if isinstance(self.values, dict):
            return list(self.values.items())
        if self.values is not None:
            values, called = (
                self.values,
                [_label_of(value, f"{name} {k}") for k, value in enumerate(self.values, 1)],
            )
        else:
            values, called = _evenly_spaced(self.low, self.high, self._many(), self.count is None)
        return list(zip(self.labels or called, values, strict=False))

    def shares(self, labels: Sequence[str]) -> list[float]:
        """Return the weight of each value, given the labels of all."""
        if isinstance(self.weights, dict):
            return [float(self.weights[label]) for label in labels]
        return list(self.weights or [1.0] * len(labels))


class FamilyTable(fields.Table):
    """A [[family]] table as written: scenarios that are all combinations of its axes' values."""

    name: fields.Label
    """First part of its scenarios' names; the labels of their values follow:
    `"transit, north, 8 kn"`."""
    weight: fields.Weight = 1.0
    """Total weight of its scenarios, relative to other families and scenarios."""
    scenario: dict[str, Any] = Field(default_factory=dict)
    """Keys that its scenarios share: those of a `[[scenario]]`, except name and weight."""
    axis: Annotated[dict[str, AxisTable], Field(min_length=1)]
    """What varies, by name, `[family.axis.speed]`. Each scenario has one value of each axis, and
    its
    weight is the product of the values' weights.
    """
    leave_out: list[dict[str, Any]] = Field(default_factory=list)
    """Combinations to leave out: tables with a label, or a list of labels, by axis: `{ route =
    "north", speed = ["14 kn", "16 kn"] }`. Their weight goes to the other scenarios."""

    _family: Family | None = PrivateAttr(None)
    _stories: list[dict[str, Any]] = PrivateAttr(default_factory=list)

    @model_validator(mode="after")
    def whole(self) -> "FamilyTable":
        """Reject keys that the family itself sets, too many scenarios, and values that do not
        fit."""
        for key in OWN:
            if key in self.scenario:
                what = (
                    "its scenarios are named by their values"
                    if key == "name"
                    else "give the family's weight"
                )
                raise ValueError(f"scenario.{key}: {what}; leave it out")
        _check_labels(self.axis)
        many = math.prod(axis._many() for axis in self.axis.values())
        if many > MOST:
            counts = " x ".join(str(axis._many()) for axis in self.axis.values())
            raise ValueError(f"{counts} = {many:,} scenarios; at most {MOST:,}. Take fewer values")
        self._made()
        return self

    def _made(self) -> None:
        """Build the family and the tables of its scenarios."""
        taken = {name: table.taken(name) for name, table in self.axis.items()}
        labels = [[label for label, _ in own] for own in taken.values()]
        out = [self._left_out(number, one, labels) for number, one in enumerate(self.leave_out, 1)]
        kept = [
            at
            for at in itertools.product(*(range(len(own)) for own in labels))
            if not any(all(k in some[axis] for axis, k in enumerate(at)) for some in out)
        ]
        if not kept:
            raise ValueError("leave_out: leaves no scenario")
        axes = tuple(Axis(name, tuple(own)) for name, own in zip(taken, labels, strict=True))
        self._family = Family(self.name, axes, tuple(kept))
        shares = [table.shares(own) for table, own in zip(self.axis.values(), labels, strict=True)]
        weights = [math.prod(own[k] for own, k in zip(shares, at, strict=True)) for at in kept]
        total = math.fsum(weights)
        if total <= 0:
            raise ValueError(
                "the weights of the scenarios that leave_out keeps add up to 0; at least one must be above 0"
            )
        head = {**self.scenario}

        # scenarios with the same values of the first axes share the tables built so far
        @functools.cache
        def scenario_table(at: tuple[int, ...]) -> Any:
            if not at:
                return head
            name = axes[len(at) - 1].name
            label, value = taken[name][at[-1]]
            return self._set(name, label, scenario_table(at[:-1]), value)

        self._stories = [
            {"name": called, "weight": self.weight * weight / total, **scenario_table(at)}
            for called, weight, at in zip(self._family.names, weights, kept, strict=True)
        ]

    def _set(self, name: str, label: str, scenario_table: Any, value: Any) -> Any:
        """Return a scenario's table with a value of an axis set."""
        key = self.axis[name].key
        try:
            if key is None:
                if own := next((key for key in OWN if key in value), None):
                    raise ValueError(f"{own} is set by the family; leave it out")
                return _merged(scenario_table, value, "")
            if key in OWN:
                raise ValueError(
                    f"{key} is set by the family; use {'labels to name' if key == 'name' else 'weights to weight'} values"
                )
            return _put(scenario_table, key.split("."), value, "")
        except ValueError as error:
            where = f"axis.{name}.key" if key is not None else f'axis.{name}, value "{label}"'
            raise ValueError(f"{where}: {error}") from None

    def _left_out(
        self, number: int, one: Mapping[str, Any], labels: Sequence[Sequence[str]]
    ) -> list[set[int]]:
        """Return per axis the indices of values whose combinations are left out."""
        names, place = list(self.axis), f"leave_out {number}"
        if not one:
            raise ValueError(f"{place}: is empty; name values by axis")
        for name, value in one.items():
            if name not in names:
                raise ValueError(f'{place}: no axis "{name}"; there are: {_quote_names(names)}')
            own = labels[names.index(name)]
            for label in _as_labels(value):
                if label not in own:
                    raise ValueError(
                        f'{place}.{name}: no value is called "{label}"; there are: {_quote_names(own)}'
                    )
        return [
            {own.index(label) for label in _as_labels(one[name])}
            if name in one
            else set(range(len(own)))
            for name, own in zip(names, labels, strict=True)
        ]

    def stories(self) -> list[dict[str, Any]]:
        """Return its scenarios as [[scenario]] tables."""
        return self._stories

    def places(self) -> dict[str, InFamily]:
        """Return the position of each of its scenarios in the family, by name."""
        assert self._family is not None  # set by the validator `whole`
        return {
            name: InFamily(self._family, at)
            for name, at in zip(self._family.names, self._family.stories, strict=True)
        }


def expand_families(data: Any) -> Any:
    """Return a case's tables with the scenarios of its families appended to its own.

    Invalid families are left unchanged; their validation reports them. Raises ValueError for too
    many scenarios.
    """
    own = data.get("scenario", []) if isinstance(data, dict) else None
    if not isinstance(own, list) or not isinstance(data.get("family"), list):
        return data
    added = [scenario_table for table in _families(data) for scenario_table in table.stories()]
    if len(own) + len(added) > MOST:
        raise ValueError(
            f"{len(own) + len(added):,} scenarios of families and others; at most {MOST:,}"
        )
    return {**data, "scenario": [*own, *added]} if added else data


def places(data: Any) -> dict[str, InFamily]:
    """Return the position of each scenario in its family, by name, for the valid families."""
    known = data.get("family") if isinstance(data, dict) else None
    found: dict[str, InFamily] = {}
    for table in _families(data) if isinstance(known, list) else ():
        found |= table.places()
    return found


def _families(data: Mapping[str, Any]) -> Iterator[FamilyTable]:
    """Yield the valid families."""
    for written in data["family"]:
        try:
            yield FamilyTable.model_validate(written)
        except ValidationError:  # reported by the case's own validation
            continue


def _as_labels(value: Any) -> list[str]:
    return [str(one) for one in value] if isinstance(value, list) else [str(value)]


def _quote_names(names: Any) -> str:
    quoted = [f'"{name}"' for name in names]
    return ", ".join(quoted[:12]) + (f" and {len(quoted) - 12} more" if len(quoted) > 12 else "")


def _put(node: Any, path: Sequence[str], value: Any, place: str) -> Any:
    """Return a copy of a table or list with a value set at a path; missing tables are created."""
    if not path:
        return value
    part, *rest = path
    here = f"{place}.{part}".lstrip(".")
    if not part:
        raise ValueError(
            f'"{".".join(path)}" has nothing between two points; write it like "phase.1.voyage.speed"'
        )
    if node is None:
        node = [] if part.isdecimal() else {}
    if isinstance(node, list):
        number = int(part) if part.isascii() and part.isdecimal() and len(part) < 6 else 0
        if not 1 <= number <= len(node) + 1:
            there = (
                f"{'1 to ' * (len(node) > 1)}{len(node)}, or {len(node) + 1} for one more"
                if node
                else "1 for the first"
            )
            raise ValueError(f'"{here}": "{part}" is not a number in the list; give {there}')
        at = node[number - 1] if number <= len(node) else None
        return [*node[: number - 1], _put(at, rest, value, here), *node[number:]]
    if not isinstance(node, dict):
        like = (
            f'; write it {{ like = "{node}", .. }}'
            if place.endswith("voyage") and isinstance(node, str)
            else ""
        )
        raise ValueError(
            f'"{here}": {place} is {node!r}, not a table in which "{part}" could be set{like}'
        )
    return {**node, part: _put(node.get(part), rest, value, here)}


def _merged(node: Any, more: Mapping[str, Any], place: str) -> Any:
    """Return a copy of a table or list, merged with a table, recursively."""
    for key, value in more.items():
        here = f"{place}.{key}".lstrip(".")
        own = _merged(_item(node, key), value, here) if isinstance(value, dict) else value
        node = _put(node, [key], own, place)
    return {} if node is None else node


def _item(node: Any, key: str) -> Any:
    if isinstance(node, dict):
        return node.get(key)
    if isinstance(node, list) and key.isdecimal() and 1 <= int(key) <= len(node):
        return node[int(key) - 1]
    return None


def _label_of(value: Any, otherwise: str) -> str:
    """Return the label of a value: a word, number, time or range is its own, else `otherwise`."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:.6g}"
    if isinstance(value, datetime):
        return notation.format_dtg(_moment(value))
    if isinstance(value, str) and value.strip() and value.isprintable():
        return value
    if (
        isinstance(value, list)
        and len(value) == 2
        and not any(isinstance(one, list | dict) for one in value)
    ):
        return _range_label(*(_label_of(one, otherwise) for one in value))
    return otherwise


def _range_label(low: str, high: str) -> str:
    """Return the label of a range, with the unit once: 6-7 kn."""
    a, b = (units.NUMBER.fullmatch(text) for text in (low, high))
    if a is None or b is None or a[2] != b[2] or not (_is_not_time(low) and _is_not_time(high)):
        return f"{low} to {high}"
    return f"{a[1]}-{high}" if a[1][0].isdigit() and b[1][0].isdigit() else f"{a[1]} to {high}"


def _is_not_time(text: str) -> bool:
    """Return whether a text is not a date-time group."""
    return not units.GROUP.fullmatch(text)


def _moment(value: Any) -> np.datetime64:
    instant = units.time(value)
    if not isinstance(instant, np.datetime64):
        raise ValueError(f"{value!r} is relative")
    return instant


def _evenly_spaced(low: Any, high: Any, many: int, ranges: bool) -> tuple[list[Any], list[str]]:
    """Return evenly spaced values, or adjacent ranges, and their labels."""
    first, last, written = _ends_as_numbers(low, high)
    if not first < last:
        raise ValueError(
            f"from {low!r} must be below to {high!r}; for descending values, or directions across north, give values"
        )
    at = [float(number) for number in np.linspace(first, last, many + ranges)]
    values, called = ([written(number, digits) for number in at] for digits in (FINE, COARSE))
    called = [_label_of(value, "") for value in (called if len({*called}) == len(at) else values)]
    if not ranges:
        return values, called
    return [list(pair) for pair in itertools.pairwise(values)], [
        _range_label(*pair) for pair in itertools.pairwise(called)
    ]


def _ends_as_numbers(low: Any, high: Any) -> tuple[float, float, Callable[[float, int], Any]]:
    """Return two ends as numbers, and a function that writes a number in between with some
    digits."""
    if all(isinstance(one, int | float) and not isinstance(one, bool) for one in (low, high)):
        if not (math.isfinite(low) and math.isfinite(high)):
            raise ValueError(f"from {low!r} and to {high!r} must be finite")
        return float(low), float(high), lambda number, digits: float(f"{number:.{digits}g}")
    try:
        begin, end = (notation.epoch(_moment(one)) for one in (low, high))
    except ValueError:
        return _quantities(low, high)
    return (
        begin,
        end,
        lambda number, digits: (notation.iso if digits > COARSE else notation.format_dtg)(
            np.datetime64(round(number), "s")
        ),
    )


def _quantities(low: Any, high: Any) -> tuple[float, float, Callable[[float, int], Any]]:
    """Return the same as `_ends_as_numbers` for two quantities of one unit."""
    a, b = (units.NUMBER.fullmatch(one) if isinstance(one, str) else None for one in (low, high))
    if (
        a is None
        or b is None
        or not all(match[2][:1].isalpha() or match[2][:1] in "%/°" for match in (a, b))
    ):
        raise ValueError(
            f"from {low!r} and to {high!r} must be two numbers, two quantities of one unit or two times, like "
            '"6 kn" and "14 kn", or "+0 h" and "+24 h"'
        )
    if a[2] != b[2]:
        raise ValueError(f"from {low!r} and to {high!r} must have the same unit")
    first, last = (float(match[1].replace("_", "")) for match in (a, b))
    if not (math.isfinite(first) and math.isfinite(last)):
        raise ValueError(f"from {low!r} and to {high!r} must be finite")
    sign, unit = "+" if a[1][0] in "+-" else "", a[2]
    return first, last, lambda number, digits: f"{number:{sign}.{digits}g} {unit}".strip()
