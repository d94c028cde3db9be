"""Records of a spill: many objects from one place, of one or several classes, and their unknowns.

All is SI and UTC. What all objects of one spill share (release, bias of windage and current, share
destroyed, sinking rate, readiness to report) is drawn once for each *world*; the objects are drawn
within it. The probability model: drift.spills.worlds.worlds, drift.spills.worlds.finds.
"""

import math
from dataclasses import dataclass

import numpy as np

from drift.engine.motion.leeway import Drifter
from drift.engine.motion.scenario import ReleasePrior

DAY = 86_400.0  # [s]
FEWEST_PARTICLES = 10  # least particles of a class in a world


@dataclass(frozen=True)
class Sinking:
    """When objects sink: by a constant hazard, or a lognormal waterlogging time; log-uniform
    between worlds.

    time: half-life of the hazard, or median waterlogging time [s], lowest and highest; spread:
    geometric standard deviation of the waterlogging time within a world, 0 for a hazard.
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
    """How soon people report an object lying ashore [1/s], by kind of shore.

    It also says how soon an object is buried or taken away.
    """

    rate: dict[str, float]
    removal: float  # [1/s]
    coast: str  # kind of all stretches that the user's file does not name
    until: np.datetime64 | None  # up to when all finds are known; None: up to the last one


@dataclass(frozen=True)
class Find:
    """An object found: where (a stretch by name, or a place [deg]), when, by whom, how surely one
    of ours.
    """

    name: str
    time: np.datetime64
    latest: bool  # found at an unknown time not later than `time`
    stretch: str | None
    lon: float  # [deg], NaN with a stretch
    lat: float
    radius: float  # [m] of the position's error; at sea
    at_sea: bool
    kind: str | None
    by: str | None  # a patrol's name; None: the public
    false: float  # probability that it is none of ours


@dataclass(frozen=True)
class Patrol:
    """A search of stretches of the beach: at a time it finds each object lying there with a
    probability.
    """

    name: str
    stretches: tuple[str, ...]
    # (lon, lat) [deg] of the piece walked
    ends: tuple[tuple[float, float], tuple[float, float]] | None
    time: np.datetime64
    detection: float


@dataclass(frozen=True)
class Team:
    """People who can patrol a length of shore once a day.

    Its fields say when, with what detection, and which stretches they can reach: those named; or
    those whose middle is within `reach` of their base over land; or, without either, all. Unless
    they cross water, all their patrols lie on one land mass.
    """

    name: str
    length: float  # [m] of shore a day
    detection: float
    times: tuple[np.datetime64, ...]  # times of its patrols
    stretches: tuple[str, ...] = ()
    base: tuple[float, float] | None = None  # (lon, lat) [deg]
    reach: float = math.inf  # [m] over land; where they cross water, straight
    crosses_water: bool = False


@dataclass(frozen=True)
class Spill:
    """A spill: its objects, the worlds that it is drawn in, and what has been found of it."""

    objects: tuple[int, int]  # number, lowest and highest; equally likely between
    kinds: tuple[Kind, ...]
    prior: ReleasePrior  # prior of a world's release
    release_std: float  # [m] standard deviation of an object's release about its world's
    release_duration: float  # [s] over which the objects of a world go adrift
    worlds: int
    per_world: int  # particles
    destroyed: tuple[float, float]  # share lost at once, uniform between
    windage_bias: float  # standard deviation of the logarithm of a factor on all leeway
    current_bias: float  # [m/s] standard deviation of an error of the current, a component
    reporting_bias: float  # standard deviation of the logarithm of a factor on all reporting rates
    redraws: int  # times that worlds may be drawn again where the finds leave too few
    stretch: float  # [m] length of a stretch of coast
    stretches: str | None  # file of named ones
    reporting: Reporting
    finds: tuple[Find, ...]
    patrols: tuple[Patrol, ...]
    teams: tuple[Team, ...] = ()  # teams that a plan may send
    # particles of each class in a world; None: by their shares
    counts: tuple[int, ...] | None = None
    bridges: tuple[
        tuple[tuple[float, float], tuple[float, float]], ...
    ] = ()  # ends (lon, lat) [deg] of what joins land

    @property
    def particles(self) -> int:
        """Particles of all worlds."""
        return self.worlds * self.per_world
