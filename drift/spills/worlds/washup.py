"""Fates of a spill's objects -> what a responder reads.

That is how many come ashore on each stretch of coast, and when.

Every world of every realisation is one complete simulated spill: N whole objects. Figures are means
and quantiles over these, weighted; standard errors are over worlds (see
drift.spills.worlds.estimate). An object lies on a stretch at a time if a stay of it contains the
time; one that refloats counts where it lies, and has arrived wherever it ever lay. Objects that
were destroyed or found are in the account at all times, as if gone from the beginning, and on no
stretch.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from drift.engine.motion import spool
from drift.engine.particles.status import Status
from drift.spills.worlds import estimate, stretches
from drift.spills.worlds.fates import Fates, Realisation
from drift.spills.worlds.products import dataset as washup_dataset
from drift.spills.worlds.products.dataset import SHARES
from geo.array import Array
from geo.coast.segments import Segments


def build_washup(
    spills: Iterable[tuple[Fates, Sequence[Realisation]]],
    segments: Segments,
    weight: Array,
    outputs: Array,
    start: np.datetime64,
    kinds: Sequence[str] = ("object",),
    realisations: int = 1,
    folder: Path | None = None,
) -> xr.Dataset:
    """Return the washup of every stretch that an object of any realisation touches, by time, and
    the account.

    spills: fates part by part, and as many realisations of each. weight: of the worlds, float64
    (W,), adds up to 1. outputs: int (T,) [s after start], ascending. start: of the run, UTC. kinds:
    names of the classes of objects, in order of their numbers. folder: for a file that goes at the
    end; None: the temporary one.
    """
    weight, outputs = np.asarray(weight, np.float64), np.asarray(outputs, np.int64)
    accounts: list[Array] = []
    with spool.scratch(folder) as file:
        table = stretches.Table(file, realisations, len(outputs), len(kinds))
        for fates, drawn in spills:
            table.add(fates, drawn, weight, outputs)
            accounts.append(
                np.stack([account(fates, one, outputs) for one in drawn]).astype(np.int32)
            )
        parts = [stretches.figures(rows, weight) for rows in table.pieces()]
    figures = (
        {name: np.concatenate([part[name] for part in parts], axis=-1) for name in parts[0]}
        if parts
        else {}
    )
    touched = figures.pop("segment", np.empty(0, np.int64))
    figures |= stretches.unseen(figures, weight)
    figures |= _account(accounts, weight, len(outputs))
    return washup_dataset.build_washup_dataset(
        figures, segments, touched, weight, realisations, outputs, start, kinds
    )


def worst(data: xr.Dataset, count: int | None = None, time: int = -1) -> Array:
    """Return the indices of the stretches with the largest expected numbers at a time, worst first.

    There are at most `count` of them.

    Where equally many lie there, the one at which more ever arrived comes first.
    """
    at = data.isel(time=time)
    return np.lexsort((-at["arrived"].values, -at["expected"].values))[:count]


def account(fates: Fates, realisation: Realisation, outputs: Array) -> Array:
    """Return the number of each world's objects of each of washup_dataset.FATES at each time, int64
    (worlds, T, 7).
    """
    stands = realisation.stands
    when = {
        name: np.searchsorted(outputs, values) for name, values in stretches.settled(fates).items()
    }

    def by_world(world: Array, at: Array, amount: Array) -> Array:
        """Return the sums of amounts by world up to each time."""
        sums = np.zeros((fates.many, len(outputs) + 1), np.int64)
        np.add.at(sums, (world - fates.here.start, at), amount)
        return np.cumsum(sums, axis=1)[:, :-1]

    lain, world = stands[fates.stays.slot], fates.world[fates.stays.slot]
    ashore = by_world(world, when["arrival"], lain) - by_world(world, when["leave"], lain)
    released = by_world(fates.world, when["release"], stands)
    sunk = by_world(fates.world, when["ended"], np.where(fates.ending == Status.SUNK, stands, 0))
    gone = by_world(fates.world, when["ended"], np.where(fates.ending == Status.SUNK, 0, stands))
    every = np.zeros(fates.many, np.int64)
    np.add.at(every, fates.world - fates.here.start, stands)
    lost = [
        np.repeat(values[:, None], len(outputs), axis=1)
        for values in (realisation.destroyed, realisation.found)
    ]
    return np.stack(
        [every[:, None] - released, released - ashore - sunk - gone, ashore, sunk, gone, *lost],
        axis=-1,
    ).astype(np.int64)


def _account(parts: Sequence[Array], weight: Array, times: int) -> dict[str, Array]:
    """Return the totals over all stretches, time by time; parts: of `account`, (realisations,
    worlds, T, 7) each.
    """
    squares, worlds = float(np.sum(weight**2)), len(weight)
    by_world = np.empty((worlds, times, len(washup_dataset.FATES)), np.float32)
    columns = []
    for t in range(times):
        # (realisations, worlds, fates)
        every = np.concatenate([part[:, :, t] for part in parts], axis=1)
        middle = every.mean(axis=0)
        by_world[:, t] = middle
        flat = every.reshape(-1, every.shape[-1]).T
        order = np.argsort(flat, axis=1, kind="stable")
        number = estimate.quantiles(
            np.take_along_axis(flat, order, axis=1).ravel().astype(np.int64),
            np.tile(weight, len(every))[order].ravel(),
            np.arange(len(flat)) * flat.shape[1],
            SHARES,
            1 / squares,
        )
        columns.append(
            (*(x[0] for x in estimate.mean(middle, weight, np.array([0]), squares)), *number)
        )
    names = ("total", "total_se", "total_number", "total_number_se")
    figures = {
        name: np.stack(of, axis=-1)
        for name, of in zip(names, zip(*columns, strict=True), strict=True)
    }
    return figures | {"world_total": by_world}
