"""Effort spread over cells, against NumPy in float64."""

import numpy as np

from drift.planning.search import concave
from kernels.planning import allocate

RNG = np.random.default_rng(23)


def test_a_gain_counts_the_sweep_width_that_a_particle_has_in_each_bin() -> None:
    """By random search, whose b(C) = 1 - exp(-C) has its slope in closed form; objects change."""
    bins, m, cells, units = 3, 500, 7, 2
    cell = RNG.integers(-1, cells, (bins, m)).astype(np.int32)
    row = RNG.integers(0, 4, (bins, m)).astype(np.int32)
    sweep = RNG.uniform(0.2, 3.0, (4, units))
    fall, weight = RNG.uniform(0, 1, (bins, m)), RNG.dirichlet(np.ones(m))
    density = RNG.uniform(0, 0.5, (cells, units))
    coverage = np.arange(2000) * concave.STEP
    curve = 1 - np.exp(-coverage), np.exp(-coverage), np.zeros(2000)
    field = allocate.Field(
        cell, cells, fall, np.zeros((bins, m)), row, weight, sweep, np.zeros(units),
        curve, concave.STEP,
    )  # fmt: skip

    there = cell >= 0
    added = np.where(there, (density[cell] * sweep[row]).sum(axis=2), 0.0)
    missed = np.exp(-np.cumsum(added, axis=0))
    worth = np.cumsum((weight * fall * missed)[::-1], axis=0)[::-1]  # of finding from a bin on
    wanted = np.zeros((cells, units))
    np.add.at(wanted, cell[there], worth[there][:, None] * sweep[row][there])

    found, _ = field.spend(density)
    # straight lines between the nodes of a table are right to STEP^2 / 8
    bound = concave.STEP**2 / 8 + 1e-5
    assert abs(found - (weight * fall * (1 - missed)).sum()) < bound * fall.sum(axis=0).max()
    whole = np.zeros((cells, units))  # what nothing found before would be worth
    unfound = np.cumsum((weight * fall)[::-1], axis=0)[::-1]
    np.add.at(whole, cell[there], unfound[there][:, None] * sweep[row][there])
    assert (np.abs(field.gain() - wanted) < bound * whole).all()
    # with the width of the first bin in all, it would be far off
    first = np.zeros((cells, units))
    np.add.at(first, cell[there], worth[there][:, None] * sweep[np.tile(row[0], (bins, 1))][there])
    assert (np.abs(first - wanted) > 100 * bound * whole).any()
