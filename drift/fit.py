"""What sorties, contacts and units must fit: the run, and each other's names; and how a refusal says which one it was."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drift import units
from drift.scenario import Scenario
from geo.errors import UserError


@dataclass(frozen=True)
class Run:
    """What a sortie must fit: the run's times, its scenarios and the folder of its files."""

    start: np.datetime64
    end: np.datetime64
    scenarios: Sequence[Scenario]
    folder: Path

    def check(self, first: np.datetime64, last: np.datetime64) -> None:
        """Refuse times outside the run."""
        if first < self.start or last > self.end:
            when = units.group(first) if first == last else f"{units.group(first)} to {units.group(last)}"
            raise ValueError(
                f"{when} is outside the run, {units.group(self.start)} to {units.group(self.end)}; change its times, or "
                "the case's start, duration or end"
            )


def named(given: Sequence[str | None], what: str) -> list[str]:
    """Return names, "sortie 2" for the second where it has none; refuse a name that comes twice."""
    names = [name or f"{what} {number}" for number, name in enumerate(given, 1)]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f'{what} "{name}": two {what}s have this name; give each its own')
    return names


def told(make: Callable[[str, Run], Any], name: str, what: str, run: Run) -> Any:
    """Return what a table makes; its refusals say which table it was."""
    try:
        return make(name, run)
    except (ValueError, UserError) as error:
        raise UserError(f'{what} "{name}": {error}') from None
