"""Triangles of unstructured grids, from the connectivity conventions of FVCOM, SCHISM and UGRID."""

import numpy as np
import xarray as xr

from geo import sphere
from geo.array import Array
from geo.errors import UserError
from geo.grids import naming
from geo.grids.layout import Index, Triangles
from geo.grids.ugrid import Mesh

# ratio to the local shortest edge; without connectivity, longer edges are assumed to cross land
LONGEST = 4.0


def triangles(
    data: xr.Dataset,
    name: str,
    dim: str,
    lon: Array | None,
    lat: Array | None,
    notes: list[str],
    mesh: Mesh | None = None,
) -> Triangles:
    """Return the triangles on which a variable with one horizontal dimension is defined.

    Args:
        data: the file's dataset.
        name: of the variable.
        dim: its horizontal dimension.
        lon: of its points [deg]; None for values at faces whose centres the file lacks, which are
            then computed as means of their nodes.
        lat: like lon.
        notes: list to which notes are appended.
        mesh: UGRID mesh of the variable, if there is one.

    Raises:
        UserError: the points and the connectivity do not fit together.
    """
    size = int(data.sizes[dim])
    node_lon, node_lat = (
        (None, None)
        if mesh is None or not mesh.nodes
        else (_read_values(data, n) for n in mesh.nodes)
    )
    table = _connectivity(data, dim, mesh, None if node_lon is None else len(node_lon))
    if table is None:
        assert lon is not None
        assert lat is not None
        notes.append(
            "no connectivity in the file: points joined by a Delaunay triangulation without its long edges"
        )
        return Triangles(lon, lat, _delaunay(lon, lat), 0)
    cells, at_faces = table
    count, nodes = len(cells), int(cells.max()) + 1
    if mesh is not None:
        at_faces = mesh.place == "face"
    if count == size and (at_faces or size != nodes):
        if node_lon is None or node_lat is None:
            node_lon, node_lat = _node_coordinates(data, nodes, count)
        if node_lon is not None and node_lat is not None and lon is None:
            lon, lat = _centres(node_lon, node_lat, cells)
            notes.append("centres of elements taken as the means of their nodes")
        assert lon is not None
        assert lat is not None
        if node_lon is not None and node_lat is not None:
            notes.append(f"triangles: {count} elements with values at their centres")
            return Triangles(node_lon, node_lat, cells, 0, lon, lat)
        notes.append(
            "values at centres of elements, whose nodes the file lacks: centres joined by triangulation"
        )
        return Triangles(lon, lat, _delaunay(lon, lat), 0)
    if nodes > size or lon is None or lat is None:
        raise UserError(f'"{name}" has {size} points, but its triangles name {nodes} nodes')
    notes.append(f"triangles: {count} elements with values at their {size} nodes")
    return Triangles(lon, lat, _to_triangles(cells), 0)


def _read_values(data: xr.Dataset, name: str) -> Array:
    return np.asarray(data[name].values, np.float64)


def _centres(lon: Array, lat: Array, cells: Index) -> tuple[Array, Array]:
    """Return mean positions [deg] of the nodes of cells (m, k), padded with -1 for fewer nodes."""
    phi, lam, present = np.radians(lat)[cells], np.radians(lon)[cells], cells >= 0
    x, y, z = (
        np.where(present, v, 0.0).sum(axis=1)
        for v in (np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi))
    )
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


def _connectivity(
    data: xr.Dataset, dim: str, mesh: Mesh | None, nodes: int | None
) -> tuple[Index, bool] | None:
    """Return cells (m, k) of node indices from 0, and whether `dim` is the dimension of cells.

    None without connectivity. Cells with fewer nodes are padded with -1. nodes: number of nodes, if
    known; larger indices are undeclared fill values.
    """
    names = [mesh.connectivity] if mesh is not None and mesh.connectivity else []
    names += [
        str(n)
        for n, v in data.variables.items()
        if str(v.attrs.get("cf_role", "")) == "face_node_connectivity"
    ]
    for other in map(str, data.variables):
        if str(data[other].attrs.get("face_node_connectivity", "")) in data.variables:
            names.append(str(data[other].attrs["face_node_connectivity"]))
    names += [
        str(n)
        for n, v in data.variables.items()
        if naming.CONNECTIVITY.match(str(n)) and v.ndim == 2
    ]
    for name in names:
        variable = data[name]
        values, dims = np.asarray(variable.values, np.float64), tuple(map(str, variable.dims))
        if values.ndim != 2 or not 3 <= min(values.shape) <= 8:
            continue
        cell_dim = next(
            (d for d in (mesh.dims.get("face") if mesh else None, dim) if d in dims), None
        )
        across = dims.index(cell_dim) == 1 if cell_dim else values.shape[0] < values.shape[1]
        values = values.T if across else values
        valid = values[np.isfinite(values) & (values >= 0)]
        start = int(variable.attrs.get("start_index", 0 if (valid == 0).any() else 1))
        with np.errstate(invalid="ignore"):
            named = np.isfinite(values) & (values >= start) & (values < start + (nodes or np.inf))
        return np.where(named, values - start, -1).astype(np.int64), cell_dim == dim
    return None


def _to_triangles(cells: Index) -> Index:
    """Return polygons (m, k), padded with -1, cut into triangles."""
    parts = [cells[:, :3]]
    for k in range(3, cells.shape[1]):
        longer = cells[:, k] >= 0
        parts.append(cells[longer][:, [0, k - 1, k]])
    return np.concatenate(parts)


def _node_coordinates(
    data: xr.Dataset, least: int, cells: int
) -> tuple[Array | None, Array | None]:
    """Return longitudes and latitudes of nodes, None if not found.

    There are at least `least` of them, and not as many as cells.
    """
    coordinates: list[Array | None] = []
    for standard, most in (("longitude", 720.0), ("latitude", 90.0)):
        values = None
        for name, variable in data.variables.items():
            suits = naming.role(str(name), variable.attrs) == standard
            if suits and variable.ndim == 1 and variable.size >= least and variable.size != cells:
                candidate = np.asarray(variable.values, np.float64)
                candidate = np.where(np.isfinite(candidate), candidate, np.nan)
                finite = candidate[np.isfinite(candidate)]
                if finite.size and np.abs(finite).max() <= most and finite.min() < finite.max():
                    values = candidate
                    break
        coordinates.append(values)
    return coordinates[0], coordinates[1]


def _delaunay(lon: Array, lat: Array) -> Index:
    """Return a Delaunay triangulation without overlong triangles.

    A triangle is left out if one of its edges is much longer than others at its points.
    """
    # imported late because it takes 0.25 s and few files need it
    from scipy.spatial import Delaunay, QhullError

    present = np.flatnonzero(np.isfinite(lon) & np.isfinite(lat))
    lon, lat = lon[present], lat[present]
    middle = float(np.degrees(np.angle(np.exp(1j * np.radians(lon)).mean())))
    x = sphere.wrap_degrees(lon - middle)
    plane = np.stack((x * np.cos(np.radians(np.mean(lat))), lat), axis=1)
    try:
        cells = np.asarray(Delaunay(plane).simplices, np.int64)
    except (QhullError, ValueError) as error:
        raise UserError(
            f"{len(present)} points with a longitude and a latitude span no triangle: there is no grid"
        ) from error
    edges = np.stack(
        [
            np.hypot(*(plane[cells[:, a]] - plane[cells[:, b]]).T)
            for a, b in ((0, 1), (1, 2), (2, 0))
        ],
        1,
    )
    shortest = np.full(len(lon), np.inf)
    for k in range(3):
        np.minimum.at(shortest, cells[:, k], edges.min(axis=1))
    local = shortest[cells].max(axis=1)
    return np.asarray(present[cells[edges.max(axis=1) <= LONGEST * local]])
