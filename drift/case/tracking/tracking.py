"""Read tracking cases: a target or its detections, a tracker with sensors, and filters, as TOML.

A tracking case has no forcing. Values are written as in cases. All mistakes are reported at once,
one per line.
"""

import math
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from drift.case import file as case_file
from drift.case.forcing import sources
from drift.case.scenario.behaviour import BearingError, BehaviourTable
from drift.case.tracking import detections
from drift.case.tracking import tracker as tracker_table
from drift.case.tracking.detections import DetectionTable
from drift.case.tracking.tracker import TrackerTable, WayTable
from drift.case.values import fields, messages, mistakes, units
from drift.case.values.mistakes import Mistakes
from drift.tracking.tracker import path, pursuit
from drift.tracking.tracker.detections import Detections
from drift.tracking.tracker.pursuit import Pursuit
from drift.tracking.tracker.records import Filling, Plan, Sensor, Tracker
from drift.tracking.tracker.study import Criteria, Scene, Study
from drift.tracking.tracker.study import figures as study_figures
from geo import notation
from geo.array import Array
from geo.errors import UserError
from geo.files import small

LARGEST = 2**20  # [bytes] of a file
MOST_SWEEPS = 2_000_000  # most sweeps of a sensor in a run
MOST = 100_000  # most runs, and most particles of a cloud
SHORTEST = 0.1  # [s] shortest interval between sweeps
MOST_FIGURES = {"experiment": 100_000, "track": 5_000}  # most times at which figures are computed
MOST_SHOWN = 50  # most times at which a cloud is drawn


def _ambiguity(value: object) -> float:
    share = units.quantity(value, "", "range ambiguity", "0.3")
    if not 0 <= share <= 1:
        raise ValueError(f"{value!r} must be a share of the range, 0 (exact) to 1 (unknown)")
    return share


Elapsed = Annotated[float, BeforeValidator(fields.interval)]
Ambiguity = Annotated[float, BeforeValidator(_ambiguity)]


class PlanTable(fields.Table):
    """The times at which a radar is on."""

    every: fields.Duration
    """Interval between the begins of two periods."""
    lasting: fields.Duration
    """Duration of a period."""
    begin: Elapsed = 0.0
    """Begin of the first period, after the start."""

    def plan(self) -> Plan:
        """Return the record of the plan."""
        return Plan(self.begin, self.every, self.lasting)

    @model_validator(mode="after")
    def proper(self) -> "PlanTable":
        """Reject overlapping periods, and intervals that are too short."""
        if self.every < SHORTEST:
            raise ValueError(f"every {self.every:g} s must be {SHORTEST:g} s or more")
        if self.lasting > self.every:
            raise ValueError(
                f"lasting, {notation.format_duration(self.lasting)}, is longer than every, {notation.format_duration(self.every)}"
            )
        return self


def _on(value: object) -> object:
    """Return a plan, or whether the sensor is on; report the mistakes of a table only as a
    plan's."""
    if isinstance(value, dict):
        try:
            return PlanTable.model_validate(value)
        except ValidationError as error:
            raise ValueError("; ".join(messages.lines(error, value))) from None
    if not isinstance(value, bool | PlanTable):
        raise ValueError(
            f'{value!r} must be true, false, or a table like {{ every = "15 min", lasting = "2 min" }}'
        )
    return value


class TargetTable(WayTable):
    """The target of an experiment."""

    radiates: PlanTable | None = None
    """When its radar is on; by default never."""
    sweep: fields.Duration = 1.2
    """Sweep interval of its radar."""
    behaviour: BehaviourTable | None = None
    """Random behaviour from its first act on, different in each run; by default it follows its
    legs.
    """


class SensorTable(fields.Table):
    """A sensor of the tracker, which detects every target within its reach."""

    name: fields.Label
    """Name of the sensor."""
    reach: fields.Reach
    """Largest range of detection."""
    range_ambiguity: Ambiguity
    """Error of ranges, as a share: 0 exact, 1 unknown."""
    bearing_ambiguity: BearingError
    """Largest error of bearings to either side, in degrees."""
    sweep: fields.Duration = 1.2
    """Interval between its sweeps."""
    on: Annotated[PlanTable | bool, BeforeValidator(_on)] = True
    """Times at which it is on."""
    hears: bool = False
    """`true`: it detects the target's radar while that is on; its silence is no evidence."""
    grace: Elapsed = 300.0
    """For cases with detections: silence within this time of a detection by any sensor is no
    evidence, if the detected position is within its reach, because not every plot is logged.
    """

    @model_validator(mode="after")
    def proper(self) -> "SensorTable":
        """Reject sweeps that are too short, and a plan of a sensor that hears."""
        if self.sweep < SHORTEST:
            raise ValueError(f"sweep {self.sweep:g} s must be {SHORTEST:g} s or more")
        if self.hears and "on" in self.model_fields_set:
            raise ValueError(
                "on: a sensor that hears does so while the target radiates; leave on out"
            )
        return self

    def sensor(self, emissions: float) -> Sensor:
        """Return the record of the sensor; `emissions` is the target's sweep interval [s]."""
        plan = Plan() if self.on is True else Plan(math.inf) if self.on is False else self.on.plan()
        interval = emissions if self.hears else self.sweep
        return Sensor(
            self.name,
            self.reach,
            self.range_ambiguity,
            math.radians(self.bearing_ambiguity),
            interval,
            plan,
            self.hears,
            self.grace,
        )


class MethodTable(BehaviourTable):
    """A tracking filter: behaviour of its particles, and repopulation of its cloud."""

    name: fields.Label
    """Name of the filter."""
    fill: Literal["position", "course", "combined"] = "combined"
    """How particles are repopulated from a detection: weighted by the speed that they need from the
    last estimate, placed on the course from it, or both.
    """
    partial: fields.Share = 0.75
    """If fewer than this share of the particles survive, the survivors are duplicated."""
    bulk: fields.Share = 0.1
    """If fewer than this share survive a detection, particles are repopulated; if fewer survive
    silence, the track is lost.
    """

    def tracker(self) -> Tracker:
        """Return the record of the filter."""
        return Tracker(self.name, self.behaviour(), Filling(self.fill, self.partial, self.bulk))

    @model_validator(mode="after")
    def thresholds(self) -> "MethodTable":
        """Reject thresholds in the wrong order."""
        if self.bulk > self.partial:
            raise ValueError(f"bulk {self.bulk:g} must not be above partial {self.partial:g}")
        return self


class CriteriaTable(fields.Table):
    """Largest errors with which an estimate meets the criteria."""

    position: fields.Reach
    """Largest distance of the estimated position."""
    course: BearingError
    """Largest error of the course, in degrees."""
    speed: fields.ShipSpeed
    """Largest error of the speed."""


class ExperimentTable(fields.Table):
    """An experiment of many runs."""

    runs: fields.Count = 100
    """Number of runs."""
    window: fields.DurationRange | None = None
    """Times after the start between which figures are averaged; by default the whole case."""
    areas: fields.Percents = ()
    """Containment areas, in per cent, whose hit rate is reported, like [50, 90]; by default
    none."""
    criteria: CriteriaTable | None = None
    """Criteria of the figure "time to criteria"."""
    published: dict[str, dict[str, float]] = Field(default_factory=dict)
    """Published figures for comparison, by method and figure."""


class PursuitTable(fields.Table):
    """A planned path through the cloud, for the tracker or another vessel."""

    aim: Literal["meet", "avoid"] = "meet"
    """Whether the vessel meets the target or avoids it."""
    speed: fields.ShipSpeed
    """Speed of the vessel."""
    reach: fields.Reach
    """Range within which it sees the target, or is seen."""
    begin: fields.Moment | None = None
    """Begin of the path: time after the start, or date and time. By default the last detection, or
    the end of the tracker's log or track if that is later. The plan uses all detections and silence
    until then; afterwards the vessel's own sweeps."""
    lasting: fields.Duration | None = None
    """Duration of the path; by default until the end of the case."""
    step: fields.Duration = 600.0
    """Interval between its sweeps."""
    at: fields.Position | None = None
    """Initial position; by default that of the tracker."""
    to: fields.Position | None = None
    """Destination of a vessel that avoids the target."""
    worth: fields.Duration = 3600.0
    """For a vessel that avoids: additional time that it accepts to reduce the expected number of
    meetings by one."""
    replan: fields.Share = 0.8
    """The path is planned again when the probability of the silence since the last plan falls below
    this (Klaas' trigger).
    """

    def pursuit(
        self,
        seen: Array,
        tracker: path.Path,
        known: float,
        start: np.datetime64,
        end: float,
        format_time: Callable[[float], str],
    ) -> Pursuit:
        """Return the record of the path.

        Args:
            seen: times of detections [s after the start of the case], shape (n,).
            tracker: track of the tracker.
            known: end of the tracker's log [s after the start of the case].
            start: start of the case.
            end: end of the case [s after its start].
            format_time: formats a time [s after the start of the case] for messages.

        Raises:
            ValueError: the path does not fit the case.
        """
        begin = (
            max(float(seen[-1]), min(known, end))
            if self.begin is None
            else fields.seconds(self.begin, start)
        )
        lasting = end - begin if self.lasting is None else self.lasting
        if begin < seen[-1]:
            raise ValueError(
                f"begin {format_time(begin)} is before the last detection, {format_time(seen[-1])}"
            )
        if begin + lasting > end + 1e-6:
            raise ValueError(
                f"it would last until {format_time(begin + lasting)}, the case until {format_time(end)}"
            )
        if begin + self.step > end + 1e-6:
            raise ValueError(
                f"begins {format_time(begin)}, and the case ends {format_time(end)}: no step of {notation.format_duration(self.step)} fits between"
                + ("; give begin" if self.begin is None else "")
            )
        if self.at is None and not tracker.time[0] <= begin <= tracker.time[-1]:
            raise ValueError(
                f"the tracker has no position at {format_time(begin)}; give at, or another begin"
            )
        place = (
            np.radians(self.at)
            if self.at is not None
            else np.radians(path.degrees(tracker.at([begin])[0][0]))
        )
        to = (
            None
            if self.to is None
            else (float(np.radians(self.to[0])), float(np.radians(self.to[1])))
        )
        steps = int(lasting / self.step + 1e-9)
        found = Pursuit(
            self.aim,
            (float(place[0]), float(place[1])),
            self.speed,
            self.reach,
            begin,
            self.step,
            steps,
            to,
            self.worth,
            self.replan,
        )
        pursuit.check(found)
        return found


class TrackingTable(fields.Table):
    """A tracking case."""

    title: fields.Label
    """Title of the results."""
    start: fields.Time
    """Date and time of the start."""
    duration: fields.Duration
    """Duration of the case."""
    every: fields.Duration = 300.0
    """Interval between figures."""
    particles: fields.Count = 2500
    """Number of particles of each cloud."""
    seed: fields.Count = 1
    """Seed of all random numbers."""
    target: TargetTable | None = None
    """The target of an experiment."""
    detections: str | None = None
    """In place of `target`, a CSV file of detections:

    `time`, `sensor`, `bearing` (true, degrees), `range` (nmi), and positions of the tracker, `lat`
    and `lon`.
    """
    detection: list[DetectionTable] = Field(default_factory=list)
    """In place of a CSV file: detections in order of time; ranges need a unit."""
    show: list[fields.Moment] = Field(default_factory=list)
    """For cases with detections: times at which the cloud is drawn and its areas are reported,
    after
    the start or as date and time. By default the last detection, the end, and times between.
    """
    tracker: TrackerTable = TrackerTable()
    """The vessel that tracks the target."""
    land: Literal["turn", "ignore"] = "turn"
    """Particles, and a target that acts, turn to a random course at the shore (`turn`), or cross
    land (`ignore`).
    """
    sensor: Annotated[list[SensorTable], Field(min_length=1)]
    """Sensors of the tracker."""
    method: Annotated[list[MethodTable], Field(min_length=1)]
    """Tracking filters; the first one is that of the case."""
    pursuit: PursuitTable | None = None
    """For cases with detections: a path to meet the target, or to avoid it."""
    experiment: ExperimentTable = ExperimentTable()
    """An experiment of many runs."""


def shipped() -> list[str]:
    """Return the names of the shipped tracking cases."""
    return [name for name, _ in case_file.shipped("tracking")]


def is_tracking_case(name: str | os.PathLike[str]) -> bool:
    """Return whether a name is that of a shipped tracking case, or of a file with a tracking
    case."""
    if str(name) in shipped():
        return True
    try:
        data = tomllib.loads(small.read_small_file(Path(name), LARGEST).decode("utf-8-sig"))
    except (OSError, UserError, ValueError, RecursionError):
        return False
    return case_file.is_of_tracking(data)


def load(name: str | os.PathLike[str], overrides: Mapping[str, str] | None = None) -> Study:
    """Read a tracking case.

    Args:
        name: a path, or the name of a shipped tracking case.
        overrides: changed keys and their TOML values as text, as in `drift.load`.

    Raises:
        UserError: all mistakes of the case, one line for each.
    """
    own = str(name) in shipped()
    place = Path(str(resources.files("cases") / "tracking" / f"{name}.toml")) if own else Path(name)
    try:
        text = small.read_small_file(place, LARGEST).decode("utf-8-sig")
        data = tomllib.loads(text)
    except OSError as error:
        other = str(name) in (case for case, _ in case_file.shipped())
        what = "is a case of drift run" if other else f"cannot be read: {error.strerror}"
        raise UserError(
            f'case "{str(name)[:300]}": {what}; shipped tracking cases: {", ".join(shipped())}'
        ) from None
    except UnicodeDecodeError:
        raise UserError(f'case "{name}": is not text in UTF-8') from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"{place.name}: not valid TOML: {error}") from None
    wrong = Mistakes()
    for key, value in (overrides or {}).items():
        with wrong.gathered():
            case_file.override(data, key, value)
        text += f"\n# --set {key}={value}"
    wrong.refuse()
    if not any(key in data for key in ("target", "detections", "detection")) and (
        "scenario" in data or "spill" in data
    ):
        raise UserError(
            f"{place.name}: is a case of drift run; a tracking case has [target] and [tracker]"
        )
    try:
        return _study(
            TrackingTable.model_validate(data, context={"whole": TrackingTable}),
            place.stem,
            text,
            place.parent,
        )
    except ValidationError as error:
        raise _error_of_case(place, messages.lines(error, data)) from None
    except (UserError, ValueError) as error:
        raise _error_of_case(
            place, error.lines if isinstance(error, UserError) else (str(error),)
        ) from None


def _error_of_case(place: Path, lines: Sequence[str]) -> UserError:
    return UserError(
        *(
            f"{place.name}: {' '.join(line.split())}"
            for line in mistakes.shorten_lines(tuple(lines))
        )
    )


def _study(table: TrackingTable, name: str, text: str, folder: Path) -> Study:
    """Build the study of a tracking case from its tables.

    Args:
        table: the validated tables.
        name: name of the case.
        text: text of its file.
        folder: folder of its file.

    Raises:
        UserError: tables do not fit together, one line for each mistake.
    """
    wrong = Mistakes()
    start = table.start
    if isinstance(start, np.timedelta64):
        wrong.lines.append("start: must be a date and time")
        start = np.datetime64(0, "s")

    def format_time(seconds: float) -> str:
        return notation.format_dtg(
            np.datetime64(notation.epoch(start) + round(float(seconds)), "s")
        )

    for what, value in (("particles", table.particles), ("experiment.runs", table.experiment.runs)):
        if not 1 <= value <= MOST:
            wrong.lines.append(f"{what}: {value:,} must be 1 to {MOST:,}")
    if not 0 <= table.seed < 2**64:
        wrong.lines.append(f"seed: {table.seed} must be 0 to 2**64 - 1")
    most = MOST_FIGURES["experiment" if table.target is not None else "track"]
    if table.duration / table.every > most:
        wrong.lines.append(
            f"every: gives more than {most:,} figures; the case lasts {notation.format_duration(table.duration)}"
        )
    if len(table.show) > MOST_SHOWN:
        wrong.lines.append(f"show: {len(table.show)} times; at most {MOST_SHOWN}")
    if table.every > table.duration:
        wrong.lines.append(
            f"every: {notation.format_duration(table.every)} is longer than the case, {notation.format_duration(table.duration)}"
        )
    shown = sorted(fields.seconds(moment, start) for moment in table.show)
    wrong.lines += [
        f"show: {format_time(after)} is not within the case, {format_time(0)} to {format_time(table.duration)}"
        for after in shown
        if not 0 <= after <= table.duration
    ]
    window = table.experiment.window
    if (
        window is not None
        and not math.floor(min(window[1], table.duration) / table.every) * table.every >= window[0]
    ):
        wrong.lines.append(
            f"experiment.window: no figure is taken from {notation.format_duration(window[0])} to {notation.format_duration(window[1])}; the case lasts {notation.format_duration(table.duration)}, every {notation.format_duration(table.every)}"
        )
    for kind in ("sensor", "method"):
        names = [one.name for one in getattr(table, kind)]
        twice = {n for n in names if names.count(n) > 1}
        wrong.lines += [f'{kind} "{name}": two have this name' for name in twice]
    target = table.target
    for sensor in table.sensor:
        if table.duration / sensor.sweep > MOST_SWEEPS:
            wrong.lines.append(
                f'sensor "{sensor.name}".sweep: gives more than {MOST_SWEEPS:,} sweeps'
            )
        if sensor.hears and target is not None and target.radiates is None:
            wrong.lines.append(
                f'sensor "{sensor.name}": hears the target\'s radar, which is never on; give [target.radiates]'
            )
        if target is not None and "grace" in sensor.model_fields_set:
            wrong.lines.append(
                f'sensor "{sensor.name}".grace: only applies to cases with detections; with a [target] every sweep is simulated'
            )
    if target is not None and table.show:
        wrong.lines.append("show: needs detections; this case has a [target], for experiments")
    if (
        target is None
        and "experiment" in table.model_fields_set
        and (table.detections or table.detection)
    ):
        wrong.lines.append(
            "experiment: needs a [target]; this case has detections, for drift track"
        )
    strange = sorted(set(table.experiment.published) - {method.name for method in table.method})
    wrong.lines += [f'experiment.published: no method "{name}"' for name in strange]
    figures = study_figures(table.experiment.areas, table.experiment.criteria is not None)
    for method_name, published_figures in table.experiment.published.items():
        wrong.lines += [
            f'experiment.published "{method_name}": no figure "{figure}"; there are {", ".join(figures)}, and median before each'
            for figure in published_figures
            if method_name not in strange and figure.removeprefix("median ") not in figures
        ]
    given = [
        name
        for name, one in (
            ("[target]", target),
            ("detections", table.detections),
            ("[[detection]]", table.detection),
        )
        if one
    ]
    if not given:
        wrong.lines.append(
            '[target] is missing: give it, or detections = "file.csv", or [[detection]]'
        )
    elif len(given) > 1:
        wrong.lines.append(f"{' and '.join(given)} are both given; give one")
    sensors = tuple(
        sensor.sensor(1.2 if target is None else target.sweep) for sensor in table.sensor
    )
    own: path.Path | None = None
    followed: Scene | Detections | None = None
    if target is not None:
        with wrong.gathered("target"):
            followed = Scene(
                target.way(table.duration),
                None if target.radiates is None else target.radiates.plan(),
                target.sweep,
                None if target.behaviour is None else target.behaviour.behaviour(),
            )
    elif table.detection:
        with wrong.gathered():
            followed, own = detections.detections_of_tables(
                table.detection, start, table.duration, sensors
            )
    elif table.detections is not None:
        with wrong.gathered():
            followed, own = detections.read_detections(
                table.detections, folder, start, table.duration, sensors
            )
    wrong.refuse()
    tracker: path.Path | None = None
    with wrong.gathered("tracker"):
        tracker = tracker_table.tracker_path(table.tracker, own, start, table.duration, folder)
    wrong.refuse()
    assert tracker is not None
    assert followed is not None
    if isinstance(followed, Detections):
        known = (followed.time >= tracker.time[0] - 1e-6) & (
            followed.time <= tracker.time[-1] + 1e-6
        )
        for time in followed.time[~known]:
            wrong.lines.append(
                f"detections: the tracker has no position at the detection of {format_time(time)}; give lat and lon there, or a track until then"
            )
        wrong.refuse()
    chase: Pursuit | None = None
    if table.pursuit is not None:
        with wrong.gathered("pursuit"):
            if not isinstance(followed, Detections):
                raise ValueError("needs detections; this case has a [target], for experiments")
            chase = table.pursuit.pursuit(
                followed.time,
                tracker,
                0.0 if table.tracker.at is not None else float(tracker.time[-1]),
                start,
                table.duration,
                format_time,
            )
    wrong.refuse()
    criteria = table.experiment.criteria
    return Study(
        name,
        text,
        table.title,
        start,
        table.duration,
        table.every,
        table.particles,
        table.seed,
        table.experiment.runs,
        tracker,
        followed,
        sensors,
        tuple(method.tracker() for method in table.method),
        table.experiment.window or (0.0, math.inf),
        None
        if criteria is None
        else Criteria(criteria.position, math.radians(criteria.course), criteria.speed),
        table.experiment.areas,
        tuple(shown),
        chase,
        table.experiment.published,
        table.land == "turn",
        logged=table.tracker.at is None,
        files=tuple(
            sources.one_file(file, folder, what)
            for what, file in (("detections", table.detections), ("track", table.tracker.track))
            if file is not None
        ),
    )
