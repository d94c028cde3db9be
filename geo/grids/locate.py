"""Find the layout of a variable in a file, from coordinates, grid mapping and connectivity."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyproj
import xarray as xr

from geo import sphere
from geo.array import Array
from geo.errors import UserError
from geo.grids import absent, connect, naming, planar, projection, rotation, seam, stagger, ugrid
from geo.grids.layout import Axes, Curved, Layout

FINEST = 1e-5  # [deg] 1 m; no whole grid is smaller


@dataclass(frozen=True)
class Component:
    """A variable whose layout is searched for.

    dims: its horizontal dimensions; side: 0 for u, 1 for v; chosen: the case's choice of
    coordinates, by key.
    """

    data: xr.Dataset
    name: str
    dims: tuple[str, ...]
    side: int
    chosen: Mapping[str, Any]


def locate(
    data: xr.Dataset, name: str, dims: tuple[str, ...], chosen: Mapping[str, Any], side: int = 0
) -> tuple[Layout, list[str]]:
    """Return the layout of a variable, and notes for the user.

    Args:
        data: the file's dataset.
        name: of the variable.
        dims: its horizontal dimensions.
        chosen: the case's choice of coordinates, by key.
        side: 0 for u, 1 for v.

    Raises:
        UserError: the file does not say where the points lie, or contradicts itself.
    """
    notes: list[str] = []
    component = Component(data, name, dims, side, chosen)
    plane = projection.plane(data, name, dims, chosen, notes)
    mesh = ugrid.mesh_of(data, name, dims[0]) if len(dims) == 1 else None
    lon_name, lat_name = _find_names(component, mesh)
    along: pyproj.Transformer | None = None
    if plane is None and not (lon_name and lat_name) and not (mesh and mesh.nodes):
        flat = planar.unprojected(data, name, dims, chosen, notes)
        if flat is not None:
            data, along = flat
            component = replace(component, data=data)
            mesh = ugrid.mesh_of(data, name, dims[0]) if len(dims) == 1 else None
            lon_name, lat_name = _find_names(component, mesh)
    elif len(dims) == 1 and planar.pairs(data, chosen):
        along = planar.transformer(data, name, chosen, [])
    if len(dims) == 1 and (mesh.place == "edge" if mesh else "edge" in dims[0].lower()):
        raise UserError(
            f'"{name}" is defined on the edges of its mesh ({dims[0]}), where no vector is known; choose values at nodes '
            f"or faces with variables = {{ east = ..., north = ... }}"
        )
    if mesh and mesh.place == "face" and lon_name is None and mesh.nodes and mesh.connectivity:
        return replace(
            connect.triangles(data, name, dims[0], None, None, notes, mesh), projection=along
        ), notes
    if plane is not None:
        if lon_name and lat_name:
            own_lon, own_lat = (_first_values(component, n) for n in (lon_name, lat_name))
            trouble = projection.disagreement(plane, own_lon, own_lat)
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
    lon, lat = absent.drop_missing_points(
        _first_values(component, lon_name), _first_values(component, lat_name), notes
    )
    if (
        not np.isfinite(lon).any()
        or np.nanmax(np.abs(lat)) > 90.001
        or np.nanmax(np.abs(lon)) > 720
    ):
        raise UserError(
            f'"{lon_name}" and "{lat_name}" are not in degrees; set variables = {{ lon = ..., lat = ... }}'
        )
    if len(dims) == 1:
        return replace(
            connect.triangles(data, name, dims[0], lon, lat, notes, mesh), projection=along
        ), notes
    if lon.ndim == 1 and lat.ndim == 1:
        sizes = tuple(int(data.sizes[d]) for d in dims)
        crossed = dims[0] in data[lon_name].dims or dims[1] in data[lat_name].dims
        if crossed or (len(lat), len(lon)) != sizes:
            raise UserError(
                f'"{lon_name}" ({len(lon)}) and "{lat_name}" ({len(lat)}) are not the columns and rows of "{name}" '
                f"({dims[1]} = {sizes[1]}, {dims[0]} = {sizes[0]}); set variables = {{ lon = ..., lat = ... }}"
            )
        return _axes(lon, lat, lon_name, lat_name), notes
    lon, lat = _component_points(component, lon_name, lon, lat, notes)
    if _is_rectilinear(lon, lat):
        return _axes(lon[0], lat[:, 0], lon_name, lat_name), notes
    angle = _file_angle(data, chosen, lon, lat, notes)
    grid = Curved(lon, lat, np.arange(lon.shape[1]), np.arange(lon.shape[0]), angle)
    return absent.extended(seam.close_seam(grid, notes)), notes


def coordinates(
    data: xr.Dataset, name: str, dims: tuple[str, ...], chosen: Mapping[str, Any], side: int
) -> tuple[str, str] | None:
    """Return the names of a variable's longitudes and latitudes, None if it has none.

    dims, chosen, side: as in `locate`.
    """
    lon, lat = _find_names(Component(data, name, dims, side, chosen), None)
    return (lon, lat) if lon is not None and lat is not None else None


def _find_names(component: Component, mesh: ugrid.Mesh | None) -> tuple[str | None, str | None]:
    """Return the names of the longitudes and latitudes of a variable; None for each if absent."""
    data, chosen = component.data, component.chosen
    mesh_names = None if mesh is None else {"node": mesh.nodes, "face": mesh.faces}.get(mesh.place)
    if mesh_names and not {"lon", "lat"} & set(chosen):
        return mesh_names
    scores_of: list[dict[str, float]] = []
    for key, standard in (("lon", "longitude"), ("lat", "latitude")):
        if key in chosen:
            if chosen[key] not in data.variables:
                raise UserError(f'no variable "{chosen[key]}" (variables.{key})')
            scores_of.append({str(chosen[key]): 0.0})
            continue
        scores = {}
        for other in map(str, data.variables):
            attributes = data[other].attrs
            fit = (
                _fit_score(component, other) if naming.role(other, attributes) == standard else None
            )
            if fit is not None:
                scores[other] = naming.certainty(other, attributes, standard) + fit
        scores_of.append(scores)
    pairs = [
        (x + y, lon, lat)
        for lon, x in scores_of[0].items()
        for lat, y in scores_of[1].items()
        if _belong_together(component, lon, lat)
    ]
    if pairs:
        _, lon, lat = max(pairs)
        for key, other in (("lon", lon), ("lat", lat)):
            odd = "" if key in chosen else naming.contradiction(other, data[other].attrs)
            if odd:
                raise UserError(
                    f"{odd}; say which it is: set variables = {{ lon = ..., lat = ... }}"
                )
        return lon, lat
    for key, others, other_axis in (
        ("lon", scores_of[1], "latitudes"),
        ("lat", scores_of[0], "longitudes"),
    ):
        if key in chosen and others:
            raise UserError(
                f'variables.{key} = "{chosen[key]}" does not go with the {other_axis} of "{component.name}" '
                f"({', '.join(others)}): they have other dimensions; set variables.lon and variables.lat"
            )
    return (
        (max(scores_of[0], default=None), None)
        if scores_of[0]
        else (None, max(scores_of[1], default=None))
    )


def _belong_together(component: Component, lon: str, lat: str) -> bool:
    """Return True if longitudes and latitudes belong together.

    They have the same points, are both axes, or are both named by the case.
    """
    own = [_own_dims(component, component.data[name].variable) for name in (lon, lat)]
    return own[0] == own[1] or max(map(len, own)) == 1 or {"lon", "lat"} <= set(component.chosen)


def _own_dims(component: Component, variable: xr.Variable) -> tuple[str, ...]:
    """Return the dimensions of coordinates, without a leading one (time) that repeats them."""
    own = tuple(map(str, variable.dims))
    stands = map(str, component.data[component.name].dims)
    repeated = len(own) > 1 and own[0] not in component.dims and own[0] in stands
    return own[1:] if repeated else own


def _fit_score(component: Component, other: str) -> float | None:
    """Return a score of how well coordinates fit a component's points; None if they do not."""
    data, dims = component.data, component.dims
    variable = data[other]
    if not variable.ndim or not np.issubdtype(variable.dtype, np.number):
        return None
    own = (
        set(_own_dims(component, variable.variable)) <= set(dims)
        or tuple(map(str, variable.dims[1:])) == dims
    )
    place = stagger.place_of(other) if len(dims) == 2 else None
    beside = place in (None, "t") and _half_cell_beside(data, variable, dims)
    if not own and not beside:
        return None
    values = _first_values(component, other)
    finite = values[np.isfinite(values)]
    if values.size > 1 and (finite.size == 0 or finite.min() == finite.max()):
        # FVCOM in metres writes lon = lat = 0 everywhere, ROMS zeros or fill values at u and v
        return None
    listed = other in str(data[component.name].attrs.get("coordinates", "")).split()
    return (
        20 * own + 10 * listed + (variable.ndim == len(dims)) + 3 * (place == "uv"[component.side])
    )


def _half_cell_beside(data: xr.Dataset, variable: xr.DataArray, dims: tuple[str, ...]) -> bool:
    """Return True if points may lie half a cell beside those of a component over `dims`."""
    wanted = tuple(int(data.sizes[d]) for d in dims)
    # WRF repeats coordinates for every time
    repeated = variable.ndim == 3 and "time" in str(variable.dims[0]).lower()
    if (
        variable.ndim != 2 + repeated
        or len(dims) != 2
        or (not repeated and "time" in str(variable.dims[0]).lower())
    ):
        return False
    shape = variable.shape[-2:]
    more = [have - want for have, want in zip(shape, wanted, strict=True)]
    same = tuple(shape) == wanted and not set(map(str, variable.dims)) <= set(dims)
    return same or (max(more) <= 1 and min(more) >= 0 and any(more)) or sorted(more) == [-1, 0]


def _first_values(component: Component, name: str) -> Array:
    """Return coordinates at the first time, for files that repeat them as WRF does."""
    variable = component.data[name].variable
    while variable.ndim > min(len(component.dims), len(_own_dims(component, variable))):
        variable = variable.isel({variable.dims[0]: 0})
    values = np.asarray(variable.values, np.float64)
    return np.where(np.isfinite(values), values, np.nan)


def _staggered_shape(shape: tuple[int, ...], wanted: tuple[int, ...]) -> bool:
    """Return True if points of this shape lie half a cell beside points of the wanted shape.

    In ROMS, rho points lie so beside u points.
    """
    if len(shape) != 2 or len(wanted) != 2:
        return False
    more = shape[0] - wanted[0], shape[1] - wanted[1]
    return more in ((0, 1), (1, 0), (1, 1))


def _average_neighbours(values: Array, wanted: tuple[int, ...]) -> Array:
    """Return the means of neighbours along every axis with one point more than wanted."""
    for axis in (0, 1):
        if values.shape[axis] == wanted[axis] + 1:
            low, high = (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])
            values = (low + high) / 2
    return values


def _component_points(
    component: Component, lon_name: str, lon: Array, lat: Array, notes: list[str]
) -> tuple[Array, Array]:
    """Return (lon, lat) [deg] of a component's own points, (ny, nx).

    The given coordinates may be those of points half a cell beside them.
    """
    data, name, dims, side, chosen = (
        component.data,
        component.name,
        component.dims,
        component.side,
        component.chosen,
    )
    wanted = tuple(int(data.sizes[d]) for d in dims)
    own = tuple(map(str, data[lon_name].dims))[-2:]
    if set(own) == set(dims) and own != dims:
        lon, lat = lon.T, lat.T
    if lon.ndim != 2 or lat.shape != lon.shape:
        raise ValueError("not over the component's dimensions")
    along = stagger.offsets(data, name, dims, side, lon_name, chosen, lon.shape)
    if along == (0.0, 0.0):
        return lon, lat
    notes.append(
        f"{name} has no coordinates of its own: taken midway between the points of {lon_name}{_describe_offset(along)}"
    )
    if _is_rectilinear(lon, lat):
        line = stagger.moved_line(np.unwrap(lon[0], period=360.0), wanted[1], along[1])
        x, y = np.meshgrid(line, stagger.moved_line(lat[:, 0], wanted[0], along[0]))
        return x, y
    extended = absent.extended(Curved(lon, lat, np.arange(lon.shape[1]), np.arange(lon.shape[0])))
    return stagger.midpoints(extended.lon, extended.lat, wanted, along, seam.follower(extended))


def _describe_offset(along: tuple[float | None, float | None]) -> str:
    """Return text on which side of the given points a component lies, if sizes do not show it."""
    phrases = [
        f", half a cell {'after' if offset > 0 else 'before'} them along the {axis}"
        for offset, axis in zip(along, ("columns", "rows"), strict=True)
        if offset
    ]
    return "".join(phrases)


def _is_rectilinear(lon: Array, lat: Array) -> bool:
    """Return True if two-dimensional lon and lat form a rectilinear grid."""
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()) or min(lon.shape) < 2:
        return False
    turn = sphere.wrap_degrees(lon - lon[0])
    dlon, dlat = np.abs(np.diff(lon[0])), np.abs(np.diff(lat[:, 0]))
    if np.median(dlon) == 0 or np.median(dlat) == 0:
        return False
    return bool(
        np.abs(turn).max() < 1e-3 * np.median(dlon)
        and np.ptp(lat, axis=1).max() < 1e-3 * np.median(dlat)
    )


def _axes(lon: Array, lat: Array, lon_name: str, lat_name: str) -> Axes:
    """Return rectilinear axes in ascending order, unwrapped and without repeated columns.

    Args:
        lon: of the columns [deg], shape (nx,).
        lat: of the rows [deg], shape (ny,).
        lon_name: of the variable, for messages.
        lat_name: of the variable, for messages.

    Raises:
        UserError: the axes are too short, incomplete, or repeat a latitude.
    """
    for values, axis in ((lon, lon_name), (lat, lat_name)):
        if len(values) < 2:
            raise UserError(
                f'"{axis}" has one value: at least two columns and two rows are needed to interpolate'
            )
        if not np.isfinite(values).all():
            raise UserError(f'"{axis}" has missing values')
        if 0 < np.ptp(values) < FINEST:
            raise UserError(
                f'"{axis}" spans {np.ptp(values):.2g} degrees in all: is it in degrees?'
            )
    rows = np.argsort(lat, kind="stable")
    if (np.diff(lat[rows]) <= 0).any():
        raise UserError(f'"{lat_name}" holds the same latitude twice')
    turned = lon % 360.0
    columns = np.argsort(turned, kind="stable")
    ordered = turned[columns]
    step = float(np.median(np.diff(ordered)))
    kept = np.concatenate(([True], np.diff(ordered) > 0.01 * step))
    # an axis from 0 to 360 may hold both ends, in single precision
    kept[-1] &= bool(ordered[0] + 360.0 - ordered[-1] > 0.01 * step)
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


def _file_angle(
    data: xr.Dataset, chosen: Mapping[str, Any], lon: Array, lat: Array, notes: list[str]
) -> Array | None:
    """Return the file's own angle of the x axis from east [rad], (ny, nx).

    None if the file has none. An angle that contradicts the points is not used.
    """
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
    angle = np.where(np.isfinite(angle), angle, np.nan)
    computed = rotation.curved_angle(lon, lat)

    def at_points(turn: Array) -> Array:
        return np.asarray(
            np.arctan2(
                _average_neighbours(np.sin(turn), lon.shape),
                _average_neighbours(np.cos(turn), lon.shape),
            )
        )

    for factor, remark in (
        (1.0, f'"{name}" gives'),
        (np.pi / 180.0, f'"{name}", in degrees, gives'),
    ):
        turn = at_points(angle * factor)
        difference = np.abs(sphere.wrap(turn - computed))
        finite = difference[np.isfinite(difference)]
        if finite.size and np.median(finite) < np.radians(3.0):
            notes.append(f"{remark} the direction of the grid's x axis")
            return np.asarray(np.where(np.isfinite(turn), turn, computed))
    if "angle" in chosen:
        notes.append(f'"{name}" does not fit the points, but the case asks for it')
        return at_points(angle)
    notes.append(f'"{name}" does not fit the points: directions are computed from them')
    return None
