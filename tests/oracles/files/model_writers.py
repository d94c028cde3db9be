"""The field of writers.py in closed form, written as ocean models store currents: on curvilinear,
rotated and triangular grids.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import xarray as xr
from scipy.spatial import Delaunay
from writers import ALONG_X, ALONG_Y, CELL, EAST, NORTH, TIMES, in_plane, save, slices

from geo.array import Array


def oblique() -> tuple[pyproj.Proj, Array, Array, float]:
    """A tangent plane about (4 E, 59 N) and a grid in it turned by 35 degrees: (projection, x', y',
    turn).
    """
    half, step = 260e3, CELL * 111_195.0
    line = np.arange(-half, half, step)
    x, y = np.meshgrid(line, line[: len(line) - 7] + 11e3)
    return pyproj.Proj("+proj=stere +lat_0=59 +lon_0=4 +R=6371000"), x, y, np.radians(35.0)


def turned(to: pyproj.Proj, x: Array, y: Array, angle: float) -> tuple[Array, Array]:
    lon, lat = to(
        x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), inverse=True
    )
    return np.asarray(lon), np.asarray(lat)


def along(to: pyproj.Proj, lon: Array, lat: Array, angle: float) -> tuple[Array, Array]:
    """The field along the turned grid's axes."""
    u, v = in_plane(to, lon, lat, *slices(lon, lat))
    return u * np.cos(angle) + v * np.sin(angle), -u * np.sin(angle) + v * np.cos(angle)


def roms(path: Path, own_points: bool = False, angle: str = "rad") -> Path:
    """A ROMS history file: u between rho points in xi, v in eta, sigma layers, an island, only
    lon_rho and angle.
    """
    to, x, y, turn = oblique()
    lon, lat = turned(to, x, y, turn)
    xu, yu = (x[:, :-1] + x[:, 1:]) / 2, (y[:, :-1] + y[:, 1:]) / 2
    xv, yv = (x[:-1] + x[1:]) / 2, (y[:-1] + y[1:]) / 2
    at_u, at_v = turned(to, xu, yu, turn), turned(to, xv, yv, turn)
    u, v = along(to, *at_u, turn)[0], along(to, *at_v, turn)[1]
    layers = np.array([-0.95, -0.5, -0.02])
    weight = np.array([0.1, 0.5, 1.0])[:, None, None]  # the surface is the last layer
    east0, north0 = to(lon, lat)
    east1, north1 = to(lon + 1e-5, lat)
    direction = turn - np.arctan2(north1 - north0, east1 - east0)
    data: dict[str, Any] = {
        "u": (("ocean_time", "s_rho", "eta_u", "xi_u"), u[:, None] * weight, {"units": "meter second-1", "long_name": "u-momentum component"}),
        "v": (("ocean_time", "s_rho", "eta_v", "xi_v"), v[:, None] * weight, {"units": "meter second-1", "long_name": "v-momentum component"}),
        "lon_rho": (("eta_rho", "xi_rho"), lon, {"units": "degree_east"}),
        "lat_rho": (("eta_rho", "xi_rho"), lat, {"units": "degree_north"}),
    }  # fmt: skip
    if angle:
        stored = direction if angle == "rad" else np.degrees(direction)
        data["angle"] = (
            ("eta_rho", "xi_rho"),
            stored,
            {"units": "radians"} if angle == "rad" else {},
        )
    if own_points:
        data |= {"lon_u": (("eta_u", "xi_u"), at_u[0]), "lat_u": (("eta_u", "xi_u"), at_u[1])}
        data |= {"lon_v": (("eta_v", "xi_v"), at_v[0]), "lat_v": (("eta_v", "xi_v"), at_v[1])}
    return save(
        xr.Dataset(data, {"ocean_time": ("ocean_time", TIMES), "s_rho": ("s_rho", layers)}),
        path,
        u={"_FillValue": 1e37},
    )


def nemo(folder: Path) -> list[Path]:
    """NEMO's grid_U and grid_V files, each with its own points under the same names; depths from
    the surface down.
    """
    to, x, y, turn = oblique()
    step = x[0, 1] - x[0, 0]
    paths = []
    for name, shift, k in (("vozocrtx", (step / 2, 0.0), 0), ("vomecrty", (0.0, step / 2), 1)):
        lon, lat = turned(to, x + shift[0], y + shift[1], turn)
        values = along(to, lon, lat, turn)[k]
        depth = "depthu" if k == 0 else "depthv"
        data = xr.Dataset(
            {
                name: (("time_counter", depth, "y", "x"), np.stack((values, 0.3 * values), 1), {"units": "m/s", "coordinates": "nav_lon nav_lat"}),
                "nav_lon": (("y", "x"), lon),
                "nav_lat": (("y", "x"), lat),
            },
            {"time_counter": TIMES, depth: (depth, [0.5, 20.0], {"units": "m"})},
        )  # fmt: skip
        paths.append(save(data, folder / f"grid_{'UV'[k]}.nc"))
    return paths


def mesh(cell: float = CELL) -> tuple[Array, Array, Array]:
    """Triangles over the area: (lon, lat) of nodes and nodes of cells, from jittered points."""
    rng = np.random.default_rng(7)
    lon, lat = np.meshgrid(np.arange(1.4, 6.6, 2 * cell), np.arange(57.6, 60.4, cell))
    jitter = rng.uniform(-0.2, 0.2, (2, lon.size))
    x, y = lon.ravel() + 2 * cell * jitter[0], lat.ravel() + cell * jitter[1]
    return x, y, Delaunay(np.stack((x / 2, y), 1)).simplices


def fvcom(path: Path) -> Path:
    """FVCOM: velocities at centres of elements, connectivity (3, nele) from 1, layers downwards,
    MJD in float32.
    """
    lon, lat, cells = mesh()
    lonc, latc = lon[cells].mean(1), lat[cells].mean(1)
    u, v = slices(lonc, latc)
    days = (TIMES - np.datetime64("1858-11-17")) / np.timedelta64(1, "D")
    weight = np.array([1.0, 0.4])[:, None]
    siglay = np.repeat(np.array([[-0.1], [-0.9]]), len(lon), 1)
    data = xr.Dataset(
        {
            "u": (("time", "siglay", "nele"), u[:, None] * weight, {"units": "meters s-1", "standard_name": "eastward_sea_water_velocity"}),
            "v": (("time", "siglay", "nele"), v[:, None] * weight, {"units": "meters s-1", "standard_name": "Northward_sea_water_velocity"}),
            "lon": ("node", lon, {"standard_name": "longitude", "units": "degrees_east"}),
            "lat": ("node", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lonc": ("nele", lonc, {"standard_name": "longitude", "units": "degrees_east"}),
            "latc": ("nele", latc, {"standard_name": "latitude", "units": "degrees_north"}),
            "nv": (("three", "nele"), cells.T + 1, {"long_name": "nodes surrounding element"}),
            "siglev_like": (("siglay", "node"), siglay),
            "time": ("time", days.astype(np.float32), {"units": "days since 1858-11-17 00:00:00", "format": "modified julian day (MJD)"}),
        }
    )  # fmt: skip
    return save(data, path)


def schism(path: Path) -> Path:
    """SCHISM: hvel(time, node, layer, two) at nodes, faces from 1 with a fill value, the last layer
    at the surface.
    """
    lon, lat, cells = mesh()
    u, v = slices(lon, lat)
    both = np.stack((u, v), -1)[:, :, None, :] * np.array([0.2, 1.0])[:, None]
    faces = np.concatenate((cells + 1, np.full((len(cells), 1), -1)), 1)
    data = xr.Dataset(
        {
            "hvel": (("time", "nSCHISM_hgrid_node", "nSCHISM_vgrid_layers", "two"), both, {"units": "m/s"}),
            "SCHISM_hgrid_node_x": ("nSCHISM_hgrid_node", lon, {"units": "degrees_east"}),
            "SCHISM_hgrid_node_y": ("nSCHISM_hgrid_node", lat, {"units": "degrees_north"}),
            "SCHISM_hgrid_face_nodes": (
                ("nSCHISM_hgrid_face", "nMaxSCHISM_hgrid_face_nodes"), faces, {"cf_role": "face_node_connectivity", "start_index": 1}
            ),
        },
        {"time": TIMES},
    )  # fmt: skip
    return save(data, path)


def curved_true(path: Path) -> Path:
    """Two-dimensional longitudes and latitudes, but components that are true east and north."""
    to, x, y, turn = oblique()
    lon, lat = turned(to, x, y, turn)
    u, v = slices(lon, lat)
    extra = {"coordinates": "lat lon"}
    return save(
        xr.Dataset(
            {
                "a": (("time", "j", "i"), u, EAST | extra),
                "b": (("time", "j", "i"), v, NORTH | extra),
            },
            {"time": TIMES, "lon": (("j", "i"), lon), "lat": (("j", "i"), lat)},
        ),
        path,
    )


def rotated(path: Path) -> Path:
    """A rotated pole: rlon east of 180, components along the rotated axes, no longitudes and
    latitudes.
    """
    mapping = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": 25.0,
        "grid_north_pole_longitude": -40.0,
    }
    to = pyproj.Transformer.from_crs("EPSG:4326", pyproj.CRS.from_cf(mapping), always_xy=True)
    x, y = to.transform(*np.meshgrid(np.linspace(1, 7, 9), np.linspace(57, 61, 9)))
    rlon, rlat = np.arange(x.min(), x.max(), CELL), np.arange(y.min(), y.max(), CELL)
    lon, lat = to.transform(*np.meshgrid(rlon, rlat), direction="INVERSE")
    (x0, y0), (x1, y1) = to.transform(lon, lat), to.transform(lon, lat + 1e-5)
    angle = np.arctan2(y1 - y0, (x1 - x0) * np.cos(np.radians(y0))) - np.pi / 2
    u, v = slices(lon, lat)
    dims, extra = ("time", "rlat", "rlon"), {"grid_mapping": "pole"}
    return save(
        xr.Dataset(
            {
                "u": (dims, u * np.cos(angle) - v * np.sin(angle), ALONG_X | extra),
                "v": (dims, u * np.sin(angle) + v * np.cos(angle), ALONG_Y | extra),
                "pole": ((), 0, mapping),
            },
            {
                "time": TIMES,
                "rlat": ("rlat", rlat, {"standard_name": "grid_latitude", "units": "degrees"}),
                "rlon": (
                    "rlon",
                    rlon + 360.0,
                    {"standard_name": "grid_longitude", "units": "degrees"},
                ),
            },
        ),
        path,
    )


def repeated(path: Path) -> Path:
    """Longitudes and latitudes repeated for every time, as WRF writes them; names say nothing of
    axes.
    """
    to, x, y, turn = oblique()
    lon, lat = turned(to, x, y, turn)
    u, v = along(to, lon, lat, turn)
    dims = ("Time", "south_north", "west_east")
    still = {"XLONG": np.repeat(lon[None], 3, 0), "XLAT": np.repeat(lat[None], 3, 0)}
    data = xr.Dataset(
        {"u": (dims, u, {"units": "m s-1"}), "v": (dims, v, {"units": "m s-1"})}
        | {
            "XLONG": (dims, still["XLONG"], {"units": "degree_east"}),
            "XLAT": (dims, still["XLAT"], {"units": "degree_north"}),
        }
        | {"XTIME": ("Time", [0.0, 180.0, 360.0], {"units": "minutes since 2024-03-05 00:00:00"})}
    )
    return save(data, path)


def apart(folder: Path) -> list[Path]:
    """A ROMS history file without points, and the grid file that has them."""
    data = xr.load_dataset(roms(folder / "all.nc", own_points=True), decode_times=False)
    grid = [n for n in data.variables if str(n)[:3] in ("lon", "lat", "ang")]
    return [save(data.drop_vars(grid), folder / "his.nc"), save(data[grid], folder / "grd.nc")]


def dflow(path: Path) -> Path:
    """D-Flow FM: UGRID, quadrilaterals and triangles mixed, values at the faces' centres."""
    x, y = np.meshgrid(np.arange(1.4, 6.7, 2 * CELL), np.arange(57.6, 60.4, CELL))
    index = np.arange(x.size).reshape(x.shape)
    four = np.stack((index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]), -1).reshape(
        -1, 4
    )
    none = np.full((len(four[::3]), 1), -1)
    halves = [np.concatenate((four[::3][:, k], none), 1) for k in ([0, 1, 2], [0, 2, 3])]
    faces = np.concatenate((np.delete(four, np.s_[::3], 0), *halves))
    real = faces >= 0
    lon, lat = ((v.ravel()[faces] * real).sum(1) / real.sum(1) for v in (x, y))
    u, v = slices(lon, lat)
    east, north = (
        {"standard_name": "longitude", "units": "degrees_east"},
        {"standard_name": "latitude", "units": "degrees_north"},
    )
    extra = {"mesh": "mesh2d", "location": "face", "units": "m s-1"}
    dims = ("time", "mesh2d_nFaces")
    return save(
        xr.Dataset(
            {
                "mesh2d": (
                    (),
                    0,
                    {"cf_role": "mesh_topology", "face_node_connectivity": "mesh2d_face_nodes"},
                ),
                "mesh2d_node_x": ("mesh2d_nNodes", x.ravel(), east),
                "mesh2d_node_y": ("mesh2d_nNodes", y.ravel(), north),
                "mesh2d_face_x": ("mesh2d_nFaces", lon, east),
                "mesh2d_face_y": ("mesh2d_nFaces", lat, north),
                "mesh2d_face_nodes": (
                    ("mesh2d_nFaces", "most"),
                    np.where(real, faces + 1, -999),
                    {"start_index": 1},
                ),
                "mesh2d_ucx": (dims, u, extra | {"standard_name": "sea_water_x_velocity"}),
                "mesh2d_ucy": (dims, v, extra | {"standard_name": "sea_water_y_velocity"}),
            },
            {"time": TIMES},
        ),
        path,
        mesh2d_face_nodes={"dtype": "int32", "_FillValue": -999},
    )
