"""Ships that tow arrays, as a case file gives them: where a plan may place them."""

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

LEAST_SPEED = 0.25  # [m/s] of a ship that tows


def _courses(value: object) -> Any:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(
            f"{value!r} must be [from, to], the courses that it steers, clockwise, like [250, 40]"
        )
    low, high = (units.quantity(x, "deg", "course", "250") for x in value)
    if not (0 <= low <= 360 and 0 <= high <= 360):
        raise ValueError(f"{value!r} must be two courses, 0 to 360 degrees")
    return math.radians(low), math.radians(high)


class TowTable(fields.Table):
    """A [[tow]] table as written."""

    name: fields.Label
    """What the plan calls the ship."""
    sensor: fields.Label
    """The sonar that it tows, a [[sensor]] without a place."""
    begin: RegionTable
    """Where it may begin to listen: a polygon, or a rectangle as of a sortie's area."""
    speed: fields.ShipSpeed
    """At which it tows and listens."""
    base: fields.Position | None = None
    """Where it is when it is ready; without it, wherever it is to begin."""
    transit_speed: fields.ShipSpeed | None = None
    """From its base to where it begins; without it as fast as it tows."""
    ready: fields.Time | None = None
    """From when on it can be sent; without it from the plan's begin on."""
    endurance: Annotated[fields.Duration | None, Field(gt=0)] = None
    """How long it listens at most; without it until the plan's end."""
    allowed: RegionTable | None = None
    """The area that it does not leave while it listens."""
    courses: Annotated[Any, BeforeValidator(_courses)] = None
    """Courses that it may steer, `[from, to]` clockwise; without it any."""
    legs: Annotated[fields.Count, Field(ge=1, le=2)] = 2
    """Most legs, 1 or 2."""

    @model_validator(mode="after")
    def moves(self) -> "TowTable":
        """Refuse a ship that does not move, and a transit from nowhere."""
        wrong = []
        if self.speed < LEAST_SPEED:
            wrong.append(
                f"speed {self.speed:.3g} m/s is too slow to tow an array; at least {LEAST_SPEED} m/s, 0.5 kn"
            )
        if self.transit_speed is not None and self.base is None:
            wrong.append(
                "transit_speed is of the way from its base: give base, or leave transit_speed out"
            )
        fields.refuse(self, wrong)
        return self

    def tow(self, name: str, run: Run, plan: PlanSpec) -> Tow:
        """Return the record; raise ValueError for what does not fit the plan."""
        sensor = sonar_table.sensor_named(self.sensor, run)
        if not isinstance(sensor.sees, Sonar):
            raise ValueError(f'sensor "{sensor.name}" is no sonar; a [[tow]] tows a sonar')
        if sensor.place is not None:
            raise ValueError(
                f'sensor "{sensor.name}" stands in one place (at); one that is towed has none: leave at out there'
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
    """Return the ships; raise UserError for what is wrong with one."""

    def maker(table: TowTable) -> Callable[[str, Run], Tow]:
        return lambda name, run: table.tow(name, run, plan)

    return tuple(
        build_each([maker(table) for table in tables], [table.name for table in tables], "tow", run)
    )
