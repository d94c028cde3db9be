"""The quantities with marginal posteriors.

A new quantity is one more entry of QUANTITIES; files and pictures need no change. A run reports a
quantity if any two of its particles differ in it.
"""

import math
from typing import NamedTuple

import numpy as np

from drift.engine.motion import changes
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.steering.family import Axis
from drift.engine.motion.steering.itinerary import (
    Acts,
    Course,
    InRing,
    Itinerary,
    Loiter,
    Place,
    Ways,
)
from drift.engine.particles import members
from drift.engine.particles.status import Status
from drift.evidence.posterior.quantity import Drawn, Quantity, Values
from geo import notation
from geo.array import Array
from geo.notation import KNOT, NMI

TURN = 2 * math.pi


def _scenario(drawn: Drawn) -> Values:
    return Values(drawn.scenario, np.ones(drawn.ensemble.n, bool))


def _steers(drawn: Drawn) -> Array:
    """Return which particles steer, or did before they went adrift, bool (n,)."""
    return np.array([s.itinerary is not None for s in drawn.spec.scenarios])[drawn.scenario]


def _departure(drawn: Drawn) -> Values | None:
    if drawn.settled is None:
        return None
    return Values(drawn.ensemble.own["departure"].to_numpy(), _steers(drawn))


def _speed(drawn: Drawn) -> Values | None:
    return _settled(drawn, "speed")


def _course(drawn: Drawn) -> Values | None:
    return _settled(drawn, "course")


def _spread_rate(drawn: Drawn) -> Values | None:
    return _settled(drawn, "k")


def _settled(drawn: Drawn, name: str) -> Values | None:
    """Return one of the values that are fixed at birth, for the scenarios that have it."""
    settled = drawn.settled
    if settled is None:
        return None
    return Values(getattr(settled, name), settled.has[name][drawn.scenario])


def _adrift(drawn: Drawn) -> Values:
    """Return when particles go adrift within the run: at their release, or their distress.

    Particles that arrive, run aground or leave the domain before their distress never go adrift;
    for a voyage, the arrival is known from the start.
    """
    ensemble = drawn.ensemble
    release, status, since = (
        column.to_numpy() for column in (ensemble.release, ensemble.status, ensemble.status_since)
    )
    holds = release <= drawn.spec.period.duration
    if drawn.settled is not None:
        holds &= release < drawn.settled.arrival
        lost = ((status == Status.LEFT) | (status == Status.OUTSIDE)) & (since < release)
        holds &= ~(lost | (status == Status.ARRIVED) | (status == Status.AGROUND))
    return Values(release, holds)


def _member(drawn: Drawn) -> Values | None:
    """Return the forcing ensemble member in which each particle drifts."""
    member = members.member_of_particles(drawn.ensemble)
    return None if member is None else Values(member, np.ones(drawn.ensemble.n, bool))


def _members(spec: EnsembleSpec) -> tuple[str, ...]:
    return spec.members


def _side(drawn: Drawn) -> Values | None:
    """Return on which side of the wind particles drift now; jibes change it.

    It applies to objects whose sides differ.
    """
    if "side" not in drawn.ensemble.own:
        return None
    sided = np.array(
        [any(one.jibes for one in s.objects) and "drift" in s.models for s in drawn.spec.scenarios]
    )
    return Values(np.where(drawn.ensemble.own["side"].to_numpy() > 0, 0, 1), sided[drawn.scenario])


def _sides(spec: EnsembleSpec) -> tuple[str, ...]:
    return "right of the wind", "left of the wind"


def _state(drawn: Drawn) -> Values | None:
    """Return what has become of each object at the time; it applies to objects that may change."""
    if changes.STATE not in drawn.ensemble.own:
        return None
    scenarios, ensemble = drawn.spec.scenarios, drawn.ensemble
    now = changes.state_at(ensemble, drawn.elapsed)
    may_change = np.array([bool(scenario.changes) for scenario in scenarios])
    number = changes.numbered(scenarios)[drawn.scenario, now]
    return Values(number, may_change[drawn.scenario])


def _states(spec: EnsembleSpec) -> tuple[str, ...]:
    return changes.names_of(spec.scenarios)


class Ends(NamedTuple):
    """The destinations of all scenarios of a run."""

    labels: tuple[str, ...]  # position of each destination
    number: Array  # (scenarios, most destinations) number of the destination, -1: none


def ends(spec: EnsembleSpec) -> Ends:
    """Return the destinations of scenarios; one that several share is listed once."""
    places = [
        _ends(scenario.itinerary) if scenario.itinerary else [] for scenario in spec.scenarios
    ]
    labels: dict[str, int] = {}
    number = np.full((len(places), max(1, *(len(own) for own in places))), -1)
    for row, own in zip(number, places, strict=True):
        for k, place in enumerate(own):
            row[k] = labels.setdefault(_label(place), len(labels))
    return Ends(tuple(labels), number)


def _ends(itinerary: Itinerary) -> list[Place]:
    """Return the destinations of the last phase with a choice, else the end of the last phase."""
    for phase in reversed(itinerary.phases):
        if isinstance(phase, Ways) and phase.destinations:
            return [point.place for point, _ in phase.destinations]
    match itinerary.phases[-1]:
        case Ways(points=points):
            return [points[-1].place]
        case Loiter(ring=ring):
            return [ring]
        case Course() | Acts():
            return []


def _label(place: Place) -> str:
    """Return the position of a place in words; of a ring, its middle."""
    lon, lat = (
        ((min(place.lon) + max(place.lon)) / 2, (min(place.lat) + max(place.lat)) / 2)
        if isinstance(place, InRing)
        else (place.lon, place.lat)
    )
    return notation.position(math.degrees(lon), math.degrees(lat)) or ""


def _destination(drawn: Drawn) -> Values | None:
    settled = drawn.settled
    if settled is None:
        return None
    number = ends(drawn.spec).number[drawn.scenario, settled.destination]
    return Values(number, number >= 0)


def _scenarios(spec: EnsembleSpec) -> tuple[str, ...]:
    return tuple(scenario.name for scenario in spec.scenarios)


def _destinations(spec: EnsembleSpec) -> tuple[str, ...]:
    return ends(spec).labels


def _of_none(drawn: Drawn) -> None:
    return None


def of_axis(axis: Axis) -> Quantity:
    """Return an axis of scenario families as a quantity with one value per scenario."""
    heading = f"{axis.name[:1].upper()}{axis.name[1:]} (by scenario)"
    return Quantity(f"axis {axis.name}", heading, "category", _of_none, by_scenario=True)


QUANTITIES = (
    Quantity("scenario", "Scenario", "category", _scenario, labels=_scenarios, by_scenario=True),
    Quantity("departure", "Departure", "time", _departure),
    Quantity("speed", "Speed of advance", "number", _speed, "kn", 1 / KNOT),
    Quantity("course", "First course", "circular", _course, "deg", 360 / TURN),
    Quantity("destination", "Destination", "category", _destination, labels=_destinations),
    Quantity("adrift", "Goes adrift", "time", _adrift),
    Quantity("spread_rate", "Spread rate K", "number", _spread_rate, "nmi/sqrt(h)", 60 / NMI),
    Quantity("member", "Member of the forcing", "category", _member, labels=_members),
    Quantity("side", "Side of the wind", "category", _side, labels=_sides),
    Quantity("state", "State of the object", "category", _state, labels=_states, later=True),
)
