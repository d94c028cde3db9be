"""Records of a spill: many objects of one or several classes, released at one place.

All values are SI and UTC. The unknowns that all objects of one spill share (release, bias of
windage and current, share destroyed, sinking rate, reporting rate) are drawn once for each *world*;
the objects are drawn within it. For the probability model see drift.spills.worlds.worlds and
drift.spills.worlds.finds.
"""

import math
from dataclasses import dataclass

import numpy as np

from drift.engine.motion.objects.leeway import Drifter
from drift.engine.motion.scenario import ReleasePrior

DAY = 86_400.0  # [s]
FEWEST_PARTICLES = 10  # fewest particles of a class in a world


@dataclass(frozen=True)
class Sinking:
    """When objects sink: with a constant hazard, or after a lognormal waterlogging time.

    time: half-life of the hazard, or median waterlogging time [s], lowest and highest; log-uniform
    between worlds. spread: geometric standard deviation of the waterlogging time within a world, 0
    for a hazard.
    """

    time: tuple[float, float]
    spread: float = 0.0


@dataclass(frozen=True)
class Kind:
    """One class of the objects spilled."""

    name: str
    share: float  # share of the objects; shares of a spill add up to 1
    object: Drifter
    jibe_rate: float  # [1/s]
    sinking: Sinking | None


@dataclass(frozen=True)
class Reporting:
    """Rates [1/s] at which people report an object lying ashore, by kind of shore.

    removal: rate at which an object is buried or taken away without a report.
    """

    rate: dict[str, float]
    removal: float  # [1/s]
    coast: str  # kind of shore of all stretches that the user's file does not name
    until: np.datetime64 | None  # time up to which all finds are known; None: the last find


@dataclass(frozen=True)
class Find:
    """An object found: place (a stretch by name, or a position [deg]), time, and who found it."""

    name: str
    time: np.datetime64
    latest: bool  # found at an unknown time not later than `time`
    stretch: str | None
    lon: float  # [deg], NaN with a stretch
    lat: float
    radius: float  # [m] standard deviation of each component of the position; at sea
    at_sea: bool
    kind: str | None
    by: str | None  # a patrol's name; None: the public
    false: float  # probability that it is not from this spill


@dataclass(frozen=True)
class Patrol:
    """A beach patrol: it finds each object lying on its stretches with a probability."""

    name: str
    stretches: tuple[str, ...]
    # (lon, lat) [deg] of both ends of the line walked
    ends: tuple[tuple[float, float], tuple[float, float]] | None
    time: np.datetime64
    detection: float


@dataclass(frozen=True)
class Team:
    """A team that can patrol a length of shore once a day.

    The stretches within its reach are those named, or those whose middle is within `reach` of its
    base over land, or, without either, all. Unless it crosses water, all its patrols lie on one
    land mass.
    """

    name: str
    length: float  # [m] of shore a day
    detection: float
    times: tuple[np.datetime64, ...]  # times of its patrols
    stretches: tuple[str, ...] = ()
    base: tuple[float, float] | None = None  # (lon, lat) [deg]
    reach: float = math.inf  # [m] over land; in a straight line if they cross water
    crosses_water: bool = False


@dataclass(frozen=True)
class Spill:
    """A spill: its objects, the prior of its worlds, and its finds and patrols."""

    objects: tuple[int, int]  # lowest and highest number; uniform between
    kinds: tuple[Kind, ...]
    prior: ReleasePrior  # prior of a world's release
    release_std: float  # [m] standard deviation of an object's release about its world's
    release_duration: float  # [s] time over which the objects of a world go adrift
    worlds: int
    per_world: int  # particles
    destroyed: tuple[float, float]  # share lost at once, uniform between
    windage_bias: float  # standard deviation of the logarithm of a factor on all leeway
    current_bias: float  # [m/s] standard deviation of each component of the current's error
    reporting_bias: float  # standard deviation of the logarithm of a factor on all reporting rates
    redraws: int  # how often worlds may be drawn again if too few are effective after the finds
    stretch: float  # [m] length of a stretch of coast
    stretches: str | None  # file of named stretches
    reporting: Reporting
    finds: tuple[Find, ...]
    patrols: tuple[Patrol, ...]
    teams: tuple[Team, ...] = ()  # teams that a plan may send
    # particles of each class in a world; None: by their shares
    counts: tuple[int, ...] | None = None
    bridges: tuple[
        tuple[tuple[float, float], tuple[float, float]], ...
    ] = ()  # ends (lon, lat) [deg] of bridges that join land masses

    @property
    def particles(self) -> int:
        """Number of particles of all worlds."""
        return self.worlds * self.per_world
