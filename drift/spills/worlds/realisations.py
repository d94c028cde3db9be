"""Complete simulated spills of those not yet found: which of a world's particles are its objects.

A world's particles are exchangeable, so objects are drawn from them without replacement; those not
found by now are drawn in proportion to the chance of not having been found. Where there are more
objects than particles some stand for several.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from drift.spills.worlds import finds
from drift.spills.worlds.fates import Fates, Realisation, Source
from drift.spills.worlds.finds import Numbers, Posterior, joint_of, together
from geo.array import Array
from kernels.maths import noise
from kernels.maths.noise import Purpose

Ints = npt.NDArray[np.int64]


def realise(
    fates: Source, posterior: Posterior, seed: int, count: int
) -> Iterator[tuple[Fates, list[Realisation]]]:
    """Yield each part of the fates with so many complete spills.

    In every world they have N objects, less those destroyed and found, on the world's particles.

    Each is a fair draw. They use different particles as far as there are enough. No number of parts
    changes a bit: each takes its own random numbers from the row of all.
    """
    rng = noise.generator(seed, Purpose.REALISATIONS)
    numbers = posterior.known.numbers
    classes = numbers.shares.size
    destroyed = np.zeros((count, fates.worlds), np.int32)
    found = np.zeros((count, fates.worlds), np.int32)
    afloat = np.zeros((count, fates.worlds, classes), np.int64)  # neither destroyed nor found
    for r in range(count):
        left, share_lost, ours = _numbers(rng, numbers, posterior)
        lost = share_lost[:, None] / (
            1 - (1 - share_lost[:, None]) * np.minimum(posterior.share, 1 - 1e-15)
        )
        gone = rng.binomial(left, np.clip(lost, 0, 1))
        destroyed[r], found[r], afloat[r] = gone.sum(1), ours, left - gone

    def dealt(part: Fates, begun: Mapping[int, np.random.Generator]) -> list[tuple[Array, int]]:
        """Return what classes are dealt in a part; begun: the random numbers of each, as they begin
        in all worlds.
        """
        unfound, ends = (
            1 - finds.found(part, posterior.known),
            np.cumsum([0, *part.counts]) * part.many,
        )
        return [
            _deal(
                own,
                unfound[ends[kind] : ends[kind + 1]].reshape(part.many, -1),
                afloat[:, part.here, kind],
                part.here.start,
                fates.worlds,
            )
            for kind, own in begun.items()
        ]

    begun = {0: rng}
    for kind, each in enumerate(fates.counts[:-1]):
        # The next class begins where this one ends, which is known once it has been dealt in all
        # worlds.
        rounds = max(dealt(part, {kind: begun[kind]})[0][1] for part in fates.parts())
        begun[kind + 1] = noise.later(begun[kind], (1 + rounds) * fates.worlds * each)
    for part in fates.parts():
        stands = np.concatenate([own for own, _ in dealt(part, begun)], axis=1)
        yield (
            part,
            [
                Realisation(stands[r], destroyed[r, part.here], found[r, part.here])
                for r in range(count)
            ],
        )


def _numbers(
    rng: np.random.Generator, numbers: Numbers, posterior: Posterior
) -> tuple[Ints, Array, Ints]:
    """Return of every world a draw of its objects not found, its share destroyed, and its finds.

    Objects not found are by class, (W, classes).
    """
    worlds = posterior.weight.size
    which = (
        np.cumsum(posterior.chosen, axis=0) < rng.random(worlds) * posterior.chosen.sum(0)
    ).sum(0)
    which = np.minimum(which, len(posterior.counts) - 1)
    left = np.zeros((worlds, numbers.shares.size), np.int64)
    share_lost, ours = np.zeros(worlds), np.zeros(worlds, np.int64)
    for k in np.unique(which):
        every = np.flatnonzero(which == k)
        for own in together(every.size):
            at = every[own]
            joint = joint_of(numbers, posterior.counts[k], posterior.share[at]).reshape(at.size, -1)
            peak = joint.max(1, keepdims=True)
            mass = np.cumsum(np.exp(joint - np.where(np.isfinite(peak), peak, 0.0)), axis=1)
            cell = np.minimum(
                (mass < rng.random((at.size, 1)) * mass[:, -1:]).sum(1), joint.shape[1] - 1
            )
            n, d = np.divmod(cell, numbers.destroyed.size)
            counts = np.array(posterior.counts[k])
            # a world where the finds cannot be has no weight
            taken = np.minimum(counts, numbers.by_class[n])
            left[at], share_lost[at], ours[at] = (
                numbers.by_class[n] - taken,
                numbers.destroyed[d],
                taken.sum(1),
            )
    return left, share_lost, ours


def _deal(
    rng: np.random.Generator, chance: Array, wanted: Ints, first: int, worlds: int
) -> tuple[Array, int]:
    """Return how many objects each particle stands for, (count, W * n), and in how many rounds they
    are dealt.

    wanted: objects of each realisation and world, (count, W); particles get them in proportion.

    Particles are passed in random order, round after round, and taken with their chance (W, n)
    relative to the likeliest; every realisation goes on where the one before it ended. rng: as the
    dealing in all worlds begins, of which there are `worlds` and these go on from number `first`.
    """

    def draw(number: int) -> Array:
        """Return the random numbers of a round."""
        return np.asarray(
            noise.later(rng, (number * worlds + first) * chance.shape[1]).random(chance.shape)
        )

    count, rounds = len(wanted), 0
    order = np.argsort(draw(0), axis=1)
    top = chance.max(1, keepdims=True)
    # where all are surely found, any will do
    accept = np.where(top > 0, chance / np.where(top > 0, top, 1.0), 1.0)
    accept = np.take_along_axis(accept, order, axis=1)
    end = np.cumsum(wanted, axis=0)
    stands = np.zeros((count, *chance.shape), np.int32)
    done = np.zeros(len(chance), np.int64)
    while (done < end[-1]).any():
        rounds += 1
        taken = draw(rounds) < accept
        number = done[:, None] + np.cumsum(taken, axis=1)  # 1, 2, ... of those taken
        for r in range(count):
            stands[r] += (
                taken & (number > (end[r] - wanted[r])[:, None]) & (number <= end[r][:, None])
            )
        done = number[:, -1]
    dealt = np.empty_like(stands)
    np.put_along_axis(dealt, np.broadcast_to(order, stands.shape), stands, axis=2)
    return dealt.reshape(count, -1), rounds
