"""Shorelines: lakes, coasts without land, what GSHHG cuts at 180, and bays filled from the sea:
against shapely.
"""

import json

import numpy as np
import oracle
import pytest
import shapely
from places import DATA

from geo import sphere
from geo.box import Box
from geo.coast import edges, gshhg, shore
from geo.errors import UserError
from geo.grids import fill
from geo.grids.grid import Grid
from kernels.runtime import runtime
from kernels.step import coast as crossing

UNITS = sphere.TURN / 360.0  # binary angle units in a degree
METRE = 1 / (sphere.RADIUS * sphere.UNIT)  # [unit] northward
BOX = Box(-1, -1, 5, 4)

HOLED = shapely.Polygon(
    shapely.box(0, 0, 4, 3).exterior,
    [shapely.box(1, 1, 2, 2).exterior, shapely.box(2.5, 0.5, 3, 2.5).exterior],
)
ISLE = shapely.box(1.4, 1.4, 1.6, 1.6)
LAKE = shapely.difference(shapely.box(1, 1, 2, 2), ISLE)  # a lake with an island


@pytest.fixture(autouse=True)
def _taichi():
    runtime.start()


def write(path, *shapes):
    path.write_text(shapely.to_geojson(shapely.GeometryCollection(shapes)))
    return path


def records(*shapes_and_kinds):
    lines = []
    for shape, kind in shapes_and_kinds:
        points = shapely.get_coordinates(shape.exterior)
        lines += [f'"a","{kind}",{len(points)}', *(f"{x!r},{y!r}" for x, y in points.tolist())]
    return "\n".join(lines)


def same_land(land, expected):
    """Whether two sets of polygons cover the same place."""
    return shapely.symmetric_difference(
        shapely.union_all(land.polygons), expected
    ).area == pytest.approx(0, abs=1e-9)


# Lakes


def test_inner_rings_are_land_unless_asked_for(tmp_path):
    path = write(tmp_path / "land.geojson", HOLED, ISLE)
    land = shore.read_land(path, BOX)
    assert same_land(land, shapely.box(0, 0, 4, 3))
    assert any("2 inner rings" in note and "are land" in note for note in land.notes)
    wet = shore.read_land(path, BOX, lakes=True)
    assert same_land(wet, shapely.union(HOLED, ISLE))
    assert any("2 lakes of the shoreline are water" in note for note in wet.notes)
    points = sphere.to_binary([(1.2, 1.2), (1.5, 1.5), (2.7, 1.0), (0.5, 0.5)])
    np.testing.assert_array_equal(
        edges.is_land(edges.build_coast(land, BOX), *points.T), [True, True, True, True]
    )
    np.testing.assert_array_equal(
        edges.is_land(edges.build_coast(wet, BOX), *points.T), [False, True, False, True]
    )


def test_a_sea_between_several_polygons_is_no_lake(tmp_path):
    """Land cut into four tiles round a sea: no polygon has an inner ring, and the sea stays."""
    ring = shapely.difference(shapely.box(0, 0, 4, 3), shapely.box(1, 1, 3, 2))
    halves = (shapely.box(0, 0, 2, 3), shapely.box(2, 0, 4, 3))
    path = write(tmp_path / "tiles.geojson", *(shapely.intersection(ring, half) for half in halves))
    land = shore.read_land(path, BOX)
    assert same_land(land, ring)
    assert not land.notes


@pytest.mark.parametrize("lakes", [False, True])
def test_lakes_of_a_bna_are_water(tmp_path, lakes):
    path = tmp_path / "land.bna"
    path.write_text(records((shapely.box(0, 0, 4, 3), 1), (shapely.box(1, 1, 2, 2), 2)))
    land = shore.read_land(path, BOX, lakes=lakes)
    assert same_land(land, shapely.difference(shapely.box(0, 0, 4, 3), shapely.box(1, 1, 2, 2)))
    assert [note for note in land.notes if "lake" in note] == ["1 lakes of the shoreline are water"]


def test_no_lakes_where_they_were_asked_for_is_said(tmp_path):
    land = shore.read_land(write(tmp_path / "land.geojson", ISLE), BOX, lakes=True)
    assert any("the shoreline holds none" in note for note in land.notes)


def test_a_file_of_lakes_is_cut_out(tmp_path):
    """A lake with an island, one half on the shore, one of another continent: shapely's difference."""
    land = write(tmp_path / "land.geojson", HOLED)
    bay, far = shapely.box(3.5, -0.5, 4.5, 0.5), shapely.box(50, 50, 51, 51)
    lakes = write(tmp_path / "lakes.geojson", LAKE, bay, far)
    cut = shore.read_land(land, BOX, lakes=lakes)
    assert same_land(cut, shapely.difference(shapely.box(0, 0, 4, 3), shapely.union(LAKE, bay)))
    assert any("2 lakes of lakes.geojson" in note for note in cut.notes)
    assert "land.geojson (sha256" in cut.source
    assert "lakes lakes.geojson (sha256" in cut.source
    other = write(tmp_path / "far.geojson", far)
    same = shore.read_land(land, BOX, lakes=other)
    assert same_land(same, shapely.box(0, 0, 4, 3))
    assert any("none of the 1 lakes of far.geojson" in note for note in same.notes)


def test_lakes_are_cut_out_of_gshhg_after_its_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("DRIFT_CACHE", str(tmp_path / "cache"))
    island = shapely.box(0, 0, 4, 3)
    monkeypatch.setattr(gshhg, "_read_package", lambda: np.array([island]))
    lakes = write(tmp_path / "lakes.geojson", LAKE)
    for _ in range(2):
        assert same_land(
            shore.read_land("gshhg", BOX, lakes=lakes), shapely.difference(island, LAKE)
        )
        assert same_land(shore.read_land("gshhg", BOX), island)


def test_a_lake_across_the_antimeridian(tmp_path):
    """Land that leaves 180, lakes cut at 180: water on both sides, and no shore along the cut."""
    land = write(tmp_path / "land.geojson", shapely.box(178, 10, 182, 13))
    lakes = write(
        tmp_path / "lakes.geojson", shapely.box(179, 11, 180, 12), shapely.box(-180, 11, -179.5, 12)
    )
    box = Box(177, 9, 183, 14)
    cut = shore.read_land(land, box, lakes=lakes)
    assert same_land(
        cut, shapely.difference(shapely.box(178, 10, 182, 13), shapely.box(179, 11, 180.5, 12))
    )
    built = edges.build_coast(cut, box)
    lon, lat = sphere.to_binary([179.5, 180, -180, -179.7, -179.3]), sphere.to_binary([11.5] * 5)
    np.testing.assert_array_equal(
        edges.is_land(built, lon, lat), [False, False, False, False, True]
    )
    assert not (edges.shoreline_edges(built)[:, [0, 2]] == -(2**31)).all(axis=1).any()


def test_a_bna_of_lakes(tmp_path):
    """Of a shoreline with its lakes, the lakes; of a file without type 2, all."""
    land = write(tmp_path / "land.geojson", shapely.box(0, 0, 4, 3))
    first, second = shapely.box(1, 1, 2, 2), shapely.box(2.5, 0.5, 3, 2.5)
    lakes = tmp_path / "lakes.bna"
    lakes.write_text(records((second, 1), (first, 2)))
    assert same_land(
        shore.read_land(land, BOX, lakes=lakes), shapely.difference(shapely.box(0, 0, 4, 3), first)
    )
    lakes.write_text(records((second, 1), (first, 1)))
    assert same_land(shore.read_land(land, BOX, lakes=lakes), HOLED)


def test_lakes_that_cross_themselves_or_overlap(tmp_path):
    land = write(tmp_path / "land.geojson", shapely.box(0, 0, 4, 3))
    bow = {"type": "Polygon", "coordinates": [[[1, 1], [2, 2], [2, 1], [1, 2], [1, 1]]]}
    block = json.loads(shapely.to_geojson(shapely.box(1.5, 0.5, 2.5, 1.5)))
    path = tmp_path / "lakes.geojson"
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": [bow, block]}))
    cut = shore.read_land(land, BOX, lakes=path)
    water = [
        shapely.Polygon([(1, 1), (1.5, 1.5), (1, 2)]),
        shapely.Polygon([(2, 2), (1.5, 1.5), (2, 1)]),
    ]
    water.append(shapely.box(1.5, 0.5, 2.5, 1.5))
    assert same_land(cut, shapely.difference(shapely.box(0, 0, 4, 3), shapely.union_all(water)))
    assert any("1 of 2 lakes" in note and "repaired" in note for note in cut.notes)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("gone.geojson", None, "no such file"),
        ("broken.geojson", '{"type": "Poly', "cannot be read"),
        ("line.geojson", '{"type": "LineString", "coordinates": [[0, 0], [1, 1]]}', "no polygon"),
        ("empty.geojson", '{"type": "FeatureCollection", "features": []}', "no polygon"),
        ("text.bna", "hello\n", "line 1"),
        ("metres.bna", '"1","2",3\n500000,6700000\n600000,6700000\n500000,6800000\n', "degrees"),
    ],
)
def test_bad_lakes_are_one_clear_line(tmp_path, name, content, words):
    land, path = write(tmp_path / "land.geojson", HOLED), tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(UserError, match=f"^lakes .*{words}") as error:
        shore.read_land(land, BOX, lakes=path)
    assert "\n" not in str(error.value)
    assert name in str(error.value)


@pytest.mark.parametrize(
    ("source", "lakes", "words"),
    [
        ("gshhg", True, "GSHHG as installed holds no lakes; name a file"),
        ("none", True, "no land"),
        ("none", "x", "no land"),
    ],
)
def test_lakes_that_cannot_be_had(source, lakes, words):
    with pytest.raises(UserError, match=words) as error:
        shore.read_land(source, BOX, lakes=lakes)
    assert "\n" not in str(error.value)


def test_lakes_of_louisiana_on_gshhg():
    """NOAA's lakes, cut out of GSHHG: Maurepas is water, as it is in NOAA's own shoreline."""
    path = DATA / "louisiana" / "LA_shoreline.bna"
    if not path.exists():
        pytest.skip(f"no {path}: set DRIFT_DATA")
    box = Box(-90.9, 30.0, -90.0, 30.5)
    lake = sphere.to_binary([-90.499, 30.257])
    assert edges.is_land(edges.build_coast(shore.read_land("gshhg", box), box), *lake)
    land = shore.read_land("gshhg", box, lakes=path)
    assert not edges.is_land(edges.build_coast(land, box), *lake)
    assert any("lakes of LA_shoreline.bna" in note for note in land.notes)


# No land


def test_a_box_on_the_open_ocean():
    """GSHHG without land in the box: no polygon, no edge, all water, no lake to cut, nothing
    refused.
    """
    box = Box(-140.4, 29.5, -138.2, 31.1)
    land = shore.read_land("gshhg", box)
    assert land.polygons.size == 0
    built = edges.build_coast(land, box)
    assert edges.shoreline_edges(built).shape == (0, 4)
    assert not edges.is_land(
        built, sphere.to_binary([-140.0, -139.0]), sphere.to_binary([30.0, 31.0])
    ).any()
    device = crossing.upload(built)
    found = crossing.crossings(
        device, sphere.to_binary([-140.0]), sphere.to_binary([30.0]), [2**24], [-(2**22)]
    )
    assert not found.hit[0]


def test_lakes_where_no_land_is(tmp_path):
    land = write(tmp_path / "land.geojson", shapely.box(50, 0, 51, 1))
    lakes = write(tmp_path / "lakes.geojson", LAKE)
    assert shore.read_land(land, BOX, lakes=lakes).polygons.size == 0


# GSHHG at 180 degrees, where it cuts its polygons


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("box", "on_land"),
    [
        pytest.param(Box(179, -17.6, 181.1, -15.6), -16.9, id="fiji"),  # Taveuni
        # Chukotka and Wrangel Island
        pytest.param(Box(176, 64, 186, 72.5), 68.5, id="chukotka", marks=pytest.mark.thorough),
    ],
)
def test_coast_at_the_cut(box, on_land):
    """Land and landings against the raw polygons, which end at 180; whole numbers, so predicates
    are exact.
    """
    earth = oracle.earth()
    bounds = shapely.bounds(earth)
    west_part = earth[
        (bounds[:, 2] >= box.west) & (bounds[:, 1] <= box.north) & (bounds[:, 3] >= box.south)
    ]
    east_part = earth[
        (bounds[:, 0] <= box.east - 360) & (bounds[:, 1] <= box.north) & (bounds[:, 3] >= box.south)
    ]
    # Clipped well outside of what is asked, for speed: Eurasia has 10^6 vertices.
    clip = (box.west - 0.5, box.south - 0.5, box.east + 0.5, box.north + 0.5)
    raw = np.concatenate(
        [west_part, shapely.transform(east_part, lambda p: p + np.array([360.0, 0.0]))]
    )
    raw = shapely.get_parts(shapely.clip_by_rect(raw, *clip))
    raw = shapely.transform(raw[~shapely.is_empty(raw)], lambda p: np.rint(p * UNITS))
    at_cut = shapely.bounds(raw)
    # this is where they are cut
    assert ((at_cut[:, 2] == 2**31) | (at_cut[:, 0] == 2**31)).sum() >= 2
    tree = shapely.STRtree(raw)

    built = edges.build_coast(shore.read_land("gshhg", box), box)
    device = crossing.upload(built)
    rng = np.random.default_rng(17)
    n = 20_000
    near = 0.3 * (box.east - box.west)
    lon = np.rint((180 + rng.uniform(-near, near, n)) * UNITS).astype(np.int64)
    lat = np.rint(rng.uniform(box.south + 0.1, box.north - 0.1, n) * UNITS).astype(np.int64)
    lon[:2000] = 2**31  # on the cut itself
    wrapped = ((lon + 2**31) % 2**32 - 2**31).astype(np.int32)
    dry = np.zeros(n, bool)
    dry[tree.query(shapely.points(lon, lat), "intersects")[0]] = True
    assert 0.005 < dry.mean() < 0.95
    assert dry[:2000].any()
    np.testing.assert_array_equal(edges.is_land(built, wrapped, lat), dry)
    np.testing.assert_array_equal(crossing.wet(device, wrapped, lat), ~dry)
    both = sphere.to_binary([180.0, -180.0, 179.99999, -179.99999])
    assert edges.is_land(built, both, sphere.to_binary([on_land] * 4)).all()

    # Steps over the cut: they end on the first raw polygon in their way, within 2 units (of 9.3
    # mm), or nowhere.
    wet = np.flatnonzero(~dry)
    lon, lat, wrapped = lon[wet], lat[wet], wrapped[wet]
    far = rng.uniform(8000, 40_000, wet.size) * METRE / np.cos(np.deg2rad(lat / UNITS))
    dlon = np.rint(np.where(lon < 2**31, far, -far)).astype(np.int64)
    dlat = np.rint(rng.uniform(-15_000, 15_000, wet.size) * METRE).astype(np.int64)
    over = (lon < 2**31) != (lon + dlon < 2**31)
    lon, lat, wrapped, dlon, dlat = (a[over] for a in (lon, lat, wrapped, dlon, dlat))
    assert lon.size > 1000
    found = crossing.crossings(device, wrapped, lat, dlon, dlat)
    ends = np.stack([lon, lat, lon + dlon, lat + dlat], axis=1).astype(float).reshape(-1, 2, 2)
    ways = shapely.linestrings(ends)
    way, land = tree.query(ways, "intersects")
    touch = np.full(lon.size, np.inf)
    reach = shapely.distance(
        shapely.intersection(ways[way], raw[land]), shapely.points(ends[way, 0])
    )
    np.minimum.at(touch, way, reach)
    hit = np.isfinite(touch)
    np.testing.assert_array_equal(found.hit, hit)
    length = np.hypot(dlon, dlat)
    assert np.abs(found.fraction[hit] * length[hit] - touch[hit]).max() < 2
    beyond = hit & ((lon + found.fraction * dlon >= 2**31) != (lon >= 2**31))
    assert beyond.any()  # some pass the cut in water and land on its far side
    assert (~hit).any()

    # The cut is no coast: no edge lies along it, and none but the raw polygons' own meet there.
    edge = edges.shoreline_edges(built)
    assert not (edge[:, [0, 2]] == -(2**31)).all(axis=1).any()


# Bays and channels narrower than the grid


def field(ny, nx, wet):
    values = np.full((ny, nx, 2), np.nan, np.float32)
    rng = np.random.default_rng(4)
    values[wet] = rng.normal(size=(int(wet.sum()), 2))
    return values


def test_far_nodes_take_the_nearest_wet_node():
    """Against all distances: nodes up to 7.5 m from a wet one, with rows 2 m and columns 1 m apart;
    no rings.
    """
    rng = np.random.default_rng(8)
    wet = rng.random((17, 23)) < 0.02
    values = field(17, 23, wet)
    filled = fill.fill(values, 0, reach=7.5, bands=((0, len(values), (2.0, 1.0)),))
    j, i = np.nonzero(wet)
    for row in range(17):
        for column in range(23):
            away = np.hypot(2.0 * (j - row), i - column)
            if away.min() > 7.5:
                assert np.isnan(filled[row, column]).all()
            else:
                nearest = values[j, i][np.isclose(away, away.min())]
                assert (filled[row, column] == nearest).all(axis=1).any()
    np.testing.assert_array_equal(filled[wet], values[wet])
    assert np.isnan(filled).any()
    assert np.isnan(values[~wet]).all()  # the input is not touched


def test_rings_come_first_and_nothing_else_changes():
    wet = np.zeros((12, 15), bool)
    wet[3:5, 2:4] = True
    values = field(12, 15, wet)
    rings = fill.fill(values, 2)
    both = fill.fill(values, 2, reach=6.0)
    known = np.isfinite(rings[..., 0])
    np.testing.assert_array_equal(both[known], rings[known])
    np.testing.assert_array_equal(both[4, 9], values[4, 3])  # six columns from the nearest
    assert np.isnan(both[4, 10]).all()
    np.testing.assert_array_equal(fill.fill(values, 2, reach=0.0), rings)
    full = fill.fill(values, 0, reach=np.inf)
    assert np.isfinite(full).all()


def test_reach_stays_within_the_models_domain():
    """Beyond an open boundary the water is unknown, not filled; a bay of the domain is."""
    wet = np.zeros((9, 11), bool)
    wet[:, 4:7] = True
    within = np.zeros((9, 11), bool)
    within[:, 4:] = True
    values = field(9, 11, wet)
    filled = fill.fill(values, 1, reach=5.0, within=within)
    assert np.isfinite(filled[:, 7:]).all()
    assert np.isfinite(filled[:, 3]).all()  # one ring, as ever
    assert np.isnan(filled[:, :3]).all()


@pytest.mark.parametrize("reach", [4.0, np.inf])
def test_reach_goes_on_across_the_seam(reach):
    """The last column is the first: nodes west of the seam take what lies east of it, as on a grid
    rolled by half.
    """
    wet = np.zeros((6, 20), bool)
    wet[1, 1], wet[4, 11] = True, True
    values = field(6, 20, wet)
    closed = np.concatenate([values, values[:, :1]], axis=1)
    filled = fill.fill(closed, 0, seamless=True, reach=reach)
    np.testing.assert_array_equal(filled[:, 0], filled[:, -1])
    np.testing.assert_array_equal(filled[1, 18], values[1, 1])
    rolled = np.roll(values, 10, axis=1)
    again = fill.fill(
        np.concatenate([rolled, rolled[:, :1]], axis=1), 0, seamless=True, reach=reach
    )
    np.testing.assert_array_equal(np.roll(again[:, :-1], -10, axis=1)[1], filled[1, :-1])


def test_a_mask_that_changes_is_filled_anew():
    """Wetting and drying: the plan of one slice must not serve another."""
    wet = np.zeros((5, 9), bool)
    wet[2, 0] = True
    first = field(5, 9, wet)
    wet[2, 8] = True
    second = field(5, 9, wet)
    assert (fill.fill(first, 0, reach=20.0)[2, 7] == first[2, 0]).all()
    assert (fill.fill(second, 0, reach=20.0)[2, 7] == second[2, 8]).all()
    nothing = np.full((5, 9, 2), np.nan, np.float32)
    assert np.isnan(fill.fill(nothing, 3, reach=20.0)).all()


def test_bands_measure_in_metres_and_do_not_follow_the_crop():
    # 58 to 65 N: bands of 55, 60 and 65 degrees
    whole = fill.bands(Grid(5.0, 58.0, 0.03, 0.01, 7, 701))
    assert [(first, last) for first, last, _ in whole] == [(0, 200), (200, 700), (700, 701)]
    for (_, _, (north, east)), middle in zip(whole, (57.5, 62.5, 67.5), strict=True):
        eastward = sphere.distance(*np.deg2rad([5.0, middle, 5.03, middle]))
        northward = sphere.distance(*np.deg2rad([5.0, middle, 5.0, middle + 0.01]))
        assert (north, east) == (
            pytest.approx(float(northward), rel=1e-6),
            pytest.approx(float(eastward), rel=1e-6),
        )
    part = fill.bands(Grid(5.0, 61.0, 0.03, 0.01, 7, 101))
    assert part == ((0, 101, whole[1][2]),)


def test_a_crop_is_filled_as_the_whole_is():
    """To the bit, at 52 to 66 N: metres of a degree of longitude change by a third from one end to
    the other.
    """
    grid = Grid(3.0, 52.0, 0.08, 0.05, 60, 281)
    wet = np.random.default_rng(3).random((281, 60)) < 0.01
    values = field(281, 60, wet)
    whole = fill.fill(values, 2, reach=30_000.0, bands=fill.bands(grid))
    # rows that 30 km and two rings do not cross: what lies beyond a crop is not known there
    margin = 8
    for low, high in ((0, 130), (90, 200), (150, 281)):
        part = fill.fill(
            values[low:high],
            2,
            reach=30_000.0,
            bands=fill.bands(Grid(3.0, 52.0 + 0.05 * low, 0.08, 0.05, 60, high - low)),
        )
        begin, end = low + margin * (low > 0), high - margin * (high < 281)
        np.testing.assert_array_equal(part[begin - low : end - low], whole[begin:end])
