"""Tables of POD as kernels take them, against pyproj's geodesics; at places and times, against
SciPy's interpolation.
"""

from itertools import pairwise

import numpy as np
import pyproj
import pytest
from scipy.interpolate import RegularGridInterpolator

from drift.evidence.sensors import pod_table
from drift.evidence.sensors.records import PodGrid
from geo import sphere
from kernels.evidence import glimpse

GEOD = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
NEVER = np.array([], "datetime64[s]")


@pytest.mark.parametrize(
    ("lon", "lat"),
    [
        ((7.3, 0.021, 6), (58.1, 0.017, 41)),
        ((178.9, 0.033, 90), (-51.3, 0.019, 27)),
        ((-31.7, 0.05, 4), (-9.2, 0.052, 900)),  # across the equator: it is narrowest in the north
        ((-31.7, 0.05, 4), (-37.4, 0.052, 900)),  # and here in the south
        ((12.2, 0.4, 5), (61.0, 0.011, 9)),
    ],
    ids=["north", "south", "farther north", "farther south", "rows close together"],
)
def test_the_lesser_side_of_a_cell_is_that_where_cells_are_least(
    lon: tuple[float, float, int], lat: tuple[float, float, int]
) -> None:
    """A parallel is longer than its chord, by 1e-6 of it for cells as small as this."""
    x, y = (first + step * np.arange(many) for first, step, many in (lon, lat))
    pod = np.linspace(0, 0.9, y.size * x.size).reshape(1, y.size, x.size).astype(np.float32)
    made = pod_table.tables(
        PodGrid(pod, NEVER, np.radians(y), np.radians(x)), np.datetime64("2026-01-01"), 1800.0
    )
    sides = [GEOD.inv(x[0], v, x[1], v)[2] for v in y] + [
        GEOD.inv(x[0], a, x[0], b)[2] for a, b in pairwise(y)
    ]
    assert made.between == pytest.approx(min(sides), rel=1e-5)
    assert made.kind == glimpse.PLACES
    assert made.rate == pytest.approx(1 / 1800.0)
    turn = 2.0**32 / 360  # binary angles of a degree
    assert made.cell == pytest.approx((lon[1] * turn, lat[1] * turn), rel=1e-9)
    assert made.middle[1] == pytest.approx(y.mean() * turn, abs=1)
    assert made.middle[0] == pytest.approx(((x.mean() + 180) % 360 - 180) * turn, abs=1)
    np.testing.assert_array_equal(made.table, pod[0])


def test_at_places_and_between_times() -> None:
    """Across the antimeridian; before the first time and after the last it is as it was then; off
    the grid nothing is seen.
    """
    random = np.random.default_rng(8)
    lon, lat = np.radians(177.4 + 0.7 * np.arange(7)), np.radians(-47.3 + 0.4 * np.arange(9))
    pod = random.random((3, 9, 7)).astype(np.float32)
    times = np.datetime64("2026-03-01T00:00:00", "s") + np.array([0, 3700, 9100])
    grid = PodGrid(pod, times, lat, lon, per=600.0)
    x, y = (
        random.uniform(lon[0] - 0.01, lon[-1] + 0.01, 500),
        random.uniform(lat[0] - 0.01, lat[-1] + 0.01, 500),
    )
    for seconds in (-400, 0, 900, 3700, 5123, 9100, 20_000):
        slab = [np.interp(seconds, [0, 3700, 9100], own) for own in pod.reshape(3, -1).T]
        read = RegularGridInterpolator(
            (lat, lon), np.reshape(slab, (9, 7)), bounds_error=False, fill_value=0.0
        )
        found = pod_table.chance(
            grid, (0.0, 0.0), times[0] + seconds, (x + np.pi) % (2 * np.pi) - np.pi, y
        )
        np.testing.assert_allclose(found, read(np.stack([y, x], axis=1)), atol=1e-6)
        assert (found == 0).any()


@pytest.mark.parametrize(
    ("ranges", "rings"),
    [
        (np.arange(1, 41) * 250.0, 40),  # as they are
        # as far apart as those nearest to each other
        (np.array([100.0, 130.0, 400.0, 2000.0, 9100.0]), 301),
        (np.array([100.0, 1300.0, 4000.0]), 200),
        (np.array([0.0, 0.5, 9000.0]), 4000),
    ],
    ids=["even", "uneven", "few", "too many"],
)
def test_rings_are_as_fine_as_the_ranges(ranges: np.ndarray, rings: int) -> None:
    """POD is straight between ranges and bearings, whatever is laid between them."""
    random = np.random.default_rng(ranges.size)
    bearing = np.arange(12) * np.pi / 6
    pod = random.random((1, 12, ranges.size)).astype(np.float32)
    grid = PodGrid(pod, NEVER, bearing=bearing, range=ranges, per=900.0)
    made = pod_table.tables(grid, np.datetime64("2026-01-01"), 60.0)
    assert made.kind == glimpse.ROUND
    assert made.table.shape[1] == rings
    assert made.rate == pytest.approx(1 / 900)
    assert made.nearest == ranges[0]
    at = ranges[0] + made.between * np.arange(rings)
    assert at[-1] == pytest.approx(ranges[-1])
    turn = np.linspace(0, 2 * np.pi, made.table.shape[0], endpoint=False)
    closed = RegularGridInterpolator(
        (np.append(bearing, 2 * np.pi), ranges), np.vstack([pod[0], pod[0][:1]])
    )
    expected = closed(
        np.stack(np.meshgrid(turn, np.clip(at, ranges[0], ranges[-1]), indexing="ij"), axis=-1)
    )
    np.testing.assert_allclose(made.table, expected, atol=2e-6)


@pytest.mark.parametrize(
    "bearing", [np.radians([10.0, 47.0, 200.0, 331.0]), np.zeros(1)], ids=["uneven", "all round"]
)
def test_round_a_sensor(bearing: np.ndarray) -> None:
    """By pyproj's bearings and ranges, across the antimeridian: nearer than the first range as
    there, beyond the last nothing.
    """
    random = np.random.default_rng(5)
    ranges = np.array([500.0, 1200.0, 5000.0, 7300.0])
    pod = random.uniform(0.1, 0.9, (1, bearing.size, 4)).astype(np.float32)
    grid = PodGrid(pod, NEVER, bearing=bearing, range=ranges)
    turn, far = (
        random.uniform(0, 360, 600),
        np.append(random.uniform(10, 9000, 598), [7299.5, 7300.5]),
    )
    lon, lat, _ = GEOD.fwd(np.full(600, 179.99), np.full(600, 62.1), turn, far)
    found = pod_table.chance(
        grid,
        tuple(np.radians([179.99, 62.1])),
        np.datetime64("2026-01-01"),
        np.radians(lon),
        np.radians(lat),
    )
    by_range = np.array([np.interp(far, ranges, row) for row in pod[0]])
    expected = [
        np.interp(t, bearing, row, period=2 * np.pi)
        for t, row in zip(np.radians(turn), by_range.T, strict=True)
    ]
    np.testing.assert_allclose(
        found, np.where(far <= 7300, expected, 0.0), atol=1e-4
    )  # bearings on the sphere, to 1e-4


def test_bearings_that_are_uneven_have_rays_of_half_a_degree() -> None:
    bearing, random = np.radians([10.3, 47.1, 200.2, 331.9]), np.random.default_rng(7)
    pod = random.random((1, 4, 3)).astype(np.float32)
    grid = PodGrid(pod, NEVER, bearing=bearing, range=np.array([100.0, 300.0, 500.0]), per=900.0)
    made = pod_table.tables(grid, np.datetime64("2026-01-01"), 60.0)
    rays = made.table.shape[0]
    assert rays >= 720
    turn = np.arange(rays) * 2 * np.pi / rays
    expected = np.stack(
        [np.interp(turn, bearing, column, period=2 * np.pi) for column in pod[0].T], axis=1
    )
    np.testing.assert_allclose(made.table, expected, atol=2e-6)
