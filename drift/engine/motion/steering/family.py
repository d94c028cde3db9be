"""Scenario families: the products of a few axes, such as route, speed and departure time.

Each scenario of a family knows its value on each axis. Results can then be listed by axis, and an
error common to many scenarios takes one line.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geo.array import Array

OPENING = 'scenario "'  # of a line about a scenario
NAMED = 3  # values of an axis listed in a line


@dataclass(frozen=True)
class Axis:
    """An axis of a family: its name and the labels of its values."""

    name: str
    labels: tuple[str, ...]


@dataclass(frozen=True)
class Family:
    """A family of scenarios."""

    name: str
    axes: tuple[Axis, ...]
    stories: tuple[tuple[int, ...], ...]  # indices of each scenario's values on the axes

    def __hash__(self) -> int:
        """Return the hash of the name only: hashing thousands of scenarios for each of them would
        be slow.
        """
        return hash(self.name)

    @property
    def names(self) -> list[str]:
        """The names of its scenarios."""
        return [
            ", ".join([self.name, *(axis.labels[k] for axis, k in zip(self.axes, at, strict=True))])
            for at in self.stories
        ]


@dataclass(frozen=True)
class InFamily:
    """The position of a scenario in its family."""

    family: Family
    at: tuple[int, ...]  # index of its value on each axis

    @property
    def labels(self) -> dict[str, str]:
        """The labels of its values, by the name of the axis."""
        return {
            axis.name: axis.labels[k] for axis, k in zip(self.family.axes, self.at, strict=True)
        }


@dataclass(frozen=True)
class Along:
    """A run's scenarios along an axis; axes of the same name in several families are merged."""

    axis: Axis
    number: npt.NDArray[np.int64]  # (scenarios,) index of each one's value; -1: it has no such axis

    def shares(self, probability: Array) -> Array:
        """Return the probability of each axis value from that of scenarios: (..., scenarios) to
        (..., values).
        """
        of = self.number[:, None] == np.arange(len(self.axis.labels))
        return np.asarray(probability @ of)


def axes_of_scenarios(places: Sequence[InFamily | None]) -> list[Along]:
    """Return the axes on which the scenarios of a run differ; places: position of each in its
    family, or None.
    """
    found: dict[str, dict[str, int]] = {}
    labels = [place.labels if place else {} for place in places]
    for family in dict.fromkeys(place.family for place in places if place):
        for axis in family.axes:  # values in the order of the case
            known = found.setdefault(axis.name, {})
            for label in axis.labels:
                known.setdefault(label, len(known))
    axes = []
    for name, known in found.items():
        number = np.array([known[own[name]] if name in own else -1 for own in labels], np.int64)
        if np.unique(number).size > 1:
            axes.append(Along(Axis(name, tuple(known)), number))
    return axes


def effective_scenarios(probability: Array) -> float:
    """Return the effective number of scenarios: the exponential of the entropy of their
    probabilities.
    """
    own = probability[probability > 0]
    return math.exp(-float((own * np.log(own)).sum())) if own.size else 0.0


def merge_lines(lines: Sequence[str], places: Mapping[str, InFamily]) -> list[str]:
    """Return lines about scenarios, with equal statements about several of a family merged into one
    line.

    places: by the names of scenarios. A merged line lists the axis values for which it holds, or
    the number of scenarios. Other lines are unchanged.
    """
    found: dict[tuple[Family | None, str], list[tuple[int, ...]]] = {}
    for line in lines:
        name = _scenario_of_line(line, places)
        if name is None:
            found.setdefault((None, line), [])
        else:
            place, rest = places[name], line[len(OPENING) + len(name) + 1 :]
            found.setdefault((place.family, rest), []).append(place.at)
    return [
        rest if family is None else f'family "{family.name}"{_describe_subset(family, {*at})}{rest}'
        for (family, rest), at in found.items()
    ]


def _scenario_of_line(line: str, places: Mapping[str, InFamily]) -> str | None:
    """Return the family scenario that a line begins with; None if there is none."""
    if not line.startswith(OPENING):
        return None
    end = line.find('"', len(OPENING))
    while end >= 0:  # names may contain quotation marks
        if line[len(OPENING) : end] in places:
            return line[len(OPENING) : end]
        end = line.find('"', end + 1)
    return None


def merge_names(names: Sequence[str], places: Mapping[str, InFamily]) -> list[str]:
    """Return scenario names with those of a family merged: "transit, north (100)".

    places: by the names of scenarios.
    """
    found: dict[Family | str, list[tuple[int, ...]]] = {}
    for name in names:
        place = places.get(name)
        found.setdefault(place.family if place else name, []).append(place.at if place else ())
    told = []
    for one, some in found.items():
        if isinstance(one, str):
            told.append(one)
        elif len(some) == 1:
            told.append(one.names[one.stories.index(some[0])])
        else:
            values = _selecting_values(one, {*some})
            parts = [_join_labels(axis, own) for axis, own in values] if values is not None else []
            told.append(f"{', '.join([one.name, *parts])} ({len(some):,})")
    return told


def _describe_subset(family: Family, some: set[tuple[int, ...]]) -> str:
    """Return a text that identifies some scenarios of a family; "" if it is all of them."""
    values = _selecting_values(family, some)
    if values is None:
        first = next(
            name for name, at in zip(family.names, family.stories, strict=True) if at in some
        )
        return f', {len(some):,} of its {len(family.stories):,} scenarios, such as "{first}"'
    return "".join(f", {axis.name} {_join_labels(axis, own, quote=True)}" for axis, own in values)


def _selecting_values(
    family: Family, some: set[tuple[int, ...]]
) -> list[tuple[Axis, list[int]]] | None:
    """Return the axis values that select exactly these scenarios of a family; None if no
    values do.
    """
    own = [{at[k] for at in some} for k in range(len(family.axes))]
    if {
        at for at in family.stories if all(at[k] in values for k, values in enumerate(own))
    } != some:
        return None
    every = [{at[k] for at in family.stories} for k in range(len(family.axes))]
    return [(axis, sorted(a)) for axis, a, b in zip(family.axes, own, every, strict=True) if a != b]


def _join_labels(axis: Axis, values: Sequence[int], *, quote: bool = False) -> str:
    labels = [f'"{axis.labels[value]}"' if quote else axis.labels[value] for value in values]
    more = f" and {len(labels) - NAMED} more" if len(labels) > NAMED else ""
    return f"{', '.join(labels[:NAMED])}{more}"
