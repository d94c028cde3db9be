"""The [[look]] table: an observation of a field at one time; and the field of looks and
presences."""

import difflib
import itertools
import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.context import Run, build_each
from drift.case.search.sensor import probability
from drift.case.sonar import sonar
from drift.case.values import fields, units
from drift.evidence.filter import records
from drift.evidence.filter.detection import sight
from drift.evidence.filter.records import Look, Sight
from drift.evidence.sensors.records import Sensor, Sonar
from geo.notation import NMI

LEAST = 10.0  # [m] smallest size of a field
LARGEST = 1000 * NMI  # [m] largest size: a field is projected about its centre
STEEPEST = 100.0  # largest beta; above it the detection function is a cookie cutter


def _side(value: object) -> float:
    number = units.quantity(value, "m", "distance", "30 nmi")
    if not LEAST <= number <= LARGEST:
        raise ValueError(
            f'{value!r} must be {LEAST:g} m to {LARGEST / NMI:g} nmi; write its unit, like "30 nmi"'
        )
    return number


Side = Annotated[float, BeforeValidator(_side)]
FalseAlarms = Annotated[float, BeforeValidator(lambda value: probability(value, "false_alarms"))]


class FieldTable(fields.Table):
    """A field: a box or a circle around a position."""

    at: fields.Position
    radius: Side | None = None
    width: Side | None = None
    height: Side | None = None
    turned: fields.Direction | None = None

    @model_validator(mode="after")
    def one_shape(self) -> "FieldTable":
        """Reject no shape or two, and an incomplete box."""
        fields.refuse(self, self.misshapen())
        return self

    def misshapen(self) -> list[str]:
        """Return the mistakes in its shape."""
        box = [key for key in ("width", "height") if getattr(self, key) is not None]
        wrong = []
        if self.radius is not None and (box or self.turned is not None):
            more = [*box, *(["turned"] if self.turned is not None else [])]
            wrong.append(
                f"{' and '.join(more)} (a box) and radius (a circle): give one or the other"
            )
        elif self.radius is None and len(box) < 2:
            missing = (
                "width and height, or radius, are"
                if not box
                else f"{({'width', 'height'} - {*box}).pop()} is"
            )
            wrong.append(f"{missing} missing: a field is a box or a circle about `at`")
        return wrong

    def field(self) -> records.Field:
        """Return the record of the field."""
        if self.radius is not None:
            return records.Field(*self.at, radius=self.radius)
        return records.Field(
            *self.at,
            width=self.width or 0.0,
            height=self.height or 0.0,
            turned=math.radians(self.turned or 0.0),
        )


def _sight(value: object) -> Sight:
    if isinstance(value, Sight):
        return value
    if value == "cookie_cutter":
        return Sight()
    if isinstance(value, dict) and len(value) == 1:
        ((kind, given),) = value.items()
        if kind in WITH_NUMBERS:
            return WITH_NUMBERS[kind][0](given)
    near = difflib.get_close_matches(str(value), ["cookie_cutter"], n=1, cutoff=0.5)
    hint = f'did you mean "{near[0]}"? ' if near and isinstance(value, str) else ""
    allowed = ", ".join(['"cookie_cutter"', *(example for _, example in WITH_NUMBERS.values())])
    raise ValueError(f"no detection function {value!r}; {hint}Allowed: {allowed}")


def _linear(value: object) -> Sight:
    alpha = probability(value, "alpha")
    if alpha == 0:
        raise ValueError(
            "linear 0 detects everything everywhere; give the decrease of the POD from the centre to the edge"
        )
    return Sight("linear", alpha)


def _exponential(value: object) -> Sight:
    beta = units.quantity(value, "", "beta", "2")
    if not 0 < beta <= STEEPEST:
        raise ValueError(
            f"beta {value!r} must be above 0 and at most {STEEPEST:g}; beyond, it is a cookie cutter"
        )
    return Sight("exponential", beta)


def _table(value: object) -> Sight:
    if (
        not isinstance(value, list)
        or len(value) < 2
        or not all(isinstance(row, list) and len(row) == 2 for row in value)
    ):
        raise ValueError(
            "table needs two or more rows of distance and chance of detection, like [1, 0.4]"
        )
    distances = tuple(
        units.quantity(row[0], "", "distance in half sizes of the field", "1.5") for row in value
    )
    chances = tuple(probability(row[1], "chance of detection") for row in value)
    if distances[0] != 0:
        raise ValueError(
            f"table begins at {value[0][0]!r}; its first distance must be 0, the middle of the field"
        )
    for k, (near, far) in enumerate(itertools.pairwise(distances)):
        if far <= near:
            raise ValueError(f"table: {value[k + 1][0]!r} does not come after {value[k][0]!r}")
    if max(chances) == 0:
        raise ValueError("table detects nothing at any distance")
    return Sight("table", 1.0, distances, chances)


WITH_NUMBERS = {  # detection functions with parameters: their parser and an example
    "linear": (_linear, "{ linear = 0.95 }"),
    "exponential": (_exponential, "{ exponential = 2 }"),
    "table": (_table, "{ table = [[0, 0.9], [1, 0.4]] }"),
}


class LookTable(FieldTable):
    """A [[look]] table as written."""

    at: fields.Position | None = None  # type: ignore[assignment]
    name: fields.Label | None = None
    time: fields.Time
    sees: Literal["something", "nothing"]
    law: Annotated[Sight, BeforeValidator(_sight)] = Field(default=Sight())
    false_alarms: FalseAlarms = 0.0
    sensor: fields.Label | None = None
    beams: list[fields.Count] | None = None
    heading: fields.Direction | None = None

    @model_validator(mode="after")
    def one_shape(self) -> "LookTable":
        """Reject a sensor together with a field, and neither of the two."""
        wrong = []
        if self.sensor is None:
            wrong += [
                f"{key} belongs to a sensor; give sensor, or leave {key} out"
                for key in ("beams", "heading")
                if getattr(self, key) is not None
            ]
            wrong += ["at is missing and has no default"] if self.at is None else []
            wrong += self.misshapen()
        else:
            given = [
                key
                for key in ("radius", "width", "height", "turned", "law")
                if key in self.model_fields_set
            ]
            wrong += [
                f"{key} belongs to a field; a sensor has its own detection function: leave {key} out"
                for key in given
            ]
        fields.refuse(self, wrong)
        return self

    def look(self, name: str, run: Run) -> Look:
        """Return the record of the look; raise ValueError if it does not fit the run."""
        time = units.resolve(self.time, run.start)
        run.check(time, time)
        if self.false_alarms == 1:
            raise ValueError(
                "false_alarms = 1 reports something everywhere and is no evidence; leave the look out"
            )
        if self.sensor is not None:
            return self._by_sensor(sonar.sensor_named(self.sensor, run), name, time, run)
        return Look(name, time, self.field(), self.sees == "something", self.law, self.false_alarms)

    def _by_sensor(self, sensor: Sensor, name: str, time: np.datetime64, run: Run) -> Look:
        """Return the record of a look by a sensor; raise ValueError if keys do not fit the
        sensor."""
        if sensor.place is not None and (self.at is not None or self.heading is not None):
            raise ValueError(
                f'sensor "{sensor.name}" has a fixed position (at in its table); leave at and heading out here'
            )
        place = sensor.place or self.at
        if place is None:
            raise ValueError(
                f'where is sensor "{sensor.name}"? Give at here, or in its [[sensor]] table'
            )
        array = isinstance(sensor.sees, Sonar) and len(sensor.sees.gain.bearing) > 1
        if array and sensor.place is None and self.heading is None:
            raise ValueError(f'sensor "{sensor.name}" has an array: give its heading at the time')
        if sight.level_depends_on_speed(sensor) and time == run.start:
            raise ValueError(
                f'sensor "{sensor.name}" has a source level by speed; at the start of the run the speed is unknown: start the run earlier'
            )
        heading = sensor.heading if sensor.place is not None else math.radians(self.heading or 0.0)
        return Look(
            name,
            time,
            None,
            self.sees == "something",
            false_alarms=self.false_alarms,
            sensor=sensor,
            beams=sonar.beam_indices(self.beams, sensor),
            place=place,
            heading=heading,
        )


def build_looks(tables: list[LookTable], run: Run) -> tuple[Look, ...]:
    """Return the looks, ordered by time; raise UserError with all their mistakes."""
    looks: list[Any] = build_each(
        [table.look for table in tables], [table.name for table in tables], "look", run
    )
    return tuple(sorted(looks, key=lambda look: look.time))
