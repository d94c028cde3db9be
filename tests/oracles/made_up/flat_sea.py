"""A place at sea, and the plane about it by pyproj."""

import numpy as np
import pyproj
import shapely
import shapely.affinity

from geo import sphere

AT = (179.96, -41.2)  # across the antimeridian, south, lon unlike lat


def local(at: tuple[float, float] = AT) -> pyproj.Proj:
    """Return the azimuthal equidistant plane round a place, by pyproj."""
    return pyproj.Proj(proj="aeqd", lon_0=at[0], lat_0=at[1], R=sphere.RADIUS)


def degrees(shape: shapely.Geometry, at: tuple[float, float] = AT) -> shapely.Geometry:
    """Return a shape of that plane [m] in degrees, longitudes running on."""
    plane = local(at)

    def back(points: np.ndarray) -> np.ndarray:
        lon, lat = plane(*points.T, inverse=True)
        return np.column_stack([at[0] + (np.asarray(lon) - at[0] + 180) % 360 - 180, lat])

    return shapely.transform(shapely.segmentize(shape, 500.0), back)
