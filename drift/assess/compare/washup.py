"""Expected objects of a spill on each stretch at the end, and each world's influence on them."""

import numpy as np

from drift.assess.compare.figures import Figures
from drift.assess.compare.units import Figure
from drift.spills.worlds import renewal, stretches
from drift.spills.worlds.products.tables import stretch_name
from drift.spills.worlds.realisations import realise
from drift.spills.worlds.renewal import SpillResult
from geo import notation
from geo.array import Array

NOWHERE = 5e-4  # [objects] stretches are left out where neither run expects more


def washup_figures(after: SpillResult, seed: int) -> Figures:
    """Return the expected number of objects on each stretch at the end of the run, and on all.

    seed: of the run.
    """
    worlds, segments = after.spill.worlds, after.segments
    number = _numbers_by_stretch(after, seed)
    weight = after.posterior.weight
    found: Figures = {
        ("ashore", "all stretches", "objects"): _mean(
            sum(number.values(), np.zeros(worlds)), weight
        )
    }
    for segment, values in number.items():
        place = notation.position(float(segments.lon[segment]), float(segments.lat[segment])) or ""
        name = stretch_name(segment, segments.name[segment], place)
        found["ashore", name, "objects"] = _mean(values, weight)
    return found


def with_missing_as_zero(own: Figures, other: Figures, worlds: int) -> Figures:
    """Return `own` with the figures that only `other` has, as 0.

    No object of the own run came to their stretches.
    """
    zero = Figure(0.0, np.zeros(worlds))
    keys = [
        key
        for key in {**own, **other}
        if max(x.get(key, zero).value for x in (own, other)) > NOWHERE
    ]
    return {key: own.get(key, zero) for key in keys}


def _mean(values: Array, weight: Array) -> Figure:
    """Return the weighted mean over worlds; values, weight: (W,), the weights sum to 1."""
    mean = float(weight @ values)
    return Figure(mean, weight * (values - mean))


def _numbers_by_stretch(after: SpillResult, seed: int) -> dict[int, Array]:
    """Return each world's number of objects, (W,), on each stretch that any touches, by stretch.

    It is the mean over the world's complete spills, as in washup.nc.
    """
    spill, last = after.spill, after.period.duration
    numbers: dict[int, Array] = {}
    for fates, drawn in realise(
        after.fates, after.posterior, seed, renewal.spills_per_world(spill)
    ):
        clean, stays = stretches.consistent_times(fates), fates.stays
        lies = (clean["arrival"] <= last) & (clean["leave"] > last)
        stands = np.mean([realisation.stands for realisation in drawn], axis=0)
        slot, segment = stays.slot[lies], stays.segment[lies].astype(np.int64)
        amount, world = stands[slot], fates.world[slot]
        for k in np.unique(segment[amount > 0]).tolist():
            there = np.bincount(world[segment == k], amount[segment == k], spill.worlds)
            numbers[k] = numbers.get(k, 0.0) + there
    return dict(sorted(numbers.items()))
