"""Shapes across the antimeridian: cut there, for formats whose longitudes end at 180 degrees."""

from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

Array = npt.NDArray[Any]


def cut(polygon: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """Return polygons of unwrapped longitudes cut at the antimeridian.

    The parts lie in [-180, 180] [deg], with outer rings anticlockwise.
    """
    parts: list[Any] = []
    for turn in (-360, 0, 360):
        inside = shapely.intersection(polygon, shapely.box(turn - 180, -90, turn + 180, 90))
        moved = shapely.set_precision(shapely.transform(inside, lambda xy, turn=turn: _moved(xy, turn)), 1e-7)
        parts += [p for p in shapely.get_parts(moved) if p.geom_type == "Polygon" and p.area > 0]
    return shapely.MultiPolygon([shapely.geometry.polygon.orient(part) for part in parts])


def _moved(xy: Array, turn: int) -> Array:
    return np.asarray(xy - np.array([turn, 0.0]))
