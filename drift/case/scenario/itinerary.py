"""Tables of a steering target: the phases of a [[scenario]], its distress, and the effect of land.

The tables build the records of drift.engine.motion.steering.itinerary. A phase is a course, a
behaviour or loitering, or follows way points (drift.case.scenario.waypoints): a track, lanes, a
voyage or a bridge.
"""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from drift.case.scenario.behaviour import BehaviourTable
from drift.case.scenario.objects import SearchObject
from drift.case.scenario.waypoints import BridgeTable, LanesTable, TrackTable, VoyageTable
from drift.case.tracking import tracker
from drift.case.tracking.tracker import TrackerTable
from drift.case.values import fields, units
from drift.case.values.places import AreaTable
from drift.case.values.spreads import Courses, Parts, Speeds, Time, start_distribution
from drift.engine.motion.steering.itinerary import (
    Acts,
    Between,
    Course,
    Distress,
    Followed,
    InRing,
    Loiter,
    Part,
    Phase,
    Rate,
    Spread,
    Ways,
)
from drift.tracking.tracker import path
from geo import notation

KNOT = notation.NMI / 3600  # [m/s]
SHORTEST_LEG = 500.0  # [m] least mean leg of loitering


class WindowedTable(fields.Table):
    """The end of a phase: at a time, after a duration, or at the end of the run."""

    until: fields.Time | None = None
    lasting: Annotated[fields.Duration | None, Field(alias="for")] = None

    def end(self, start: np.datetime64) -> tuple[np.datetime64 | None, float]:
        """Return the latest end of the phase (None: none) and its longest duration [s]."""
        until = None if self.until is None else units.resolve(self.until, start)
        return until, math.inf if self.lasting is None else self.lasting


class CourseTable(WindowedTable):
    """A constant course, or one that changes."""

    course: Courses
    speed: Speeds
    change: fields.Duration | None = None

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Course:
        """Return the record of the phase, for a case from `start` to `end`."""
        return Course(self.course, self.speed, self.change or 0.0, *self.end(start))


ANY_COURSE = Spread(0.0, 2 * math.pi, math.pi)


class ActsTable(BehaviourTable, WindowedTable):
    """A target that at random times changes its course, seeks a tracker or flees from it."""

    course: Courses = ANY_COURSE
    speed: Speeds | None = None
    tracker: TrackerTable | None = None

    @model_validator(mode="after")
    def of_whom(self) -> "ActsTable":
        """Reject seeking or fleeing without a tracker, no acts, and an initial speed above
        fastest."""
        wrong = []
        if self.acts is None:
            wrong.append(
                'acts: is missing, like ["3 min", "15 min"]; for a target that keeps its course use a phase of kind course'
            )
        if self.seek + self.hide > 0 and self.tracker is None:
            wrong.append(
                'tracker: is missing: name the vessel to seek or hide from: give { at, legs }, { track = "own.gpx" }, or the name of a [tracker.NAME]'
            )
        if self.speed is not None and self.speed.high > self.fastest:
            wrong.append(
                f"speed: {self.speed.high / KNOT:.4g} kn is above fastest, {self.fastest / KNOT:.4g} kn"
            )
        fields.refuse(self, wrong)
        return self

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Acts:
        """Return the record of the phase, for a case from `start` to `end`."""
        assert self.acts is not None
        until, lasting = self.end(start)
        speed = self.speed or Spread(0.0, self.fastest, self.fastest / 2)
        followed = (
            None
            if self.tracker is None
            else _followed(self.tracker, start, min(end, until or end), folder)
        )
        return Acts(
            self.course,
            speed,
            self.fastest,
            self.acts,
            self.change,
            self.seek,
            self.hide,
            self.leave,
            math.radians(self.spread),
            followed,
            until,
            lasting,
        )


def _followed(
    table: TrackerTable, start: np.datetime64, end: np.datetime64, folder: Path
) -> Followed:
    """Return the track of a tracker from the start to an end; reject one that does not cover it."""
    lasting = max(float((end - start) / np.timedelta64(1, "s")), 0.0)
    try:
        way = tracker.tracker_path(table, None, start, lasting, folder)
        first, last = (
            start + np.timedelta64(round(time), "s") for time in (way.time[0], way.time[-1])
        )
        if first > start or last < end:
            raise ValueError(
                f"is known from {notation.format_dtg(first)} to {notation.format_dtg(last)}, not from {notation.format_dtg(start)} to "
                f"{notation.format_dtg(end)}; complete its track, or give the phase until"
            )
    except ValueError as error:
        raise ValueError(f"tracker: {error}") from None
    lon, lat = np.radians(path.degrees(way.place))
    return Followed(start, tuple(way.time.tolist()), tuple(lon.tolist()), tuple(lat.tolist()))


class LoiterTable(WindowedTable):
    """Legs of random length and direction inside a polygon."""

    polygon: list[fields.Position]
    speed: Speeds
    leg: fields.Length

    @field_validator("leg")
    @classmethod
    def long_enough(cls, leg: float) -> float:
        """Reject legs so short that the target would only turn."""
        if leg < SHORTEST_LEG:
            raise ValueError(
                f"a mean leg of {leg:.4g} m is too short; at least {SHORTEST_LEG:.0f} m; a number "
                "without a unit is in metres"
            )
        return leg

    @model_validator(mode="after")
    def simple(self) -> "LoiterTable":
        """Reject corners that do not enclose exactly one area."""
        AreaTable.model_construct(polygon=self.polygon).corners()
        return self

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Loiter:
        """Return the record of the phase, for a case from `start` to `end`."""
        lon, lat = np.radians(np.array(AreaTable.model_construct(polygon=self.polygon).corners())).T
        return Loiter(
            InRing(tuple(lon.tolist()), tuple(lat.tolist())), self.speed, self.leg, *self.end(start)
        )


def insert_shared_tables(data: Any) -> Any:
    """Insert the voyages and trackers that phases refer to by name, or by `like`, into the tables.

    Invalid tables are left unchanged; their validation reports them. Raises ValidationError with a
    message for each unknown name.
    """
    if not isinstance(data, dict) or not isinstance(data.get("scenario"), list):
        return data
    wrong: list[str] = []

    def find_shared_table(kind: str, name: Any, where: str) -> dict[str, Any]:
        tables = data.get(kind)
        known = tables if isinstance(tables, dict) else {}
        if isinstance(name, str) and isinstance(known.get(name), dict):
            return dict(known[name])
        there = ", ".join(f"[{kind}.{key}]" for key in known) or f"none; write it as [{kind}.NAME]"
        wrong.append(f"{where}: no {kind} {name!r}; there are: {there}")
        return {}

    def insert_in_phase(phase: Any, where: str) -> Any:
        if not isinstance(phase, dict):
            return phase
        voyage, behaviour = phase.get("voyage"), phase.get("behaviour")
        if isinstance(voyage, str):
            return {**phase, "voyage": find_shared_table("voyage", voyage, f"{where}.voyage")}
        if isinstance(voyage, dict) and voyage.get("like") is not None:
            rest = {key: value for key, value in voyage.items() if key != "like"}
            return {
                **phase,
                "voyage": {
                    **find_shared_table("voyage", voyage["like"], f"{where}.voyage"),
                    **rest,
                },
            }
        if isinstance(behaviour, dict) and isinstance(behaviour.get("tracker"), str):
            who = find_shared_table("tracker", behaviour["tracker"], f"{where}.behaviour.tracker")
            return {**phase, "behaviour": {**behaviour, "tracker": who}}
        return phase

    def insert_in_scenario(scenario: Any) -> Any:
        phases = scenario.get("phase") if isinstance(scenario, dict) else None
        if not isinstance(phases, list):
            return scenario
        where = f'scenario "{scenario.get("name")}".phase'
        return {
            **scenario,
            "phase": [
                insert_in_phase(phase, f"{where} {number}")
                for number, phase in enumerate(phases, 1)
            ],
        }

    made = {**data, "scenario": [insert_in_scenario(scenario) for scenario in data["scenario"]]}
    if wrong:
        raise ValidationError.from_exception_data(
            "scenarios", [fields.complaint(line) for line in wrong]
        )
    return made


LAWS = ("course", "behaviour", "track", "lanes", "voyage", "loiter", "bridge")


class PhaseTable(fields.Table):
    """A [[scenario.phase]] table as written: one of the kinds of motion."""

    course: CourseTable | None = None
    """A constant course, or one that changes."""
    behaviour: ActsTable | None = None
    """At random times it changes course, or begins to seek or to flee from a tracker."""
    track: TrackTable | None = None
    """Way points at times after a start."""
    lanes: LanesTable | None = None
    """A route along the lanes of a network."""
    voyage: VoyageTable | None = None
    """Way points at a speed."""
    loiter: LoiterTable | None = None
    """Legs of random length and direction inside a polygon."""
    bridge: BridgeTable | None = None
    """Brownian bridges between way points."""

    @property
    def kind(self) -> str:
        """The kind of the phase: the name of its table."""
        return fields.one_of(self, LAWS)

    @property
    def endless(self) -> bool:
        """Whether the phase lasts until the end of the run."""
        own = self.course or self.behaviour or self.loiter
        return own is not None and own.until is None and own.lasting is None

    @property
    def begins(self) -> bool:
        """Whether the phase defines its initial position."""
        return self.course is None and self.behaviour is None and self.loiter is None

    @model_validator(mode="after")
    def one_kind(self) -> "PhaseTable":
        """Reject a phase without a kind, or with two."""
        fields.one_of(self, LAWS)
        return self

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Phase:
        """Return the record of the phase, for a case from `start` to `end`."""
        phase: Phase = getattr(self, self.kind).phase(start, end, folder)
        return phase


class DistressTable(fields.Table):
    """When a target under way goes adrift: between two times, at a rate, or after part of its
    path."""

    between: Time | None = None
    rate: Annotated[float, BeforeValidator(fields.rate)] | None = None
    part: Parts | None = None

    @model_validator(mode="after")
    def one_law(self) -> "DistressTable":
        """Reject no distribution, or two."""
        fields.one_of(self, ("between", "rate", "part"))
        return self

    def distress(self, phases: tuple[Phase, ...], start: np.datetime64) -> Distress:
        """Return the record of the distress: when the target goes adrift."""
        if self.rate is not None:
            return Rate(self.rate)
        if self.part is not None:
            first = phases[0]
            if not isinstance(first, Ways) or first.points[-1].time is not None:
                raise ValueError(
                    "part applies only to a voyage or a route along lanes; give between or rate"
                )
            return Part(self.part)
        assert self.between is not None
        return Between(*start_distribution(self.between, start))


class VesselTable(fields.Table):
    """Properties of a target while it is under way."""

    search_object: SearchObject | None = None
    land: Literal["refuse", "stop", "ignore"] = "refuse"
    currents: Literal["compensated", "felt"] = "compensated"
