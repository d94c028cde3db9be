"""Cuts at the antimeridian: what is cut off is moved by whole turns, and nothing is lost."""

import numpy as np
import pytest
import shapely

from geo import antimeridian

# A ring with a hole, unlike in lon and lat, begun at any turn; its hole lies across the line.
OUTER = np.array([(176.3, -21.0), (184.9, -20.2), (183.1, -14.8), (177.0, -16.5)])
HOLE = np.array([(179.1, -19.5), (179.4, -17.9), (181.7, -18.2)])


@pytest.mark.parametrize("turn", [-720, -360, 0, 360])
def test_a_ring_with_a_hole_across_the_line(turn: int) -> None:
    """Areas in degrees are those of the whole: coordinates are kept to 1e-7, along 40 degrees of
    edges.
    """
    turned = np.array([turn, 0])
    whole = shapely.Polygon(OUTER + turned, [HOLE + turned])
    made = antimeridian.cut_polygons(shapely.MultiPolygon([whole]))
    assert made.is_valid
    assert made.area == pytest.approx(whole.area, abs=4e-6)
    west, _, east, _ = made.bounds
    assert (west, east) == (-180, 180)
    assert all(part.exterior.is_ccw for part in made.geoms)
    for lon, lat in [
        (177.5, -19.0),
        (183.0, -17.0),
        (180.2, -18.4),
        (184.9, -14.8),
    ]:  # west, east, in the hole, outside
        place = shapely.Point((lon + 180) % 360 - 180, lat)
        assert made.contains(place) == whole.contains(shapely.Point(lon + turn, lat))


def test_a_line_that_goes_round_is_cut_at_every_crossing() -> None:
    """A line once and a half round: its parts are as long in latitude as the whole, in its order."""
    line = shapely.LineString([(-200.0, -7.0), (80.0, 1.0), (370.0, 4.0)])
    parts = antimeridian.cut_lines([line])
    assert [part.bounds[::2] for part in parts] == [(160, 180), (-180, 180), (-180, 10)]
    rise = [part.coords[-1][1] - part.coords[0][1] for part in parts]
    assert sum(rise) == pytest.approx(11.0)
    assert parts[1].coords[0][1] == pytest.approx(-7 + 8 * 20 / 280)


def test_lines_cut_together_are_those_cut_alone() -> None:
    """In the order of the lines, and of their ways within each; empty ones leave nothing."""
    lines = [
        shapely.LineString([(170.0, 3.0), (200.0, 5.0), (171.0, 8.0)]),
        shapely.LineString(),
        shapely.LineString([(12.0, -3.0), (15.5, -2.0)]),
        shapely.LineString([(-190.0, 1.0), (-165.0, 2.0)]),
    ]
    alone = [part for line in lines for part in antimeridian.cut_lines([line])]
    together = antimeridian.cut_lines(lines)
    assert [part.wkt for part in together] == [part.wkt for part in alone]
    assert len(together) == 3 + 0 + 1 + 2
    assert len(antimeridian.cut_lines([])) == 0
