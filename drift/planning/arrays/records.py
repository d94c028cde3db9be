"""Records of the beam allocation: detection probabilities, processors and the result.

Beams of all arrays share one axis, ordered by array. A slot is an interval of time in which a
processor works on one beam.
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
    """Detection probabilities of all beams, and which processor can serve them.

    Create one with `hearing`, which checks it. Beams miss a particle independently, in one slot and
    in different slots. The exception: of beams that share a level in a slot (those of one array,
    because the target is equally loud in each), only the best counts. A correlation between slots
    (a level that fluctuates slowly) must be part of the probabilities of longer slots.
    """

    # for each slot, CSR float32 (beams, particles): probability that a particle is heard
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
        """Return which arrays each processor that works in a slot can serve."""
        return tuple(tuple(row) for row in self.serves[self.manned[slot]].tolist())


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another use of the processors, and its value."""

    name: str
    beams: Chosen
    value: float


@dataclass(frozen=True, eq=False)
class Allocation:
    """Which beams are processed when, and the weight that is heard."""

    processing: NDArray[np.intp]  # (slots, processors) beam; -1: idle
    heard: float  # weight that is heard at least once
    value: float  # the same, minus the cost of the beams
    bound: float  # no choice of beams is worth more
    exact: bool  # whether this choice is proved to be the best
    # (slots, beams): weight that a beam adds to the other processed ones, before costs; NaN: it
    # cannot be processed
    gain: Real
    by_slot: Real  # (slots,) weight that is heard by the end of each slot
    weight: float  # of all particles
    alternatives: tuple[Alternative, ...] = ()

    @property
    def chosen(self) -> Chosen:
        """The beams that are processed in each slot."""
        return tuple(
            tuple(sorted(int(beam) for beam in row if beam >= 0)) for row in self.processing
        )


@dataclass(frozen=True)
class Names:
    """Names of arrays, beams and processors, and the times of slots."""

    arrays: tuple[str, ...]
    # by beam: its name within its array, such as its bearing
    beams: tuple[str, ...]
    processors: tuple[str, ...]
    edges: NDArray[np.datetime64] = field(compare=False)  # (slots + 1,) UTC

    def begins(self, slot: int) -> str:
        """Return the date-time group of a slot's begin."""
        return notation.format_dtg(self.edges[slot])


def names(hearing: Hearing, start: np.datetime64, slot: float) -> Names:
    """Return numbered names for slots of equal length.

    Args:
        hearing: the allocation problem.
        start: begin of the first slot.
        slot: length of a slot [s].
    """
    counts: dict[int, int] = {}
    beams = []
    for array in hearing.array.tolist():
        counts[array] = counts.get(array, 0) + 1
        beams.append(f"beam {counts[array]}")
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
    """Return a checked allocation problem.

    Args:
        chance: for each slot the probability that each beam hears each particle, shape (particles,
            beams), dense or sparse.
        weight: of the particles, shape (particles,).
        array: index of each beam's array from 0, shape (beams,).
        processors: number of processors, each for any array; or whether a processor can serve an
            array, shape (processors, arrays).
        manned: whether a processor works in a slot, shape (slots, processors); None: always.
        cost: in units of weight, shape (slots, beams); None: 0.
        shared: index of the level that beams share, shape (beams,); None: each has its own.

    Raises:
        UserError: one line for each mistake.
    """
    arrays = np.asarray(array, np.intp)
    if arrays.ndim != 1 or len(arrays) == 0 or len(chance) == 0:
        raise UserError("processing: no beam or no time slot: there must be at least one of each")
    if arrays.min() < 0:
        raise UserError(
            f"processing.array: {arrays.min()} is no index of an array: they count from 0"
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
    """Return error messages about tables by slot."""
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
        wrong.append(
            f"processing.cost: {cost.min():g} is no cost: costs must be finite and at least 0"
        )
    return wrong


def _weights(weight: Real) -> list[str]:
    """Return error messages about the weights."""
    if weight.ndim != 1 or not np.isfinite(weight).all():
        return [
            f"processing.weight: {np.count_nonzero(~np.isfinite(weight))} are not finite, shape {weight.shape}"
        ]
    if (weight < 0).any():
        return [
            f"processing.weight: {np.count_nonzero(weight < 0)} are negative, such as {weight.min():g}"
        ]
    return (
        [] if weight.sum() > 0 else ["processing.weight: all are 0; at least one must be positive"]
    )


def _surplus(heard: Hearing) -> None:
    """Raise UserError if processors outnumber the beams that they can serve."""
    many = np.bincount(heard.array, minlength=heard.serves.shape[1])
    for slot in range(heard.slots):
        over = manning.surplus(heard.crew(slot), tuple(many.tolist()))
        if over is not None:
            raise UserError(
                f"processing: {over[0]} processors for {over[1]} beams in slot {slot + 1}: "
                "at most as many as beams that they can serve; leave some out, or give them other arrays"
            )
