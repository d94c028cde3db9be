"""Phases that follow way points: tracks and bridges by time, voyages and lane routes by speed."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from drift.case.forcing import sources
from drift.case.scenario.network import read_network
from drift.case.scenario.route import AsGiven
from drift.case.values import fields
from drift.case.values.places import AreaTable, EllipseTable, ErrorTable
from drift.case.values.spreads import AT_ONCE, Durations, Speeds, Time, Times, start_distribution
from drift.engine.motion.steering import lanes
from drift.engine.motion.steering.itinerary import (
    NONE,
    Abeam,
    InBox,
    InDisc,
    InRing,
    Lanes,
    Near,
    Place,
    Spread,
    WayPoint,
    Ways,
    latest,
    middle,
    radius,
)
from drift.tracking.bridges.bridge import refuse_antipodes, refuse_width
from geo import notation, sphere

KNOT = notation.NMI / 3600  # [m/s]
SPREADS = 4.0  # standard deviations taken as the limit of a position or a time


class PointTable(fields.Table):
    """A way point: its position with an error, and the time when it is reached."""

    at: fields.Position | None = None
    std: fields.LengthPair | None = None
    ellipse: EllipseTable | None = None
    error: fields.Length | None = None
    box: fields.LengthPair | None = None
    orientation: fields.Direction | None = None
    radius: fields.Length | None = None
    polygon: list[fields.Position] | None = None
    correlation: Annotated[float, Field(ge=-1, le=1)] = 0.0
    time: Time | None = None
    after: Durations | None = None
    probability: fields.Share | None = None

    @model_validator(mode="after")
    def one_place(self) -> "PointTable":
        """Reject two positions or two errors, and keys that belong to an error not given."""
        fields.one_of(self, ("at", "polygon"))
        errors = [
            name
            for name in ("std", "ellipse", "error", "box", "radius")
            if getattr(self, name) is not None
        ]
        if len(errors) > 1 or (errors and self.polygon is not None):
            raise ValueError(f"give one error of a position at most; found {' and '.join(errors)}")
        if self.orientation is not None and errors not in (["std"], ["box"]):
            raise ValueError(
                "orientation belongs to std or box; an ellipse has its own inside its table"
            )
        if self.correlation and errors not in (["std"], ["ellipse"], ["error"]):
            raise ValueError(
                "correlation links the normal errors of this way point and the one before: give std too"
            )
        if self.box is not None and min(self.box) == 0:
            raise ValueError("box has a side of 0; give its length and its width")
        if self.std is not None and self.std[0] != self.std[1] and self.orientation is None:
            raise ValueError(
                "std has two values: give orientation too, of the first, in degrees true"
            )
        if self.polygon is not None:
            AreaTable.model_construct(polygon=self.polygon).corners()
        if self.time is not None and self.after is not None:
            raise ValueError("give time or after, not both")
        return self

    def place(self, before: Place | None) -> Place:
        """Return the position; it may be correlated with that of the way point `before`."""
        if self.polygon is not None:
            lon, lat = np.radians(
                np.array(AreaTable.model_construct(polygon=self.polygon).corners())
            ).T
            return InRing(tuple(lon.tolist()), tuple(lat.tolist()))
        assert self.at is not None
        lon, lat = (math.radians(angle) for angle in self.at)
        if self.box is not None:
            return InBox(lon, lat, *self.box, orientation=math.radians(self.orientation or 0.0))
        if self.radius is not None:
            return InDisc(lon, lat, self.radius)
        if self.std is None and self.ellipse is None and self.error is None:
            return Near(lon, lat)
        axes = ErrorTable.model_construct(
            std=self.std, ellipse=self.ellipse, error=self.error, orientation=self.orientation
        ).axes()
        own = Near(lon, lat, *axes)
        return own if not self.correlation else _correlated(own, before, self.correlation)


def _correlated(own: Near, before: Place | None, correlation: float) -> Near:
    """Return a normally distributed position, correlated with that of the way point before.

    S_a and S_b are the symmetric roots of the covariances (east, north) of this position and the
    one before. The deviation here is r S_a S_b^-1 times the deviation before, plus an independent
    part of covariance (1 - r^2) S_a^2, so its covariance is unchanged.

    Args:
        own: the position without correlation.
        before: the position of the way point before; it must be normal.
        correlation: r, from -1 to 1.
    """
    if not isinstance(before, Near) or before.minor == 0:
        raise ValueError(
            "correlation: the way point before has no normal error; give it std, ellipse or error"
        )
    gain = correlation * _root(own) @ np.linalg.inv(_root(before))
    rest = math.sqrt(1 - correlation**2)
    follows = (float(gain[0, 0]), float(gain[0, 1]), float(gain[1, 0]), float(gain[1, 1]))
    return Near(own.lon, own.lat, rest * own.major, rest * own.minor, own.orientation, follows)


def _root(place: Near) -> Any:
    s, c = math.sin(place.orientation), math.cos(place.orientation)
    axes = np.array([[s, c], [c, -s]])
    return axes @ np.diag([place.major, place.minor]) @ axes.T


class BoundedTable(fields.Table):
    """Limits of the speed made good between way points with times."""

    min_speed: fields.Speed = 0.0
    max_speed: fields.ShipSpeed | None = None

    @model_validator(mode="after")
    def speeds_in_order(self) -> "BoundedTable":
        """Reject a lowest speed above the highest."""
        if self.max_speed is not None and self.min_speed > self.max_speed:
            raise ValueError(
                f"min_speed {self.min_speed:.3g} m/s is above max_speed {self.max_speed:.3g} m/s"
            )
        return self

    def in_time(self, points: Sequence[WayPoint]) -> None:
        """Reject way points that these speeds cannot reach at their times."""
        for a, b in itertools.pairwise(points):
            apart = float(sphere.distance(*middle(a.place), *middle(b.place)))
            spread = radius(a.place, SPREADS) + radius(b.place, SPREADS)
            longest = latest(b.time, SPREADS) - latest(a.time, -SPREADS)
            shortest = latest(b.time, -SPREADS) - latest(a.time, SPREADS)
            least, most = max(apart - spread, 0.0) / notation.NMI, (apart + spread) / notation.NMI
            if self.max_speed is not None and least > self.max_speed / notation.NMI * longest:
                raise ValueError(
                    f"max_speed {self.max_speed / KNOT:.4g} kn is too slow: {least:.0f} nmi at least between two way points, in "
                    f"{longest / 3600:.3g} h at most; give more, or other times"
                )
            if most < self.min_speed / notation.NMI * shortest:
                raise ValueError(
                    f"min_speed {self.min_speed / KNOT:.4g} kn is too fast: {most:.0f} nmi at most between two way points, in "
                    f"{shortest / 3600:.3g} h at least; give less, or other times"
                )


class TrackTable(BoundedTable):
    """Way points at times after an uncertain start."""

    start: Time = AT_ONCE
    points: Annotated[list[PointTable], Field(min_length=2)]

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Ways:
        """Return the record of the phase, for a case from `start` to `end`."""
        earliest, after = start_distribution(self.start, start)
        points = _way_points(self.points, None, start)
        _check_order(list(points), start, lambda seconds: f"after {seconds / 3600:g} h")
        self.in_time(points)
        return Ways(
            points,
            earliest,
            after,
            slowest=self.min_speed,
            fastest=self.max_speed or math.inf,
        )


class BridgeTable(BoundedTable):
    """Way points joined by Brownian bridges."""

    k: fields.SpreadRate
    k_spread: Annotated[float, Field(ge=1, le=20)] = 1.0
    points: Annotated[list[PointTable], Field(min_length=1)]
    destinations: list[PointTable] = Field(default_factory=list)

    @model_validator(mode="after")
    def somewhere(self) -> "BridgeTable":
        """Reject a bridge with one end, and destinations whose probabilities do not add up to 1."""
        if len(self.points) + bool(self.destinations) < 2:
            raise ValueError(
                "points: a bridge leads from one way point to another; give two, or destinations"
            )
        given = [table.probability for table in self.destinations]
        if None in given:
            raise ValueError(
                f"destinations.{given.index(None) + 1}.probability is missing; together they add up to 1"
            )
        if given and abs((total := math.fsum(x or 0.0 for x in given)) - 1) > 1e-6:
            raise ValueError(
                f"destinations: their probabilities add up to {total:g}; they must add up to 1"
            )
        if any(table.probability is not None for table in self.points):
            raise ValueError("points: a probability belongs to destinations")
        return self

    def has_law(self, points: Sequence[WayPoint]) -> None:
        """Reject bridges between antipodes, and bridges too wide for the Earth."""
        refuse_antipodes(*np.array([middle(point.place) for point in points]).T)
        for a, b in itertools.pairwise(points):
            lasting = latest(b.time, 0.0) - latest(a.time, 0.0)
            refuse_width(self.k * self.k_spread * math.sqrt(max(lasting, 0.0)) / 2)  # midway

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Ways:
        """Return the record of the phase, for a case from `start` to `end`."""
        points = _way_points(self.points, start, start)
        last = points[-1].place
        ends = tuple(
            (_way_point(table, last, start, start), float(table.probability or 0.0))
            for table in self.destinations
        )
        for some in (points, *((points[-1], end) for end, _ in ends)):
            _check_order(list(some), start)
            self.in_time(some)
            self.has_law(some)
        return Ways(
            points,
            start,
            NONE,
            ends,
            k=self.k,
            k_spread=math.log(self.k_spread),
            slowest=self.min_speed,
            fastest=self.max_speed or math.inf,
        )


class VoyageTable(fields.Table):
    """A voyage by way points: departure, speed, and distance from the track."""

    waypoints: Annotated[list[fields.Position], Field(min_length=2)]
    departure: Time = AT_ONCE
    departure_error: fields.Length = 0.0
    speed: Speeds
    cross_track: fields.Length = 0.0

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Ways:
        """Return the record of the phase, for a case from `start` to `end`."""
        lon, lat = np.radians(np.array(self.waypoints)).T
        length = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
        if (length < 1).any():
            raise ValueError("waypoints: two in a row lie in one place")
        ahead = lanes.bearing(lon[:-1], lat[:-1], lon[1:], lat[1:])
        behind = lanes.bearing(lon[1:], lat[1:], lon[:-1], lat[:-1]) + np.pi
        off = np.full(lon.size, self.cross_track)
        half, toward = lanes.line_across_corridor(
            np.append(ahead[0], behind), np.append(ahead, behind[-1]), off, off
        )
        columns = (x.tolist() for x in (lon, lat, half, toward))
        places: list[Abeam | Near] = [
            Abeam(x, y, wide, away, "normal") for x, y, wide, away in zip(*columns, strict=True)
        ]
        if self.departure_error > 0:
            axes = ErrorTable.model_construct(error=self.departure_error).axes()
            places[0] = Near(places[0].lon, places[0].lat, *axes)
        return _by_speed(places, np.append(0.0, length), self.departure, self.speed, start)


class LanesTable(fields.Table):
    """A route along the lanes of a network."""

    network: str
    route: AsGiven
    entry: Time = AT_ONCE
    speed: Speeds

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Ways:
        """Return the record of the route; raise UserError for an invalid network or route."""
        chart = read_network(sources.one_file(self.network, folder, "network"))
        route = self.route.route(chart.network)
        columns = (x.tolist() for x in (route.lon, route.lat, route.half, route.toward))
        places = [Abeam(*at) for at in zip(*columns, strict=True)]
        ways = _by_speed(places, np.diff(route.along, prepend=0.0), self.entry, self.speed, start)
        return replace(ways, lanes=Lanes(lanes.followed(chart.network, [route]), route))


def _by_speed(
    places: Sequence[Abeam | Near], distance: Any, begin: Times, speed: Spread, start: np.datetime64
) -> Ways:
    points = [
        WayPoint(place, distance=float(far)) for place, far in zip(places, distance, strict=True)
    ]
    return Ways(tuple(points), *start_distribution(begin, start), speed=speed)


def _way_points(
    tables: list[PointTable], origin: np.datetime64 | None, start: np.datetime64
) -> tuple[WayPoint, ...]:
    points: list[WayPoint] = []
    for table in tables:
        points.append(_way_point(table, points[-1].place if points else None, origin, start))
    return tuple(points)


def _way_point(
    table: PointTable, before: Place | None, origin: np.datetime64 | None, start: np.datetime64
) -> WayPoint:
    """Return a way point; its times count from `origin`, or are given by `after` if it is None."""
    if origin is None:
        if table.after is None or table.time is not None:
            raise ValueError(
                'each point of a track needs after, such as "6 h" or ["6 h", "9 h"]: the time from its start'
            )
        return WayPoint(table.place(before), table.after)
    if table.time is None or table.after is not None:
        raise ValueError("points and destinations of a bridge have a time each")
    return WayPoint(table.place(before), table.time.seconds(origin, start))


def _check_order(
    points: list[WayPoint], start: np.datetime64, describe: Callable[[float], str] | None = None
) -> None:
    """Reject a way point certainly reached before its predecessor; `describe` formats seconds."""
    describe = describe or (
        lambda seconds: notation.format_dtg(start + np.timedelta64(round(seconds), "s"))
    )
    for a, b in itertools.pairwise(points):
        earliest = a.time.low if isinstance(a.time, Spread) else a.time.mean if a.time else 0.0
        latest = b.time.high if isinstance(b.time, Spread) else b.time.mean if b.time else math.inf
        if latest <= earliest:
            raise ValueError(
                f"arrives {describe(latest)}, before it departs, {describe(earliest)}; give times in the order of the way points"
            )
