"""How a target steers: the phases of a [[scenario]], its distress, and what land means to it.

Tables of the case file, and the records of drift.motion.itinerary that they become. Each phase is one of course, behaviour,
track, lanes, voyage, loiter and bridge.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from drift.bridges.bridge import refuse_antipodes, refuse_width
from drift.case import fields, sources, tracker, units
from drift.case.behaviour import BehaviourTable
from drift.case.network import read
from drift.case.objects import SearchObject
from drift.case.places import AreaTable, EllipseTable, ErrorTable
from drift.case.route import AsGiven
from drift.case.tracker import TrackerTable
from drift.motion import lanes
from drift.motion.itinerary import (
    NONE,
    Abeam,
    Acts,
    Between,
    Course,
    Distress,
    Followed,
    InBox,
    InDisc,
    InRing,
    Lanes,
    Loiter,
    Moment,
    Near,
    Part,
    Phase,
    Place,
    Rate,
    Spread,
    WayPoint,
    Ways,
    latest,
    middle,
    radius,
)
from drift.tracker import path
from geo import notation, sphere

LEAST_RATIO = 1.0
KNOT = notation.NMI / 3600  # [m/s]
SHORTEST_LEG = 500.0  # [m] of an area to loiter in, on average
SPREADS = 4.0  # standard deviations beyond which a place or a time is not expected


def _spread(single: Callable[[object], float], example: str) -> BeforeValidator:
    """Return a validator of an uncertain number: a value, [low, high], or a truncated triangle."""

    return BeforeValidator(lambda value: _uncertain(value, single, example))


def _uncertain(value: object, single: Callable[[object], float], example: str) -> Spread:
    if isinstance(value, Spread):
        return value
    if isinstance(value, dict):
        return _triangle(value, single, example)
    low, high = fields.pair_of(single)(value)
    if high < low:
        raise ValueError(f"{value!r} must go from low to high")
    return Spread(low, high, (low + high) / 2)


def _triangle(value: dict[Any, Any], single: Callable[[object], float], example: str) -> Spread:
    keys = ("low", "best", "high", "ratio")
    if set(value) != set(keys):
        raise ValueError(f"{value!r} must be one value, [low, high], or a table with {', '.join(keys)}, like {example}")
    low, best, high = (single(value[key]) for key in keys[:3])
    ratio = units.quantity(value["ratio"], "", "ratio", "4")
    if not low <= best <= high:
        raise ValueError(f"best {value['best']!r} must lie between low {value['low']!r} and high {value['high']!r}")
    if ratio < LEAST_RATIO:
        raise ValueError(f"ratio {ratio:g}, of the highest to the lowest density, must be at least 1 (1: uniform)")
    return Spread(low, high, best, ratio)


def _course(value: object) -> Spread:
    """Return courses [rad]; a range through north, like [340, 20], goes on past a whole turn."""
    if isinstance(value, Spread):
        return value
    one = fields.direction
    if isinstance(value, dict) and set(value) == {"low", "best", "high", "ratio"}:
        low, best, high = (one(value[key]) for key in ("low", "best", "high"))
        high += 360.0 * (high < low)
        best += 360.0 * (best < low)
        value = {"low": low, "best": best, "high": high, "ratio": value["ratio"]}
    elif isinstance(value, list | tuple) and len(value) == 2:
        low, high = one(value[0]), one(value[1])
        value = [low, high + 360.0 * (high < low)]
    else:
        value = one(value)

    def bare(number: object) -> float:
        return units.quantity(number, "deg", "direction", "120 deg")

    spread = _uncertain(value, bare, "{ low = 340, best = 10, high = 40, ratio = 4 }")
    return Spread(math.radians(spread.low), math.radians(spread.high), math.radians(spread.mode), spread.ratio)


Speeds = Annotated[Spread, _spread(fields.ship_speed, '{ low = "5 kn", best = "8 kn", high = "12 kn", ratio = 4 }')]
Courses = Annotated[Spread, BeforeValidator(_course)]
Durations = Annotated[Spread, _spread(fields.interval, '{ low = "2 h", best = "3 h", high = "6 h", ratio = 4 }')]
Parts = Annotated[Spread, _spread(fields.share, "{ low = 0.2, best = 0.5, high = 0.9, ratio = 4 }")]


class Times(fields.Table):
    """An uncertain time: a time, [earliest, latest], a truncated triangle, or a normal law."""

    earliest: fields.Time | None = None
    """With `latest`; all in between alike unless `best` is given."""
    best: fields.Time | None = None
    """The likeliest, with `ratio`."""
    latest: fields.Time | None = None
    """With `earliest`."""
    ratio: float = 1.0
    """How many times likelier the best is than the ends."""
    at: fields.Time | None = None
    """The time itself, or the mean with `std`."""
    std: fields.Duration | None = None
    """Standard deviation of a normal law."""

    @model_validator(mode="after")
    def one_law(self) -> "Times":
        """Refuse half a law, or two."""
        given = {name for name in self.model_fields_set if getattr(self, name) is not None}
        if given not in ({"at"}, {"at", "std"}, {"earliest", "latest"}, {"earliest", "best", "latest", "ratio"}):
            raise ValueError(
                "give a time, [earliest, latest], { earliest, best, latest, ratio } or { at, std }; found "
                f"{', '.join(sorted(given)) or 'nothing'}"
            )
        if self.ratio < LEAST_RATIO:
            raise ValueError(f"ratio {self.ratio:g}, of the highest to the lowest density, must be at least 1")
        return self

    def seconds(self, origin: np.datetime64, start: np.datetime64) -> Spread | Moment:
        """Return the law in seconds after an origin, for a case that starts at `start`; refuse times out of order."""

        def after(time: units.Instant) -> float:
            return float((units.resolve(time, start) - origin) / np.timedelta64(1, "s"))

        if self.at is not None:
            mean = after(self.at)
            return Moment(mean, self.std) if self.std else Spread(mean, mean, mean)
        assert self.earliest is not None
        assert self.latest is not None
        low, high = after(self.earliest), after(self.latest)
        best = after(self.best) if self.best is not None else (low + high) / 2
        if not low <= best <= high:
            first, last = (notation.group(units.resolve(time, start)) for time in (self.earliest, self.latest))
            raise ValueError(f"times go from {first} to {last}, or the best one lies outside; give them in order")
        return Spread(low, high, best, self.ratio)


def _times(value: Any) -> Any:
    if isinstance(value, dict | Times):
        return value
    if isinstance(value, list):
        if len(value) != 2:
            raise ValueError(f"{value!r} must be a time or [earliest, latest]")
        return {"earliest": value[0], "latest": value[1]}
    return {"at": value}


Time = Annotated[Times, BeforeValidator(_times)]


AT_ONCE = Times(at="+0 h")  # as it is written


class PointTable(fields.Table):
    """A way point: where, with its error, and when it is reached."""

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
        """Refuse two places or two errors, and what belongs to none that is given."""
        fields.one_of(self, ("at", "polygon"))
        errors = [name for name in ("std", "ellipse", "error", "box", "radius") if getattr(self, name) is not None]
        if len(errors) > 1 or (errors and self.polygon is not None):
            raise ValueError(f"give one error of a position at most; found {' and '.join(errors)}")
        if self.orientation is not None and errors not in (["std"], ["box"]):
            raise ValueError("orientation belongs to std or box; an ellipse has its own inside its table")
        if self.correlation and errors not in (["std"], ["ellipse"], ["error"]):
            raise ValueError("correlation is that of a normal error with that of the way point before: give std too")
        if self.box is not None and min(self.box) == 0:
            raise ValueError("box has a side of 0; give its length and its width")
        if self.std is not None and self.std[0] != self.std[1] and self.orientation is None:
            raise ValueError("std has two values: give orientation too, of the first, in degrees true")
        if self.polygon is not None:
            AreaTable.model_construct(polygon=self.polygon).corners()
        if self.time is not None and self.after is not None:
            raise ValueError("give time or after, not both")
        return self

    def place(self, before: Place | None) -> Place:
        """Return the place; before: that of the way point before, on whose deviation it may depend."""
        if self.polygon is not None:
            lon, lat = np.radians(np.array(AreaTable.model_construct(polygon=self.polygon).corners())).T
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
        return own if not self.correlation else correlated(own, before, self.correlation)


def correlated(own: Near, before: Place | None, correlation: float) -> Near:
    """Return a normal place whose deviation has a correlation with that of the place before.

    With S_a and S_b the symmetric roots of the covariances (east, north) here and there, the deviation here is
    r S_a S_b^-1 times that there, and a rest of covariance (1 - r^2) S_a^2: it keeps its own covariance.
    """
    if not isinstance(before, Near) or before.minor == 0:
        raise ValueError("correlation: the way point before has no normal error; give it std, ellipse or error")
    gain = correlation * _root(own) @ np.linalg.inv(_root(before))
    rest = math.sqrt(1 - correlation**2)
    follows = (float(gain[0, 0]), float(gain[0, 1]), float(gain[1, 0]), float(gain[1, 1]))
    return Near(own.lon, own.lat, rest * own.major, rest * own.minor, own.orientation, follows)


def _root(place: Near) -> Any:
    s, c = math.sin(place.orientation), math.cos(place.orientation)
    axes = np.array([[s, c], [c, -s]])
    return axes @ np.diag([place.major, place.minor]) @ axes.T


class WindowedTable(fields.Table):
    """How long a phase lasts: until a time, or for a duration, or as long as the run."""

    until: fields.Time | None = None
    lasting: Annotated[fields.Duration | None, Field(alias="for")] = None

    def end(self, start: np.datetime64) -> tuple[np.datetime64 | None, float]:
        """Return when it is over at the latest, and how long it lasts at most [s]."""
        until = None if self.until is None else units.resolve(self.until, start)
        return until, math.inf if self.lasting is None else self.lasting


class CourseTable(WindowedTable):
    """A constant course, or one that changes."""

    course: Courses
    speed: Speeds
    change: fields.Duration | None = None

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Course:
        """Return the record."""
        return Course(self.course, self.speed, self.change or 0.0, *self.end(start))


ANY_COURSE = Spread(0.0, 2 * math.pi, math.pi)


class ActsTable(BehaviourTable, WindowedTable):
    """A course that is kept, changed, or one that leads to a tracker or away from it, at times of its own."""

    course: Courses = ANY_COURSE
    speed: Speeds | None = None
    tracker: TrackerTable | None = None

    @model_validator(mode="after")
    def of_whom(self) -> "ActsTable":
        """Refuse what seeks or flees from nobody, what never acts, and a first speed above the highest."""
        wrong = []
        if self.acts is None:
            wrong.append('acts: is missing, like ["3 min", "15 min"]; what keeps its course is a phase of course')
        if self.seek + self.hide > 0 and self.tracker is None:
            wrong.append(
                'tracker: is missing: whom does it seek or hide from? Give { at, legs }, { track = "own.gpx" }, or the name of a [tracker.NAME]'
            )
        if self.speed is not None and self.speed.high > self.fastest:
            wrong.append(f"speed: {self.speed.high / KNOT:.4g} kn is above fastest, {self.fastest / KNOT:.4g} kn")
        fields.refuse(self, wrong)
        return self

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Acts:
        """Return the record."""
        assert self.acts is not None
        until, lasting = self.end(start)
        speed = self.speed or Spread(0.0, self.fastest, self.fastest / 2)
        followed = None if self.tracker is None else _followed(self.tracker, start, min(end, until or end), folder)
        return Acts(
            self.course, speed, self.fastest, self.acts, self.change, self.seek, self.hide, self.leave, math.radians(self.spread),
            followed, until, lasting,
        )  # fmt: skip


def _followed(table: TrackerTable, start: np.datetime64, end: np.datetime64, folder: Path) -> Followed:
    """Return where a tracker is from the start to an end; refuse a track that does not say it."""
    lasting = max(float((end - start) / np.timedelta64(1, "s")), 0.0)
    try:
        way = tracker.way(table, None, start, lasting, folder)
        first, last = (start + np.timedelta64(round(time), "s") for time in (way.time[0], way.time[-1]))
        if first > start or last < end:
            raise ValueError(
                f"is known from {notation.group(first)} to {notation.group(last)}, not from {notation.group(start)} to "
                f"{notation.group(end)}; complete its track, or give the phase until"
            )
    except ValueError as error:
        raise ValueError(f"tracker: {error}") from None
    lon, lat = np.radians(path.degrees(way.place))
    return Followed(start, tuple(way.time.tolist()), tuple(lon.tolist()), tuple(lat.tolist()))


class LoiterTable(WindowedTable):
    """To and fro in a polygon."""

    polygon: list[fields.Position]
    speed: Speeds
    leg: fields.Length

    @field_validator("leg")
    @classmethod
    def long_enough(cls, leg: float) -> float:
        """Refuse legs after which a target would do nothing but turn, for ever."""
        if leg < SHORTEST_LEG:
            raise ValueError(
                f"{leg:.4g} m on average between turns is too short; allowed: {SHORTEST_LEG:.0f} m or more; a number "
                "without a unit is in metres"
            )
        return leg

    @model_validator(mode="after")
    def simple(self) -> "LoiterTable":
        """Refuse what encloses no area, or not one."""
        AreaTable.model_construct(polygon=self.polygon).corners()
        return self

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Loiter:
        """Return the record."""
        lon, lat = np.radians(np.array(AreaTable.model_construct(polygon=self.polygon).corners())).T
        return Loiter(InRing(tuple(lon.tolist()), tuple(lat.tolist())), self.speed, self.leg, *self.end(start))


class BoundedTable(fields.Table):
    """Speeds made good between way points that have times."""

    min_speed: fields.Speed = 0.0
    max_speed: fields.ShipSpeed | None = None

    @model_validator(mode="after")
    def speeds_in_order(self) -> "BoundedTable":
        """Refuse a lowest speed above the highest."""
        if self.max_speed is not None and self.min_speed > self.max_speed:
            raise ValueError(f"min_speed {self.min_speed:.3g} m/s is above max_speed {self.max_speed:.3g} m/s")
        return self

    def in_time(self, points: Sequence[WayPoint]) -> None:
        """Refuse a way point that cannot be reached in its time by these speeds, or only after it."""
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
    """Places at times after an uncertain start."""

    start: Time = AT_ONCE
    points: Annotated[list[PointTable], Field(min_length=2)]

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Ways:
        """Return the record."""
        earliest, after = _start(self.start, start)
        points = _points(self.points, None, start)
        _in_order(list(points), start, lambda seconds: f"after {seconds / 3600:g} h")
        self.in_time(points)
        return Ways(
            points, earliest, after,
            slowest=self.min_speed, fastest=self.max_speed or math.inf,
        )  # fmt: skip


class BridgeTable(BoundedTable):
    """Way points, and a Brownian bridge from each to the next."""

    k: fields.SpreadRate
    k_spread: Annotated[float, Field(ge=1, le=20)] = 1.0
    points: Annotated[list[PointTable], Field(min_length=1)]
    destinations: list[PointTable] = Field(default_factory=list)

    @model_validator(mode="after")
    def somewhere(self) -> "BridgeTable":
        """Refuse a bridge that leads nowhere, and destinations whose probabilities do not add up to 1."""
        if len(self.points) + bool(self.destinations) < 2:
            raise ValueError("points: a bridge leads from one way point to another; give two, or destinations")
        given = [table.probability for table in self.destinations]
        if None in given:
            raise ValueError(f"destinations.{given.index(None) + 1}.probability is missing; together they add up to 1")
        if given and abs((total := math.fsum(x or 0.0 for x in given)) - 1) > 1e-6:
            raise ValueError(f"destinations: their probabilities add up to {total:g}; they must add up to 1")
        if any(table.probability is not None for table in self.points):
            raise ValueError("points: a probability belongs to destinations")
        return self

    def has_law(self, points: Sequence[WayPoint]) -> None:
        """Refuse what `drift bridge` refuses: ways between antipodes, or all over the Earth."""
        refuse_antipodes(*np.array([middle(point.place) for point in points]).T)
        for a, b in itertools.pairwise(points):
            lasting = latest(b.time, 0.0) - latest(a.time, 0.0)
            refuse_width(self.k * self.k_spread * math.sqrt(max(lasting, 0.0)) / 2)  # midway

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Ways:
        """Return the record."""
        points = _points(self.points, start, start)
        last = points[-1].place
        ends = tuple(
            (_point(table, last, start, start), float(table.probability or 0.0)) for table in self.destinations
        )
        for some in (points, *((points[-1], end) for end, _ in ends)):
            _in_order(list(some), start)
            self.in_time(some)
            self.has_law(some)
        return Ways(
            points, start, NONE, ends, k=self.k, k_spread=math.log(self.k_spread),
            slowest=self.min_speed, fastest=self.max_speed or math.inf,
        )  # fmt: skip


class VoyageTable(fields.Table):
    """A voyage by way points: when and where it departs, how fast it is, how far off the track it may be."""

    waypoints: Annotated[list[fields.Position], Field(min_length=2)]
    departure: Time = AT_ONCE
    departure_error: fields.Length = 0.0
    speed: Speeds
    cross_track: fields.Length = 0.0

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Ways:
        """Return the record."""
        lon, lat = np.radians(np.array(self.waypoints)).T
        length = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
        if (length < 1).any():
            raise ValueError("waypoints: two in a row lie in one place")
        ahead = lanes.bearing(lon[:-1], lat[:-1], lon[1:], lat[1:])
        behind = lanes.bearing(lon[1:], lat[1:], lon[:-1], lat[:-1]) + np.pi
        off = np.full(lon.size, self.cross_track)
        half, toward = lanes.across(np.append(ahead[0], behind), np.append(ahead, behind[-1]), off, off)
        columns = (x.tolist() for x in (lon, lat, half, toward))
        places: list[Abeam | Near] = [
            Abeam(x, y, wide, away, "normal") for x, y, wide, away in zip(*columns, strict=True)
        ]
        if self.departure_error > 0:
            axes = ErrorTable.model_construct(error=self.departure_error).axes()
            places[0] = Near(places[0].lon, places[0].lat, *axes)
        return _by_speed(places, np.append(0.0, length), self.departure, self.speed, start)


def shared(data: Any) -> Any:
    """Return the tables of a case as read with what its phases name put in: voyages, alone or by `like`, and trackers.

    What is not as it should be stays as it is, and is refused where it stands. Raises ValidationError, a complaint for each name that
    there is none of.
    """
    if not isinstance(data, dict) or not isinstance(data.get("scenario"), list):
        return data
    wrong: list[str] = []

    def named(kind: str, name: Any, where: str) -> dict[str, Any]:
        tables = data.get(kind)
        known = tables if isinstance(tables, dict) else {}
        if isinstance(name, str) and isinstance(known.get(name), dict):
            return dict(known[name])
        there = ", ".join(f"[{kind}.{key}]" for key in known) or f"none; write it as [{kind}.NAME]"
        wrong.append(f"{where}: no {kind} {name!r}; there are: {there}")
        return {}

    def whole(phase: Any, where: str) -> Any:
        if not isinstance(phase, dict):
            return phase
        voyage, behaviour = phase.get("voyage"), phase.get("behaviour")
        if isinstance(voyage, str):
            return {**phase, "voyage": named("voyage", voyage, f"{where}.voyage")}
        if isinstance(voyage, dict) and voyage.get("like") is not None:
            rest = {key: value for key, value in voyage.items() if key != "like"}
            return {**phase, "voyage": {**named("voyage", voyage["like"], f"{where}.voyage"), **rest}}
        if isinstance(behaviour, dict) and isinstance(behaviour.get("tracker"), str):
            who = named("tracker", behaviour["tracker"], f"{where}.behaviour.tracker")
            return {**phase, "behaviour": {**behaviour, "tracker": who}}
        return phase

    def told(story: Any) -> Any:
        phases = story.get("phase") if isinstance(story, dict) else None
        if not isinstance(phases, list):
            return story
        where = f'scenario "{story.get("name")}".phase'
        return {**story, "phase": [whole(phase, f"{where} {number}") for number, phase in enumerate(phases, 1)]}

    made = {**data, "scenario": [told(story) for story in data["scenario"]]}
    if wrong:
        raise ValidationError.from_exception_data("scenarios", [fields.complaint(line) for line in wrong])
    return made


class LanesTable(fields.Table):
    """A route along the lanes of a network."""

    network: str
    route: AsGiven
    entry: Time = AT_ONCE
    speed: Speeds

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Ways:
        """Return the record; raise UserError where the network or the route is at fault."""
        chart = read(sources.one_file(self.network, folder, "network"))
        route = self.route.route(chart.network)
        columns = (x.tolist() for x in (route.lon, route.lat, route.half, route.toward))
        places = [Abeam(*at) for at in zip(*columns, strict=True)]
        ways = _by_speed(places, np.diff(route.along, prepend=0.0), self.entry, self.speed, start)
        return replace(ways, lanes=Lanes(lanes.followed(chart.network, [route]), route))


def _start(law: Times, start: np.datetime64) -> tuple[np.datetime64, Spread]:
    """Return the earliest time of a start, and how long after it the start is."""
    seconds = law.seconds(start, start)
    if isinstance(seconds, Moment):
        raise ValueError("a start has no std; give a time, [earliest, latest] or { earliest, best, latest, ratio }")
    earliest = start + np.timedelta64(round(seconds.low), "s")
    low = seconds.low
    return earliest, Spread(0.0, seconds.high - low, seconds.mode - low, seconds.ratio)


def _by_speed(places: Sequence[Abeam | Near], distance: Any, begin: Times, speed: Spread, start: np.datetime64) -> Ways:
    points = [WayPoint(place, distance=float(far)) for place, far in zip(places, distance, strict=True)]
    return Ways(tuple(points), *_start(begin, start), speed=speed)


def _points(tables: list[PointTable], origin: np.datetime64 | None, start: np.datetime64) -> tuple[WayPoint, ...]:
    points: list[WayPoint] = []
    for table in tables:
        points.append(_point(table, points[-1].place if points else None, origin, start))
    return tuple(points)


def _point(table: PointTable, before: Place | None, origin: np.datetime64 | None, start: np.datetime64) -> WayPoint:
    """Return a way point; origin: what its times count from, None where they come as `after`."""
    if origin is None:
        if table.after is None or table.time is not None:
            raise ValueError('points of a track have after, like "6 h" or ["6 h", "9 h"]: the time from its start')
        return WayPoint(table.place(before), table.after)
    if table.time is None or table.after is not None:
        raise ValueError("points and destinations of a bridge have a time each")
    return WayPoint(table.place(before), table.time.seconds(origin, start))


def _in_order(points: list[WayPoint], start: np.datetime64, told: Callable[[float], str] | None = None) -> None:
    """Refuse a way point that is surely reached before the one before it; told: how seconds are told, by default as times."""
    told = told or (lambda seconds: notation.group(start + np.timedelta64(round(seconds), "s")))
    for a, b in itertools.pairwise(points):
        earliest = a.time.low if isinstance(a.time, Spread) else a.time.mean if a.time else 0.0
        latest = b.time.high if isinstance(b.time, Spread) else b.time.mean if b.time else math.inf
        if latest <= earliest:
            raise ValueError(
                f"arrives {told(latest)}, before it departs, {told(earliest)}; give times in the order of the way points"
            )


LAWS = ("course", "behaviour", "track", "lanes", "voyage", "loiter", "bridge")


class PhaseTable(fields.Table):
    """A [[scenario.phase]] table as written: one of the kinds of motion."""

    course: CourseTable | None = None
    """A constant course, or one that changes."""
    behaviour: ActsTable | None = None
    """A course that it changes, or on which it seeks or flees from a tracker, at times of its own."""
    track: TrackTable | None = None
    """Places at times after a start."""
    lanes: LanesTable | None = None
    """Along lanes of a network."""
    voyage: VoyageTable | None = None
    """By way points at a speed."""
    loiter: LoiterTable | None = None
    """To and fro in a polygon."""
    bridge: BridgeTable | None = None
    """Brownian bridges from way point to way point."""

    @property
    def kind(self) -> str:
        """Its kind, the name of its table."""
        return fields.one_of(self, LAWS)

    @property
    def endless(self) -> bool:
        """Whether it goes on for as long as the run."""
        own = self.course or self.behaviour or self.loiter
        return own is not None and own.until is None and own.lasting is None

    @property
    def begins(self) -> bool:
        """Whether it says where it begins."""
        return self.course is None and self.behaviour is None and self.loiter is None

    @model_validator(mode="after")
    def one_kind(self) -> "PhaseTable":
        """Refuse none or two kinds."""
        fields.one_of(self, LAWS)
        return self

    def phase(self, start: np.datetime64, end: np.datetime64, folder: Path) -> Phase:
        """Return the record."""
        phase: Phase = getattr(self, self.kind).phase(start, end, folder)
        return phase


class DistressTable(fields.Table):
    """When a target that is under way goes adrift: between two times, at a rate, or after a part of its way."""

    between: Time | None = None
    rate: Annotated[float, BeforeValidator(fields.rate)] | None = None
    part: Parts | None = None

    @model_validator(mode="after")
    def one_law(self) -> "DistressTable":
        """Refuse none or two laws."""
        fields.one_of(self, ("between", "rate", "part"))
        return self

    def distress(self, phases: tuple[Phase, ...], start: np.datetime64) -> Distress:
        """Return the record."""
        if self.rate is not None:
            return Rate(self.rate)
        if self.part is not None:
            first = phases[0]
            if not isinstance(first, Ways) or first.points[-1].time is not None:
                raise ValueError("part is that of a voyage or a route along lanes; give between or rate")
            return Part(self.part)
        assert self.between is not None
        return Between(*_start(self.between, start))


class VesselTable(fields.Table):
    """What a target is like while it is under way."""

    search_object: SearchObject | None = None
    land: Literal["refuse", "stop", "ignore"] = "refuse"
    currents: Literal["compensated", "felt"] = "compensated"
