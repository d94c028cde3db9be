"""Feasible sets of beams: those to which different processors can be assigned.

These sets are the independent sets of a transversal matroid (Edmonds and Fulkerson 1965, J. Res.
Natl. Bur. Stand. 69B, 147). Taking beams by falling score, each one that still fits, therefore
maximises the sum of scores (Edmonds 1971, Math. Programming 1, 127, doi:10.1007/BF01584082); a
linear programme cannot do better. Beams of one array are interchangeable here, so feasibility
depends only on the number of beams of each array.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from geo.array import Array

# for each processor that works in a slot: whether it can serve each array
Crew = tuple[tuple[bool, ...], ...]


@lru_cache(maxsize=65536)
def fits(crew: Crew, counts: tuple[int, ...]) -> bool:
    """Return True if the crew can process this number of beams of each array."""
    return _matched(crew, counts)[0]


def _matched(crew: Crew, counts: tuple[int, ...]) -> tuple[bool, list[int]]:
    """Return whether every beam gets a processor, and each processor's array (-1: none).

    Uses augmenting paths.
    """
    assigned = [-1] * len(crew)

    def assign(array: int, seen: set[int]) -> bool:
        for k, serves in enumerate(crew):
            if serves[array] and k not in seen:
                seen.add(k)
                if assigned[k] < 0 or assign(assigned[k], seen):
                    assigned[k] = array
                    return True
        return False

    if sum(counts) > len(crew):
        return False, assigned
    return all(
        assign(array, set()) for array, many in enumerate(counts) for _ in range(many)
    ), assigned


def surplus(crew: Crew, many: tuple[int, ...]) -> tuple[int, int] | None:
    """Return a set of processors that outnumbers the beams it can serve (Hall 1935).

    Args:
        crew: which arrays each processor can serve.
        many: number of beams of each array.

    Returns:
        The number of these processors and the number of beams that they can serve; None if there is
            no such set.
    """
    working: list[list[int]] = [[] for _ in many]  # processors by array

    def place(processor: int, seen: set[int]) -> bool:
        for array, serves in enumerate(crew[processor]):
            if serves and array not in seen:
                seen.add(array)
                if len(working[array]) < many[array]:
                    working[array].append(processor)
                    return True
                for at, other in enumerate(working[array]):
                    if place(other, seen):
                        working[array][at] = processor
                        return True
        return False

    for processor in range(len(crew)):
        reached: set[int] = set()
        if not place(processor, reached):
            return 1 + sum(len(working[array]) for array in reached), sum(
                many[array] for array in reached
            )
    return None


def best(score: Array, array: Array, crew: Crew, chosen: tuple[int, ...] = ()) -> tuple[int, ...]:
    """Return the feasible set of beams with the highest sum of positive scores.

    Args:
        score: value of each beam, shape (beams,).
        array: index of each beam's array, shape (beams,).
        crew: which arrays each processor can serve.
        chosen: beams that are processed in any case.

    Returns:
        Beams in ascending order; of equal scores the lower beam comes first.
    """
    counts = [0] * (len(crew[0]) if crew else 0)
    for beam in chosen:
        counts[array[beam]] += 1
    taken = list(chosen)
    candidates = np.flatnonzero(score > 0)
    for beam in candidates[np.argsort(-score[candidates], kind="stable")].tolist():
        if len(taken) >= len(crew):
            break
        if beam in taken:
            continue
        counts[array[beam]] += 1
        if fits(crew, tuple(counts)):
            taken.append(beam)
        else:
            counts[array[beam]] -= 1
    return tuple(sorted(taken))


def extends(chosen: tuple[int, ...], array: Array, crew: Crew) -> NDArray[np.bool_]:
    """Return which single beams fit together with the chosen ones, shape (beams,)."""
    if len(chosen) >= len(crew):
        return np.zeros(len(array), bool)
    counts = [0] * len(crew[0])
    for beam in chosen:
        counts[array[beam]] += 1
    fit = [
        fits(crew, tuple(n + (k == a) for k, n in enumerate(counts))) for a in range(len(counts))
    ]
    return np.asarray(np.array(fit)[array])


def shared_out(
    beams: tuple[int, ...], array: Array, crew: Crew, before: tuple[int, ...]
) -> tuple[int, ...]:
    """Assign beams to processors with as few changes of beam or array as possible.

    Args:
        beams: the beams that are processed.
        array: index of each beam's array, shape (beams,).
        crew: which arrays each processor can serve.
        before: each processor's beam in the slot before, -1: idle.

    Returns:
        Each processor's beam, -1: idle.
    """
    from scipy import optimize  # imported here, because it takes a third of a second

    if not beams:
        return (-1,) * len(crew)
    effort = np.zeros((len(crew), len(beams)))
    for k, serves in enumerate(crew):
        for j, beam in enumerate(beams):
            same = before[k] == beam
            near = before[k] >= 0 and array[before[k]] == array[beam]
            effort[k, j] = (0 if same else 1 if near else 1.5) if serves[array[beam]] else 1e6
    # break ties by the order of processors and beams
    effort += 1e-6 * np.arange(len(crew))[:, None] * np.arange(len(beams), 0, -1)
    rows, columns = optimize.linear_sum_assignment(effort)
    assigned = [-1] * len(crew)
    for k, j in zip(rows.tolist(), columns.tolist(), strict=True):
        assigned[k] = beams[j]
    return tuple(assigned)
