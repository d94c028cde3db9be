"""The most likely place afloat and stretch of coast, against a search through all cells by hand."""

import numpy as np
import pytest
import xarray as xr
from pyproj import Geod

from drift.forecast.likeliest_places import LEAST, REACH, likeliest_place, likeliest_places

ROWS, COLUMNS = 31, 41
WEST, SOUTH = 179.6, 62.1  # across the antimeridian
STEP = (0.021, 0.0097)  # [deg] of longitude and latitude


def grid(afloat: np.ndarray, ashore: np.ndarray) -> xr.Dataset:
    lat = SOUTH + STEP[1] * np.arange(ROWS)
    # of no map: what lies in the east counts for less, and is not to be taken for less dense
    area = np.cos(np.radians(lat))[:, None] * np.linspace(0.4, 1.6, COLUMNS)
    cells = {
        "probability": afloat + ashore,
        "probability_ashore": ashore,
        "cell_area": 1e6 * area,
    }
    return xr.Dataset(
        {name: (("lat", "lon"), value.astype(np.float32)) for name, value in cells.items()},
        {"lon": WEST + STEP[0] * np.arange(COLUMNS), "lat": lat},
    )


def scattered(seed: int, share_ashore: float) -> xr.Dataset:
    """Return a broad cloud afloat, and few cells of a coast with a lot in each."""
    random = np.random.default_rng(seed)
    afloat = random.gamma(5.0, size=(ROWS, COLUMNS))
    ashore = random.gamma(0.3, size=(ROWS, COLUMNS)) * (random.random((ROWS, COLUMNS)) < 0.02)
    return grid(
        (1 - share_ashore) * afloat / afloat.sum(), share_ashore * ashore / max(ashore.sum(), 1e-9)
    )


def by_hand(at: xr.Dataset) -> tuple[tuple[int, int], tuple[int, int], float]:
    """Return the densest cell afloat, the cell with most ashore within REACH, and how much.

    Distances are those of PROJ on a sphere.
    """
    sphere = Geod(a=6_371_008.8, b=6_371_008.8)
    ashore = at["probability_ashore"].values.astype(float)
    afloat = (at["probability"].values - ashore) / at["cell_area"].values
    stranded = np.argwhere(ashore > 0)
    lon, lat = at["lon"].values, at["lat"].values
    best, most = (-1, -1), -1.0
    for row, column in stranded:
        total = 0.0
        for other, beside in stranded:
            away = sphere.inv(lon[column], lat[row], lon[beside], lat[other])[2]
            total += ashore[other, beside] if away <= REACH else 0.0
        if total > most:
            best, most = (int(row), int(column)), total
    where = np.unravel_index(int(afloat.argmax()), afloat.shape)
    return (int(where[0]), int(where[1])), best, most


@pytest.mark.parametrize(("seed", "share"), [(3, 0.02), (4, 0.3), (5, 0.8)])
def test_both_places_by_a_search_through_all_cells(seed: int, share: float) -> None:
    at = scattered(seed, share)
    sea, coast, held = by_hand(at)
    # the cell with most of all media together is of the coast: what stood in the headline once
    density = at["probability"].values / at["cell_area"].values
    assert at["probability_ashore"].values.ravel()[density.argmax()] > 0
    found = likeliest_places(at)
    assert [one.ashore for one in found] == ([True, False] if share > 0.5 else [False, True])
    for place in found:
        row, column = coast if place.ashore else sea
        assert place.lat == pytest.approx(SOUTH + STEP[1] * row, abs=1e-9)
        lon = WEST + STEP[0] * column
        assert place.lon == pytest.approx((lon + 180) % 360 - 180, abs=1e-9)
        assert place.share == pytest.approx(held if place.ashore else 1 - share, abs=1e-5)
    assert likeliest_place(at) == found[0]


def test_of_stretches_that_hold_the_same_the_densest_cell_is_named() -> None:
    """Five cells within reach of each other hold all: their sums differ only by rounding."""
    ashore = np.zeros((ROWS, COLUMNS))
    ashore[9, 30:35] = [0.011, 0.013, 0.012, 0.019, 0.003]
    afloat = np.zeros((ROWS, COLUMNS))
    afloat[20, 7] = 1 - ashore.sum()
    _, coast = likeliest_places(grid(afloat, ashore))
    assert coast.lon == pytest.approx(WEST + 33 * STEP[0] - 360, abs=1e-9)
    assert coast.share == pytest.approx(0.058, abs=1e-6)


def test_what_is_too_little_or_nothing() -> None:
    empty = np.zeros((ROWS, COLUMNS))
    one = empty.copy()
    one[4, 5] = 1.0
    assert likeliest_places(grid(empty, empty)) == []
    assert likeliest_place(grid(empty, empty)) is None
    little = likeliest_places(grid((1 - 0.9 * LEAST) * one, 0.9 * LEAST * one[::-1]))
    assert [place.ashore for place in little] == [False]
    # on a small map nearly all may be beyond it: what is ashore there is named
    assert [place.ashore for place in likeliest_places(grid(empty, 0.5 * LEAST * one))] == [True]
