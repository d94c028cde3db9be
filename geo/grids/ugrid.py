"""What a UGRID mesh says of itself: where a variable stands on it, and which variables hold its coordinates.

A variable's `mesh` names the topology; without it, the topology one of whose dimensions the variable has is its own.
Names are never looked at: only attributes of the UGRID conventions 1.0.
"""

from dataclasses import dataclass

import xarray as xr

from geo.grids import naming

PLACES = ("node", "face", "edge")


@dataclass(frozen=True)
class Mesh:
    """A variable's mesh. place: "node", "face" or "edge", where the variable stands; dims: the dimension of each place.

    nodes, faces: names of (longitudes, latitudes), None where the file has none in degrees; connectivity: name of the
    nodes of every face, None where the file has none.
    """

    name: str
    place: str
    dims: dict[str, str]
    nodes: tuple[str, str] | None
    faces: tuple[str, str] | None
    connectivity: str | None


def mesh_of(data: xr.Dataset, name: str, dim: str) -> Mesh | None:
    """Return the mesh along whose dimension `dim` a variable stands, None where the file describes none."""
    named = str(data[name].attrs.get("mesh", ""))
    roles = [str(n) for n, v in data.variables.items() if v.attrs.get("cf_role") == "mesh_topology"]
    for topology in [named] if named in data.variables else roles:
        attributes = {key: str(value) for key, value in data[topology].attrs.items()}
        nodes = _degrees(data, attributes.get("node_coordinates", ""))
        faces = _degrees(data, attributes.get("face_coordinates", ""))
        connectivity = attributes.get("face_node_connectivity", "")
        dims = {}
        for place in PLACES:
            found = _dimension(data, attributes, place)
            if found:
                dims[place] = found
        stated = str(data[name].attrs.get("location", ""))
        place = next((p for p in PLACES if dims.get(p) == dim), stated if named and stated not in dims else "")
        if place:
            held = connectivity if connectivity in data.variables else None
            return Mesh(topology, place, dims, nodes, faces, held)
    return None


def _dimension(data: xr.Dataset, attributes: dict[str, str], place: str) -> str | None:
    """Return the dimension of a mesh's nodes, faces or edges, as stated or as its coordinates have it."""
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


def _degrees(data: xr.Dataset, listed: str) -> tuple[str, str] | None:
    """Return the longitudes and latitudes among coordinates, which may hold a plane's x and y as well."""
    there = [n for n in listed.split() if n in data.variables and data[n].ndim == 1]
    found = []
    for standard, units, pattern in (
        ("longitude", naming.EAST_UNITS, naming.LON),
        ("latitude", naming.NORTH_UNITS, naming.LAT),
    ):
        said = [n for n in there if data[n].attrs.get("standard_name") == standard]
        said += [n for n in there if units.match(str(data[n].attrs.get("units", "")).strip())]
        silent = [n for n in there if not {"standard_name", "units"} & set(data[n].attrs)]
        said += [n for n in silent if pattern.match(n)]
        found.append(said[0] if said else None)
    if found[0] and found[1]:
        return found[0], found[1]
    silent = [n for n in there if not {"standard_name", "units"} & set(data[n].attrs)]
    return (silent[0], silent[1]) if len(silent) == 2 else None  # the conventions' order: x, then y
