"""The case file as written: its tables, each key with its type, its default and what it refuses.

Scenarios, objects, sources, errors and expectations have files of their own; here is what holds
them together.
"""

from collections import Counter
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, field_validator, model_validator

from drift.case.about import AboutTable
from drift.case.expect import Expect
from drift.case.forcing.sources import SourceTable
from drift.case.forcing.uncertainty import Uncertainty, UncertaintyTable
from drift.case.scenario.family import FamilyTable, expanded
from drift.case.scenario.itinerary import shared
from drift.case.scenario.scenario import ScenarioTable
from drift.case.scenario.waypoints import VoyageTable
from drift.case.search.barrier import BarrierTable, LineTable
from drift.case.search.contact import ContactTable
from drift.case.search.look import LookTable
from drift.case.search.plan import PlanTable, ResamplingTable, UnitTable
from drift.case.search.presence import PresenceTable
from drift.case.search.sortie import SortieTable
from drift.case.sonar.sonar import NamedSensorTable
from drift.case.sonar.tow import TowTable
from drift.case.spill import FindTable, PatrolTable, PatrolUnitTable, SpillTable
from drift.case.tracking.tracker import TrackerTable
from drift.case.values import fields, units
from drift.case.values.grid import GridTable
from drift.forecast import shares
from geo import notation
from geo.box import Box, box_between

SEARCH = (
    "sortie",
    "contact",
    "sensor",
    "look",
    "presence",
    "barrier",
    "line",
    "unit",
    "tow",
)  # tables of a search for one object
MOST_PARTICLES = 2**31 - 1  # they are numbered in 32 bits


class OutputTable(fields.Table):
    """The [output] table as written."""

    every: fields.Duration | None = None
    """Time between outputs from the start on; 6 h unless this or `times` is given."""
    times: list[fields.Time] | None = None
    """The outputs themselves, within the run."""
    datum: fields.Time | None = None
    """When the datum is asked for: an output of its own, at which `map.png` and the report open;
    without it the begin of the plan, the end of the last sortie, or the end."""
    trajectories: fields.Count = 200
    """How many tracks `particles.nc` and the maps show."""
    grid: GridTable | None = None
    """One grid for all outputs, on which runs can be subtracted; without it a grid is chosen for
    each.
    """
    areas: Annotated[tuple[float, ...], BeforeValidator(shares.percents)] = tuple(
        100 * share for share in shares.SHARES
    )
    """Shares of the probability, in per cent, whose smallest areas are reported in every output."""
    about: AboutTable = AboutTable()
    """Who made this and how it may be used; stands in every file."""

    @model_validator(mode="after")
    def one_way(self) -> "OutputTable":
        """Refuse two ways of giving the times."""
        if self.every is not None and self.times is not None:
            raise ValueError("give every or times, not both")
        if self.trajectories < 0:
            raise ValueError(f"trajectories {self.trajectories} must be at least 0")
        return self

    def fractions(self) -> tuple[float, ...]:
        """Return the shares whose areas are asked for."""
        return tuple(percent / 100 for percent in self.areas)


def _step(value: object) -> int | None:
    if value == "auto":
        return None
    seconds = units.quantity(value, "s", "step", "10 min")
    if seconds < 1 or seconds != round(seconds) or seconds > 86_400:
        raise ValueError(f'{value!r} must be "auto" or a whole number of seconds, 1 s to 24 h')
    return int(seconds)


class ClockTable(fields.Table):
    """The [clock] table as written."""

    step: Annotated[int | None, BeforeValidator(_step)] = None
    """Length of a step, `"auto"` or a whole number of seconds;

    `auto` halves steps until `tolerance` is met, over the whole run.
    """
    scheme: Literal["rk2", "rk4"] = "rk4"
    """Runge-Kutta of order 4, or of order 2."""
    tolerance: Annotated[fields.Length, Field(gt=0)] = 20.0
    """How far a day's drift with the chosen step may be from that with half of it, and how far a
    place inside a step.
    """


class DomainTable(fields.Table):
    """The [domain] table as written; beyond 89 degrees of latitude it holds the pole and goes all
    round it.
    """

    west: fields.Edge
    """Western edge."""
    south: fields.Latitude
    """Southern edge."""
    east: fields.Edge
    """Eastern edge; may lie across the antimeridian, as -170 or 190.

    Half the Earth or more must be written beyond `west`.
    """
    north: fields.Latitude
    """Northern edge."""

    @model_validator(mode="after")
    def proper(self) -> "DomainTable":
        """Refuse an empty box."""
        if self.south >= self.north:
            raise ValueError(f"south {self.south:g} is not below north {self.north:g}")
        self.box()
        return self

    def box(self) -> Box:
        """Return the box; one whose east is not east of its west lies across the antimeridian or
        goes round.
        """
        return box_between(self.west, self.south, self.east, self.north)


def _lakes(value: object) -> bool | str:
    if not isinstance(value, bool | str):
        raise ValueError(f"{value!r} must be true, false or a file of lakes")
    return value


class CoastTable(fields.Table):
    """The [coast] table as written."""

    source: str = "gshhg"
    """`"gshhg"`, the full-resolution shoreline that comes along, `"none"`, or a file of a shoreline
    of your own.
    """
    lakes: Annotated[Any, BeforeValidator(_lakes)] = False
    """`true` where lakes of `source` are water, or a file of lakes; else they are land."""
    behaviour: Literal["strand", "refloat", "slide"] = "strand"
    """Particles at the shore stay, refloat with a half-life, or slide along it."""
    half_life: fields.Duration | None = None
    """Of stranded particles, with `refloat`."""
    offing: Annotated[fields.Length, Field(gt=0, le=2000)] = 100.0
    """How far off the shore what refloats begins again."""

    @model_validator(mode="after")
    def one_behaviour(self) -> "CoastTable":
        """Refuse a half-life of what does not refloat, and refloating without one."""
        if (self.half_life is None) == (self.behaviour == "refloat"):
            raise ValueError(
                'behaviour = "refloat" needs a half_life, like "12 h"; no other behaviour has one'
            )
        return self


class DepthTable(fields.Table):
    """The [depth] table as written: where boats have too little water."""

    file: str
    variable: fields.Label | None = None
    positive: Literal["up", "down"] | None = None


def _particles(value: object) -> int:
    number = fields.count(value)
    if number < 1:
        raise ValueError(f"{number} particles; at least 1")
    if number > MOST_PARTICLES:
        raise ValueError(f"{number:,} particles; at most {MOST_PARTICLES:,}")
    return number


class CaseTable(fields.Table):
    """The case file as written."""

    title: fields.Label | None = None
    """What maps and files are called; without it the file's name."""
    start: fields.Time
    """When the run begins, with its zone; all relative times of the case count from here."""
    duration: fields.Duration | None = None
    """How long the run lasts; give this or `end`."""
    end: fields.Time | None = None
    """When the run ends; before `start` in a backward run."""
    direction: Literal["forward", "backward"] = "forward"
    """`backward` asks where something found came from: time runs from `start` to the past."""
    particles: Annotated[int, BeforeValidator(_particles)] = 100_000
    """How many guesses of where the object is are moved; more make maps smoother and rarer things
    visible.
    """
    seed: fields.Count = 1
    """The number from which all chance of the run follows: the same case and seed give the same
    bits.
    """
    max_lost: fields.Share = 0.2
    """The largest share of the probability that may be lost at the edges of the forcing; more is
    rejected.
    """
    output: OutputTable = OutputTable()
    """When there are maps, of what areas, and on which grid."""
    clock: ClockTable = ClockTable()
    """How time is stepped."""
    domain: DomainTable | None = None
    """A box beyond which what drifts is no longer followed; without it, as far as anything can get."""
    coast: CoastTable = CoastTable()
    """Shoreline, lakes, and what becomes of what reaches the shore."""
    depth: DepthTable | None = None
    """Where boats of a plan have too little water."""
    current: list[SourceTable] = Field(default_factory=list)
    """Sources of the current, in order of priority."""
    wind: list[SourceTable] = Field(default_factory=list)
    """Sources of the wind."""
    stokes: list[SourceTable] = Field(default_factory=list)
    """Sources of the Stokes drift."""
    uncertainty: Uncertainty = UncertaintyTable()
    """How wrong winds and currents may be; `"none"` switches all of it off."""
    voyage: dict[str, VoyageTable] = Field(default_factory=dict)
    """Voyages by name, `[voyage.passage]`, that several scenarios share: a phase says `voyage =
    "passage"`, or `voyage = { like = "passage", speed = "3 kn" }` where some of its keys are its
    own."""
    tracker: dict[str, TrackerTable] = Field(default_factory=dict)
    """Vessels that targets seek or flee from, by name, `[tracker.patrol]`: a phase of `behaviour`
    says `tracker = "patrol"`.
    """
    scenario: list[ScenarioTable] = Field(default_factory=list)
    """Scenarios of one object, each with its weight; give these, families of them, or a `[spill]`."""
    family: list[FamilyTable] = Field(default_factory=list)
    """Hundreds of scenarios in a few lines: the products of routes, speeds, times."""
    spill: SpillTable | None = None
    """Many objects released by one event."""
    find: list[FindTable] = Field(default_factory=list)
    """Objects of a spill that were found."""
    patrol: list[PatrolTable] = Field(default_factory=list)
    """Patrols that walked stretches of coast."""
    patrol_unit: list[PatrolUnitTable] = Field(default_factory=list)
    """Teams that can walk the shore next: `drift plan` of a spill sends them."""
    sortie: list[SortieTable] = Field(default_factory=list)
    """Searches that found nothing, or were flown."""
    contact: list[ContactTable] = Field(default_factory=list)
    """What was seen or heard and may be ours."""
    sensor: list[NamedSensorTable] = Field(default_factory=list)
    """Sensors that know the water: passive sonars, and POD by place; watches, looks, contacts and
    units name them.
    """
    look: list[LookTable] = Field(default_factory=list)
    """A sensor that looked once, at one time."""
    presence: list[PresenceTable] = Field(default_factory=list)
    """A field that was watched over a time."""
    barrier: list[BarrierTable] = Field(default_factory=list)
    """A line that was manned and reports targets that cross it."""
    line: list[LineTable] = Field(default_factory=list)
    """A line of which the first crossing is asked."""
    unit: list[UnitTable] = Field(default_factory=list)
    """Units that can search next: `drift plan` sends them."""
    tow: list[TowTable] = Field(default_factory=list)
    """Ships that tow arrays: `drift plan` places them."""
    plan: PlanTable = PlanTable()
    """The time and the aim of the next search."""
    resampling: ResamplingTable = ResamplingTable()
    """How particles are resampled after searches."""
    expect: Expect = Expect()
    """Ranges of what the case expects at its end:

    `drift run` says whether it is so, and its exit status is 1 if not.
    """

    @model_validator(mode="before")
    @classmethod
    def with_shared(cls, data: Any) -> Any:
        """Make scenarios of families, and put the voyages and trackers that scenarios share where
        they are named.
        """
        return shared(expanded(data))

    @field_validator("seed")
    @classmethod
    def fits(cls, value: int) -> int:
        """Refuse a seed that the generator's 64-bit key does not hold."""
        if not 0 <= value < 2**63:
            raise ValueError(f"{value} must be 0 to 2^63 - 1")
        return value

    @field_validator("start")
    @classmethod
    def absolute(cls, value: units.Instant) -> units.Instant:
        """Refuse a start that is relative to itself."""
        if not isinstance(value, np.datetime64):
            raise ValueError('cannot be relative; write it like "211830ZNOV26"')
        return value

    @model_validator(mode="after")
    def whole(self) -> "CaseTable":
        """Refuse a case of nothing, one of two kinds, and one whose times don't fit its direction."""
        wrong = [*self._subject(), *self._families(), *self._backward(), *self._span()]
        fields.refuse(self, wrong)
        return self

    def _subject(self) -> list[str]:
        if bool(self.scenario) == (self.spill is not None):
            return [
                "give either [[scenario]] or [[family]] tables, of one object, or a [spill] of many"
            ]
        wrong = []
        if self.spill is None and (self.find or self.patrol or self.patrol_unit):
            wrong.append("[[find]], [[patrol]] and [[patrol_unit]] belong to a [spill]")
        if self.spill is not None and "particles" in self.model_fields_set:
            wrong.append(
                "particles: a spill has spill.worlds times spill.per_world of them; give those"
            )
        if self.spill is not None and (given := self._of_a_search()):
            wrong.append(
                f"{given} belongs to a search with [[scenario]] tables; a [spill] has [[find]] and [[patrol]]"
            )
        return wrong

    def _families(self) -> list[str]:
        """Return families that bear the name of another one or of a scenario: tables by scenario
        name both.
        """
        names = Counter([table.name for table in self.family])
        stories = {table.name for table in self.scenario} if names else set()
        wrong = [
            f'family "{name}": two families have this name; give each its own'
            for name in names
            if names[name] > 1
        ]
        return wrong + [
            f'family "{name}": a scenario has this name too; give each its own'
            for name in names
            if name in stories
        ]

    def _backward(self) -> list[str]:
        given = self._of_a_search() if self.direction == "backward" and self.spill is None else ""
        return (
            [f"{given} belongs to a forward run: a search and its plan go with the time"]
            if given
            else []
        )

    def _of_a_search(self) -> str:
        """Return the first table that belongs to a search, "" without one."""
        given = [f"[[{key}]]" for key in SEARCH if getattr(self, key)]
        given += [f"[{key}]" for key in ("plan", "resampling") if key in self.model_fields_set]
        return given[0] if given else ""

    def _span(self) -> list[str]:
        try:
            fields.one_of(self, ("duration", "end"))
        except ValueError as error:
            return [str(error)]
        start, end = self.begin(), self.finish()
        if end == start and self.duration is not None:
            return [f"duration {self.duration:g} s is less than a second: nothing to forecast"]
        if end == start:
            return [f"end {notation.format_dtg(end)} is the start: nothing to forecast"]
        if (end < start) == (self.direction == "backward"):
            return []
        fault = "before" if end < start else "after"
        cure = (
            'an end after the start, or direction = "backward"'
            if end < start
            else "an end before the start"
        )
        return [
            f"end {notation.format_dtg(end)} is {fault} start {notation.format_dtg(start)} in a {self.direction} run; give {cure}"
        ]

    def begin(self) -> np.datetime64:
        """Return the start."""
        assert isinstance(self.start, np.datetime64)  # absolute
        return self.start

    def finish(self) -> np.datetime64:
        """Return the end."""
        if self.end is not None:
            return units.resolve(self.end, self.begin())
        span = np.timedelta64(round(self.duration or 0.0), "s")
        return self.begin() - span if self.direction == "backward" else self.begin() + span
