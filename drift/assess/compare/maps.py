"""Maps of two runs with one smoothing, so that their difference is of the particles and not of the
kernels.

Kernels are as wide as the particles of both together want them, with as many in each as the maps of
the two runs alone have on average (drift.forecast.density); a map is linear in the particles once
they are given. So the difference is a sum over units, and its error comes from their groups (random
groups: Wolter 2007, doi:10.1007/978-0-387-35099-8).
"""

from dataclasses import dataclass

import numpy as np

from drift.assess.compare.units import GROUPS, Units
from drift.engine.particles.snapshot import Snapshot, mapped
from drift.engine.particles.status import Status
from drift.forecast import areas
from drift.forecast.build import media_of
from geo import cells
from geo.array import Array
from geo.cells import Cells


@dataclass(frozen=True)
class Maps:
    """Probability in each cell of a grid in two runs, and the difference with its standard error;
    (nlat, nlon).
    """

    a: Array
    b: Array
    difference: Array
    error: Array


@dataclass(frozen=True)
class _Laid:
    """What a snapshot leaves in cells that hold any particle of either run: weights by group of
    units and medium.
    """

    cell: Array  # (n,) of each particle on the map, flat
    medium: Array  # (n,) 1 ashore, where kernels follow the shore; 0 elsewhere
    group: Array  # (n,)
    weight: Array  # (n,)
    total: Array  # (GROUPS,) probability of each group, on the map or not


def _laid(snapshot: Snapshot, units: Units, grid: Cells) -> _Laid:
    group = units.group[units.of(snapshot)]
    cell = np.where(mapped(snapshot), cells.index(snapshot.lon, snapshot.lat, grid), -1)
    on = cell >= 0
    medium = (snapshot.status[on] == Status.ASHORE).astype(np.int64)
    total = np.bincount(group, snapshot.probability, GROUPS)
    return _Laid(cell[on], medium, group[on], snapshot.probability[on], total)


def maps(
    a: Snapshot, b: Snapshot, units: Units, grid: Cells, land: Array | None, per_kernel: float
) -> Maps:
    """Return the maps of two snapshots of one time, whose particles come in pairs.

    land: bool (nlat, nlon); None where there is none. per_kernel: effective particles in a kernel.
    """
    laid = _laid(a, units, grid), _laid(b, units, grid)
    held = np.unique(np.concatenate([one.cell for one in laid]))
    if not held.size:
        nothing = np.zeros(grid.shape)
        return Maps(nothing, nothing, nothing, nothing)
    media = 1 + max(int(one.medium.max(initial=0)) for one in laid)

    def mass(one: _Laid) -> Array:
        code = (one.group * media + one.medium) * held.size + np.searchsorted(held, one.cell)
        return np.bincount(code, one.weight, GROUPS * media * held.size).reshape(
            GROUPS, media, held.size
        )

    def squares(one: _Laid) -> Array:
        code = one.medium * held.size + np.searchsorted(held, one.cell)
        return np.bincount(code, one.weight**2, media * held.size).reshape(media, held.size)

    masses = mass(laid[0]), mass(laid[1])
    pooled = (masses[0] + masses[1]).sum(axis=0) / 2
    # A cell that both fill counts as one run's does, one that only either fills as half of that.
    both = (squares(laid[0]) + squares(laid[1])) / 2
    where = media_of(areas.Deposits(held, pooled[None], both[None], pooled[None]), grid.shape, land)
    guides = areas.guides_of(held, pooled, both, where)
    smooth = [
        np.stack([areas.spread(held, own, guides, per_kernel, where) for own in groups])
        for groups in masses
    ]
    whole = [groups.sum(axis=0) for groups in smooth]
    # A group that happens to weigh more brings more everywhere: only what it brings beyond its
    # share counts.
    pulls = [
        groups - one.total[:, None, None] * sums
        for groups, one, sums in zip(smooth, laid, whole, strict=True)
    ]
    error = np.sqrt(GROUPS / (GROUPS - 1) * np.sum((pulls[1] - pulls[0]) ** 2, axis=0))
    return Maps(whole[0], whole[1], whole[1] - whole[0], error)
