"""The behaviour table of case and tracking files: targets that change course at random times."""

import math
from typing import Annotated

from pydantic import BeforeValidator, model_validator

from drift.case.values import fields, units
from drift.tracking.tracker.records import Behaviour

SOONEST = 1.0  # [s] shortest time between acts
SLOWEST = 0.01  # [m/s] lowest top speed


def _bearing(value: object) -> float:
    """Return the largest error of a bearing to either side [deg]."""
    degrees = units.quantity(value, "deg", "error of a bearing", "1.5 deg")
    if not 0 < degrees <= 180:
        raise ValueError(f"{value!r} must be above 0 and at most 180 degrees, on either side")
    return degrees


BearingError = Annotated[float, BeforeValidator(_bearing)]


class BehaviourTable(fields.Table):
    """A target that acts at random times: changes course, seeks the tracker or flees from it."""

    fastest: fields.ShipSpeed
    """Highest speed of the target."""
    acts: fields.DurationRange | None = None
    """Shortest and longest time between acts; without it the target keeps course and speed."""
    change: fields.Share = 0.0
    """Probability that an act is a new course and speed, drawn at random."""
    seek: fields.Share = 0.0
    """Probability that at an act the target begins to seek the tracker."""
    hide: fields.Share = 0.0
    """Probability that at an act the target begins to flee from the tracker."""
    leave: fields.Share = 0.0
    """Probability that at an act a target that seeks or flees stops doing so."""
    spread: BearingError = 30.0
    """A fleeing target steers within this angle of the bearing away from the tracker."""

    @model_validator(mode="after")
    def proper(self) -> "BehaviourTable":
        """Reject probabilities whose sum exceeds 1, and speeds and times that are too small."""
        total = self.change + self.seek + self.hide
        if total > 1 + 1e-9:
            raise ValueError(
                f"change {self.change:g}, seek {self.seek:g} and hide {self.hide:g} are {total:g} together; at most 1 (what is left keeps its course)"
            )
        if self.acts is None and total > 0:
            raise ValueError(
                'change, seek and hide are at times of acts; give acts = ["3 min", "15 min"]'
            )
        if self.acts is not None and self.acts[0] < SOONEST:
            raise ValueError(f"acts: the shortest time between acts must be {SOONEST:g} s or more")
        if self.fastest < SLOWEST:
            raise ValueError(f"fastest {self.fastest:g} m/s must be {SLOWEST:g} m/s or more")
        return self

    def behaviour(self) -> Behaviour:
        """Return the record of the behaviour."""
        return Behaviour(
            self.fastest,
            self.change,
            self.seek,
            self.hide,
            self.leave,
            self.acts,
            math.radians(self.spread),
        )
