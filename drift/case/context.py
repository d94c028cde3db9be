"""What sorties, contacts and units must fit: the run, and the names of each other."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drift.case.values.mistakes import Mistakes
from drift.engine.motion.scenario import Scenario
from drift.evidence.sensors.records import Sensor
from geo import notation
from geo.errors import UserError


@dataclass(frozen=True)
class Run:
    """What a sortie must fit: the run's times, its scenarios and the folder of its files."""

    start: np.datetime64
    end: np.datetime64
    scenarios: Sequence[Scenario]
    folder: Path
    sensors: Mapping[str, Sensor] = field(default_factory=dict)  # by name

    def check(self, first: np.datetime64, last: np.datetime64) -> None:
        """Refuse times outside the run."""
        if first < self.start or last > self.end:
            when = (
                notation.format_dtg(first)
                if first == last
                else f"{notation.format_dtg(first)} to {notation.format_dtg(last)}"
            )
            raise ValueError(
                f"{when} is outside the run, {notation.format_dtg(self.start)} to {notation.format_dtg(self.end)}; change its "
                "times, or the case's start, duration or end"
            )


def named(given: Sequence[str | None], what: str) -> list[str]:
    """Return names, "sortie 2" for the second where it has none; refuse a name that comes twice."""
    names = numbered(given, what)
    again = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if again:
        raise UserError(
            *(f'{what} "{name}": two {what}s have this name; give each its own' for name in again)
        )
    return names


def numbered(given: Sequence[str | None], what: str) -> list[str]:
    """Return names, "sortie 2" for the second where it has none."""
    return [name or f"{what} {number}" for number, name in enumerate(given, 1)]


def build_each(
    makers: Sequence[Callable[[str, Run], Any]], given: Sequence[str | None], what: str, run: Run
) -> list[Any]:
    """Return the records of tables, one after the other.

    makers: make a record from its name and the run; given: the names as written; what: "sortie",
    "contact" or "unit". Raises one UserError for all that is wrong with any of them.
    """
    wrong, records = Mistakes(), []
    with wrong.gathered():
        named(given, what)
    for make, name in zip(makers, numbered(given, what), strict=True):
        with wrong.gathered():
            records.append(_build_one(make, name, what, run))
    wrong.refuse()
    return records


def _build_one(make: Callable[[str, Run], Any], name: str, what: str, run: Run) -> Any:
    """Return what a table makes; its refusals say which table it was."""
    try:
        return make(name, run)
    except UserError as error:
        raise UserError(*(f'{what} "{name}": {line}' for line in error.lines)) from None
    except ValueError as error:
        raise UserError(f'{what} "{name}": {error}') from None
