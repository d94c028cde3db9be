"""The coast against shapely: crossings, water and islands."""

import numpy as np
import pytest
import shapely
from coast_steps import UNITS, coast_of, on_lattice, segments, square, steps_within

from geo import sphere
from geo.box import Box
from geo.coast import edges, shore
from geo.coast.shore import Shore
from kernels.runtime import runtime
from kernels.step import coast as crossing

NORWAY = Box(2.5, 59.3, 7.5, 63.0)


@pytest.fixture(autouse=True)
def _taichi():
    runtime.start()


@pytest.fixture(scope="module")
def norway():
    """The coast of West Norway, on the device too, and its land on the lattice (in units) as
    shapely sees it.
    """
    runtime.start()
    land = shore.read_land("gshhg", NORWAY)
    built = edges.build_coast(land, NORWAY)
    polygons = on_lattice(land.polygons)
    shapely.prepare(polygons)
    return built, crossing.upload(built), polygons, shapely.boundary(polygons)


@pytest.mark.parametrize("turn", [0, 360])
def test_a_coast_covers_boxes_inside_it_alone(turn):
    """A grid from 176 E over the antimeridian to 178 W; longitudes as they are, or a turn on."""
    ring = shapely.box(178.0, -19.0, 179.0, -17.0)
    coast = edges.build_coast(Shore(np.array([ring]), "made up"), Box(176.0, -20.0, 182.0, -16.0))
    for west, east, inside in (
        (177.0, 181.0, True),
        (176.5, 178.0, True),
        (181.0, 184.5, False),
        (170.0, 177.0, False),
        (174.0, 175.0, False),
    ):
        assert edges.covers(coast, Box(west - turn, -19.0, east - turn, -17.0)) == inside
    assert not edges.covers(coast, Box(177.0, -22.0, 178.0, -17.0))
    assert not edges.covers(coast, Box(177.0, -19.0, 178.0, -14.0))


@pytest.mark.parametrize(
    "length",
    [10, 1000, *(pytest.param(m, marks=pytest.mark.thorough) for m in (100, 5000, 50_000))],
)  # [m]
def test_crossings_agree_with_shapely(norway, length):
    _, device, land, lines = norway
    rng = np.random.default_rng(length)
    lon, lat, dlon, dlat = steps_within(NORWAY, rng, 48_000, length)
    wet = crossing.wet(device, lon, lat)
    n = 20_000 if length < 50_000 else 4_000  # the longest meet many islands each
    lon, lat, dlon, dlat = (a[wet][:n] for a in (lon, lat, dlon, dlat))
    assert lon.size == n
    found = crossing.crossings(device, lon, lat, dlon, dlat)

    way = segments(lon, lat, dlon, dlat)
    shapely.prepare(lines)
    np.testing.assert_array_equal(found.hit, shapely.intersects(lines, way))

    # No hit: the step as it was, bit for bit. Hit: the stop is in water, and the way to it meets no
    # shoreline.
    free = ~found.hit
    assert found.hit.any()
    assert free.any()
    assert (found.lon[free] == (lon + dlon)[free]).all()
    assert (found.lat[free] == (lat + dlat)[free]).all()
    assert (found.fraction[free] == 1).all()
    assert (found.edge_id[free] == -1).all()
    assert not shapely.intersects_xy(land, found.lon, found.lat).any()
    moved = found.hit & ((found.lon != lon) | (found.lat != lat))
    assert not shapely.intersects(
        lines, segments(lon, lat, found.lon - lon, found.lat - lat)[moved]
    ).any()

    # The crossing is shapely's nearest intersection, within 2 units (of 9.3 mm); it lies on the
    # edge that is named.
    which = np.flatnonzero(found.hit)[:1500]
    points, owner = shapely.get_coordinates(
        shapely.intersection(lines, way[which]), return_index=True
    )
    away = np.hypot(points[:, 0] - lon[which][owner], points[:, 1] - lat[which][owner])
    nearest = np.full(which.size, np.inf)
    np.minimum.at(nearest, owner, away)
    reached = found.fraction[which].astype(float) * np.hypot(dlon, dlat)[which]
    assert np.abs(reached - nearest).max() < 2
    edge = edges.shoreline_edges(norway[0])[found.edge_id[which]].reshape(-1, 2, 2).astype(float)
    place = (
        np.stack([lon, lat], 1)[which]
        + found.fraction[which, None].astype(float) * np.stack([dlon, dlat], 1)[which]
    )
    assert shapely.distance(shapely.linestrings(edge), shapely.points(place)).max() < 2

    # The stop is close before the crossing: a unit or two, more only where the step grazes the
    # shore.
    stopped = np.hypot(found.lon - lon, found.lat - lat)[which]
    assert (stopped < nearest).all()
    assert np.percentile(nearest - stopped, 90) < 3


@pytest.mark.thorough
def test_degenerate_steps_agree_with_shapely():
    """Vertices hit, edges grazed and followed, cell borders: everything lies on a coarse lattice of
    2**15 units.
    """
    rng = np.random.default_rng(7)
    step = 2**15
    for _ in range(8):
        corners = rng.integers(0, 24, (12, 2))
        sizes = rng.integers(1, 5, (12, 2))
        blocks = [square(*a, *(a + b)) for a, b in zip(corners, sizes, strict=True)]
        blocks += [shapely.Polygon(rng.integers(0, 24, (3, 2))) for _ in range(6)]
        blocks = [block for block in blocks if block.area > 0]
        # vertices stay on the coarse lattice
        union = shapely.set_precision(shapely.union_all(blocks), 1)
        land = shapely.get_parts(shapely.transform(union, lambda x: x * step / UNITS))
        box = Box(0, 0, 24 * step / UNITS, 24 * step / UNITS)
        _, device = coast_of(land, box)
        exact = on_lattice(land)

        lon, lat, x, y = (rng.integers(0, 25, 4000) * step for _ in range(4))
        wet = ~shapely.intersects_xy(exact, lon, lat)
        np.testing.assert_array_equal(crossing.wet(device, lon, lat), wet)
        lon, lat, dlon, dlat = lon[wet], lat[wet], (x - lon)[wet], (y - lat)[wet]
        found = crossing.crossings(device, lon, lat, dlon, dlat)
        still = (dlon == 0) & (dlat == 0)
        way = segments(lon, lat, dlon, dlat)
        touches = np.where(still, False, shapely.intersects(exact, way))
        np.testing.assert_array_equal(found.hit, touches)
        met = crossing.meets(device, lon, lat, dlon, dlat)
        np.testing.assert_array_equal(np.isfinite(met), touches)
        np.testing.assert_array_equal(met[touches], found.fraction[touches])
        assert not shapely.intersects_xy(exact, found.lon, found.lat).any()
        touch = shapely.distance(shapely.intersection(way, exact), shapely.points(lon, lat))[
            found.hit
        ]
        reached = (found.fraction * np.hypot(dlon, dlat))[found.hit]
        np.testing.assert_allclose(reached, touch, atol=2)
        # Nothing but the start's side of the coast is ever reached.
        moved = (found.lon != lon) | (found.lat != lat)
        assert not shapely.intersects(
            exact, segments(lon, lat, found.lon - lon, found.lat - lat)[moved]
        ).any()


def test_nothing_narrow_is_jumped():
    """A spit 2 units (2 cm) wide and an islet of 3 units stop steps of any length, up to 40
    degrees.
    """
    unit = 1 / UNITS
    spit = square(10, -5, 10 + 2 * unit, 5)
    islet = square(20, 7, 20 + 3 * unit, 7 + 3 * unit)
    _, device = coast_of([spit, islet], Box(0, -20, 45, 20))
    for east in (1, 300, 10**5, 10**7, int(40 * UNITS)):
        start = int(10 * UNITS) - max(east // 3, 1)
        found = crossing.crossings(device, [start], [12_345], [east], [1])
        assert found.hit[0]
        assert found.lon[0] == np.rint(10 * UNITS) - 1
        back = crossing.crossings(device, [int(10 * UNITS) + 3 + east // 3], [12_345], [-east], [0])
        assert back.hit[0]
        assert back.lon[0] == np.rint(10 * UNITS) + 3
    middle = np.rint([20 * UNITS + 1, 7 * UNITS + 1]).astype(int)
    for dx, dy in ((7, 3), (7_000_000, 3_000_000), (-70_000_000, 30_000_000)):
        assert crossing.crossings(
            device, [middle[0] - dx], [middle[1] - dy], [2 * dx], [2 * dy]
        ).hit[0]
        assert not crossing.crossings(
            device, [middle[0] - dx], [middle[1] - dy + 9], [2 * dx], [2 * dy]
        ).hit[0]


def test_open_sea_look_up_hides_no_crossing(norway):
    """Steps about as long as the byte of their cell allows, from its corners, in the worst
    directions.
    """
    built, device, _, lines = norway
    shapely.prepare(lines)
    rng = np.random.default_rng(3)
    away = (built.cell & 127).astype(np.int64)
    cell = rng.choice(np.flatnonzero((away > 0) & (built.cell < edges.LAND)), 100_000)
    size = 1 << built.shift
    lon = built.lon0 + (cell % built.nx) * size + rng.choice([0, size - 1], cell.size)
    lat = built.lat0 + (cell // built.nx) * size + rng.choice([0, size - 1], cell.size)
    reach = (away[cell] - 1) * size + rng.choice([0, 1, size // 2, size], cell.size)
    dlon, dlat = (
        rng.choice([-1, 1], cell.size) * reach,
        np.rint(rng.uniform(-1, 1, cell.size) * reach).astype(int),
    )
    inside = (lon + dlon > built.lon0) & (lon + dlon < built.lon0 + built.nx * size)
    inside &= (lat + dlat > built.lat0) & (lat + dlat < built.lat0 + built.ny * size)
    lon, lat, dlon, dlat = (a[inside] for a in (lon, lat, dlon, dlat))
    expected = shapely.intersects(lines, segments(lon, lat, dlon, dlat))
    assert 0 < expected.sum() < expected.size / 2
    np.testing.assert_array_equal(crossing.crossings(device, lon, lat, dlon, dlat).hit, expected)


def test_water_agrees_with_shapely(norway):
    built, device, land, lines = norway
    rng = np.random.default_rng(5)
    lon, lat, _, _ = steps_within(NORWAY, rng, 100_000, 1)
    inland = shapely.intersects_xy(land, lon, lat)
    assert 0.2 < inland.mean() < 0.8
    np.testing.assert_array_equal(crossing.wet(device, lon, lat), ~inland)
    np.testing.assert_array_equal(edges.is_land(built, lon, lat), inland)

    vertices = rng.permutation(shapely.get_coordinates(lines).astype(np.int64))
    inside = (vertices > np.array([NORWAY.west, NORWAY.south]) * UNITS).all(axis=1)
    inside &= (vertices < np.array([NORWAY.east, NORWAY.north]) * UNITS).all(axis=1)
    vertices = vertices[inside][:20_000]
    assert edges.is_land(built, *vertices.T).all()
    assert not crossing.wet(device, *vertices.T).any()
    beside = vertices + rng.integers(-2, 3, vertices.shape)
    expected = shapely.intersects_xy(land, *beside.T)
    np.testing.assert_array_equal(edges.is_land(built, *beside.T), expected)
    np.testing.assert_array_equal(crossing.wet(device, *beside.T), ~expected)


def test_points_on_edges_are_land():
    triangle = shapely.transform(
        shapely.Polygon([(1, 1), (31, 11), (11, 21)]), lambda x: x * 10_000 / UNITS
    )
    built, device = coast_of([triangle], Box(0, 0, 0.1, 0.1))
    k = np.arange(10_001)
    # every 10,000th part of the first edge lies on the lattice
    lon, lat = 10_000 + 30 * k, 10_000 + 10 * k
    assert edges.is_land(built, lon, lat).all()
    assert not crossing.wet(device, lon, lat).any()
    assert crossing.wet(device, lon, lat - 1).all()
    assert not crossing.wet(device, lon[1:-1], lat[1:-1] + 1).any()


def test_nearest_water_and_coast(norway):
    built, _, _, _ = norway
    lon, lat = 6.30, 60.95  # on the mountains between two fjords
    assert edges.is_land(built, sphere.to_binary(lon), sphere.to_binary(lat))
    x, y, metres = edges.nearest_water(built, lon, lat)
    assert not edges.is_land(built, sphere.to_binary(x), sphere.to_binary(y))
    assert metres == pytest.approx(float(sphere.distance(*np.deg2rad([lon, lat, x, y]))))
    # shapely in a plane that is true to scale here: half a percent over a few km
    squeeze = np.cos(np.deg2rad(lat))
    lines = shapely.transform(
        shapely.boundary(shapely.multipolygons(built.polygons)), lambda p: p * [squeeze, 1]
    )
    expected = (
        np.deg2rad(shapely.distance(lines, shapely.Point(lon * squeeze, lat))) * sphere.RADIUS
    )
    assert edges.nearest_coast(built, lon, lat)[2] == pytest.approx(expected, rel=5e-3)
    assert expected * 0.995 < metres < expected * 1.005 + 120
    assert edges.nearest_water(built, 3.0, 61.0) == (3.0, 61.0, 0.0)


def test_no_coast():
    built, device = coast_of([], Box(-5, 40, 5, 50))
    assert edges.nearest_coast(built, 0, 45) is None
    found = crossing.crossings(device, [0], [45 * 2**23], [2**28], [-(2**27)])
    assert (found.hit[0], found.lon[0], found.lat[0]) == (False, 2**28, 45 * 2**23 - 2**27)
    assert shore.read_land("none", Box(0, 0, 1, 1)).polygons.size == 0
    assert crossing.wet(device, [0], [0]).all()


def test_land_beyond_the_cut_is_refused(norway):
    with pytest.raises(ValueError, match="does not hold"):
        edges.build_coast(shore.read_land("none", Box(0, 0, 2, 2)), Box(0, 0, 5, 2))
