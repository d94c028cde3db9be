"""Complete simulated spills: choose the particles of a world that are its objects not yet found.

A world's particles are exchangeable, so objects are drawn from them without replacement, in
proportion to the chance of not having been found by now. If a world has more objects than
particles, some particles represent several objects.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from drift.spills.worlds import finds
from drift.spills.worlds.fates import Fates, FatesSource, Realisation
from drift.spills.worlds.finds import Numbers, Posterior, log_joint_of_numbers, world_ranges
from geo.array import Array
from kernels.maths import noise
from kernels.maths.noise import Purpose

Ints = npt.NDArray[np.int64]


def realise(
    fates: FatesSource, posterior: Posterior, seed: int, count: int
) -> Iterator[tuple[Fates, list[Realisation]]]:
    """Draw `count` complete spills for each part of the fates, and yield them part by part.

    In every world a spill puts its N objects, less those destroyed and found, on the world's
    particles. Each spill is an unbiased draw; the spills use different particles as far as there
    are enough. The result does not depend on the division into parts: each part takes its own range
    of the random numbers.

    Args:
        fates: fates of all particles.
        posterior: posterior of the worlds and of their numbers of objects.
        seed: seed of the run.
        count: number of spills for each world.

    Returns:
        Each part with its spills.
    """
    rng = noise.generator(seed, Purpose.REALISATIONS)
    numbers = posterior.known.numbers
    classes = numbers.shares.size
    destroyed = np.zeros((count, fates.worlds), np.int32)
    found = np.zeros((count, fates.worlds), np.int32)
    afloat = np.zeros((count, fates.worlds, classes), np.int64)  # neither destroyed nor found
    for r in range(count):
        left, share_lost, ours = _draw_numbers(rng, numbers, posterior)
        lost = share_lost[:, None] / (
            1 - (1 - share_lost[:, None]) * np.minimum(posterior.share, 1 - 1e-15)
        )
        gone = rng.binomial(left, np.clip(lost, 0, 1))
        destroyed[r], found[r], afloat[r] = gone.sum(1), ours, left - gone

    def deal_part(
        part: Fates, generators: Mapping[int, np.random.Generator]
    ) -> list[tuple[Array, int]]:
        """Return the objects dealt to each class of a part, with the number of rounds of each.

        generators: generator of each class, at its start in all worlds.
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
            for kind, own in generators.items()
        ]

    generators = {0: rng}
    for kind, each in enumerate(fates.counts[:-1]):
        # The random numbers of the next class begin after those of this one in all worlds.
        rounds = max(deal_part(part, {kind: generators[kind]})[0][1] for part in fates.parts())
        generators[kind + 1] = noise.later(generators[kind], (1 + rounds) * fates.worlds * each)
    for part in fates.parts():
        stands = np.concatenate([own for own, _ in deal_part(part, generators)], axis=1)
        yield (
            part,
            [
                Realisation(stands[r], destroyed[r, part.here], found[r, part.here])
                for r in range(count)
            ],
        )


def _draw_numbers(
    rng: np.random.Generator, numbers: Numbers, posterior: Posterior
) -> tuple[Ints, Array, Ints]:
    """Draw every world's objects not found, by class (W, classes), share destroyed, and finds."""
    worlds = posterior.weight.size
    which = (
        np.cumsum(posterior.chosen, axis=0) < rng.random(worlds) * posterior.chosen.sum(0)
    ).sum(0)
    which = np.minimum(which, len(posterior.counts) - 1)
    left = np.zeros((worlds, numbers.shares.size), np.int64)
    share_lost, ours = np.zeros(worlds), np.zeros(worlds, np.int64)
    for k in np.unique(which):
        worlds_of_counts = np.flatnonzero(which == k)
        for own in world_ranges(worlds_of_counts.size):
            at = worlds_of_counts[own]
            joint = log_joint_of_numbers(numbers, posterior.counts[k], posterior.share[at]).reshape(
                at.size, -1
            )
            peak = joint.max(1, keepdims=True)
            mass = np.cumsum(np.exp(joint - np.where(np.isfinite(peak), peak, 0.0)), axis=1)
            cell = np.minimum(
                (mass < rng.random((at.size, 1)) * mass[:, -1:]).sum(1), joint.shape[1] - 1
            )
            n, d = np.divmod(cell, numbers.destroyed.size)
            counts = np.array(posterior.counts[k])
            # worlds with fewer objects than finds have no weight; avoid negative numbers
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
    """Return the number of objects on each particle, (count, W * n), and the number of rounds.

    wanted: objects of each spill and world, (count, W). Particles are visited in random order,
    round after round, and accepted with their chance (W, n) relative to the largest; every spill
    continues where the one before it ended. rng: generator at the start of the class in all
    `worlds`, of which these begin with number `first`.
    """

    def draw(number: int) -> Array:
        """Return the uniform random numbers of a round, (W, n)."""
        return np.asarray(
            noise.later(rng, (number * worlds + first) * chance.shape[1]).random(chance.shape)
        )

    count, rounds = len(wanted), 0
    order = np.argsort(draw(0), axis=1)
    top = chance.max(1, keepdims=True)
    # where all particles have certainly been found, accept any
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
