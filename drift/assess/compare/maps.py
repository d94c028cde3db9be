"""Maps of two runs with the same smoothing, so that their difference comes from the particles.

The width of the kernels is chosen for the particles of both runs together, with as many in each
kernel as the maps of the two runs alone have on average (drift.forecast.density). With the kernels
fixed, a map is linear in the particles. So the difference is a sum over units, and its error comes
from groups of them (random groups: Wolter 2007, doi:10.1007/978-0-387-35099-8).
"""

from dataclasses import dataclass

import numpy as np

from drift.assess.compare.units import GROUPS, SamplingUnits
from drift.engine.particles.snapshot import Snapshot, mapped
from drift.engine.particles.status import Status
from drift.forecast import areas
from drift.forecast.build import media_of
from geo import cells
from geo.array import Array
from geo.cells import Cells


@dataclass(frozen=True)
class Maps:
    """Probability by cell in two runs, the difference and its standard error; each (nlat, nlon)."""

    a: Array
    b: Array
    difference: Array
    error: Array


@dataclass(frozen=True)
class _Deposit:
    """The mapped particles of a snapshot, by cell, medium and group of units."""

    cell: Array  # (n,) flat index of each mapped particle's cell
    medium: Array  # (n,) 1 ashore, where kernels follow the shore; 0 elsewhere
    group: Array  # (n,)
    weight: Array  # (n,)
    total: Array  # (GROUPS,) probability of each group, mapped or not


def _deposit(snapshot: Snapshot, units: SamplingUnits, grid: Cells) -> _Deposit:
    group = units.group[units.of(snapshot)]
    cell = np.where(mapped(snapshot), cells.index_of_cells(snapshot.lon, snapshot.lat, grid), -1)
    on = cell >= 0
    medium = (snapshot.status[on] == Status.ASHORE).astype(np.int64)
    total = np.bincount(group, snapshot.probability, GROUPS)
    return _Deposit(cell[on], medium, group[on], snapshot.probability[on], total)


def paired_maps(
    a: Snapshot,
    b: Snapshot,
    units: SamplingUnits,
    grid: Cells,
    land: Array | None,
    per_kernel: float,
) -> Maps:
    """Return the maps of two snapshots of the same time, whose particles come in pairs.

    Args:
        a: snapshot of run A.
        b: snapshot of run B.
        units: the independent units of both runs.
        grid: grid of the maps.
        land: which cells are land, bool (nlat, nlon); None if none is.
        per_kernel: effective particles in a kernel.

    Returns:
        Probability in A and B, their difference and its standard error, each (nlat, nlon).
    """
    deposits = _deposit(a, units, grid), _deposit(b, units, grid)
    occupied = np.unique(np.concatenate([one.cell for one in deposits]))
    if not occupied.size:
        nothing = np.zeros(grid.shape)
        return Maps(nothing, nothing, nothing, nothing)
    media = 1 + max(int(one.medium.max(initial=0)) for one in deposits)

    def mass(one: _Deposit) -> Array:
        code = (one.group * media + one.medium) * occupied.size + np.searchsorted(
            occupied, one.cell
        )
        return np.bincount(code, one.weight, GROUPS * media * occupied.size).reshape(
            GROUPS, media, occupied.size
        )

    def squares(one: _Deposit) -> Array:
        code = one.medium * occupied.size + np.searchsorted(occupied, one.cell)
        return np.bincount(code, one.weight**2, media * occupied.size).reshape(media, occupied.size)

    masses = mass(deposits[0]), mass(deposits[1])
    pooled = (masses[0] + masses[1]).sum(axis=0) / 2
    # Averages over the runs: a cell that only one run fills counts half.
    both = (squares(deposits[0]) + squares(deposits[1])) / 2
    where = media_of(
        areas.Deposits(occupied, pooled[None], both[None], pooled[None]), grid.shape, land
    )
    guides = areas.guides_of(occupied, pooled, both, where)
    smooth = [
        np.stack([areas.spread(occupied, own, guides, per_kernel, where) for own in groups])
        for groups in masses
    ]
    totals = [groups.sum(axis=0) for groups in smooth]
    # A group that happens to have more weight adds more everywhere: only what it adds beyond its
    # share of the total counts.
    pulls = [
        groups - one.total[:, None, None] * sums
        for groups, one, sums in zip(smooth, deposits, totals, strict=True)
    ]
    error = np.sqrt(GROUPS / (GROUPS - 1) * np.sum((pulls[1] - pulls[0]) ** 2, axis=0))
    return Maps(totals[0], totals[1], totals[1] - totals[0], error)
