"""The coast at the antimeridian and round the globe: against shapely."""

import numpy as np
import pytest
import shapely
from coast_steps import UNITS, coast_of, on_lattice, segments, square, steps_within

from geo import sphere
from geo.box import Box
from geo.coast import edges, shore
from kernels.runtime import runtime
from kernels.step import coast as crossing


@pytest.fixture(autouse=True)
def _taichi():
    runtime.start()


def test_island_cut_at_the_antimeridian_is_whole(tmp_path):
    """A file whose island is cut at 180, with other vertices on the two sides of the cut, has no
    shore along it.
    """
    west = shapely.Polygon(
        [(179.5, -17.2), (180, -17.1), (180, -16.5), (180, -16.0), (179.6, -16.3)]
    )
    east = shapely.Polygon([(-180, -17.1), (-179.7, -16.9), (-180, -16.0)])
    path = tmp_path / "island.geojson"
    path.write_text(shapely.to_geojson(shapely.MultiPolygon([west, east])))
    box = Box(177, -19, 183, -14)
    land = shore.read_land(path, box)
    assert len(land.polygons) == 1
    built = edges.build_coast(land, box)
    device = crossing.upload(built)
    rng = np.random.default_rng(11)
    lon, lat, dlon, dlat = steps_within(box, rng, 20_000, 30_000)
    whole = on_lattice(land.polygons)
    wrapped = ((lon + 2**31) % 2**32 - 2**31).astype(np.int32)
    inland = shapely.intersects_xy(whole, lon, lat)
    np.testing.assert_array_equal(edges.is_land(built, wrapped, lat), inland)
    np.testing.assert_array_equal(crossing.wet(device, wrapped, lat), ~inland)
    assert edges.is_land(
        built, sphere.to_binary([180.0, -180.0]), sphere.to_binary([-16.4, -16.4])
    ).all()
    lon, lat, dlon, dlat, wrapped = (a[~inland] for a in (lon, lat, dlon, dlat, wrapped))
    found = crossing.crossings(device, wrapped, lat, dlon, dlat)
    np.testing.assert_array_equal(
        found.hit, shapely.intersects(whole, segments(lon, lat, dlon, dlat))
    )
    free = ~found.hit
    # some ended east of 180, as binary angles below zero
    assert (sphere.to_degrees(found.lon[free]) < 0).any()
    assert (sphere.to_degrees(found.lon[free]) > 0).any()


def test_fiji_has_no_shore_along_the_antimeridian():
    box = Box(178, -18, 182, -15)
    built = edges.build_coast(shore.read_land("gshhg", box), box)
    edge = edges.shoreline_edges(built)
    along = (edge[:, 0] == -(2**31)) & (edge[:, 2] == -(2**31))
    assert not along.any()
    # Taveuni, which GSHHG cuts at 180
    inside = sphere.to_binary([180.0, -180.0, 179.999, -179.999])
    assert edges.is_land(built, inside, sphere.to_binary([-16.9] * 4)).all()


def test_globe_closes_at_its_seam():
    """Round the whole Earth: land that is cut at 180 has no shore there, land that ends there has
    one.
    """
    pieces = [square(170, 10, 180, 20), square(-180, 10, -175, 20), square(175, 30, 180, 40)]
    pieces.append(shapely.Polygon([(-180, -90), (180, -90), (180, -78), (-180, -78)]))
    built, device = coast_of(pieces, Box(-180, -90, 180, 90), max_cells=10**6)
    assert built.nx << built.shift == sphere.TURN
    lon, lat = (
        sphere.to_binary([180, -180, 179.9, -179.9, 180, -179.9]),
        sphere.to_binary([15, 15, 15, 15, 35, 35]),
    )
    np.testing.assert_array_equal(
        crossing.wet(device, lon, lat), [False, False, False, False, False, True]
    )
    np.testing.assert_array_equal(
        edges.is_land(built, lon, lat), [True, True, True, True, True, False]
    )
    assert edges.is_land(
        built, sphere.to_binary([-180.0, 0, 123]), sphere.to_binary([-80.0] * 3)
    ).all()

    def go(lon, lat, east, north):
        dlon, dlat = int(east * UNITS), int(north * UNITS)
        return crossing.crossings(
            device, sphere.to_binary([lon]), sphere.to_binary([lat]), [dlon], [dlat]
        )

    assert not go(179, 25, 3, 2).hit[0]
    westward = go(-179, 35, -3, 0.5)
    assert westward.hit[0]
    assert westward.lon[0] == -(2**31) + 1
    assert westward.fraction[0] == pytest.approx(1 / 3, abs=1e-6)
    assert go(-170, 15, -20, 1).fraction[0] == pytest.approx(0.25, abs=1e-6)
    assert go(-178, 5, -4, 10).hit[0]
    assert go(179, -70, 5, -10).fraction[0] == pytest.approx(0.8, abs=1e-6)
    # Near the seam, distances to the coast count round it.
    x = (int(sphere.to_binary(-174.0)) - built.lon0) >> built.shift
    y = (int(sphere.to_binary(15.0)) - built.lat0) >> built.shift
    assert built.cell[y * built.nx + x] & 127 < 20
