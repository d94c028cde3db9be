"""Measurements of a contact by a sensor of the case: side, bearing error, level and frequency."""

import math
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.context import Run
from drift.case.sonar import sonar
from drift.case.values import fields, units
from drift.evidence.filter.records import Heard, Tone
from drift.evidence.sensors.records import PodGrid, Sensor, Sonar
from geo import sphere

WIDEST = 90.0  # [deg] largest standard deviation of a bearing
AHEAD = 1e-9  # [rad] tolerance within which a bearing equals its mirror image


def _std(value: object) -> float:
    degrees = units.quantity(value, "deg", "angle", "5 deg")
    if not 0 < degrees <= WIDEST:
        raise ValueError(f"std {degrees:g} deg must be above 0 and at most {WIDEST:g} deg")
    return degrees


def _bearing_error(value: object) -> Any:
    """Return a bearing's standard deviation [deg], or rows of (relative bearing, it) [deg]."""
    if not isinstance(value, list):
        return _std(value)
    if len(value) < 2 or not all(isinstance(row, list) and len(row) == 2 for row in value):
        raise ValueError(
            'std by relative bearing needs two or more rows, like [[0, "12 deg"], [90, "2 deg"]]'
        )
    rows = tuple(
        (units.quantity(angle, "deg", "relative bearing", "30 deg"), _std(std))
        for angle, std in value
    )
    angles = [angle for angle, _ in rows]
    if angles[0] != 0 or angles[-1] not in (90, 180):
        raise ValueError(
            f"std by relative bearing goes from {angles[0]:g} to {angles[-1]:g} deg; it must go from 0 to 180 deg, or to 90 "
            "deg if it is symmetric ahead and astern"
        )
    for k in range(1, len(rows)):
        if rows[k][0] <= rows[k - 1][0]:
            raise ValueError(f"std: {value[k][0]!r} does not come after {value[k - 1][0]!r}")
    return rows


def _width(value: object) -> float:
    degrees = units.quantity(value, "deg", "angle", "8 deg")
    if not 0 < degrees <= 360:
        raise ValueError(f"wedge {degrees:g} deg must be above 0 and at most 360 deg")
    return degrees


BearingError = Annotated[Any, BeforeValidator(_bearing_error)]
Wedge = Annotated[float, BeforeValidator(_width)]
Side = Literal["port", "starboard"]


class LevelTable(fields.Table):
    """The received level of a target, before the array gain."""

    value: Annotated[float | None, BeforeValidator(sonar.decibels("received level", -50, 250))] = (
        None
    )
    """Received level in the band of the source level: source level - transmission loss +
    fluctuation. In a series, the file gives it.
    """
    std: Annotated[float, BeforeValidator(sonar.decibels("std", 0, 30, above=True))]
    """Standard deviation of the measurement error; the sensor gives the fluctuation."""


class FrequencyTable(fields.Table):
    """The received frequency of a target, with the Doppler shift of target and sensor."""

    value: sonar.Frequency | None = None
    """Received frequency. In a series, the file gives it."""
    std: sonar.Frequency
    """Standard deviation of the measurement error."""
    source: sonar.Frequency
    """Source frequency."""
    source_std: Annotated[
        float, BeforeValidator(lambda value: units.quantity(value, "Hz", "frequency", "0.05 Hz"))
    ] = 0.0
    """Standard deviation of the source frequency; independent between contacts unless they have the
    same `source_group`.
    """
    source_group: fields.Label | None = None
    """Contacts of one group come from the same source; each contact improves the estimate of its
    frequency."""
    sound_speed: sonar.SoundSpeed = 1500.0
    """Sound speed in the water."""
    speed: fields.Speed = 0.0
    """Speed over ground of the sensor's platform."""
    course: fields.Direction | None = None
    """Course over ground of the sensor's platform; by default the heading of the array."""

    @model_validator(mode="after")
    def proper(self) -> "FrequencyTable":
        """Reject impossible Doppler shifts, and a source group with a known source frequency."""
        wrong = []
        if self.source_std < 0 or self.source_std > 0.2 * self.source:
            wrong.append(
                f"source_std {self.source_std:g} Hz must be 0 Hz to a fifth of source, {self.source:g} Hz"
            )
        if self.value is not None and not 0.8 < self.value / self.source < 1.25:
            wrong.append(
                f"value {self.value:g} Hz and source {self.source:g} Hz: no target is fast enough for this Doppler shift"
            )
        if self.source_group is not None and self.source_std == 0:
            wrong.append(
                "source_group: the source frequency is known exactly; give source_std, or leave source_group out"
            )
        fields.refuse(self, wrong)
        return self

    def tone(self) -> Tone:
        """Return the record of the tone."""
        assert self.value is not None
        return Tone(
            self.value,
            self.std,
            self.source,
            self.source_std,
            self.sound_speed,
            self.source_group or "",
        )


class BySensorTable(fields.Table):
    """The observer of a contact: a position, or a sensor of the case."""

    from_: fields.Position | None = Field(default=None, alias="from")
    """Position of the observer, or of a sensor without a fixed position."""
    sensor: fields.Label | None = None
    """Sensor of the case that made the contact; its POD replaces `zones`."""
    beams: list[fields.Count] | None = None
    """Beams of the array that were processed; by default all."""
    heading: fields.Direction | None = None
    """Heading of a towed array."""

    def without_sensor(self) -> list[str]:
        """Return the mistakes in the choice between a position and a sensor."""
        if self.sensor is not None:
            zones = getattr(self, "zones", None) is not None
            return (
                ["zones and sensor: the sensor defines its own POD; leave zones out"]
                if zones
                else []
            )
        wrong = [] if self.from_ is not None else ["from is missing and has no default"]
        return wrong + [
            f"{key} belongs to a sensor; give sensor, or leave {key} out"
            for key in ("beams", "heading")
            if getattr(self, key) is not None
        ]

    def heard(self, run: Run, turns: bool = False) -> Heard | None:
        """Return the record of the measurement; None without a sensor.

        Args:
            run: the run and its sensors.
            turns: whether the measurement depends on the heading of the sensor.

        Raises:
            ValueError: the sensor's position or heading is missing, or given twice.
        """
        if self.sensor is None:
            return None
        sensor = sonar.sensor_named(self.sensor, run)
        if sensor.place is not None and (self.from_ is not None or self.heading is not None):
            raise ValueError(
                f'sensor "{sensor.name}" has a fixed position (`at` in its table); leave out `from` and `heading` here'
            )
        if sensor.place is None and self.from_ is None:
            raise ValueError(
                f'where was sensor "{sensor.name}"? Give from here, or at in its [[sensor]] table'
            )
        array = turns or (isinstance(sensor.sees, Sonar) and len(sensor.sees.gain.bearing) > 1)
        if array and sensor.place is None and self.heading is None:
            raise ValueError(f'sensor "{sensor.name}" has an array: give its heading at the time')
        heading = sensor.heading if sensor.place is not None else math.radians(self.heading or 0.0)
        return Heard(sensor, sonar.beam_indices(self.beams, sensor), heading)

    def place(self, run: Run) -> tuple[float, float]:
        """Return the position (lon, lat) [deg] of the observer."""
        if self.sensor is not None:
            own = sonar.sensor_named(self.sensor, run).place
            if own is not None:
                return own
        assert self.from_ is not None
        return self.from_


def reach(sensor: Sensor) -> float:
    """Return the range [m] beyond which a sensor detects nothing; inf if there is no limit."""
    sees = sensor.sees
    ranges = sees.losses.range if isinstance(sees, Sonar) else sees.range
    return math.inf if ranges is None else float(ranges[-1])


def resolve_side(own: Heard, bearing: float, side: Side | None) -> Heard:
    """Return a measurement with its left-right ambiguity resolved by the side, if one is given.

    Args:
        own: the measurement.
        bearing: the measured bearing [rad], true.
        side: the side of the array on which the target is; None: unknown.

    Raises:
        ValueError: the array has no ambiguity, or the bearing is on the other side.
    """
    mirrored = isinstance(own.sensor.sees, Sonar) and own.sensor.sees.gain.mirrored
    if side is None:
        return replace(own, mirrored=mirrored)
    if not mirrored:
        raise ValueError(
            f'side: sensor "{own.sensor.name}" distinguishes port from starboard, or its gain is not `mirrored`; leave side out'
        )
    off = float(sphere.wrap(np.float64(bearing - own.heading)))
    if (off > AHEAD and side == "port") or (off < -AHEAD and side == "starboard"):
        image = 2 * own.heading - bearing
        other = "starboard" if side == "port" else "port"
        raise ValueError(
            f"bearing {math.degrees(bearing):.1f} is to {other} of heading {math.degrees(own.heading):.1f}; its image to {side} is "
            f"{math.degrees(image) % 360:.1f}: give that, or leave side out"
        )
    return own


def add_measurements(
    own: Heard, level: LevelTable | None, frequency: FrequencyTable | None
) -> Heard:
    """Add the measured level and frequency, if given, to a measurement.

    Args:
        own: the measurement.
        level: the received level.
        frequency: the received frequency.

    Raises:
        ValueError: values are missing, or do not apply to the sensor.
    """
    if isinstance(own.sensor.sees, PodGrid) and (level or frequency):
        raise ValueError(
            f'received_level and frequency belong to a sonar; sensor "{own.sensor.name}" has a POD table: leave them out'
        )
    for key, table in (("received_level", level), ("frequency", frequency)):
        if table is not None and table.value is None:
            raise ValueError(f"{key}: value is missing and has no default")
    if level is not None:
        assert level.value is not None
        own = replace(own, level=(level.value, level.std))
    if frequency is not None:
        if own.sensor.place is not None and (frequency.speed > 0 or frequency.course is not None):
            raise ValueError(
                f'sensor "{own.sensor.name}" has a fixed position; leave speed and course out'
            )
        course = own.heading if frequency.course is None else math.radians(frequency.course)
        velocity = frequency.speed * math.sin(course), frequency.speed * math.cos(course)
        own = replace(own, tone=frequency.tone(), velocity=velocity)
    return own
