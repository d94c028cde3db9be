"""Itineraries of steering targets: the route, phase by phase, and the time of distress.

Records are in SI, radians and UTC. A phase leads along way points (a voyage, a track, lanes, a
bridge), keeps a course, changes course at random times, or loiters.
drift.engine.motion.steering.itinerary_tables converts the itineraries of a run for
kernels.steering.itinerary.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from drift.engine.motion.steering.lanes import Network, Route
from geo import sphere
from geo.array import Array
from geo.notation import NMI

PIECE = 50_000.0  # [m] spacing of points along great circles for their extent


@dataclass(frozen=True)
class Spread:
    """An uncertain number: a truncated triangle (Richardson et al. 2003, section 4.2).

    ratio: the density at the mode over that at both ends; 1 is a uniform law.
    """

    low: float
    high: float
    mode: float
    ratio: float = 1.0

    @property
    def mean(self) -> float:
        """Its expectation."""
        flat = 2 / (1 + self.ratio)
        return (
            flat * (self.low + self.high) / 2 + (1 - flat) * (self.low + self.high + self.mode) / 3
        )


NONE = Spread(0.0, 0.0, 0.0)  # certainly nothing


@dataclass(frozen=True)
class Near:
    """A normally distributed place; it may be correlated with the deviation from the way point
    before.
    """

    lon: float  # [rad]
    lat: float
    major: float = 0.0  # [m] standard deviation along the major axis
    minor: float = 0.0
    orientation: float = 0.0  # [rad] of the major axis, clockwise from north
    # How much of the deviation from the way point before it has, on average: east of east, east of
    # north, north of east, north of north; major and minor are then those about that average.
    follows: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class InBox:
    """A place uniform in a rectangle about a position."""

    lon: float  # [rad] of its middle
    lat: float
    length: float  # [m] along `orientation`
    width: float  # [m] across
    orientation: float = 0.0  # [rad] clockwise from north


@dataclass(frozen=True)
class InDisc:
    """A place uniform in a circle about a position."""

    lon: float  # [rad]
    lat: float
    radius: float  # [m]


@dataclass(frozen=True)
class InRing:
    """A place uniform in a polygon whose edges are straight in longitude and latitude."""

    lon: tuple[float, ...]  # [rad] unwrapped: without jumps
    lat: tuple[float, ...]


@dataclass(frozen=True)
class Abeam:
    """A place to the side of a route's centre line; a target keeps its side for the whole route.

    See drift.engine.motion.steering.lanes.
    """

    lon: float  # [rad] on the centre line
    lat: float
    half: float  # [m] farthest off it, or the standard deviation
    toward: float  # [rad] direction of the displacement to starboard
    law: Literal["uniform", "normal"] = "uniform"


Place: TypeAlias = Near | InBox | InDisc | InRing | Abeam


@dataclass(frozen=True)
class Moment:
    """An uncertain time after the start of a phase."""

    mean: float  # [s]
    std: float  # [s] of a normal law


@dataclass(frozen=True)
class WayPoint:
    """A place to reach, at a time after the phase's start or as the speed of advance determines."""

    place: Place
    # [s after the phase's start]; None: by the speed of advance
    time: Spread | Moment | None = None
    distance: float = 0.0  # [m] from the way point before, for the speed of advance


@dataclass(frozen=True)
class Lanes:
    """The lanes that a phase follows: the network reduced to these lanes, and the route
    along them.
    """

    network: Network
    route: Route


@dataclass(frozen=True)
class Ways:
    """A phase along way points; the target begins at the first way point of its first phase."""

    points: tuple[WayPoint, ...]
    start: np.datetime64  # earliest start
    after: Spread = NONE  # [s] from there to the start
    # alternatives for the last way point, with their probabilities
    destinations: tuple[tuple[WayPoint, float], ...] = ()
    speed: Spread = NONE  # [m/s] of advance, where way points have no times
    k: float = 0.0  # [m/sqrt(s)] of the Brownian bridges between way points
    k_spread: float = 0.0  # standard deviation of the logarithm of k
    slowest: float = 0.0  # [m/s] made good between way points that have times
    fastest: float = np.inf
    lanes: Lanes | None = None  # the lanes followed; None: none


@dataclass(frozen=True)
class Course:
    """A phase on a constant course, or on one that changes at exponentially distributed times."""

    course: Spread  # [rad] clockwise from north; high may be beyond a turn
    speed: Spread  # [m/s]
    change: float = 0.0  # [s] mean time between changes; 0: it keeps its course
    until: np.datetime64 | None = None
    lasting: float = np.inf  # [s] at most


@dataclass(frozen=True)
class Loiter:
    """A phase of legs back and forth inside a polygon."""

    ring: InRing
    speed: Spread  # [m/s]
    leg: float  # [m] mean length
    until: np.datetime64 | None = None
    lasting: float = np.inf  # [s] at most


@dataclass(frozen=True)
class Followed:
    """The track of a tracker: great circles between vertices; it does not move before and after
    them.
    """

    begin: np.datetime64
    time: tuple[float, ...]  # [s after the begin] ascending
    lon: tuple[float, ...]  # [rad]
    lat: tuple[float, ...]


@dataclass(frozen=True)
class Acts:
    """A phase that keeps a course and at random times changes it, or seeks or evades a tracker."""

    course: Spread  # [rad] of the first course
    speed: Spread  # [m/s] of the first speed
    fastest: float  # [m/s] later speeds are uniform from 0 to this
    between: tuple[float, float]  # [s] least and longest time between acts
    change: float = 0.0  # probability that it takes any other course and speed when it acts
    seek: float = 0.0  # probability that it seeks the tracker from then on
    hide: float = 0.0  # probability that it evades the tracker from then on
    leave: float = 0.0  # probability that it stops seeking or evading
    spread: float = np.pi / 6  # [rad] on either side of the reciprocal bearing on which it flees
    tracker: Followed | None = None  # None: no tracker to seek or evade
    until: np.datetime64 | None = None
    lasting: float = np.inf  # [s] at most


Phase: TypeAlias = Ways | Course | Acts | Loiter


@dataclass(frozen=True)
class Between:
    """Distress at a random time after an earliest one."""

    earliest: np.datetime64
    after: Spread  # [s]


@dataclass(frozen=True)
class Rate:
    """Distress at a constant rate after departure."""

    rate: float  # [1/s]


@dataclass(frozen=True)
class Part:
    """Distress after a part of the voyage, whatever its speed."""

    part: Spread  # 0 to 1


Distress: TypeAlias = Between | Rate | Part


@dataclass(frozen=True)
class Itinerary:
    """The plan of a target: consecutive phases, ended by its distress if that occurs."""

    phases: tuple[Phase, ...]
    distress: Distress | None = None  # None: it never goes adrift
    overdue: np.datetime64 | None = None  # from then on a target in port is not the missing one
    land: Literal["refuse", "stop", "ignore"] = "refuse"
    # what sorties look for while it is under way, in the sweep width tables
    search_object: str | None = None
    # Whether it compensates the current, or steers by dead reckoning and is set off its track.
    currents: Literal["compensated", "felt"] = "compensated"
    # [m] from its last way point within which a target that has arrived is in port
    arrival_radius: float = 10 * NMI

    @property
    def fastest(self) -> float:
        """Highest speed [m/s] on a course; the extent of way points and polygons needs no speed."""
        return max(
            (_pace(phase) for phase in self.phases if isinstance(phase, Course | Acts)), default=0.0
        )

    @property
    def pace(self) -> float:
        """Highest speed [m/s] through the water, from the middles of way points that have times."""
        return max(_pace(phase) for phase in self.phases)

    @property
    def ways(self) -> list[tuple[Array, Array]]:
        """The lines (lon, lat) [rad] along its way points."""
        return [line for phase in self.phases if isinstance(phase, Ways) for line in _lines(phase)]

    @property
    def rings(self) -> list[InRing]:
        """The polygons in which it loiters."""
        return [phase.ring for phase in self.phases if isinstance(phase, Loiter)]

    @property
    def places(self) -> list[tuple[Place, float]]:
        """Its way points off lanes and voyages, each with the probability of being visited."""
        return [
            (point.place, probability)
            for phase in self.phases
            if isinstance(phase, Ways)
            for point, probability in (
                *((point, 1.0) for point in phase.points),
                *phase.destinations,
            )
            if not isinstance(point.place, Abeam)
        ]

    def extents(self, spreads: float) -> list[tuple[Array, Array, float]]:
        """Return places (lon, lat) [rad], unwrapped, of each phase, and how far [m] from them it
        may lead.

        spreads: number of standard deviations to allow for. Great circles between way points are
        sampled, because they bulge.
        """
        found = []
        for phase in self.phases:
            if isinstance(phase, Ways):
                found.append(_ways_extent(phase, spreads))
            elif isinstance(phase, Loiter):
                found.append((np.array(phase.ring.lon), np.array(phase.ring.lat), 0.0))
        return found


def _pace(phase: Phase) -> float:
    if isinstance(phase, Acts):
        return max(phase.fastest, phase.speed.high)
    if not isinstance(phase, Ways) or phase.speed.high > 0:
        return phase.speed.high
    if phase.fastest < np.inf:
        return phase.fastest
    lon, lat = np.array([middle(point.place) for point in phase.points]).T
    time = np.array([latest(point.time, 0.0) for point in phase.points])
    return float(
        (
            sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]) / np.maximum(np.diff(time), 1.0)
        ).max(initial=0.0)
    )


def _lines(phase: Ways) -> list[tuple[Array, Array]]:
    """Return the great circles between the middles of a phase's way points (lon, lat) [rad],
    unwrapped.
    """
    points = [*phase.points, *(point for point, _ in phase.destinations)]
    lon, lat = np.array([middle(point.place) for point in points]).T
    common = len(phase.points)
    ways = [np.arange(common), *(np.array([common - 1, k]) for k in range(common, len(points)))]
    lines = [
        sphere.track(lon[way], lat[way], PIECE)
        for way in ways
        if way.size > 1 or common == len(points)
    ]
    return [(np.unwrap(x), y) for x, y in lines]


def _ways_extent(phase: Ways, spreads: float) -> tuple[Array, Array, float]:
    points = [*phase.points, *(point for point, _ in phase.destinations)]
    lon, lat = (np.concatenate(parts) for parts in zip(*_lines(phase), strict=True))
    wide = max(radius(point.place, spreads) for point in points)
    # A bridge is widest midway, K sqrt(T) / 2, where nothing but T bounds the time between two way
    # points.
    lasting = phase.after.high + max((latest(point.time, spreads) for point in points), default=0.0)
    k = phase.k * np.exp(spreads * phase.k_spread)
    return np.unwrap(lon), lat, float(wide + spreads * k * np.sqrt(max(lasting, 0.0)) / 2)


def middle(place: Place) -> tuple[float, float]:
    """Return the middle (lon, lat) [rad] of a place's distribution."""
    if isinstance(place, InRing):
        return (min(place.lon) + max(place.lon)) / 2, (min(place.lat) + max(place.lat)) / 2
    return place.lon, place.lat


def radius(place: Place, spreads: float) -> float:
    """Return how far from its middle [m] a place may be; spreads: number of standard deviations
    that count.
    """
    match place:
        case Near():
            return spreads * place.major
        case InBox():
            return float(np.hypot(place.length, place.width)) / 2
        case InDisc():
            return place.radius
        case Abeam():
            return place.half * (1.0 if place.law == "uniform" else spreads)
        case InRing():
            lon, lat = middle(place)
            return float(sphere.distance(lon, lat, np.array(place.lon), np.array(place.lat)).max())


def latest(time: Spread | Moment | None, spreads: float) -> float:
    """Return the latest time [s] of a distribution.

    spreads: number of standard deviations to allow for; below 0 for the earliest time.
    """
    match time:
        case Spread():
            return time.high if spreads >= 0 else time.low
        case Moment():
            return time.mean + spreads * time.std
    return 0.0


def unsettled(itinerary: Itinerary) -> str:
    """Return why the track of a target is not known at its departure; "": it is known.

    Distress after a part of the voyage comes in the first phase, and only that one counts.
    """
    if itinerary.currents == "felt":
        return "vessel.currents is felt: the current sets it off its track"
    phases = itinerary.phases[: 1 if isinstance(itinerary.distress, Part) else None]
    for number, phase in enumerate(phases, 1):
        match phase:
            case Loiter():
                return f"phase {number} loiters"
            case Acts():
                return f"phase {number} acts at random times"
            case Course(change=change) if change > 0:
                return f"phase {number} changes its course at random times"
            case Ways(k=k) if k > 0:
                return f"phase {number} is a Brownian bridge"
            case Ways():
                begins = 1 if number == 1 else 0  # where and when it begins is drawn at birth
                ends = [point for point, _ in phase.destinations]
                if any(_drawn_later(point) for point in (*phase.points[begins:], *ends)):
                    return f"phase {number} has a way point of uncertain place or time"
    return ""


def _drawn_later(point: WayPoint) -> bool:
    """Return whether the place or the time of a way point is drawn as the target makes for it."""
    sure = isinstance(point.place, Abeam) or (
        isinstance(point.place, Near) and point.place.major == 0
    )
    match point.time:
        case Spread(low, high):
            return not sure or high > low
        case Moment(std=std):
            return not sure or std > 0
    return not sure
