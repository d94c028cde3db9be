"""Positions and areas of the case file, each with its error and its time of release."""

import math

import numpy as np
from pydantic import model_validator

from drift.case.values import fields, units
from drift.engine.motion.scenario import AreaPrior, Displacement, PositionPrior
from geo import notation, sphere

LONGEST_EDGE = 90.0  # [deg] of longitude, longest edge of a polygon
NARROWEST = 1e-5  # [deg] least ratio of a polygon's area to its perimeter: half its width, 1 m


class WindowTable(fields.Table):
    """When it went adrift: at a time (default: the start), or between `time` and `until`."""

    time: fields.Time = np.timedelta64(0, "s")
    """When it went adrift; with `until`, the earliest time."""
    until: fields.Time | None = None
    """The latest time it can have gone adrift; uniform between `time` and this."""

    def window(self, start: np.datetime64) -> tuple[np.datetime64, np.datetime64]:
        """Return the first and the last time of release."""
        first = units.resolve(self.time, start)
        last = first if self.until is None else units.resolve(self.until, start)
        if last < first:
            raise ValueError(
                f"until {notation.format_dtg(last)} is before time {notation.format_dtg(first)}"
            )
        return first, last


class EllipseTable(fields.Table):
    """An error ellipse: semi-axes, orientation of the major axis, probability inside."""

    major: fields.Length
    """Semi-major axis."""
    minor: fields.Length
    """Semi-minor axis."""
    orientation: fields.Direction
    """Direction of the major axis."""
    probability: fields.Share = 0.5
    """Probability that the true position is inside the ellipse."""

    @model_validator(mode="after")
    def proper(self) -> "EllipseTable":
        """Reject swapped axes and a probability of 0 or 1."""
        if self.minor > self.major:
            raise ValueError("minor is longer than major; orientation belongs to the major axis")
        if not 0 < self.probability < 1:
            raise ValueError(
                f"probability {self.probability:g} must lie between 0 and 1, like 0.5 or 0.95"
            )
        return self


class DisplacementTable(fields.Table):
    """An unknown displacement before drifting: a range of distances and a sector of directions."""

    distance: fields.LengthRange
    """Distance of the displacement, or [least, most]."""
    direction: fields.Sector = (0.0, 360.0)
    """Direction it moved toward, or a sector [first, second], clockwise, degrees true."""


class ErrorTable(fields.Table):
    """The error of a position: std, ellipse, or the radius that contains 50 %."""

    std: fields.LengthPair | None = None
    """Standard deviation, or two: along `orientation` and across it."""
    orientation: fields.Direction | None = None
    """Direction of the first of two standard deviations."""
    ellipse: EllipseTable | None = None
    """Error ellipse that contains a given probability."""
    error: fields.Length | None = None
    """Radius that contains half of the probability."""

    @model_validator(mode="after")
    def one_error(self) -> "ErrorTable":
        """Reject no error or two, and unequal standard deviations without a direction."""
        kind = fields.one_of(self, ("std", "ellipse", "error"))
        unequal = self.std is not None and self.std[0] != self.std[1]
        if unequal and self.orientation is None:
            raise ValueError(
                "std has two values: give orientation too, of the first, in degrees true"
            )
        if self.orientation is not None and kind != "std":
            raise ValueError(
                "orientation belongs to std here; an ellipse has its own inside its table"
            )
        return self

    def axes(self) -> tuple[float, float, float]:
        """Return standard deviations along and across the major axis [m], and its direction
        [rad]."""
        if self.ellipse is not None:
            # A bivariate normal has probability 1 - exp(-k^2/2) within k standard deviations.
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
    """A reported position with its error, and an unknown displacement before drifting."""

    at: fields.Position
    """The reported position."""
    displacement: DisplacementTable | None = None
    """An unknown displacement between the report and going adrift."""

    def prior(self, start: np.datetime64) -> PositionPrior:
        """Return the prior for a case that starts at `start`."""
        moved = None
        if self.displacement is not None:
            first, second = self.displacement.direction
            moved = Displacement(
                self.displacement.distance, (math.radians(first), math.radians(second))
            )
        lon, lat = (math.radians(angle) for angle in self.at)
        return PositionPrior(lon, lat, *self.axes(), moved, *self.window(start))


class AreaTable(WindowTable):
    """An area: corners in order, without crossing."""

    polygon: list[fields.Position]
    """Three corners or more, in order; edges are straight in longitude and latitude."""

    @model_validator(mode="after")
    def simple(self) -> "AreaTable":
        """Reject corners that do not enclose exactly one area."""
        self.corners()
        return self

    def corners(self) -> list[tuple[float, float]]:
        """Return the corners (lon, lat) [deg], with longitudes continuous across 180 degrees."""
        import shapely  # imported late: areas are rare and the import takes 0.1 s

        points = [
            point
            for point, before in zip(self.polygon, [None, *self.polygon], strict=False)
            if point != before
        ]
        points = points[:-1] if len(points) > 1 and points[0] == points[-1] else points
        if len(points) < 3:
            raise ValueError(f"polygon has {len(points)} corners; at least 3 are needed")
        lon, lat = np.array(points).T
        steps = sphere.wrap_degrees(np.diff(lon, append=lon[0]))
        if abs(steps.sum()) > 1:
            raise ValueError("polygon goes round a pole; split it into areas that don't")
        if np.abs(steps).max() > LONGEST_EDGE:
            (west, south), (east, north) = (
                points[k := int(np.argmax(np.abs(steps)))],
                points[(k + 1) % len(points)],
            )
            raise ValueError(
                f"polygon's edge from [{west:g}, {south:g}] to [{east:g}, {north:g}] is {abs(steps[k]):.0f} degrees of "
                f"longitude wide, so its direction round the Earth is ambiguous; put corners at most {LONGEST_EDGE:g} degrees apart"
            )
        unwrapped = lon[0] + np.concatenate([[0.0], np.cumsum(steps[:-1])])
        shape = shapely.Polygon(np.column_stack([unwrapped, lat]))
        if not shape.is_valid or shape.area == 0:
            raise ValueError(
                f"polygon {_describe_fault(shapely.is_valid_reason(shape))}; give its corners in order"
            )
        if shape.area < NARROWEST * shape.length:
            raise ValueError("polygon is narrower than 2 m; give a position or a trackline instead")
        return list(zip(unwrapped.tolist(), lat.tolist(), strict=True))

    def prior(self, start: np.datetime64) -> AreaPrior:
        """Return the prior for a case that starts at `start`."""
        lon, lat = np.radians(np.array(self.corners())).T
        return AreaPrior(tuple(lon.tolist()), tuple(lat.tolist()), *self.window(start))


def _describe_fault(reason: str) -> str:
    if reason.startswith("Self-intersection"):
        lon, lat = (float(part) for part in reason[reason.index("[") + 1 : -1].split())
        return f"crosses itself near [{sphere.wrap_degrees(lon):.3f}, {lat:.3f}] (lon, lat)"
    return "encloses no area" if reason == "Valid Geometry" else f"is not simple ({reason})"
