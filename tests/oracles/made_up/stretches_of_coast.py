"""Coasts of rectangles and islands, and checks of their segments."""

import json

import numpy as np
import pyproj
import shapely

from geo import sphere
from geo.box import Box
from geo.coast import edges
from geo.coast.shore import Shore

EARTH = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS)
DEGREE = np.pi * sphere.RADIUS / 180  # [m] of latitude
# [m] a kilometre of float64 great circles by two formulas: 1e-9 of the radius in the worst case
ATOL = 1e-3
FIJI = Box(178, -18, 182, -15)


def rectangle(west, south, east, north, step):
    """Return a rectangle with a vertex every `step` [deg]."""
    return shapely.segmentize(shapely.box(west, south, east, north), step)


def coast_of(polygons, box):
    return edges.build_coast(Shore(np.array(polygons, object), "test"), box)


ISLAND = rectangle(10.0, -0.15, 10.4, 0.1, 0.0099)  # an edge is at most 1.1 km long
AROUND = Box(9.5, -0.6, 11.0, 0.5)


def edge_lengths(built):
    edge = sphere.to_degrees(edges.shoreline_edges(built))
    return EARTH.inv(edge[:, 0], edge[:, 1], edge[:, 2], edge[:, 3])[2]


def geojson(path, *features):
    """Write features (geometry, properties) as a collection."""
    rows = [
        {
            "type": "Feature",
            "properties": words,
            "geometry": json.loads(shapely.to_geojson(shape)) if shape else None,
        }
        for shape, words in features
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": rows}))
    return path


def check(built, cut):
    """Hold what is true of any segments: every edge in one, lengths, lines, midpoints."""
    size, number = edge_lengths(built), len(cut.name)
    assert cut.of_edge.shape == size.shape
    assert cut.of_edge.dtype == np.int32
    np.testing.assert_array_equal(np.unique(cut.of_edge), np.arange(number))
    np.testing.assert_allclose(cut.length, np.bincount(cut.of_edge, size), atol=ATOL)
    np.testing.assert_allclose(cut.length.sum(), size.sum(), rtol=1e-9)
    np.testing.assert_allclose(
        [EARTH.geometry_length(line) for line in cut.lines], cut.length, rtol=1e-9, atol=ATOL
    )
    assert len(set(cut.name)) == len(cut.access) == number
    assert (np.abs(cut.lon) <= 180).all()
    # Midpoints lie on their own lines: 1e-9 degrees are a tenth of a millimetre.
    east = np.array([line.bounds[0] for line in cut.lines]) - 1e-6
    places = shapely.points(east + (cut.lon - east) % 360, cut.lat)
    assert shapely.distance(cut.lines, places).max(initial=0) < 1e-9
