"""Cut shapes at the antimeridian, for formats whose longitudes end at 180 degrees.

Our shapes have unwrapped longitudes, which define how they run. The library `antimeridian` (0.4.9)
infers that from jumps of more than 180 degrees: it returns invalid polygons for shapes that touch
the line from the east, rejects a hole across it, and does not cut unwrapped lines.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from geo.array import Array

TURNS = (-720, -360, 0, 360, 720)  # [deg] shifts that unwrapped longitudes may need


def cut_polygons(polygon: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """Return polygons with unwrapped longitudes, cut at the antimeridian.

    The parts lie in [-180, 180] [deg], with outer rings anticlockwise.
    """
    parts = [
        part
        for part in _split_at_antimeridian([polygon], 1e-7)
        if part.geom_type == "Polygon" and part.area > 0
    ]
    return shapely.MultiPolygon([shapely.geometry.polygon.orient(part) for part in parts])


def cut_lines(lines: Sequence[Any]) -> Array:
    """Return the parts of lines with unwrapped longitudes, cut at the antimeridian, in degrees."""
    parts = _split_at_antimeridian(lines)
    is_line = shapely.get_type_id(parts) == shapely.GeometryType.LINESTRING
    return np.asarray(parts[is_line & ~shapely.is_empty(parts)])


def _split_at_antimeridian(shapes: Sequence[Any], precision: float = 0.0) -> Array:
    """Return the parts of shapes between two antimeridians, shifted to [-180, 180].

    precision [deg]: grid size to which corners are rounded; 0 for none.
    """
    every = np.array(shapes, dtype=object)
    west, _, east, _ = shapely.bounds(every).reshape(-1, 4).T
    found, owners = [np.array([], dtype=object)], [np.array([], dtype=int)]
    for turn in TURNS:
        meets = np.flatnonzero((east >= turn - 180) & (west <= turn + 180))
        inside = shapely.intersection(every[meets], shapely.box(turn - 180, -90, turn + 180, 90))
        moved = shapely.transform(inside, lambda xy, turn=turn: xy - np.array([turn, 0.0]))
        rounded = shapely.set_precision(moved, precision) if precision else moved
        parts, owner = shapely.get_parts(rounded, return_index=True)
        found.append(parts)
        owners.append(meets[owner])
    return np.concatenate(found)[np.argsort(np.concatenate(owners), kind="stable")]
