"""Land masses of polygons drawn by hand."""

import numpy as np
import pytest
import shapely

from geo import sphere
from geo.box import Box
from geo.coast import edges, land_masses, segments
from geo.coast.land_masses import SEVERAL
from geo.coast.shore import Shore
from geo.errors import UserError

# A mainland whose arms enclose a gulf, and an island in it.
MAINLAND = shapely.Polygon([(0, 0), (3, 0), (3, 1), (2, 1), (2, 0.5), (1, 0.5), (1, 1), (0, 1)])
ISLAND = shapely.box(1.4, 0.8, 1.6, 0.9)


def test_each_place_is_on_its_land_or_the_nearest():
    land = land_masses.build_land_masses(np.array([MAINLAND, ISLAND], object))
    found = land_masses.mass_of_places(
        land, np.array([0.5, 1.5, 1.5, 361.5]), np.array([0.7, 0.85, 0.79, 0.91])
    )
    assert found.tolist() == [land.mass[0], land.mass[1], land.mass[1], land.mass[1]]
    assert land_masses.nearest_land(land, 0.5, 0.7) == (0, 0.5, 0.7, 0.0)
    polygon, lon, lat, away = land_masses.nearest_land(land, 1.5, 0.95)
    assert (polygon, lon, lat) == (1, 1.5, 0.9)
    assert away == pytest.approx(0.05 * np.pi / 180 * sphere.RADIUS, rel=1e-9)


def test_what_is_one_beyond_the_box_is_one():
    """The box holds the two arms, not what joins them; the island stays by itself."""
    box = Box(-0.5, 0.6, 3.5, 1.2)
    pieces = shapely.get_parts(
        shapely.intersection(MAINLAND, shapely.box(box.west, box.south, box.east, box.north))
    )
    land = land_masses.build_land_masses(np.array([*pieces, ISLAND], object), box=box)
    assert len(set(land.mass.tolist())) == 3
    assert land_masses.masses_at_edge(land) == frozenset(land.mass[:2].tolist())
    joined = land_masses.of_whole(land, lambda: np.array([MAINLAND, ISLAND], object))
    assert joined.mass[0] == joined.mass[1] != joined.mass[2]


@pytest.mark.parametrize("turn", [0.0, 360.0])
def test_what_a_source_cuts_at_the_antimeridian_is_one(turn):
    """Halves of a mainland that meet at 180 degrees beyond the box; a file may count its longitudes
    from 0 to 360.
    """
    west, east = shapely.box(178, 0, 180, 1), shapely.box(-180 + turn, 0, -178 + turn, 1)
    pieces = np.array([shapely.box(178, 0, 179, 0.5), shapely.box(181, 0, 182, 0.5)], object)
    land = land_masses.build_land_masses(pieces, box=Box(178.0, 0.0, -178.0 + 360, 0.5))
    joined = land_masses.of_whole(land, lambda: np.array([west, east], object))
    assert (joined.mass[0] == joined.mass[1]) == (turn == 0.0)


def test_the_whole_source_is_not_asked_for_islands():
    def never():
        raise AssertionError

    land = land_masses.build_land_masses(
        np.array([MAINLAND, ISLAND], object), box=Box(-1.0, -1.0, 4.0, 2.0)
    )
    assert land_masses.of_whole(land, never) is land


def test_stretches_are_on_one_land_mass_or_several():
    box = Box(-0.5, -0.5, 3.5, 1.4)
    islets = [shapely.box(1.2 + x, 0.62, 1.203 + x, 0.623) for x in (0.0, 0.01, 0.02)]
    coast = edges.build_coast(Shore(np.array([MAINLAND, ISLAND, *islets], object), "test"), box)
    land = land_masses.build_land_masses(coast.polygons)
    cut = segments.cut_coast(coast, 20_000)
    mass = land_masses.mass_of_stretches(land, coast, cut.of_edge, len(cut.name))
    for line, number in zip(cut.lines, mass, strict=True):
        touched = {
            int(land.mass[k])
            for k, shape in enumerate(coast.polygons)
            if shapely.dwithin(shape, line, 1e-6)
        }
        assert {int(number)} == (touched if len(touched) == 1 else {SEVERAL})
    assert (mass == SEVERAL).sum() == 1


def test_a_bridge_that_ends_at_sea_is_told_with_the_nearest_land():
    polygons = np.array([MAINLAND, ISLAND], object)
    assert (
        len(set(land_masses.build_land_masses(polygons, [((1.5, 0.5), (1.5, 0.8))]).mass.tolist()))
        == 1
    )
    with pytest.raises(
        UserError, match=r"spill.bridges, number 1: its end at .* 11.1 km from the nearest land, at"
    ):
        land_masses.build_land_masses(polygons, [((1.5, 0.5), (1.5, 1.0))])
