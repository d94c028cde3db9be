"""Records of a search: what was looked for where and how, what was seen, and what can be sent next.

The engine takes these. All is SI and UTC; positions are degrees, their longitudes running on along one shape. What
depends on the object looked for has one entry a scenario, in the order of the case.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drift.motion.leeway import Drifter
from geo.polyline import Area, Legs


@dataclass(frozen=True)
class Law:
    """How likely a sweep detects what it passes (Koopman 1980, Search and Screening; SEARCH.md)."""

    kind: str = "inverse_cube"  # an entry of drift.search.laws.LAWS
    beta: float = 1.0  # m_beta: chance of detection within M = W / (2 beta)
    ranges: tuple[float, ...] = ()  # curve: lateral ranges [m], ascending from 0
    chances: tuple[float, ...] = ()  # and the chance of detection there, straight in between, none beyond


@dataclass(frozen=True)
class Watch:
    """A sensor that sees in zones of range: radar, or passive sonar with convergence zones.

    An object that stays in a zone for the whole watch is detected with its chance; time adds up as a constant hazard.
    """

    inner: tuple[float, ...]  # [m]
    outer: tuple[float, ...]
    pod: tuple[float, ...]  # in (0, 1]; zones do not overlap; nothing outside


@dataclass(frozen=True)
class Sortie:
    """One search that found nothing. It has an area with a coverage, or legs, or a watch along its legs."""

    name: str
    kind: str  # of unit, as in the sweep width tables; "" if not told
    start: np.datetime64
    end: np.datetime64
    law: Law
    sweep_width: tuple[float, ...]  # [m], one a scenario; 0: its object is not seen
    shape: float = math.inf  # of the gamma distribution, of mean 1, of the unknown factor of W; inf: W is known
    group: str = ""  # sorties of one group share that factor
    area: Area | None = None  # where; with legs it only says what counts as searched
    coverage: tuple[float, ...] = ()  # C = W v t / A, one a scenario: an area without legs
    legs: Legs | None = None  # tracks that were made good; of a watch: where its sensor was
    watch: Watch | None = None
    completed: float = 1.0  # share of the effort that was spent; legs are cut already
    frame: Literal["ground", "datum"] = "ground"  # datum: area and legs drift with a marker
    marker: Legs | None = None  # where the marker was, if that is known; else it drifts as water does from `datum`
    datum: tuple[float, float] | None = None  # (lon, lat) [deg] where a drifting frame begins
    # For action plans and legends only:
    speed: float = math.nan  # [m/s]
    altitude: float = math.nan  # [m]
    spacing: float = math.nan  # [m]


@dataclass(frozen=True)
class Fix:
    """A position that a contact may be at."""

    lon: float  # [deg]
    lat: float
    share: float = 1.0  # of the contact's probability: fixes A and B of a beacon


@dataclass(frozen=True)
class Contact:
    """Something seen: a likelihood of where the object was. Exactly one of fixes, bearing, distance or area is given."""

    name: str
    time: np.datetime64
    kind: str  # an entry of drift.search.contacts.LIKELIHOODS
    belief: float = 1.0  # that it is ours: belief N / E[N] + 1 - belief
    false_density: float = (
        0.0  # [1/m2] (range: [1/m], bearing: [1/rad]) of false contacts: N + false_density; then belief is 1
    )
    fixes: tuple[Fix, ...] = ()
    major: float = 0.0  # [m] standard deviation along the major axis
    minor: float = 0.0
    orientation: float = 0.0  # [rad] of the major axis, clockwise from north
    sensor: tuple[float, float] | None = None  # (lon, lat) [deg] that bearing and range are from
    bearing: float = 0.0  # [rad] true
    bearing_std: float = 0.0
    range: float = 0.0  # [m]
    range_std: float = 0.0
    near: float = 0.0  # [m] a bearing's object is between these ranges
    far: float = math.inf
    zones: Watch | None = None  # chance of detection by range; None: the same at all
    area: Area | None = None
    drifter: Drifter | None = None  # debris, which drifts by this class; None: the object itself


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
    sweep_width: tuple[float, ...]  # [m], one a scenario
    shape: float = math.inf
    group: str = ""
    altitude: float = math.nan  # [m]
    daylight: bool = True  # searches by daylight only
    turnaround: float = 7200.0  # [s] on the ground between sorties
    least_spacing: float = 0.0  # [m]
    clear_of_land: float = 0.0  # [m] that a boat keeps from the shore
    draught: float = 0.0  # [m] of a boat, where depths are known

    @property
    def afloat(self) -> bool:
        """Whether it goes by sea: what flies goes straight on, and what is not said to be a boat is taken to fly."""
        return self.kind == "Boat"


@dataclass(frozen=True)
class PlanSpec:
    """What is asked of a plan."""

    begin: np.datetime64  # nothing is flown before
    until: np.datetime64  # everything is flown by then
    objective: Literal["pos", "alive"] = "pos"
    separation: float = 0.0  # [m] between areas that are searched at the same time
    rounds: int = 1  # sorties of each unit, each planned on the failure of those before
    particles: int = 40_000  # that the plan is made on; it is scored on the case's own


@dataclass(frozen=True)
class Resampling:
    """When and how particles are drawn anew in proportion to their weights."""

    method: Literal["systematic", "kahn"] = "systematic"
    below: float = 0.0  # share of the particles under which the effective ones may not fall; 0: never
