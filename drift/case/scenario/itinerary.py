"""How a target steers: the phases of a [[scenario]], its distress, and what land means to it.

Tables of the case file, and the records of drift.engine.motion.steering.itinerary that they become.
Each phase is one of course, behaviour, loiter and, by way points (drift.case.scenario.waypoints),
track, lanes, voyage and bridge.
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
from drift.case.values.spreads import Courses, Parts, Speeds, Time, begins
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
SHORTEST_LEG = 500.0  # [m] of an area to loiter in, on average


class WindowedTable(fields.Table):
    """How long a phase lasts: until a time, or for a duration, or as long as the run."""

    until: fields.Time | None = None
    lasting: Annotated[fields.Duration | None, Field(alias="for")] = None

    def end(self, start: np.datetime64) -> tuple[np.datetime64 | None, float]:
        """Return when it is over at the latest, and how long it lasts at most [s]."""
        until = None if self.until is None else units.resolve(self.until, start)
        return until, math.inf if self.lasting is None else self.lasting


class CourseTable(WindowedTable):
    """A constant course, or one that changes."""

    course: Courses
    speed: Speeds
    change: fields.Duration | None = None

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Course:
        """Return the record."""
        return Course(self.course, self.speed, self.change or 0.0, *self.end(start))


ANY_COURSE = Spread(0.0, 2 * math.pi, math.pi)


class ActsTable(BehaviourTable, WindowedTable):
    """A course that is kept, changed, or one that leads to a tracker or away from it, at times of
    its own.
    """

    course: Courses = ANY_COURSE
    speed: Speeds | None = None
    tracker: TrackerTable | None = None

    @model_validator(mode="after")
    def of_whom(self) -> "ActsTable":
        """Refuse what seeks or flees from nobody, what never acts, and a first speed above the
        highest.
        """
        wrong = []
        if self.acts is None:
            wrong.append(
                'acts: is missing, like ["3 min", "15 min"]; what keeps its course is a phase of course'
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
        """Return the record."""
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
    """Return where a tracker is from the start to an end; refuse a track that does not say it."""
    lasting = max(float((end - start) / np.timedelta64(1, "s")), 0.0)
    try:
        way = tracker.way(table, None, start, lasting, folder)
        first, last = (
            start + np.timedelta64(round(time), "s") for time in (way.time[0], way.time[-1])
        )
        if first > start or last < end:
            raise ValueError(
                f"is known from {notation.group(first)} to {notation.group(last)}, not from {notation.group(start)} to "
                f"{notation.group(end)}; complete its track, or give the phase until"
            )
    except ValueError as error:
        raise ValueError(f"tracker: {error}") from None
    lon, lat = np.radians(path.degrees(way.place))
    return Followed(start, tuple(way.time.tolist()), tuple(lon.tolist()), tuple(lat.tolist()))


class LoiterTable(WindowedTable):
    """To and fro in a polygon."""

    polygon: list[fields.Position]
    speed: Speeds
    leg: fields.Length

    @field_validator("leg")
    @classmethod
    def long_enough(cls, leg: float) -> float:
        """Refuse legs after which a target would do nothing but turn, for ever."""
        if leg < SHORTEST_LEG:
            raise ValueError(
                f"{leg:.4g} m on average between turns is too short; allowed: {SHORTEST_LEG:.0f} m or more; a number "
                "without a unit is in metres"
            )
        return leg

    @model_validator(mode="after")
    def simple(self) -> "LoiterTable":
        """Refuse what encloses no area, or not one."""
        AreaTable.model_construct(polygon=self.polygon).corners()
        return self

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Loiter:
        """Return the record."""
        lon, lat = np.radians(np.array(AreaTable.model_construct(polygon=self.polygon).corners())).T
        return Loiter(
            InRing(tuple(lon.tolist()), tuple(lat.tolist())), self.speed, self.leg, *self.end(start)
        )


def shared(data: Any) -> Any:
    """Return the tables of a case as read with what its phases name put in: voyages, alone or by
    `like`, and trackers.

    What is not as it should be stays as it is, and is refused where it stands. Raises
    ValidationError, a complaint for each name that there is none of.
    """
    if not isinstance(data, dict) or not isinstance(data.get("scenario"), list):
        return data
    wrong: list[str] = []

    def named(kind: str, name: Any, where: str) -> dict[str, Any]:
        tables = data.get(kind)
        known = tables if isinstance(tables, dict) else {}
        if isinstance(name, str) and isinstance(known.get(name), dict):
            return dict(known[name])
        there = ", ".join(f"[{kind}.{key}]" for key in known) or f"none; write it as [{kind}.NAME]"
        wrong.append(f"{where}: no {kind} {name!r}; there are: {there}")
        return {}

    def whole(phase: Any, where: str) -> Any:
        if not isinstance(phase, dict):
            return phase
        voyage, behaviour = phase.get("voyage"), phase.get("behaviour")
        if isinstance(voyage, str):
            return {**phase, "voyage": named("voyage", voyage, f"{where}.voyage")}
        if isinstance(voyage, dict) and voyage.get("like") is not None:
            rest = {key: value for key, value in voyage.items() if key != "like"}
            return {
                **phase,
                "voyage": {**named("voyage", voyage["like"], f"{where}.voyage"), **rest},
            }
        if isinstance(behaviour, dict) and isinstance(behaviour.get("tracker"), str):
            who = named("tracker", behaviour["tracker"], f"{where}.behaviour.tracker")
            return {**phase, "behaviour": {**behaviour, "tracker": who}}
        return phase

    def told(story: Any) -> Any:
        phases = story.get("phase") if isinstance(story, dict) else None
        if not isinstance(phases, list):
            return story
        where = f'scenario "{story.get("name")}".phase'
        return {
            **story,
            "phase": [whole(phase, f"{where} {number}") for number, phase in enumerate(phases, 1)],
        }

    made = {**data, "scenario": [told(story) for story in data["scenario"]]}
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
    """A course that it changes, or on which it seeks or flees from a tracker, at times of its own."""
    track: TrackTable | None = None
    """Places at times after a start."""
    lanes: LanesTable | None = None
    """Along lanes of a network."""
    voyage: VoyageTable | None = None
    """By way points at a speed."""
    loiter: LoiterTable | None = None
    """To and fro in a polygon."""
    bridge: BridgeTable | None = None
    """Brownian bridges from way point to way point."""

    @property
    def kind(self) -> str:
        """Its kind, the name of its table."""
        return fields.one_of(self, LAWS)

    @property
    def endless(self) -> bool:
        """Whether it goes on for as long as the run."""
        own = self.course or self.behaviour or self.loiter
        return own is not None and own.until is None and own.lasting is None

    @property
    def begins(self) -> bool:
        """Whether it says where it begins."""
        return self.course is None and self.behaviour is None and self.loiter is None

    @model_validator(mode="after")
    def one_kind(self) -> "PhaseTable":
        """Refuse none or two kinds."""
        fields.one_of(self, LAWS)
        return self

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Phase:
        """Return the record."""
        phase: Phase = getattr(self, self.kind).phase(start, end, folder)
        return phase


class DistressTable(fields.Table):
    """When a target that is under way goes adrift: between two times, at a rate, or after a part of
    its way.
    """

    between: Time | None = None
    rate: Annotated[float, BeforeValidator(fields.rate)] | None = None
    part: Parts | None = None

    @model_validator(mode="after")
    def one_law(self) -> "DistressTable":
        """Refuse none or two laws."""
        fields.one_of(self, ("between", "rate", "part"))
        return self

    def distress(self, phases: tuple[Phase, ...], start: np.datetime64) -> Distress:
        """Return the record."""
        if self.rate is not None:
            return Rate(self.rate)
        if self.part is not None:
            first = phases[0]
            if not isinstance(first, Ways) or first.points[-1].time is not None:
                raise ValueError(
                    "part is that of a voyage or a route along lanes; give between or rate"
                )
            return Part(self.part)
        assert self.between is not None
        return Between(*begins(self.between, start))


class VesselTable(fields.Table):
    """What a target is like while it is under way."""

    search_object: SearchObject | None = None
    land: Literal["refuse", "stop", "ignore"] = "refuse"
    currents: Literal["compensated", "felt"] = "compensated"
