"""The [[scenario.change]] table: what becomes of an object while it is adrift."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.scenario.objects import ObjectTable, SearchObject
from drift.case.scenario.survival import SurvivalTable
from drift.case.values import fields, spreads
from drift.case.values.mistakes import Mistakes
from drift.engine.motion.scenario import UNCHANGED, Change
from drift.engine.motion.steering.itinerary import Spread

MOST = 16  # changes of one scenario
# [m/s] default width: OpenDrift's probability of capsizing, 0.5 + 0.5 tanh((W - at) / 5 m/s)
WIDTH = 2.5


def _states(value: object) -> object:
    return [value] if isinstance(value, str) else value


class ChangeTable(fields.Table):
    """A change of state: how it comes, and what drifts then."""

    name: fields.Label
    from_: Annotated[list[str], BeforeValidator(_states)] = Field([UNCHANGED], alias="from")
    rate: Annotated[float, BeforeValidator(fields.rate)] | None = None
    wind: fields.WindSpeed | None = None
    width: Annotated[fields.WindSpeed | None, Field(gt=0)] = None
    at: spreads.Time | None = None
    after: spreads.Durations | None = None
    object: Annotated[
        ObjectTable | None,
        BeforeValidator(lambda value: {"name": value} if isinstance(value, str) else value),
    ] = None
    leeway: fields.Share | None = None
    sinks: bool = False
    search_object: SearchObject | None = None
    survival: SurvivalTable | None = None

    @model_validator(mode="after")
    def whole(self) -> "ChangeTable":
        """Reject a change that comes in no way or in two, and one that leads to two states."""
        fields.refuse(self, list(self._wrong()))
        return self

    def _wrong(self) -> list[str]:
        wrong = []
        given = [name for name in ("rate", "at", "after") if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none"
            wrong.append(f"exactly one of rate, at, after must be given; found {found}")
        if self.rate == 0:
            wrong.append('rate "0/h": it never comes; give a rate above 0, or leave the change out')
        if self.wind is not None and self.rate is None:
            wrong.append('wind belongs to rate: add rate, like "1/h", or leave wind out')
        if self.width is not None and self.wind is None:
            wrong.append("width belongs to wind; add wind, or leave width out")
        if self.object is not None and self.leeway is not None:
            wrong.append("object and leeway both say how it drifts then; give one of them")
        if self.object is not None and self.object.immersion is not None:
            wrong.append(
                "object: immersion differs between objects and is drawn at the release; give a "
                "class, leeway lines or windage"
            )
        if self.sinks:
            wrong += [
                f"{name} belongs to an object that floats; leave {name} or sinks out"
                for name in ("object", "leeway", "search_object", "survival")
                if getattr(self, name) is not None
            ]
        return wrong

    def change(self, leaves: tuple[int, ...], start: np.datetime64) -> Change:
        """Return the record of the change.

        Args:
            leaves: numbers of the states in which it may come.
            start: start of the case.
        """
        time = self.after
        if self.at is not None:
            law = self.at.seconds(start, start)
            if not isinstance(law, Spread):
                raise ValueError(
                    "at has no std; give a time, [earliest, latest] or { earliest, best, latest, ratio }"
                )
            time = law
        width = WIDTH if self.width is None else self.width
        return Change(
            self.name,
            leaves,
            self.rate or 0.0,
            None if self.wind is None else (self.wind, width),
            time,
            self.after is not None,
            self.object.drifter() if self.object else None,
            1.0 if self.leeway is None else self.leeway,
            self.sinks,
            self.search_object,
            self.survival.survival() if self.survival else None,
        )


def build_changes(
    tables: Sequence[ChangeTable], start: np.datetime64, place: str, *, lives: bool
) -> tuple[Change, ...]:
    """Return the changes of a scenario.

    Args:
        tables: the changes, in the order of the case.
        start: start of the case.
        place: the scenario in messages.
        lives: whether the scenario has survival times.

    Raises:
        UserError: changes do not fit together, one line for each mistake.
    """
    wrong, states, made = Mistakes(), {UNCHANGED: 0}, []
    if len(tables) > MOST:
        wrong.lines.append(f"{place}: {len(tables)} changes; at most {MOST} are allowed")
    sunk = {table.name for table in tables if table.sinks}
    for number, table in enumerate(tables, 1):
        own = f'{place}.change "{table.name}"'
        if table.name in states:
            wrong.lines.append(f"{own}: two states have this name; give each its own")
        for name in table.from_:
            if name not in states:
                allowed = ", ".join(f'"{state}"' for state in states)
                wrong.lines.append(
                    f'{own}.from: no state "{name}" before it; allowed here: {allowed}'
                )
            elif name in sunk:
                wrong.lines.append(f'{own}.from: "{name}" has sunk, and nothing comes after that')
        if not table.from_:
            wrong.lines.append(f"{own}.from: it leaves no state; name one, or leave from out")
        if table.survival and not lives:
            wrong.lines.append(
                f"{own}.survival: the scenario has no survival; give both, or leave this one out"
            )
        leaves = tuple(states.get(name, 0) for name in dict.fromkeys(table.from_))
        states.setdefault(table.name, number)
        with wrong.gathered(own):
            made.append(table.change(leaves, start))
    wrong.refuse()
    return tuple(made)
