"""The search geometry of a sortie: regions, search patterns, waypoints and tracks."""

import itertools
import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from drift.case.values import fields, gpx, units
from drift.case.values.places import AreaTable
from drift.evidence.filter import patterns
from drift.evidence.filter.patterns import Pattern
from geo import notation, polyline, sphere
from geo.notation import NMI
from geo.polyline import Area, Legs

LARGEST = 2000 * NMI  # [m] longest side of a rectangle
COMPASS = {name: 45.0 * k for k, name in enumerate(("N", "NE", "E", "SE", "S", "SW", "W", "NW"))}

Side = Annotated[fields.Length, Field(gt=0, le=LARGEST)]
Spacing = Annotated[float, BeforeValidator(lambda value: _spacing(value))]


def _spacing(value: object) -> float:
    number = units.quantity(value, "m", "spacing", "1 nmi")
    if not 10 <= number <= LARGEST:
        raise ValueError(
            f'spacing {value!r} must be 10 m to {LARGEST / NMI:g} nmi; write its unit, like "1 nmi"'
        )
    return number


class RegionTable(fields.Table):
    """A region: a polygon with great circles as edges, or a rectangle.

    The length of a rectangle lies along its orientation.
    """

    polygon: list[fields.Position] | None = None
    centre: fields.Position | None = None
    length: Side | None = None
    width: Side | None = None
    orientation: fields.Direction | None = None

    @model_validator(mode="after")
    def one_shape(self) -> "RegionTable":
        """Reject no shape or two, and a polygon without area."""
        shape = fields.one_of(self, ("polygon", "centre"))
        if shape == "centre":
            for key in ("length", "width"):
                if getattr(self, key) is None:
                    raise ValueError(
                        f"{key} is missing: a rectangle has centre, length, width and orientation"
                    )
        else:
            for key in ("length", "width", "orientation"):
                if getattr(self, key) is not None:
                    raise ValueError(
                        f"{key} belongs to a rectangle; a polygon has only its corners"
                    )
        self.area()
        return self

    def area(self) -> Area:
        """Return the record of the region."""
        if self.centre is not None:
            assert self.length is not None  # one_shape
            assert self.width is not None
            return patterns.rectangle(
                self.centre, self.length, self.width, math.radians(self.orientation or 0.0)
            )
        assert self.polygon is not None
        lon, lat = zip(*AreaTable.model_construct(polygon=self.polygon).corners(), strict=True)
        return Area(lon, lat)

    def middle(self) -> tuple[float, float]:
        """Return the centre of a rectangle, or the centroid of a polygon, (lon, lat) [deg]."""
        return self.centre if self.centre is not None else middle(self.area())


def middle(area: Area) -> tuple[float, float]:
    """Return the centroid (lon, lat) [deg] of an area."""
    import shapely

    point = shapely.Polygon(area.ring).centroid
    return float(point.x), float(point.y)


def _corner(value: object) -> Any:
    if isinstance(value, str) and value.strip().upper() in COMPASS:
        return value.strip().upper()
    try:
        return units.position(value)
    except ValueError:
        raise ValueError(
            f"{value!r} is not a corner; write one of {', '.join(COMPASS)}, or a position near it"
        ) from None


class PatternTable(fields.Table):
    """A search pattern: the keys that its kind needs or allows, and no others."""

    kind: Literal["parallel", "creeping", "square", "sector", "trackline"]
    centre: fields.Position | None = None
    length: Side | None = None
    width: Side | None = None
    orientation: fields.Direction | None = None
    spacing: Spacing | None = None
    corner: Annotated[Any, BeforeValidator(_corner)] = None
    datum: fields.Position | None = None
    legs: Annotated[fields.Count, Field(ge=1, le=500)] | None = None
    radius: Side | None = None
    sectors: Annotated[fields.Count, Field(ge=1, le=6)] | None = None
    waypoints: Annotated[list[fields.Position], Field(min_length=2)] | None = None
    offset: Annotated[fields.Length, Field(le=100 * NMI)] | None = None
    back: bool | None = Field(None, alias="return")

    @model_validator(mode="after")
    def complete(self) -> "PatternTable":
        """Reject missing keys of the kind of pattern, and keys of other kinds."""
        needed, more = NEEDS[self.kind]
        has = f"a {self.kind} pattern has {', '.join(needed + more)}"
        for name, field in type(self).model_fields.items():
            key = field.alias or name
            arguments = getattr(self, name) is not None
            if name != "kind" and arguments and key not in needed + more:
                raise ValueError(f"{key} does not belong here; {has}")
            if key in needed and not arguments:
                raise ValueError(f"{key} is missing; {has}")
        if self.length is not None and self.width is not None and self.spacing is not None:
            along = self.length if self.kind == "parallel" else self.width
            if self.spacing >= along:
                raise ValueError(
                    f"spacing {self.spacing / NMI:g} nmi leaves no legs: at both ends a leg stops half a spacing "
                    f"inside its {along / NMI:g} nmi; make spacing smaller"
                )
            across = self.width if self.kind == "parallel" else self.length
            if patterns.leg_count(across, self.spacing) > patterns.MOST_LEGS:
                raise ValueError(
                    f"spacing {self.spacing:g} m makes more than {patterns.MOST_LEGS:,} legs; make it larger"
                )
            self.corner_signs()
        return self

    def corner_signs(self) -> tuple[int, int]:
        """Return the commencing corner: -1 or 1 along, and -1 or 1 across the orientation."""
        assert self.centre is not None  # complete
        assert self.length is not None
        assert self.width is not None
        if self.corner is None:
            return -1, -1
        turn = math.radians(self.orientation or 0.0)
        signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        along = np.array([a * self.length / 2 for a, _ in signs])
        across = np.array([b * self.width / 2 for _, b in signs])
        if isinstance(self.corner, str):
            to = math.radians(COMPASS[self.corner]) - turn
            reach = along * math.cos(to) + across * math.sin(to)
        else:
            lon, lat = patterns.points_along(self.centre, turn, along, across)
            reach = -sphere.distance(*np.radians([lon, lat]), *np.radians(self.corner))
        order = np.argsort(reach)
        if isinstance(self.corner, str) and reach[order[-1]] - reach[order[-2]] < 1e-3 * (
            self.length + self.width
        ):
            raise ValueError(
                f'corner "{self.corner}": two corners are equally far in that direction; name one, like "NE", or a position'
            )
        return signs[int(order[-1])]

    def pattern(self, start: float, speed: float, end: float | None) -> Pattern:
        """Return the legs of the pattern.

        Args:
            start: begin of the first leg [s since 1970].
            speed: speed over ground [m/s].
            end: end of an expanding square without a number of legs [s since 1970].

        Raises:
            ValueError: an expanding square has no end, or too many legs.
        """
        turn = math.radians(self.orientation or 0.0)
        if self.kind in {"parallel", "creeping"}:
            assert self.centre is not None  # complete
            assert self.length is not None
            assert self.width is not None
            assert self.spacing is not None
            flown = patterns.parallel if self.kind == "parallel" else patterns.creeping
            arguments = (
                self.centre,
                self.length,
                self.width,
                turn,
                self.spacing,
                start,
                speed,
                self.corner_signs(),
            )
            return flown(*arguments)
        if self.kind == "trackline":
            assert self.waypoints is not None
            return patterns.trackline(
                self.waypoints, self.offset or 0.0, bool(self.back), start, speed
            )
        assert self.datum is not None
        if self.kind == "sector":
            assert self.radius is not None
            return patterns.sector(self.datum, self.radius, self.sectors or 3, turn, start, speed)
        assert self.spacing is not None
        if self.legs is not None:
            return patterns.square(self.datum, self.spacing, turn, self.legs, start, speed)
        if end is None:
            raise ValueError("a square pattern needs legs = their number, or the sortie's end")
        number = patterns.square_legs(self.spacing, (end - start) * speed)
        if number > 500:
            raise ValueError(
                f"spacing {self.spacing:g} m makes {number:,} legs until the end; at most 500"
            )
        square = patterns.square(self.datum, self.spacing, turn, number, start, speed)
        return Pattern(polyline.legs_between(square.legs, start, end), square.area)


# by kind of pattern: its required keys, and its optional keys
NEEDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "parallel": (("centre", "length", "width", "spacing"), ("orientation", "corner")),
    "creeping": (("centre", "length", "width", "spacing"), ("orientation", "corner")),
    "square": (("datum", "spacing"), ("orientation", "legs")),
    "sector": (("datum", "radius"), ("orientation", "sectors")),
    "trackline": (("waypoints",), ("offset", "return")),
}


def _waypoint(row: object) -> tuple[Any, tuple[float, float]]:
    """Return a waypoint as (time or None, (lon, lat) [deg])."""
    if isinstance(row, dict) and set(row) == {"time", "at"}:
        return units.time(row["time"]), units.position(row["at"])
    if isinstance(row, list | tuple) and len(row) == 2 and _timed(row):
        return units.time(row[0]), units.position(row[1])
    return None, units.position(row)


def _timed(row: list[Any] | tuple[Any, ...]) -> bool:
    first, second = row
    if isinstance(second, list | tuple | dict) or not isinstance(first, str | int | float):
        return True
    letters = (
        {letter for letter in second.upper() if letter in "NSEW"}
        if isinstance(second, str)
        else set()
    )
    return bool(letters & set("NS")) and bool(letters & set("EW"))


def waypoints(value: object) -> Any:
    if not isinstance(value, list) or len(value) < 2:
        raise ValueError(
            'needs two or more waypoints: positions, or ["211800ZNOV26", "27 30N 088 15W"] with their times'
        )
    rows = [_waypoint(row) for row in value]
    timed = sum(time is not None for time, _ in rows)
    if timed not in (0, len(rows)):
        raise ValueError(
            f"{timed} of {len(rows)} waypoints have a time; give all a time, or none and a speed"
        )
    return rows


Waypoints = Annotated[Any, BeforeValidator(waypoints)]  # list of (time or None, (lon, lat) [deg])


def moment(seconds_: float, up: bool = False) -> np.datetime64:
    """Convert [s since 1970] to a time, rounded to the nearest second, or up if `up` is set."""
    return np.datetime64(math.ceil(seconds_ - 1e-6) if up else round(seconds_), "s")


def timed_legs(rows: list[tuple[Any, tuple[float, float]]], start: np.datetime64) -> Legs:
    """Return the legs through waypoints with times.

    Args:
        rows: (time, (lon, lat) [deg]) of each waypoint.
        start: start of the case, for relative times.

    Raises:
        ValueError: the times are not ascending.
    """
    times = [units.resolve(time, start) for time, _ in rows]
    for before, after in itertools.pairwise(times):
        if after <= before:
            raise ValueError(
                f"waypoints: {notation.format_dtg(after)} does not come after {notation.format_dtg(before)}"
            )
    lon, lat = np.array([place for _, place in rows]).T
    return polyline.legs_through([float(notation.epoch(time)) for time in times], lon, lat)


def track_legs(track: gpx.Track, start: float | None, speed: float | None) -> Legs:
    """Return the legs of a GPX track.

    Args:
        track: the track.
        start: begin of a track without times [s since 1970].
        speed: speed along a track without times [m/s].

    Raises:
        ValueError: the track has no times, and start or speed is missing.
    """
    if track.time:
        return polyline.legs_through(track.time, track.lon, track.lat, track.joined)
    if speed is None or start is None:
        raise ValueError("its points have no times; give the speed and the start of the track")
    return polyline.legs_at_speed(track.lon, track.lat, start, speed, track.joined)
