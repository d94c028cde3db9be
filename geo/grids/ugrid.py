"""UGRID meshes: where on its mesh a variable is defined, and which variables are its coordinates.

A variable's attribute `mesh` names its topology; without it, the topology that has the variable's
dimension is used. Only attributes of the UGRID conventions 1.0 are used; names are used only if
coordinates have neither standard name nor units.
"""

from dataclasses import dataclass

import xarray as xr

from geo.grids import naming

PLACES = ("node", "face", "edge")


@dataclass(frozen=True)
class Mesh:
    """The mesh of a variable.

    place: "node", "face" or "edge", where the variable is defined. dims: the dimension of each
    place. nodes, faces: names of their (longitudes, latitudes), None if the file has none in
    degrees. connectivity: name of the table of every face's nodes, None if the file has none.
    """

    name: str
    place: str
    dims: dict[str, str]
    nodes: tuple[str, str] | None
    faces: tuple[str, str] | None
    connectivity: str | None


def mesh_of(data: xr.Dataset, name: str, dim: str) -> Mesh | None:
    """Return the mesh of a variable with the horizontal dimension `dim`; None if undescribed."""
    topology_name = str(data[name].attrs.get("mesh", ""))
    roles = [
        str(n)
        for n, v in data.variables.items()
        if str(v.attrs.get("cf_role", "")) == "mesh_topology"
    ]
    for topology in [topology_name] if topology_name in data.variables else roles:
        attributes = {key: str(value) for key, value in data[topology].attrs.items()}
        nodes = _lonlat_names(data, attributes.get("node_coordinates", ""))
        faces = _lonlat_names(data, attributes.get("face_coordinates", ""))
        connectivity = attributes.get("face_node_connectivity", "")
        dims = {}
        for place in PLACES:
            dim_of_place = _dim_of_place(data, attributes, place)
            if dim_of_place:
                dims[place] = dim_of_place
        stated = str(data[name].attrs.get("location", ""))
        place = next(
            (p for p in PLACES if dims.get(p) == dim),
            stated if topology_name and stated not in dims else "",
        )
        if place:
            table = connectivity if connectivity in data.variables else None
            return Mesh(topology, place, dims, nodes, faces, table)
    return None


def _dim_of_place(data: xr.Dataset, attributes: dict[str, str], place: str) -> str | None:
    """Return the dimension of a mesh's nodes, faces or edges.

    It is stated, or follows from coordinates or connectivity.
    """
    if f"{place}_dimension" in attributes:
        return attributes[f"{place}_dimension"]
    for other in attributes.get(f"{place}_coordinates", "").split():
        if other in data.variables and data[other].ndim == 1:
            return str(data[other].dims[0])
    table = attributes.get(f"{place}_node_connectivity", "")
    if table in data.variables and data[table].ndim == 2:
        longer = 0 if data[table].shape[0] >= data[table].shape[1] else 1
        return str(data[table].dims[longer])
    return None


def _lonlat_names(data: xr.Dataset, listed: str) -> tuple[str, str] | None:
    """Return the longitudes and latitudes among coordinates, which may include planar x and y."""
    candidates = [n for n in listed.split() if n in data.variables and data[n].ndim == 1]
    chosen = []
    for standard, units, pattern in (
        ("longitude", naming.EAST_UNITS, naming.LON),
        ("latitude", naming.NORTH_UNITS, naming.LAT),
    ):
        matching = [
            n for n in candidates if str(data[n].attrs.get("standard_name", "")) == standard
        ]
        matching += [
            n for n in candidates if units.match(str(data[n].attrs.get("units", "")).strip())
        ]
        unnamed = [n for n in candidates if not {"standard_name", "units"} & set(data[n].attrs)]
        matching += [n for n in unnamed if pattern.match(n)]
        chosen.append(matching[0] if matching else None)
    if chosen[0] and chosen[1]:
        return chosen[0], chosen[1]
    unnamed = [n for n in candidates if not {"standard_name", "units"} & set(data[n].attrs)]
    return (unnamed[0], unnamed[1]) if len(unnamed) == 2 else None  # the conventions put x before y
