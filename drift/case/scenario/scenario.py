"""The [[scenario]] table: a weight, an object, and the prior of its position and time of release.

The tables build the engine's records in SI units, radians and UTC. There are three priors of the
position: around a reported position, inside an area, along a trackline.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.forcing import sources
from drift.case.scenario.change import ChangeTable, build_changes
from drift.case.scenario.hazard import HazardTable
from drift.case.scenario.itinerary import DistressTable as DistressLaw
from drift.case.scenario.itinerary import PhaseTable, VesselTable
from drift.case.scenario.objects import ObjectTable, SearchObject
from drift.case.scenario.survival import SurvivalTable
from drift.case.sonar.sonar import SourceLevel
from drift.case.values import fields, units
from drift.case.values.mistakes import Mistakes
from drift.case.values.places import AreaTable, PositionTable
from drift.engine.motion.models import own_motion
from drift.engine.motion.models.own_motion import OwnMotion
from drift.engine.motion.objects.leeway import WATER, Drifter, Line
from drift.engine.motion.scenario import JIBE_RATE, Change, ReleasePrior, TracklinePrior
from drift.engine.motion.steering.itinerary import Itinerary
from geo import notation, sphere
from geo.files import fence


class TriangularTable(fields.Table):
    """Triangular distribution of the distress over the voyage."""

    mode: fields.Share
    """Share of the voyage at which distress is most likely."""


class DistressTable(fields.Table):
    """Time of distress on a voyage: uniform (no key), triangular, or between two times."""

    triangular: TriangularTable | None = None
    """Triangular distribution over the voyage."""
    between: Annotated[list[fields.Time], Field(min_length=2, max_length=2)] | None = None
    """Earliest and latest time."""

    @model_validator(mode="after")
    def one_kind(self) -> "DistressTable":
        """Reject two distributions at once."""
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
    """A voyage: waypoints, departure, speed, and the time of distress on it."""

    waypoints: Annotated[list[fields.Position], Field(min_length=2)]
    """Way points of the voyage, two positions or more."""
    departure: fields.Time = np.timedelta64(0, "s")
    """Time of departure."""
    speed: fields.ShipSpeed
    """Speed over the ground."""
    cross_track: fields.Length
    """Standard deviation of the distance from the track."""
    distress: Annotated[DistressTable, BeforeValidator(_distress)] = DistressTable()
    """Time of distress on the voyage: `"uniform"`, triangular, or between two times."""

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
            f"distress.between {notation.format_dtg(when)} is not on the voyage, "
            f"which lasts from {notation.format_dtg(departure)} to {notation.format_dtg(arrival)}"
        )
    return min(max(share, 0.0), 1.0)


def _motion(value: object) -> object:
    if not isinstance(value, str) or not (value in PARAMETERS or own_motion.is_own(value)):
        names = ", ".join(f'"{name}"' for name in (*PARAMETERS, *own_motion.shipped()))
        raise ValueError(
            f'no model of motion {value!r}; allowed are {names}, or a Python file such as "iceberg.py"'
        )
    return value


class ParameterTable(fields.Table):
    """A parameter of a drift model of your own: normally distributed, constant for each
    particle."""

    mean: float = Field(allow_inf_nan=False)
    """Mean, in the unit that the Python file expects; a bare number in place of the table is the
    mean."""
    std: float = Field(default=0.0, ge=0, allow_inf_nan=False)
    """Standard deviation between particles."""


def _parameter(value: object) -> object:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {"mean": value}
    if not isinstance(value, dict | ParameterTable):
        raise ValueError(
            f"{value!r} must be a number without a unit, as the Python file expects it, or {{ mean = .., std = .. }}"
        )
    return value


class ScenarioTable(fields.Table):
    """A [[scenario]] table as written."""

    name: fields.Label
    """Name of this scenario on maps and in tables."""
    weight: fields.Weight = 1.0
    """Prior probability relative to the other scenarios; weights need not add up to 1."""
    object: Annotated[
        ObjectTable | None,
        BeforeValidator(lambda value: {"name": value} if isinstance(value, str) else value),
    ] = None
    """The drifting object: a leeway class (`drift objects`), or a table."""
    motion: Annotated[str, BeforeValidator(_motion)] = "drift"
    """Drift model of the object:

    `drift`, the leeway of its object, or a Python file with a velocity of your own
    (`docs/howto/model.md` shows one).
    """
    parameters: dict[str, Annotated[ParameterTable, BeforeValidator(_parameter)]] = Field(
        default_factory=dict
    )
    """Parameters of a Python file in `motion`, by name."""
    jibe: fields.Rate | None = None
    """Jibing rate, a bare number per hour; by default 0.04 for classes that jibe."""
    currents: list[str] | None = None
    """Names of the current sources of this scenario; by default all."""
    winds: list[str] | None = None
    """Names of the wind sources of this scenario; by default all."""
    stokes: list[str] | None = None
    """Names of the Stokes drift sources of this scenario; by default all."""
    position: PositionTable | None = None
    """Position where it went adrift: a reported position with its error."""
    area: AreaTable | None = None
    """In place of `position`: anywhere in an area."""
    trackline: TracklineTable | None = None
    """In place of `position`: somewhere on a voyage."""
    hazard: HazardTable | None = None
    """Where and when distress on the trackline is likelier: by wind, or by a file."""
    search_object: SearchObject | None = None
    source_level: SourceLevel | None = None
    """Source level for passive sonar, `"140 dB"` re 1 uPa at 1 m, or rows of speed and level; a
    sensor may give it instead.
    """
    survival: SurvivalTable | None = None
    change: list[ChangeTable] = Field(default_factory=list)
    """What becomes of the object while it is adrift: it capsizes, is swamped, sinks."""
    phase: list[PhaseTable] = Field(default_factory=list)
    """How it steers before it drifts: phases in order."""
    vessel: VesselTable | None = None
    """Properties while it is under way."""
    distress: DistressLaw | None = None
    """When it goes adrift; without this it stays under way."""
    overdue: fields.Time | None = None
    """Time by which its arrival would be known; from then on, particles in port have weight 0."""
    arrival_radius: Annotated[fields.Length | None, Field(gt=0)] = None
    """A target that has arrived counts as in port within this distance of its last way point, by
    default 10 nmi; farther away its particles keep their weight.
    """

    @model_validator(mode="after")
    def whole(self) -> "ScenarioTable":
        """Reject a scenario without exactly one start, an object, or all keys of its steering."""
        fields.refuse(self, [*self._place(), *self._states()])
        return self

    def _place(self) -> Iterator[str]:
        given = [
            name for name in ("position", "area", "trackline") if getattr(self, name) is not None
        ]
        if self.phase and self.phase[0].begins:
            if given:
                yield (
                    f"{given[0]}: its first phase defines the starting position; leave {given[0]} out, or begin with a course, "
                    "a behaviour or loitering"
                    + "; a hazard needs the trackline: leave the phases out"
                    * (given[0] == "trackline" and self.hazard is not None)
                )
        elif self.phase and given != ["position"] and given != ["area"]:
            yield "a first phase of a course, a behaviour or of loitering begins at a position or in an area; give one of them"
        elif len(given) != 1:
            found = " and ".join(given) if given else "none"
            yield f"exactly one of position, area, trackline must be given; found {found}"

    def _states(self) -> Iterator[str]:
        adrift = not self.phase or self.distress is not None
        own = own_motion.is_own(self.motion)
        if adrift and self.object is None and not own:
            yield "object is missing: give the object that drifts; see: drift objects"
        if own and self.object is not None:
            yield f'object: motion = "{self.motion}" determines its drift; leave object out, and give search_object for sweep widths'
        if own and self.jibe is not None:
            yield f'jibe belongs to leeway, and motion = "{self.motion}" has none; leave jibe out'
        if own and self.change:
            yield f'change replaces leeway, and motion = "{self.motion}" has none; leave change out'
        if self.parameters and not own:
            yield 'parameters belong to a drift model of your own; add motion = "FILE.py", or leave them out'
        for number, phase in enumerate(self.phase[:-1], 1):
            if phase.endless:
                yield (
                    f"phase {number} has no end, so phase {number + 1} never begins; give {phase.kind}.until or "
                    f"{phase.kind}.for, or leave the phases after it out"
                )
        if (
            self.vessel
            and self.vessel.currents == "felt"
            and any(phase.kind == "bridge" for phase in self.phase)
        ):
            yield (
                'vessel.currents is "felt": the path of a bridge does not depend on the current; leave currents '
                "out, or give a voyage, a track or a course"
            )
        for name in () if self.phase else ("vessel", "distress", "overdue"):
            if getattr(self, name) is not None:
                yield (
                    "distress belongs to a target under way; write it within the trackline, trackline = { .., distress = .. }"
                    if name == "distress" and self.trackline is not None
                    else f"{name} belongs to a target under way; add [[scenario.phase]]"
                )
        if self.hazard is not None and self.trackline is None:
            yield (
                "hazard belongs to a trackline, and targets under way have none yet; write the voyage as trackline, without "
                "[[scenario.phase]], distress and overdue, or leave hazard out"
                if self.phase
                else "hazard belongs to a trackline; add trackline, or leave hazard out"
            )
        if self.arrival_radius is not None and self.overdue is None:
            yield "arrival_radius belongs to overdue, the time by which its arrival would be known; add overdue"
        if not adrift:
            if own:
                yield f'motion = "{self.motion}" belongs to an object adrift; add distress, or leave motion out'
            for name in ("survival", "jibe", "object", "change"):
                if getattr(self, name):
                    yield f"{name} belongs to an object adrift; add distress, or leave {name} out"
            if self.search_object is not None:
                yield (
                    f'search_object "{self.search_object}" applies to an object adrift, and this target stays under way; write vessel = '
                    f'{{ search_object = "{self.search_object}" }}, or add distress'
                )

    def prior(self, start: np.datetime64) -> ReleasePrior | None:
        """Return the prior of position and release; None: its first way point is the start."""
        table = self.position or self.area or self.trackline
        return table.prior(start) if table is not None else None

    def itinerary(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Itinerary | None:
        """Return the itinerary of a target under way; None if the object is adrift from the start.

        Args:
            start: start of the case.
            end: end of the case.
            folder: folder from which relative paths start.

        Raises:
            UserError: phases or distress are invalid, one line for each mistake.
        """
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
        """Return the drift model of the scenario, if a file defines it; None: leeway or another."""
        if not own_motion.is_own(self.motion):
            return None
        path = own_motion.shipped().get(self.motion)
        if path is None:
            fence.check_program(self.motion)
            path = Path(sources.one_file(self.motion, folder, "motion"))
        return own_motion.read(
            path, {name: (one.mean, one.std) for name, one in self.parameters.items()}
        )

    def drifter(self, own: OwnMotion | None) -> Drifter:
        """Return the record of the drifting object; `own` is the user's drift model, if any."""
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

    def changes(self, start: np.datetime64) -> tuple[Change, ...]:
        """Return the changes of state of the object, for a case that starts at `start`.

        Raises:
            UserError: changes do not fit together, one line for each mistake.
        """
        return build_changes(
            self.change, start, f'scenario "{self.name}"', lives=self.survival is not None
        )

    def jibe_rate(self, *drifters: Drifter) -> float:
        """Return the jibing rate [1/s]; by default as published if any object has two sides."""
        if self.jibe is not None:
            return self.jibe
        return JIBE_RATE if any(drifter.jibes for drifter in drifters) else 0.0


# The models of motion by name, each with a function that returns its parameters for a scenario.
PARAMETERS: dict[str, Callable[[ScenarioTable], Any]] = {"drift": lambda table: None}
