"""The schema of the case file: `CaseTable`, its top-level keys, and the smaller tables.

Scenarios, objects, sources, errors and searches have modules of their own.
"""

from collections import Counter
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, field_validator, model_validator

from drift.case.about import AboutTable
from drift.case.expect import Expect
from drift.case.forcing.sources import SourceTable
from drift.case.forcing.uncertainty import Uncertainty, UncertaintyTable
from drift.case.scenario.catalogue import LeewayTable
from drift.case.scenario.family import FamilyTable, expand_families
from drift.case.scenario.itinerary import insert_shared_tables
from drift.case.scenario.scenario import ScenarioTable
from drift.case.scenario.waypoints import VoyageTable
from drift.case.search.barrier import BarrierTable, LineTable
from drift.case.search.contact import ContactTable
from drift.case.search.drifter import DrifterTable
from drift.case.search.look import LookTable
from drift.case.search.plan import PlanTable, ResamplingTable, UnitTable
from drift.case.search.presence import PresenceTable
from drift.case.search.report import ReportTable
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
MOST_PARTICLES = 2**31 - 1  # particles are numbered in 32 bits


class OutputTable(fields.Table):
    """The [output] table as written."""

    every: fields.Duration | None = None
    """Interval between outputs, from the start; 6 h unless this or `times` is given."""
    times: list[fields.Time] | None = None
    """Output times within the run, in place of `every`."""
    datum: fields.Time | None = None
    """Time of the datum: an additional output, shown by `map.png` and first in the report. By
    default the begin of the plan, else the end of the last sortie, else the end of the run."""
    trajectories: fields.Count = 200
    """Number of tracks in `particles.nc` and on maps."""
    grid: GridTable | None = None
    """One grid for all outputs, so that runs can be compared cell by cell; by default drift chooses
    a grid for each output.
    """
    areas: Annotated[tuple[float, ...], BeforeValidator(shares.percents)] = tuple(
        100 * share for share in shares.SHARES
    )
    """Containment areas of every output, in per cent of the probability."""
    about: AboutTable = AboutTable()
    """Authors and terms of use, written into every output file."""

    @model_validator(mode="after")
    def one_way(self) -> "OutputTable":
        """Reject output times given twice, and a negative number of tracks."""
        if self.every is not None and self.times is not None:
            raise ValueError("give every or times, not both")
        if self.trajectories < 0:
            raise ValueError(f"trajectories {self.trajectories} must be at least 0")
        return self

    def fractions(self) -> tuple[float, ...]:
        """Return the probabilities of the requested containment areas, 0 to 1."""
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
    """Time step: `"auto"` or a whole number of seconds.

    `auto` halves the step until `tolerance` is met, and uses it for the whole run.
    """
    scheme: Literal["rk2", "rk4"] = "rk4"
    """Runge-Kutta scheme of order 4 or 2."""
    tolerance: Annotated[fields.Length, Field(gt=0)] = 20.0
    """Largest difference of a day's drift between the chosen step and half of it; also the largest
    error of positions interpolated inside a step.
    """


class DomainTable(fields.Table):
    """The [domain] table as written.

    A box that reaches beyond 89 degrees of latitude includes the pole and all longitudes.
    """

    west: fields.Edge
    """Western edge."""
    south: fields.Latitude
    """Southern edge."""
    east: fields.Edge
    """Eastern edge; across the antimeridian write -170 or 190.

    For a box of half the Earth or more, write a number above `west`.
    """
    north: fields.Latitude
    """Northern edge."""

    @model_validator(mode="after")
    def proper(self) -> "DomainTable":
        """Reject an empty box."""
        if self.south >= self.north:
            raise ValueError(f"south {self.south:g} is not below north {self.north:g}")
        self.box()
        return self

    def box(self) -> Box:
        """Return the box; if its east is below its west it crosses the antimeridian."""
        return box_between(self.west, self.south, self.east, self.north)


def _lakes(value: object) -> bool | str:
    if not isinstance(value, bool | str):
        raise ValueError(f"{value!r} must be true, false or a file of lakes")
    return value


class CoastTable(fields.Table):
    """The [coast] table as written."""

    source: str = "gshhg"
    """`"gshhg"`, the included full-resolution shoreline, `"none"`, or a shoreline file of your
    own."""
    lakes: Annotated[Any, BeforeValidator(_lakes)] = False
    """`true`: lakes of `source` are water; or a file of lakes. By default lakes are land."""
    behaviour: Literal["strand", "refloat", "slide"] = "strand"
    """Particles at the shore stay, refloat with a half-life, or slide along it."""
    half_life: fields.Duration | None = None
    """Half-life of stranding; needs `behaviour = "refloat"`."""
    offing: Annotated[fields.Length, Field(gt=0, le=2000)] = 100.0
    """Distance from the shore at which a refloated particle starts."""

    @model_validator(mode="after")
    def one_behaviour(self) -> "CoastTable":
        """Reject refloating without a half-life, and a half-life with another behaviour."""
        if (self.half_life is None) == (self.behaviour == "refloat"):
            raise ValueError(
                'behaviour = "refloat" needs a half_life, like "12 h"; no other behaviour has one'
            )
        return self


class DepthTable(fields.Table):
    """The [depth] table as written: bathymetry, for boats of a plan."""

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
    """Title of maps and files; by default the file's name."""
    start: fields.Time
    """Start of the run, with its time zone; relative times of the case count from here."""
    duration: fields.Duration | None = None
    """Duration of the run; give this or `end`."""
    end: fields.Time | None = None
    """End of the run; in a backward run it is before `start`."""
    direction: Literal["forward", "backward"] = "forward"
    """`backward` traces an object back to its origin: time runs from `start` into the past."""
    particles: Annotated[int, BeforeValidator(_particles)] = 100_000
    """Number of particles: possible positions of the object that the run moves. More particles
    resolve smaller probabilities and make smoother maps.
    """
    seed: fields.Count = 1
    """Seed of all random numbers: the same case and seed give the same results to the bit."""
    max_lost: fields.Share = 0.2
    """Largest probability that may leave the forcing; a run that loses more is rejected."""
    output: OutputTable = OutputTable()
    """Output times, containment areas and grid."""
    clock: ClockTable = ClockTable()
    """Time step and integration scheme."""
    domain: DomainTable | None = None
    """Box outside which particles are no longer moved; by default as far as an object can drift."""
    coast: CoastTable = CoastTable()
    """Shoreline, lakes, and what happens to particles at the shore."""
    depth: DepthTable | None = None
    """Bathymetry that keeps boats of a plan out of shallow water."""
    current: list[SourceTable] = Field(default_factory=list)
    """Sources of the current, in order of priority."""
    wind: list[SourceTable] = Field(default_factory=list)
    """Sources of the wind."""
    stokes: list[SourceTable] = Field(default_factory=list)
    """Sources of the Stokes drift."""
    leeway: LeewayTable = LeewayTable()
    """Leeway classes of your own, and whether leeway lines include the Stokes drift."""
    uncertainty: Uncertainty = UncertaintyTable()
    """Errors of winds and currents; `"none"` sets all to zero."""
    voyage: dict[str, VoyageTable] = Field(default_factory=dict)
    """Voyages by name, `[voyage.passage]`, for several scenarios. A phase refers to one with
    `voyage
    = "passage"`, or with `voyage = { like = "passage", speed = "3 kn" }` to replace some keys."""
    tracker: dict[str, TrackerTable] = Field(default_factory=dict)
    """Vessels that targets seek or flee from, by name, `[tracker.patrol]`. A phase of `behaviour`
    refers to one with `tracker = "patrol"`.
    """
    scenario: list[ScenarioTable] = Field(default_factory=list)
    """Scenarios of one object, each with a weight; give scenarios, families, or a `[spill]`."""
    family: list[FamilyTable] = Field(default_factory=list)
    """Many scenarios in a few lines: all combinations of routes, speeds, times and so on."""
    spill: SpillTable | None = None
    """Many objects released by one event."""
    find: list[FindTable] = Field(default_factory=list)
    """Objects of a spill that were found."""
    patrol: list[PatrolTable] = Field(default_factory=list)
    """Patrols of stretches of coast."""
    patrol_unit: list[PatrolUnitTable] = Field(default_factory=list)
    """Teams that can patrol the shore next; `drift plan` of a spill assigns their stretches."""
    sortie: list[SortieTable] = Field(default_factory=list)
    """Searches that were done without finding the object."""
    contact: list[ContactTable] = Field(default_factory=list)
    """Sightings and detections that may be of the search object."""
    sensor: list[NamedSensorTable] = Field(default_factory=list)
    """Sensors whose POD depends on the place: passive sonars and POD tables. Watches, looks,
    contacts and units refer to a sensor by name.
    """
    drifter: list[DrifterTable] = Field(default_factory=list)
    """Drifting buoys on scene: their tracks correct the errors of the current near them."""
    report: list[ReportTable] = Field(default_factory=list)
    """Winds and currents reported on scene: they correct those of the case near them."""
    look: list[LookTable] = Field(default_factory=list)
    """An observation of a field at one time."""
    presence: list[PresenceTable] = Field(default_factory=list)
    """An observation of a field over an interval."""
    barrier: list[BarrierTable] = Field(default_factory=list)
    """A manned line that reports targets crossing it."""
    line: list[LineTable] = Field(default_factory=list)
    """A line whose first crossing is reported."""
    unit: list[UnitTable] = Field(default_factory=list)
    """Units available for the next search; `drift plan` assigns their search areas."""
    tow: list[TowTable] = Field(default_factory=list)
    """Ships that tow arrays; `drift plan` places the ships."""
    plan: PlanTable = PlanTable()
    """Time and objective of the next search."""
    resampling: ResamplingTable = ResamplingTable()
    """Resampling of particles after searches."""
    expect: Expect = Expect()
    """Ranges in which the case expects its results at the end:

    `drift run` prints whether it meets these; if not, its exit status is 1.
    """

    @model_validator(mode="before")
    @classmethod
    def with_shared(cls, data: Any) -> Any:
        """Expand families to scenarios, and insert shared voyages and trackers where named."""
        return insert_shared_tables(expand_families(data))

    @field_validator("seed")
    @classmethod
    def fits(cls, value: int) -> int:
        """Reject a seed that does not fit into the generator's 64-bit key."""
        if not 0 <= value < 2**63:
            raise ValueError(f"{value} must be 0 to 2^63 - 1")
        return value

    @field_validator("start")
    @classmethod
    def absolute(cls, value: units.Instant) -> units.Instant:
        """Reject a relative start."""
        if not isinstance(value, np.datetime64):
            raise ValueError('cannot be relative; write it like "211830ZNOV26"')
        return value

    @model_validator(mode="after")
    def whole(self) -> "CaseTable":
        """Reject a case without scenarios or spill, with both, and times against its direction."""
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
                "particles: a spill has spill.worlds x spill.per_world particles; set these two instead"
            )
        if self.spill is not None and (given := self._of_a_search()):
            wrong.append(
                f"{given} belongs to a search with [[scenario]] tables; a [spill] has [[find]] and [[patrol]]"
            )
        return wrong

    def _families(self) -> list[str]:
        """Return messages about families whose names are not unique among families and
        scenarios."""
        names = Counter([table.name for table in self.family])
        scenario_names = {table.name for table in self.scenario} if names else set()
        wrong = [
            f'family "{name}": two families have this name; give each its own'
            for name in names
            if names[name] > 1
        ]
        return wrong + [
            f'family "{name}": a scenario has this name too; give each its own'
            for name in names
            if name in scenario_names
        ]

    def _backward(self) -> list[str]:
        given = self._of_a_search() if self.direction == "backward" and self.spill is None else ""
        return (
            [f"{given} belongs to a forward run; leave it out, or remove direction"]
            if given
            else []
        )

    def _of_a_search(self) -> str:
        """Return the first table that belongs to a search; "" if there is none."""
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
        """Return the start of the run."""
        assert isinstance(self.start, np.datetime64)  # absolute
        return self.start

    def finish(self) -> np.datetime64:
        """Return the end of the run."""
        if self.end is not None:
            return units.resolve(self.end, self.begin())
        span = np.timedelta64(round(self.duration or 0.0), "s")
        return self.begin() - span if self.direction == "backward" else self.begin() + span
