"""Evidence from an overdue target: it was due in port by a time, and has not arrived.

Particles in port by then are ruled out, since an arrival would be known. This makes a distress on
the way, and slow passages, more likely. The evidence continues: whenever something is searched or
observed later, and when a plan begins, particles that have arrived since are ruled out too.

A particle is in port if it has arrived by its own dead reckoning and lies within a radius of its
last way point. A particle that the current has set farther off, or that kept farther off its track,
would not be in port and goes on unchanged.
"""

from collections.abc import Sequence

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.steering.itinerary import Abeam, Itinerary, Ways
from drift.engine.particles import life
from drift.engine.particles.ensemble import Ensemble
from drift.engine.particles.status import Status
from geo import sphere
from geo.array import Array


def overdue_times(spec: EnsembleSpec, known: Sequence[int]) -> dict[int, bool]:
    """Return the times at which being overdue is evidence, and whether a scenario begins to be.

    All times are seconds after the run's start. Later than the first deadline, it is evidence
    whenever there is other evidence.

    known: times of all other evidence.
    """
    due = [s.itinerary.overdue for s in spec.scenarios if s.itinerary]
    begins = {spec.period.elapsed(time) for time in due if time is not None}
    later = {time for time in known if begins and time > min(begins)}
    return {time: time in begins for time in sorted(begins | later)}


def log_likelihood(spec: EnsembleSpec, time: int, ensemble: Ensemble) -> Array:
    """Return the log likelihood (n,) of not being in port at a time: -inf in port, else 0."""
    when = spec.period.time(time)
    there = in_port(spec, ensemble, life.read_lives(ensemble).at(time), when)
    return np.where(there, -np.inf, 0.0)


def in_port(spec: EnsembleSpec, ensemble: Ensemble, status: Array, when: np.datetime64) -> Array:
    """Return which particles are known to be in port at a time, bool (n,).

    status: of each particle at that time.
    """
    there = np.zeros(len(status), bool)
    for k, scenario in enumerate(spec.scenarios):
        own = scenario.itinerary
        if own is None or own.overdue is None or own.overdue > when:
            continue
        mine = np.flatnonzero((status == Status.ARRIVED) & (ensemble.scenario.to_numpy() == k))
        there[mine] = _distance_from_end(own, ensemble, mine) <= own.arrival_radius
    return there


def _distance_from_end(own: Itinerary, ensemble: Ensemble, index: Array) -> Array:
    """Return the distance [m] of arrived particles from their last way point.

    The way point is the one that each particle has drawn. On a voyage it is the middle of the
    track, without the particle's own offset; on lanes it is any place across them.
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
