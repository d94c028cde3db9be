"""Sensors that know the water, as a case file gives them: [[sensor]] tables, to which watches,
looks and contacts refer.

A sensor is a passive sonar, by the terms of its equation, or a table of POD by place or by bearing
and range.
"""

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.context import Run, build_each
from drift.case.forcing import sources
from drift.case.values import fields, units
from drift.engine.motion.scenario import Scenario

# the others as they are wanted: they import SciPy and xarray
from drift.evidence.sensors import unknown
from drift.evidence.sensors.records import Gain, Levels, Losses, Noise, PodGrid, Sensor, Sonar
from geo import sphere
from geo.errors import UserError

SHOWN = 3  # scenarios that a message names


def decibels(what: str, low: float, high: float, above: bool = False) -> Callable[[object], float]:
    """Return what reads decibels in [low, high], or (low, high]: a number, or a text with its unit."""

    def check(value: object) -> float:
        number = _decibels(value, what, _like(low, high))
        if not low <= number <= high or (above and number == low):
            least = f"above {low:g}" if above else f"{low:g}"
            raise ValueError(
                f'{what} {value!r} must be {least} to {high:g} dB; write its unit, like "{_like(low, high)}"'
            )
        return number

    return check


def _like(low: float, high: float) -> str:
    return f"{(low + high) / 2:g} dB"


def _decibels(value: object, what: str, example: str = "6 dB") -> float:
    """Return decibels, of a number or a text "140 dB"; pint takes a logarithmic unit for a ratio."""
    text = value
    if isinstance(value, str):
        text = value.strip().removesuffix("dB").strip() if value.strip().endswith("dB") else value
    try:
        if isinstance(text, bool) or not isinstance(text, str | int | float):
            raise ValueError
        number = float(text)
    except ValueError:
        raise ValueError(
            f'{what} {value!r} is no number of decibels; write it like "{example}"'
        ) from None
    if not math.isfinite(number):
        raise ValueError(f"{what} {value!r} must be finite")
    return number


SOURCE = decibels("source level", 50, 250)
Level = float | tuple[tuple[float, float], ...]  # [dB], or rows of speed [m/s] and level


def source_level(value: object) -> Level:
    """Return a source level [dB], or rows of speed [m/s] and level."""
    if not isinstance(value, list):
        return SOURCE(value)
    if len(value) < 2 or not all(isinstance(row, list) and len(row) == 2 for row in value):
        raise ValueError('source_level by speed needs two or more rows, like ["5 kn", "128 dB"]')
    rows = tuple(
        (units.quantity(speed, "m/s", "speed", "5 kn"), SOURCE(level)) for speed, level in value
    )
    for k in range(1, len(rows)):
        if not 0 <= rows[k - 1][0] < rows[k][0]:
            raise ValueError(
                f"source_level: speed {value[k][0]!r} does not come after {value[k - 1][0]!r}"
            )
    return rows


def _source_levels(value: object) -> Any:
    """Return one for all scenarios, or a dict of them by scenario."""
    if isinstance(value, dict):
        if not value:
            raise ValueError("source_level is empty; give a level, or one for each scenario")
        return {str(name): source_level(level) for name, level in value.items()}
    return source_level(value)


SourceLevel = Annotated[Any, BeforeValidator(source_level)]


class FileTable(fields.Table):
    """A table of values in a netCDF file."""

    file: str
    """The netCDF file."""
    variable: fields.Label | None = None
    """The variable, where the file leaves it open."""
    select: dict[str, Any] | None = None
    """The value of each further dimension that has several: `{ depth = 100 }`."""
    units: dict[str, str] | None = None
    """Units of variables whose attribute is absent or wrong."""

    def asked(self) -> dict[str, Any]:
        """Return what readers take besides the path."""
        return {"variable": self.variable, "select": self.select, "units": self.units}


def _rate_of_loss(value: object) -> float:
    """Return an absorption [dB/km]."""
    text = str(value).strip()
    for suffix in ("dB/km", "dB / km"):
        if text.endswith(suffix):
            text = text.removesuffix(suffix).strip()
    try:
        number = float(text)
    except ValueError:
        raise ValueError(
            f'absorption {value!r} must be decibels a kilometre, like "0.02 dB/km"'
        ) from None
    if not 0 <= number < 1000:
        raise ValueError(f'absorption {value!r} must be 0 to 1000 dB/km, like "0.02 dB/km"')
    return number


def _zone(row: object) -> tuple[float, float, float]:
    if not isinstance(row, list) or len(row) != 3:
        raise ValueError(
            f'{row!r} is not a zone; write [inner range, outer range, gain], like ["28 nmi", "33 nmi", "10 dB"]'
        )
    inner, outer = (units.quantity(x, "m", "distance", "28 nmi") for x in row[:2])
    return inner, outer, _decibels(row[2], "gain")


def _frequency(value: object) -> float:
    number = units.quantity(value, "Hz", "frequency", "50 Hz")
    if number <= 0:
        raise ValueError(f"frequency {value!r} must be above 0 Hz")
    return number


Frequency = Annotated[float, BeforeValidator(_frequency)]


def _sound_speed(value: object) -> float:
    number = units.quantity(value, "m/s", "speed of sound", "1500 m/s")
    if not 1000 <= number <= 2000:
        raise ValueError(f"sound_speed {value!r} must be 1000 to 2000 m/s")
    return number


SoundSpeed = Annotated[float, BeforeValidator(_sound_speed)]


class LossTable(FileTable):
    """Transmission loss: of a file by bearing and range, at one place or several; or by a formula."""

    file: str | None = None  # type: ignore[assignment]
    """A netCDF file; without it a formula holds."""
    spreading: float = 20.0
    """Of the formula, decibels for ten times the range, up to the transition."""
    transition: Annotated[fields.Length | None, Field(gt=0)] = None
    """From which range on the loss spreads as in a duct, 10 dB for ten times the range; without it
    nowhere.
    """
    absorption: Annotated[float | None, BeforeValidator(_rate_of_loss)] = None
    """Absorption, like `"0.02 dB/km"`; without it that of Francois and Garrison (1982) at
    `frequency`, or none.
    """
    frequency: Frequency | None = None
    """Of the formula, for its absorption."""
    zones: list[Annotated[Any, BeforeValidator(_zone)]] = Field(default_factory=list)
    """Convergence zones, `["28 nmi", "33 nmi", "10 dB"]`: inner and outer range, and by how much
    the loss is less there.
    """
    to: Annotated[fields.Length | None, Field(gt=0)] = None
    """Of the formula, the range beyond which nothing is heard; 500 nmi without it."""

    @model_validator(mode="after")
    def one_way(self) -> "LossTable":
        """Refuse a file and a formula at once, and two absorptions."""
        given = [
            key
            for key in ("spreading", "transition", "absorption", "frequency", "zones", "to")
            if key in self.model_fields_set
        ]
        if self.file is not None and given:
            raise ValueError(
                f"file and {given[0]}: the loss is that of a file, or of a formula; give one of them"
            )
        if self.file is None and (self.variable or self.select or self.units):
            raise ValueError(
                "variable, select and units are of a file; give file, or leave them out"
            )
        if self.absorption is not None and self.frequency is not None:
            raise ValueError("give absorption, or frequency from which it follows, not both")
        return self

    def losses(self, folder: Path) -> Losses:
        """Return the record; raise UserError for what is wrong with the file or the numbers."""
        from drift.evidence.sensors import losses, spreading

        if self.file is not None:
            return losses.read_losses(
                sources.one_file(self.file, folder, "loss.file"), name="loss", **self.asked()
            )
        absorbed = self.absorption
        if absorbed is None:
            absorbed = 0.0 if self.frequency is None else spreading.absorption(self.frequency)
        return spreading.losses(
            self.to or 500 * 1852.0,
            coefficient=self.spreading,
            transition=self.transition,
            absorption=absorbed,
            zones=self.zones,
            name="loss",
        )


class LineTable(fields.Table):
    """A line array of equal elements."""

    elements: fields.Count
    """How many."""
    spacing: Annotated[fields.Length, Field(gt=0)]
    """From one to the next."""
    frequency: Frequency
    """At which it listens."""
    sound_speed: SoundSpeed = 1500.0
    """Of the water."""
    beams: fields.Count | None = None
    """How many beams, from dead ahead to dead astern; without it as many as cross at -3 dB."""
    steered: list[fields.Direction] | None = None
    """Or their relative bearings, 0 to 180 degrees."""

    def gain(self) -> Gain:
        """Return the record."""
        from drift.evidence.sensors import line_array

        turned = None if self.steered is None else [math.radians(angle) for angle in self.steered]
        return line_array.of_line(
            self.elements,
            self.spacing,
            self.frequency,
            sound_speed=self.sound_speed,
            beams=self.beams,
            steered=turned,
            name="gain",
        )


class GainTable(fields.Table):
    """Array gain by relative bearing, or of a line of elements."""

    table: list[list[Any]] | None = None
    """Rows of relative bearing and gain, `[30, "12 dB"]`."""
    symmetric: bool = False
    """Whether the rows go from 0 to 180 degrees and hold on either side."""
    mirrored: bool = False
    """Whether it cannot distinguish port from starboard."""
    line: LineTable | None = None
    """A line array of equal elements."""

    @model_validator(mode="after")
    def one_kind(self) -> "GainTable":
        """Refuse none or two kinds."""
        fields.one_of(self, ("table", "line"))
        return self

    def gain(self) -> Gain:
        """Return the record; raise UserError for a pattern with gaps."""
        from drift.evidence.sensors import line_array

        if self.line is not None:
            return self.line.gain()
        assert self.table is not None
        return line_array.of_table(
            _rows(self.table, "gain"), symmetric=self.symmetric, mirrored=self.mirrored, name="gain"
        )


def _rows(table: Sequence[Any], what: str) -> list[list[float]]:
    """Return rows of a bearing [deg] and decibels."""
    rows = []
    for row in table:
        if not isinstance(row, list) or len(row) != 2:
            raise ValueError(
                f'{what}: {row!r} is not a row; write [bearing, decibels], like [30, "12 dB"]'
            )
        rows.append([units.quantity(row[0], "deg", "bearing", "30 deg"), _decibels(row[1], what)])
    return rows


def _noise(value: object) -> Any:
    if isinstance(value, dict):
        return FileTable.model_validate(value)
    if isinstance(value, list):
        return _rows(value, "noise")
    return _decibels(value, "noise")


def _gain(value: object) -> Any:
    if isinstance(value, dict):
        return GainTable.model_validate(value)
    if isinstance(value, list):
        return GainTable.model_validate({"table": value})
    return _decibels(value, "gain")


class SonarTable(fields.Table):
    """A passive sonar: signal excess = source level - loss - (noise - gain) - threshold."""

    source_level: Annotated[Any, BeforeValidator(_source_levels)] = None
    """Of the target [dB re 1 uPa at 1 m], rows of speed and level, or a table of either by
    scenario; without it the scenarios have their own.
    """
    loss: LossTable = LossTable()
    """Transmission loss."""
    noise: Annotated[Any, BeforeValidator(_noise)]
    """Ambient noise: a level, rows of true bearing and level (four quarters will do), or `{ file =
    .. }` by bearing and time.
    """
    gain: Annotated[Any, BeforeValidator(_gain)] = 0.0
    """Array gain: a number, rows of relative bearing and gain, or a table with `line`, `symmetric`
    and `mirrored`.
    """
    threshold: Annotated[float, BeforeValidator(decibels("threshold", -100, 100))] = 0.0
    """Detection threshold."""
    fluctuation: Annotated[float, BeforeValidator(decibels("fluctuation", 0, 30, above=True))] = 6.0
    """Standard deviation of the signal excess."""
    jump_rate: Annotated[float, BeforeValidator(fields.rate)] = 1 / 3600
    """How often it jumps to another value, like `"2 /h"`; once an hour without it."""
    unknown: Annotated[float, BeforeValidator(decibels("unknown", 0, 45))] = 0.0
    """Standard deviation of what all looks and watches of its group have in common."""

    @model_validator(mode="after")
    def held(self) -> "SonarTable":
        """Refuse an unknown that so few values do not stand for."""
        if self.unknown > unknown.MOST * self.fluctuation:
            raise ValueError(
                f"unknown {self.unknown:g} dB must be at most {unknown.MOST:g} times the fluctuation, "
                f"{self.fluctuation:g} dB"
            )
        return self

    def sonar(self, folder: Path, scenarios: Sequence[Scenario]) -> Sonar:
        """Return the record; raise UserError or ValueError for what is wrong."""
        from drift.evidence.sensors import line_array, noise

        heard: Noise
        if isinstance(self.noise, FileTable):
            path = sources.one_file(self.noise.file, folder, "noise.file")
            heard = noise.read_noise(path, name="noise", **self.noise.asked())
        elif isinstance(self.noise, list):
            heard = noise.of_table(self.noise, name="noise")
        else:
            heard = noise.constant(self.noise, name="noise")
        gain = (
            self.gain.gain()
            if isinstance(self.gain, GainTable)
            else line_array.of_table([[0, self.gain]], name="gain")
        )
        return Sonar(
            self.levels(scenarios),
            self.loss.losses(folder),
            heard,
            gain,
            self.threshold,
            self.fluctuation,
            self.jump_rate,
            self.unknown,
        )

    def levels(self, scenarios: Sequence[Scenario]) -> Levels:
        """Return the source levels of scenarios; raise ValueError where one has none."""
        given = self.source_level
        every: list[Level | None]
        if isinstance(given, dict):
            names = [scenario.name for scenario in scenarios]
            for name in given:
                if name not in names:
                    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
                    hint = f'did you mean "{near[0]}"? ' if near else ""
                    raise ValueError(
                        f'source_level: no scenario "{name}"; {hint}there are: {", ".join(names[:20])}'
                    )
            every = [given.get(scenario.name, scenario.source_level) for scenario in scenarios]
        elif given is not None:
            every = [given] * len(scenarios)
        else:
            every = [scenario.source_level for scenario in scenarios]
        without = [
            f'"{scenario.name}"'
            for scenario, own in zip(scenarios, every, strict=True)
            if own is None
        ]
        if without:
            more = f" and {len(without) - SHOWN} more" if len(without) > SHOWN else ""
            raise ValueError(
                f"source_level is missing for scenario {', '.join(without[:SHOWN])}{more}; give it here, "
                'like "140 dB", or in the scenario'
            )
        rows = [own if isinstance(own, tuple) else ((0.0, float(own or 0.0)),) for own in every]
        speeds = sorted({speed for own in rows for speed, _ in own})
        table = [np.interp(speeds, *np.array(own).T) for own in rows]
        return Levels(np.array(speeds), np.array(table, np.float32))


class PodTable(FileTable):
    """POD of any sensor by place and time, or by bearing and range round it."""

    per: fields.Duration | None = None
    """How long what is detected with this probability is there; without it, for as long as the
    watch.
    """
    gaps: Literal["refuse", "blind"] = "refuse"
    """`"blind"`: nothing is detected where the file has no value; else such a file is rejected."""
    coordinates: dict[str, str] | None = None
    """Names of `lon`, `lat` or `crs`, where the file leaves them open."""

    def grid(self, folder: Path) -> PodGrid:
        """Return the record; raise UserError for what is wrong with the file."""
        from drift.evidence.sensors import pod_grid

        path = sources.one_file(self.file, folder, "pod.file")
        return pod_grid.read_pod(
            path,
            per=math.nan if self.per is None else self.per,
            gaps=self.gaps,
            coordinates=self.coordinates,
            name="pod",
            **self.asked(),
        )


class NamedSensorTable(fields.Table):
    """A [[sensor]] table as written."""

    name: fields.Label
    """What watches, looks, contacts and units call it."""
    at: fields.Position | None = None
    """Where it stands; without it, on what carries it."""
    heading: fields.Direction | None = None
    """Of the array of a sensor that stands; of one that is towed it is the course."""
    group: fields.Label | None = None
    """Sensors of one group share their `unknown`; by default each has its own."""
    sonar: SonarTable | None = None
    """A passive sonar."""
    pod: PodTable | None = None
    """POD by place, or by bearing and range."""

    @model_validator(mode="after")
    def one_kind(self) -> "NamedSensorTable":
        """Refuse none or two kinds, and a heading of what is towed."""
        wrong = []
        try:
            fields.one_of(self, ("sonar", "pod"))
        except ValueError as error:
            wrong.append(str(error))
        if self.heading is not None and self.at is None:
            wrong.append(
                "heading is of a sensor that stands; give at, or leave heading out: a towed array lies along its course"
            )
        fields.refuse(self, wrong)
        return self

    def sensor(self, name: str, run: Run) -> Sensor:
        """Return the record; raise ValueError or UserError for what is wrong."""
        sees: Sonar | PodGrid
        if self.sonar is not None:
            sees = self.sonar.sonar(run.folder, run.scenarios)
        else:
            assert self.pod is not None
            sees = self.pod.grid(run.folder)
        if (
            isinstance(sees, Sonar)
            and len(sees.gain.bearing) > 1
            and self.at is not None
            and self.heading is None
        ):
            raise ValueError(
                "heading is missing: it stands and has an array, whose gains are relative to its heading"
            )
        place = self.at
        if (
            place is None
            and isinstance(sees, PodGrid)
            and sees.lon is not None
            and sees.lat is not None
        ):
            # It sees where its table says, wherever it is: it is drawn in the middle.
            place = (
                float(sphere.wrap_degrees(np.degrees(0.5 * (sees.lon[0] + sees.lon[-1])))),
                float(np.degrees(0.5 * (sees.lat[0] + sees.lat[-1]))),
            )
        return Sensor(name, sees, place, math.radians(self.heading or 0.0), self.group or name)


def build_sensors(tables: Sequence[NamedSensorTable], run: Run) -> dict[str, Sensor]:
    """Return the sensors by name; raise UserError for all that is wrong with them."""
    every = build_each(
        [table.sensor for table in tables], [table.name for table in tables], "sensor", run
    )
    return {sensor.name: sensor for sensor in _in_groups(every)}


def _in_groups(every: Sequence[Sensor]) -> list[Sensor]:
    """Return sensors that know of their group how steady its steadiest is; raise UserError where
    unknowns differ.
    """
    first: dict[str, tuple[str, Sonar]] = {}
    steadiest: dict[str, float] = {}
    for sensor in every:
        sonar = sensor.sees
        if not isinstance(sonar, Sonar) or sonar.unknown == 0:
            continue
        name, other = first.setdefault(sensor.group, (sensor.name, sonar))
        if other.unknown != sonar.unknown:
            raise UserError(
                f'sensor "{sensor.name}": its unknown is {sonar.unknown:g} dB, and that of sensor "{name}" of the same group, '
                f'"{sensor.group}", {other.unknown:g} dB; a group shares one: give both the same, or groups of their own'
            )
        steadiest[sensor.group] = min(steadiest.get(sensor.group, math.inf), sonar.fluctuation)
    return [replace(sensor, steadiest=steadiest.get(sensor.group, math.inf)) for sensor in every]


def sensor_named(name: str, run: Run) -> Sensor:
    """Return the sensor of a name; raise ValueError where there is none."""
    if name not in run.sensors:
        near = difflib.get_close_matches(name, list(run.sensors), n=1, cutoff=0.5)
        hint = f'did you mean "{near[0]}"? ' if near else ""
        there = ", ".join(run.sensors) or "none; write it as [[sensor]]"
        raise ValueError(f'no sensor "{name}"; {hint}there are: {there}')
    return run.sensors[name]


def beam_indices(given: Sequence[int] | None, sensor: Sensor) -> tuple[int, ...]:
    """Return numbers of beams, from 0, given from 1; raise ValueError for those that the sensor
    does not have.
    """
    if given is None:
        return ()
    if not isinstance(sensor.sees, Sonar):
        raise ValueError(f'beams: sensor "{sensor.name}" is no sonar; leave beams out')
    many = len(sensor.sees.gain.beams)
    if not given or min(given) < 1 or max(given) > many or len(set(given)) < len(given):
        raise ValueError(
            f'beams {list(given)} must be numbers from 1 to {many}, the beams of sensor "{sensor.name}", each once'
        )
    return tuple(sorted(number - 1 for number in given))
