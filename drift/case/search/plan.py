"""The [[unit]], [plan] and [resampling] tables: available units, the plan's objective,
resampling."""

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, field_validator, model_validator

from drift.case.context import Run, build_each
from drift.case.search.sensor import VISUAL, Kind, SensorTable
from drift.case.sonar.processing import ProcessingTable
from drift.case.values import fields, units
from drift.case.values.mistakes import Mistakes
from drift.evidence.filter.records import Contact, PlanSpec, Resampling, Sensors, Sortie, Unit
from drift.tracking.tracker.records import METHODS
from geo import notation
from geo.errors import UserError

LEAST, MOST = 1000, 1_000_000  # limits of the number of particles of a plan
MOST_ROUNDS = 20
BULK = 0.1  # share of surviving particles below which a contact repopulates
MOST_ENDURANCE = 30 * 86_400.0  # [s]
MOST_TURNAROUND = 30 * 86_400.0  # [s]


def _turnaround(value: object) -> float:
    number = units.quantity(value, "s", "duration", "2 h")
    if not 0 <= number <= MOST_TURNAROUND:
        raise ValueError(f"turnaround {value!r} must be 0 to {MOST_TURNAROUND / 86_400:.0f} days")
    return number


def _endurance(value: object) -> float:
    number = units.quantity(value, "s", "duration", "4 h")
    if not 0 < number <= MOST_ENDURANCE:
        raise ValueError(
            f"endurance {value!r} must be above 0 and at most {MOST_ENDURANCE / 86_400:.0f} days on scene"
        )
    return number


class UnitTable(SensorTable):
    """A [[unit]] table as written."""

    name: fields.Label
    kind: Kind = ""
    base: fields.Position
    return_to: fields.Position | None = None
    ready: fields.Time | None = None
    search_speed: fields.ShipSpeed
    transit_speed: fields.ShipSpeed | None = None
    endurance: Annotated[float, BeforeValidator(_endurance)]
    daylight: bool | None = None
    turnaround: Annotated[float, BeforeValidator(_turnaround)] = 7200.0
    least_spacing: fields.Length = 0.0
    clear_of_land: fields.Length | None = None
    draught: fields.Length | None = None

    def unit(self, name: str, run: Run, plan: PlanSpec) -> Unit:
        """Return the record of the unit; raise ValueError if it does not fit the plan."""
        ready = plan.begin if self.ready is None else units.resolve(self.ready, run.start)
        if self.ready is not None and ready >= plan.until:
            raise ValueError(
                f"ready at {notation.format_dtg(ready)}, not before the plan's end, {notation.format_dtg(plan.until)}; change "
                "ready, or until in [plan], or run for longer"
            )
        for key in ("clear_of_land", "draught"):
            if getattr(self, key) is not None and self.kind != "Boat":
                raise ValueError(
                    f'{key} applies only to boats; give kind = "Boat", or leave {key} out'
                )
        visual = self.sensor == VISUAL
        return Unit(
            name=name,
            kind=self.kind,
            base=self.base,
            return_to=self.base if self.return_to is None else self.return_to,
            ready=ready,
            search_speed=self.search_speed,
            transit_speed=self.search_speed if self.transit_speed is None else self.transit_speed,
            endurance=self.endurance,
            law=self.law,
            sweep_width=self.widths(self.kind, self.search_speed, run.scenarios),
            width_under_way=self.widths_under_way(self.kind, self.search_speed, run.scenarios),
            shape=self.shape(),
            group=self.group(self.kind),
            altitude=self.height(),
            daylight=visual if self.daylight is None else self.daylight,
            turnaround=self.turnaround,
            least_spacing=self.least_spacing,
            clear_of_land=self.clear_of_land or 0.0,
            draught=self.draught or 0.0,
        )


class PlanTable(fields.Table):
    """The [plan] table as written."""

    begin: fields.Time | None = None
    until: fields.Time | None = None
    objective: Literal["pos", "alive"] = "pos"
    separation: fields.Length = 0.0
    rounds: Annotated[fields.Count, Field(ge=1, le=MOST_ROUNDS)] = 1
    ashore: bool = False
    particles: fields.Count = 40_000
    processing: ProcessingTable | None = None

    @field_validator("particles")
    @classmethod
    def enough(cls, value: int) -> int:
        """Reject too few or too many particles for a plan."""
        if not LEAST <= value <= MOST:
            raise ValueError(f"{value:,} must be {LEAST:,} to {MOST:,} particles")
        return value

    def spec(
        self,
        run: Run,
        sorties: Sequence[Sortie],
        contacts: Sequence[Contact],
        sensors: Sensors,
        asked: bool,
    ) -> PlanSpec:
        """Return the record of the plan.

        Args:
            run: the run and its scenarios.
            sorties: sorties flown so far.
            contacts: contacts so far.
            sensors: observations of sensors so far.
            asked: whether there are units to plan; the plan must then begin before its end.

        Raises:
            UserError: times or objective do not fit the run, one line for each mistake.
        """
        overdue = [scenario.itinerary.overdue for scenario in run.scenarios if scenario.itinerary]
        past = [
            run.start,
            *(time for time in overdue if time is not None),
            *(sortie.end for sortie in sorties),
            *(contact.time for contact in contacts),
            *sensors.times,
        ]
        begin = max(past) if self.begin is None else units.resolve(self.begin, run.start)
        until = run.end if self.until is None else units.resolve(self.until, run.start)
        wrong = Mistakes()
        for key, time in (("begin", begin), ("until", until)):
            if getattr(self, key) is not None:
                with wrong.gathered(f"plan.{key}"):
                    run.check(time, time)
        if self.begin is None:
            # sorties may last until the end of the run if there is nothing to plan
            begin = min(begin, until)
        elif asked and begin >= until:
            wrong.lines.append(
                f"plan: its begin, {notation.format_dtg(begin)}, is not before its end, {notation.format_dtg(until)}; give begin "
                "and until in [plan], or run for longer"
            )
        if self.objective == "alive" and all(
            scenario.survival is None for scenario in run.scenarios
        ):
            wrong.lines.append(
                'plan.objective: "alive" needs survival in the scenarios, like survival = { median = "18 h", spread = '
                "1.6 }"
            )
        if self.objective == "alive" and any(
            one.survival for scenario in run.scenarios for one in scenario.changes
        ):
            wrong.lines.append(
                'plan.objective: "alive" counts survival from the release, and a change of state has a survival of its own; '
                'write objective = "pos"'
            )
        wrong.refuse()
        return PlanSpec(
            begin, until, self.objective, self.separation, self.rounds, self.particles, self.ashore
        )


class ResamplingTable(fields.Table):
    """The [resampling] table as written."""

    method: Literal["systematic", "kahn", "duplicates", "position", "course", "combined"] = (
        "systematic"
    )
    below: fields.Share = 0.0
    across_scenarios: bool = False
    bulk: fields.Share | None = None
    fastest: fields.ShipSpeed | None = None

    @field_validator("below")
    @classmethod
    def proper(cls, value: float) -> float:
        """Reject a threshold of 1 or more, with which every update would resample."""
        if value >= 1:
            raise ValueError(
                f"{value:g} must be below 1: the share of effective particles under which it resamples"
            )
        return value

    def resampling(self) -> Resampling:
        """Return the record of the resampling rule."""
        bulk = BULK if self.bulk is None else self.bulk
        return Resampling(
            self.method,
            self.below,
            self.across_scenarios,
            bulk if self.method in METHODS else 0.0,
            self.fastest or 0.0,
        )

    @model_validator(mode="after")
    def filled(self) -> "ResamplingTable":
        """Reject missing keys of repopulation, and its keys with other methods."""
        wrong = []
        if self.method in METHODS:
            bulk = BULK if self.bulk is None else self.bulk
            if self.fastest is None:
                wrong.append(
                    f'method "{self.method}" needs fastest, like "32 kn": the highest speed of repopulated particles'
                )
            if not 0 < bulk <= self.below:
                wrong.append(
                    f'method "{self.method}" needs 0 < bulk <= below, and bulk is {bulk:g}, below {self.below:g}: fewer survivors than below '
                    "are duplicated, fewer than bulk repopulated at a contact; give below, like 0.75"
                )
        else:
            given = [key for key in ("bulk", "fastest") if getattr(self, key) is not None]
            if given:
                wrong.append(
                    f'{" and ".join(given)}: only for method "position", "course" or "combined"; leave it out'
                )
        fields.refuse(self, wrong)
        return self

    @model_validator(mode="after")
    def whole(self) -> "ResamplingTable":
        """Reject `across_scenarios` with a method that excludes it, and without resampling."""
        if self.across_scenarios and self.method != "systematic":
            why = {
                "kahn": "the number of particles of a scenario varies, and cannot be given to another",
            }.get(self.method, "the survivors of a scenario keep their slots")
            raise ValueError(
                f'across_scenarios = true needs method = "systematic": with "{self.method}" {why}'
            )
        if self.across_scenarios and self.below == 0:
            raise ValueError(
                "across_scenarios = true needs below, such as 0.5: with below = 0 nothing is resampled"
            )
        return self


def build_units(tables: list[UnitTable], run: Run, plan: PlanSpec) -> tuple[Unit, ...]:
    """Return the units; raise UserError with their mistakes."""

    def maker(table: UnitTable) -> Callable[[str, Run], Unit]:
        return lambda name, run: table.unit(name, run, plan)

    return tuple(
        build_each(
            [maker(table) for table in tables], [table.name for table in tables], "unit", run
        )
    )


def check_groups(sorties: Sequence[Sortie], fleet: Sequence[Unit]) -> None:
    """Reject a sweep group with different uncertainties: its members share one unknown factor."""
    first: dict[str, tuple[str, float]] = {}
    members: list[tuple[str, Sortie | Unit]] = [
        (f'sortie "{sortie.name}"', sortie) for sortie in sorties if not sortie.watches
    ]
    members += [(f'unit "{unit.name}"', unit) for unit in fleet]
    for place, member in members:
        name, shape = first.setdefault(member.group, (place, member.shape))
        if shape != member.shape:
            raise UserError(
                f"{place}: sweep_width_uncertainty is {_share(member.shape)}, but {_share(shape)} in {name} of the "
                f'same sweep_group "{member.group}", which has one unknown factor; give both the same uncertainty, or a '
                "sweep_group of its own"
            )


def _share(shape: float) -> str:
    return "0" if math.isinf(shape) else f"{100 / math.sqrt(shape):.3g} %"


def map_times(sorties: Sequence[Sortie], contacts: Sequence[Contact]) -> list[np.datetime64]:
    """Return the times that get a map: each contact, and start, middle and end of each sortie."""
    moments = [contact.time for contact in contacts]
    for sortie in sorties:
        half = (sortie.end - sortie.start) // 2
        moments += [sortie.start, sortie.start + half, sortie.end]
    return moments
