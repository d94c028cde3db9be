"""Shores in the plane about a place, in metres, and their edges as kernels hold them."""

import numpy as np
import shapely

from geo import sphere
from geo.box import Box
from geo.coast import edges as shoreline
from geo.coast.shore import Shore

EPS = 2.0**-24
LAT = 47.3
METRE = sphere.RADIUS * sphere.UNIT  # [m] of a binary angle unit northward
COS = float(np.cos(np.radians(LAT)))
ANGLE = np.radians(24.0)  # of a straight shore, clockwise from north; land lies east of it
REACH = 3000.0


def built(*polygons: shapely.Polygon) -> shoreline.Coast:
    """Return a coast about (0, LAT); polygons in metres about it."""
    degrees = [
        shapely.transform(
            p, lambda x: x / METRE * 360 / sphere.TURN / np.array([COS, 1.0]) + np.array([0.0, LAT])
        )
        for p in polygons
    ]
    box = Box(-0.4, LAT - 0.3, 0.4, LAT + 0.3)
    return shoreline.build_coast(Shore(np.array(degrees, object), "test", (), box), box)


def binary(east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points [m about (0, LAT)] as binary angles."""
    lat0 = int(sphere.to_binary(LAT))
    return (np.round(east / METRE / COS)).astype(np.int32), (lat0 + np.round(north / METRE)).astype(
        np.int32
    )


def about(coast: shoreline.Coast, lon: int, lat: int) -> np.ndarray:
    """Return all edges [m east and north of a point], in its tangent plane, float64, (m, 2, 2)."""
    edges = shoreline.shoreline_edges(coast).reshape(-1, 2, 2).astype(float) - np.array(
        [lon, lat], float
    )
    return edges * METRE * np.array([np.cos(lat * sphere.UNIT), 1.0])


def wavy(rng: np.random.Generator) -> shapely.Polygon:
    """Land in the east, off a shore in uneven edges of some 300 m."""
    north = np.arange(-9000.0, 9000.0, 300.0) + rng.uniform(-90, 90, 60)
    return shapely.Polygon(
        [
            (15_000, 9500),
            *zip(rng.uniform(-500, 500, 60), north[::-1], strict=True),
            (15_000, -9500),
        ]
    )


def straight() -> shapely.Polygon:
    """Land beyond one long edge through (0, 0), at ANGLE from north."""
    way = 14_000 * np.array([np.sin(ANGLE), np.cos(ANGLE)])
    inland = np.array([20_000.0, 0.0])
    return shapely.Polygon([way, -way, inland - way, inland + way])
