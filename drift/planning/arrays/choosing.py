"""Heuristics that choose beams: greedy choice, then exchanges of single beams.

The probability of hearing the target is a monotone submodular function of the set of processed
beams, and the feasible sets form a matroid. Greedy choice therefore reaches at least half of the
optimum (Fisher, Nemhauser and Wolsey 1978, Math. Programming Study 8, 73, doi:10.1007/BFb0121195);
so does a choice that no exchange improves. In practice both come far closer
(tests/planning/arrays).
"""

import heapq

import numpy as np

from drift.planning.arrays import manning
from drift.planning.arrays.records import Chosen, Hearing
from geo.array import Array, Real

LEAST = 1e-12  # share of the weight by which an exchange must be better
SWEEPS = 50  # at most; in practice exchanges stop to improve the choice much earlier


class Missed:
    """Weight that the processed beams miss, updated as beams are added and dropped."""

    def __init__(self, hearing: Hearing, chosen: Chosen) -> None:
        """Start with the beams that are chosen in each slot."""
        self.hearing = hearing
        # weight times the probability that all beams miss, without those that hear for certain
        self.rest = hearing.weight.copy()
        # number of levels (in all slots) that hear the particle for certain
        self.sure = np.zeros(len(hearing.weight), np.int32)
        # whether no two beams share a level
        self.alone = len(np.unique(hearing.shared)) == len(hearing.shared)
        # For each slot and shared level: the processed beams, and each particle's highest
        # probability of being heard.
        self.used: dict[tuple[int, int], list[int]] = {}
        self.best: dict[tuple[int, int], Real] = {}
        for slot, beams in enumerate(chosen):
            for beam in beams:
                self.add(slot, beam)

    def add(self, slot: int, beam: int) -> None:
        """Add a beam to the processed ones."""
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
        """Remove a beam from the processed ones."""
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
        """Change the probability with which one level of a slot hears some particles."""
        self.rest[at] *= np.where(np.less(after, 1), np.subtract(1, after), 1) / np.where(
            np.less(before, 1), np.subtract(1, before), 1
        )
        self.sure[at] += np.equal(after, 1).astype(np.int32) - np.equal(before, 1)

    @property
    def weight(self) -> Real:
        """Missed weight of each particle, shape (particles,)."""
        return np.where(self.sure == 0, self.rest, 0.0)

    def gain(self, slot: int, beam: int) -> float:
        """Return the weight that one more beam would add."""
        at, chance = row(self.hearing, slot, beam)
        left = np.where(self.sure[at] == 0, self.rest[at], 0.0)
        level = slot, int(self.hearing.shared[beam])
        if not self.used.get(level):
            return float(np.dot(left, chance))
        best = self.best[level][at]
        return float(np.dot(left, np.maximum(chance - best, 0) / np.where(best < 1, 1 - best, 1)))

    def gains(self, slot: int) -> Real:
        """Return the weight that each beam of a slot would add, shape (beams,)."""
        found = np.asarray(self.hearing.chance[slot] @ self.weight, float)
        levels = [level for (at, level), beams in self.used.items() if at == slot and beams]
        for beam in np.flatnonzero(np.isin(self.hearing.shared, levels)).tolist() if levels else ():
            found[beam] = self.gain(slot, beam)
        return found


def row(hearing: Hearing, slot: int, beam: int) -> tuple[Array, Real]:
    """Return the particles that a beam hears, and with which probability.

    Args:
        hearing: detection probabilities of all beams.
        slot: index of the slot.
        beam: index of the beam.

    Returns:
        Indices of the particles with a probability above 0, and these probabilities in double
            precision.
    """
    table = hearing.chance[slot]
    part = slice(table.indptr[beam], table.indptr[beam + 1])
    return table.indices[part], table.data[part].astype(float)


def heard(hearing: Hearing, chosen: Chosen) -> float:
    """Return the weight of the target being heard at least once."""
    return float(hearing.weight.sum() - Missed(hearing, chosen).weight.sum())


def costs(hearing: Hearing, chosen: Chosen) -> float:
    """Return the total cost of the chosen beams."""
    return float(sum(hearing.cost[slot, list(beams)].sum() for slot, beams in enumerate(chosen)))


def value(hearing: Hearing, chosen: Chosen) -> float:
    """Return the weight that is heard at least once, less the cost of the beams."""
    return heard(hearing, chosen) - costs(hearing, chosen)


def greedy(
    hearing: Hearing,
    *,
    first: tuple[int, int] | None = None,
    without: tuple[int, int] | None = None,
) -> Chosen:
    """Return a greedy choice of beams over all slots.

    Each step adds the beam with the highest gain (lazy evaluation: Minoux 1978,
    doi:10.1007/BFb0006528).

    Args:
        hearing: detection probabilities of all beams.
        first: slot and beam that are chosen before all others.
        without: slot and beam that must not be chosen.
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
            continue  # more beams never make it fit again
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
    """Return a greedy choice that is made slot after slot.

    Args:
        hearing: detection probabilities of all beams.
        knowing: True: each slot takes account of what earlier slots have heard; False: each slot is
            optimised alone.
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
    """Add the beams of one slot greedily to the processed ones and return them."""
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
    """Return a choice that no added, dropped or exchanged single beam improves."""
    threshold = LEAST * float(hearing.weight.sum())
    current = list(chosen)
    for _ in range(SWEEPS):
        missed = Missed(hearing, tuple(current))
        before = list(current)
        for slot in range(hearing.slots):
            current[slot] = _swapped(hearing, missed, slot, current[slot], threshold)
        if current == before:
            break
    return tuple(current)


def _swapped(
    hearing: Hearing, missed: Missed, slot: int, chosen: tuple[int, ...], threshold: float
) -> tuple[int, ...]:
    """Return the beams of a slot after replacing each in turn by the best alternative."""
    crew, cost = hearing.crew(slot), hearing.cost[slot]
    positions: list[int | None] = [*chosen, *[None] * (len(crew) - len(chosen))]
    for k, beam in enumerate(positions):
        others = tuple(b for j, b in enumerate(positions) if b is not None and j != k)
        fit = manning.extends(others, hearing.array, crew)
        if not fit.any():
            continue
        if beam is not None:
            missed.drop(slot, beam)
        gains = np.where(fit, missed.gains(slot) - cost, -np.inf)
        gains[list(others)] = -np.inf
        other = int(np.argmax(gains))
        own_gain = 0.0 if beam is None else float(gains[beam])
        if gains[other] > own_gain + threshold and gains[other] > 0:
            positions[k] = other
        elif own_gain < -threshold:
            positions[k] = None
        replacement = positions[k]
        if replacement is not None:
            missed.add(slot, replacement)
    return tuple(sorted(b for b in positions if b is not None))
