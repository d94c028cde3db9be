"""What objects lying ashore go through: being reported, buried or taken away, and searched for by patrols.

An object on stretch s is reported by the public at the rate h, buried or taken away unreported at the rate rho, and
found by each patrol of the stretch with its detection probability. From these every particle has a probability of
having been found, and a density of being found at a stated stretch and time, both in closed form between patrols.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drift.spill.fates import FOREVER, Fates
from geo.array import Array, Real

LEAST = (
    -700.0
)  # log of the chance that a sure detection misses: e^-700 is nothing in any sum, yet differences stay finite


@dataclass(frozen=True)
class Reporting:
    """How soon an object ashore is reported or lost."""

    rate: Real  # (S,) by stretch [1/s] at which the public reports an object
    removal: Real | float  # (S,) or one for all [1/s] of burial or removal without a report
    factor: Real  # (W,) by world, on the rate


@dataclass(frozen=True)
class Walk:
    """A patrol on stretches by number: at a time [s after start] it finds each object lying there with a probability."""

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
    leave: Real  # [s after start], inf: stays
    report: Real  # [1/s]
    loss: Real  # [1/s] by report, burial or removal
    before: Real  # log probability that it is still there to be found at its arrival: earlier stays
    bounds: npt.NDArray[np.int64]  # (S + 1,) first row of each stretch
    visits: tuple[tuple[int, ...], ...]  # (S,) numbers of the patrols of each stretch by time


def expose(fates: Fates, reporting: Reporting, patrols: tuple[Walk, ...]) -> Exposure:
    """Return the stays of every particle with all that can happen to them ashore."""
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
    here = Exposure(
        fates, patrols, slot, arrival, leave, report, loss, np.zeros(slot.size),
        np.searchsorted(segment, np.arange(segments + 1)), tuple(map(tuple, visits)),
    )  # fmt: skip
    gone = np.flatnonzero(np.isfinite(leave))
    if gone.size:  # some refloat: the chance that earlier stays have left them
        through = np.zeros(slot.size)
        for s in np.unique(segment[gone]):
            rows = _rows(here, int(s))
            rows = rows.start + np.flatnonzero(np.isfinite(leave[rows]))
            through[rows] = _alive(here, int(s), rows, leave[rows])
        time_order = np.empty(slot.size)
        time_order[order] = through  # in the order of the stays: by slot and arrival
        first = np.flatnonzero(np.diff(stays.slot, prepend=-1))
        ahead = np.cumsum(time_order) - time_order
        ahead -= np.repeat(ahead[first], np.diff(np.append(first, slot.size)))
        here.before[:] = np.minimum(ahead[order], 0.0)
    return here


def _rows(here: Exposure, segment: int) -> slice:
    return slice(int(here.bounds[segment]), int(here.bounds[segment + 1]))


def _missed(here: Exposure, segment: int) -> tuple[Real, Real]:
    """Return the times of a stretch's P patrols and the log chances (P + 1,) that the first 0 to P all missed."""
    patrols = [here.patrols[k] for k in here.visits[segment]]
    miss = [max(np.log1p(-p.detection), LEAST) if p.detection < 1 else LEAST for p in patrols]
    return np.array([p.time for p in patrols], float), np.concatenate([[0.0], np.cumsum(miss)])


def _alive(here: Exposure, segment: int, rows: slice | Array, until: Real | float) -> Real:
    """Return the log chance of lying there unfound from arrival until just before a time."""
    times, miss = _missed(here, segment)
    arrival = here.arrival[rows]
    passed = miss[np.searchsorted(times, until)] - miss[np.searchsorted(times, arrival)]
    return np.asarray(-here.loss[rows] * (until - arrival) + passed)


def reported(here: Exposure, segment: int, until: float) -> tuple[slice, Real]:
    """Return the rows of a stretch, and each stay's chance (rows,) that the public has reported it by a time [s]."""
    rows = _rows(here, segment)
    times, miss = _missed(here, segment)
    arrival, loss, end = here.arrival[rows], here.loss[rows], np.minimum(here.leave[rows], until)
    base = here.before[rows] - miss[np.searchsorted(times, arrival)]
    edges = np.concatenate([[-np.inf], times[times < until], [np.inf]])
    total = np.zeros(arrival.size)
    for k in range(edges.size - 1):  # between two patrols
        begin = np.maximum(arrival, edges[k])
        lasting = np.maximum(np.minimum(end, edges[k + 1]) - begin, 0.0)
        alive = np.exp(np.minimum(base + miss[k] - loss * (begin - arrival), 0.0))
        total += alive * -np.expm1(-loss * lasting)
    return rows, total * here.report[rows] / np.where(loss > 0, loss, 1.0)


def public(here: Exposure, segment: int, time: float) -> tuple[slice, Real]:
    """Return the rows of a stretch and the density [1/s] of each stay of being reported at a time."""
    rows = _rows(here, segment)
    there = (here.arrival[rows] <= time) & (time < here.leave[rows])
    at = np.where(there, time, here.arrival[rows])
    return rows, there * here.report[rows] * np.exp(here.before[rows] + _alive(here, segment, rows, at))


def lying(here: Exposure, segment: int, time: float) -> Real:
    """Return each stay's chance (rows,) of lying unfound on a stretch at a time, before the patrols of that time."""
    rows = _rows(here, segment)
    there = (here.arrival[rows] <= time) & (time < here.leave[rows])
    at = np.where(there, time, here.arrival[rows])
    return np.asarray(there * np.exp(np.minimum(here.before[rows] + _alive(here, segment, rows, at), 0.0)))


def searched(here: Exposure, segment: int, patrol: int) -> tuple[slice, Real]:
    """Return the rows of a stretch and the chance of each stay of being found by a patrol of it."""
    rows = _rows(here, segment)
    time, number = float(here.patrols[patrol].time), here.visits[segment].index(patrol)
    times, miss = _missed(here, segment)
    there = (here.arrival[rows] <= time) & (time < here.leave[rows])
    passed = miss[number] - miss[np.searchsorted(times, here.arrival[rows])]
    alive = here.before[rows] - here.loss[rows] * (time - here.arrival[rows]) + passed
    return rows, there * np.exp(np.minimum(alive, 0.0)) * here.patrols[patrol].detection


def found(here: Exposure, now: float, before: bool = False) -> Real:
    """Return the probability (n,) of every particle that it has been found by a time, by any means.

    before: leave out the patrols at that very time.
    """
    chance = np.zeros(here.slot.size)
    for s in range(len(here.visits)):
        rows, total = reported(here, s, now)
        for k in here.visits[s]:
            time = here.patrols[k].time
            if time < now or (time == now and not before):
                total = total + searched(here, s, k)[1]
        chance[rows] = total
    return np.minimum(np.bincount(here.slot, chance, here.fates.world.size), 1.0)
