"""[[family]]: hundreds of scenarios in a few lines, the products of routes, speeds, times or
whatever else differs.

Families are made scenarios of before these are validated, so that each is refused for what it is;
what can be wrong with a family itself is refused here.
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
OWN = ("name", "weight")  # keys of a scenario that the family gives
FINE, COARSE = 9, 4  # digits of values at equal distances, and of what they are called


def _named(labels: Iterable[Any]) -> None:
    for label in labels:
        fields._label(label)


def _labelled(value: Any) -> Any:
    """Take values, a list, or a table by what they are called."""
    if not isinstance(value, dict | list) or not value:
        raise ValueError(
            f"{value!r} must be a list of values, or a table of them by what they are called"
        )
    _named(value if isinstance(value, dict) else ())
    return value


def _weighed(value: Any) -> Any:
    """Take weights, a list, or a table by what values are called."""

    def one(weight: Any) -> float:
        number = units.quantity(weight, "", "weight", "0.5")
        if number < 0:
            raise ValueError(f"weight {weight!r} must be at least 0")
        return number

    if isinstance(value, dict):
        return {label: one(weight) for label, weight in value.items()}
    if isinstance(value, list):
        return [one(weight) for weight in value]
    raise ValueError(f"{value!r} must be a list, one a value, or a table by what values are called")


def _labels(value: Any) -> Any:
    """Take what values are called."""
    if not isinstance(value, list):
        raise ValueError(f"{value!r} must be a list, one a value")
    named = [
        str(one) if isinstance(one, int | float) and not isinstance(one, bool) else one
        for one in value
    ]
    if strange := [one for one in named if not isinstance(one, str)]:
        raise ValueError(f"{strange[0]!r} is no word that a value could be called by")
    _named(named)
    return named


class AxisTable(fields.Table):
    """A [family.axis.NAME] table as written: what differs, and the values that it takes."""

    key: fields.Label | None = None
    """The key of the scenario that it sets, tables and numbers of lists, from 1, joined by points:
    `"phase.1.voyage.speed"`. Without it each value is a table of keys, which are set beside those
    that the scenario has."""
    values: Annotated[Any, BeforeValidator(_labelled)] = None
    """The values, a list, or a table by what they are called; give these, or `from` and `to`."""
    low: Annotated[Any, Field(alias="from")] = None
    """The first of values at equal distances: a number, a quantity or a time."""
    high: Annotated[Any, Field(alias="to")] = None
    """The last of them, in the same unit."""
    count: fields.Count | None = None
    """How many values from `from` to `to`, both among them."""
    ranges: fields.Count | None = None
    """Or how many ranges `[low, high]` side by side, for keys that take uncertain numbers and
    times.
    """
    weights: Annotated[Any, BeforeValidator(_weighed)] = None
    """Probability of each value relative to the others, a list, or a table by name; without it all
    are equal.
    """
    labels: Annotated[Any, BeforeValidator(_labels)] = None
    """What each value is called, in tables and in the scenarios' names; without it by itself, or by
    its number.
    """

    @model_validator(mode="after")
    def whole(self) -> "AxisTable":
        """Refuse no values, values in two ways, and weights and names that are not one a value."""
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
            raise ValueError("labels: values by name have names already; leave labels out")
        many = self._many()
        if many > MOST:
            raise ValueError(f"{many:,} values; at most {MOST:,} scenarios are allowed")
        labels = [label for label, _ in self.taken("value")]
        for name, own in (("weights", self.weights), ("labels", self.labels)):
            if isinstance(own, list) and len(own) != many:
                raise ValueError(f"{name}: {len(own)} of them for {many} values; give one a value")
        if isinstance(self.weights, dict) and {*self.weights} != {*labels}:
            raise ValueError(
                f"weights: of {_listed(self.weights)}; give one of each value: {_listed(labels)}"
            )
        if many and math.fsum(self.shares(labels)) <= 0:
            raise ValueError("weights add up to 0; at least one must be above 0")
        if twice := next((label for k, label in enumerate(labels) if label in labels[:k]), None):
            raise ValueError(
                f'two values are called "{twice}"; give labels, one a value, that differ'
            )
        if self.key is None:
            for label, value in self.taken("value"):
                if not isinstance(value, dict):
                    raise ValueError(
                        f'value "{label}" is no table of keys; give key, the one that the values are of'
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
        """Return what the values are called, and the values; name: of the axis."""
        if isinstance(self.values, dict):
            return list(self.values.items())
        if self.values is not None:
            values, called = (
                self.values,
                [_called(value, f"{name} {k}") for k, value in enumerate(self.values, 1)],
            )
        else:
            values, called = _spaced(self.low, self.high, self._many(), self.count is None)
        return list(zip(self.labels or called, values, strict=False))

    def shares(self, labels: Sequence[str]) -> list[float]:
        """Return the weight of each value, by what they are called."""
        if isinstance(self.weights, dict):
            return [float(self.weights[label]) for label in labels]
        return list(self.weights or [1.0] * len(labels))


class FamilyTable(fields.Table):
    """A [[family]] table as written: scenarios that are the products of its axes."""

    name: fields.Label
    """What its scenarios are called, with what their values are called: `"transit, north, 8 kn"`."""
    weight: fields.Weight = 1.0
    """How likely all of its scenarios are together, beside other families and scenarios."""
    scenario: dict[str, Any] = Field(default_factory=dict)
    """What its scenarios have in common: the keys of a `[[scenario]]`, but for name and weight."""
    axis: Annotated[dict[str, AxisTable], Field(min_length=1)]
    """What differs, by name, `[family.axis.speed]`; each scenario has one value of each axis, and
    its weight is the product of theirs.
    """
    leave_out: list[dict[str, Any]] = Field(default_factory=list)
    """What is no scenario: tables by axis of what a value, or some in a list, is called, `{ route =
    "north", speed = ["14 kn", "16 kn"] }`. Its weight goes to all others."""

    _family: Family | None = PrivateAttr(None)
    _stories: list[dict[str, Any]] = PrivateAttr(default_factory=list)

    @model_validator(mode="after")
    def whole(self) -> "FamilyTable":
        """Refuse what the family says by itself, too many scenarios, and values that have no place
        in them.
        """
        for key in OWN:
            if key in self.scenario:
                what = (
                    "its scenarios are named by their values"
                    if key == "name"
                    else "give the family's weight"
                )
                raise ValueError(f"scenario.{key}: {what}; leave it out")
        _named(self.axis)
        many = math.prod(axis._many() for axis in self.axis.values())
        if many > MOST:
            counts = " x ".join(str(axis._many()) for axis in self.axis.values())
            raise ValueError(f"{counts} = {many:,} scenarios; at most {MOST:,}. Take fewer values")
        self._made()
        return self

    def _made(self) -> None:
        """Make the family and its scenarios."""
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
                "the weights of what leave_out leaves add up to 0; at least one must be above 0"
            )
        head = {**self.scenario}

        # scenarios share what they have in common, and what the values of the first axes have set
        @functools.cache
        def story(at: tuple[int, ...]) -> Any:
            if not at:
                return head
            name = axes[len(at) - 1].name
            label, value = taken[name][at[-1]]
            return self._set(name, label, story(at[:-1]), value)

        self._stories = [
            {"name": called, "weight": self.weight * weight / total, **story(at)}
            for called, weight, at in zip(self._family.names, weights, kept, strict=True)
        ]

    def _set(self, name: str, label: str, story: Any, value: Any) -> Any:
        """Return a scenario with a value of an axis."""
        key = self.axis[name].key
        try:
            if key is None:
                if own := next((key for key in OWN if key in value), None):
                    raise ValueError(f"{own} is the family's to give; leave it out")
                return _merged(story, value, "")
            if key in OWN:
                raise ValueError(
                    f"{key} is the family's to give; {'labels name' if key == 'name' else 'weights weigh'} values"
                )
            return _put(story, key.split("."), value, "")
        except ValueError as error:
            where = f"axis.{name}.key" if key is not None else f'axis.{name}, value "{label}"'
            raise ValueError(f"{where}: {error}") from None

    def _left_out(
        self, number: int, one: Mapping[str, Any], labels: Sequence[Sequence[str]]
    ) -> list[set[int]]:
        """Return the values on each axis, by number, of which all products are left out."""
        names, place = list(self.axis), f"leave_out {number}"
        if not one:
            raise ValueError(f"{place}: is empty; name values by axis")
        for name, value in one.items():
            if name not in names:
                raise ValueError(f'{place}: no axis "{name}"; there are: {_listed(names)}')
            own = labels[names.index(name)]
            for label in _several(value):
                if label not in own:
                    raise ValueError(
                        f'{place}.{name}: no value is called "{label}"; there are: {_listed(own)}'
                    )
        return [
            {own.index(label) for label in _several(one[name])}
            if name in one
            else set(range(len(own)))
            for name, own in zip(names, labels, strict=True)
        ]

    def stories(self) -> list[dict[str, Any]]:
        """Return its scenarios as tables of the case file."""
        return self._stories

    def places(self) -> dict[str, InFamily]:
        """Return where each of its scenarios stands, by name."""
        assert self._family is not None  # whole
        return {
            name: InFamily(self._family, at)
            for name, at in zip(self._family.names, self._family.stories, strict=True)
        }


def expanded(data: Any) -> Any:
    """Return the tables of a case as read with the scenarios of its families behind its own.

    What is not as it should be stays as it is, and is refused where it stands. Raises ValueError
    for too many scenarios.
    """
    own = data.get("scenario", []) if isinstance(data, dict) else None
    if not isinstance(own, list) or not isinstance(data.get("family"), list):
        return data
    stories = [story for table in _families(data) for story in table.stories()]
    if len(own) + len(stories) > MOST:
        raise ValueError(
            f"{len(own) + len(stories):,} scenarios of families and others; at most {MOST:,}"
        )
    return {**data, "scenario": [*own, *stories]} if stories else data


def places(data: Any) -> dict[str, InFamily]:
    """Return where the scenarios of families stand, by their names, of the tables of a case as
    read; of families in order.
    """
    known = data.get("family") if isinstance(data, dict) else None
    found: dict[str, InFamily] = {}
    for table in _families(data) if isinstance(known, list) else ():
        found |= table.places()
    return found


def _families(data: Mapping[str, Any]) -> Iterator[FamilyTable]:
    """Yield the families that are in order."""
    for written in data["family"]:
        try:
            yield FamilyTable.model_validate(written)
        except ValidationError:  # which is refused where it stands
            continue


def _several(value: Any) -> list[str]:
    return [str(one) for one in value] if isinstance(value, list) else [str(value)]


def _listed(names: Any) -> str:
    quoted = [f'"{name}"' for name in names]
    return ", ".join(quoted[:12]) + (f" and {len(quoted) - 12} more" if len(quoted) > 12 else "")


def _put(node: Any, path: Sequence[str], value: Any, place: str) -> Any:
    """Return a table or list with a value set at a path inside it; tables and lists that are not
    there are made.
    """
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
            raise ValueError(f'"{here}": "{part}" is no number of the list; give {there}')
        at = node[number - 1] if number <= len(node) else None
        return [*node[: number - 1], _put(at, rest, value, here), *node[number:]]
    if not isinstance(node, dict):
        like = (
            f'; write it {{ like = "{node}", .. }}'
            if place.endswith("voyage") and isinstance(node, str)
            else ""
        )
        raise ValueError(
            f'"{here}": {place} is {node!r}, no table in which "{part}" could be set{like}'
        )
    return {**node, part: _put(node.get(part), rest, value, here)}


def _merged(node: Any, more: Mapping[str, Any], place: str) -> Any:
    """Return a table or list with the keys of a table set in it, table by table."""
    for key, value in more.items():
        here = f"{place}.{key}".lstrip(".")
        own = _merged(_at(node, key), value, here) if isinstance(value, dict) else value
        node = _put(node, [key], own, place)
    return {} if node is None else node


def _at(node: Any, key: str) -> Any:
    if isinstance(node, dict):
        return node.get(key)
    if isinstance(node, list) and key.isdecimal() and 1 <= int(key) <= len(node):
        return node[int(key) - 1]
    return None


def _called(value: Any, otherwise: str) -> str:
    """Return what a value is called: a word, a number, a time or two of these by itself."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:.6g}"
    if isinstance(value, datetime):
        return notation.group(_moment(value))
    if isinstance(value, str) and value.strip() and value.isprintable():
        return value
    if (
        isinstance(value, list)
        and len(value) == 2
        and not any(isinstance(one, list | dict) for one in value)
    ):
        return _ends(*(_called(one, otherwise) for one in value))
    return otherwise


def _ends(low: str, high: str) -> str:
    """Return a range in words, the unit once: 6-7 kn."""
    a, b = (units.NUMBER.fullmatch(text) for text in (low, high))
    if a is None or b is None or a[2] != b[2] or not (_plain(low) and _plain(high)):
        return f"{low} to {high}"
    return f"{a[1]}-{high}" if a[1][0].isdigit() and b[1][0].isdigit() else f"{a[1]} to {high}"


def _plain(text: str) -> bool:
    """Whether a text is a number with no unit, or one that is no time."""
    return not units.GROUP.fullmatch(text)


def _moment(value: Any) -> np.datetime64:
    instant = units.time(value)
    if not isinstance(instant, np.datetime64):
        raise ValueError(f"{value!r} is relative")
    return instant


def _spaced(low: Any, high: Any, many: int, ranges: bool) -> tuple[list[Any], list[str]]:
    """Return values at equal distances, or ranges side by side, from one end to the other, and what
    they are called.
    """
    first, last, written = _line(low, high)
    if not first < last:
        raise ValueError(
            f"from {low!r} must be below to {high!r}; downward, or across north, give values"
        )
    at = [float(number) for number in np.linspace(first, last, many + ranges)]
    values, called = ([written(number, digits) for number in at] for digits in (FINE, COARSE))
    called = [_called(value, "") for value in (called if len({*called}) == len(at) else values)]
    if not ranges:
        return values, called
    return [list(pair) for pair in itertools.pairwise(values)], [
        _ends(*pair) for pair in itertools.pairwise(called)
    ]


def _line(low: Any, high: Any) -> tuple[float, float, Callable[[float, int], Any]]:
    """Return two ends as numbers, and how a number between them is written in the case file with so
    many digits.
    """
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
        lambda number, digits: (notation.iso if digits > COARSE else notation.group)(
            np.datetime64(round(number), "s")
        ),
    )


def _quantities(low: Any, high: Any) -> tuple[float, float, Callable[[float, int], Any]]:
    """Return the same of two quantities of one unit."""
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
