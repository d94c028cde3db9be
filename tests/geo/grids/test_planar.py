"""Meshes and curved grids whose coordinates are metres in a plane: by the projection that a file or
the case names.
"""

from pathlib import Path
from typing import Any

import linear
import numpy as np
import pyproj
import pytest
import xarray as xr
from scipy.spatial import Delaunay

from geo.errors import UserError
from geo.forcing import sources

UTM = "EPSG:32625"
HOURS = np.array([0.0, 6.0, 12.0])
# [m/s] edges of triangles are great circles, and its cells' centres are carried to its nodes
NEAR = 3e-4
X = {"standard_name": "projection_x_coordinate", "units": "m"}
Y = {"standard_name": "projection_y_coordinate", "units": "m"}


def along(crs: str, lon: Any, lat: Any, u: Any, v: Any) -> tuple[Any, Any]:
    """Return components along the axes of a plane, by PROJ's own convergence of meridians."""
    angle = np.radians(pyproj.Proj(crs).get_factors(lon, lat).meridian_convergence)
    return u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)


def mesh(place: str = "face", axes: str = "grid", scale: float = 1.0, crs: str = UTM) -> xr.Dataset:
    """Return Delft3D FM's layout; axes: along which its components count; scale: of its
    coordinates, 0.001 for km.
    """
    rng = np.random.default_rng(8)
    lon, lat = (v.ravel() for v in np.meshgrid(np.linspace(-34, -26, 33), np.linspace(37, 43, 29)))
    lon, lat = lon + rng.uniform(-0.05, 0.05, lon.size), lat + rng.uniform(-0.05, 0.05, lon.size)
    cells = Delaunay(np.stack((lon, lat), 1)).simplices
    x, y = pyproj.Proj(crs)(lon, lat)
    at = {"node": (x, y), "face": (x[cells].mean(1), y[cells].mean(1))}
    own_lon, own_lat = pyproj.Proj(crs)(*at[place], inverse=True)
    u, v = linear.field(own_lon, own_lat, HOURS[:, None])
    if axes == "grid":
        u, v = along(crs, own_lon, own_lat, u, v)
    said = {"mesh": "mesh2d", "location": place, "units": "m s-1"}
    units = {"units": "m" if scale == 1.0 else "km"}
    topology = {
        "cf_role": "mesh_topology", "topology_dimension": 2, "node_coordinates": "mesh2d_node_x mesh2d_node_y",
        "face_coordinates": "mesh2d_face_x mesh2d_face_y", "face_node_connectivity": "mesh2d_face_nodes",
    }  # fmt: skip
    places = {
        f"mesh2d_{k}_{n}": (k, scale * v[j], (X, Y)[j] | units)
        for k, v in at.items()
        for j, n in enumerate("xy")
    }
    return xr.Dataset(
        {
            "mesh2d": ((), 0, topology),
            "mesh2d_ucx": (("time", place), u, said | {"standard_name": "sea_water_x_velocity"}),
            "mesh2d_ucy": (("time", place), v, said | {"standard_name": "sea_water_y_velocity"}),
            "mesh2d_face_nodes": (("face", "corner"), cells, {"start_index": 0}),
            "time": ("time", HOURS, {"units": linear.UNITS}),
            **places,
        }
    )


def test_a_mesh_without_a_projection_is_refused_with_keys_that_work(tmp_path: Path) -> None:
    path = linear.written(tmp_path / "a.nc", mesh())
    with pytest.raises(
        UserError, match=r'lengths in a plane.*variables = \{ crs = "EPSG:32631", axes = "grid" \}'
    ):
        sources.open_source("current", path)
    assert (
        linear.worst(sources.open_source("current", path, variables={"crs": UTM, "axes": "grid"}))
        < NEAR
    )
    source = sources.open_source("current", path, variables={"crs": UTM})
    assert linear.worst(source) < NEAR
    assert any("rotated from the projection's axes" in note for note in source.notes)
    true = linear.written(tmp_path / "b.nc", mesh(axes="true"))
    assert (
        linear.worst(sources.open_source("current", true, variables={"crs": UTM, "axes": "true"}))
        < NEAR
    )
    with pytest.raises(UserError, match="is no projection"):
        sources.open_source("current", path, variables={"crs": "EPSG:4326"})


@pytest.mark.parametrize(("place", "scale"), [("node", 1.0), ("face", 0.001)])
def test_nodes_and_kilometres(place: str, scale: float, tmp_path: Path) -> None:
    path = linear.written(tmp_path / "a.nc", mesh(place, scale=scale))
    assert linear.worst(sources.open_source("current", path, variables={"crs": UTM})) < NEAR


SPELT: dict[str, dict[str, Any]] = {
    "epsg": {"epsg": 32625},
    "float": {"epsg": 32625.0},
    "EPSG_code": {
        "grid_mapping_name": "Unknown projected",
        "EPSG_code": "EPSG:32625",
        "proj4_params": "",
    },
    "urn": {"epsg_code": "urn:ogc:def:crs:EPSG::32625"},
    "wkt": {"crs_wkt": pyproj.CRS(UTM).to_wkt()},
    "proj": {"proj4_params": "+proj=utm +zone=25 +datum=WGS84 +units=m"},
    "cf": {k: v for k, v in pyproj.CRS(UTM).to_cf().items() if k != "crs_wkt"},
}


@pytest.mark.parametrize(
    ("key", "named"), [*((key, True) for key in SPELT), ("EPSG_code", False), ("wkt", False)]
)
def test_projections_as_files_spell_them(key: str, named: bool, tmp_path: Path) -> None:
    data = mesh().assign(projected_coordinate_system=((), 0, SPELT[key]))
    data["wgs84"] = ((), 0, pyproj.CRS("EPSG:4326").to_cf() | {"epsg": 4326})
    for name in ("mesh2d_ucx", "mesh2d_ucy") if named else ():
        data[name].attrs["grid_mapping"] = "projected_coordinate_system"
    assert (
        linear.worst(sources.open_source("current", linear.written(tmp_path / "a.nc", data))) < NEAR
    )


def test_fvcom_with_cartesian_coordinates(tmp_path: Path) -> None:
    """Longitudes and latitudes are zero everywhere; the global attributes name the projection, or
    none.
    """
    held = mesh("face")
    zero = np.zeros(held.sizes["node"])
    data = xr.Dataset(
        {
            "u": (
                ("time", "nele"),
                held.mesh2d_ucx.values,
                {"units": "meters s-1", "standard_name": "sea_water_x_velocity"},
            ),
            "v": (
                ("time", "nele"),
                held.mesh2d_ucy.values,
                {"units": "meters s-1", "standard_name": "sea_water_y_velocity"},
            ),
            "nv": (("three", "nele"), held.mesh2d_face_nodes.values.T + 1),
            "lon": ("node", zero, {"units": "degrees_east"}),
            "lat": ("node", zero, {"units": "degrees_north"}),
            "x": (
                "node",
                held.mesh2d_node_x.values,
                {"long_name": "nodal x-coordinate", "units": "meters"},
            ),
            "y": (
                "node",
                held.mesh2d_node_y.values,
                {"long_name": "nodal y-coordinate", "units": "meters"},
            ),
            "xc": (
                "nele",
                held.mesh2d_face_x.values,
                {"long_name": "zonal x-coordinate", "units": "meters"},
            ),
            "yc": (
                "nele",
                held.mesh2d_face_y.values,
                {"long_name": "zonal y-coordinate", "units": "meters"},
            ),
            "time": held.time,
        },
        attrs={"CoordinateSystem": "Cartesian", "CoordinateProjection": "none"},
    )
    path = linear.written(tmp_path / "a.nc", data)
    with pytest.raises(UserError, match="lengths in a plane"):
        sources.open_source("current", path)
    assert linear.worst(sources.open_source("current", path, variables={"crs": UTM})) < NEAR
    data.attrs["CoordinateProjection"] = "proj=utm +ellps=WGS84 +zone=25"
    assert (
        linear.worst(sources.open_source("current", linear.written(tmp_path / "b.nc", data))) < NEAR
    )
    bare = data.drop_vars(["lon", "lat"])
    assert (
        linear.worst(sources.open_source("current", linear.written(tmp_path / "c.nc", bare))) < NEAR
    )


def test_components_along_the_plane_beside_longitudes(tmp_path: Path) -> None:
    """A file that has longitudes too: its components still count along the axes of its projection."""
    data = mesh("node")
    lon, lat = pyproj.Proj(UTM)(data.mesh2d_node_x.values, data.mesh2d_node_y.values, inverse=True)
    data["lon"] = ("node", lon, {"standard_name": "longitude", "units": "degrees_east"})
    data["lat"] = ("node", lat, {"standard_name": "latitude", "units": "degrees_north"})
    data["mesh2d"].attrs["node_coordinates"] += " lon lat"
    data["crs"] = ((), 0, {"epsg": 32625})
    assert (
        linear.worst(sources.open_source("current", linear.written(tmp_path / "a.nc", data))) < NEAR
    )


def test_curved_grids_in_a_plane(tmp_path: Path) -> None:
    lon, lat = np.meshgrid(np.linspace(-34, -26, 41), np.linspace(37, 43, 33))
    x, y = pyproj.Proj(UTM)(lon + 0.03 * (lat - 40), lat)
    own_lon, own_lat = pyproj.Proj(UTM)(x, y, inverse=True)
    u, v = linear.field(own_lon, own_lat, HOURS[:, None, None])
    dims, said = ("time", "M", "N"), {"units": "m s-1"}
    data = xr.Dataset(
        {
            "u1": (dims, u, said | {"standard_name": "eastward_sea_water_velocity"}),
            "v1": (dims, v, said | {"standard_name": "northward_sea_water_velocity"}),
            "XZ": (("M", "N"), x, X),
            "YZ": (("M", "N"), y, Y),
            "time": ("time", HOURS, {"units": linear.UNITS}),
        }
    )
    path = linear.written(tmp_path / "a.nc", data)
    with pytest.raises(UserError, match="lengths in a plane"):
        sources.open_source("current", path)
    assert linear.worst(sources.open_source("current", path, variables={"crs": UTM})) < NEAR


def test_joined_meshes_have_the_same_points(tmp_path: Path) -> None:
    first = linear.written(tmp_path / "a.nc", mesh())
    later = mesh().assign_coords(time=("time", HOURS + 18, {"units": linear.UNITS}))
    moved = later.assign(mesh2d_face_x=later.mesh2d_face_x + 5000.0)
    with pytest.raises(UserError, match="another grid"):
        sources.open_source(
            "current", [first, linear.written(tmp_path / "b.nc", moved)], variables={"crs": UTM}
        )
    both = sources.open_source(
        "current", [first, linear.written(tmp_path / "c.nc", later)], variables={"crs": UTM}
    )
    assert len(both.times) == 6
