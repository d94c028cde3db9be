"""Triangles of unstructured grids: who is connected with whom, in FVCOM's, SCHISM's and UGRID's words."""

import re

import numpy as np
import scipy.spatial
import xarray as xr

from geo.errors import UserError
from geo.layout import Array, Index, Triangles

NAMES = re.compile(
    r"^(nv|ele(ment)?s?|tri(angles)?|schism_hgrid_face_nodes|.*face_nodes?|face_node_connectivity|elem)$", re.I
)
LONGEST = 4.0  # edges over this many times the local median bridge land when no connectivity is given


def triangles(data: xr.Dataset, name: str, dim: str, lon: Array, lat: Array, notes: list[str]) -> Triangles:
    """Return the triangles on which a variable of one horizontal dimension stands, at nodes or at centres."""
    cells = _connectivity(data)
    if cells is None:
        notes.append("no connectivity in the file: points joined by a Delaunay triangulation without its long edges")
        return Triangles(lon, lat, _delaunay(lon, lat), 0)
    count, nodes = len(cells), int(cells.max()) + 1
    if len(lon) == count and _split(cells)[1] is None and len(lon) != nodes:
        node_lon, node_lat = _nodes(data, nodes)
        if node_lon is not None and node_lat is not None:
            notes.append(f"triangles: {count} elements with values at their centres")
            return Triangles(node_lon, node_lat, cells[:, :3], 0, lon, lat)
        notes.append("values at centres of elements, whose nodes the file lacks: centres joined by triangulation")
        return Triangles(lon, lat, _delaunay(lon, lat), 0)
    if nodes > len(lon):
        raise UserError(f'"{name}" has {len(lon)} points, but its triangles name {nodes} nodes')
    notes.append(f"triangles: {count} elements with values at their {len(lon)} nodes")
    first, second = _split(cells)
    return Triangles(lon, lat, first if second is None else np.concatenate((first, second)), 0)


def _connectivity(data: xr.Dataset) -> Index | None:
    """Return cells (m, 3 or 4) of node indices from 0, a missing fourth node being -1."""
    names = [str(n) for n, v in data.variables.items() if v.attrs.get("cf_role") == "face_node_connectivity"]
    for other in map(str, data.variables):
        if str(data[other].attrs.get("face_node_connectivity", "")) in data.variables:
            names.append(str(data[other].attrs["face_node_connectivity"]))
    names += [str(n) for n, v in data.variables.items() if NAMES.match(str(n)) and v.ndim == 2]
    for name in names:
        variable = data[name]
        values = np.asarray(variable.values, np.float64)
        if values.ndim != 2 or min(values.shape) not in (3, 4):
            continue
        values = values.T if values.shape[0] < values.shape[1] else values
        values = np.where(np.isfinite(values) & (values >= 0), values, -1)
        valid = values[values >= 0]
        start = int(variable.attrs.get("start_index", 0 if (valid == 0).any() else 1))
        return np.where(values >= 0, values - start, -1).astype(np.int64)
    return None


def _split(cells: Index) -> tuple[Index, Index | None]:
    """Cut quadrilaterals into two triangles."""
    if cells.shape[1] == 3:
        return cells, None
    four = cells[:, 3] >= 0
    return cells[:, :3], cells[four][:, [0, 2, 3]] if four.any() else None


def _nodes(data: xr.Dataset, count: int) -> tuple[Array | None, Array | None]:
    for lon_name, lat_name in (("lon", "lat"), ("longitude", "latitude"), ("x", "y")):
        if lon_name in data.variables and lat_name in data.variables and data[lon_name].shape == (count,):
            lon, lat = (np.asarray(data[n].values, np.float64) for n in (lon_name, lat_name))
            if np.abs(lat).max() <= 90 and np.abs(lon).max() <= 720:
                return lon, lat
    named = {str(v.attrs.get("standard_name", "")): str(n) for n, v in data.variables.items() if v.shape == (count,)}
    if {"longitude", "latitude"} <= set(named):
        return tuple(np.asarray(data[named[k]].values, np.float64) for k in ("longitude", "latitude"))  # type: ignore[return-value]
    return None, None


def _delaunay(lon: Array, lat: Array) -> Index:
    """Triangulate in a tangent plane and drop triangles with an edge far longer than its points' others."""
    middle = float(np.degrees(np.angle(np.exp(1j * np.radians(lon)).mean())))
    x = (lon - middle + 180.0) % 360.0 - 180.0
    plane = np.stack((x * np.cos(np.radians(np.mean(lat))), lat), axis=1)
    cells = np.asarray(scipy.spatial.Delaunay(plane).simplices, np.int64)
    edges = np.stack([np.hypot(*(plane[cells[:, a]] - plane[cells[:, b]]).T) for a, b in ((0, 1), (1, 2), (2, 0))], 1)
    shortest = np.full(len(lon), np.inf)
    for k in range(3):
        np.minimum.at(shortest, cells[:, k], edges.min(axis=1))
    local = shortest[cells].max(axis=1)
    return np.asarray(cells[edges.max(axis=1) <= LONGEST * local])
