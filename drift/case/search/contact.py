"""Contacts as a case file gives them: something was seen at a position, bearing, range or area."""

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
from drift.evidence.filter.detection import heard as heard_law
from drift.evidence.filter.records import Contact, Fix
from geo.errors import UserError
from geo.notation import NMI

DENSITY = {  # kinds of contact, with unit and example of the density of false ones
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
        raise ValueError(f"a fix with a share of 0, at {row[0]!r}, says nothing; leave it out")
    return Fix(*place, share)


class PlaceTable(ErrorTable):
    """A position, or rival ones with their shares (fixes A and B of a beacon), and its error."""

    at: fields.Position | None = None
    fixes: Annotated[list[Any], Field(min_length=1, max_length=100)] | None = None

    @model_validator(mode="after")
    def proper(self) -> "PlaceTable":
        """Refuse none or two places, shares that don't add up, and a position without error."""
        fields.one_of(self, ("at", "fixes"))
        self.places()
        if min(self.axes()[:2]) <= 0:
            raise ValueError(
                'a contact\'s position has an error above 0, like error = "1 nmi" (half of them within it)'
            )
        return self

    def places(self) -> tuple[Fix, ...]:
        """Return the positions it may be at, shares adding up to 1."""
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
    """A line of bearing from a place or a sensor: a flare, a direction finder, a sonar."""

    bearing: fields.Direction
    std: heard.BearingError = None
    wedge: heard.Wedge | None = None
    side: heard.Side | None = None
    near: fields.Length = 0.0
    far: fields.Length | None = None
    zones: Zones | None = None

    @model_validator(mode="after")
    def proper(self) -> "BearingTable":
        """Refuse none or two errors, what is of a sensor where none is named, and ranges from far
        to near.
        """
        wrong = self.without_sensor()
        if (self.std is None) == (self.wedge is None):
            wrong.append(
                'give std, like "5 deg", or wedge, within which all errors are as likely, like "8 deg"'
            )
        if self.sensor is None:
            if isinstance(self.std, tuple):
                wrong.append("std by relative bearing is of an array; give sensor, or one std")
            if self.side is not None:
                wrong.append("side is of an array; give sensor, or leave side out")
        if self.far is not None and self.far <= self.near:
            wrong.append("far must be farther than near")
        fields.refuse(self, wrong)
        return self

    def details(self, run: Run) -> dict[str, Any]:
        """Return the fields of the contact's record that it gives."""
        bearing, rows = math.radians(self.bearing), self.std if isinstance(self.std, tuple) else ()
        if rows and rows[-1][0] == 90:  # the same ahead and astern
            rows = (*rows, *((180 - angle, std) for angle, std in rows[-2::-1]))
        own, far = self.heard(run, turns=bool(rows)), math.inf if self.far is None else self.far
        if own is not None:
            own, far = heard.sided(own, bearing, self.side), min(far, heard.reach(own.sensor))
        if far <= self.near:
            raise ValueError(
                f'near: nothing is seen there by sensor "{self.sensor}", which reaches {far / NMI:.1f} nmi'
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
    """A distance from a place or a sensor."""

    range: Annotated[fields.Length, Field(gt=0)]
    std: Annotated[fields.Length, Field(gt=0)]
    zones: Zones | None = None

    @model_validator(mode="after")
    def proper(self) -> "RangeTable":
        """Refuse what is of a sensor where none is named, and one beside zones."""
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
    """A region within which something was seen."""

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
    """The course with which something was seen to move, and its error."""

    value: fields.Direction
    """The course over ground."""
    std: Annotated[
        float, BeforeValidator(lambda value: units.quantity(value, "deg", "angle", "10 deg"))
    ]
    """Its standard deviation, to 90 degrees."""

    @model_validator(mode="after")
    def proper(self) -> "CourseSeenTable":
        """Refuse an error of zero."""
        if not 0 < self.std <= 90:
            raise ValueError(f"std {self.std:g} deg must be above 0 and at most 90 deg")
        return self


class SpeedSeenTable(fields.Table):
    """The speed with which something was seen to move, and its error."""

    value: fields.Speed
    """The speed over ground."""
    std: Annotated[fields.Speed, Field(gt=0)]
    """Its standard deviation."""


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

    @model_validator(mode="after")
    def one_kind(self) -> "ContactTable":
        """Refuse none or two kinds, and two ways of being false."""
        fields.one_of(self, (*DENSITY, "bearings"))
        if self.bearings is not None:
            return self  # each of its lines is looked at by itself
        if self.time is None:
            raise ValueError("time is missing and has no default")
        if self.belief is not None and self.false_density is not None:
            raise ValueError(
                "give belief or false_density, not both: either says how a contact may be false"
            )
        self.false()
        if self.course is not None or self.speed is not None:
            if self.false_density is not None:
                raise ValueError(
                    "false_density is of places alone; with course or speed give belief"
                )
            if self.of is not None:
                raise ValueError("course and speed are the object's own; leave them out of debris")
        if self.guide is not None and (self.of is None or self.position is None):
            raise ValueError("guide applies only to a position of debris (of); remove it")
        self._check_sensor()
        return self

    def _check_sensor(self) -> None:
        """Refuse what a contact by a sensor of the case cannot tell, and what only such a one can."""
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
                f"false_density is of places alone; with {' and '.join(measured)} give belief"
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
                "belief and source_group: what a doubtful contact teaches of the source is not followed; leave one out"
            )
        fields.refuse(self, wrong)

    def kind(self) -> str:
        """Return the kind of contact."""
        return fields.one_of(self, tuple(DENSITY))

    def false(self) -> float:
        """Return the density of false contacts, in what the contact is measured in."""
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
        """Return it, or of a series each of its contacts; raise UserError for what is wrong with
        one.
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
            )
            try:
                found.append(ContactTable.model_validate(row))
            except ValidationError as error:
                told = messages.lines(error, {})
                raise UserError(
                    *(
                        f'contact "{self.name or "bearings"}", line {line} of {self.bearings.file}: {one}'
                        for one in told
                    )
                ) from None
        return found

    def contact(self, name: str, run: Run) -> Contact:
        """Return the record; raise ValueError for what does not fit the run."""
        assert self.time is not None
        time = units.resolve(self.time, run.start)
        run.check(time, time)
        more = getattr(self, self.kind()).details(run)
        belief = 1.0 if self.belief is None else self.belief
        drifter = self.of.drifter() if self.of is not None else None
        if self.course is not None:
            more |= {
                "course": math.radians(self.course.value),
                "course_std": math.radians(self.course.std),
            }
        if self.speed is not None:
            more |= {"speed": self.speed.value, "speed_std": self.speed.std}
        if own := more.get("heard"):
            more["heard"] = heard.measured(own, self.received_level, self.frequency)
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
                "course, speed, a frequency, and a source level by speed are those of a way; at the start of the run there is "
                "none yet: start earlier"
            )
        return contact


def build_contacts(tables: list[ContactTable], run: Run) -> tuple[Contact, ...]:
    """Return the contacts by time; raise UserError for what is wrong with one."""
    tables = [one for table in tables for one in table.each(run)]
    contacts = build_each(
        [table.contact for table in tables], [table.name for table in tables], "contact", run
    )
    _check_groups(contacts)
    return tuple(sorted(contacts, key=lambda contact: contact.time))


def _check_groups(contacts: Sequence[Contact]) -> None:
    """Refuse contacts of one source that say different things of it before any was heard."""
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
                f'"{other.name}"; they are what was known before any of them: give the same'
            )
