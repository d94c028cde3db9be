"""The [[sensor]] table: sensors to which watches, looks and contacts refer by name.

A sensor is a passive sonar, given by the terms of the sonar equation, or a table of POD by position
or by bearing and range.
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

# other modules of this package import SciPy and xarray, and are imported where needed
from drift.evidence.sensors import unknown
from drift.evidence.sensors.records import Gain, Levels, Losses, Noise, PodGrid, Sensor, Sonar
from geo import sphere
from geo.errors import UserError

SHOWN = 3  # most scenarios named in a message


def decibels(what: str, low: float, high: float, above: bool = False) -> Callable[[object], float]:
    """Return a validator of decibels in [low, high], given as a number or text with its unit.

    Args:
        what: kind of quantity, for messages.
        low: least value [dB].
        high: largest value [dB].
        above: whether `low` itself is excluded.
    """

    def check(value: object) -> float:
        number = _decibels(value, what, _example(low, high))
        if not low <= number <= high or (above and number == low):
            least = f"above {low:g}" if above else f"{low:g}"
            raise ValueError(
                f'{what} {value!r} must be {least} to {high:g} dB; write its unit, like "{_example(low, high)}"'
            )
        return number

    return check


def _example(low: float, high: float) -> str:
    return f"{(low + high) / 2:g} dB"


def _decibels(value: object, what: str, example: str = "6 dB") -> float:
    """Return decibels from a number or text "140 dB"; pint would convert the unit to a ratio."""
    text = value
    if isinstance(value, str):
        text = value.strip().removesuffix("dB").strip() if value.strip().endswith("dB") else value
    try:
        if isinstance(text, bool) or not isinstance(text, str | int | float):
            raise ValueError
        number = float(text)
    except ValueError:
        raise ValueError(
            f'{what} {value!r} is not a number of decibels; write it like "{example}"'
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
    """Return one source level for all scenarios, or source levels by scenario."""
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
    """Name of the variable, if the file has several."""
    select: dict[str, Any] | None = None
    """Coordinate value of each further dimension with more than one: `{ depth = 100 }`."""
    units: dict[str, str] | None = None
    """Units of variables whose units attribute is missing or wrong."""

    def asked(self) -> dict[str, Any]:
        """Return the keyword arguments of the readers, except the path."""
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
    """Transmission loss: from a file by bearing and range, at one position or more; or a
    formula."""

    file: str | None = None  # type: ignore[assignment]
    """A netCDF file; by default drift uses a formula."""
    spreading: float = 20.0
    """Formula: spreading loss in decibels per tenfold range, up to the transition."""
    transition: Annotated[fields.Length | None, Field(gt=0)] = None
    """Formula: range beyond which spreading is cylindrical, 10 dB per tenfold range; by default
    nowhere.
    """
    absorption: Annotated[float | None, BeforeValidator(_rate_of_loss)] = None
    """Absorption, like `"0.02 dB/km"`; by default that of Francois and Garrison (1982) at
    `frequency`, or none.
    """
    frequency: Frequency | None = None
    """Formula: frequency from which the absorption is computed."""
    zones: list[Annotated[Any, BeforeValidator(_zone)]] = Field(default_factory=list)
    """Convergence zones, `["28 nmi", "33 nmi", "10 dB"]`: inner range, outer range, and reduction
    of the loss.
    """
    to: Annotated[fields.Length | None, Field(gt=0)] = None
    """Formula: range beyond which nothing is detected; by default 500 nmi."""

    @model_validator(mode="after")
    def one_way(self) -> "LossTable":
        """Reject a file together with a formula, and two absorptions."""
        given = [
            key
            for key in ("spreading", "transition", "absorption", "frequency", "zones", "to")
            if key in self.model_fields_set
        ]
        if self.file is not None and given:
            raise ValueError(
                f"file and {given[0]}: the loss comes from a file or from a formula; give one of them"
            )
        if self.file is None and (self.variable or self.select or self.units):
            raise ValueError(
                "variable, select and units belong to a file; give file, or leave them out"
            )
        if self.absorption is not None and self.frequency is not None:
            raise ValueError("give absorption, or frequency to compute it from, not both")
        return self

    def losses(self, folder: Path) -> Losses:
        """Return the record of the losses; raise UserError for an invalid file or numbers."""
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
    """Number of elements."""
    spacing: Annotated[fields.Length, Field(gt=0)]
    """Distance between neighbouring elements."""
    frequency: Frequency
    """Frequency at which the array listens."""
    sound_speed: SoundSpeed = 1500.0
    """Sound speed in the water."""
    beams: fields.Count | None = None
    """Number of beams, from dead ahead to dead astern; by default neighbouring beams cross at -3
    dB."""
    steered: list[fields.Direction] | None = None
    """In place of `beams`: relative bearings of the beams, 0 to 180 degrees."""

    def gain(self) -> Gain:
        """Return the record of the gain."""
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
    """Array gain by relative bearing, or of a line array."""

    table: list[list[Any]] | None = None
    """Rows of relative bearing and gain, `[30, "12 dB"]`."""
    symmetric: bool = False
    """`true`: the rows go from 0 to 180 degrees and apply to both sides."""
    mirrored: bool = False
    """`true`: the array cannot distinguish port from starboard."""
    line: LineTable | None = None
    """A line array of equal elements."""

    @model_validator(mode="after")
    def one_kind(self) -> "GainTable":
        """Reject no kind of gain, or two."""
        fields.one_of(self, ("table", "line"))
        return self

    def gain(self) -> Gain:
        """Return the record of the gain; raise UserError for a pattern with gaps."""
        from drift.evidence.sensors import line_array

        if self.line is not None:
            return self.line.gain()
        assert self.table is not None
        return line_array.of_table(
            _rows(self.table, "gain"), symmetric=self.symmetric, mirrored=self.mirrored, name="gain"
        )


def _rows(table: Sequence[Any], what: str) -> list[list[float]]:
    """Return rows (bearing [deg], level [dB])."""
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
    """Source level of the target [dB re 1 uPa at 1 m], rows of speed and level, or a table of
    either
    by scenario; by default the scenarios give it.
    """
    loss: LossTable = LossTable()
    """Transmission loss."""
    noise: Annotated[Any, BeforeValidator(_noise)]
    """Ambient noise: a level, rows of true bearing and level (four rows suffice), or `{ file = ..
    }`
    by bearing and time.
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
    """Rate at which the fluctuation jumps to a new value, like `"2 /h"`; by default once an
    hour."""
    unknown: Annotated[float, BeforeValidator(decibels("unknown", 0, 45))] = 0.0
    """Standard deviation of the constant error that all looks and watches of its group share."""

    @model_validator(mode="after")
    def held(self) -> "SonarTable":
        """Reject an `unknown` too large for the quadrature that represents it."""
        if self.unknown > unknown.MOST * self.fluctuation:
            raise ValueError(
                f"unknown {self.unknown:g} dB must be at most {unknown.MOST:g} times the fluctuation, "
                f"{self.fluctuation:g} dB"
            )
        return self

    def sonar(self, folder: Path, scenarios: Sequence[Scenario]) -> Sonar:
        """Return the record of the sonar.

        Args:
            folder: folder from which relative paths start.
            scenarios: the scenarios of the case.

        Raises:
            UserError: a file is invalid.
            ValueError: a scenario has no source level.
        """
        from drift.evidence.sensors import line_array, noise

        noise_record: Noise
        if isinstance(self.noise, FileTable):
            path = sources.one_file(self.noise.file, folder, "noise.file")
            noise_record = noise.read_noise(path, name="noise", **self.noise.asked())
        elif isinstance(self.noise, list):
            noise_record = noise.of_table(self.noise, name="noise")
        else:
            noise_record = noise.constant(self.noise, name="noise")
        gain = (
            self.gain.gain()
            if isinstance(self.gain, GainTable)
            else line_array.of_table([[0, self.gain]], name="gain")
        )
        return Sonar(
            self.levels(scenarios),
            self.loss.losses(folder),
            noise_record,
            gain,
            self.threshold,
            self.fluctuation,
            self.jump_rate,
            self.unknown,
        )

    def levels(self, scenarios: Sequence[Scenario]) -> Levels:
        """Return the source levels of the scenarios; raise ValueError if one has none."""
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
    """POD of any sensor by position and time, or by bearing and range from the sensor."""

    per: fields.Duration | None = None
    """Exposure time to which the POD refers; by default the duration of the watch."""
    gaps: Literal["refuse", "blind"] = "refuse"
    """`"blind"`: the POD is 0 where the file has no value; by default such a file is rejected."""
    coordinates: dict[str, str] | None = None
    """Names of the variables `lon`, `lat` or `crs`, if drift cannot find these in the file."""

    def grid(self, folder: Path) -> PodGrid:
        """Return the record of the POD table; raise UserError for an invalid file."""
        from drift.evidence.sensors import pod_file

        path = sources.one_file(self.file, folder, "pod.file")
        return pod_file.read_pod(
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
    """Name of the sensor, to which watches, looks, contacts and units refer."""
    at: fields.Position | None = None
    """Fixed position of the sensor; without it, the sensor moves with its platform."""
    heading: fields.Direction | None = None
    """Heading of the array of a fixed sensor; a towed array has the course of its ship."""
    group: fields.Label | None = None
    """Sensors of one group share their `unknown`; by default each has its own."""
    sonar: SonarTable | None = None
    """A passive sonar."""
    pod: PodTable | None = None
    """POD by position, or by bearing and range."""

    @model_validator(mode="after")
    def one_kind(self) -> "NamedSensorTable":
        """Reject no kind of sensor or two, and a heading of a towed array."""
        wrong = []
        try:
            fields.one_of(self, ("sonar", "pod"))
        except ValueError as error:
            wrong.append(str(error))
        if self.heading is not None and self.at is None:
            wrong.append(
                "heading belongs to a sensor with a fixed position; give at, or leave heading out: a towed array lies along its course"
            )
        fields.refuse(self, wrong)
        return self

    def sensor(self, name: str, run: Run) -> Sensor:
        """Return the record of the sensor; raise ValueError or UserError for its mistakes."""
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
                "heading is missing: the gains of a fixed array are relative to its heading"
            )
        place = self.at
        if (
            place is None
            and isinstance(sees, PodGrid)
            and sees.lon is not None
            and sees.lat is not None
        ):
            # Its POD depends on the target's position alone: draw the sensor in the middle of the
            # table.
            place = (
                float(sphere.wrap_degrees(np.degrees(0.5 * (sees.lon[0] + sees.lon[-1])))),
                float(np.degrees(0.5 * (sees.lat[0] + sees.lat[-1]))),
            )
        return Sensor(name, sees, place, math.radians(self.heading or 0.0), self.group or name)


def build_sensors(tables: Sequence[NamedSensorTable], run: Run) -> dict[str, Sensor]:
    """Return the sensors by name; raise UserError with all their mistakes."""
    every = build_each(
        [table.sensor for table in tables], [table.name for table in tables], "sensor", run
    )
    return {sensor.name: sensor for sensor in _with_steadiest(every)}


def _with_steadiest(every: Sequence[Sensor]) -> list[Sensor]:
    """Set each sensor's `steadiest`: the smallest fluctuation in its group.

    Raises UserError if sensors of a group have different `unknown`.
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
    """Return the [[sensor]] with a name; raise ValueError if there is none.

    Args:
        name: its name.
        run: the run, with its sensors.
    """
    if name not in run.sensors:
        near = difflib.get_close_matches(name, list(run.sensors), n=1, cutoff=0.5)
        hint = f'did you mean "{near[0]}"? ' if near else ""
        there = ", ".join(run.sensors) or "none; write it as [[sensor]]"
        raise ValueError(f'no sensor "{name}"; {hint}there are: {there}')
    return run.sensors[name]


def beam_indices(given: Sequence[int] | None, sensor: Sensor) -> tuple[int, ...]:
    """Return the indices of beams, counted from 0.

    Args:
        given: numbers of the beams, counted from 1; None: all, which gives ().
        sensor: the sensor, which must be a sonar.

    Raises:
        ValueError: the sensor does not have these beams.
    """
    if given is None:
        return ()
    if not isinstance(sensor.sees, Sonar):
        raise ValueError(f'beams: sensor "{sensor.name}" is not a sonar; leave beams out')
    many = len(sensor.sees.gain.beams)
    if not given or min(given) < 1 or max(given) > many or len(set(given)) < len(given):
        raise ValueError(
            f'beams {list(given)} must be numbers from 1 to {many}, the beams of sensor "{sensor.name}", each once'
        )
    return tuple(sorted(number - 1 for number in given))
