"""Which rows and columns a box needs, against every node asked by itself."""

import numpy as np
import pytest
import shapely

from drift.apps.fetch import window
from geo.box import Box

MARGIN = 1.5  # cells that are taken beyond the box


def around(lon: np.ndarray, west: float) -> np.ndarray:
    """Return longitudes as degrees east of a meridian, in [0, 360)."""
    return (lon - west) % 360


@pytest.mark.parametrize("down", [False, True], ids=["ascending", "descending"])
@pytest.mark.parametrize("kind", ["regional", "global", "closed"])
@pytest.mark.parametrize("seed", range(12))
def test_columns_are_those_of_the_box(seed: int, kind: str, down: bool) -> None:
    random = np.random.default_rng([seed, len(kind), down])
    step = float(random.choice([0.25, 1.0, 2.5]))
    first = float(random.uniform(-180, 200))
    many = {
        "regional": int(60 / step),
        "global": round(360 / step),
        "closed": round(360 / step) + 1,
    }[kind]
    lon = first + step * np.arange(many)
    # A closed axis has its first meridian twice: the box lies about it.
    west = first + float(random.uniform(-20, {"regional": 50, "global": 350, "closed": 2}[kind]))
    box = Box(west, -11.3, west + float(random.uniform(3, 30)), 17.9)
    lat = np.arange(-80, 80.1, 2.0)
    if down:
        lon, lat = lon[::-1], lat[::-1]
    found = window.along_axes(lon, lat, box)
    wanted = around(lon, box.west - MARGIN * step) <= box.east - box.west + 2 * MARGIN * step
    if not wanted.any():
        assert found is None
        return
    assert found is not None
    columns = np.concatenate([np.arange(*run) for run in found.runs])
    taken = np.concatenate(
        [lon[slice(*run)] + turn for run, turn in zip(found.runs, found.turns, strict=True)]
    )
    assert found.shape == (found.rows[1] - found.rows[0], columns.size)
    assert found.turns[0] == 0  # they begin as the file has them
    # and run on without a jump
    np.testing.assert_allclose(np.diff(taken), -step if down else step, atol=1e-9)
    everyone = {round(float(x) % 360, 6) % 360 for x in lon[wanted]}
    # each meridian, and once
    assert {round(float(x) % 360, 6) % 360 for x in lon[columns]} == everyone
    assert columns.size == len(everyone)
    rows = lat[slice(*found.rows)]
    assert rows.tolist() == [
        y for y in lat if box.south - 2 * MARGIN <= y <= box.north + 2 * MARGIN
    ]
    # of all turns, that nearest to the box
    left = box.west + (taken.min() - box.west + 180) % 360 - 180
    assert found.whole == (left <= box.west and left + np.ptp(taken) >= box.east)


@pytest.mark.parametrize(
    ("south", "north", "whole"), [(-79, 79, True), (-79, 85, False), (-85, 10, False)]
)
def test_a_box_that_is_higher_than_the_grid(south: float, north: float, whole: bool) -> None:
    found = window.along_axes(
        np.arange(0, 360, 2.0), np.arange(-80, 80.1, 2.0), Box(10, south, 20, north)
    )
    assert found is not None
    assert found.whole == whole


def test_the_whole_circle() -> None:
    found = window.along_axes(
        np.arange(0, 360, 10.0), np.arange(-80, 80.1, 10.0), Box(-180, -70, 180, 70)
    )
    assert found == window.Window((0, 17), ((0, 36),), (0.0,), True)


@pytest.mark.parametrize(
    ("lon", "lat", "south", "north", "whole"),
    [
        (
            np.arange(0, 360, 10.0),
            np.arange(-85, 86, 10.0),
            -90,
            90,
            True,
        ),  # rows in the middle of their cells: none is nearer to a pole
        (np.arange(0, 360, 10.0), np.arange(-85, 80, 10.0), -90, 90, False),
        (np.arange(0, 360, 10.0), np.arange(-75, 86, 10.0), -90, 90, False),
        (np.arange(0, 340, 10.0), np.arange(-85, 86, 10.0), -60, 60, False),
        (np.arange(-180, 181, 10.0), np.arange(-85, 86, 10.0), -60, 60, True),
    ],
    ids=["all", "not in the north", "not in the south", "not all round", "a meridian twice"],
)
def test_what_goes_round_may_lack_something(
    lon: np.ndarray, lat: np.ndarray, south: float, north: float, whole: bool
) -> None:
    found = window.along_axes(lon, lat, Box(-180, south, 180, north))
    assert found is not None
    assert found.runs == ((0, lon.size),)
    assert found.whole == whole


@pytest.mark.parametrize(
    ("south", "north", "whole"), [(70, 90, True), (-90, -70, True), (70, 88, True), (-90, 80, True)]
)
def test_a_box_to_a_pole_needs_a_row_within_a_cell_of_it(
    south: float, north: float, whole: bool
) -> None:
    for lat, held in ((np.arange(-88.75, 89, 2.5), whole), (np.arange(-83.75, 84, 2.5), False)):
        found = window.along_axes(np.arange(0, 360, 2.5), lat, Box(10, south, 41, north))
        assert found is not None
        assert found.whole == held


def bent(lon: float, lat: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a curvilinear grid (23, 31) [deg] about a place, turned by 0.3 rad, whose rows bend;
    longitudes in [-180, 180).
    """
    row, column = np.mgrid[-11:12, -15:16].astype(float)
    x, y = 0.11 * column, 0.09 * (row + 0.004 * column**2)
    east, north = np.cos(0.3) * x - np.sin(0.3) * y, np.sin(0.3) * x + np.cos(0.3) * y
    return (lon + east + 180) % 360 - 180, lat + north


@pytest.mark.parametrize("turned", [False, True], ids=["rows first", "columns first"])
@pytest.mark.parametrize(
    ("east", "north", "whole"),
    [
        (0.13, -0.07, True),
        (1.2, 0.3, False),
        (-1.35, -0.3, False),
        (-0.3, 0.9, False),
        (0.31, -0.8, False),
    ],
    ids=["inside", "beyond the east", "beyond the west", "beyond the north", "beyond the south"],
)
def test_a_box_on_a_curvilinear_grid(east: float, north: float, whole: bool, turned: bool) -> None:
    """Across the antimeridian: two nodes more than those in the box, as far as there are any; all
    of it, by shapely's outline.
    """
    middle = 179.63, 51.2
    lon, lat = bent(*middle)
    if turned:
        lon, lat = lon.T, lat.T
    box = Box(
        middle[0] + east - 0.41,
        middle[1] + north - 0.27,
        middle[0] + east + 0.41,
        middle[1] + north + 0.27,
    )
    found = window.on_surface(lon, lat, box)
    x = middle[0] + (lon - middle[0] + 180) % 360 - 180
    spans = []
    for axis, many in ((1, lon.shape[0]), (0, lon.shape[1])):
        inside = (box.west <= x) & (x <= box.east) & (box.south <= lat) & (lat <= box.north)
        within = [k for k in range(many) if inside.take(k, 1 - axis).any()]
        spans.append((max(within[0] - 2, 0), min(within[-1] + 2, many - 1) + 1))
    around = [
        (slice(None), 0),
        (-1, slice(None)),
        (slice(None, None, -1), -1),
        (0, slice(None, None, -1)),
    ]
    outline = shapely.Polygon(
        np.concatenate([np.stack([x[side], lat[side]], axis=1) for side in around])
    )
    assert outline.contains(shapely.box(box.west, box.south, box.east, box.north)) == whole
    assert found == window.Window(spans[0], (spans[1],), (0.0,), whole)


def test_a_box_off_a_curvilinear_grid() -> None:
    assert window.on_surface(*bent(12.3, -33.1), Box(14.9, -33.4, 15.7, -32.9)) is None
