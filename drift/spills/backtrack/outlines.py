"""Outlines of the release place over all times: the smallest areas of given shares, as contours."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import contourpy
import numpy as np
import shapely

from drift.forecast import areas, density
from drift.products.files import geojson
from drift.products.maps.marks import Mark
from drift.spills.backtrack import backward
from drift.spills.backtrack.backward import Origin
from geo import notation
from geo.array import Array
from geo.notation import NMI

# lowest density for contouring, as a share of a line's density: keeps lines near the cells
FLOOR = float(np.exp(-4.0))
SHARES = (0.5, 0.9)


@dataclass(frozen=True)
class Outlines:
    """The release place over all times, by cell, and its areas by share."""

    density: Array  # [% per nmi2], (nlat, nlon)
    containment: Array  # share of the smallest area that holds the cell, (nlat, nlon)
    areas: dict[float, tuple[shapely.MultiPolygon, float]]  # outline [deg] and size [nmi2] by share


def release_outlines(origin: Origin, shares: Sequence[float] = SHARES) -> Outlines:
    """Return the smallest areas of the release place that hold the shares."""
    mass, area = origin.probability.sum(axis=0), backward.cell_area(origin)
    per_nmi2 = 100 * mass / (area[:, None] / NMI**2)
    containment, levels, sizes, _ = areas.containment(
        mass, area, density.Calibration(density.KNOTS)
    )
    found = {}
    for share in shares:
        inside = cells_of_share(containment, share)
        last_in, first_out = (
            float(per_nmi2[inside].min()),
            float(per_nmi2.max(where=~inside, initial=0.0)),
        )
        level = float(np.sqrt(last_in * max(first_out, last_in * FLOOR)))
        found[share] = (
            density_outline(origin, per_nmi2, level),
            float(np.interp(share, levels, sizes)) / NMI**2,
        )
    return Outlines(per_nmi2, containment, found)


def cells_of_share(containment: Array, share: float) -> Array:
    """Return the cells in the area of a share, at least one, bool (nlat, nlon)."""
    return np.asarray(containment <= max(share, float(containment.min())))


def density_outline(origin: Origin, values: Array, level: float) -> shapely.MultiPolygon:
    """Return where a density exceeds a level [deg]; its log is linear between cell centres."""
    floor = level * FLOOR
    field = np.pad(np.log(np.maximum(values, floor)), 1, constant_values=np.log(floor))
    lon, lat = (
        np.concatenate([[2 * edge[0] - axis[0]], axis, [2 * edge[-1] - axis[-1]]])
        for axis, edge in ((axis, backward.cell_edges(axis)) for axis in (origin.lon, origin.lat))
    )
    contours: Any = contourpy.contour_generator(
        lon, lat, field, fill_type=contourpy.FillType.OuterOffset
    )
    polygons = [
        [points[a:b] for a, b in itertools.pairwise(offsets)]
        for points, offsets in zip(*contours.filled(np.log(level), np.inf), strict=True)
    ]
    return shapely.MultiPolygon([shapely.Polygon(outer, holes) for outer, *holes in polygons])


def origin_geojson(
    origin: Origin, finds: Sequence[Mark], attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Return areas, mean and finds as a GeoJSON FeatureCollection, cut at the antimeridian.

    finds: marks whose labels begin with their numbers. Every feature has a kind: area, mean or
    find.
    """
    features = []
    for share, (shape, size) in release_outlines(origin).areas.items():
        properties = {
            "kind": "area",
            "level": share,
            "area_nmi2": float(f"{size:.6g}"),
            "area_km2": float(f"{size * NMI**2 / 1e6:.6g}"),
        }
        features.append(geojson.feature(geojson.polygons(shape), properties))
    lon, lat, seconds = origin.mean
    when = notation.iso(np.datetime64(round(seconds), "s"))
    features.append(geojson.feature(geojson.point(lon, lat), {"kind": "mean", "time": when}))
    for find in finds:
        number, _, name = find.label.partition(" ")
        features.append(
            geojson.feature(
                geojson.point(find.lon, find.lat), {"kind": "find", "number": number, "name": name}
            )
        )
    return geojson.collection(features, attributes)
