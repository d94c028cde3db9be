"""The context in which sorties, contacts and units are checked: the run, and unique names."""

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
    """The run that a table is checked against: its times, scenarios, sensors and folder."""

    start: np.datetime64
    end: np.datetime64
    scenarios: Sequence[Scenario]
    folder: Path
    sensors: Mapping[str, Sensor] = field(default_factory=dict)  # by name

    def check(self, first: np.datetime64, last: np.datetime64) -> None:
        """Raise ValueError if the interval from `first` to `last` is not inside the run."""
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


def unique_names(given: Sequence[str | None], what: str) -> list[str]:
    """Return the names of tables as `numbered` does; raise UserError for a duplicate name."""
    names = _default_names(given, what)
    again = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if again:
        raise UserError(
            *(f'{what} "{name}": two {what}s have this name; give each its own' for name in again)
        )
    return names


def _default_names(given: Sequence[str | None], what: str) -> list[str]:
    """Return the names of tables; a table without a name gets its kind and number: "sortie 2".

    Args:
        given: the names as written.
        what: kind of the tables: "sortie".
    """
    return [name or f"{what} {number}" for number, name in enumerate(given, 1)]


def build_each(
    makers: Sequence[Callable[[str, Run], Any]], given: Sequence[str | None], what: str, run: Run
) -> list[Any]:
    """Build the records of a list of tables.

    Args:
        makers: functions that build a record from its name and the run.
        given: the names as written.
        what: kind of the tables: "sortie", "contact", "unit" and so on.
        run: the run that the tables are checked against.

    Raises:
        UserError: the mistakes of all tables, one line each.
    """
    wrong, records = Mistakes(), []
    with wrong.gathered():
        unique_names(given, what)
    for make, name in zip(makers, _default_names(given, what), strict=True):
        with wrong.gathered():
            records.append(_build_one(make, name, what, run))
    wrong.refuse()
    return records


def _build_one(make: Callable[[str, Run], Any], name: str, what: str, run: Run) -> Any:
    """Build one record; errors name its table."""
    try:
        return make(name, run)
    except UserError as error:
        raise UserError(*(f'{what} "{name}": {line}' for line in error.lines)) from None
    except ValueError as error:
        raise UserError(f'{what} "{name}": {error}') from None
