"""Detections of a target from a CSV file or from tables, and positions of its tracker in them."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, ValidationError

from drift.case.forcing import sources
from drift.case.tracking import tracker
from drift.case.values import fields, messages, rows, units
from drift.case.values.mistakes import Mistakes
from drift.tracking.tracker import path
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.records import Sensor
from geo import notation
from geo.errors import UserError
from geo.notation import NMI

NEEDED = ("time", "sensor")
ALLOWED = (*NEEDED, "bearing", "range", "lat", "lon", "remarks")


def _range(value: object) -> float:
    metres = units.quantity(value, "m", "range", "12 nmi")
    if not metres > 0:
        raise ValueError(f"range {value} must be above 0")
    return metres


def _with_unit(value: object) -> float:
    """Return a range [m]; a unit is required, as bare numbers are nautical miles in CSV files."""
    if isinstance(value, int | float) or (
        isinstance(value, str) and re.fullmatch(r"[\d.\s]*", value)
    ):
        raise ValueError(f'range {value} has no unit; write it like "9.2 nmi"')
    return _range(value)


def _plotted(value: object) -> float:
    """Return a range [m]; a bare number is in nautical miles, as on a plot."""
    return _range(f"{value!r} nmi" if isinstance(value, float) else value)


def _cell(text: str) -> str | float:
    """Return a cell of the file, converted to a number if possible."""
    try:
        return float(text)
    except ValueError:
        return text


class DetectionTable(fields.Table):
    """A detection by a sensor; without a sensor, only a position of the tracker."""

    time: fields.Time
    """Date and time, or the time after the start."""
    sensor: str = ""
    """Name of the sensor; without it, the table gives only the tracker's position."""
    bearing: fields.Direction | None = None
    """True bearing; by default unknown."""
    range: Annotated[float, BeforeValidator(_with_unit)] | None = None
    """Range with its unit; by default unknown."""
    lat: fields.Latitude | None = None
    """Latitude of the tracker."""
    lon: fields.Longitude | None = None
    """Longitude of the tracker."""


class RowTable(DetectionTable):
    """A line of a CSV file, in which a range without unit is in nautical miles."""

    range: Annotated[float, BeforeValidator(_plotted)] | None = None


class _Log:
    """Detections and positions of the tracker, in order of time."""

    def __init__(self, start: np.datetime64, end: float, sensors: tuple[Sensor, ...]) -> None:
        """Begin a log of a case, from its start to an end [s after it]."""
        self._start, self._end, self._sensors = start, end, sensors
        self._names = [sensor.name for sensor in sensors]
        self._rows: list[tuple[float, DetectionTable]] = []
        self._place: tuple[float, float | None, float | None] | None = None
        self._before = -np.inf

    def add(self, row: DetectionTable) -> None:
        """Add a detection or position; raise ValueError for its mistakes."""
        time = _after(row.time, self._start)
        if not 0 <= time <= self._end:
            raise ValueError(
                f"time {self._format_time(time)} is not within the case, {self._format_time(0)} to {self._format_time(self._end)}: change start or duration"
            )
        before, self._before = self._before, time
        if time < before:
            raise ValueError(
                f"time {self._format_time(time)} is before that of the line above; order the lines by time"
            )
        if row.sensor:
            _check(row, self._names, self._sensors)
        elif row.bearing is not None or row.range is not None:
            raise ValueError(
                f"a bearing or a range without a sensor; there are {', '.join(self._names)}"
            )
        elif row.lat is None:
            raise ValueError("neither a sensor nor lat and lon")
        if (row.lat is None) != (row.lon is None):
            raise ValueError("lat and lon go together")
        if row.lat is not None:
            own = (time, row.lon, row.lat)
            if self._place is not None and self._place[0] == time and self._place != own:
                raise ValueError(
                    f"the tracker has two positions at {self._format_time(time)}; the other is above"
                )
            self._place = own
        self._rows.append((time, row))

    def found(self, label: str) -> tuple[Detections, path.Path | None]:
        """Return the detections, and the track of the tracker (None: no positions).

        Raises UserError without a detection, or without a position at the first detection.
        """
        seen = [(time, row) for time, row in self._rows if row.sensor]
        if not seen:
            raise UserError(f"{label}: no detection; a track begins with one")
        bearing, distance = (
            np.array(
                [np.nan if (value := getattr(row, key)) is None else value for _, row in seen],
                np.float64,
            )
            for key in ("bearing", "range")
        )
        found = Detections(
            np.array([time for time, _ in seen]),
            np.array([self._names.index(row.sensor) for _, row in seen]),
            np.radians(bearing),
            distance,
        )
        placed = np.array(
            [(time, row.lon, row.lat) for time, row in self._rows if row.lat is not None],
            np.float64,
        )
        if not len(placed):
            return found, None
        if placed[0, 0] > found.time[0]:
            raise UserError(
                f"{label}: the tracker has no position at the first detection; give lat and lon there"
            )
        return found, tracker.through(placed[:, 0], placed[:, 1], placed[:, 2], self._start, label)

    def _format_time(self, time: float) -> str:
        return notation.iso(self._start + np.timedelta64(round(time), "s"))


def read_detections(
    file: str, folder: Path, start: np.datetime64, end: float, sensors: tuple[Sensor, ...]
) -> tuple[Detections, path.Path | None]:
    """Read detections from a CSV file.

    Args:
        file: path of the file as in the case.
        folder: folder from which relative paths start.
        start: start of the case.
        end: end of the case [s after its start].
        sensors: the sensors of the case.

    Returns:
        The detections, and the track of the tracker; None: the file gives no positions.

    Raises:
        UserError: one line for each mistake.
    """
    name = sources.one_file(file, folder, "detections")
    label = f"detections: {Path(name).name}"
    try:
        table = rows.Rows(name, NEEDED, ALLOWED, words=("sensor", "remarks"))
        if ("lat" in table.columns) != ("lon" in table.columns):
            raise UserError(
                f"{table.name}: lat and lon go together; allowed are {', '.join(ALLOWED)}"
            )
    except UserError as error:
        true = (
            "; bearings are true: add the variation to magnetic ones"
            if re.search(r"column [^;]*mag", str(error))
            else ""
        )
        raise UserError(f"detections: {error}{true}") from None
    wrong, log = Mistakes(), _Log(start, end, sensors)
    for line, given in table:
        with wrong.gathered(f"{label}, line {line}"):
            if given is None:
                raise ValueError(table.wanted)
            cells = {
                key: _cell(value) if key not in NEEDED else value
                for key, value in given.items()
                if value and key != "remarks"
            }
            try:
                row = RowTable.model_validate(cells)
            except ValidationError as error:
                raise UserError(*messages.lines(error, cells)) from None
            log.add(row)
    wrong.refuse()
    return log.found(label)


def detections_of_tables(
    tables: Sequence[DetectionTable], start: np.datetime64, end: float, sensors: tuple[Sensor, ...]
) -> tuple[Detections, path.Path | None]:
    """Return the same as `read_detections` from [[detection]] tables of the case."""
    wrong, log = Mistakes(), _Log(start, end, sensors)
    for number, row in enumerate(tables, 1):
        with wrong.gathered(f"detection {number}"):
            log.add(row)
    wrong.refuse()
    return log.found("detection")


def _check(row: DetectionTable, names: list[str], sensors: tuple[Sensor, ...]) -> None:
    if row.sensor not in names:
        raise ValueError(f'no [[sensor]] "{row.sensor}"; there are {", ".join(names)}')
    if row.bearing is None and row.range is None:
        raise ValueError(
            "neither a bearing nor a range: a line with a sensor is a detection; to give only the tracker's position leave the sensor out"
        )
    sensor = sensors[names.index(row.sensor)]
    if row.range is not None and not 0 <= row.range * (1 - sensor.range_share) <= sensor.reach:
        raise ValueError(
            f"range {row.range / NMI:.4g} nmi is beyond the reach of {sensor.name}, {_reach(sensor)}"
        )


def _reach(sensor: Sensor) -> str:
    return (
        f"{sensor.reach / NMI:.4g} nmi"
        if sensor.reach >= 0.1 * NMI
        else f"{sensor.reach:g} m: write its unit"
    )


def _after(time: units.Instant, start: np.datetime64) -> float:
    """Return the time after the start [s]."""
    gap = time if isinstance(time, np.timedelta64) else time - start
    return float(gap / np.timedelta64(1, "ms")) / 1000
