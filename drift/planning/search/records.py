"""Records of a search plan: taskings of the units, the plan's value and its upper bound."""

from dataclasses import dataclass

import numpy as np

from drift.evidence.filter.records import PlanSpec, Sortie, Unit
from drift.forecast.effective import Count
from drift.planning.search.manners import PLAIN, Manner
from geo.array import Array
from geo.polyline import LonLat


@dataclass(frozen=True)
class Tasking:
    """One sortie of a plan: a sub-area and the pattern that searches it."""

    unit: Unit
    round: int  # from 1; planned given the failure of earlier rounds
    sortie: Sortie  # as it is to be flown: its area, legs and times of search
    takeoff: np.datetime64
    on_scene: np.datetime64  # at the commence search point
    off_scene: np.datetime64
    home: np.datetime64
    centre: LonLat  # [deg] of the sub-area
    length: float  # [m] along the legs; the area is what they search after cuts at the coast
    width: float  # [m] across them
    orientation: float  # [rad] of the legs, clockwise from north
    creep: float  # [rad] direction in which parallel legs follow each other, clockwise from north
    spacing: float  # [m] between tracks; of a sector search its radius
    legs: int  # number of legs, without cross legs between parallel ones
    pos: float  # probability of success, given the failure of all earlier sorties of the plan
    # a boat's way by sea to its commence search point [deg]; (): straight from its base
    out: tuple[LonLat, ...] = ()
    back: tuple[LonLat, ...] = ()  # and from the end of its search
    # numbers of the legs, from 1, that are cut at the coast or go round land
    cut: tuple[int, ...] = ()
    swept: float = 1.0  # share of the sub-area's sea that its cut legs search
    pos_ashore: float = 0.0  # part of `pos` that is due to objects ashore at the end of the sortie
    waits: str = ""  # reason for searching later than possible
    manner: Manner = PLAIN  # pattern and its frame


@dataclass(frozen=True)
class Alternative:
    """Another plan, scored on the planning particles."""

    name: str
    value: float  # of the objective
    difference: float  # plan - alternative
    standard_error: float  # of the difference
    apart: bool = True  # whether it keeps the separation that the plan keeps

    @property
    def same(self) -> bool:
        """Whether it is equal to the plan: it finds the same share of every particle."""
        return self.difference == 0 and self.standard_error == 0


@dataclass(frozen=True)
class Plan:
    """A search plan. `value` is the objective: POS, or the probability of finding alive."""

    spec: PlanSpec
    taskings: tuple[Tasking, ...]
    value: float  # on the case's own particles, which were not used for planning
    pos: float  # on the same particles: 1 - evidence of the plan's failure
    by_scenario: Array  # (scenarios,) POS given each scenario, on the same particles
    seen: float  # value on the planning particles; the excess over `value` is optimism
    # estimated upper bound of any plan of these units, laws and times, on the planning particles
    bound: float | None
    # standard error of `bound` less `value`, which are means over different particles
    bound_error: float
    alternatives: tuple[Alternative, ...]  # scored on the planning particles, as `seen`
    scenarios: tuple[str, ...]
    families: tuple[
        str | None, ...
    ] = ()  # (scenarios,) family of each, None: of no family; (): there are no families
    shares: Array | None = None  # (scenarios,) probability of each before the plan; None: unknown
    ashore: float = 0.0  # probability that the object is ashore or aground when the plan begins
    pos_ashore: float = 0.0  # part of `pos` that is due to objects ashore as a unit passes
    idle: tuple[str, ...] = ()  # units that are not sent
    said: tuple[str, ...] = ()  # remarks on boats: ways out of harbour, boats that cannot be sent
    made_on: Count | None = None  # effective number of planning particles
    scored_on: Count | None = None  # and of the case's own particles when the plan begins
    unbounded: str = ""  # short reason why there is no bound
