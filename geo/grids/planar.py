"""Projected coordinates in metres, on meshes and curvilinear grids, converted to lon and lat.

Delft3D FM in UTM and FVCOM with Cartesian coordinates use them. The projection is the one that the
case names, otherwise that of the file: a grid mapping, an EPSG code, a PROJ or WKT text, or FVCOM's
`CoordinateProjection`.
"""

import functools
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyproj
import xarray as xr

from geo.errors import UserError
from geo.grids import naming, projection

NAMED = {"x": re.compile(r"(^|_)xc?c?(_|$)", re.I), "y": re.compile(r"(^|_)yc?c?(_|$)", re.I)}
KILO = re.compile(r"^k(m|ilo)", re.I)


def pairs(data: xr.Dataset, chosen: Mapping[str, Any] | None = None) -> list[tuple[str, str]]:
    """Return the pairs of variables that are x and y in a plane, over the same dimensions.

    chosen: the case's choice of coordinates, by key; its x and y come first.
    """
    found = []
    own = chosen or {}
    if own.get("x") in data.variables and own.get("y") in data.variables:
        found.append((str(own["x"]), str(own["y"])))
    for topology in data.variables.values():
        for key, listed in topology.attrs.items():
            if (
                str(key).endswith("_coordinates")
                and str(topology.attrs.get("cf_role", "")) == "mesh_topology"
            ):
                found += _pair_up(
                    [name for name in str(listed).split() if name in data.variables], data
                )
    over: dict[tuple[Any, ...], list[str]] = {}
    for name, variable in data.variables.items():
        if (
            1 <= variable.ndim <= 2
            and np.issubdtype(variable.dtype, np.number)
            and variable.dims != (name,)
        ):
            over.setdefault(variable.dims, []).append(str(name))
    for names in over.values():
        found += _pair_up(names, data)
    return list(dict.fromkeys(found))


def _pair_up(names: list[str], data: xr.Dataset) -> list[tuple[str, str]]:
    sides = [[name for name in names if _axis_of(data, name) == axis] for axis in ("x", "y")]
    alone = len(sides[0]) == 1 and len(sides[1]) == 1
    return (
        [(sides[0][0], sides[1][0])]
        if alone and data[sides[0][0]].dims == data[sides[1][0]].dims
        else []
    )


def _axis_of(data: xr.Dataset, name: str) -> str | None:
    """Return the axis in a plane, "x" or "y", that a variable holds; None for others."""
    attributes = data[name].attrs
    units, standard = (str(attributes.get(key, "")).strip() for key in ("units", "standard_name"))
    for axis, pattern in NAMED.items():
        if standard == f"projection_{axis}_coordinate":
            return axis
        flat = naming.LENGTH_UNITS.match(units) or (not units and _cartesian(data))
        if not standard and flat and pattern.search(name):
            return axis
    return None


def _cartesian(data: xr.Dataset) -> bool:
    return str(data.attrs.get("CoordinateSystem", "")).strip().lower() == "cartesian"


def transformer(
    data: xr.Dataset, name: str, chosen: Mapping[str, Any], notes: list[str]
) -> pyproj.Transformer | None:
    """Return the transformer from a variable's plane to lon and lat; None if unknown."""
    crs = projection.crs_of(data, name, chosen, notes) or projection.of_attributes(data.attrs)
    if crs is None or not crs.is_projected:
        return None
    return _transformer(crs.to_wkt())


@functools.lru_cache(8)
def _transformer(wkt: str) -> pyproj.Transformer:
    """Return one object per projection, so that the layouts of both components compare as equal."""
    crs = pyproj.CRS.from_wkt(wkt)
    return pyproj.Transformer.from_crs(crs, crs.geodetic_crs or "EPSG:4326", always_xy=True)


def unprojected(
    data: xr.Dataset, name: str, dims: tuple[str, ...], chosen: Mapping[str, Any], notes: list[str]
) -> tuple[xr.Dataset, pyproj.Transformer] | None:
    """Return a dataset whose projected coordinates are replaced by lon and lat.

    Args:
        data: the file's dataset.
        name: of the variable.
        dims: its horizontal dimensions.
        chosen: the case's choice of coordinates, by key.
        notes: list to which a note is appended.

    Returns:
        The dataset and the transformer used; None if there are no projected coordinates.

    Raises:
        UserError: the projection is unknown.
    """
    found = [pair for pair in pairs(data, chosen) if data[pair[0]].ndim == len(dims)]
    if not found:
        return None
    x_name, y_name = next((p for p in found if set(data[p[0]].dims) <= set(dims)), found[0])
    to_degrees = transformer(data, name, chosen, notes)
    if to_degrees is None:
        reason = (
            f'variables.crs = "{chosen["crs"]}" is no projection'
            if chosen.get("crs")
            else "their projection is unknown"
        )
        raise UserError(
            f'"{x_name}" and "{y_name}" are lengths in a plane, and {reason}; set variables = {{ crs = "EPSG:32631", axes = '
            '"grid" } with the EPSG code of their projection (this one is UTM zone 31 north), and axes = "true" where '
            "components are east and north instead of along the plane's axes"
        )
    new = {}
    for pair in found:
        x, y = (_to_metres(data, other) for other in pair)
        degrees = to_degrees.transform(x, y)
        for other, values, kind in zip(pair, degrees, ("longitude", "latitude"), strict=True):
            values = np.where(np.isfinite(values), values, np.nan)
            units = "degrees_east" if kind == "longitude" else "degrees_north"
            new[other] = (data[other].dims, values, {"units": units, "standard_name": kind})
    crs = to_degrees.source_crs
    crs_name = crs.name if crs is not None else "a projection"
    notes.append(f'"{x_name}" and "{y_name}" lie in the plane of {crs_name}')
    return data.assign(new), to_degrees


def _to_metres(data: xr.Dataset, name: str) -> Any:
    factor = 1000.0 if KILO.match(str(data[name].attrs.get("units", "")).strip()) else 1.0
    return np.asarray(data[name].values, np.float64) * factor
