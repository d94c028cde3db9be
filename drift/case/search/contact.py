"""The [[contact]] table: a sighting or detection at a position, bearing or range, or in an area."""

import math
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from drift.case.context import Run, build_each
from drift.case.scenario.objects import ObjectTable
from drift.case.search import bearings as series
from drift.case.search import heard
from drift.case.search.pattern import RegionTable
from drift.case.search.sensor import Zones, probability
from drift.case.values import fields, messages, units
from drift.case.values.places import ErrorTable
from drift.engine.motion.scenario import UNCHANGED, Scenario
from drift.evidence.filter.detection import heard as heard_law
from drift.evidence.filter.records import Contact, Fix
from geo.errors import UserError
from geo.notation import NMI

DENSITY = {  # by kind of contact: unit and example of the density of false contacts
    "position": ("1/m^2", "0.001 /nmi2"),
    "bearing": ("1/rad", "0.01 /deg"),
    "range": ("1/m", "0.02 /nmi"),
    "area": ("1/m^2", "0.001 /nmi2"),
}


def _fix(row: object) -> Fix:
    if not isinstance(row, list | tuple) or len(row) != 2:
        raise ValueError(
            f'{row!r} is not a fix; write [position, share], like ["27 30N 088 15W", 0.7]'
        )
    place, share = units.position(row[0]), probability(row[1], "share")
    if share == 0:
        raise ValueError(f"a fix with a share of 0, at {row[0]!r}, has no effect; leave it out")
    return Fix(*place, share)


class PlaceTable(ErrorTable):
    """A position with its error, or rival positions with shares (fixes A and B of a beacon)."""

    at: fields.Position | None = None
    fixes: Annotated[list[Any], Field(min_length=1, max_length=100)] | None = None

    @model_validator(mode="after")
    def proper(self) -> "PlaceTable":
        """Reject no position or two, shares that do not add up to 1, and a position without
        error."""
        fields.one_of(self, ("at", "fixes"))
        self.places()
        if min(self.axes()[:2]) <= 0:
            raise ValueError(
                'a contact\'s position needs an error above 0, like error = "1 nmi" (half of all positions are within it)'
            )
        return self

    def places(self) -> tuple[Fix, ...]:
        """Return the possible positions, with shares that add up to 1."""
        if self.at is not None:
            return (Fix(*self.at),)
        fixes = [_fix(row) for row in self.fixes or ()]
        total = math.fsum(fix.share for fix in fixes)
        if not math.isclose(total, 1, abs_tol=0.01):
            raise ValueError(f"shares of the fixes add up to {total:g}; they must add up to 1")
        return tuple(Fix(fix.lon, fix.lat, fix.share / total) for fix in fixes)

    def details(self, run: Run) -> dict[str, Any]:
        """Return the fields of the contact's record that it gives."""
        major, minor, turn = self.axes()
        return {"fixes": self.places(), "major": major, "minor": minor, "orientation": turn}


class BearingTable(heard.BySensorTable):
    """A line of bearing from a position or a sensor: a flare, a direction finder, a sonar."""

    bearing: fields.Direction
    std: heard.BearingError = None
    wedge: heard.Wedge | None = None
    side: heard.Side | None = None
    near: fields.Length = 0.0
    far: fields.Length | None = None
    zones: Zones | None = None

    @model_validator(mode="after")
    def proper(self) -> "BearingTable":
        """Reject no error or two, keys of a sensor without a sensor, and ranges out of order."""
        wrong = self.without_sensor()
        if (self.std is None) == (self.wedge is None):
            wrong.append(
                'give std, like "5 deg", or wedge, the width of a uniform error, like "8 deg"'
            )
        if self.sensor is None:
            if isinstance(self.std, tuple):
                wrong.append("std by relative bearing belongs to an array; give sensor, or one std")
            if self.side is not None:
                wrong.append("side belongs to an array; give sensor, or leave side out")
        if self.far is not None and self.far <= self.near:
            wrong.append("far must be farther than near")
        fields.refuse(self, wrong)
        return self

    def details(self, run: Run) -> dict[str, Any]:
        """Return the fields of the contact's record that it gives."""
        bearing, rows = math.radians(self.bearing), self.std if isinstance(self.std, tuple) else ()
        if rows and rows[-1][0] == 90:  # symmetric ahead and astern
            rows = (*rows, *((180 - angle, std) for angle, std in rows[-2::-1]))
        own, far = self.heard(run, turns=bool(rows)), math.inf if self.far is None else self.far
        if own is not None:
            own, far = (
                heard.resolve_side(own, bearing, self.side),
                min(far, heard.reach(own.sensor)),
            )
        if far <= self.near:
            raise ValueError(
                f'near: sensor "{self.sensor}" detects nothing beyond its reach of {far / NMI:.1f} nmi'
            )
        return {
            "sensor": self.place(run),
            "bearing": bearing,
            "bearing_std": math.radians(self.std) if isinstance(self.std, float) else 0.0,
            "bearing_stds": tuple((math.radians(angle), math.radians(std)) for angle, std in rows),
            "wedge": math.radians(self.wedge or 0.0),
            "near": self.near,
            "far": far,
            "zones": self.zones,
            "heard": own,
        }


class RangeTable(heard.BySensorTable):
    """A range from a position or a sensor."""

    range: Annotated[fields.Length, Field(gt=0)]
    std: Annotated[fields.Length, Field(gt=0)]
    zones: Zones | None = None

    @model_validator(mode="after")
    def proper(self) -> "RangeTable":
        """Reject keys of a sensor without a sensor, and a sensor together with zones."""
        fields.refuse(self, self.without_sensor())
        return self

    def details(self, run: Run) -> dict[str, Any]:
        """Return the fields of the contact's record that it gives."""
        return {
            "sensor": self.place(run),
            "range": self.range,
            "range_std": self.std,
            "zones": self.zones,
            "heard": self.heard(run),
        }


class SeenInTable(RegionTable):
    """A region in which something was seen."""

    def details(self, run: Run) -> dict[str, Any]:
        """Return the fields of the contact's record that it gives."""
        return {"area": self.area()}


def _belief(value: object) -> float:
    belief = probability(value, "belief")
    if belief == 0:
        raise ValueError("belief 0: the contact is certainly false and has no effect; remove it")
    return belief


def _object(value: object) -> object:
    return {"name": value} if isinstance(value, str) else value


class CourseSeenTable(fields.Table):
    """The observed course of the object, with its error."""

    value: fields.Direction
    """Course over ground."""
    std: Annotated[
        float, BeforeValidator(lambda value: units.quantity(value, "deg", "angle", "10 deg"))
    ]
    """Standard deviation of the course, at most 90 degrees."""

    @model_validator(mode="after")
    def proper(self) -> "CourseSeenTable":
        """Reject an error of 0 or above 90 degrees."""
        if not 0 < self.std <= 90:
            raise ValueError(f"std {self.std:g} deg must be above 0 and at most 90 deg")
        return self


class SpeedSeenTable(fields.Table):
    """The observed speed of the object, with its error."""

    value: fields.Speed
    """Speed over ground."""
    std: Annotated[fields.Speed, Field(gt=0)]
    """Standard deviation of the speed."""


class ContactTable(fields.Table):
    """A [[contact]] table as written."""

    name: fields.Label | None = None
    time: fields.Time | None = None
    belief: Annotated[float, BeforeValidator(_belief)] | None = None
    false_density: Any = None
    position: PlaceTable | None = None
    bearing: BearingTable | None = None
    range: RangeTable | None = None
    area: SeenInTable | None = None
    bearings: series.SeriesTable | None = None
    of: Annotated[ObjectTable, BeforeValidator(_object)] | None = None
    course: CourseSeenTable | None = None
    speed: SpeedSeenTable | None = None
    received_level: heard.LevelTable | None = None
    frequency: heard.FrequencyTable | None = None
    guide: bool | None = None
    state: fields.Label | None = None

    @model_validator(mode="after")
    def one_kind(self) -> "ContactTable":
        """Reject no kind of contact or two, and two models of false contacts."""
        fields.one_of(self, (*DENSITY, "bearings"))
        if self.bearings is not None:
            return self  # `each` validates every line
        if self.time is None:
            raise ValueError("time is missing and has no default")
        if self.belief is not None and self.false_density is not None:
            raise ValueError(
                "give belief or false_density, not both: either models a false contact"
            )
        self.false()
        if self.course is not None or self.speed is not None:
            if self.false_density is not None:
                raise ValueError(
                    "false_density covers only positions; with course or speed give belief"
                )
            if self.of is not None:
                raise ValueError(
                    "course and speed are those of the search object; leave them out for debris"
                )
        if self.state is not None and self.of is not None:
            raise ValueError("state is that of the search object; leave it out for debris")
        if self.guide is not None and (self.of is None or self.position is None):
            raise ValueError("guide applies only to a position of debris (of); remove it")
        self._check_sensor()
        return self

    def _check_sensor(self) -> None:
        """Reject keys that a sensor of the case excludes, and keys that need one."""
        by_sensor = (
            isinstance(seen := getattr(self, self.kind()), heard.BySensorTable)
            and seen.sensor is not None
        )
        measured = [
            key for key in ("received_level", "frequency") if getattr(self, key) is not None
        ]
        wrong = []
        if measured and not by_sensor:
            wrong.append(
                f"{' and '.join(measured)}: a bearing or range needs the sensor that measured it"
            )
        if measured and self.false_density is not None:
            wrong.append(
                f"false_density covers only positions; with {' and '.join(measured)} give belief"
            )
        if by_sensor and self.of is not None:
            wrong.append(
                "of and sensor: a sensor of the case observes the object itself; leave one of them out"
            )
        if (
            self.frequency is not None
            and self.frequency.source_group is not None
            and self.belief is not None
        ):
            wrong.append(
                "belief and source_group: a doubtful contact cannot update the source's frequency; leave one out"
            )
        fields.refuse(self, wrong)

    def kind(self) -> str:
        """Return the kind of contact: "position", "bearing", "range" or "area"."""
        return fields.one_of(self, tuple(DENSITY))

    def false(self) -> float:
        """Return the density of false contacts [1/m2], [1/rad] or [1/m], by kind of contact."""
        if self.false_density is None:
            return 0.0
        unit, example = DENSITY[self.kind()]
        given = self.false_density
        if not isinstance(given, str) and given != 0:  # a bare number would be per square metre
            raise ValueError(f'false_density {given!r} needs a unit here, like "{example}"')
        density = units.quantity(given, unit, "density of false contacts", example)
        if density < 0:
            raise ValueError(f"false_density {given!r} must be at least 0")
        return density

    def each(self, run: Run) -> "list[ContactTable]":
        """Return the contacts of the table: itself, or one for each line of a series.

        Raises UserError for mistakes in the series.
        """
        if self.bearings is None:
            return [self]
        found = []
        given = self.model_dump(
            by_alias=True, exclude_unset=True, exclude={"bearings", "name", "time"}
        )
        for number, (line, time, bearing, measured) in enumerate(
            self.bearings.bearings(run.folder), 1
        ):
            tables = {key: given.get(key, {}) | {"value": value} for key, value in measured.items()}
            row = (
                given
                | tables
                | {"name": f"{self.name or 'bearing'} {number}", "time": time, "bearing": bearing}
                | ({} if self.of is None else {"of": self.of})
            )
            try:
                found.append(ContactTable.model_validate(row))
            except ValidationError as error:
                errors = messages.lines(error, {})
                raise UserError(
                    *(
                        f'contact "{self.name or "bearings"}", line {line} of {self.bearings.file}: {one}'
                        for one in errors
                    )
                ) from None
        return found

    def contact(self, name: str, run: Run) -> Contact:
        """Return the record of the contact; raise ValueError if it does not fit the run."""
        assert self.time is not None
        time = units.resolve(self.time, run.start)
        run.check(time, time)
        more = getattr(self, self.kind()).details(run)
        belief = 1.0 if self.belief is None else self.belief
        drifter = self.of.drifter() if self.of is not None else None
        if self.state is not None:
            more["state"] = _known_state(self.state, run.scenarios)
        if self.course is not None:
            more |= {
                "course": math.radians(self.course.value),
                "course_std": math.radians(self.course.std),
            }
        if self.speed is not None:
            more |= {"speed": self.speed.value, "speed_std": self.speed.std}
        if own := more.get("heard"):
            more["heard"] = heard.add_measurements(own, self.received_level, self.frequency)
        contact = Contact(
            name,
            time,
            self.kind(),
            belief,
            self.false(),
            drifter=drifter,
            guide=self.guide is not False,
            **more,
        )
        if heard_law.asks_velocity(contact) and time == run.start:
            raise ValueError(
                "course, speed, a frequency, and a source level by speed need a velocity, which is unknown at the start of "
                "the run: start the run earlier"
            )
        return contact


def _known_state(name: str, scenarios: Sequence[Scenario]) -> str:
    """Return the name of a state of some scenario; raise ValueError for another."""
    changes = [one.name for scenario in scenarios for one in scenario.changes]
    if not changes:
        raise ValueError(
            f'state "{name}": no object changes its state; add [[scenario.change]], or leave it out'
        )
    states = list(dict.fromkeys([UNCHANGED, *changes]))
    if name not in states:
        raise ValueError(
            f'state: no state "{name}"; there are: {", ".join(f"{chr(34)}{own}{chr(34)}" for own in states)}'
        )
    return name


def build_contacts(tables: list[ContactTable], run: Run) -> tuple[Contact, ...]:
    """Return the contacts, ordered by time; raise UserError with their mistakes."""
    tables = [one for table in tables for one in table.each(run)]
    contacts = build_each(
        [table.contact for table in tables], [table.name for table in tables], "contact", run
    )
    _check_groups(contacts)
    return tuple(sorted(contacts, key=lambda contact: contact.time))


def _check_groups(contacts: Sequence[Contact]) -> None:
    """Reject contacts of one source group with different priors of the source's frequency."""
    first: dict[str, Contact] = {}
    for contact in contacts:
        tone = contact.heard.tone if contact.heard else None
        if tone is None or not tone.group:
            continue
        other = first.setdefault(tone.group, contact)
        assert other.heard is not None
        assert other.heard.tone is not None
        if (other.heard.tone.source, other.heard.tone.source_std) != (tone.source, tone.source_std):
            raise UserError(
                f'contact "{contact.name}": source_group "{tone.group}" has another source or source_std in contact '
                f'"{other.name}"; they describe the prior of one source: give the same values'
            )
