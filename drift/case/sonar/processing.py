"""The [plan.processing] table: arrays, beams and time slots for a limited number of processors."""

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.context import Run, unique_names
from drift.case.search import track as track_table
from drift.case.search.pattern import Waypoints
from drift.case.sonar import sonar as sonar_table
from drift.case.values import fields, units
from drift.case.values.mistakes import Mistakes
from drift.evidence.filter.records import PlanSpec
from drift.evidence.sensors.records import Listener, Processing, Sensor, Sonar, Tow
from geo import notation, polyline
from geo.errors import UserError

LEAST_SLOT = 60.0  # [s]
MOST_SLOTS = 1000
MOST_PROCESSORS = 200
FINE = 200.0  # [m] tolerance with which a track is simplified
HERE = "plan.processing"


class TowedTable(fields.Table):
    """A towed array with a known track."""

    sensor: fields.Label
    """The sonar: a [[sensor]] without a position."""
    name: fields.Label | None = None
    """Name of the array in the plan; by default the sensor's name."""
    waypoints: Waypoints | None = None
    """Track of the array: rows of time and position."""
    track: Annotated[str, Field(min_length=1)] | None = None
    """In place of `waypoints`: a GPX file."""
    speed: fields.ShipSpeed | None = None
    """Speed along waypoints or a track without times, from `start`."""
    start: fields.Time | None = None
    """Time of the first position, for waypoints or a track without times."""

    @model_validator(mode="after")
    def one_way(self) -> "TowedTable":
        """Reject no track or two, and waypoints without times, speed or start."""
        fields.one_of(self, ("waypoints", "track"))
        untimed = self.waypoints is not None and self.waypoints[0][0] is None
        if untimed and (self.speed is None or self.start is None):
            raise ValueError("waypoints without times need speed and start")
        if (
            not untimed
            and self.waypoints is not None
            and (self.speed is not None or self.start is not None)
        ):
            raise ValueError("speed and start belong to waypoints without times; leave them out")
        return self

    def listener(self, run: Run) -> Listener:
        """Return the record of the array; raise ValueError if it does not fit the run."""
        sensor = sonar_table.sensor_named(self.sensor, run)
        if sensor.place is not None:
            raise ValueError(
                f'sensor "{sensor.name}" has a fixed position (at in its table); give only its name'
            )
        since = (
            None
            if self.start is None
            else float(notation.epoch(units.resolve(self.start, run.start)))
        )
        if self.track is not None:
            legs = polyline.thin_legs(
                track_table.read_track(self.track, "track", self.speed, since, None, run), FINE
            )
        elif since is None:
            legs = track_table.read_track(self.waypoints, "waypoints", None, None, None, run)
        else:
            assert self.waypoints is not None
            assert self.speed is not None
            lon, lat = np.array([place for _, place in self.waypoints]).T
            legs = polyline.legs_at_speed(lon, lat, since, self.speed)
        return Listener(self.name or sensor.name, sensor, legs)


class ProcessorTable(fields.Table):
    """A processor, which can process one beam at a time."""

    name: fields.Label
    """Name of the processor in the plan."""
    sensors: list[fields.Label] | None = None
    """Arrays that it can serve, by their names in `plan.processing.sensors`; by default all."""
    manned: list[list[fields.Time]] = Field(default_factory=list)
    """When it works: rows [from, to]; by default always.

    It works only in slots that are manned from begin to end.
    """

    def serves(self, listeners: Sequence[Listener], asked: Sequence[str]) -> list[bool]:
        """Return for each array whether the processor can serve it.

        Args:
            listeners: the arrays.
            asked: for each array its name in `plan.processing.sensors`.

        Raises:
            ValueError: an array is unknown, or there is none.
        """
        every = dict.fromkeys([*asked, *(listener.name for listener in listeners)])
        for name in self.sensors or ():
            if name not in every:
                raise ValueError(
                    f'sensors: no sensor "{name}" in {HERE}.sensors; there are: {", ".join(every)}'
                )
        found = [
            self.sensors is None or listener.name in self.sensors or name in self.sensors
            for listener, name in zip(listeners, asked, strict=True)
        ]
        if not any(found):
            raise ValueError(
                "sensors is empty: name those that it can serve, or leave it out for all"
            )
        return found

    def works(self, edges: Any, run: Run) -> list[bool]:
        """Return for each slot whether the processor works.

        Args:
            edges: begin and end times of the slots.
            run: the run.

        Raises:
            ValueError: hours are invalid, or contain no slot.
        """
        if not self.manned:
            return [True] * (len(edges) - 1)
        spans = []
        for row in self.manned:
            if len(row) != 2:
                raise ValueError('manned: write rows of from and to, like [["+0 h", "+8 h"]]')
            begin, end = (units.resolve(time, run.start) for time in row)
            if end <= begin:
                raise ValueError(
                    f"manned: {notation.format_dtg(end)} is not after {notation.format_dtg(begin)}"
                )
            spans.append((begin, end))
        joined = _merge_spans(spans)
        found = [
            any(a <= begin and end <= b for a, b in joined)
            for begin, end in itertools.pairwise(edges)
        ]
        if not any(found):
            raise ValueError(
                "manned: no slot of the plan lies within these hours; give longer ones, or leave it out"
            )
        return found


def _processors(value: object) -> Any:
    if isinstance(value, list):
        if not value:
            raise ValueError("is empty: give how many, or a table for each")
        return [ProcessorTable.model_validate(row) for row in value]
    many = fields.count(value)
    if not 1 <= many <= MOST_PROCESSORS:
        raise ValueError(f"{many} processors; allowed are 1 to {MOST_PROCESSORS}")
    return many


def _sensors(value: object) -> Any:
    if not isinstance(value, list) or not value:
        raise ValueError('must be a list of names, like ["west", "east"], with one at least')
    return [
        TowedTable.model_validate(row) if isinstance(row, dict) else _name(row) for row in value
    ]


def _name(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError(
            f'{value!r} is neither the name of a sensor nor a table like {{ sensor = "tail", waypoints = [..] }}'
        )
    return value


class ProcessingTable(fields.Table):
    """The [plan.processing] table as written."""

    slot: fields.Duration
    """Length of a time slot; a processor works on one beam per slot."""
    processors: Annotated[int | list[ProcessorTable], BeforeValidator(_processors)]
    """Number of processors, each for any array; or a table for each, `{ name = "P1", sensors =
    ["west"], manned = [["+0 h", "+8 h"]] }`.
    """
    sensors: Annotated[list[str | TowedTable], BeforeValidator(_sensors)]
    """Arrays whose beams may be processed: names of `[[sensor]]`s with a position, of towed
    `[[sensor]]`s or of a `[[tow]]`; or `{ sensor = "tail", waypoints = [["+0 h", "36N 170W"], ["+9
    h", "36N 169W"]] }`."""
    cost: fields.Share = 0.0
    """Least detection probability that a beam must add to be worth a slot."""
    today: dict[str, list[fields.Count]] | None = None
    """Beams, numbered from 1, that are processed all the time at present, `{ west = [3, 4] }`;
    drift
    compares the plan with these.
    """

    def processing(self, run: Run, plan: PlanSpec, tows: Sequence[Tow]) -> Processing:
        """Return the record of the processing; raise UserError with all mistakes."""
        wrong = Mistakes()
        edges = np.array([plan.begin, plan.until])
        with wrong.gathered():
            edges = self._edges(plan)
        found: list[tuple[str, Listener]] = []
        for number, asked in enumerate(self.sensors, 1):
            with wrong.gathered(f"{HERE}.sensors"):
                found += _arrays_of_entry(asked, number, run, tows)
        wrong.refuse()
        listeners = tuple(listener for _, listener in found)
        names = [listener.name for listener in listeners]
        for name in dict.fromkeys(names):
            if names.count(name) > 1:
                wrong.lines.append(
                    f'{HERE}.sensors: two arrays have the name "{name}"; name each once, and give a towed one its own name'
                )
        tables: Sequence[ProcessorTable] = self._each()
        serves, manned = [], []
        with wrong.gathered():
            unique_names([table.name for table in tables], "processor")
        for table in tables:
            with wrong.gathered(f'{HERE}.processors "{table.name}"'):
                serves.append(table.serves(listeners, [asked for asked, _ in found]))
                manned.append(table.works(edges, run))
        today = None
        with wrong.gathered(f"{HERE}.today"):
            today = self._today(listeners)
        wrong.refuse()
        processors = tuple(table.name for table in tables)
        made = Processing(
            edges, listeners, processors, np.array(serves), np.array(manned).T, self.cost, today
        )
        most = int(made.manned.sum(axis=1).max())
        if most > sum(made.beams):
            raise UserError(
                f"{HERE}.processors: {most} work at a time, and there are {sum(made.beams)} beams; give at most as many processors "
                "as beams"
            )
        return made

    def _edges(self, plan: PlanSpec) -> Any:
        """Return the begin of each slot and the end of the last, which may be shorter."""
        span = float((plan.until - plan.begin) / np.timedelta64(1, "s"))
        if self.slot < LEAST_SLOT:
            raise ValueError(f"{HERE}.slot: {self.slot:g} s; at least {LEAST_SLOT:g} s")
        if self.slot > span:
            raise ValueError(
                f"{HERE}.slot: {_hours(self.slot)} is longer than the plan, {_hours(span)} from {notation.format_dtg(plan.begin)} to "
                f"{notation.format_dtg(plan.until)}; give a shorter slot, or begin and until in [plan]"
            )
        many = math.ceil(span / self.slot - 1e-6)
        if many > MOST_SLOTS:
            raise ValueError(
                f"{HERE}.slot: the plan has {many:,} slots of {_hours(self.slot)}; at most {MOST_SLOTS:,}"
            )
        seconds = np.minimum(np.round(np.arange(many + 1) * self.slot), span)
        return plan.begin + seconds.astype("timedelta64[s]")

    def _each(self) -> Sequence[ProcessorTable]:
        """Return one table for each processor."""
        if isinstance(self.processors, int):
            return [ProcessorTable(name=f"P{k + 1}") for k in range(self.processors)]
        tables: Sequence[ProcessorTable] = self.processors
        return tables

    def _today(self, listeners: Sequence[Listener]) -> tuple[tuple[int, ...], ...] | None:
        if self.today is None:
            return None
        names = [listener.name for listener in listeners]
        for name in self.today:
            if name not in names:
                raise ValueError(
                    f'no sensor "{name}" in {HERE}.sensors; there are: {", ".join(names)}'
                )
        return tuple(
            sonar_table.beam_indices(self.today[listener.name], listener.sensor)
            if self.today.get(listener.name)
            else ()
            for listener in listeners
        )


def _arrays_of_entry(
    asked: Any, number: int, run: Run, tows: Sequence[Tow]
) -> list[tuple[str, Listener]]:
    """Return the arrays of an entry of `sensors`, each with the name used in the entry."""
    if isinstance(asked, TowedTable):
        try:
            found = [asked.listener(run)]
        except (ValueError, UserError) as error:
            raise ValueError(f"{number}: {error}") from None
    elif asked not in run.sensors and asked in [tow.name for tow in tows]:
        found = [Listener(tow.name, tow.sensor, tow=tow.name) for tow in tows if tow.name == asked]
    else:
        found = _by_sensor(sonar_table.sensor_named(asked, run), tows)
    for listener in found:
        _check_beams(listener.sensor)
    return [
        (asked.name or asked.sensor if isinstance(asked, TowedTable) else asked, listener)
        for listener in found
    ]


def _by_sensor(sensor: Sensor, tows: Sequence[Tow]) -> list[Listener]:
    """Return the arrays of a sensor: itself if it has a position, else one for each ship."""
    if sensor.place is not None or not isinstance(sensor.sees, Sonar):
        return [Listener(sensor.name, sensor)]
    own = [tow for tow in tows if tow.sensor.name == sensor.name]
    if not own:
        raise ValueError(
            f'where is sensor "{sensor.name}"? It has no position (at): give a [[tow]] that tows it, or '
            f'{{ sensor = "{sensor.name}", waypoints = [["+0 h", "36N 170W"], ..] }}'
        )
    return [
        Listener(sensor.name if len(own) == 1 else tow.name, sensor, tow=tow.name) for tow in own
    ]


def _check_beams(sensor: Sensor) -> None:
    if not isinstance(sensor.sees, Sonar):
        raise ValueError(
            f'sensor "{sensor.name}" is not a sonar: only beams of sonars are processed'
        )
    if len(sensor.sees.gain.beams) < 2:
        raise ValueError(
            f'sensor "{sensor.name}" has no beams to choose among; give its sonar gain = {{ line = {{ elements, spacing, frequency }} }}, '
            "or leave it out"
        )


def _merge_spans(
    spans: Sequence[tuple[np.datetime64, np.datetime64]],
) -> list[tuple[np.datetime64, np.datetime64]]:
    """Return spans of time in order, with adjacent and overlapping spans merged."""
    found: list[tuple[np.datetime64, np.datetime64]] = []
    for begin, end in sorted(spans):
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((begin, end))
    return found


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.3g} h"
