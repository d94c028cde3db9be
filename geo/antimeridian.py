"""Cut shapes at the antimeridian, for formats whose longitudes end at 180 degrees.

Our shapes have unwrapped longitudes, which define how they run. The library `antimeridian` (0.4.9)
infers that from jumps of more than 180 degrees: it returns invalid polygons for shapes that touch
the line from the east, rejects a hole across it, and does not cut unwrapped lines.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely

TURNS = (-720, -360, 0, 360, 720)  # [deg] shifts that unwrapped longitudes may need


def cut_polygons(polygon: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """Return polygons with unwrapped longitudes, cut at the antimeridian.

    The parts lie in [-180, 180] [deg], with outer rings anticlockwise.
    """
    parts = [
        part
        for part in _split_at_antimeridian(polygon, 1e-7)
        if part.geom_type == "Polygon" and part.area > 0
    ]
    return shapely.MultiPolygon([shapely.geometry.polygon.orient(part) for part in parts])


def cut_line(line: Any) -> list[Any]:
    """Return the parts of a line with unwrapped longitudes, cut at the antimeridian, in degrees."""
    return [
        part
        for part in _split_at_antimeridian(line)
        if part.geom_type == "LineString" and not part.is_empty
    ]


def _split_at_antimeridian(shape: Any, precision: float = 0.0) -> Iterator[Any]:
    """Yield the parts of a shape between two antimeridians, shifted to [-180, 180].

    precision [deg]: grid size to which corners are rounded; 0 for none.
    """
    west, _, east, _ = shape.bounds
    for turn in TURNS:
        if east < turn - 180 or west > turn + 180:
            continue
        inside = shapely.intersection(shape, shapely.box(turn - 180, -90, turn + 180, 90))
        moved = shapely.transform(inside, lambda xy, turn=turn: xy - np.array([turn, 0.0]))
        yield from shapely.get_parts(
            shapely.set_precision(moved, precision) if precision else moved
        )
