"""Chances of objects ashore of being reported, removed, or found by patrols.

An object on stretch s is reported by the public at the rate h, buried or taken away without a
report at the rate rho, and found by each patrol of the stretch with its detection probability. So
every particle has a probability of having been found, and a density of being found at a given
stretch and time, both in closed form between patrols.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drift.spills.worlds.fates import FOREVER, Fates
from geo.array import Array, Real

# Log of the miss probability of a certain detection: e^-700 is negligible, and differences of such
# logs stay finite.
LEAST = -700.0


@dataclass(frozen=True)
class Reporting:
    """Rates at which an object ashore is reported or removed."""

    rate: Real  # (S,) reports by the public, by stretch [1/s]
    removal: Real | float  # (S,) or for all stretches: burial or removal without a report [1/s]
    factor: Real  # (W,) factor of each world on the reporting rate


@dataclass(frozen=True)
class Walk:
    """A patrol of stretches (numbers) at a time [s after start], with its detection probability."""

    segments: tuple[int, ...]
    time: int
    detection: float


@dataclass(frozen=True)
class Exposure:
    """Stays on the shore by stretch, shape (m,), and the patrols of every stretch."""

    fates: Fates
    patrols: tuple[Walk, ...]
    slot: npt.NDArray[np.int32]
    arrival: Real  # [s after start]
    leave: Real  # [s after start], inf: never
    report: Real  # [1/s]
    loss: Real  # [1/s] sum of report, burial and removal
    before: Real  # log probability that the object was not found or removed in earlier stays
    bounds: npt.NDArray[np.int64]  # (S + 1,) first row of each stretch
    visits: tuple[tuple[int, ...], ...]  # (S,) numbers of the patrols of each stretch by time

    @property
    def segment(self) -> Array:
        """The stretch of each row, (m,)."""
        return np.repeat(np.arange(len(self.visits)), np.diff(self.bounds))

    @property
    def touched(self) -> Array:
        """The stretches with any stay."""
        return np.flatnonzero(np.diff(self.bounds))


def expose(fates: Fates, reporting: Reporting, patrols: tuple[Walk, ...]) -> Exposure:
    """Return the stays of every particle with their rates and patrols.

    Args:
        fates: fates of the particles.
        reporting: rates of reports and removal.
        patrols: all patrols.

    Returns:
        The stays by stretch.
    """
    stays = fates.stays
    segments = reporting.rate.size
    order = np.argsort(stays.segment, kind="stable")
    slot, segment = stays.slot[order], stays.segment[order]
    arrival = stays.arrival[order].astype(float)
    leave = np.where(stays.leave[order] == FOREVER, np.inf, stays.leave[order])
    report = reporting.rate[segment] * reporting.factor[fates.world[slot]]
    loss = report + np.broadcast_to(reporting.removal, segments)[segment]
    by_time = sorted(range(len(patrols)), key=lambda k: patrols[k].time)
    visits: list[list[int]] = [[] for _ in range(segments)]
    for k in by_time:
        for s in dict.fromkeys(patrols[k].segments):
            visits[s].append(k)
    exposed = Exposure(
        fates,
        patrols,
        slot,
        arrival,
        leave,
        report,
        loss,
        np.zeros(slot.size),
        np.searchsorted(segment, np.arange(segments + 1)),
        tuple(map(tuple, visits)),
    )
    gone = np.flatnonzero(np.isfinite(leave))
    if gone.size:  # some refloat: `before` is the chance of surviving earlier stays
        through = np.zeros(slot.size)
        for s in np.unique(segment[gone]):
            rows = _rows(exposed, int(s))
            rows = rows.start + np.flatnonzero(np.isfinite(leave[rows]))
            through[rows] = _log_unfound(exposed, int(s), rows, leave[rows])
        time_order = np.empty(slot.size)
        time_order[order] = through  # the order of the stays is by slot and arrival
        first = np.flatnonzero(np.diff(stays.slot, prepend=-1))
        count, ahead = np.diff(np.append(first, slot.size)), np.zeros(slot.size)
        # accumulate over the stays of each slot; few slots have many stays
        for k in range(1, int(count.max(initial=1))):
            later = first[count > k] + k
            ahead[later] = ahead[later - 1] + time_order[later - 1]
        exposed.before[:] = np.minimum(ahead[order], 0.0)
    return exposed


def _rows(exposed: Exposure, segment: int) -> slice:
    return slice(int(exposed.bounds[segment]), int(exposed.bounds[segment + 1]))


def _log_missed(exposed: Exposure, segment: int) -> tuple[Real, Real]:
    """Return the times of a stretch's P patrols, and the log chances that the first 0..P miss."""
    patrols = [exposed.patrols[k] for k in exposed.visits[segment]]
    miss = [max(np.log1p(-p.detection), LEAST) if p.detection < 1 else LEAST for p in patrols]
    return np.array([p.time for p in patrols], float), np.concatenate([[0.0], np.cumsum(miss)])


def _log_unfound(exposed: Exposure, segment: int, rows: slice | Array, until: Real | float) -> Real:
    """Return the log chance of lying there unfound from arrival until just before a time."""
    times, miss = _log_missed(exposed, segment)
    arrival = exposed.arrival[rows]
    passed = miss[np.searchsorted(times, until)] - miss[np.searchsorted(times, arrival)]
    return np.asarray(-exposed.loss[rows] * (until - arrival) + passed)


def reported_probability(exposed: Exposure, segment: int, until: float) -> tuple[slice, Real]:
    """Return the chance of each stay on a stretch of being reported by the public by a time.

    Args:
        exposed: stays on the shore.
        segment: number of the stretch.
        until: the time [s after start].

    Returns:
        Rows of the stretch, and chances, (rows,).
    """
    rows = _rows(exposed, segment)
    times, miss = _log_missed(exposed, segment)
    arrival, loss, end = (
        exposed.arrival[rows],
        exposed.loss[rows],
        np.minimum(exposed.leave[rows], until),
    )
    base = exposed.before[rows] - miss[np.searchsorted(times, arrival)]
    edges = np.concatenate([[-np.inf], times[times < until], [np.inf]])
    total = np.zeros(arrival.size)
    for k in range(edges.size - 1):  # between two patrols
        begin = np.maximum(arrival, edges[k])
        lasting = np.maximum(np.minimum(end, edges[k + 1]) - begin, 0.0)
        alive = np.exp(np.minimum(base + miss[k] - loss * (begin - arrival), 0.0))
        total += alive * -np.expm1(-loss * lasting)
    return rows, total * exposed.report[rows] / np.where(loss > 0, loss, 1.0)


def report_density(exposed: Exposure, segment: int, time: float) -> tuple[slice, Real]:
    """Return the density [1/s] of a public report at a time for each stay on a stretch.

    Args:
        exposed: stays on the shore.
        segment: number of the stretch.
        time: the time [s after start].

    Returns:
        Rows of the stretch, and densities, (rows,).
    """
    rows = _rows(exposed, segment)
    there = (exposed.arrival[rows] <= time) & (time < exposed.leave[rows])
    at = np.where(there, time, exposed.arrival[rows])
    return rows, there * exposed.report[rows] * np.exp(
        exposed.before[rows] + _log_unfound(exposed, segment, rows, at)
    )


def lying_probability(exposed: Exposure, segment: int, time: float) -> Real:
    """Return the chance of each stay of lying unfound on a stretch at a time.

    Args:
        exposed: stays on the shore.
        segment: number of the stretch.
        time: the time [s after start]; patrols at this time come after it.

    Returns:
        Chances, (rows,).
    """
    rows = _rows(exposed, segment)
    there = (exposed.arrival[rows] <= time) & (time < exposed.leave[rows])
    at = np.where(there, time, exposed.arrival[rows])
    return np.asarray(
        there
        * np.exp(np.minimum(exposed.before[rows] + _log_unfound(exposed, segment, rows, at), 0.0))
    )


def patrol_probability(exposed: Exposure, segment: int, patrol: int) -> tuple[slice, Real]:
    """Return the chance of each stay on a stretch of being found by a patrol.

    Args:
        exposed: stays on the shore.
        segment: number of the stretch.
        patrol: number of the patrol, which must visit the stretch.

    Returns:
        Rows of the stretch, and chances, (rows,).
    """
    rows = _rows(exposed, segment)
    time, number = float(exposed.patrols[patrol].time), exposed.visits[segment].index(patrol)
    times, miss = _log_missed(exposed, segment)
    there = (exposed.arrival[rows] <= time) & (time < exposed.leave[rows])
    passed = miss[number] - miss[np.searchsorted(times, exposed.arrival[rows])]
    alive = exposed.before[rows] - exposed.loss[rows] * (time - exposed.arrival[rows]) + passed
    return rows, there * np.exp(np.minimum(alive, 0.0)) * exposed.patrols[patrol].detection


def found_probability(exposed: Exposure, now: float, before: bool = False) -> Real:
    """Return every particle's probability of having been found by a time, by any means.

    Args:
        exposed: stays on the shore.
        now: the time [s after start].
        before: whether to leave out the patrols at that very time.

    Returns:
        Probabilities, (n,).
    """
    chance = np.zeros(exposed.slot.size)
    for s in exposed.touched.tolist():
        rows, total = reported_probability(exposed, s, now)
        for k in exposed.visits[s]:
            time = exposed.patrols[k].time
            if time < now or (time == now and not before):
                total = total + patrol_probability(exposed, s, k)[1]
        chance[rows] = total
    return np.minimum(np.bincount(exposed.slot, chance, exposed.fates.world.size), 1.0)
