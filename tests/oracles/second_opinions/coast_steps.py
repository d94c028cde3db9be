"""Steps beside a coast, and what shapely says of them."""

import numpy as np
import shapely

from geo import sphere
from geo.coast import edges
from geo.coast.shore import Shore
from kernels.step import coast as crossing

UNITS = sphere.TURN / 360.0  # binary angle units in a degree
METRE = 1 / (sphere.RADIUS * sphere.UNIT)  # [unit] northward


def on_lattice(polygons):
    """Return polygons [deg] as one multipolygon of lattice units; whole numbers, so shapely's
    predicates are exact.
    """
    return shapely.transform(shapely.multipolygons(polygons), lambda x: np.rint(x * UNITS))


def segments(lon, lat, dlon, dlat):
    ends = np.stack([lon, lat, lon + dlon, lat + dlat], axis=1).astype(np.float64)
    return shapely.linestrings(ends.reshape(-1, 2, 2))


def steps_within(box, rng, n, length):
    """Return n random steps [unit] of a length [m] that stay in a box, as int64."""
    lon, lat = (
        rng.uniform(box.west, box.east, n) * UNITS,
        rng.uniform(box.south, box.north, n) * UNITS,
    )
    course = rng.uniform(0, 2 * np.pi, n)
    stretch = 1 / np.cos(lat / UNITS * np.pi / 180)
    dlon, dlat = length * METRE * np.sin(course) * stretch, length * METRE * np.cos(course)
    inside = (lon + dlon > box.west * UNITS) & (lon + dlon < box.east * UNITS)
    inside &= (lat + dlat > box.south * UNITS) & (lat + dlat < box.north * UNITS)
    return [np.rint(a[inside]).astype(np.int64) for a in (lon, lat, dlon, dlat)]


def square(west, south, east, north):
    return shapely.box(west, south, east, north)


def coast_of(polygons, box, **options):
    built = edges.build_coast(Shore(np.array(polygons, object), "test"), box, **options)
    return built, crossing.upload(built)
