"""Shorelines: coasts without land, the cut of GSHHG at 180 degrees, and bays filled from the sea:
against shapely.
"""

import numpy as np
import oracle
import pytest
import shapely

from geo import sphere
from geo.box import Box
from geo.coast import edges, shore
from geo.grids import fill
from geo.grids.grid import Grid
from kernels.runtime import runtime
from kernels.step import coast as crossing

UNITS = sphere.TURN / 360.0  # binary angle units in a degree
METRE = 1 / (sphere.RADIUS * sphere.UNIT)  # [unit] northward


@pytest.fixture(autouse=True)
def _taichi():
    runtime.start()


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
