"""Which beams can be processed at the same time: those to which different processors can be given.

Such sets of beams are the independent sets of a transversal matroid (Edmonds and Fulkerson 1965, J.
Res. Natl. Bur. Stand. 69B, 147). So taking beams by falling score, each that still fits, makes the
highest sum of scores (Edmonds 1971, Math. Programming 1, 127, doi:10.1007/BF01584082): no linear
programme does better. Beams of one array differ in nothing here, so that all depends on how many
each array has.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from geo.array import Array

# of each processor that works in a slot, whether it can serve each array
Crew = tuple[tuple[bool, ...], ...]


@lru_cache(maxsize=65536)
def fits(crew: Crew, counts: tuple[int, ...]) -> bool:
    """Whether processors can be given to so many beams of each array."""
    return _matched(crew, counts)[0]


def _matched(crew: Crew, counts: tuple[int, ...]) -> tuple[bool, list[int]]:
    """Return whether each beam found a processor (augmenting paths), and of each processor the
    array, -1: none.
    """
    given = [-1] * len(crew)

    def free(array: int, seen: set[int]) -> bool:
        for k, serves in enumerate(crew):
            if serves[array] and k not in seen:
                seen.add(k)
                if given[k] < 0 or free(given[k], seen):
                    given[k] = array
                    return True
        return False

    if sum(counts) > len(crew):
        return False, given
    return all(free(array, set()) for array, many in enumerate(counts) for _ in range(many)), given


def surplus(crew: Crew, many: tuple[int, ...]) -> tuple[int, int] | None:
    """Return some processors that have fewer beams than they are, and those beams' number (Hall
    1935); None: there are none.

    many: beams of each array.
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
    """Return the beams of the highest sum of scores above 0 that fit together; of equal ones the
    first.

    score: (beams,). array: (beams,). chosen: beams that are processed in any case.
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
    """Return which beams fit together with those chosen, (beams,)."""
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
    """Return the beam of each processor of a crew, -1: idle, so that as few as can be change their
    beam or array.

    before: the beam of each of them in the slot before; -1: idle.
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
    # of equal ones, in order
    effort += 1e-6 * np.arange(len(crew))[:, None] * np.arange(len(beams), 0, -1)
    rows, columns = optimize.linear_sum_assignment(effort)
    given = [-1] * len(crew)
    for k, j in zip(rows.tolist(), columns.tolist(), strict=True):
        given[k] = beams[j]
    return tuple(given)
