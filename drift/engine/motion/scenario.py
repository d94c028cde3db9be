"""Scenarios: hypotheses with a weight, an object, and a prior of where and when it went adrift.

Records are in SI, radians and UTC. There are four kinds of prior: around a reported position,
inside an area, along a trackline, and for spills along a track. All have the same attributes. `reported`: the reported position
[deg], or None; `moving`: whether the release position depends on the time; `extent`: how far the
prior reaches. Priors are drawn in drift.engine.motion.prior and drift.spills.worlds.releases.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np

from drift.engine.motion.objects.leeway import Drifter
from drift.engine.motion.steering.family import InFamily
from drift.engine.motion.steering.itinerary import Itinerary, Spread
from geo import sphere
from geo.array import Array
from geo.grids.grid import Grid

PIECE = 50_000.0  # [m] spacing of points along a voyage for its extent


@dataclass(frozen=True)
class Survival:
    """Survival time after release: lognormal."""

    median: float  # [s]
    spread: float  # factor of one standard deviation, > 1
    basis: str = "as the case says"  # source of the median

    def alive(self, age: Array) -> Array:
        """Return the probability of being alive at an age [s]."""
        from scipy import special

        z = np.log(np.maximum(age, 1e-9) / self.median) / math.log(self.spread)
        return np.asarray(0.5 * special.erfc(z / math.sqrt(2)))


# [1/s] 4 % an hour (Allen 2005, CG-D-05-05; Breivik and Allen 2008, section 2.3)
JIBE_RATE = 0.04 / 3600


UNCHANGED = "unchanged"  # name of the state of an object as it went adrift


@dataclass(frozen=True)
class Change:
    """A change of an object's state while it is adrift (docs/changes.md).

    State 0 is the object as it went adrift, state k + 1 what change k of the scenario leads to. The
    change comes at a rate, by the wind, or at a time.
    """

    name: str  # of the state that it leads to
    leaves: tuple[int, ...]  # the states in which it may come
    rate: float = 0.0  # [1/s]; with `wind`, in winds far above it
    # wind [m/s] at which half of the rate holds, and the width [m/s] of the rise
    wind: tuple[float, float] | None = None
    # its time [s], in place of a rate: after the run's start, or after the state began
    time: Spread | None = None
    after: bool = False
    object: Drifter | None = None  # what drifts then; None: a share of the leeway that it had
    leeway: float = 1.0  # that share
    sinks: bool = False
    search_object: str | None = None  # its name in the sweep width tables; None: as before
    survival: Survival | None = None  # from the change on; None: as before

    @property
    def memoryless(self) -> bool:
        """Whether copies of a particle may draw their own wait: it comes at a rate."""
        return self.time is None


@dataclass(frozen=True)
class Displacement:
    """A move from the reported position before the object drifts, uniform in distance and in
    direction.
    """

    distance: tuple[float, float]  # [m]
    # [rad] toward, clockwise from north; second >= first, up to 2 turns
    direction: tuple[float, float]


@dataclass(frozen=True)
class PositionPrior:
    """A normal distribution in the tangent plane of a position, wrapped onto the sphere.

    The release time is uniform in a window.
    """

    moving: ClassVar = False

    lon: float  # [rad]
    lat: float
    major: float  # [m] standard deviation along the major axis
    minor: float
    orientation: float  # [rad] of the major axis, clockwise from north
    displacement: Displacement | None
    release_start: np.datetime64  # the earlier, also in a backward run
    release_end: np.datetime64

    @property
    def reported(self) -> tuple[float, float] | None:
        """Position (lon, lat) [deg]."""
        return float(np.degrees(self.lon)), float(np.degrees(self.lat))

    def extent(self, spreads: float) -> tuple[Array, Array, float]:
        """Return places (lon, lat) [rad], unwrapped, and how far from them [m] the prior reaches.

        spreads: number of standard deviations to allow for.
        """
        far = self.displacement.distance[1] if self.displacement else 0.0
        return np.array([self.lon]), np.array([self.lat]), spreads * self.major + far


@dataclass(frozen=True)
class AreaPrior:
    """Uniform in true area inside a polygon whose edges are straight in longitude and latitude."""

    reported: ClassVar[tuple[float, float] | None] = None
    moving: ClassVar = False

    lon: tuple[float, ...]  # [rad] unwrapped: without jumps, so it may leave [-pi, pi]
    lat: tuple[float, ...]
    release_start: np.datetime64
    release_end: np.datetime64

    def extent(self, spreads: float) -> tuple[Array, Array, float]:
        """Return the polygon's corners in the format of PositionPrior.extent; nothing lies outside
        them.
        """
        return np.array(self.lon), np.array(self.lat), 0.0


@dataclass(frozen=True, eq=False)
class Hazard:
    """How likely distress is at a place and time, compared with others.

    It is 1 / (1 + exp((W - w) / width)) in a wind w, with W and width in `wind`; or the value of a
    field; or, of a field of depths, 1 in water less deep than `depth`, and `deeper` elsewhere.
    """

    wind: tuple[float, float] | None = None  # [m/s]
    name: str = ""  # of the field, for messages
    grid: Grid | None = None
    values: Array | None = None  # (t, nlat, nlon), at least 0; depths [m]. NaN: no value
    times: Array | None = None  # UTC (t,) ascending; empty: always the same
    depth: float | None = None  # [m]
    deeper: float = 0.0
    outside: float | None = None  # where and when the field has no value; None: that is rejected


@dataclass(frozen=True, eq=False)
class Tilt:
    """A hazard along a voyage as kernels.step.prior.draw_trackline takes it; all float32."""

    law: Array  # (n + 1,)
    proposed: Array  # (n + 1,)
    most: Array  # (n,)
    hazard: Array  # ((n + 1) * ACROSS,)


@dataclass(frozen=True)
class TracklinePrior:
    """Along great-circle legs at constant speed, with cross-track error.

    The object goes adrift at an unknown share of the voyage, uniform in [low, high], or triangular
    there with its peak at `mode`. With a tilt, that density is multiplied by a hazard.
    """

    reported: ClassVar[tuple[float, float] | None] = None
    moving: ClassVar = True

    lon: tuple[float, ...]  # [rad]
    lat: tuple[float, ...]
    cross_track: float  # [m] standard deviation
    departure: np.datetime64
    arrival: np.datetime64
    speed: float  # [m/s]
    low: float
    high: float
    mode: float | None
    release_start: np.datetime64
    release_end: np.datetime64
    tilt: Tilt | None = None

    def extent(self, spreads: float) -> tuple[Array, Array, float]:
        """Return places along the voyage in the format of PositionPrior.extent."""
        lon, lat = sphere.track(self.lon, self.lat, PIECE)
        return np.unwrap(lon), lat, spreads * self.cross_track


@dataclass(frozen=True)
class Loss:
    """An interval in which objects go overboard: begin and length uniform, each in a range."""

    begin: tuple[np.datetime64, np.datetime64]  # earliest and latest
    length: tuple[float, float]  # [s]
    share: float  # of the objects

    @property
    def end(self) -> np.datetime64:
        """The latest end."""
        return self.begin[1] + np.timedelta64(math.ceil(self.length[1]), "s")


@dataclass(frozen=True)
class TrackPrior:
    """Along a ship's known track: the objects of a world go overboard for hours, one by one."""

    reported: ClassVar[tuple[float, float] | None] = None
    moving: ClassVar = True

    lon: tuple[float, ...]  # [rad]
    lat: tuple[float, ...]
    time: tuple[int, ...]  # [s since 1970] at these points by the ship's clock
    losses: tuple[Loss, ...]
    clock_error: float  # [s] the ship's clock is at most so much wrong, uniform
    release_start: np.datetime64
    release_end: np.datetime64

    def extent(self, spreads: float) -> tuple[Array, Array, float]:
        """Return places along the track in the format of PositionPrior.extent; all of the track,
        so nothing lies off it.
        """
        lon, lat = sphere.track(self.lon, self.lat, PIECE)
        return np.unwrap(lon), lat, 0.0


ReleasePrior: TypeAlias = PositionPrior | AreaPrior | TracklinePrior | TrackPrior


@dataclass(frozen=True)
class Scenario:
    """One scenario; the weights of a case add up to 1."""

    name: str
    weight: float
    object: Drifter
    jibe_rate: float  # [1/s]
    prior: ReleasePrior | None  # where it begins; None: at the first way point of its itinerary
    sources: Mapping[str, tuple[str, ...]]  # their names by quantity, in order of priority
    search_object: str | None = None  # the object's name in the sweep width tables
    model: str = "drift"  # model of motion: drift.engine.motion.models.by_name
    motion: Any = None  # parameters that only the model reads
    survival: Survival | None = None
    # how it steers until its distress; None: it is adrift from the start
    itinerary: Itinerary | None = None
    family: InFamily | None = None  # its position in a family; None: it has none
    # Source level for passive sonar [dB re 1 uPa at 1 m], or rows of speed [m/s] and level;
    # None: not stated.
    source_level: float | tuple[tuple[float, float], ...] | None = None
    changes: tuple[Change, ...] = ()  # of its state while it is adrift
    hazard: Hazard | None = None  # of distress along its trackline; None: the same everywhere

    @property
    def objects(self) -> tuple[Drifter, ...]:
        """What drifts: its object, and what changes of state make of it."""
        return (self.object, *(one.object for one in self.changes if one.object is not None))

    @property
    def survivals(self) -> tuple[Survival | None, ...]:
        """Its survival times, then those from each of its changes on; None: as before."""
        return (self.survival, *(one.survival for one in self.changes))

    @property
    def uses_wind(self) -> bool:
        """Whether the wind moves its object in any state, changes it, or makes distress likelier."""
        by_wind = any(one.wind is not None for one in self.changes)
        by_wind |= self.hazard is not None and self.hazard.wind is not None
        return by_wind or any(drifter.uses_wind for drifter in self.objects)

    @property
    def models(self) -> tuple[str, ...]:
        """Its motion models, in the order in which they act within a step."""
        if self.itinerary is None:
            return (self.model,)
        return ("steer",) if self.itinerary.distress is None else ("steer", self.model)

    def extents(self, spreads: float) -> list[tuple[Array, Array, float]]:
        """Return the extents of its prior and of its itinerary: see PositionPrior.extent."""
        own = [self.prior.extent(spreads)] if self.prior is not None else []
        return own + (self.itinerary.extents(spreads) if self.itinerary else [])
