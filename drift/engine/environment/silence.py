"""Finds the sources without values at particle positions, and those that caused particles to be
lost.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from drift.engine.motion.clock import Clock
from drift.engine.motion.forcing import Forcing, Term
from drift.engine.particles import partials
from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from geo import notation, sphere
from geo.array import Array
from geo.forcing.quantity import required_quantities

Shares = dict[tuple[str, tuple[str, ...]], float]  # by quantity and the names of a term's sources

MOST = 24  # steps examined: those that lost most represent all
# steps ahead along the current: a stage of the step found nothing, not always its begin
AHEAD = (0.0, 1.0, 3.0)


def terms(
    forcing: Forcing,
    scenario: int,
    lon: Array,
    lat: Array,
    member: Array | None,
    fraction: float = 0.0,
) -> Iterator[tuple[str, Term, Array]]:
    """Yield quantity, term, and where the term has a value, for all required terms of a scenario.

    Args:
        forcing: set to a step.
        scenario: its number.
        lon: of the places [binary angle], (n,).
        lat: of the places [binary angle], (n,).
        member: forcing ensemble member of each place, int32 (n,); None without an ensemble.
        fraction: of the step to which the forcing is set.
    """
    for quantity in required_quantities():
        for term in forcing.terms[scenario][quantity]:
            yield (
                quantity,
                term,
                forcing.tiles.at(term.first, term.last, lon, lat, fraction, member)[:, 2] > 0.5,
            )


class AtEnd(NamedTuple):
    """Some particles at the end of a run, and when the status of each began [s after
    start], (n,).
    """

    snapshot: Snapshot
    since: Array


def lost(forcing: Forcing, clock: Clock, ends: Callable[[], Iterable[AtEnd]]) -> Shares:
    """Return the probability lost by each term that had no value, keyed by quantity and sources.

    The search tests the last position of a particle at the begin and the end of the step that
    failed, then positions ahead along the current. Gaps reached only by leeway are not found.

    Args:
        forcing: of the run.
        clock: of the run.
        ends: returns all particles at the end of the run, part by part.
    """
    steps = [(step.elapsed, low, high) for low, high, step in clock.steps()]
    begins = [elapsed for elapsed, _, _ in steps]

    def stuck(end: AtEnd) -> tuple[Array, Array]:
        """Return the probability of particles outside the forcing, and the number of the step that
        failed.

        Pending particles and those released before the first step are not outside; their number is
        unused.
        """
        outside = end.snapshot.status == Status.OUTSIDE
        number = (np.searchsorted(begins, end.since, "right") - 1).clip(0)
        return np.where(outside, end.snapshot.probability, 0.0), number

    sums = [
        end.snapshot.blocks.partial(p, code=number, many=len(steps))
        for end in ends()
        for p, number in [stuck(end)]
    ]
    by_step = partials.merge_partials(sums).total[:, 0]
    chosen = [int(k) for k in np.argsort(-by_step, kind="stable")[:MOST] if by_step[k] > 0]
    shares: Shares = {}
    for end in ends():
        probability, number = stuck(end)
        for k in chosen:
            _, low, high = steps[k]
            forcing.set(low, high)
            for scenario in np.unique(end.snapshot.scenario).tolist():
                slots = np.flatnonzero(
                    (probability > 0) & (number == k) & (end.snapshot.scenario == scenario)
                )
                for ahead in AHEAD:
                    if slots.size:
                        time = ahead * clock.direction * clock.step
                        own = end.snapshot
                        member = None if own.member is None else own.member[slots]
                        lon, lat = _ahead_along_current(
                            forcing, scenario, own.lon[slots], own.lat[slots], member, time
                        )
                        share = partial(end.snapshot.blocks.total, slots=slots)
                        slots = slots[
                            _add_silent(
                                shares,
                                forcing,
                                scenario,
                                lon,
                                lat,
                                member,
                                probability[slots],
                                share,
                            )
                        ]
    scale = float(by_step.sum() / by_step[chosen].sum()) if chosen else 1.0
    return {key: share * scale for key, share in shares.items()}


def in_words(shares: Shares) -> str:
    """Return shares in words, the largest first: current "tide" 28 %, wind "arome" 2 %."""
    largest = sorted(shares.items(), key=lambda item: -item[1])
    return ", ".join(
        f"{quantity} {' and '.join(_quoted(name) for name in names)} {notation.percent(share)}"
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
    """Add the shares of terms without values at places (n,); return where all terms have one, bool
    (n,).

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


def _ahead_along_current(
    forcing: Forcing, scenario: int, lon: Array, lat: Array, member: Array | None, time: float
) -> tuple[Array, Array]:
    """Return the positions [binary angle] reached in a straight line along the current in a time
    [s].

    Positions without a current stay.
    """
    current = forcing.tiles.at(*forcing.ranges[scenario]["current"], lon, lat, 0.0, member)
    east, north, valid = current.astype(np.float64).T
    metres = np.where(valid > 0.5, time, 0.0) / (sphere.RADIUS * sphere.UNIT)
    x = lon + np.nan_to_num(east) * metres / np.cos(lat * sphere.UNIT)
    y = lat + np.nan_to_num(north) * metres
    return np.rint(x).astype(np.int64).astype(np.int32), np.rint(y).astype(np.int32)
