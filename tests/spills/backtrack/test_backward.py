"""Densities of finds by cell, in closed form, on a grid so high that its plane and the sphere
differ.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from drift.engine.particles.status import Status
from drift.spills.backtrack import backward
from drift.spills.backtrack.tracks import Group
from geo import sphere

MIDDLE = (179.6, 61.7)  # [deg] of the grid; it lies across the antimeridian
EAST, NORTH = 210e3, 420e3  # [m] standard deviations of what comes from the find


def column(values: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(to_numpy=lambda: values)


@pytest.mark.parametrize("off", [0.0, -310e3, 240e3])
def test_a_density_is_one_on_the_sphere(off: float) -> None:
    """Particles normal in the plane, by quantiles, 40 x 60 for each of two worlds: on the sphere a
    cell of the plane is larger or smaller.

    Their middle is so far [m] north of the grid's. Kernels leave a normal law as it is; where it
    ends, by quantiles, it is known to 4 % within 1.6 standard deviations.
    """
    degree = np.radians(sphere.RADIUS)
    wide = degree * np.cos(np.radians(MIDDLE[1]))
    side = 30e3
    lon, lat = (
        MIDDLE[0] + side / wide * np.arange(-22, 23),
        MIDDLE[1] + side / degree * np.arange(-35, 36),
    )
    grid = backward._Grid(lon, lat, np.zeros(1, np.int64), np.ones((1, lat.size, lon.size)), side)
    x, y = (stats.norm.ppf((np.arange(n) + 0.5) / n) for n in (40, 60))
    x, y = (EAST * x / x.std())[:, None], (off + NORTH * y / y.std())[None]
    x, y = (
        np.append(v.ravel(), np.full(400, at))
        for v, at in zip(np.broadcast_arrays(x, y), (2e5, 1e5), strict=True)
    )
    x, y, n = np.tile(x, 2), np.tile(y, 2), x.size
    # What has come ashore, or has sunk, counts for nothing, wherever it is: 400 of each world.
    status = np.tile(np.where(np.arange(n) < 2400, int(Status.ADRIFT), int(Status.ASHORE)), 2)
    there = (
        np.stack([(MIDDLE[0] + x / wide + 180) % 360 - 180, MIDDLE[1] + y / degree]) * 2**32 / 360
    )
    moment = SimpleNamespace(
        status=status, lon=there[0].astype(np.int32), lat=there[1].astype(np.int32), elapsed=7200.0
    )
    ensemble = SimpleNamespace(
        release=column(np.zeros(2 * n)), log_weight=column(np.full(2 * n, np.log(0.6), np.float32))
    )
    spill = SimpleNamespace(finds=[None], kinds=[SimpleNamespace(sinking=None)], release_std=1000.0)
    worlds = SimpleNamespace(size=2, sinking=np.zeros((2, 1)))
    found = backward._find_densities(
        spill, grid, worlds, [Group(0, 0, 0.7, 0, n)], ensemble, moment
    )
    assert found.shape == (1, 2, lat.size, lon.size)
    gx, gy = (lon - MIDDLE[0]) * wide, (lat - MIDDLE[1]) * degree
    plane = np.outer(stats.norm.pdf(gy, off, NORTH), stats.norm.pdf(gx, 0.0, EAST))
    on_sphere = plane * (np.cos(np.radians(MIDDLE[1])) / np.cos(np.radians(lat)))[:, None]
    expected = 0.6 * 0.7 * 2400 / n * on_sphere * (side**2 * lat.size * lon.size)
    inner = np.ix_(np.abs(gy - off) < 1.6 * NORTH, np.abs(gx) < 1.6 * EAST)
    for world in found[0]:
        np.testing.assert_allclose(world[inner], expected[inner], rtol=0.04)
