"""Cells of a map and their smoothing, against closed forms."""

import numpy as np
import pytest

from drift.forecast import density
from geo import cells, sphere


def test_every_particle_is_in_the_cell_that_holds_it():
    rng = np.random.default_rng(5)
    # over 180 degrees
    grid = cells.Cells(lon0=2**31 - 5000, lat0=-3000, width=700, height=300, nlon=21, nlat=17)
    lon = (2**31 - 6000 + rng.integers(0, 18_000, 5000)).astype(np.int64)
    lat = rng.integers(-4000, 3000, 5000).astype(np.int32)
    expected = []
    for x, y in zip(lon, lat, strict=True):
        i, j = (int(x) - grid.lon0) // 700, (int(y) - grid.lat0) // 300
        expected.append(21 * j + i if 0 <= i < 21 and 0 <= j < 17 else -1)
    wrapped = ((lon + 2**31) % 2**32 - 2**31).astype(np.int32)
    np.testing.assert_array_equal(cells.index_of_cells(wrapped, lat, grid), expected)


def test_cell_areas_add_up_to_the_zone():
    grid = cells.Cells(lon0=100, lat0=2**29, width=3 * 2**20, height=2**21, nlon=5, nlat=40)
    south, north = np.pi / 4, np.pi / 4 + 40 * 2**21 * sphere.UNIT
    exact = sphere.RADIUS**2 * 5 * 3 * 2**20 * sphere.UNIT * (np.sin(north) - np.sin(south))
    assert grid.area().sum() * 5 == pytest.approx(exact, rel=1e-12)


def test_finer_cells_divide_the_extent():
    grid = cells.Cells(-4096, 8192, 1024, 512, 6, 5)
    assert grid.finer(2).area().sum() * 24 == pytest.approx(grid.area().sum() * 6, rel=1e-12)
    assert grid.finer(2).lon()[0] == pytest.approx(
        grid.lon()[0] - 0.375 * 1024 * 360 / 2**32, rel=1e-12
    )


def spread_example(allowed, m=20.0, seed=2):
    rng = np.random.default_rng(seed)
    mass = rng.poisson(0.7 * rng.random(allowed.shape) ** 8, allowed.shape) * allowed * 1e-4
    where = density.medium(allowed)
    return mass, spread(mass, histogram(mass, where), m, where), where


def histogram(mass, where):
    """That of particles of weight 1e-4."""
    held = np.flatnonzero(mass)
    return density.histogram(held, mass.ravel()[held], mass.ravel()[held] * 1e-4, where)


def spread(mass, guide, m, where):
    held = np.flatnonzero(mass)
    return density.spread(held, mass.ravel()[held], guide, m, where)


@pytest.mark.parametrize("shape", [(33, 58), (64, 47), (17, 16), (9, 5)])
def test_smoothing_keeps_the_mass_and_keeps_off_land(shape):
    allowed = np.ones(shape, bool)
    allowed[shape[0] // 3 : shape[0] // 2, 2:] = False
    allowed[:, shape[1] * 3 // 4] = False
    mass, smooth, _ = spread_example(allowed)
    assert smooth.sum() == pytest.approx(mass.sum(), rel=1e-12)
    assert (smooth[~allowed] == 0).all()
    assert (smooth >= 0).all()
    assert np.count_nonzero(smooth) > 2 * np.count_nonzero(mass)


def test_smoothing_is_linear_so_scenarios_add_up():
    allowed = np.ones((40, 52), bool)
    mass, smooth, where = spread_example(allowed)
    part = mass * (np.random.default_rng(3).random(mass.shape) < 0.3)
    guide = histogram(mass, where)
    both = spread(part, guide, 20.0, where) + spread(mass - part, guide, 20.0, where)
    np.testing.assert_allclose(both, smooth, rtol=1e-10, atol=1e-20)


def kernel(size):
    """(coarse, size): weights 1 3 3 1 / 4 of cells in those half as fine, what would lie beyond the
    edge in the last one.
    """
    made = np.zeros(((size + 1) // 2, size))
    for fine in range(size):
        for offset, part in zip((-1, 0, 1, 2), (1, 3, 3, 1), strict=True):
            for coarse in range(-1, len(made) + 1):
                if fine == 2 * coarse + offset:
                    made[min(max(coarse, 0), len(made) - 1), fine] += part / 4
    return made


@pytest.mark.parametrize("shape", [(33, 58), (64, 47), (19, 21)])
def test_few_cells_climb_and_are_read_as_all_are(shape):
    """Sparse and dense sums, and interpolation, against matrices; rounding of a dozen additions."""
    rng = np.random.default_rng(6)
    rows, columns = kernel(shape[0]), kernel(shape[1])
    for share in (0.02, 0.9):  # under and over the share from which on it is done for all cells
        fine = rng.random(shape) * (rng.random(shape) < share)
        fine[0, -1] = fine[-1, 0] = 1.0
        held = np.flatnonzero(fine)
        expected = (rows @ fine @ columns.T).ravel()
        for factor, raised in zip(
            (1, 3),
            density._raised(held, shape, fine.ravel()[held], 3 * fine.ravel()[held]),
            strict=True,
        ):
            np.testing.assert_allclose(raised, factor * expected, rtol=1e-14)
    coarse = rng.random(((shape[0] + 1) // 2, (shape[1] + 1) // 2))
    np.testing.assert_allclose(density._finer(coarse, shape), rows.T @ coarse @ columns, rtol=1e-14)


def test_cells_that_are_asked_for_have_the_values_of_the_map():
    """On a grid so large that some levels are read at few cells and some whole; land thin enough to
    be few cells, and not.
    """
    rng = np.random.default_rng(8)
    shape = (130, 171)
    strip = np.abs(np.arange(shape[0])[:, None] - 60 - np.arange(shape[1]) // 5) < 5
    for allowed in (np.ones(shape, bool), strip):
        where = density.medium(allowed)
        assert (where.few is None) == allowed.all()
        mass = rng.poisson(0.4 * rng.random(shape) ** 8, shape) * allowed * 1e-4
        mass[40:43, 55] = 5e-3 * allowed[40:43, 55]  # a pile, whose kernels are the narrowest
        smooth = spread(mass, histogram(mass, where), 12.0, where)
        assert smooth.sum() == pytest.approx(mass.sum(), rel=1e-12)
        held, asked = np.flatnonzero(mass), rng.choice(mass.size, 300, replace=False)
        few = density.spread(
            held,
            mass.ravel()[held],
            histogram(mass, where),
            12.0,
            where,
            density.reading(asked, [level.shape for level in where.reach]),
        )
        np.testing.assert_allclose(few, smooth.ravel()[asked], rtol=1e-10, atol=1e-18)


def test_ties_are_ranked_in_order_of_the_index():
    values = np.round(np.random.default_rng(4).random((61, 47)), 2)
    expected = sorted(np.flatnonzero(values), key=lambda k: (-values.ravel()[k], k))
    assert density.ranked(values).tolist() == expected
    assert density.ranked(values, 0.25).tolist() == [
        k for k in expected if values.ravel()[k] >= 0.25
    ]


def test_kernel_variance_follows_the_particles_it_should_hold():
    # far from edges one kernel of level l has variance 1.5 4^l - 0.5 cells: Gauss 4^l, down and up
    # 4^l - 1 over 2
    allowed = np.ones((256, 256), bool)
    where = density.medium(allowed)
    mass = np.zeros((256, 256))
    mass[121, 133] = 1.0
    for level, wanted in ((0, 1.0), (1, 5.5), (2, 23.5), (3, 95.5)):
        number = [np.full(r.shape, 1e9 if i >= level else 1e-9) for i, r in enumerate(where.reach)]
        smooth = spread(mass, density.Histogram(tuple(number)), 10.0, where)
        offsets = np.arange(256) - np.array([[121], [133]])
        for axis in (0, 1):
            along = smooth.sum(axis=1 - axis)
            mean = (along * offsets[axis]).sum()
            # truncating the Gauss at 4 standard deviations takes 0.1 % of its variance; decimation
            # shifts the mean
            assert (along * offsets[axis] ** 2).sum() - mean**2 == pytest.approx(wanted, rel=0.03)
