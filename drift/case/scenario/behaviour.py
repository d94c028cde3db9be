"""What particles do at times of their own, as keys of case files and of tracking files have it."""

import math
from typing import Annotated

from pydantic import BeforeValidator, model_validator

from drift.case.values import fields, units
from drift.tracking.tracker.records import Behaviour

SOONEST = 1.0  # [s] between acts
SLOWEST = 0.01  # [m/s] that anything follows


def _bearing(value: object) -> float:
    """Return an error of bearings on either side [deg]."""
    degrees = units.quantity(value, "deg", "error of a bearing", "1.5 deg")
    if not 0 < degrees <= 180:
        raise ValueError(f"{value!r} must be above 0 and at most 180 degrees, on either side")
    return degrees


BearingError = Annotated[float, BeforeValidator(_bearing)]


class BehaviourTable(fields.Table):
    """What something does at times of its own."""

    fastest: fields.ShipSpeed
    """No course is taken at more."""
    acts: fields.DurationRange | None = None
    """Least and longest time between acts; without it course and speed are kept."""
    change: fields.Share = 0.0
    """Probability that what acts takes another course and speed, any of them."""
    seek: fields.Share = 0.0
    """That from then on it seeks the tracker."""
    hide: fields.Share = 0.0
    """That from then on it flees from it."""
    leave: fields.Share = 0.0
    """That one which seeks or flees acts freely again."""
    spread: BearingError = 30.0
    """On either side of the reciprocal bearing on which one flees."""

    @model_validator(mode="after")
    def proper(self) -> "BehaviourTable":
        """Refuse probabilities that are more than one together."""
        whole = self.change + self.seek + self.hide
        if whole > 1 + 1e-9:
            raise ValueError(
                f"change {self.change:g}, seek {self.seek:g} and hide {self.hide:g} are {whole:g} together; at most 1 (what is left keeps its course)"
            )
        if self.acts is None and whole > 0:
            raise ValueError(
                'change, seek and hide are at times of acts; give acts = ["3 min", "15 min"]'
            )
        if self.acts is not None and self.acts[0] < SOONEST:
            raise ValueError(f"acts: the shortest time between acts must be {SOONEST:g} s or more")
        if self.fastest < SLOWEST:
            raise ValueError(f"fastest {self.fastest:g} m/s must be {SLOWEST:g} m/s or more")
        return self

    def behaviour(self) -> Behaviour:
        """Return the record."""
        return Behaviour(
            self.fastest,
            self.change,
            self.seek,
            self.hide,
            self.leave,
            self.acts,
            math.radians(self.spread),
        )
