"""Small problems of allocation, and brute force over all choices."""

import itertools

import numpy as np

from drift.planning.arrays import records
from drift.planning.arrays.records import Hearing
from geo.errors import UserError


def options(hearing: Hearing, slot: int) -> list[tuple[int, ...]]:
    """Return every set of beams to which different processors can be given in a slot, by trying
    all.
    """
    crew = hearing.serves[hearing.manned[slot]]
    found = set()
    for given in itertools.product(range(-1, hearing.beams), repeat=len(crew)):
        beams = [beam for beam in given if beam >= 0]
        if len(set(beams)) == len(beams) and all(
            b < 0 or crew[k][hearing.array[b]] for k, b in enumerate(given)
        ):
            found.add(tuple(sorted(beams)))
    return sorted(found)


def silent(table: np.ndarray, beams: tuple[int, ...], shared: np.ndarray) -> np.ndarray:
    """Return the chance that each particle is missed: of beams that share a level the best counts."""
    missed = np.ones(table.shape[1])
    for level in set(shared[list(beams)].tolist()):
        missed *= 1 - table[[beam for beam in beams if shared[beam] == level]].max(axis=0)
    return missed


def brute_force(hearing: Hearing) -> float:
    """Return the most that any choice of beams is worth."""
    sets = [options(hearing, slot) for slot in range(hearing.slots)]
    tables = [table.toarray().astype(float) for table in hearing.chance]
    missed = [[silent(tables[s], o, hearing.shared) for o in sets[s]] for s in range(hearing.slots)]
    cost = [[hearing.cost[s, list(o)].sum() for o in sets[s]] for s in range(hearing.slots)]
    best = 0.0
    for choice in itertools.product(*(range(len(o)) for o in sets)):
        rest = np.prod([missed[s][i] for s, i in enumerate(choice)], axis=0)
        paid = sum(cost[s][i] for s, i in enumerate(choice))
        best = max(best, float(hearing.weight @ (1 - rest)) - paid)
    return best


def small(seed: int) -> Hearing:
    """Return a random case that brute force can do; its beams overlap within slots and from slot to
    slot.
    """
    for attempt in itertools.count():
        rng = np.random.default_rng((seed, attempt))
        slots, beams, arrays = (int(rng.integers(*ends)) for ends in ((1, 4), (3, 7), (1, 4)))
        many, processors = int(rng.integers(3, 40)), int(rng.integers(1, 3))
        array = np.append(np.sort(rng.integers(0, arrays, beams - 1)), arrays - 1)
        share, power = rng.choice([0.2, 0.5, 0.9]), rng.choice([0.2, 1.0, 3.0])
        chance = (rng.random((slots, many, beams)) < share) * rng.random(
            (slots, many, beams)
        ) ** power
        if seed % 5 == 0:
            chance = np.where(chance > 0.5, 1.0, 0.0)  # all or nothing
        if seed % 7 == 0:
            chance = np.round(2 * chance) / 2  # ties
        manned = rng.random((slots, processors)) < (0.8 if seed % 3 == 0 else 1.1)
        cost = 0.1 * rng.random((slots, beams)) if seed % 4 == 0 else None
        weight = rng.gamma(0.5, 1, many)
        serves = rng.random((processors, arrays)) < 0.7
        try:
            return records.hearing(
                chance, weight / weight.sum(), array, serves, manned=manned, cost=cost
            )
        except UserError:
            continue  # more processors than beams
    raise AssertionError
