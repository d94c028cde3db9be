"""Beam allocation: which beams to process in which slot if there are fewer processors than beams.

The allocation maximises the weight that is heard at least once, sum w (1 - prod (1 - p)) over the
chosen beams. If no particle is heard by two beams, in any slots, the objective is linear and the
answer exact (`manning.best`). Otherwise a linear programme counts particles twice that two beams
hear (it may find 0.49 where the optimum is 0.63). Beams are then chosen greedily and exchanged over
all slots together, from several starts (`choosing`), with an upper bound of any choice
(`relaxation`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drift.planning.arrays import choosing, manning, relaxation
from drift.planning.arrays.records import Allocation, Alternative, Chosen, Hearing
from drift.planning.arrays.relaxation import Relaxed
from geo.array import Real
from geo.errors import UserError

# particles on which starts and the bound are first computed; the final values use all particles
SAMPLE = 10_000
STEPS, LAST = 200, 20  # of the search for the bound: on the sample, then on all particles
GAP = 1e-4  # relative duality gap at which that search ends
# table entries that may be visited to vary the choice; most variations
EFFORT, MOST = 2e8, 200
EACH = 500  # table entries that take as long as the overhead of one beam
SAME = 1e-9  # share of the weight within which a choice counts as equal to its bound
FIXED = "the same beams all the time"
ALONE = "each slot by itself"
IN_TURN = "slot after slot"


def allocate(hearing: Hearing, *, today: Chosen | None = None) -> Allocation:
    """Return the best allocation of processors to beams that is found, with its bound.

    Args:
        hearing: detection probabilities of all beams.
        today: the beams of each slot in the present practice, reported as one more alternative.

    Raises:
        UserError: beams of `today` do not exist or cannot be processed together.
    """
    if today is not None:
        _check_today(hearing, today)
    others = {FIXED: _fixed(hearing)} if hearing.slots > 1 else {}
    if hearing.slots > 1:
        others |= {
            ALONE: choosing.in_order(hearing, knowing=False),
            IN_TURN: choosing.in_order(hearing, knowing=True),
        }
    if today is not None:
        others["as today"] = today
    linear, ceiling = _linear(hearing)
    total = float(hearing.weight.sum())
    if choosing.value(hearing, linear) >= ceiling - SAME * total:
        chosen, bound = linear, ceiling
    else:
        chosen, relaxed = _search(hearing, [linear, *others.values()])
        bound = min(relaxed.bound, ceiling, total)
    heard = choosing.heard(hearing, chosen)
    value = heard - choosing.costs(hearing, chosen)
    return Allocation(
        shared_out(hearing, chosen),
        heard,
        value,
        max(bound, value),
        bound <= value + SAME * total,
        gains(hearing, chosen),
        _by_slot(hearing, chosen),
        total,
        tuple(
            Alternative(name, beams, choosing.value(hearing, beams))
            for name, beams in others.items()
        ),
    )


def _search(hearing: Hearing, starts: list[Chosen]) -> tuple[Chosen, Relaxed]:
    """Return the best choice that local search finds, and the relaxation's bound."""
    part = sampled(hearing)
    chosen = best(part, [choosing.greedy(part), *starts])
    chosen = best(part, [chosen, *_variations(part, chosen)])
    share = np.zeros((hearing.slots, hearing.beams))
    for slot, beams in enumerate(chosen):
        share[slot, list(beams)] = 1
    relaxed = relaxation.bound(part, share, steps=STEPS, gap=GAP)
    chosen = best(part, [chosen, _rounded(part, relaxed.share)])
    if part is hearing:
        return chosen, relaxed
    sharp = relaxation.SMOOTH[1]
    relaxed = relaxation.bound(hearing, relaxed.share, steps=LAST, gap=GAP, soft=(sharp, sharp))
    chosen = best(hearing, [chosen, _rounded(hearing, relaxed.share)])
    worth = choosing.value(hearing, chosen)
    return best(
        hearing, [chosen, *(start for start in starts if choosing.value(hearing, start) > worth)]
    ), relaxed


def sampled(hearing: Hearing) -> Hearing:
    """Return the allocation problem on every k-th particle, at least SAMPLE of them."""
    many = len(hearing.weight)
    if many < 2 * SAMPLE:
        return hearing
    indices = np.arange(many // (2 * (many // SAMPLE)), many, many // SAMPLE)
    weight = hearing.weight[indices]
    if weight.sum() == 0:
        return hearing
    chance = tuple(table[:, indices] for table in hearing.chance)
    return replace(hearing, chance=chance, weight=weight * (hearing.weight.sum() / weight.sum()))


def best(hearing: Hearing, starts: list[Chosen]) -> Chosen:
    """Return the best result of exchanges from several starts; of equal ones the first."""
    return max(
        (choosing.exchanged(hearing, start) for start in dict.fromkeys(starts)),
        key=lambda choice: choosing.value(hearing, choice),
    )


def _fixed(hearing: Hearing) -> Chosen:
    """Return a good choice with the same beams in every slot.

    Only processors that work in every slot are used.
    """
    misses = None
    with np.errstate(divide="ignore"):
        for table in hearing.chance:
            log = table.astype(float)
            log.data = -np.log1p(-log.data)
            misses = log if misses is None else misses + log
    assert misses is not None
    misses.data = -np.expm1(-misses.data)
    together = Hearing(
        (misses.tocsr(),),
        hearing.weight,
        hearing.array,
        hearing.serves,
        np.all(hearing.manned, axis=0, keepdims=True),
        hearing.cost.sum(axis=0, keepdims=True),
        hearing.shared,
    )
    return choosing.exchanged(together, choosing.greedy(together)) * hearing.slots


def gains(hearing: Hearing, chosen: Chosen) -> Real:
    """Return the weight that each beam adds to the other processed beams, (slots, beams).

    NaN marks beams that no processor can serve.
    """
    missed = choosing.Missed(hearing, chosen)
    added = np.empty((hearing.slots, hearing.beams))
    for slot, beams in enumerate(chosen):
        added[slot] = missed.gains(slot)
        for beam in beams:
            missed.drop(slot, beam)
            added[slot, beam] = missed.gain(slot, beam)
            missed.add(slot, beam)
        served = manning.extends((), hearing.array, hearing.crew(slot))
        added[slot] = np.where(served, added[slot], np.nan)
    return added


def _by_slot(hearing: Hearing, chosen: Chosen) -> Real:
    """Return the weight that is heard by the end of each slot, shape (slots,)."""
    missed, total = choosing.Missed(hearing, ()), float(hearing.weight.sum())
    heard = np.empty(hearing.slots)
    for slot, beams in enumerate(chosen):
        for beam in beams:
            missed.add(slot, beam)
        heard[slot] = total - float(missed.weight.sum())
    return heard


def shared_out(hearing: Hearing, chosen: Chosen) -> NDArray[np.intp]:
    """Return the beam of each processor, shape (slots, processors), -1: idle.

    Processors keep their beam from slot to slot if possible.
    """
    assigned = np.full(hearing.manned.shape, -1, np.intp)
    previous = np.full(len(hearing.serves), -1, np.intp)
    for slot, beams in enumerate(chosen):
        works = np.flatnonzero(hearing.manned[slot])
        last = tuple(previous[works].tolist())
        assigned[slot, works] = manning.shared_out(beams, hearing.array, hearing.crew(slot), last)
        previous = np.where(assigned[slot] >= 0, assigned[slot], previous)
    return assigned


def _linear(hearing: Hearing) -> tuple[Chosen, float]:
    """Return the optimum of the linear objective, and an upper bound of every choice.

    The linear objective counts particles once for every beam that hears them.
    """
    chosen, ceiling = [], 0.0
    for slot, table in enumerate(hearing.chance):
        gain = np.asarray(table @ hearing.weight, float) - hearing.cost[slot]
        beams = manning.best(gain, hearing.array, hearing.crew(slot))
        chosen.append(beams)
        ceiling += float(gain[list(beams)].sum())
    return tuple(chosen), ceiling * (1 + SAME)


def _variations(hearing: Hearing, chosen: Chosen) -> list[Chosen]:
    """Return greedy choices that start with another beam, or leave out a chosen one.

    Their number is limited by the work that each one takes.
    """
    looks = hearing.slots * hearing.beams * (1 + sum(map(len, chosen)))
    work = 10 * sum(table.nnz for table in hearing.chance) + EACH * looks
    many = int(EFFORT / max(work, EFFORT / MOST))
    missed = choosing.Missed(hearing, ())
    gain = np.stack([missed.gains(slot) for slot in range(hearing.slots)]) - hearing.cost
    firsts = [
        divmod(int(k), hearing.beams)
        for k in np.argsort(-gain, axis=None, kind="stable")
        if gain.flat[k] > 0
    ]
    firsts = [
        (slot, beam)
        for slot, beam in firsts
        if manning.extends((), hearing.array, hearing.crew(slot))[beam]
    ]
    used = [(slot, beam) for slot, beams in enumerate(chosen) for beam in beams]
    return [
        *(choosing.greedy(hearing, without=beam) for beam in used[: many // 2]),
        *(choosing.greedy(hearing, first=beam) for beam in firsts[: many // 2]),
    ]


def _rounded(hearing: Hearing, share: Real) -> Chosen:
    """Return the feasible beams of the highest shares in each slot."""
    return tuple(
        manning.best(row, hearing.array, hearing.crew(slot)) for slot, row in enumerate(share)
    )


def _check_today(hearing: Hearing, today: Chosen) -> None:
    """Raise UserError if beams of today do not exist or cannot be processed together."""
    if len(today) != hearing.slots:
        raise UserError(f"processing.today: {len(today)} slots of beams for {hearing.slots} slots")
    for slot, beams in enumerate(today):
        if len(set(beams)) != len(beams) or not all(0 <= beam < hearing.beams for beam in beams):
            raise UserError(
                f"processing.today: slot {slot + 1} has beams {list(beams)}, of {hearing.beams}, each once"
            )
        counts = np.bincount(hearing.array[list(beams)], minlength=hearing.serves.shape[1])
        if not manning.fits(hearing.crew(slot), tuple(counts.tolist())):
            raise UserError(
                f"processing.today: slot {slot + 1} has beams {list(beams)}: no processors for all of them"
            )
