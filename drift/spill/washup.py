"""Fates of a spill's objects -> what a responder reads.

That is how many come ashore on each stretch of coast, and when.

Every world of every realisation is one complete simulated spill: N whole objects. Figures are means and quantiles over
these, weighted; standard errors are over worlds (see drift.spill.estimate). An object lies on a stretch at a time if a
stay of it contains the time; one that refloats counts where it lies, and has arrived wherever it ever lay. Objects that
were destroyed or found are in the account at all times, as if gone from the beginning, and on no stretch.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from drift.particles.status import Status
from drift.spill import dataset as washup_dataset
from drift.spill import estimate, stretches
from drift.spill.dataset import SHARES
from drift.spill.fates import Fates, Realisation
from geo.array import Array
from geo.coast.segments import Segments


def build(
    fates: Fates,
    segments: Segments,
    realisations: Sequence[Realisation],
    weight: Array,
    outputs: Array,
    start: np.datetime64,
    kinds: Sequence[str] = ("object",),
) -> xr.Dataset:
    """Return the washup of every stretch that an object of any realisation touches, by time, and the account.

    weight: of the worlds, float64 (W,), adds up to 1. outputs: int (T,) [s after start], ascending. start: of the run,
    UTC. kinds: names of the classes of objects, in order of their numbers.
    """
    weight, outputs = np.asarray(weight, np.float64), np.asarray(outputs, np.int64)
    rows = stretches.sorted_rows(fates, realisations, weight, outputs)
    parts = [stretches.figures(rows, run, fates, realisations, weight, len(kinds)) for run in stretches.runs(rows)]
    figures = {name: np.concatenate([part[name] for part in parts], axis=-1) for name in parts[0]} if parts else {}
    figures |= stretches.unseen(figures, weight)
    figures |= _account(fates, realisations, weight, outputs)
    touched = rows.segment[rows.first]
    return washup_dataset.build(figures, segments, touched, weight, len(realisations), outputs, start, kinds)


def worst(data: xr.Dataset, count: int | None = None, time: int = -1) -> Array:
    """Return the indices of the stretches with the largest expected numbers at a time, worst first.

    There are at most `count` of them.

    Where equally many lie there, the one at which more ever arrived comes first.
    """
    at = data.isel(time=time)
    return np.lexsort((-at["arrived"].values, -at["expected"].values))[:count]


def account(fates: Fates, realisation: Realisation, outputs: Array) -> Array:
    """Return the number of each world's objects of each of washup_dataset.FATES at each time, int64 (W, T, 7)."""
    stands = realisation.stands
    when = {name: np.searchsorted(outputs, values) for name, values in stretches.settled(fates).items()}

    def by_world(world: Array, at: Array, amount: Array) -> Array:
        """Return the sums of amounts by world up to each time."""
        sums = np.zeros((fates.worlds, len(outputs) + 1), np.int64)
        np.add.at(sums, (world, at), amount)
        return np.cumsum(sums, axis=1)[:, :-1]

    lain, world = stands[fates.stays.slot], fates.world[fates.stays.slot]
    ashore = by_world(world, when["arrival"], lain) - by_world(world, when["leave"], lain)
    released = by_world(fates.world, when["release"], stands)
    sunk = by_world(fates.world, when["ended"], np.where(fates.ending == Status.SUNK, stands, 0))
    gone = by_world(fates.world, when["ended"], np.where(fates.ending == Status.SUNK, 0, stands))
    every = np.zeros(fates.worlds, np.int64)
    np.add.at(every, fates.world, stands)
    lost = [np.repeat(values[:, None], len(outputs), axis=1) for values in (realisation.destroyed, realisation.found)]
    return np.stack(
        [every[:, None] - released, released - ashore - sunk - gone, ashore, sunk, gone, *lost], axis=-1
    ).astype(np.int64)


def _account(fates: Fates, realisations: Sequence[Realisation], weight: Array, outputs: Array) -> dict[str, Array]:
    """Return the totals over all stretches."""
    # Shape (realisation, world, time, fate).
    every = np.stack([account(fates, realisation, outputs) for realisation in realisations])
    middle = every.mean(axis=0)
    shape = every.shape[2:]
    squares = float(np.sum(weight**2))
    total, error = estimate.mean(middle.reshape(len(weight), -1), weight, np.array([0]), squares)
    flat = every.reshape(-1, shape[0] * shape[1]).T
    order = np.argsort(flat, axis=1, kind="stable")
    pooled = np.tile(weight, len(realisations))[order]
    number, number_se = estimate.quantiles(
        np.take_along_axis(flat, order, axis=1).ravel(),
        pooled.ravel(),
        np.arange(len(flat)) * flat.shape[1],
        SHARES,
        1 / squares,
    )
    return {
        "total": total.reshape(shape).T,
        "total_se": error.reshape(shape).T,
        "total_number": number.reshape(-1, *shape).swapaxes(1, 2),
        "total_number_se": number_se.reshape(-1, *shape).swapaxes(1, 2),
        "world_total": middle.astype(np.float32),
    }
