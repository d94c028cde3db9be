"""Allocation of processing: which beams of which arrays to process in which slot, where processors
are fewer than beams.

It makes the weight that is heard at least once as high as it can, sum w (1 - prod (1 - p)) over the
beams chosen. Where no particle is heard by two beams, in any slots, that is linear, and the answer
exact (`manning.best`). Else a linear programme counts twice what two beams hear (it may find 0.49
where 0.63 is best): beams are chosen greedily and exchanged over all slots together, from several
starts (`choosing`), and a bound says how much any other choice could be worth (`relaxation`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drift.planning.arrays import choosing, manning, relaxation
from drift.planning.arrays.records import Allocation, Alternative, Chosen, Hearing
from drift.planning.arrays.relaxation import Relaxed
from geo.array import Real
from geo.errors import UserError

# particles on which starts are tried and the bound is sought, before both are settled on all
SAMPLE = 10_000
STEPS, LAST = 200, 20  # of the search for the bound, on a sample, and then on all
GAP = 1e-4  # share of the bound at which it ends
# chances that may be gone through to vary the choice; variations at the most
EFFORT, MOST = 2e8, 200
EACH = 500  # chances that take as long as one beam that is looked at
SAME = 1e-9  # share of the weight within which a choice is as good as its bound
FIXED = "the same beams all the time"
ALONE = "each slot by itself"
IN_TURN = "slot after slot"


def allocate(hearing: Hearing, *, today: Chosen | None = None) -> Allocation:
    """Return which beams to process when.

    today: beams of each slot that would be processed else, told as one more alternative.
    """
    if today is not None:
        _fits(hearing, today)
    others = {FIXED: fixed(hearing)} if hearing.slots > 1 else {}
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
        chosen, relaxed = _sought(hearing, [linear, *others.values()])
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
        by_slot(hearing, chosen),
        total,
        tuple(
            Alternative(name, beams, choosing.value(hearing, beams))
            for name, beams in others.items()
        ),
    )


def _sought(hearing: Hearing, starts: list[Chosen]) -> tuple[Chosen, Relaxed]:
    """Return the best choice that was found, and the bound."""
    part = sampled(hearing)
    chosen = best(part, [choosing.greedy(part), *starts])
    chosen = best(part, [chosen, *_varied(part, chosen)])
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
    """Return what is heard of every so many particles, at least SAMPLE; all of them where they are
    few.
    """
    many = len(hearing.weight)
    if many < 2 * SAMPLE:
        return hearing
    every = np.arange(many // (2 * (many // SAMPLE)), many, many // SAMPLE)
    weight = hearing.weight[every]
    if weight.sum() == 0:
        return hearing
    chance = tuple(table[:, every] for table in hearing.chance)
    return replace(hearing, chance=chance, weight=weight * (hearing.weight.sum() / weight.sum()))


def best(hearing: Hearing, starts: list[Chosen]) -> Chosen:
    """Return the best that exchanges make of some choices; of equal ones the first."""
    return max(
        (choosing.exchanged(hearing, start) for start in dict.fromkeys(starts)),
        key=lambda choice: choosing.value(hearing, choice),
    )


def fixed(hearing: Hearing) -> Chosen:
    """Return a good choice of beams that are processed in every slot, by processors that work in
    every slot.
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
    """Return what each beam adds to all others that are processed, (slots, beams);

    NaN: no processor can serve it.
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


def by_slot(hearing: Hearing, chosen: Chosen) -> Real:
    """Return the weight that is heard by the end of each slot, (slots,)."""
    missed, total = choosing.Missed(hearing, ()), float(hearing.weight.sum())
    heard = np.empty(hearing.slots)
    for slot, beams in enumerate(chosen):
        for beam in beams:
            missed.add(slot, beam)
        heard[slot] = total - float(missed.weight.sum())
    return heard


def shared_out(hearing: Hearing, chosen: Chosen) -> NDArray[np.intp]:
    """Return the beam of each processor, (slots, processors), -1: idle; a processor keeps its beam
    where it can.
    """
    given = np.full(hearing.manned.shape, -1, np.intp)
    before = np.full(len(hearing.serves), -1, np.intp)
    for slot, beams in enumerate(chosen):
        works = np.flatnonzero(hearing.manned[slot])
        last = tuple(before[works].tolist())
        given[slot, works] = manning.shared_out(beams, hearing.array, hearing.crew(slot), last)
        before = np.where(given[slot] >= 0, given[slot], before)
    return given


def _linear(hearing: Hearing) -> tuple[Chosen, float]:
    """Return the best choice if nothing were heard twice, and what it would be worth then: no
    choice is worth more.
    """
    chosen, ceiling = [], 0.0
    for slot, table in enumerate(hearing.chance):
        gain = np.asarray(table @ hearing.weight, float) - hearing.cost[slot]
        beams = manning.best(gain, hearing.array, hearing.crew(slot))
        chosen.append(beams)
        ceiling += float(gain[list(beams)].sum())
    return tuple(chosen), ceiling * (1 + SAME)


def _varied(hearing: Hearing, chosen: Chosen) -> list[Chosen]:
    """Return greedy choices that begin with another beam, or do without one of those chosen: as
    many as there is time for.
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
    """Return the beams of the highest shares that fit together."""
    return tuple(
        manning.best(row, hearing.array, hearing.crew(slot)) for slot, row in enumerate(share)
    )


def _fits(hearing: Hearing, today: Chosen) -> None:
    """Refuse beams of today that there are not, or that the processors cannot process together."""
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
