"""What fills missing values, and small questions to grids, against plain search and closed forms on
the sphere.
"""

import numpy as np
import pytest

from geo import sphere
from geo.box import Box
from geo.grids import fill
from geo.grids.grid import Grid, sample, share_covered


def test_the_nearest_wet_node_fills_up_to_a_distance_in_metres() -> None:
    """Across the edge of a band of latitude at 65 N, where a degree of longitude is less than half
    of one of latitude.
    """
    grid = Grid(5.0, 64.3, 0.09, 0.05, 60, 30)
    rng = np.random.default_rng(8)
    wet = rng.random((grid.nlat, grid.nlon)) < 0.02
    wet[:, 50:] = False
    wet[grid.lat > 65.02] &= rng.random((int((grid.lat > 65.02).sum()), grid.nlon)) < 0.2
    number = np.arange(grid.nlat * grid.nlon, dtype=np.float32).reshape(grid.nlat, grid.nlon)
    values = np.where(wet, number, np.nan)[..., None].astype(np.float32)
    reach = 21_000.0
    filled = fill.fill(values, 0, reach=reach, bands=fill.bands(grid))[..., 0]
    lon, lat = np.radians(np.meshgrid(grid.lon, grid.lat))
    away = sphere.distance(lon[..., None], lat[..., None], lon[wet], lat[wet])  # (nlat, nlon, wet)
    nearest = away.min(axis=-1)
    # A degree of longitude counts as in the middle of its band of 5 degrees: 4.7 % at 65 N, and as
    # much on the way back.
    off = np.cos(np.radians(65.0)) / np.cos(np.radians(67.5))
    assert np.isfinite(filled[nearest < reach / off]).all()
    assert np.isnan(filled[nearest > reach * off]).all()
    assert 200 < np.isnan(filled).sum() < number.size - 400
    got = np.isfinite(filled)
    order = {int(k): place for place, k in enumerate(number[wet])}
    source = np.array([order[int(k)] for k in filled[got]])
    chosen = np.take_along_axis(away[got], source[:, None], axis=1)[:, 0]
    assert (chosen <= nearest[got] * off**2 + 1.0).all()


def test_a_point_a_hair_west_of_the_first_column_is_on_it() -> None:
    grid = Grid(-179.7, -12.0, 0.7, 0.4, 9, 8)
    values = np.random.default_rng(2).normal(size=(8, 9)).astype(np.float32)
    np.testing.assert_allclose(
        sample(grid, values, np.full(8, -179.7 - 1e-10), grid.lat), values[:, 0], rtol=1e-6
    )
    assert np.isnan(sample(grid, values, -179.71, -11.0)).all()


@pytest.mark.parametrize("south", [31.0, 62.0])
def test_the_share_of_a_box_is_that_of_its_area_on_the_sphere(south: float) -> None:
    """Zones are as large as the differences of their latitudes' sines; 5 of the box's 9 degrees of
    longitude are covered.
    """
    grid = Grid(-183.0, south, 0.5, 0.25, 11, 41)  # to 178 W and 10 degrees north
    box = Box(177.0, south - 13.0, 186.0, south + 7.0)
    low, middle, high = np.sin(np.radians([south - 13.0, south, south + 7.0]))
    assert share_covered(grid, box) == pytest.approx(
        (high - middle) / (high - low) * 5 / 9, rel=1e-9
    )
