"""What is overdue: a target that was to have come into port by a time, and has not.

Those that are in port by then are not what is looked for: one would know. That is evidence as any
other: it makes a distress on the way likelier, and slow passages too. It holds on: whenever
something is searched or seen later, and as a plan begins, those that have come in since are known
to be no longer missing.

In port is who has arrived by its own dead reckoning, and lies within a radius of its last way
point. Whom the current has set farther off, or who kept farther off its way, would not be there: it
goes on as what it is.
"""

from collections.abc import Sequence

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.steering.itinerary import Abeam, Itinerary, Ways
from drift.engine.particles import life
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status
from geo import notation, sphere
from geo.array import Array


def begins(spec: EnsembleSpec) -> list[int]:
    """Return the times [s after the run's start] at which scenarios are known to be overdue,
    ascending.
    """
    known = {
        s.itinerary.overdue
        for s in spec.scenarios
        if s.itinerary and s.itinerary.overdue is not None
    }
    return sorted(spec.period.elapsed(time) for time in known)


def times(spec: EnsembleSpec, known: Sequence[int]) -> list[int]:
    """Return all times at which it tells something; known [s after the run's start]: when else
    anything was known.
    """
    first = begins(spec)
    return sorted({*first, *(time for time in known if first and time > first[0])})


def name(spec: EnsembleSpec, time: int) -> str:
    """Return what the evidence of a time [s after the run's start] is called."""
    return f"overdue {notation.group(spec.period.time(time))}"


def log_likelihood(spec: EnsembleSpec, time: int, ensemble: Ensemble) -> Array:
    """Return the log likelihood (n,) of not being in port at a time: -inf of what is, 0 of all
    else.
    """
    when = spec.period.time(time)
    there = in_port(spec, ensemble, life.read_lives(ensemble).at(time), when)
    return np.where(there, -np.inf, 0.0)


def in_port(spec: EnsembleSpec, ensemble: Ensemble, status: Array, when: np.datetime64) -> Array:
    """Return which particles are in port and would be known to be, bool (n,); status: of each at
    that time.
    """
    there = np.zeros(len(status), bool)
    for k, scenario in enumerate(spec.scenarios):
        own = scenario.itinerary
        if own is None or own.overdue is None or own.overdue > when:
            continue
        mine = np.flatnonzero((status == Status.ARRIVED) & (ensemble.scenario.to_numpy() == k))
        there[mine] = _off(own, ensemble, mine) <= own.arrival_radius
    return there


def _off(own: Itinerary, ensemble: Ensemble, index: Array) -> Array:
    """Return how far [m] particles that have arrived lie from their last way point.

    That is the one that each has drawn. On a voyage it is the middle of its way, off which it has
    kept; on lanes any place across them.
    """
    lon, lat, set_lon, set_lat = (
        ensemble.columns[key].to_numpy()[index] for key in ("lon", "lat", "set_lon", "set_lat")
    )
    to_lon, to_lat = (lon - set_lon) * sphere.UNIT, (lat - set_lat) * sphere.UNIT
    last = own.phases[-1]
    if (
        isinstance(last, Ways)
        and isinstance(place := last.points[-1].place, Abeam)
        and place.law == "normal"
    ):
        to_lon, to_lat = np.full(len(index), place.lon), np.full(len(index), place.lat)
    return np.asarray(sphere.distance(lon * sphere.UNIT, lat * sphere.UNIT, to_lon, to_lat))
