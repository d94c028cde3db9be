"""Finding where a variable's points lie, from what a file says: coordinates, grid mapping, connectivity."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from geo import absent, connect, naming, projection, rotation, seam
from geo.errors import UserError
from geo.layout import Array, Axes, Curved, Layout


def locate(data: xr.Dataset, name: str, dims: tuple[str, ...], chosen: Mapping[str, Any]) -> tuple[Layout, list[str]]:
    """Return the layout of a variable with these horizontal dimensions, and remarks."""
    notes: list[str] = []
    plane = projection.plane(data, name, dims, chosen, notes)
    lon_name, lat_name = _names(data, name, dims, chosen)
    if plane is not None:
        if lon_name and lat_name:
            trouble = projection.disagreement(plane, _still(data, lon_name, dims), _still(data, lat_name, dims))
            if trouble and not chosen.get("crs"):
                notes.append(
                    f"the grid mapping disagrees with {lon_name}, {lat_name} by {trouble}: the latter are used"
                )
                plane = None
        if plane is not None:
            return plane, notes
    if lon_name is None or lat_name is None:
        raise UserError(
            f'no longitude and latitude for "{name}" ({", ".join(dims)}), and no grid mapping with x and y; '
            f"set variables = {{ lon = ..., lat = ... }} or variables.crs"
        )
    lon, lat = absent.without(_still(data, lon_name, dims), _still(data, lat_name, dims), notes)
    if not np.isfinite(lon).any() or np.nanmax(np.abs(lat)) > 90.001 or np.nanmax(np.abs(lon)) > 720:
        raise UserError(f'"{lon_name}" and "{lat_name}" are no degrees; set variables = {{ lon = ..., lat = ... }}')
    if len(dims) == 1:
        return connect.triangles(data, name, dims[0], lon, lat, notes), notes
    if lon.ndim == 1 and lat.ndim == 1:
        return axes(lon, lat, lon_name, lat_name), notes
    lon, lat = _at_points(lon, lat, data, lon_name, dims)
    if _separable(lon, lat):
        return axes(lon[0], lat[:, 0], lon_name, lat_name), notes
    angle = _angle(data, chosen, lon, lat, notes)
    whole = Curved(lon, lat, np.arange(lon.shape[1]), np.arange(lon.shape[0]), angle)
    return absent.extended(seam.close(whole, notes)), notes


def _names(
    data: xr.Dataset, name: str, dims: tuple[str, ...], chosen: Mapping[str, Any]
) -> tuple[str | None, str | None]:
    """Return the names of the longitudes and latitudes that go with a variable."""
    listed = str(data[name].attrs.get("coordinates", "")).split()
    mesh = data[name].attrs.get("mesh")
    if mesh in data.variables:  # UGRID: the mesh names the coordinates of its nodes and faces
        for key in ("node_coordinates", "face_coordinates"):
            listed += str(data[mesh].attrs.get(key, "")).split()
    found: list[str | None] = []
    for key, pattern, units, standard in (
        ("lon", naming.LON, naming.EAST_UNITS, "longitude"),
        ("lat", naming.LAT, naming.NORTH_UNITS, "latitude"),
    ):
        if key in chosen:
            if chosen[key] not in data.variables:
                raise UserError(f'no variable "{chosen[key]}" (variables.{key})')
            found.append(str(chosen[key]))
            continue
        candidates = []
        for other in map(str, data.variables):
            variable = data[other]
            attributes = variable.attrs
            score = (
                4 * (str(attributes.get("standard_name", "")) == standard)
                + 4 * bool(units.match(str(attributes.get("units", "")).strip()))
                + 2 * bool(pattern.match(other))
            )
            if not score or not variable.ndim or not np.issubdtype(variable.dtype, np.number):
                continue
            own = set(map(str, variable.dims)) <= set(dims) or tuple(map(str, variable.dims[1:])) == dims
            if not own and not _staggered_shape(variable.shape, tuple(data.sizes[d] for d in dims)):
                continue
            values = variable.isel({variable.dims[0]: 0}).values if variable.ndim > 2 else variable.values
            if values.size > 1 and np.nanmin(values) == np.nanmax(values):
                continue  # FVCOM in metres writes lon = lat = 0 everywhere
            candidates.append((score + 20 * own + 10 * (other in listed) + (variable.ndim == len(dims)), other))
        found.append(max(candidates)[1] if candidates else None)
    return found[0], found[1]


def _still(data: xr.Dataset, name: str, dims: tuple[str, ...]) -> Array:
    """Return coordinates, of the first time where they have one (WRF repeats them for every time)."""
    variable = data[name]
    while variable.ndim > len(dims):
        variable = variable.isel({variable.dims[0]: 0})
    return np.asarray(variable.values, np.float64)


def _staggered_shape(shape: tuple[int, ...], wanted: tuple[int, ...]) -> bool:
    """Whether points of this shape lie half a cell beside points of the wanted one (ROMS: rho beside u)."""
    if len(shape) != 2 or len(wanted) != 2:
        return False
    more = shape[0] - wanted[0], shape[1] - wanted[1]
    return more in ((0, 1), (1, 0), (1, 1))


def _halved(values: Array, wanted: tuple[int, ...]) -> Array:
    """Average neighbours along every axis that has one point more than wanted."""
    for axis in (0, 1):
        if values.shape[axis] == wanted[axis] + 1:
            low, high = (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])
            values = (low + high) / 2
    return values


def _at_points(lon: Array, lat: Array, data: xr.Dataset, name: str, dims: tuple[str, ...]) -> tuple[Array, Array]:
    wanted = tuple(data.sizes[d] for d in dims)
    own = tuple(map(str, data[name].dims))
    if set(own) == set(dims) and own != dims:
        lon, lat = lon.T, lat.T
    if lon.shape == wanted:
        return lon, lat
    middle = float(lon[np.isfinite(lon)][0])
    near = middle + (lon - middle + 180.0) % 360.0 - 180.0
    if np.nanmax(np.abs(np.diff(near, axis=1))) > 180 or np.nanmax(np.abs(np.diff(near, axis=0))) > 180:
        x, y = np.cos(np.radians(lon)), np.sin(np.radians(lon))  # round the Earth: average directions
        return np.degrees(np.arctan2(_halved(y, wanted), _halved(x, wanted))), _halved(lat, wanted)
    return _halved(near, wanted), _halved(lat, wanted)


def _separable(lon: Array, lat: Array) -> bool:
    """Whether a two-dimensional lon, lat is a rectilinear grid written out."""
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()) or min(lon.shape) < 2:
        return False
    turn = (lon - lon[0] + 180.0) % 360.0 - 180.0
    dlon, dlat = np.abs(np.diff(lon[0])), np.abs(np.diff(lat[:, 0]))
    if np.median(dlon) == 0 or np.median(dlat) == 0:
        return False
    return bool(np.abs(turn).max() < 1e-3 * np.median(dlon) and np.ptp(lat, axis=1).max() < 1e-3 * np.median(dlat))


def axes(lon: Array, lat: Array, lon_name: str, lat_name: str) -> Axes:
    """Return rectilinear axes brought into ascending order, longitudes unwrapped, repeated columns dropped."""
    for values, axis in ((lon, lon_name), (lat, lat_name)):
        if len(values) < 2:
            raise UserError(f'"{axis}" has one value: at least two columns and two rows are needed to interpolate')
        if not np.isfinite(values).all():
            raise UserError(f'"{axis}" has missing values')
    rows = np.argsort(lat, kind="stable")
    if (np.diff(lat[rows]) <= 0).any():
        raise UserError(f'"{lat_name}" holds the same latitude twice')
    turned = lon % 360.0
    columns = np.argsort(turned, kind="stable")
    ordered = turned[columns]
    step = float(np.median(np.diff(ordered)))
    kept = np.concatenate(([True], np.diff(ordered) > 0.01 * step))
    kept[-1] &= bool(ordered[0] + 360.0 - ordered[-1] > 0.01 * step)  # 0..360 with both ends, in single precision
    columns, ordered = columns[kept], ordered[kept]
    if len(ordered) < 2:
        raise UserError(f'"{lon_name}" holds one longitude only')
    gaps = np.diff(np.concatenate((ordered, ordered[:1] + 360.0)))
    first = int(np.argmax(gaps)) + 1  # the grid starts east of its widest gap
    step = float(np.median(gaps))
    goes_round = bool(gaps.max() < 1.5 * step)
    if goes_round:
        first = int(np.argmin(np.abs((lon[columns] + 180.0) % 360.0)))
    ordered = np.concatenate((ordered[first:], ordered[:first] + 360.0))
    columns = np.concatenate((columns[first:], columns[:first]))
    ordered = ordered - 360.0 * np.floor((ordered[0] + 180.0) / 360.0)
    return Axes(ordered, lat[rows], columns, rows, goes_round)


def _angle(data: xr.Dataset, chosen: Mapping[str, Any], lon: Array, lat: Array, notes: list[str]) -> Array | None:
    """Return the file's own angle of the x axis from east [rad] where it has one that fits the points."""
    name = str(chosen.get("angle", "angle"))
    if name not in data.variables:
        if "angle" in chosen:
            raise UserError(f'no variable "{name}" (variables.angle)')
        return None
    angle = np.asarray(data[name].values, np.float64)
    while angle.ndim > 2:
        angle = angle[0]
    if angle.shape != lon.shape and not _staggered_shape(angle.shape, lon.shape):
        return None
    if "degree" in str(data[name].attrs.get("units", "")).lower():
        angle = np.radians(angle)
    angle = np.arctan2(_halved(np.sin(angle), lon.shape), _halved(np.cos(angle), lon.shape))
    seen = rotation.curved_angle(lon, lat)
    for factor, remark in ((1.0, f'"{name}" gives'), (np.pi / 180.0, f'"{name}", in degrees, gives')):
        apart = np.abs((angle * factor - seen + np.pi) % (2 * np.pi) - np.pi)
        if np.nanmedian(apart) < np.radians(3.0):
            notes.append(f"{remark} the direction of the grid's x axis")
            return np.asarray(angle * factor)
    if "angle" in chosen:
        notes.append(f'"{name}" does not fit the points, but the case asks for it')
        return np.asarray(angle)
    notes.append(f'"{name}" does not fit the points: directions are computed from them')
    return None
