"""How many objects of a spill lie on each stretch at the end, and the influence of every world on
that.
"""

import numpy as np

from drift.assess.compare.figures import Figures
from drift.assess.compare.units import Figure
from drift.spills.worlds import renewal, stretches
from drift.spills.worlds.products.tables import called
from drift.spills.worlds.realisations import realise
from drift.spills.worlds.renewal import Aftermath
from geo import notation
from geo.array import Array

NOWHERE = 5e-4  # objects; stretches where no run expects more are left out


def figures(after: Aftermath, seed: int) -> Figures:
    """Return the expected number of objects on each stretch at the end of the run, and on all;
    seed: of the run.
    """
    worlds, segments = after.spill.worlds, after.segments
    number = _numbers(after, seed)
    weight = after.posterior.weight
    found: Figures = {
        ("ashore", "all stretches", "objects"): _mean(
            sum(number.values(), np.zeros(worlds)), weight
        )
    }
    for segment, values in number.items():
        place = notation.position(float(segments.lon[segment]), float(segments.lat[segment])) or ""
        name = called(segment, segments.name[segment], place)
        found["ashore", name, "objects"] = _mean(values, weight)
    return found


def with_all(own: Figures, other: Figures, worlds: int) -> Figures:
    """Return figures with those that only another run has as 0: nothing came there."""
    nothing = Figure(0.0, np.zeros(worlds))
    keys = [
        key
        for key in {**own, **other}
        if max(x.get(key, nothing).value for x in (own, other)) > NOWHERE
    ]
    return {key: own.get(key, nothing) for key in keys}


def _mean(values: Array, weight: Array) -> Figure:
    """Return the mean over worlds; values, weight: (W,), the weights add up to 1."""
    mean = float(weight @ values)
    return Figure(mean, weight * (values - mean))


def _numbers(after: Aftermath, seed: int) -> dict[int, Array]:
    """Return the number of objects of each world, (W,), on each stretch that any touches, by the
    stretch's number.

    It is the mean over the complete spills that are drawn in each world, as washup.nc has it.
    """
    spill, last = after.spill, after.period.duration
    numbers: dict[int, Array] = {}
    for fates, drawn in realise(after.fates, after.posterior, seed, renewal.spills(spill)):
        clean, stays = stretches.settled(fates), fates.stays
        lies = (clean["arrival"] <= last) & (clean["leave"] > last)
        stands = np.mean([realisation.stands for realisation in drawn], axis=0)
        slot, segment = stays.slot[lies], stays.segment[lies].astype(np.int64)
        amount, world = stands[slot], fates.world[slot]
        for k in np.unique(segment[amount > 0]).tolist():
            there = np.bincount(world[segment == k], amount[segment == k], spill.worlds)
            numbers[k] = numbers.get(k, 0.0) + there
    return dict(sorted(numbers.items()))
