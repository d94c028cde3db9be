"""The washup of a spill: number of objects ashore on each stretch of coast, and when they arrive.

Every world of every realisation is one complete simulated spill of N objects. Figures are weighted
means and quantiles over these; standard errors are over worlds (drift.spills.worlds.estimate). An
object lies on a stretch at a time if one of its stays contains the time. An object that refloats
counts where it lies, and has arrived at every stretch where it ever lay. Objects that were
destroyed or found are in the account at all times, as if gone from the beginning, and on no
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
    """Return the figures of every stretch that any object touches, by time, and the account.

    Args:
        spills: fates part by part, with the realisations of each.
        segments: stretches of coast.
        weight: weights of the worlds, float64 (W,), sum 1.
        outputs: output times [s after start], int (T,), ascending.
        start: start of the run, UTC.
        kinds: names of the classes of objects, in order of their numbers.
        realisations: number of realisations of each world.
        folder: folder of a temporary file, which is removed at the end; None: the system's.

    Returns:
        The contents of washup.nc.
    """
    weight, outputs = np.asarray(weight, np.float64), np.asarray(outputs, np.int64)
    accounts: list[Array] = []
    with spool.scratch(folder) as file:
        table = stretches.Table(file, realisations, len(outputs), len(kinds))
        for fates, spills_of_part in spills:
            table.add(fates, spills_of_part, weight, outputs)
            accounts.append(
                np.stack(
                    [fates_by_world(fates, realisation, outputs) for realisation in spills_of_part]
                ).astype(np.int32)
            )
        parts = [stretches.figures(rows, weight) for rows in table.pieces()]
    figures = (
        {name: np.concatenate([part[name] for part in parts], axis=-1) for name in parts[0]}
        if parts
        else {}
    )
    touched = figures.pop("segment", np.empty(0, np.int64))
    figures |= stretches.unseen_errors(figures, weight)
    figures |= _totals(accounts, weight, len(outputs))
    return washup_dataset.build_washup_dataset(
        figures, segments, touched, weight, realisations, outputs, start, kinds
    )


def worst_stretches(data: xr.Dataset, count: int | None = None, time: int = -1) -> Array:
    """Return the stretches with the largest expected numbers at a time, worst first.

    Of stretches with equal numbers, that with more arrivals comes first.

    Args:
        data: contents of washup.nc.
        count: most stretches to return; None: all.
        time: index of the output time.

    Returns:
        Indices of the stretches in `data`.
    """
    at = data.isel(time=time)
    return np.lexsort((-at["arrived"].values, -at["expected"].values))[:count]


def fates_by_world(fates: Fates, realisation: Realisation, outputs: Array) -> Array:
    """Return each world's objects by fate at each time.

    Args:
        fates: fates of some worlds.
        realisation: a simulated spill of these worlds.
        outputs: output times [s after start], (T,), ascending.

    Returns:
        Numbers of objects in the order of washup_dataset.FATES, int64 (worlds, T, 7).
    """
    stands = realisation.stands
    when = {
        name: np.searchsorted(outputs, values)
        for name, values in stretches.consistent_times(fates).items()
    }

    def by_world(world: Array, at: Array, amount: Array) -> Array:
        """Return cumulative sums of amounts by world at each time."""
        sums = np.zeros((fates.many, len(outputs) + 1), np.int64)
        np.add.at(sums, (world - fates.here.start, at), amount)
        return np.cumsum(sums, axis=1)[:, :-1]

    lying, world = stands[fates.stays.slot], fates.world[fates.stays.slot]
    ashore = by_world(world, when["arrival"], lying) - by_world(world, when["leave"], lying)
    released = by_world(fates.world, when["release"], stands)
    sunk = by_world(fates.world, when["ended"], np.where(fates.ending == Status.SUNK, stands, 0))
    gone = by_world(fates.world, when["ended"], np.where(fates.ending == Status.SUNK, 0, stands))
    total = np.zeros(fates.many, np.int64)
    np.add.at(total, fates.world - fates.here.start, stands)
    constant_fates = [
        np.repeat(values[:, None], len(outputs), axis=1)
        for values in (realisation.destroyed, realisation.found)
    ]
    return np.stack(
        [
            total[:, None] - released,
            released - ashore - sunk - gone,
            ashore,
            sunk,
            gone,
            *constant_fates,
        ],
        axis=-1,
    ).astype(np.int64)


def _totals(parts: Sequence[Array], weight: Array, times: int) -> dict[str, Array]:
    """Return the totals over all stretches by time.

    parts: results of `account`, (realisations, worlds, T, 7) each.
    """
    squares, worlds = float(np.sum(weight**2)), len(weight)
    by_world = np.empty((worlds, times, len(washup_dataset.FATES)), np.float32)
    columns = []
    for t in range(times):
        # (realisations, worlds, fates)
        counts = np.concatenate([part[:, :, t] for part in parts], axis=1)
        mean_of_world = counts.mean(axis=0)
        by_world[:, t] = mean_of_world
        flat = counts.reshape(-1, counts.shape[-1]).T
        order = np.argsort(flat, axis=1, kind="stable")
        number = estimate.quantiles(
            np.take_along_axis(flat, order, axis=1).ravel().astype(np.int64),
            np.tile(weight, len(counts))[order].ravel(),
            np.arange(len(flat)) * flat.shape[1],
            SHARES,
            1 / squares,
        )
        columns.append(
            (*(x[0] for x in estimate.mean(mean_of_world, weight, np.array([0]), squares)), *number)
        )
    names = ("total", "total_se", "total_number", "total_number_se")
    figures = {
        name: np.stack(of, axis=-1)
        for name, of in zip(names, zip(*columns, strict=True), strict=True)
    }
    return figures | {"world_total": by_world}
