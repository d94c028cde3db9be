"""Grids in a projection's plane, defined by x and y axes and a grid mapping (CF, PROJ or WKT)."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyproj
import xarray as xr
from numpy.typing import NDArray

from geo import sphere
from geo.array import Array
from geo.errors import UserError
from geo.files import fence, reference_system
from geo.grids.layout import Plane, points

WKT = re.compile(r"\s*[A-Z]\w*\s*\[", re.IGNORECASE)
MAPPINGS = (
    "proj4",
    "proj4text",
    "proj4_string",
    "proj4_params",
    "crs_wkt",
    "wkt",
    "spatial_ref",
    "epsg_code",
    "CoordinateProjection",
)
EPSG = re.compile(r"epsg", re.IGNORECASE)  # epsg, EPSG_code, horizontal_epsg


def plane(
    data: xr.Dataset, name: str, dims: tuple[str, ...], chosen: Mapping[str, Any], notes: list[str]
) -> Plane | None:
    """Return the plane of a variable that has x and y axes and a projection.

    None for other variables. The arguments are those of `locate.locate`; notes are appended.
    """
    if len(dims) != 2:
        return None
    axis: list[Array] = []
    for key, dim in (("y", dims[0]), ("x", dims[1])):
        axis_name = str(chosen.get(key, dim))
        if axis_name not in data.variables or data[axis_name].ndim != 1:
            return None
        variable = data[axis_name]
        if not np.issubdtype(variable.dtype, np.number):
            return None
        standard, units = (
            str(variable.attrs.get(k, "")).strip() for k in ("standard_name", "units")
        )
        rotated = standard in ("grid_longitude", "grid_latitude")
        planar = standard in (
            f"projection_{key}_coordinate",
            "projection_x_coordinate",
            "projection_y_coordinate",
        )
        if not (planar or rotated or units in ("m", "km", "meter", "metre", "meters", "metres")):
            return None
        axis.append(np.asarray(variable.values, np.float64) * (1000.0 if units == "km" else 1.0))
    crs = crs_of(data, name, chosen, notes)
    if crs is None or min(len(axis[0]), len(axis[1])) < 2:
        return None
    geographic = crs.geodetic_crs if not crs.is_derived or crs.is_projected else crs.source_crs
    if crs.is_geographic and not crs.is_derived:
        return None
    for values, dim in zip(axis, dims, strict=True):
        steps = np.diff(values)
        if not ((steps > 0).all() or (steps < 0).all()):
            raise UserError(f'the axis "{dim}" does not increase')
    transform = pyproj.Transformer.from_crs(crs, geographic or "EPSG:4326", always_xy=True)
    method = crs.coordinate_operation.method_name if crs.coordinate_operation else crs.name
    notes.append(f"grid in a projection's plane ({method})")
    turn = 360.0 if crs.is_geographic else 0.0
    return Plane(
        axis[1], axis[0], np.arange(len(axis[1])), np.arange(len(axis[0])), transform, turn
    )


def crs_of(
    data: xr.Dataset, name: str, chosen: Mapping[str, Any], notes: list[str]
) -> pyproj.CRS | None:
    """Return the reference system that the case chooses or the file describes; None without."""
    if chosen.get("crs"):
        fence.check_crs(chosen["crs"])
        try:
            return pyproj.CRS.from_user_input(chosen["crs"])
        except pyproj.exceptions.CRSError as error:
            raise UserError(
                f'variables.crs = "{chosen["crs"]}" is no coordinate reference system'
            ) from error
    mapping = str(data[name].attrs.get("grid_mapping", "")).split(":")[0].strip()
    if mapping in data.variables:
        return _system_of_mapping(data, mapping, notes)
    described = [str(n) for n in data.variables if _has_system(data[n].attrs)]
    if len(described) > 1:  # Delft3D FM also has one in degrees
        systems = {n: _system_of_mapping(data, n, []) for n in described}
        described = [n for n, crs in systems.items() if crs is not None and crs.is_projected]
    if len(described) != 1:
        return None
    notes.append(f'grid mapping "{described[0]}" taken, the only one in the file')
    return _system_of_mapping(data, described[0], notes)


def _system_of_mapping(data: xr.Dataset, mapping: str, notes: list[str]) -> pyproj.CRS | None:
    """Return the reference system that a grid mapping describes; None if it describes none."""
    attributes = dict(data[mapping].attrs)
    for key in _system_keys(attributes):
        if not WKT.match(str(attributes.get(key, ""))):
            fence.check_crs(attributes.get(key, ""))
    try:
        return reference_system.parse_reference_system(attributes)
    except (KeyError, ValueError, TypeError, pyproj.exceptions.CRSError):
        return of_attributes(attributes, notes, f'grid mapping "{mapping}"')


def _has_system(attributes: Mapping[str, Any]) -> bool:
    return "grid_mapping_name" in attributes or bool(_system_keys(attributes))


def _system_keys(attributes: Mapping[str, Any]) -> list[str]:
    """Return the attributes that may define a reference system, the most usual ones first."""
    return [key for key in MAPPINGS if key in attributes] + sorted(
        k for k in attributes if EPSG.search(k) and k not in MAPPINGS
    )


def of_attributes(
    attributes: Mapping[str, Any], notes: list[str] | None = None, source_text: str = "projection"
) -> pyproj.CRS | None:
    """Return the reference system that attributes define (PROJ, WKT, EPSG); None without."""
    for key in _system_keys(attributes):
        written = attributes[key]
        number = re.fullmatch(
            r"\s*(?:urn:ogc:def:crs:)?(?:EPSG:*)?\s*(\d{4,6})(?:\.0)?\s*",
            str(written),
            re.IGNORECASE,
        )
        if not number and not WKT.match(str(written)):
            fence.check_crs(written)
        try:
            crs = (
                pyproj.CRS.from_epsg(int(number[1]))
                if number
                else pyproj.CRS.from_user_input(str(written))
            )
        except pyproj.exceptions.CRSError:
            continue
        if notes is not None:
            notes.append(f"{source_text} read from its {key}")
        return crs
    return None


def disagreement(plane: Plane, lon: NDArray[Any], lat: NDArray[Any]) -> str:
    """Return the distance between a file's lon, lat and its projection; "" below half a cell."""
    shape = (len(plane.y), len(plane.x))
    if lon.shape != shape or lat.shape != shape:
        return ""
    j, i = np.ix_([0, shape[0] // 2, -1], [0, shape[1] // 2, -1])
    plane_lon, plane_lat = points(plane)
    cell = max(abs(np.diff(lat[:2, 0])[0]), abs(np.diff(lat[0, :2])[0]), 1e-9)
    with np.errstate(invalid="ignore"):
        east = sphere.wrap_degrees((lon - plane_lon)[j, i])
        distance = np.hypot(east * np.cos(np.radians(lat[j, i])), (lat - plane_lat)[j, i])
    worst = float(np.nanmax(distance)) if np.isfinite(distance).any() else 0.0
    return f"{worst * 60:.2f} nmi" if worst > 0.5 * cell else ""
