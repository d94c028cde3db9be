"""GeoJSON (RFC 7946) of shapes with unwrapped longitudes [deg], split at the antimeridian."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import shapely

from geo import antimeridian, sphere

DIGITS = 7  # decimals of a degree: 1 cm


def polygons(shape: shapely.MultiPolygon) -> dict[str, Any]:
    """Return polygons [deg] as a MultiPolygon, with outer rings anticlockwise.

    Its coordinates are empty if nothing remains.
    """
    coordinates = [
        [_rounded(ring) for ring in (part.exterior, *part.interiors)]
        for part in antimeridian.cut_polygons(shape).geoms
    ]
    return {"type": "MultiPolygon", "coordinates": coordinates}


def lines(shapes: Iterable[Any]) -> dict[str, Any]:
    """Return lines (Shapely, [deg]) as a MultiLineString; each step takes the shorter way round."""
    parts = [_unwrapped(part) for shape in shapes for part in shapely.get_parts(shape)]
    pieces = [piece for part in parts for piece in antimeridian.cut_line(part)]
    return {"type": "MultiLineString", "coordinates": [_rounded(piece) for piece in pieces]}


def point(lon: float, lat: float) -> dict[str, Any]:
    """Return a position [deg] as a Point."""
    return {
        "type": "Point",
        "coordinates": [round(sphere.wrap_degrees(lon), DIGITS), round(lat, DIGITS)],
    }


def _unwrapped(line: Any) -> Any:
    """Return a line with unwrapped longitudes."""
    return shapely.transform(
        line, lambda xy: np.column_stack([np.unwrap(xy[:, 0], period=360), xy[:, 1]])
    )


def _rounded(line: Any) -> list[list[float]]:
    coordinates: list[list[float]] = np.round(line.coords, DIGITS).tolist()
    return coordinates


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
