"""Records of a search: sorties, contacts, sensors, and search units to plan for.

The engine takes these. All values are SI and UTC. Positions are in degrees; longitudes along one
shape run on without a jump. Values that depend on the search object have one entry per scenario, in
the order of the case.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drift.engine.motion.objects.leeway import Drifter
from drift.evidence.sensors.records import Sensor
from geo.polyline import Area, Legs

# what changes weights
Kind = Literal["sortie", "contact", "look", "presence", "barrier", "overdue"]


@dataclass(frozen=True)
class Law:
    """A detection function: the probability that a sweep detects an object that it passes.

    Koopman 1980, Search and Screening; docs/searches.md.
    """

    kind: str = "inverse_cube"  # an entry of drift.evidence.filter.detection.laws.LAWS
    beta: float = 1.0  # m_beta: probability of detection within M = W / (2 beta)
    ranges: tuple[float, ...] = ()  # lateral ranges of a curve [m], ascending from 0
    chances: tuple[float, ...] = ()  # POD there; linear in between, 0 beyond


@dataclass(frozen=True)
class Watch:
    """A sensor that detects in zones of range: radar, or passive sonar with convergence zones.

    An object that stays in a zone for the whole watch is detected with the POD of the zone. The
    hazard is constant in time.
    """

    inner: tuple[float, ...]  # [m]
    outer: tuple[float, ...]
    pod: tuple[float, ...]  # probability of detection in each zone, in (0, 1]; without overlaps


@dataclass(frozen=True)
class Sortie:
    """One search that found nothing: an area with a coverage, legs, or a watch along legs."""

    name: str
    kind: str  # kind of unit, as in the sweep width tables; "" if not given
    start: np.datetime64
    end: np.datetime64
    law: Law
    sweep_width: tuple[float, ...]  # [m], one per scenario; 0: its object cannot be detected
    # shape of the gamma distribution (mean 1) of the unknown factor of W; inf: W is known
    shape: float = math.inf
    group: str = ""  # sorties of one group share that factor
    # the area that it searched; with legs, the area that counts as searched
    area: Area | None = None
    coverage: tuple[float, ...] = ()  # C = W v t / A, one per scenario; only of areas without legs
    legs: Legs | None = None  # tracks made good; of a watch, the track of its sensor
    watch: Watch | None = None
    sensor: Sensor | None = None  # a sensor of the case that watches, instead of zones
    # numbers of the beams of its array that were processed, from 0; (): all
    beams: tuple[int, ...] = ()
    completed: float = 1.0  # share of the planned effort; legs are already cut
    ashore: bool = True  # whether it can detect stranded and grounded particles
    frame: Literal["ground", "datum"] = "ground"  # "datum": area and legs drift with a marker
    # track of the marker, if known; else the marker drifts with the water from `datum`
    marker: Legs | None = None
    datum: tuple[float, float] | None = None  # (lon, lat) [deg] where a drifting frame begins
    # Only action plans and legends use these.
    speed: float = math.nan  # [m/s]
    altitude: float = math.nan  # [m]
    spacing: float = math.nan  # [m]
    # [m], one per scenario, of objects under way; (): no scenario steers
    width_under_way: tuple[float, ...] = ()
    coverage_under_way: tuple[float, ...] = ()  # as `coverage`, of objects under way
    # sweep widths and coverages as above, of objects after change 1, 2, ... of their state; (): as
    # before the changes
    changed: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = ()
    planned: bool = False  # whether it is planned, not yet flown
    # whether every other leg, from the second on, is a cross leg, which crews do not count
    crossed: bool = False

    @property
    def watches(self) -> bool:
        """Whether it is a watch: it detects by range or position, not by sweeping."""
        return self.watch is not None or self.sensor is not None

    @property
    def status(self) -> str:
        """The word "planned" or "flown"."""
        return "planned" if self.planned else "flown"

    @property
    def search_legs(self) -> int:
        """Number of its search legs as crews count them, without cross legs."""
        return 0 if self.legs is None else sum(self.legs.searching[:: 1 + self.crossed])


@dataclass(frozen=True)
class Fix:
    """A possible position of a contact."""

    lon: float  # [deg]
    lat: float
    share: float = 1.0  # share of the probability, for positions A and B of a beacon


@dataclass(frozen=True)
class Tone:
    """A frequency that a sensor received, with the Doppler shift by source and sensor."""

    value: float  # [Hz] received
    std: float  # [Hz] standard deviation of the measurement
    source: float  # [Hz] sent
    source_std: float = 0.0  # [Hz] standard deviation of the source frequency
    sound_speed: float = 1500.0  # [m/s]
    group: str = ""  # contacts of one group heard the same source; "": no other contact did


@dataclass(frozen=True)
class Heard:
    """What a sensor of the case measured of a contact besides its bearing or range.

    The probability of detection is that of the sensor.
    """

    sensor: Sensor
    beams: tuple[int, ...] = ()  # of its array that were processed, from 0; (): all
    heading: float = 0.0  # [rad] true, of its array
    # whether the mirror image of the bearing, on the other side of the array, is as likely
    mirrored: bool = False
    # received level, and the standard deviation of its error [dB]
    level: tuple[float, float] | None = None
    tone: Tone | None = None
    velocity: tuple[float, float] = (0.0, 0.0)  # (east, north) [m/s] of the sensor


@dataclass(frozen=True)
class Contact:
    """A sighting or detection, which gives a likelihood of the object's position.

    It is by fixes, a bearing, a range or an area.
    """

    name: str
    time: np.datetime64
    kind: str  # an entry of drift.evidence.filter.contacts.LIKELIHOODS
    # With N the density of the observation, the likelihood is belief N / E[N] + 1 - belief, or
    # N + false_density.
    belief: float = 1.0  # probability that it is of the object
    # density of false contacts [1/m2] (range: [1/m], bearing: [1/rad]); belief is then 1
    false_density: float = 0.0
    fixes: tuple[Fix, ...] = ()
    major: float = 0.0  # [m] standard deviation along the major axis
    minor: float = 0.0
    orientation: float = 0.0  # [rad] of the major axis, clockwise from north
    # (lon, lat) [deg] from which bearing and range were taken
    sensor: tuple[float, float] | None = None
    bearing: float = 0.0  # [rad] true
    bearing_std: float = 0.0  # of a wedge 0
    bearing_stds: tuple[
        tuple[float, float], ...
    ] = ()  # relative bearing of the object, 0 to pi, and the error there [rad]; (): the same
    wedge: float = 0.0  # [rad] width within which all errors are as likely; 0: they are normal
    range: float = 0.0  # [m]
    range_std: float = 0.0
    near: float = 0.0  # [m]; the object of a bearing is between near and far
    far: float = math.inf
    zones: Watch | None = None  # probability of detection by range; None: the same at all ranges
    # measurement by a sensor of the case, whose probability of detection replaces `zones`
    heard: Heard | None = None
    area: Area | None = None
    drifter: Drifter | None = None  # leeway class of debris; None: the contact is the object itself
    # whether particles may be guided toward it, if it is debris: drift.evidence.filter.debris.guide
    guide: bool = True
    course: float = 0.0  # [rad] observed course over ground, clockwise from north
    course_std: float = 0.0  # 0: no course was observed
    speed: float = 0.0  # [m/s] over ground
    speed_std: float = 0.0  # 0: no speed was observed
    state: str = ""  # name of the state in which the object was seen; "": not observed

    @property
    def moves(self) -> bool:
        """Whether its course or speed was observed."""
        return self.course_std > 0 or self.speed_std > 0


@dataclass(frozen=True)
class Field:
    """A box or a circle about a position, in the tangent plane there."""

    lon: float  # [deg]
    lat: float
    radius: float = 0.0  # [m] of a circle; 0: it is a box
    width: float = 0.0  # [m] of a box, east to west before it is turned
    height: float = 0.0
    turned: float = 0.0  # [rad] clockwise


@dataclass(frozen=True)
class Sight:
    """The probability of detection of a look by distance, in units of the field's half size.

    A distance of 1 is the edge of the field.
    """

    kind: str = "cookie_cutter"  # an entry of drift.evidence.filter.detection.looks.SIGHTS
    number: float = 1.0  # alpha of linear, beta of exponential
    distances: tuple[float, ...] = ()  # of a table, ascending from 0
    chances: tuple[float, ...] = ()  # POD there; linear in between, 0 beyond


@dataclass(frozen=True)
class Look:
    """A look at a field, or around a sensor, at one time, with or without a detection."""

    name: str
    time: np.datetime64
    field: Field | None  # None: `sensor` determines the probability of detection
    positive: bool
    sight: Sight = Sight()
    false_alarms: float = 0.0  # probability of a detection without an object
    sensor: Sensor | None = None
    beams: tuple[int, ...] = ()  # of its array that were processed, from 0; (): all
    place: tuple[float, float] | None = None  # (lon, lat) [deg] of the sensor
    heading: float = 0.0  # [rad] true, of its array


@dataclass(frozen=True)
class Presence:
    """A field that a sensor monitored for some time, and its report."""

    name: str
    start: np.datetime64
    end: np.datetime64
    field: Field
    present: Literal["throughout", "sometime", "never"]  # reported presence of the object
    detection: float = 1.0  # probability of reporting a true presence
    false_alarms: float = 0.0  # probability of reporting a presence otherwise


@dataclass(frozen=True)
class Barrier:
    """A line that is watched for some time, and detects an object that touches it at most once."""

    name: str
    start: np.datetime64
    end: np.datetime64
    # (lon, lat) [deg], two or more, great circles between them
    points: tuple[tuple[float, float], ...]
    detection: float
    reported: np.datetime64 | None = None  # time of the reported crossing; None: no report
    error: float = 0.0  # [s] standard deviation of that time
    false_rate: float = 0.0  # of false reports [1/s]


@dataclass(frozen=True)
class Line:
    """A line whose first crossing is reported; it changes no weights."""

    name: str
    points: tuple[tuple[float, float], ...]  # as of a barrier


@dataclass(frozen=True)
class Sensors:
    """Evidence besides sorties and contacts, and lines whose crossings are reported."""

    looks: tuple[Look, ...] = ()  # by time
    presences: tuple[Presence, ...] = ()
    barriers: tuple[Barrier, ...] = ()
    lines: tuple[Line, ...] = ()

    @property
    def telling(self) -> tuple[Look | Presence | Barrier, ...]:
        """The sensors that change weights."""
        return (*self.looks, *self.presences, *self.barriers)

    @property
    def times(self) -> list[np.datetime64]:
        """The times at which a sensor begins, ends or looks."""
        lasting: list[Presence | Barrier] = [*self.presences, *self.barriers]
        return [look.time for look in self.looks] + [
            time for what in lasting for time in (what.start, what.end)
        ]


NO_SENSORS = Sensors()


@dataclass(frozen=True)
class Unit:
    """A search unit that a plan may send."""

    name: str
    kind: str
    base: tuple[float, float]  # (lon, lat) [deg]
    return_to: tuple[float, float]
    ready: np.datetime64
    search_speed: float  # [m/s]
    transit_speed: float
    endurance: float  # [s] on scene; 85 % of it is search
    law: Law
    sweep_width: tuple[float, ...]  # [m], one per scenario
    shape: float = math.inf
    group: str = ""
    altitude: float = math.nan  # [m]
    daylight: bool = True  # searches by daylight only
    turnaround: float = 7200.0  # [s] on the ground between sorties
    least_spacing: float = 0.0  # [m]
    clear_of_land: float = 0.0  # [m] least distance of a boat from the shore
    draught: float = 0.0  # [m] of a boat, where depths are known
    # [m], one per scenario, of objects under way; (): no scenario steers
    width_under_way: tuple[float, ...] = ()

    @property
    def afloat(self) -> bool:
        """Whether it goes by sea; a unit of any other kind than "Boat" flies, over land too."""
        return self.kind == "Boat"


@dataclass(frozen=True)
class PlanSpec:
    """The settings of a plan."""

    begin: np.datetime64  # nothing is flown before
    until: np.datetime64  # everything is flown by then
    objective: Literal["pos", "alive"] = "pos"
    separation: float = 0.0  # [m] between areas that are searched at the same time
    rounds: int = 1  # sorties of each unit, each planned given that those before fail
    # particles on which the plan is optimized; it is scored on those of the case
    particles: int = 40_000
    ashore: bool = False  # whether its units search for stranded particles too


@dataclass(frozen=True)
class Resampling:
    """When and how particles are resampled in proportion to their weights."""

    method: Literal["systematic", "kahn", "duplicates", "position", "course", "combined"] = (
        "systematic"
    )
    # share of the particles; with fewer effective particles, or survivors, they are resampled;
    # 0: never
    below: float = 0.0
    across: bool = False  # whether slots may move between scenarios; else each keeps its number
    bulk: float = (
        # share of survivors below which a contact repopulates particles, and without a contact the
        # track is lost; 0: never
        0.0
    )
    fastest: float = 0.0  # [m/s] highest speed of repopulated particles

    @property
    def fills(self) -> bool:
        """Whether contacts repopulate particles."""
        return self.bulk > 0
