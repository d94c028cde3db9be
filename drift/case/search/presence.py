"""The [[presence]] table: a field observed over an interval of time."""

from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator

from drift.case.context import Run, build_each
from drift.case.search.look import FalseAlarms, FieldTable
from drift.case.search.sensor import probability
from drift.case.values import fields, units
from drift.evidence.filter.records import Presence
from geo import notation


def detection(value: object) -> float:
    """Return a probability of detection above 0."""
    chance = probability(value, "detection")
    if chance == 0:
        raise ValueError("detection = 0 is no evidence; leave the sensor out")
    return chance


Detection = Annotated[float, BeforeValidator(detection)]


def span(start: units.Instant, end: units.Instant, run: Run) -> tuple[np.datetime64, np.datetime64]:
    """Return the begin and end of an observation in UTC.

    Args:
        start: begin as written.
        end: end as written.
        run: the run.

    Raises:
        ValueError: the times are out of order, or outside the run.
    """
    begin, over = units.resolve(start, run.start), units.resolve(end, run.start)
    if over <= begin:
        raise ValueError(
            f"end {notation.format_dtg(over)} is not after start {notation.format_dtg(begin)}"
        )
    run.check(begin, over)
    return begin, over


class PresenceTable(FieldTable):
    """A [[presence]] table as written."""

    name: fields.Label | None = None
    start: fields.Time
    end: fields.Time
    present: Literal["throughout", "sometime", "never"]
    detection: Detection = 1.0
    false_alarms: FalseAlarms = 0.0

    def presence(self, name: str, run: Run) -> Presence:
        """Return the record of the presence; raise ValueError if it does not fit the run."""
        if self.false_alarms == 1:
            raise ValueError(
                "false_alarms = 1 gives the same report wherever the object is; leave the presence out"
            )
        return Presence(
            name,
            *span(self.start, self.end, run),
            self.field(),
            self.present,
            self.detection,
            self.false_alarms,
        )


def build_presences(tables: list[PresenceTable], run: Run) -> tuple[Presence, ...]:
    """Return the presences, ordered by end; raise UserError with all their mistakes."""
    every = build_each(
        [table.presence for table in tables], [table.name for table in tables], "presence", run
    )
    return tuple(sorted(every, key=lambda presence: presence.end))
