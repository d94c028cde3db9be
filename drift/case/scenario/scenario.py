"""Scenarios: what may have happened, each with its weight, its object and where and when it went
adrift.

Holds the records that the engine takes (SI, radians, UTC) and, in the same order, the tables of the
case file that they are made from. Three kinds of prior: around a reported position, inside an area,
along a trackline.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.forcing import sources
from drift.case.scenario import survival
from drift.case.scenario.itinerary import DistressTable as DistressLaw
from drift.case.scenario.itinerary import PhaseTable, VesselTable
from drift.case.scenario.objects import ObjectTable, SearchObject
from drift.case.sonar.sonar import SourceLevel
from drift.case.values import fields, units
from drift.case.values.mistakes import Mistakes
from drift.case.values.places import AreaTable, PositionTable
from drift.engine.motion import own_motion
from drift.engine.motion.leeway import WATER, Drifter, Line
from drift.engine.motion.own_motion import OwnMotion
from drift.engine.motion.scenario import JIBE_RATE, ReleasePrior, Survival, TracklinePrior
from drift.engine.motion.steering.itinerary import Itinerary
from geo import notation, sphere
from geo.files import fence

PYTHON = ".py"  # what the name of a file with a drift model ends with


class TriangularTable(fields.Table):
    """Distress most likely at one share of the voyage, never before its start or after its end."""

    mode: fields.Share
    """Share of the voyage at which distress is likeliest."""


class DistressTable(fields.Table):
    """When on the voyage: uniform (both absent), triangular, or between two times."""

    triangular: TriangularTable | None = None
    """Likeliest at one share of the voyage."""
    between: Annotated[list[fields.Time], Field(min_length=2, max_length=2)] | None = None
    """Earliest and latest time."""

    @model_validator(mode="after")
    def one_kind(self) -> "DistressTable":
        """Refuse two laws at once."""
        if self.triangular and self.between:
            raise ValueError("give triangular or between, not both")
        return self


def _distress(value: Any) -> Any:
    if isinstance(value, str):
        if value != "uniform":
            raise ValueError(
                f'"{value}" is not allowed; write "uniform", {{ triangular = {{ mode = 0.6 }} }} or '
                "{ between = [..] }"
            )
        return {}
    return value


class TracklineTable(fields.Table):
    """A voyage: waypoints, departure, speed, and when on it the distress may have come."""

    waypoints: Annotated[list[fields.Position], Field(min_length=2)]
    """The voyage, two positions or more."""
    departure: fields.Time = np.timedelta64(0, "s")
    """When it begins."""
    speed: fields.ShipSpeed
    """Over the ground."""
    cross_track: fields.Length
    """Standard deviation to each side of the way."""
    distress: Annotated[DistressTable, BeforeValidator(_distress)] = DistressTable()
    """When on the voyage: `"uniform"`, triangular, or between two times."""

    def prior(self, start: np.datetime64) -> TracklinePrior:
        """Return the prior for a case that starts at `start`."""
        lon, lat = np.radians(np.array(self.waypoints)).T
        length = float(sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]).sum())
        if length < 1:
            raise ValueError("waypoints: the voyage has no length")
        voyage = length / self.speed
        if voyage > units.CENTURY:
            raise ValueError(
                f"trackline: at {self.speed:g} m/s the voyage takes more than a century; check speed"
            )
        departure = units.resolve(self.departure, start)
        low, high, mode = 0.0, 1.0, None
        if self.distress.triangular:
            mode = self.distress.triangular.mode
        elif self.distress.between:
            low, high = (_share(time, departure, voyage, start) for time in self.distress.between)
            if high < low:
                raise ValueError("distress.between must go from the earlier to the later time")

        def moment(share: float) -> np.datetime64:
            return departure + np.timedelta64(round(share * voyage), "s")

        return TracklinePrior(
            *(
                tuple(lon.tolist()),
                tuple(lat.tolist()),
                self.cross_track,
                departure,
                moment(1.0),
                self.speed,
            ),
            *(low, high, mode, moment(low), moment(high)),
        )


def _share(
    time: units.Instant, departure: np.datetime64, voyage: float, start: np.datetime64
) -> float:
    when = units.resolve(time, start)
    share = float((when - departure) / np.timedelta64(1, "s")) / voyage
    if not -0.5 / voyage <= share <= 1 + 0.5 / voyage:  # half a second: times are whole seconds
        arrival = departure + np.timedelta64(round(voyage), "s")
        raise ValueError(
            f"distress.between {notation.group(when)} is not on the voyage, "
            f"which lasts from {notation.group(departure)} to {notation.group(arrival)}"
        )
    return min(max(share, 0.0), 1.0)


class SurvivalTable(fields.Table):
    """How long someone stays alive after going adrift: lognormal, by a median and a spread.

    The spread is the factor of one standard deviation.
    The median is given, or follows from the water's temperature (drift.case.scenario.survival).
    """

    median: fields.Duration | None = None
    """Time by which half are no longer alive."""
    spread: Annotated[float, Field(gt=1, le=20)] | None = None
    """Factor of one standard deviation; 1.5 with `median`, 2 with `water`."""
    water: Annotated[float, BeforeValidator(survival.celsius)] | None = None
    """Temperature of the water, from which the median follows."""
    clothing: str | None = None
    """With `water`: `"light"`, the only one that a formula is known for."""

    @model_validator(mode="after")
    def one_way(self) -> "SurvivalTable":
        """Refuse none or two ways of giving the median, and clothing that no formula is known for."""
        if fields.one_of(self, ("median", "water")) == "median":
            if self.clothing is not None:
                raise ValueError(
                    "clothing belongs to water; a median is of people as they are clothed"
                )
        elif self.clothing not in survival.CLOTHING:
            given = "is missing" if self.clothing is None else f'"{self.clothing}" is not known'
            raise ValueError(f'clothing {given}; with water it must be "light": {survival.OTHERS}')
        return self

    def survival(self) -> Survival:
        """Return the record."""
        if self.median is not None:
            return Survival(self.median, self.spread or 1.5)
        assert self.water is not None
        spread = self.spread or survival.SPREAD
        return Survival(
            survival.immersed(self.water),
            spread,
            f"{survival.SOURCE}, light clothing, {self.water:.1f} degC",
        )


def _motion(value: object) -> object:
    if not isinstance(value, str) or (value not in PARAMETERS and not value.endswith(PYTHON)):
        names = ", ".join(f'"{name}"' for name in PARAMETERS)
        raise ValueError(
            f'no model of motion {value!r}; there is: {names}, and a Python file such as "iceberg.py"'
        )
    return value


class ParameterTable(fields.Table):
    """A parameter of a drift model of your own: normal between particles, each of which keeps its
    own.
    """

    mean: float = Field(allow_inf_nan=False)
    """Its mean, in the unit that the file takes; a bare number says the mean alone."""
    std: float = Field(default=0.0, ge=0, allow_inf_nan=False)
    """Its standard deviation between particles."""


def _parameter(value: object) -> object:
    return (
        {"mean": value} if isinstance(value, int | float) and not isinstance(value, bool) else value
    )


class ScenarioTable(fields.Table):
    """A [[scenario]] table as written."""

    name: fields.Label
    """Name of this scenario on maps and in tables."""
    weight: fields.Weight = 1.0
    """How likely it is, beside the others; they need not add up to 1."""
    object: Annotated[
        ObjectTable | None,
        BeforeValidator(lambda value: {"name": value} if isinstance(value, str) else value),
    ] = None
    """What drifts: a leeway class (`drift objects`), or a table of its own."""
    motion: Annotated[str, BeforeValidator(_motion)] = "drift"
    """How what is adrift moves:

    `drift`, by the leeway of its object, or a Python file with a velocity of your own
    (`docs/howto/model.md` shows one).
    """
    parameters: dict[str, Annotated[ParameterTable, BeforeValidator(_parameter)]] = Field(
        default_factory=dict
    )
    """Of a Python file in `motion`: its parameters by name."""
    jibe: fields.Rate | None = None
    """How often its drift changes sides, a bare number per hour; 0.04 of classes that do."""
    currents: list[str] | None = None
    """Names of the current's sources that hold in this scenario; all without it."""
    winds: list[str] | None = None
    """Names of the wind's sources."""
    stokes: list[str] | None = None
    """Names of the Stokes drift's sources."""
    position: PositionTable | None = None
    """Where it went adrift: a reported position."""
    area: AreaTable | None = None
    """Or anywhere in an area."""
    trackline: TracklineTable | None = None
    """Or somewhere on a voyage."""
    search_object: SearchObject | None = None
    source_level: SourceLevel | None = None
    """How loud it is to a passive sonar, `"140 dB"` re 1 uPa at 1 m, or rows of speed and level; a
    sensor may say it instead.
    """
    survival: SurvivalTable | None = None
    phase: list[PhaseTable] = Field(default_factory=list)
    """How it steers before it drifts, one phase after another."""
    vessel: VesselTable | None = None
    """What it is while under way."""
    distress: DistressLaw | None = None
    """When it goes adrift; without this it stays under way."""
    overdue: fields.Time | None = None
    """By when its arrival would be known: from then on what is in port has no weight."""
    arrival_radius: Annotated[fields.Length | None, Field(gt=0)] = None
    """How near to its last way point what has arrived is in port, 10 nmi without it; what is
    farther off goes on as what it is.
    """

    @model_validator(mode="after")
    def whole(self) -> "ScenarioTable":
        """Refuse a scenario with no place to begin at, or two; what drifts without its object; what
        steers half.
        """
        fields.refuse(self, [*self._place(), *self._states()])
        return self

    def _place(self) -> Iterator[str]:
        given = [
            name for name in ("position", "area", "trackline") if getattr(self, name) is not None
        ]
        if self.phase and self.phase[0].begins:
            if given:
                yield (
                    f"{given[0]}: its first phase says where it begins; leave {given[0]} out, or begin with a course, "
                    "a behaviour or with loitering"
                )
        elif self.phase and given != ["position"] and given != ["area"]:
            yield "a first phase of a course, a behaviour or of loitering begins at a position or in an area; give one of them"
        elif len(given) != 1:
            found = " and ".join(given) if given else "none"
            yield f"exactly one of position, area, trackline must be given; found {found}"

    def _states(self) -> Iterator[str]:
        adrift = not self.phase or self.distress is not None
        own = self.motion.endswith(PYTHON)
        if adrift and self.object is None and not own:
            yield "object is missing: what drifts? See: drift objects"
        if own and self.object is not None:
            yield f'object: motion = "{self.motion}" says how it drifts; leave object out, and say search_object for sweep widths'
        if own and self.jibe is not None:
            yield f'jibe belongs to leeway, and motion = "{self.motion}" has none; leave jibe out'
        if self.parameters and not own:
            yield 'parameters belong to a drift model of your own; add motion = "FILE.py", or leave them out'
        for number, phase in enumerate(self.phase[:-1], 1):
            if phase.endless:
                yield (
                    f"phase {number} has no end, so that phase {number + 1} never comes; give {phase.kind}.until or "
                    f"{phase.kind}.for, or leave the phases after it out"
                )
        if (
            self.vessel
            and self.vessel.currents == "felt"
            and any(phase.kind == "bridge" for phase in self.phase)
        ):
            yield (
                'vessel.currents is "felt": a bridge says where the target is, whatever the current; leave currents '
                "out, or give a voyage, a track or a course"
            )
        for name in () if self.phase else ("vessel", "distress", "overdue"):
            if getattr(self, name) is not None:
                yield f"{name} belongs to what is under way first; add [[scenario.phase]]"
        if self.arrival_radius is not None and self.overdue is None:
            yield "arrival_radius belongs to overdue, the time by which one would know that it is in port; add overdue"
        if not adrift:
            if own:
                yield f'motion = "{self.motion}" belongs to what goes adrift; add distress, or leave motion out'
            for name in ("survival", "jibe", "object"):
                if getattr(self, name) is not None:
                    yield f"{name} belongs to what goes adrift; add distress, or leave {name} out"
            if self.search_object is not None:
                yield (
                    f'search_object "{self.search_object}" is looked for adrift, and this stays under way; write vessel = '
                    f'{{ search_object = "{self.search_object}" }}, or add distress'
                )

    def prior(self, start: np.datetime64) -> ReleasePrior | None:
        """Return where and when it begins; None: at the first way point of its first phase."""
        table = self.position or self.area or self.trackline
        return table.prior(start) if table is not None else None

    def itinerary(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Itinerary | None:
        """Return how it steers; None: it is adrift from the first."""
        if not self.phase:
            return None
        phases, wrong = [], Mistakes()
        for number, table in enumerate(self.phase, 1):
            with wrong.gathered(f'scenario "{self.name}".phase {number}.{table.kind}'):
                phases.append(table.phase(start, end, folder))
        distress = None
        if self.distress is not None and len(phases) == len(self.phase):
            with wrong.gathered(f'scenario "{self.name}".distress'):
                distress = self.distress.distress(tuple(phases), start)
        wrong.refuse()
        vessel = self.vessel or VesselTable()
        return Itinerary(
            tuple(phases),
            distress,
            None if self.overdue is None else units.resolve(self.overdue, start),
            vessel.land,
            vessel.search_object,
            vessel.currents,
            **({} if self.arrival_radius is None else {"arrival_radius": self.arrival_radius}),
        )

    def own_motion(self, folder: Path) -> OwnMotion | None:
        """Return the drift model of the user's own; None: it drifts by leeway."""
        if not self.motion.endswith(PYTHON):
            return None
        fence.check_program(self.motion)
        path = Path(sources.one_file(self.motion, folder, "motion"))
        return own_motion.read(
            path, {name: (one.mean, one.std) for name, one in self.parameters.items()}
        )

    def drifter(self, own: OwnMotion | None) -> Drifter:
        """Return what drifts; own: its drift model, where it has one of its own."""
        if own is not None:
            still = Line()
            return Drifter(
                own.path.stem,
                f"drifts as {own.path.name} says",
                still,
                still,
                still,
                blown="wind" in own.uses,
            )
        return self.object.drifter() if self.object else WATER

    def jibe_rate(self, drifter: Drifter) -> float:
        """Return the jibing rate [1/s]; by default as published for objects with two sides."""
        return self.jibe if self.jibe is not None else (JIBE_RATE if drifter.jibes else 0.0)


# The models of motion that a scenario can name, and how each makes its own parameters of the
# scenario's keys.
PARAMETERS: dict[str, Callable[[ScenarioTable], Any]] = {"drift": lambda table: None}
