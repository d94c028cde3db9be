"""Records of what arrays hear and of what of it is processed.

Beams of all arrays stand in one axis, by array. A slot is a stretch of time in which a processor
works on one beam.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from drift.planning.arrays import manning
from drift.planning.arrays.manning import Crew
from geo import notation
from geo.array import Array, Real
from geo.errors import UserError

Chosen = tuple[tuple[int, ...], ...]  # of each slot the beams that are processed, ascending


@dataclass(frozen=True, eq=False)
class Hearing:
    """What each beam would hear if it were processed, and what can process it; `hearing` makes and
    checks one.

    A particle that several beams hear, in one slot or in several, is missed by each of them
    independently; but of beams that share a level in a slot (those of one array, on which a target
    is as loud in each) only the best counts. What slots fail in together (a level that fluctuates
    slowly) belongs into the chances of longer ones.
    """

    # of each slot, CSR float32 (beams, particles): that a particle is heard
    chance: tuple[Any, ...]
    weight: Real  # (particles,), at least 0
    array: NDArray[np.intp]  # (beams,) number of the array
    serves: NDArray[np.bool_]  # (processors, arrays): whether it can process beams of that array
    manned: NDArray[np.bool_]  # (slots, processors): whether it works in that slot
    cost: Real  # (slots, beams), in units of weight: what the beam must add to be worth a processor
    shared: NDArray[np.intp]  # (beams,): beams of one number share a level in a slot

    @property
    def slots(self) -> int:
        """Number of slots."""
        return len(self.chance)

    @property
    def beams(self) -> int:
        """Number of beams of all arrays."""
        return len(self.array)

    def crew(self, slot: int) -> Crew:
        """Return which arrays each processor can serve that works in a slot."""
        return tuple(tuple(row) for row in self.serves[self.manned[slot]].tolist())


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another way to use the processors, and what it is worth."""

    name: str
    beams: Chosen
    value: float


@dataclass(frozen=True, eq=False)
class Allocation:
    """Which beams are processed when."""

    processing: NDArray[np.intp]  # (slots, processors) beam; -1: idle
    heard: float  # weight that is heard at least once
    value: float  # the same, less what the beams cost
    bound: float  # no choice of beams is worth more
    exact: bool  # whether none is worth more than this one, by proof
    # (slots, beams): what a beam adds to all others that are processed, costs not taken off; NaN:
    # cannot be processed
    gain: Real
    by_slot: Real  # (slots,) weight that is heard by the end of each slot
    weight: float  # of all particles
    alternatives: tuple[Alternative, ...] = ()

    @property
    def chosen(self) -> Chosen:
        """Of each slot the beams that are processed."""
        return tuple(
            tuple(sorted(int(beam) for beam in row if beam >= 0)) for row in self.processing
        )


@dataclass(frozen=True)
class Names:
    """What people call arrays, beams and processors, and when slots begin and end."""

    arrays: tuple[str, ...]
    # of the axis of beams: its name within its array, such as where it looks
    beams: tuple[str, ...]
    processors: tuple[str, ...]
    edges: NDArray[np.datetime64] = field(compare=False)  # (slots + 1,) UTC

    def begins(self, slot: int) -> str:
        """Return the date-time group at which a slot begins."""
        return notation.format_dtg(self.edges[slot])


def names(hearing: Hearing, start: np.datetime64, slot: float) -> Names:
    """Return names by number, for slots of a length [s] from a start."""
    within: dict[int, int] = {}
    beams = []
    for array in hearing.array.tolist():
        within[array] = within.get(array, 0) + 1
        beams.append(f"beam {within[array]}")
    edges = start.astype("datetime64[s]") + np.round(np.arange(hearing.slots + 1) * slot).astype(
        "timedelta64[s]"
    )
    return Names(
        tuple(f"array {k + 1}" for k in range(hearing.serves.shape[1])),
        tuple(beams),
        tuple(f"processor {k + 1}" for k in range(len(hearing.serves))),
        edges,
    )


def hearing(
    chance: Sequence[Any],
    weight: Array,
    array: Sequence[int] | Array,
    processors: int | Array,
    *,
    manned: Array | None = None,
    cost: Array | None = None,
    shared: Sequence[int] | Array | None = None,
) -> Hearing:
    """Return what is heard, checked; raise UserError for all that is wrong with it.

    chance: of each slot, (particles, beams), dense or sparse. weight: (particles,). array: (beams,)
    numbers from 0. processors: how many, each for any array; or (processors, arrays) whether a
    processor can serve an array. manned: (slots, processors); None: all work in every slot. cost:
    (slots, beams); None: nothing. shared: (beams,) numbers of levels that beams share; None: each
    has its own.
    """
    arrays = np.asarray(array, np.intp)
    if arrays.ndim != 1 or len(arrays) == 0 or len(chance) == 0:
        raise UserError("processing: no beam or no time slot: there must be at least one of each")
    if arrays.min() < 0:
        raise UserError(
            f"processing.array: {arrays.min()} is no number of an array: they count from 0"
        )
    serves = (
        np.ones((processors, int(arrays.max()) + 1), bool)
        if isinstance(processors, (int, np.integer))
        else np.asarray(processors, bool)
    )
    if serves.ndim != 2 or len(serves) == 0 or serves.shape[1] <= arrays.max():
        raise UserError(
            f"processing.processors: table of shape {serves.shape} for {arrays.max() + 1} arrays: "
            "a row for each processor (at least one), a column for each array"
        )
    slots = len(chance)
    works = np.ones((slots, len(serves)), bool) if manned is None else np.asarray(manned, bool)
    prices = np.zeros((slots, len(arrays))) if cost is None else np.asarray(cost, float)
    levels = np.arange(len(arrays)) if shared is None else np.asarray(shared, np.intp)
    if levels.shape != arrays.shape:
        raise UserError(f"processing.shared: shape {levels.shape}, not (beams,) = ({len(arrays)},)")
    wrong = [*_shapes(slots, arrays, serves, works, prices), *_weights(np.asarray(weight, float))]
    made = []
    for k, table in enumerate(chance):
        beams = sparse.csc_array(table).T
        if beams.shape != (len(arrays), np.size(weight)):
            wrong.append(
                f"processing.chance: slot {k + 1} has the shape {beams.shape[::-1]}, not (particles, beams) = "
                f"({np.size(weight)}, {len(arrays)})"
            )
            continue
        beams.sum_duplicates()
        out = ~((beams.data >= 0) & (beams.data <= 1))
        if out.any():
            wrong.append(
                f"processing.chance: slot {k + 1} has {int(out.sum())} chances outside of 0 to 1, such as {beams.data[out][0]:g}"
            )
        beams = beams.astype(np.float32)
        beams.eliminate_zeros()
        made.append(beams)
    if wrong:
        raise UserError(*wrong)
    heard = Hearing(tuple(made), np.asarray(weight, float), arrays, serves, works, prices, levels)
    _surplus(heard)
    return heard


def _shapes(slots: int, array: Array, serves: Array, manned: Array, cost: Array) -> list[str]:
    """Return what is wrong with tables by slot."""
    wrong = []
    if manned.shape != (slots, len(serves)):
        wrong.append(
            f"processing.manned: shape {manned.shape}, not (slots, processors) = ({slots}, {len(serves)})"
        )
    if cost.shape != (slots, len(array)):
        wrong.append(
            f"processing.cost: shape {cost.shape}, not (slots, beams) = ({slots}, {len(array)})"
        )
    elif not (np.isfinite(cost).all() and (cost >= 0).all()):
        wrong.append(f"processing.cost: {cost.min():g} is no cost: each is finite and at least 0")
    return wrong


def _weights(weight: Real) -> list[str]:
    """Return what is wrong with the weights of particles."""
    if weight.ndim != 1 or not np.isfinite(weight).all():
        return [
            f"processing.weight: {np.count_nonzero(~np.isfinite(weight))} are not finite, shape {weight.shape}"
        ]
    if (weight < 0).any():
        return [
            f"processing.weight: {np.count_nonzero(weight < 0)} are negative, such as {weight.min():g}"
        ]
    return (
        [] if weight.sum() > 0 else ["processing.weight: all are 0: nothing is there to be heard"]
    )


def _surplus(heard: Hearing) -> None:
    """Refuse processors that have no beam left to work on."""
    many = np.bincount(heard.array, minlength=heard.serves.shape[1])
    for slot in range(heard.slots):
        over = manning.surplus(heard.crew(slot), tuple(many.tolist()))
        if over is not None:
            raise UserError(
                f"processing: {over[0]} processors for {over[1]} beams in slot {slot + 1}: "
                "at most as many as beams that they can serve; leave some out, or give them other arrays"
            )
