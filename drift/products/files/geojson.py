"""GeoJSON (RFC 7946) of shapes with unwrapped longitudes [deg], split at the antimeridian."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import shapely

from geo import antimeridian, sphere
from geo.array import Array

DIGITS = 7  # decimals of a degree: 1 cm


def polygons(shape: shapely.MultiPolygon) -> dict[str, Any]:
    """Return polygons [deg] as a MultiPolygon, with outer rings anticlockwise.

    Its coordinates are empty if nothing remains.
    """
    coordinates = [
        _rounded([part.exterior, *part.interiors])
        for part in antimeridian.cut_polygons(shape).geoms
    ]
    return {"type": "MultiPolygon", "coordinates": coordinates}


def lines(shapes: Iterable[Any]) -> dict[str, Any]:
    """Return lines (Shapely, [deg]) as a MultiLineString; each step takes the shorter way round."""
    parts = [_unwrapped(part) for shape in shapes for part in shapely.get_parts(shape)]
    return {"type": "MultiLineString", "coordinates": _rounded(antimeridian.cut_lines(parts))}


def point(lon: float, lat: float) -> dict[str, Any]:
    """Return a position [deg] as a Point."""
    return {
        "type": "Point",
        "coordinates": [round(sphere.wrap_degrees(lon), DIGITS), round(lat, DIGITS)],
    }


def _unwrapped(line: Any) -> Any:
    """Return a line with unwrapped longitudes."""
    west, _, east, _ = line.bounds
    if east - west <= 180:  # no step can be longer
        return line
    return shapely.transform(
        line, lambda xy: np.column_stack([np.unwrap(xy[:, 0], period=360), xy[:, 1]])
    )


def _rounded(lines: Sequence[Any] | Array) -> list[list[list[float]]]:
    """Return the rounded coordinates of lines or rings."""
    points = np.round(shapely.get_coordinates(lines), DIGITS).tolist()
    ends = np.cumsum(shapely.get_num_coordinates(lines)).tolist()
    return [points[begin:end] for begin, end in itertools.pairwise([0, *ends])]


def feature(
    geometry: Mapping[str, Any], properties: Mapping[str, Any], **members: Any
) -> dict[str, Any]:
    """Return a feature; members: further members, such as its id."""
    return {"type": "Feature", **members, "geometry": geometry, "properties": properties}


def collection(features: Sequence[Any], attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return features as a FeatureCollection; the run's attributes come first, sorted by name."""
    return {
        "type": "FeatureCollection",
        **{k: attributes[k] for k in sorted(attributes)},
        "features": features,
    }
