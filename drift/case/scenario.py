"""Scenarios: what may have happened, each with its weight, its object and where and when it went adrift.

Holds the records that the engine takes (SI, radians, UTC) and, in the same order, the tables of the case file that
they are made from. Three kinds of prior: around a reported position, inside an area, along a trackline.
"""

import math
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case import fields, survival, units
from drift.case.objects import ObjectTable
from drift.motion.leeway import Drifter
from drift.motion.scenario import (
    JIBE_RATE,
    AreaPrior,
    Displacement,
    PositionPrior,
    ReleasePrior,
    Survival,
    TracklinePrior,
)
from drift.search import sweep_width
from geo import notation, sphere
from geo.errors import UserError

LONGEST_EDGE = 90.0  # [deg] of longitude, of a polygon's edge
NARROWEST = 1e-5  # [deg] least area of a polygon over its outline, which is half its width: 1 m


class WindowTable(fields.Table):
    """When it went adrift: a time (default: the start), or unknown between time and until."""

    time: fields.Time = np.timedelta64(0, "s")
    until: fields.Time | None = None

    def window(self, start: np.datetime64) -> tuple[np.datetime64, np.datetime64]:
        """Return the first and the last time of release."""
        first = units.resolve(self.time, start)
        last = first if self.until is None else units.resolve(self.until, start)
        if last < first:
            raise ValueError(f"until {notation.group(last)} is before time {notation.group(first)}")
        return first, last


class EllipseTable(fields.Table):
    """An error ellipse: semi-axes, orientation of the major one, probability of being inside."""

    major: fields.Length
    minor: fields.Length
    orientation: fields.Direction
    probability: fields.Share = 0.5

    @model_validator(mode="after")
    def proper(self) -> "EllipseTable":
        """Refuse swapped axes and a probability that no ellipse has."""
        if self.minor > self.major:
            raise ValueError("minor is longer than major; orientation belongs to the major axis")
        if not 0 < self.probability < 1:
            raise ValueError(f"probability {self.probability:g} must lie between 0 and 1, like 0.5 or 0.95")
        return self


class DisplacementTable(fields.Table):
    """An unknown move before drifting: distance range and direction sector (toward, degrees true)."""

    distance: fields.LengthRange
    direction: fields.Sector = (0.0, 360.0)


class ErrorTable(fields.Table):
    """The error of a position: std, ellipse, or the radius that holds 50 %."""

    std: fields.LengthPair | None = None
    orientation: fields.Direction | None = None
    ellipse: EllipseTable | None = None
    error: fields.Length | None = None

    @model_validator(mode="after")
    def one_error(self) -> "ErrorTable":
        """Refuse none or two ways of giving the error, and an ellipse without its direction."""
        kind = fields.one_of(self, ("std", "ellipse", "error"))
        unequal = self.std is not None and self.std[0] != self.std[1]
        if unequal and self.orientation is None:
            raise ValueError("std has two values: give orientation too, of the first, in degrees true")
        if self.orientation is not None and kind != "std":
            raise ValueError("orientation belongs to std here; an ellipse has its own inside its table")
        return self

    def axes(self) -> tuple[float, float, float]:
        """Return standard deviations along and across the major axis [m] and its orientation [rad]."""
        if self.ellipse is not None:
            # A bivariate normal holds 1 - exp(-k^2/2) inside k standard deviations.
            scale = math.sqrt(-2 * math.log1p(-self.ellipse.probability))
            turn = math.radians(self.ellipse.orientation)
            return self.ellipse.major / scale, self.ellipse.minor / scale, turn
        if self.error is not None:
            std = self.error / math.sqrt(2 * math.log(2))
            return std, std, 0.0
        along, across = self.std or (0.0, 0.0)
        turn = math.radians(self.orientation or 0.0)
        return (along, across, turn) if along >= across else (across, along, turn + math.pi / 2)


class PositionTable(ErrorTable, WindowTable):
    """A position report with its error, and an unknown move before drifting."""

    at: fields.Position
    displacement: DisplacementTable | None = None

    def prior(self, start: np.datetime64) -> PositionPrior:
        """Return the prior for a case that starts at `start`."""
        moved = None
        if self.displacement is not None:
            first, second = self.displacement.direction
            moved = Displacement(self.displacement.distance, (math.radians(first), math.radians(second)))
        lon, lat = (math.radians(angle) for angle in self.at)
        return PositionPrior(lon, lat, *self.axes(), moved, *self.window(start))


class AreaTable(WindowTable):
    """An area: corners in order, without crossing."""

    polygon: list[fields.Position]

    @model_validator(mode="after")
    def simple(self) -> "AreaTable":
        """Refuse what encloses no area, or not one."""
        self.corners()
        return self

    def corners(self) -> list[tuple[float, float]]:
        """Return the corners [deg], longitude without jumps."""
        import shapely  # here, since an area is rare and the import takes 0.1 s

        points = [point for point, before in zip(self.polygon, [None, *self.polygon], strict=False) if point != before]
        points = points[:-1] if len(points) > 1 and points[0] == points[-1] else points
        if len(points) < 3:
            raise ValueError(f"polygon has {len(points)} corners; at least 3 are needed")
        lon, lat = np.array(points).T
        steps = sphere.wrap_degrees(np.diff(lon, append=lon[0]))
        if abs(steps.sum()) > 1:
            raise ValueError("polygon goes round a pole; split it into areas that don't")
        if np.abs(steps).max() > LONGEST_EDGE:
            (west, south), (east, north) = points[k := int(np.argmax(np.abs(steps)))], points[(k + 1) % len(points)]
            raise ValueError(
                f"polygon's edge from [{west:g}, {south:g}] to [{east:g}, {north:g}] is {abs(steps[k]):.0f} degrees of "
                f"longitude wide: which way round is not clear; put corners at most {LONGEST_EDGE:g} degrees apart"
            )
        unwrapped = lon[0] + np.concatenate([[0.0], np.cumsum(steps[:-1])])
        shape = shapely.Polygon(np.column_stack([unwrapped, lat]))
        if not shape.is_valid or shape.area == 0:
            raise ValueError(f"polygon {_fault(shapely.is_valid_reason(shape))}; give its corners in order")
        if shape.area < NARROWEST * shape.length:
            raise ValueError("polygon is narrower than 2 m, too narrow to lie in; give a position or a trackline")
        return list(zip(unwrapped.tolist(), lat.tolist(), strict=True))

    def prior(self, start: np.datetime64) -> AreaPrior:
        """Return the prior for a case that starts at `start`."""
        lon, lat = np.radians(np.array(self.corners())).T
        return AreaPrior(tuple(lon.tolist()), tuple(lat.tolist()), *self.window(start))


def _fault(reason: str) -> str:
    if reason.startswith("Self-intersection"):
        lon, lat = (float(part) for part in reason[reason.index("[") + 1 : -1].split())
        return f"crosses itself near [{sphere.wrap_degrees(lon):.3f}, {lat:.3f}] (lon, lat)"
    return "encloses no area" if reason == "Valid Geometry" else f"is not simple ({reason})"


class TriangularTable(fields.Table):
    """Distress most likely at one share of the voyage, never before its start or after its end."""

    mode: fields.Share


class DistressTable(fields.Table):
    """When on the voyage: uniform (both absent), triangular, or between two times."""

    triangular: TriangularTable | None = None
    between: Annotated[list[fields.Time], Field(min_length=2, max_length=2)] | None = None

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
    departure: fields.Time = np.timedelta64(0, "s")
    speed: fields.ShipSpeed
    cross_track: fields.Length
    distress: Annotated[DistressTable, BeforeValidator(_distress)] = DistressTable()

    def prior(self, start: np.datetime64) -> TracklinePrior:
        """Return the prior for a case that starts at `start`."""
        lon, lat = np.radians(np.array(self.waypoints)).T
        length = float(sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]).sum())
        if length < 1:
            raise ValueError("waypoints: the voyage has no length")
        voyage = length / self.speed
        if voyage > units.CENTURY:
            raise ValueError(f"trackline: at {self.speed:g} m/s the voyage takes more than a century; check speed")
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
            *(tuple(lon.tolist()), tuple(lat.tolist()), self.cross_track, departure, moment(1.0), self.speed),
            *(low, high, mode, moment(low), moment(high)),
        )


def _share(time: units.Instant, departure: np.datetime64, voyage: float, start: np.datetime64) -> float:
    when = units.resolve(time, start)
    share = float((when - departure) / np.timedelta64(1, "s")) / voyage
    if not -0.5 / voyage <= share <= 1 + 0.5 / voyage:  # half a second: times are whole seconds
        arrival = departure + np.timedelta64(round(voyage), "s")
        raise ValueError(
            f"distress.between {notation.group(when)} is not on the voyage, "
            f"which lasts from {notation.group(departure)} to {notation.group(arrival)}"
        )
    return min(max(share, 0.0), 1.0)


def _search_object(value: object) -> object:
    try:
        return sweep_width.find(value) if isinstance(value, str) else value
    except UserError as error:
        raise ValueError(str(error)) from None


class SurvivalTable(fields.Table):
    """How long someone stays alive after going adrift: lognormal, by a median and a spread.

    The spread is the factor of one standard deviation.
    The median is given, or follows from the water's temperature (drift.case.survival).
    """

    median: fields.Duration | None = None
    spread: Annotated[float, Field(gt=1, le=20)] | None = None
    water: Annotated[float, BeforeValidator(survival.celsius)] | None = None
    clothing: str | None = None

    @model_validator(mode="after")
    def one_way(self) -> "SurvivalTable":
        """Refuse none or two ways of giving the median, and clothing that no formula is known for."""
        if fields.one_of(self, ("median", "water")) == "median":
            if self.clothing is not None:
                raise ValueError("clothing belongs to water; a median is of people as they are clothed")
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
            survival.immersed(self.water), spread, f"{survival.SOURCE}, light clothing, {self.water:.1f} degC"
        )


def _motion(value: object) -> object:
    if not isinstance(value, str) or value not in PARAMETERS:
        names = ", ".join(f'"{name}"' for name in PARAMETERS)
        raise ValueError(f"no model of motion {value!r}; there is: {names}")
    return value


class ScenarioTable(fields.Table):
    """A [[scenario]] table as written."""

    name: fields.Label
    weight: fields.Weight = 1.0
    object: Annotated[ObjectTable, BeforeValidator(lambda value: {"name": value} if isinstance(value, str) else value)]
    motion: Annotated[str, BeforeValidator(_motion)] = "drift"
    jibe: fields.Rate | None = None
    currents: list[str] | None = None
    winds: list[str] | None = None
    stokes: list[str] | None = None
    position: PositionTable | None = None
    area: AreaTable | None = None
    trackline: TracklineTable | None = None
    search_object: Annotated[str, BeforeValidator(_search_object)] | None = None
    survival: SurvivalTable | None = None

    @model_validator(mode="after")
    def one_prior(self) -> "ScenarioTable":
        """Refuse a scenario with no place, or two."""
        fields.one_of(self, ("position", "area", "trackline"))
        return self

    def prior(self, start: np.datetime64) -> ReleasePrior:
        """Return where and when it went adrift."""
        table = self.position or self.area or self.trackline
        assert table is not None  # one_prior
        return table.prior(start)

    def jibe_rate(self, drifter: Drifter) -> float:
        """Return the jibing rate [1/s]; by default as published for objects with two sides."""
        return self.jibe if self.jibe is not None else (JIBE_RATE if drifter.jibes else 0.0)


# The models of motion that a scenario can name, and how each makes its own parameters of the scenario's keys.
PARAMETERS: dict[str, Callable[[ScenarioTable], Any]] = {"drift": lambda table: None}
