"""Choices of beams: greedy, then by exchange until no single one makes it better.

What is heard is a monotone submodular function of the beams processed, and they are independent in
a matroid: greedy alone has at least half of the best (Fisher, Nemhauser and Wolsey 1978, Math.
Programming Study 8, 73, doi:10.1007/BFb0121195), a choice without a better exchange too. In
practice both are far nearer (tests/planning/arrays).
"""

import heapq

import numpy as np

from drift.planning.arrays import manning
from drift.planning.arrays.records import Chosen, Hearing
from geo.array import Array, Real

LEAST = 1e-12  # share of the weight by which an exchange must be better
SWEEPS = 50  # of exchanges; never reached in practice, for each makes the choice better


class Missed:
    """What the beams chosen so far miss: kept up to date as beams come and go."""

    def __init__(self, hearing: Hearing, chosen: Chosen) -> None:
        """Take the beams chosen of each slot."""
        self.hearing = hearing
        # weight times the chance that those miss it which do not hear it for sure
        self.rest = hearing.weight.copy()
        # how many levels of slots are heard for sure
        self.sure = np.zeros(len(hearing.weight), np.int32)
        # whether no two beams share a level
        self.alone = len(np.unique(hearing.shared)) == len(hearing.shared)
        # Of each slot and shared level, the beams that are processed, and the best chance of each
        # particle.
        self.used: dict[tuple[int, int], list[int]] = {}
        self.best: dict[tuple[int, int], Real] = {}
        for slot, beams in enumerate(chosen):
            for beam in beams:
                self.add(slot, beam)

    def add(self, slot: int, beam: int) -> None:
        """Process a beam."""
        at, chance = row(self.hearing, slot, beam)
        if self.alone:
            self._change(at, 0.0, chance)
            return
        level = slot, int(self.hearing.shared[beam])
        self.used.setdefault(level, []).append(beam)
        best = self.best.setdefault(level, np.zeros(len(self.rest)))
        before = best[at]
        best[at] = np.maximum(before, chance)
        self._change(at, before, best[at])

    def drop(self, slot: int, beam: int) -> None:
        """Process a beam no more."""
        at, chance = row(self.hearing, slot, beam)
        if self.alone:
            self._change(at, chance, 0.0)
            return
        level = slot, int(self.hearing.shared[beam])
        self.used[level].remove(beam)
        before, best = self.best[level][at], np.zeros(len(self.rest))
        for other in self.used[level]:
            there, chances = row(self.hearing, slot, other)
            best[there] = np.maximum(best[there], chances)
        self.best[level] = best
        self._change(at, before, best[at])

    def _change(self, at: Array, before: Real | float, after: Real | float) -> None:
        """Have particles be heard with other chances by one level of a slot."""
        self.rest[at] *= np.where(np.less(after, 1), np.subtract(1, after), 1) / np.where(
            np.less(before, 1), np.subtract(1, before), 1
        )
        self.sure[at] += np.equal(after, 1).astype(np.int32) - np.equal(before, 1)

    @property
    def weight(self) -> Real:
        """Weight that is missed, of each particle (particles,)."""
        return np.where(self.sure == 0, self.rest, 0.0)

    def gain(self, slot: int, beam: int) -> float:
        """Return the weight that a beam adds."""
        at, chance = row(self.hearing, slot, beam)
        left = np.where(self.sure[at] == 0, self.rest[at], 0.0)
        level = slot, int(self.hearing.shared[beam])
        if not self.used.get(level):
            return float(np.dot(left, chance))
        best = self.best[level][at]
        return float(np.dot(left, np.maximum(chance - best, 0) / np.where(best < 1, 1 - best, 1)))

    def gains(self, slot: int) -> Real:
        """Return the weight that each beam of a slot adds, (beams,)."""
        found = np.asarray(self.hearing.chance[slot] @ self.weight, float)
        levels = [level for (at, level), beams in self.used.items() if at == slot and beams]
        for beam in np.flatnonzero(np.isin(self.hearing.shared, levels)).tolist() if levels else ():
            found[beam] = self.gain(slot, beam)
        return found


def row(hearing: Hearing, slot: int, beam: int) -> tuple[Array, Real]:
    """Return the particles that a beam hears, and the chances of that in double precision."""
    table = hearing.chance[slot]
    part = slice(table.indptr[beam], table.indptr[beam + 1])
    return table.indices[part], table.data[part].astype(float)


def heard(hearing: Hearing, chosen: Chosen) -> float:
    """Return the weight that is heard at least once."""
    return float(hearing.weight.sum() - Missed(hearing, chosen).weight.sum())


def costs(hearing: Hearing, chosen: Chosen) -> float:
    """Return what the beams cost together."""
    return float(sum(hearing.cost[slot, list(beams)].sum() for slot, beams in enumerate(chosen)))


def value(hearing: Hearing, chosen: Chosen) -> float:
    """Return the weight that is heard at least once, less what the beams cost."""
    return heard(hearing, chosen) - costs(hearing, chosen)


def greedy(
    hearing: Hearing,
    *,
    first: tuple[int, int] | None = None,
    without: tuple[int, int] | None = None,
) -> Chosen:
    """Return beams chosen over all slots, each time the one that adds most (lazily: Minoux 1978,
    doi:10.1007/BFb0006528).

    first, without: slot and beam of one that is chosen before all others, and of one that is not
    chosen.
    """
    crews = [hearing.crew(slot) for slot in range(hearing.slots)]
    chosen: list[tuple[int, ...]] = [()] * hearing.slots
    if first is not None:
        chosen[first[0]] = (first[1],)
    missed = Missed(hearing, tuple(chosen))
    fit = [
        manning.extends(beams, hearing.array, crew)
        for beams, crew in zip(chosen, crews, strict=True)
    ]
    heap = [
        (-float(gain), slot, beam, 0)
        for slot in range(hearing.slots)
        for beam, gain in enumerate(missed.gains(slot) - hearing.cost[slot])
        if gain > 0 and beam not in chosen[slot] and (slot, beam) != without
    ]
    heapq.heapify(heap)
    taken = 0
    while heap:
        _, slot, beam, when = heapq.heappop(heap)
        if not fit[slot][beam]:
            continue  # nor will it later
        if when < taken:
            gain = missed.gain(slot, beam) - float(hearing.cost[slot, beam])
            if gain > 0:
                heapq.heappush(heap, (-gain, slot, beam, taken))
            continue
        missed.add(slot, beam)
        chosen[slot] = tuple(sorted((*chosen[slot], beam)))
        fit[slot] = manning.extends(chosen[slot], hearing.array, crews[slot])
        taken += 1
    return tuple(chosen)


def in_order(hearing: Hearing, *, knowing: bool) -> Chosen:
    """Return beams chosen slot after slot; knowing: given what the slots before missed, else as if
    each were alone.
    """
    missed = Missed(hearing, ())
    chosen = []
    for slot in range(hearing.slots):
        beams = _slot(hearing, missed, slot)
        for beam in () if knowing else beams:
            missed.drop(slot, beam)
        chosen.append(beams)
    return tuple(chosen)


def _slot(hearing: Hearing, missed: Missed, slot: int) -> tuple[int, ...]:
    """Choose beams of a slot in which none is processed, each time the one that adds most, and
    leave them processed.
    """
    crew = hearing.crew(slot)
    chosen: tuple[int, ...] = ()
    while True:
        fit = manning.extends(chosen, hearing.array, crew)
        gains = np.where(fit, missed.gains(slot) - hearing.cost[slot], 0.0)
        gains[list(chosen)] = 0
        beam = int(np.argmax(gains))
        if gains[beam] <= 0:
            return tuple(sorted(chosen))
        missed.add(slot, beam)
        chosen = (*chosen, beam)


def exchanged(hearing: Hearing, chosen: Chosen) -> Chosen:
    """Return a choice that no beam more, none less and none instead of another makes better."""
    least = LEAST * float(hearing.weight.sum())
    now = list(chosen)
    for _ in range(SWEEPS):
        missed = Missed(hearing, tuple(now))
        before = list(now)
        for slot in range(hearing.slots):
            now[slot] = _swapped(hearing, missed, slot, now[slot], least)
        if now == before:
            break
    return tuple(now)


def _swapped(
    hearing: Hearing, missed: Missed, slot: int, chosen: tuple[int, ...], least: float
) -> tuple[int, ...]:
    """Return the beams of a slot after each in turn gave way to the one that adds most in its
    place.
    """
    crew, cost = hearing.crew(slot), hearing.cost[slot]
    places: list[int | None] = [*chosen, *[None] * (len(crew) - len(chosen))]
    for k, beam in enumerate(places):
        others = tuple(b for j, b in enumerate(places) if b is not None and j != k)
        fit = manning.extends(others, hearing.array, crew)
        if not fit.any():
            continue
        if beam is not None:
            missed.drop(slot, beam)
        gains = np.where(fit, missed.gains(slot) - cost, -np.inf)
        gains[list(others)] = -np.inf
        other = int(np.argmax(gains))
        now = 0.0 if beam is None else float(gains[beam])
        if gains[other] > now + least and gains[other] > 0:
            places[k] = other
        elif now < -least:
            places[k] = None
        put = places[k]
        if put is not None:
            missed.add(slot, put)
    return tuple(sorted(b for b in places if b is not None))
