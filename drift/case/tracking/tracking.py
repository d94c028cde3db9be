"""The file of a tracking case: a target that is rarely seen, who follows it and how, as TOML.

It is a small file of its own, without forcing. Its words are those of cases. Every mistake is found
here, all of them at once, a line each.
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

LARGEST = 2**20  # [bytes] of such a file
MOST_SWEEPS = 2_000_000  # of one sensor in a run
MOST = 100_000  # runs, and particles of a cloud
SHORTEST = 0.1  # [s] between sweeps
MOST_FIGURES = {"experiment": 100_000, "track": 5_000}  # times at which figures are taken
MOST_SHOWN = 50  # times at which a cloud is drawn


def _ambiguity(value: object) -> float:
    share = units.quantity(value, "", "range ambiguity", "0.3")
    if not 0 <= share <= 1:
        raise ValueError(f"{value!r} must be a share of the range, 0 (exact) to 1 (unknown)")
    return share


Elapsed = Annotated[float, BeforeValidator(fields.interval)]
Ambiguity = Annotated[float, BeforeValidator(_ambiguity)]


class PlanTable(fields.Table):
    """When a radar is on."""

    every: fields.Duration
    """From one begin to the next."""
    lasting: fields.Duration
    """How long each time."""
    begin: Elapsed = 0.0
    """When first, after the start."""

    def plan(self) -> Plan:
        """Return the record."""
        return Plan(self.begin, self.every, self.lasting)

    @model_validator(mode="after")
    def proper(self) -> "PlanTable":
        """Refuse times that run into one another, and more of them than any radar has."""
        if self.every < SHORTEST:
            raise ValueError(f"every {self.every:g} s must be {SHORTEST:g} s or more")
        if self.lasting > self.every:
            raise ValueError(
                f"lasting, {notation.format_duration(self.lasting)}, is longer than every, {notation.format_duration(self.every)}"
            )
        return self


def _on(value: object) -> object:
    """Return a plan or whether it is on at all; of a table that is wrong what is wrong with it, and
    nothing of the other kind.
    """
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
    """Who is followed."""

    radiates: PlanTable | None = None
    """When its radar is on; never by default."""
    sweep: fields.Duration = 1.2
    """Of its radar."""
    behaviour: BehaviourTable | None = None
    """What it does on its own from its first act on, another in each run; by default it keeps to
    its legs.
    """


class SensorTable(fields.Table):
    """A sensor of the tracker, which detects whatever is within its reach."""

    name: fields.Label
    """What it is called."""
    reach: fields.Reach
    """How far."""
    range_ambiguity: Ambiguity
    """0: ranges are exact; 1: they are unknown."""
    bearing_ambiguity: BearingError
    """On either side, in degrees."""
    sweep: fields.Duration = 1.2
    """Time between its looks all round."""
    on: Annotated[PlanTable | bool, BeforeValidator(_on)] = True
    """When it is on."""
    hears: bool = False
    """It detects a target's radar while that is on; its silence is no evidence."""
    grace: Elapsed = 300.0
    """Of `detections`: its silence counts no nearer to a detection, by any sensor, of what is
    within its reach, for not every plot is written down.
    """

    @model_validator(mode="after")
    def proper(self) -> "SensorTable":
        """Refuse sweeps that no sensor makes."""
        if self.sweep < SHORTEST:
            raise ValueError(f"sweep {self.sweep:g} s must be {SHORTEST:g} s or more")
        if self.hears and "on" in self.model_fields_set:
            raise ValueError(
                "on: a sensor that hears does so while the target radiates; leave on out"
            )
        return self

    def sensor(self, emissions: float) -> Sensor:
        """Return the record; emissions: [s] between those of the target."""
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
    """A way of following: what particles do, and how their cloud is filled again."""

    name: fields.Label
    """What it is called."""
    fill: Literal["position", "course", "combined"] = "combined"
    """How particles are repopulated from a detection: weighted by the speed they need from the last
    estimate, on the course from it, or both.
    """
    partial: fields.Share = 0.75
    """Share of the particles below which what is left is duplicated."""
    bulk: fields.Share = 0.1
    """Share below which they are repopulated from a detection; after silence the track is lost."""

    def tracker(self) -> Tracker:
        """Return the record."""
        return Tracker(self.name, self.behaviour(), Filling(self.fill, self.partial, self.bulk))

    @model_validator(mode="after")
    def thresholds(self) -> "MethodTable":
        """Refuse thresholds the wrong way round."""
        if self.bulk > self.partial:
            raise ValueError(f"bulk {self.bulk:g} must not be above partial {self.partial:g}")
        return self


class CriteriaTable(fields.Table):
    """How near an estimate must be."""

    position: fields.Reach
    """Distance."""
    course: BearingError
    """Degrees."""
    speed: fields.ShipSpeed
    """Difference of speeds."""


class ExperimentTable(fields.Table):
    """Many runs."""

    runs: fields.Count = 100
    """How many."""
    window: fields.DurationRange | None = None
    """Times after the start between which figures are averaged; all by default."""
    areas: fields.Percents = ()
    """Per cent whose areas are asked how often they hold the target, like [50, 90]; none by
    default.
    """
    criteria: CriteriaTable | None = None
    """Of the time to criteria."""
    published: dict[str, dict[str, float]] = Field(default_factory=dict)
    """Figures to set beside, by way of following and figure."""


class PursuitTable(fields.Table):
    """A path through the cloud, for the tracker or another vessel."""

    aim: Literal["meet", "avoid"] = "meet"
    """To meet the target, or to keep out of its way."""
    speed: fields.ShipSpeed
    """Of the vessel."""
    reach: fields.Reach
    """Within which it sees the target, or is seen."""
    begin: fields.Moment | None = None
    """After the start, or a date and time; by default the last detection, or until when a log or a
    track says where the tracker was if that is later. The path is planned on what was seen, and not
    seen, until then; from then on the vessel's own looks count."""
    lasting: fields.Duration | None = None
    """How long; until the end of the case by default."""
    step: fields.Duration = 600.0
    """Between its looks all round."""
    at: fields.Position | None = None
    """Where it begins; where the tracker then is by default."""
    to: fields.Position | None = None
    """Where one goes that avoids."""
    worth: fields.Duration = 3600.0
    """Of one that avoids: how much longer it would go to meet the target once less, as expected."""
    replan: fields.Share = 0.8
    """It is planned again when seeing nothing since the last plan was less likely than this (Klaas'
    trigger).
    """

    def pursuit(
        self,
        seen: Array,
        tracker: path.Path,
        known: float,
        start: np.datetime64,
        end: float,
        told: Callable[[float], str],
    ) -> Pursuit:
        """Return the record.

        seen: times of detections [s after the start of the case]; known: until when the log knows
        the tracker [s]; start, end [s after it]: of the case; told: puts a time in words.

        Raises ValueError for what does not fit.
        """
        begin = (
            max(float(seen[-1]), min(known, end))
            if self.begin is None
            else fields.seconds(self.begin, start)
        )
        lasting = end - begin if self.lasting is None else self.lasting
        if begin < seen[-1]:
            raise ValueError(f"begin {told(begin)} is before the last detection, {told(seen[-1])}")
        if begin + lasting > end + 1e-6:
            raise ValueError(
                f"it would last until {told(begin + lasting)}, the case until {told(end)}"
            )
        if begin + self.step > end + 1e-6:
            raise ValueError(
                f"begins {told(begin)}, and the case ends {told(end)}: there is no step of {notation.format_duration(self.step)} between"
                + ("; give begin" if self.begin is None else "")
            )
        if self.at is None and not tracker.time[0] <= begin <= tracker.time[-1]:
            raise ValueError(
                f"the tracker has no position at {told(begin)}; give at, or another begin"
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
    """The whole file."""

    title: fields.Label
    """What it is called."""
    start: fields.Time
    """Date and time."""
    duration: fields.Duration
    """How long it is followed."""
    every: fields.Duration = 300.0
    """Time between figures."""
    particles: fields.Count = 2500
    """Of each cloud."""
    seed: fields.Count = 1
    """Of all random numbers."""
    target: TargetTable | None = None
    """The target of an experiment."""
    detections: str | None = None
    """In place of it, a CSV file of what was detected:

    `time`, `sensor`, `bearing` (true, degrees), `range` (nmi), and where the tracker was, `lat` and
    `lon`.
    """
    detection: list[DetectionTable] = Field(default_factory=list)
    """The same in this file, in order of time; ranges with their unit."""
    show: list[fields.Moment] = Field(default_factory=list)
    """Of detections: times, after the start or of date and time, at which the cloud is drawn and
    its areas are reported; by default the last detection, the end, and between.
    """
    tracker: TrackerTable = TrackerTable()
    """The vessel that follows."""
    land: Literal["turn", "ignore"] = "turn"
    """What the shore means to particles, and to a target that acts: they turn there to any other
    course, or pass over.
    """
    sensor: Annotated[list[SensorTable], Field(min_length=1)]
    """Its sensors."""
    method: Annotated[list[MethodTable], Field(min_length=1)]
    """Ways of following, the first of which is the case's own."""
    pursuit: PursuitTable | None = None
    """Of detections: a path on which to meet the target, or to avoid it."""
    experiment: ExperimentTable = ExperimentTable()
    """Many runs."""


def shipped() -> list[str]:
    """Return the names of the tracking cases that ship with the project."""
    return [name for name, _ in case_file.shipped("tracking")]


def is_tracking_case(name: str | os.PathLike[str]) -> bool:
    """Return whether a name is that of a shipped tracking case, or a file with what such a case
    has.
    """
    if str(name) in shipped():
        return True
    try:
        data = tomllib.loads(small.read_small_file(Path(name), LARGEST).decode("utf-8-sig"))
    except (OSError, UserError, ValueError, RecursionError):
        return False
    return case_file.is_of_tracking(data)


def load(name: str | os.PathLike[str], overrides: Mapping[str, str] | None = None) -> Study:
    """Return what a tracking case asks, of a TOML file or a shipped case's name.

    overrides: as of drift.load.

    Raises one UserError for whatever is wrong with it, a line for each mistake.
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
            f'case "{str(name)[:300]}": {what}; tracking cases that ship: {", ".join(shipped())}'
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
        return study(
            TrackingTable.model_validate(data, context={"whole": TrackingTable}),
            place.stem,
            text,
            place.parent,
        )
    except ValidationError as error:
        raise _refusal(place, messages.lines(error, data)) from None
    except (UserError, ValueError) as error:
        raise _refusal(
            place, error.lines if isinstance(error, UserError) else (str(error),)
        ) from None


def _refusal(place: Path, lines: Sequence[str]) -> UserError:
    return UserError(
        *(
            f"{place.name}: {' '.join(line.split())}"
            for line in mistakes.shorten_lines(tuple(lines))
        )
    )


def study(table: TrackingTable, name: str, text: str, folder: Path) -> Study:
    """Return what the tables ask for; name, text, folder: of their file.

    Raises UserError with a line for each mistake.
    """
    wrong = Mistakes()
    start = table.start
    if isinstance(start, np.timedelta64):
        wrong.lines.append("start: must be a date and time")
        start = np.datetime64(0, "s")

    def told(seconds: float) -> str:
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
            f"every: asks for more than {most:,} figures; the case lasts {notation.format_duration(table.duration)}"
        )
    if len(table.show) > MOST_SHOWN:
        wrong.lines.append(f"show: {len(table.show)} times; at most {MOST_SHOWN}")
    if table.every > table.duration:
        wrong.lines.append(
            f"every: {notation.format_duration(table.every)} is longer than the case, {notation.format_duration(table.duration)}"
        )
    shown = sorted(fields.seconds(moment, start) for moment in table.show)
    wrong.lines += [
        f"show: {told(after)} is not within the case, {told(0)} to {told(table.duration)}"
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
        wrong.lines += [f'{kind} "{name}": there are two of this name' for name in twice]
    target = table.target
    for sensor in table.sensor:
        if table.duration / sensor.sweep > MOST_SWEEPS:
            wrong.lines.append(
                f'sensor "{sensor.name}".sweep: asks for more than {MOST_SWEEPS:,} sweeps'
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
        wrong.lines.append("show: is of detections; a [target] is followed in experiments")
    if (
        target is None
        and "experiment" in table.model_fields_set
        and (table.detections or table.detection)
    ):
        wrong.lines.append(
            "experiment: is of a [target]; detections are followed by drift track, once"
        )
    strange = sorted(set(table.experiment.published) - {method.name for method in table.method})
    wrong.lines += [f'experiment.published: no method "{name}"' for name in strange]
    figures = study_figures(table.experiment.areas, table.experiment.criteria is not None)
    for way, told_figures in table.experiment.published.items():
        wrong.lines += [
            f'experiment.published "{way}": no figure "{figure}"; there are {", ".join(figures)}, and median before each'
            for figure in told_figures
            if way not in strange and figure.removeprefix("median ") not in figures
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
                f"detections: the tracker has no position at the detection of {told(time)}; give lat and lon there, or a track until then"
            )
        wrong.refuse()
    chase: Pursuit | None = None
    if table.pursuit is not None:
        with wrong.gathered("pursuit"):
            if not isinstance(followed, Detections):
                raise ValueError("is of detections; a [target] is followed in experiments")
            chase = table.pursuit.pursuit(
                followed.time,
                tracker,
                0.0 if table.tracker.at is not None else float(tracker.time[-1]),
                start,
                table.duration,
                told,
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
