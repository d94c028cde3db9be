"""A plan: what each unit is to do next, what that is worth, and an estimated bound of any plan's
worth.
"""

from dataclasses import dataclass

import numpy as np

from drift.evidence.filter.records import PlanSpec, Sortie, Unit
from drift.forecast.effective import Count
from drift.planning.search.manners import PLAIN, Manner
from geo.array import Array
from geo.polyline import LonLat


@dataclass(frozen=True)
class Tasking:
    """One sortie of a plan: a sub-area searched by parallel tracks, an expanding square or sectors."""

    unit: Unit
    round: int  # from 1: planned on the failure of the rounds before
    sortie: Sortie  # as it is to be flown: its area, legs and times of search
    takeoff: np.datetime64
    on_scene: np.datetime64  # at the commence search point
    off_scene: np.datetime64
    home: np.datetime64
    centre: LonLat  # [deg] of the sub-area
    length: float  # [m] along the legs; of legs cut at the coast the area is what they search
    width: float  # [m] across them
    orientation: float  # [rad] of the legs, clockwise from north
    creep: float  # [rad] direction in which parallel legs follow each other, clockwise from north
    spacing: float  # [m] between tracks; of a sector search its radius
    legs: int  # those that are counted, which are not the cross legs between parallel ones
    pos: float  # probability that it finds the object, given that all before it in the plan failed
    # a boat's way by sea to where it commences [deg]; (): straight from its base
    out: tuple[LonLat, ...] = ()
    back: tuple[LonLat, ...] = ()  # and from where its search ends
    # numbers of the legs, from 1, that are cut at the coast, or go round it
    cut: tuple[int, ...] = ()
    swept: float = 1.0  # share of the sub-area's sea that its legs search, cut as they are
    pos_ashore: float = 0.0  # the part of pos that is of what lies ashore as it ends
    waits: str = ""  # why it searches later than it could, if it does
    manner: Manner = PLAIN  # its pattern, and the frame that this is laid in


@dataclass(frozen=True)
class Alternative:
    """Another plan, scored on the particles that the plan was made on."""

    name: str
    value: float  # of the objective
    difference: float  # plan - alternative
    standard_error: float  # of the difference
    apart: bool = True  # whether it keeps the separation that the plan keeps

    @property
    def same(self) -> bool:
        """Whether it finds the same share of every particle as the plan, so is the plan."""
        return self.difference == 0 and self.standard_error == 0


@dataclass(frozen=True)
class Plan:
    """What to do next. `value` is the objective: POS, or the probability of finding alive."""

    spec: PlanSpec
    taskings: tuple[Tasking, ...]
    value: float  # on the case's own particles, which the plan has not seen
    pos: float  # there: 1 - evidence of executing it
    by_scenario: Array  # (scenarios,) POS given each scenario, there
    seen: float  # on the particles that it was made on; the excess over `value` is optimism
    # estimated: no plan of these units, laws and times should find more of those particles
    bound: float | None
    # standard error of `bound` less `value`, each of which is a mean over particles of its own
    bound_error: float
    alternatives: tuple[Alternative, ...]  # their values are of the particles that `seen` is of
    scenarios: tuple[str, ...]
    families: tuple[
        str | None, ...
    ] = ()  # (scenarios,) the name of the family of each, None: it is in none; (): none is
    shares: Array | None = None  # (scenarios,) probability of each before the plan; None: not known
    ashore: float = 0.0  # probability that it lies ashore, or has run aground, when the plan begins
    pos_ashore: float = 0.0  # the part of pos that is of what lies ashore as a unit passes
    idle: tuple[str, ...] = ()  # units that are not sent
    said: tuple[str, ...] = ()  # of boats: how they leave harbour, and why one cannot get there
    made_on: Count | None = None  # how many of the particles that it was made on count
    scored_on: Count | None = None  # and of the case's own, when it begins
    unbounded: str = ""  # why there is no bound, in a few words
