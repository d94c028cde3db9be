"""Parts of layouts that cover a box, against every node and cell asked by itself."""

import numpy as np
import pyproj
import pytest
import shapely

from geo.box import Box
from geo.grids import layout
from geo.grids.layout import Axes, Curved, Plane, Triangles

RNG = np.random.default_rng(11)


def span(axis: np.ndarray, low: float, high: float) -> tuple[int, int]:
    """Return the first and the last node that are kept: two before a span and two after it, as far
    as there are any.
    """
    before, after = np.flatnonzero(axis <= low), np.flatnonzero(axis >= high)
    first = before[-2] if before.size > 1 else 0
    last = after[1] if after.size > 1 else axis.size - 1
    return int(first), int(last)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("lon0", [-11.3, 171.6])
def test_axes(lon0: float, seed: int) -> None:
    """Uneven rows; across the antimeridian; also where the box reaches beyond the grid."""
    random = np.random.default_rng(seed)
    lon = lon0 + 0.37 * np.arange(40)
    lat = 31.2 + np.cumsum(random.uniform(0.2, 0.6, 25))
    west, south = lon0 + random.uniform(-0.3, 12), lat[0] + random.uniform(-0.2, 6)
    turn = 360.0 * (west > 180)
    box = Box(
        west - turn, south, west - turn + random.uniform(0.3, 5), south + random.uniform(0.3, 3)
    )
    rows, columns = 300 - np.arange(25), 7 + 2 * np.arange(40)  # as they are in the file
    made = layout.crop(Axes(lon, lat, columns, rows, round=False), box)
    assert isinstance(made, Axes)
    i = span(lon, west, west + box.east - box.west)
    j = span(lat, box.south, box.north)
    np.testing.assert_array_equal(made.columns, columns[i[0] : i[1] + 1])
    np.testing.assert_array_equal(made.rows, rows[j[0] : j[1] + 1])
    np.testing.assert_array_equal(made.lon, lon[i[0] : i[1] + 1])
    np.testing.assert_array_equal(made.lat, lat[j[0] : j[1] + 1])
    assert not made.round


@pytest.mark.parametrize("west", [-29.3, 3.1, 178.4, 340.2, 351.9, 361.0])
@pytest.mark.parametrize("wide", [0.6, 23.7, 350.0])
def test_axes_round_the_earth(west: float, wide: float) -> None:
    """Columns go on where the axis ends, as many as there are: two before the box and two after it."""
    step, many, first = 2.5, 144, 1.25
    axes = Axes(
        first + step * np.arange(many),
        np.arange(-60, 61, 3.0),
        np.arange(many) + 5,
        np.arange(41),
        round=True,
    )
    made = layout.crop(axes, Box(west, -7.7, west + wide, 20.2))
    assert isinstance(made, Axes)
    low, high = (
        int(np.floor((west - first) / step)) - 1,
        int(np.ceil((west + wide - first) / step)) + 1,
    )
    if high - low + 1 >= many:
        assert made.round
        np.testing.assert_array_equal(made.lon, axes.lon)
        return
    assert not made.round
    np.testing.assert_array_equal(made.columns, np.arange(low, high + 1) % many + 5)
    np.testing.assert_allclose(np.diff(made.lon), step)
    assert (made.lon[0] - (first + step * low)) % 360 == pytest.approx(0, abs=1e-9)


def test_a_box_off_the_axes() -> None:
    axes = Axes(
        np.arange(3.0, 9.0, 0.5),
        np.arange(50.0, 54.0, 0.5),
        np.arange(12),
        np.arange(8),
        round=False,
    )
    for west, south in ((11.2, 51.3), (-1.4, 51.3), (4.1, 55.3), (4.1, 47.2)):
        assert layout.crop(axes, Box(west, south, west + 0.7, south + 0.9)) is None


def grown(box: Box, metres: float) -> tuple[float, float, float, float]:
    """Return west, south, east, north [deg] of a box with so much more on every side, at its
    latitude farthest from the equator.
    """
    degrees = np.degrees(metres / 6_371_000)
    wide = degrees / np.cos(np.radians(max(abs(box.south), abs(box.north)) + degrees))
    return box.west - wide, box.south - degrees, box.east + wide, box.north + degrees


@pytest.mark.parametrize(("east", "north"), [(0.0, 0.0), (0.9, -0.4), (-1.2, 0.3), (0.2, 0.8)])
def test_plane(east: float, north: float) -> None:
    """Rows and columns that have a node within three cells of the box, and no others."""
    projection = pyproj.Proj(proj="stere", lat_0=90, lat_ts=60, lon_0=-40, R=6_371_000)
    middle = projection(12.4, 63.3)
    x, y = (m + 4300.0 * np.arange(-n, n + 1) for m, n in zip(middle, (37, 29), strict=True))
    back = "+proj=pipeline +step +inv +proj=stere +lat_0=90 +lat_ts=60 +lon_0=-40 +R=6371000"
    to = pyproj.Transformer.from_pipeline(back + " +step +proj=unitconvert +xy_in=rad +xy_out=deg")
    plane = Plane(x, y, 50 + np.arange(75), 90 - np.arange(59), to)
    box = Box(12.4 + east - 0.5, 63.3 + north - 0.2, 12.4 + east + 0.5, 63.3 + north + 0.2)
    made = layout.crop(plane, box)
    assert isinstance(made, Plane)
    lon, lat = projection(*np.meshgrid(x, y), inverse=True)
    geod = pyproj.Geod(a=6_371_000, b=6_371_000)
    cell = min(
        np.median(geod.inv(lon[:, :-1], lat[:, :-1], lon[:, 1:], lat[:, 1:])[2]),
        np.median(geod.inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2]),
    )
    west, south, high_east, high_north = grown(box, 3 * cell)
    inside = (west <= lon) & (lon <= high_east) & (south <= lat) & (lat <= high_north)
    i, j = np.flatnonzero(inside.any(axis=0)), np.flatnonzero(inside.any(axis=1))
    np.testing.assert_array_equal(made.columns, plane.columns[i[0] : i[-1] + 1])
    np.testing.assert_array_equal(made.rows, plane.rows[j[0] : j[-1] + 1])
    np.testing.assert_array_equal(made.x, x[i[0] : i[-1] + 1])
    np.testing.assert_array_equal(made.y, y[j[0] : j[-1] + 1])


def swirled(lon0: float, lat0: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a curved grid (60, 110) [deg] turned by 0.6 rad about its middle, with cells of about
    0.05 degrees.
    """
    j, i = np.mgrid[-30:30, -55:55] + 0.5
    x, y = 0.052 * i + 4e-5 * j**2, 0.047 * j + 3e-5 * i**2
    lon = lon0 + (np.cos(0.6) * x - np.sin(0.6) * y) / np.cos(np.radians(lat0))
    return (lon + 180) % 360 - 180, lat0 + np.sin(0.6) * x + np.cos(0.6) * y


@pytest.mark.parametrize("lon0", [21.7, 179.8])
@pytest.mark.parametrize(
    ("east", "north"),
    [(0.1, 0.05), (2.2, -0.3), (-1.9, 0.4), (1.6, 1.4), (-4.2, -1.55), (4.3, 1.6)],
)
def test_curved(lon0: float, east: float, north: float) -> None:
    """By shapely: the cells whose extents meet the box and three cells around it, and one more row
    and column on each side.
    """
    lon, lat = swirled(lon0, 57.3)
    columns, rows = 400 - np.arange(110), 3 + np.arange(60)
    curved = Curved(lon, lat, columns, rows, angle=lon + 2 * lat)
    west = lon0 + east - 0.3
    west -= 360 * (west >= 180)
    box = Box(west, 57.3 + north - 0.14, west + 0.6, 57.3 + north + 0.14)
    made = layout.crop(curved, box)
    assert isinstance(made, Curved)
    geod = pyproj.Geod(a=6_371_000, b=6_371_000)
    cell = min(
        np.median(geod.inv(lon[:, :-1], lat[:, :-1], lon[:, 1:], lat[:, 1:])[2]),
        np.median(geod.inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2]),
    )
    wide = shapely.box(*grown(box, 3 * cell))
    x = box.west + (lon - box.west + 180) % 360 - 180
    node = np.stack([x, lat], axis=-1)
    corners = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=2)
    j, i = np.nonzero(
        shapely.intersects(shapely.envelope(shapely.polygons(corners)), wide)
    )  # first row and column of each
    low, high = (
        (max(v.min() - 1, 0) for v in (j, i)),
        (min(v.max() + 2, n - 1) for v, n in ((j, 60), (i, 110))),
    )
    (bottom, left), (top, right) = low, high
    assert right - left < 109
    np.testing.assert_array_equal(made.rows, rows[bottom : top + 1])
    np.testing.assert_array_equal(made.columns, columns[left : right + 1])
    for own, whole in ((made.lon, lon), (made.lat, lat), (made.angle, lon + 2 * lat)):
        np.testing.assert_array_equal(own, whole[bottom : top + 1, left : right + 1])


@pytest.mark.parametrize("at_centres", [False, True], ids=["at nodes", "at centres"])
def test_triangles(at_centres: bool) -> None:
    """By shapely: those whose extents meet the box and three sides around it; their nodes are where
    they were.
    """
    j, i = np.mgrid[0:24, 0:31]
    lon, lat = (-30.7 + 0.06 * i + RNG.uniform(-0.01, 0.01, i.shape)).ravel(), (38.4 + 0.05 * j + RNG.uniform(-0.01, 0.01, j.shape)).ravel()  # fmt: skip
    k = np.arange(24 * 31).reshape(24, 31)
    a, b, c, d = k[:-1, :-1].ravel(), k[:-1, 1:].ravel(), k[1:, 1:].ravel(), k[1:, :-1].ravel()
    cells = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])[
        np.argsort(np.tile(a, 2), kind="stable")
    ]
    middle = (lon[cells].mean(1), lat[cells].mean(1)) if at_centres else (None, None)
    mesh = Triangles(lon, lat, cells, 7, *middle)
    box = Box(-29.97, 38.83, -29.52, 39.11)
    made = layout.crop(mesh, box)
    assert isinstance(made, Triangles)
    geod = pyproj.Geod(a=6_371_000, b=6_371_000)
    sides = [
        geod.inv(lon[cells[:, m]], lat[cells[:, m]], lon[cells[:, n]], lat[cells[:, n]])[2]
        for m, n in ((0, 1), (1, 2), (2, 0))
    ]
    degrees = 3 * np.degrees(np.percentile(sides, 10) / 6_371_000)
    wide = degrees / np.cos(np.radians(box.north))
    around = shapely.box(box.west - wide, box.south - degrees, box.east + wide, box.north + degrees)
    node = np.stack([lon, lat], axis=-1)
    met = np.flatnonzero(
        shapely.intersects(shapely.envelope(shapely.polygons(node[cells])), around)
    )
    places = np.stack([made.lon, made.lat], axis=-1)[made.cells]
    if at_centres:
        np.testing.assert_array_equal(places, node[cells[met[0] : met[-1] + 1]])
        assert made.first == 7 + met[0]
        np.testing.assert_array_equal(made.lonc, middle[0][met[0] : met[-1] + 1])
        np.testing.assert_array_equal(made.latc, middle[1][met[0] : met[-1] + 1])
    else:
        np.testing.assert_array_equal(places, node[cells[met]])
        assert made.first == 7 + cells[met].min()
        assert made.lon.size == np.ptp(cells[met]) + 1


def test_a_box_beside_the_axes_has_their_last_two_columns() -> None:
    """As far as two cells off."""
    axes = Axes(
        np.arange(3.0, 9.0, 0.5),
        np.arange(50.0, 54.0, 0.5),
        np.arange(12),
        np.arange(8),
        round=False,
    )
    for west, expected in ((1.7, [0, 1]), (9.27, [10, 11])):
        made = layout.crop(axes, Box(west, 51.2, west + 0.53, 51.9))
        assert isinstance(made, Axes)
        assert made.columns.tolist() == expected


@pytest.mark.parametrize("seed", range(3))
def test_extents_hold_edges_that_are_great_circles(seed: int) -> None:
    """Of quadrilaterals on both halves of the Earth and about both poles, by points all along their
    edges.

    Along parallels the farther edge bulges as it is told to the last; there and for a pole it is no
    more than that.
    """
    random = np.random.default_rng(seed)
    middle = random.uniform([-180, -89.5], [180, 89.5], (400, 2))
    angle = np.pi / 4 + np.arange(4) * np.pi / 2 + random.uniform(-0.5, 0.5, (400, 4))
    size = random.uniform(0.5, 9, (400, 4))
    geod = pyproj.Geod(a=6_371_000, b=6_371_000)
    lon, lat, _ = geod.fwd(
        *(np.repeat(v, 4) for v in middle.T),
        np.degrees(angle).ravel(),
        np.radians(size).ravel() * 6_371_000,
    )
    lon, lat = np.reshape(lon, (400, 4)), np.reshape(lat, (400, 4))
    wide = random.uniform(1, 80, 100)  # along parallels, in turn from the south-west
    lon[:100] = middle[:100, :1] + np.stack([-wide, wide, wide, -wide], axis=1) / 2
    lat[:100] = (middle[:100, 1:] * 0.9) + np.array([-2.0, -2.0, 2.0, 2.0])
    west, width, south, north = layout.extents(lon, lat)
    place = np.stack([np.cos(np.radians(lat)) * np.cos(np.radians(lon)), np.cos(np.radians(lat)) * np.sin(np.radians(lon)), np.sin(np.radians(lat))], -1)  # fmt: skip
    share = np.linspace(0, 1, 201)[:, None]
    edge = (1 - share) * place[:, :, None] + share * np.roll(place, -1, axis=1)[
        :, :, None
    ]  # (cells, edges, points, 3), on chords
    edge = edge.reshape(400, -1, 3)
    y = np.degrees(np.arctan2(edge[..., 2], np.hypot(edge[..., 0], edge[..., 1])))
    x = np.degrees(np.unwrap(np.arctan2(edge[..., 1], edge[..., 0]), axis=1))
    assert (y >= south[:, None] - 1e-9).all()
    assert (y <= north[:, None] + 1e-9).all()
    polar = np.abs(x[:, -1] - x[:, 0]) > 180  # once round
    np.testing.assert_array_equal(width == 360, polar)
    assert 3 < polar.sum() < 100
    assert (np.maximum(np.abs(south), np.abs(north))[polar] == 90).all()
    off = (x - west[:, None] + 1e-9) % 360
    assert (off[~polar] <= width[~polar, None] + 2e-9).all()
    np.testing.assert_allclose(width[:100], wide, atol=1e-9)
    np.testing.assert_allclose(north[:100], y[:100].max(axis=1), atol=1e-6)
    np.testing.assert_allclose(south[:100], y[:100].min(axis=1), atol=1e-6)


def test_of_columns_that_are_needed_here_and_there_the_widest_gaps_are_left_out() -> None:
    """Of a grid of 300 columns round the Earth: gaps of 61, 54, 41, 27, 18 and 9 between what is
    needed, and one column on each side.
    """
    needed = np.zeros(300, bool)
    gaps, place = [61, 27, 9, 54, 18, 41], 20
    for gap in gaps:
        needed[[place, (place + 14) % 300]] = True
        needed[place : place + 15] = True
        place += 15 + gap
    assert place == 320  # once round
    taken = layout._pieces(needed, around=True)
    left_out = set(range(300)) - set(taken.tolist())
    begin = np.cumsum([20] + [15 + gap for gap in gaps])[:-1] + 15
    expected = {
        (b + k) % 300
        for b, gap in zip(begin, gaps, strict=True)
        if gap > 30
        for k in range(1, gap - 1)
    }
    assert left_out == expected
    assert taken[0] == (begin[0] + 60) % 300  # after the widest
    assert (np.diff(taken) % 300 >= 1).all()
    assert ((taken - taken[0]) % 300).tolist() == sorted(((taken - taken[0]) % 300).tolist())


def test_of_a_grid_that_does_not_go_round_its_ends_are_no_neighbours() -> None:
    needed = np.zeros(100, bool)
    needed[[0, 1, 2]] = True
    assert sorted(layout._pieces(needed, around=False).tolist()) == [0, 1, 2, 3]
    assert sorted(layout._pieces(needed, around=True).tolist()) == [0, 1, 2, 3, 99]


@pytest.mark.parametrize(
    ("share", "even"), [(0.0, True), (0.004, True), (0.009, True), (0.013, False), (0.3, False)]
)
def test_an_axis_that_jitters_by_a_hundredth_of_a_cell_is_even(share: float, even: bool) -> None:
    axis = -31.7 + 0.17 * np.arange(40)
    for k in (7, 31):
        off = axis.copy()
        off[k] += share * 0.17 * (-1) ** k
        assert layout.uniform(off) == even


@pytest.mark.parametrize(("gap", "filled"), [(17, True), (18, False)])
def test_gaps_of_fewer_than_sixteen_columns_are_filled(gap: int, filled: bool) -> None:
    """One column on each side of what is needed is taken anyway."""
    needed = np.zeros(100, bool)
    needed[:10] = needed[10 + gap : 80] = True
    left_out = set(range(100)) - set(layout._pieces(needed, around=True).tolist())
    assert left_out == set(range(81, 99)) | (set() if filled else set(range(11, 9 + gap)))
