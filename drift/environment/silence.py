"""Which sources have no value where particles are, and which of them ended the way of those that are lost."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from drift.motion.clock import Clock
from drift.motion.forcing import Forcing, Term
from drift.particles import members as member_column
from drift.particles.ensemble import Ensemble
from drift.particles.snapshot import Snapshot
from drift.particles.status import Status
from geo import sphere
from geo.array import Array
from geo.forcing.quantity import needed

Shares = dict[tuple[str, tuple[str, ...]], float]  # by quantity and the names of a term's sources

MOST = 24  # steps that are looked at: those that lost most stand for all
AHEAD = (0.0, 1.0, 3.0)  # steps ahead along the current: a stage of the step found nothing, not always its begin


def terms(
    forcing: Forcing, scenario: int, lon: Array, lat: Array, member: Array | None, fraction: float = 0.0
) -> Iterator[tuple[str, Term, Array]]:
    """Yield the quantity and the term, and where the term has a value, for all terms of a scenario that it needs.

    lon, lat: places [binary angle] (n,); member: in which member of an ensemble each is, int32 (n,), None without one; fraction: of the step that the forcing is set to.
    """
    for quantity in needed():
        for term in forcing.terms[scenario][quantity]:
            yield quantity, term, forcing.tiles.at(term.first, term.last, lon, lat, fraction, member)[:, 2] > 0.5


def lost(forcing: Forcing, clock: Clock, ensemble: Ensemble, end: Snapshot) -> Shares:
    """Return how much of the probability ran out of forcing where a term had no value.

    end: of the run. The search looks where a particle stayed, at the begin and the end of the step that it could not
    make, then ahead of it along the current. A gap to which only its leeway led is not found.
    """
    ended, outside, probability = ensemble.status_since.to_numpy(), end.status == Status.OUTSIDE, end.probability
    steps = [(step.elapsed, low, high) for low, high, step in clock.steps()]
    number = np.searchsorted([elapsed for elapsed, _, _ in steps], ended, "right") - 1
    # Particles released before the first step, and pending ones, are not outside: their number does not matter.
    by_step = ensemble.blocks.table(number.clip(0), len(steps), np.where(outside, probability, 0.0))
    chosen = [k for k in np.argsort(-by_step, kind="stable")[:MOST] if by_step[k] > 0]
    shares: Shares = {}
    members = member_column.of(ensemble)
    for k in chosen:
        _, low, high = steps[k]
        forcing.set(low, high)
        for scenario, (first, last) in enumerate(ensemble.scenarios):
            slots = first + np.flatnonzero(outside[first:last] & (number[first:last] == k))
            for ahead in AHEAD:
                if slots.size:
                    time = ahead * clock.direction * clock.step
                    member = None if members is None else members[slots]
                    lon, lat = _along(forcing, scenario, end.lon[slots], end.lat[slots], member, time)
                    share = partial(ensemble.blocks.total, slots=slots)
                    slots = slots[_add_silent(shares, forcing, scenario, lon, lat, member, probability[slots], share)]
    scale = float(by_step.sum() / by_step[chosen].sum()) if chosen else 1.0
    return {key: share * scale for key, share in shares.items()}


def in_words(shares: Shares) -> str:
    """Return shares in words, the largest first: current "tide" 28 %, wind "arome" 2 %."""
    largest = sorted(shares.items(), key=lambda item: -item[1])
    return ", ".join(
        f"{quantity} {' and '.join(_quoted(name) for name in names)} {share:.0%}"
        for (quantity, names), share in largest
        if share > 0
    )


def _quoted(name: str) -> str:
    return f'"{name}"'


def _add_silent(
    shares: Shares,
    forcing: Forcing,
    scenario: int,
    lon: Array,
    lat: Array,
    member: Array | None,
    probability: Array,
    total: Callable[[Array], float],
) -> Array:
    """Add the shares of what has no value at places (n,), and return where all terms have one, bool (n,).

    total: returns the sum of values (n,) over these particles.
    """
    valid_all = np.ones(lon.size, bool)
    for fraction in (0.0, 1.0):
        before = valid_all.copy()
        for quantity, term, valid in terms(forcing, scenario, lon, lat, member, fraction):
            share = total(np.where(before & ~valid, probability, 0.0))
            if share > 0:
                shares[quantity, term.names] = shares.get((quantity, term.names), 0.0) + share
            valid_all &= valid
    return valid_all


def _along(
    forcing: Forcing, scenario: int, lon: Array, lat: Array, member: Array | None, time: float
) -> tuple[Array, Array]:
    """Return the places [binary angle] to which the current leads in a time [s], straight on.

    Places without a current stay.
    """
    told = forcing.tiles.at(*forcing.ranges[scenario]["current"], lon, lat, 0.0, member)
    east, north, valid = told.astype(np.float64).T
    metres = np.where(valid > 0.5, time, 0.0) / (sphere.RADIUS * sphere.UNIT)
    x = lon + np.nan_to_num(east) * metres / np.cos(lat * sphere.UNIT)
    y = lat + np.nan_to_num(north) * metres
    return np.rint(x).astype(np.int64).astype(np.int32), np.rint(y).astype(np.int32)
