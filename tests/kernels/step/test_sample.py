"""Tiles against SciPy's interpolator; priority, missing values, time, antimeridian, seam."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from geo import sphere
from geo.grids.grid import Grid
from kernels.step.sample import Tiles

RNG = np.random.default_rng(8)


def field(grid: Grid, seed: int = 0) -> np.ndarray:
    """Random values that repeat their first column at the end where the grid goes round."""
    values = np.random.default_rng(seed).normal(size=(grid.nlat, grid.nlon, 2)).astype(np.float32)
    if grid.seamless:
        values[:, -1] = values[:, 0]
    return values


def points(
    west: float, east: float, south: float, north: float, n: int = 5000
) -> tuple[np.ndarray, np.ndarray]:
    return sphere.to_binary(RNG.uniform(west, east, n)), sphere.to_binary(
        RNG.uniform(south, north, n)
    )


@pytest.mark.parametrize(
    "grid",
    [
        Grid(-98.0, 18.0, 0.05, 0.04, 81, 61),
        Grid(176.0, -20.5, 0.25, 0.2, 33, 12),  # 176 E to 176 W
        Grid(-180.0, -80.0, 1.0, 2.0, 361, 81),  # round the Earth
        Grid(20.0, -80.0, 1.5, 2.0, 241, 81),  # round the Earth from 20 E
    ],
    ids=["regional", "antimeridian", "global", "global from 20 E"],
)
@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_bilinear_in_space_and_linear_in_time(grid: Grid, fraction: float) -> None:
    tiles = Tiles([Grid(0, 0, 1, 1, 3, 2), grid])
    early, late = field(grid, 1), field(grid, 2)
    tiles.place(1, early, later=False)
    tiles.place(1, late, later=True)
    tiles.blend([None, (0.2, 0.7)])
    lon, lat = points(
        grid.lon0,
        grid.lon0 + (grid.nlon - 1) * grid.dlon,
        grid.lat0,
        grid.lat0 + (grid.nlat - 1) * grid.dlat,
    )
    found = tiles.at(1, 2, lon, lat, fraction)
    weight = 0.2 + 0.5 * fraction
    values = (1 - weight) * early.astype(float) + weight * late
    axes = (
        grid.lat0 + grid.dlat * np.arange(grid.nlat),
        grid.lon0 + grid.dlon * np.arange(grid.nlon),
    )
    x = grid.lon0 + (sphere.to_degrees(lon) - grid.lon0) % 360
    expected = RegularGridInterpolator(axes, values)(np.stack([sphere.to_degrees(lat), x], axis=1))
    assert (found[:, 2] == 1).all()
    # float32 of a node's coordinate: eps * number of nodes, times the largest slope between nodes
    tolerance = 4 * np.finfo(np.float32).eps * grid.nlon * np.abs(np.diff(values, axis=1)).max()
    assert np.abs(found[:, :2] - expected).max() < tolerance


def test_a_shift_makes_the_later_slice_the_earlier() -> None:
    grid = Grid(5.0, 58.0, 0.5, 0.25, 9, 7)
    slices = [field(grid, k) for k in range(3)]
    moved, fresh = Tiles([grid]), Tiles([grid])
    moved.place(0, slices[0], later=False)
    moved.place(0, slices[1], later=True)
    moved.place(0, slices[2], later=True, shift=True)
    fresh.place(0, slices[1], later=False)
    fresh.place(0, slices[2], later=True)
    assert (moved.nodes.to_numpy() == fresh.nodes.to_numpy()).all()


def test_the_next_source_answers_where_the_first_is_missing_or_absent_and_nowhere_is_never_zero() -> (
    None
):
    small, large = Grid(2.0, 60.0, 1.0, 1.0, 4, 3), Grid(0.0, 58.0, 2.0, 2.0, 6, 5)
    tiles = Tiles([small, large])
    hole = np.full((3, 4, 2), 1.0, np.float32)
    hole[1, 2] = np.nan
    for later in (False, True):
        tiles.place(0, hole, later=later)
        tiles.place(1, np.full((5, 6, 2), 2.0, np.float32), later=later)
    tiles.blend([(0.0, 1.0), (0.0, 1.0)])
    lon = sphere.to_binary([2.5, 3.5, 9.0, 11.0])
    lat = sphere.to_binary([60.5, 60.5, 62.0, 60.5])
    found = tiles.at(0, 2, lon, lat, 0.5)
    assert found[:3, 0] == pytest.approx([1.0, 2.0, 2.0])
    assert found[:, 2].tolist() == [1, 1, 1, 0]
    tiles.blend([None, (0.0, 1.0)])  # the first source has nothing at this time
    assert tiles.at(0, 2, lon, lat, 0.5)[:3, 0] == pytest.approx([2.0, 2.0, 2.0])
    tiles.blend([(0.0, 1.0), None])
    assert tiles.at(0, 2, lon, lat, 0.5)[:, 2].tolist() == [1, 0, 0, 0]


def test_a_steady_vector_covers_the_globe() -> None:
    tiles = Tiles([Grid(-180, -90, 360, 180, 2, 2)])
    values = np.tile(np.array([0.25, -0.5], np.float32), (2, 2, 1))
    tiles.place(0, values, later=False)
    tiles.place(0, values, later=True)
    tiles.blend([(0.0, 0.0)])
    lon, lat = points(-180, 180, -90, 90)
    assert tiles.at(0, 1, lon, lat, 0.9) == pytest.approx(
        np.tile([0.25, -0.5, 1.0], (lon.size, 1)), rel=1e-6
    )


@pytest.mark.parametrize("lon0", [0.0, -180.0, 20.3, 359.9])
@pytest.mark.parametrize("nlon", [361, 4321])
def test_no_unit_of_longitude_falls_between_the_ends_of_a_global_tile(
    lon0: float, nlon: int
) -> None:
    grid = Grid(lon0, -1.0, 360 / (nlon - 1), 1.0, nlon, 3)
    tiles = Tiles([grid])
    wave = np.stack([np.sin(np.radians(grid.lon)), np.cos(np.radians(grid.lon))], axis=-1)
    values = np.broadcast_to(wave, (3, nlon, 2)).astype(np.float32)
    tiles.place(0, values, later=False)
    tiles.place(0, values, later=True)
    tiles.blend([(0.0, 0.0)])
    near = int(sphere.to_binary(lon0)) + np.arange(-600, 600)
    lon = ((near + 2**31) % 2**32 - 2**31).astype(np.int32)
    found = tiles.at(0, 1, lon, np.zeros(lon.size, np.int32), 0.0)
    assert (found[:, 2] == 1).all()
    # bilinear: h^2 / 8 of the second derivative; float32 coordinates: 2^-24 of a turn
    bound = np.radians(grid.dlon) ** 2 / 8 + 2 * np.pi * 2**-24 + 1e-6
    assert np.abs(found[:, 0] - np.sin(lon * sphere.UNIT)).max() < bound


def test_a_tile_just_east_of_a_particle_is_silent() -> None:
    grid = Grid(179.7, 50.0, 0.1, 0.1, 7, 7)
    tiles = Tiles([grid])
    for later in (False, True):
        tiles.place(0, np.ones((7, 7, 2), np.float32), later=later)
    tiles.blend([(0.0, 0.0)])
    lon = (sphere.to_binary(179.7) - np.array([0, 1, 2, 1000, 10**6])).astype(np.int32)
    found = tiles.at(0, 1, lon, np.full(5, int(sphere.to_binary(50.3)), np.int32), 0.0)
    assert found[:, 2].tolist() == [1, 0, 0, 0, 0]
