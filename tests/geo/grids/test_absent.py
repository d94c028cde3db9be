"""Points of a curvilinear grid that have no coordinates, on a grid in closed form."""

from dataclasses import replace

import numpy as np

from geo import sphere
from geo.grids import absent
from geo.grids.layout import Curved


def bent(ny: int = 16, nx: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """A grid on the sphere whose rows and columns are bent, with cells of some 10 km near 69 N;
    (lon, lat) [deg].
    """
    i, j = np.meshgrid(np.arange(nx), np.arange(ny))
    return (
        14.0 + 0.25 * i + 0.09 * j + 0.004 * i * j,
        68.5 + 0.08 * j - 0.03 * i + 0.0007 * i * i + 0.0011 * j * j,
    )


def test_coordinates_go_on_as_straight_lines_and_parallelograms_would() -> None:
    """Within what the grid bends in a cell: second differences, below 3 % of a cell here;
    neighbours alone are off by half of one.
    """
    lon, lat = bent()
    gone = np.zeros(lon.shape, bool)
    gone[9:12, 5:9] = gone[0, 15:] = True
    curved = Curved(
        np.where(gone, np.nan, lon), np.where(gone, np.nan, lat), np.arange(20), np.arange(16)
    )
    told = absent.extended(curved)
    found = gone & np.isfinite(told.lon)
    # all but the two in the middle of the block, which stand beside none
    assert found.sum() == gone.sum() - 2
    there = sphere.distance(*np.radians([told.lon[found], told.lat[found], lon[found], lat[found]]))
    place = np.stack(
        [
            np.cos(np.radians(lat)) * np.cos(np.radians(lon)),
            np.cos(np.radians(lat)) * np.sin(np.radians(lon)),
            np.sin(np.radians(lat)),
        ]
    )
    bend = max(float(np.abs(np.diff(place, 2, axis=k)).sum(axis=0).max()) for k in (1, 2))
    mixed = float(np.abs(np.diff(np.diff(place, axis=1), axis=2)).sum(axis=0).max())
    # The diagonal's second difference is that of both directions and twice the mixed one.
    assert there.max() < (2 * bend + 2 * mixed) * sphere.RADIUS
    np.testing.assert_array_equal(told.lon[~gone], lon[~gone])
    assert absent.extended(replace(curved, lon=lon, lat=lat)).lon is lon


def test_a_block_at_one_place_is_no_place_but_a_single_point_there_is() -> None:
    i, j = np.meshgrid(np.arange(20), np.arange(16))
    # its point (8, 6) is at 0 N 0 E
    lon, lat = -1.5 + 0.25 * i + 0.0 * j, -2.0 + 0.25 * j + 0.0 * i
    assert lon[8, 6] == lat[8, 6] == 0
    filled = np.zeros(lon.shape, bool)
    filled[1:4, 10:15] = True
    notes: list[str] = []
    found = absent.drop_missing_points(
        np.where(filled, 0.0, lon), np.where(filled, 0.0, lat), notes
    )
    for values, whole in zip(found, (lon, lat), strict=True):
        np.testing.assert_array_equal(values, np.where(filled, np.nan, whole))
    assert len(notes) == 1
    assert "0 E, 0 N" in notes[0]
