"""The [[tow]] table: ships that tow arrays, and where a plan may place them."""

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.context import Run, build_each
from drift.case.search.pattern import RegionTable
from drift.case.sonar import sonar as sonar_table
from drift.case.values import fields, units
from drift.evidence.filter.records import PlanSpec
from drift.evidence.sensors.records import Sonar, Tow
from geo import notation

LEAST_SPEED = 0.25  # [m/s] lowest towing speed


def _courses(value: object) -> Any:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(
            f"{value!r} must be [from, to], the allowed courses, clockwise, like [250, 40]"
        )
    low, high = (units.quantity(x, "deg", "course", "250") for x in value)
    if not (0 <= low <= 360 and 0 <= high <= 360):
        raise ValueError(f"{value!r} must be two courses, 0 to 360 degrees")
    return math.radians(low), math.radians(high)


class TowTable(fields.Table):
    """A [[tow]] table as written."""

    name: fields.Label
    """Name of the ship in the plan."""
    sensor: fields.Label
    """The sonar that it tows: a [[sensor]] without a position."""
    begin: RegionTable
    """Area in which it may begin to listen: a polygon, or a rectangle as in a sortie's area."""
    speed: fields.ShipSpeed
    """Towing speed, at which it listens."""
    base: fields.Position | None = None
    """Position of the ship at the time `ready`; by default it begins without a transit."""
    transit_speed: fields.ShipSpeed | None = None
    """Speed from its base to its first position; by default the towing speed."""
    ready: fields.Time | None = None
    """Earliest departure; by default the begin of the plan."""
    endurance: Annotated[fields.Duration | None, Field(gt=0)] = None
    """Longest time of listening; by default until the end of the plan."""
    allowed: RegionTable | None = None
    """Area that it must not leave while it listens."""
    courses: Annotated[Any, BeforeValidator(_courses)] = None
    """Allowed courses, `[from, to]` clockwise; by default all."""
    legs: Annotated[fields.Count, Field(ge=1, le=2)] = 2
    """Largest number of legs, 1 or 2."""

    @model_validator(mode="after")
    def moves(self) -> "TowTable":
        """Reject a ship that is too slow, and a transit speed without a base."""
        wrong = []
        if self.speed < LEAST_SPEED:
            wrong.append(
                f"speed {self.speed:.3g} m/s is too slow to tow an array; at least {LEAST_SPEED} m/s, 0.5 kn"
            )
        if self.transit_speed is not None and self.base is None:
            wrong.append(
                "transit_speed is the speed from its base: give base, or leave transit_speed out"
            )
        fields.refuse(self, wrong)
        return self

    def tow(self, name: str, run: Run, plan: PlanSpec) -> Tow:
        """Return the record of the ship; raise ValueError if it does not fit the plan."""
        sensor = sonar_table.sensor_named(self.sensor, run)
        if not isinstance(sensor.sees, Sonar):
            raise ValueError(f'sensor "{sensor.name}" is not a sonar; a [[tow]] tows a sonar')
        if sensor.place is not None:
            raise ValueError(
                f'sensor "{sensor.name}" has a fixed position (at), a towed sensor has none: leave at out there'
            )
        ready = plan.begin if self.ready is None else units.resolve(self.ready, run.start)
        if ready >= plan.until:
            raise ValueError(
                f"ready at {notation.format_dtg(ready)}, not before the plan's end, {notation.format_dtg(plan.until)}; change ready, or "
                "until in [plan], or run for longer"
            )
        return Tow(
            name,
            sensor,
            self.begin.area(),
            self.speed,
            np.maximum(ready, plan.begin),
            endurance=math.inf if self.endurance is None else self.endurance,
            base=self.base,
            transit_speed=self.transit_speed or self.speed,
            allowed=self.allowed.area() if self.allowed else None,
            courses=self.courses,
            legs=self.legs,
        )


def build_ships(tables: Sequence[TowTable], run: Run, plan: PlanSpec) -> tuple[Tow, ...]:
    """Return the ships; raise UserError with all their mistakes."""

    def maker(table: TowTable) -> Callable[[str, Run], Tow]:
        return lambda name, run: table.tow(name, run, plan)

    return tuple(
        build_each([maker(table) for table in tables], [table.name for table in tables], "tow", run)
    )
