"""Spills of few objects whose washup can be counted."""

import numpy as np
import shapely

from drift.engine.particles.status import Status
from drift.spills.worlds import washup
from drift.spills.worlds.fates import FOREVER, Fates, Realisation, Stays
from geo.coast.segments import Segments

START = np.datetime64("1973-11-21T18:00:00")
HOUR = 3600


def stretches(count):
    lon = -90 + 0.1 * np.arange(count)
    lines = np.array([shapely.LineString([(x - 0.05, 29), (x + 0.05, 29.01)]) for x in lon], object)
    return Segments(
        name=tuple(f"S{i}" for i in range(count)),
        length=np.full(count, 9700.0),
        lon=lon,
        lat=np.full(count, 29.005),
        of_edge=np.arange(count, dtype=np.int32),
        lines=lines,
        access=tuple(("wild", "road")[i % 2] for i in range(count)),
    )


def spill(world, stays, release=0, ended=None, kind=None, worlds=None):
    """Return Fates; stays: (slot, segment, arrival, leave) rows; ended: {slot: (time, Status)}."""
    world = np.asarray(world, np.int32)
    rows = np.array(sorted(stays, key=lambda row: (row[0], row[2])), np.int32).reshape(-1, 4)
    ends, ending = np.full(len(world), FOREVER, np.int32), np.zeros(len(world), np.int32)
    for slot, _, _, leave in rows:
        ending[slot] = Status.ASHORE if leave == FOREVER else ending[slot]
    for slot, (time, status) in (ended or {}).items():
        ends[slot], ending[slot] = time, status
    return Fates(
        worlds=int(world.max()) + 1 if worlds is None else worlds,
        world=world,
        kind=np.zeros(len(world), np.int32) if kind is None else np.asarray(kind, np.int32),
        release=np.broadcast_to(np.asarray(release, np.int32), world.shape).copy(),
        ended=ends,
        ending=ending,
        stays=Stays(*(rows[:, i].copy() for i in range(4))),
    )


def once(stands, worlds, destroyed=0, found=0):
    lost = [np.broadcast_to(np.asarray(v, np.int32), (worlds,)).copy() for v in (destroyed, found)]
    return Realisation(np.asarray(stands, np.int32), *lost)


def build(fates, segments, draws, weight, outputs, start, kinds=("object",)):
    return washup.build_washup(
        [(fates, draws)], segments, weight, outputs, start, kinds, len(draws)
    )


def level(worlds):
    return np.full(worlds, 1 / worlds)


def random_spill(rng, worlds=5, each=12, segments=4, kinds=2):
    """Return Fates in which objects are released late, refloat, sink, leave, also at the same
    instant, and 2 draws.
    """
    n = worlds * each
    stays, ended, release = [], {}, rng.integers(0, 8, n)
    for slot in range(n):
        time = int(release[slot])
        for _ in range(rng.integers(0, 4)):
            arrival = time + int(rng.integers(0, 6))
            leave = FOREVER if rng.random() < 0.3 else arrival + int(rng.integers(1, 9))
            stays.append((slot, int(rng.integers(segments)), arrival, leave))
            time = leave
            if leave == FOREVER:
                break
        kind = (Status.SUNK, Status.LEFT, Status.OUTSIDE)[rng.integers(3)]
        if rng.random() < 0.1:  # at any time: before its release, or ashore
            ended[slot] = (int(rng.integers(0, 30)), kind)
        elif time != FOREVER and rng.random() < 0.5:
            ended[slot] = (time + int(rng.integers(0, 5)), kind)
    world = np.tile(np.repeat(np.arange(worlds), each // kinds), kinds)
    kind = np.repeat(np.arange(kinds), n // kinds)
    fates = spill(world, stays, release, ended, kind, worlds)
    draws = [
        once(rng.integers(0, 3, n), worlds, rng.integers(0, 4, worlds), rng.integers(0, 3, worlds))
        for _ in range(2)
    ]
    return fates, draws


def state(fates, slot, time):
    """Return what a slot is at a time, straight from the definition: (fate, segment)."""
    if fates.release[slot] > time:
        return "pending", None
    if fates.ended[slot] <= time:
        return ("sunk" if fates.ending[slot] == Status.SUNK else "gone"), None
    for i in np.flatnonzero(fates.stays.slot == slot):
        if fates.stays.arrival[i] <= time < fates.stays.leave[i]:
            return "ashore", int(fates.stays.segment[i])
    return "afloat", None


def quantile(values, weights, share):
    """Smallest value at which the distribution function reaches the share."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(np.asarray(weights)[order]) / np.sum(weights)
    return np.asarray(values)[order][np.argmax(reached >= share - 1e-9)]
