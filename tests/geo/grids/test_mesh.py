"""Unstructured files as models write them:

UGRID meshes by what they say, and FVCOM's own attributes.
"""

from pathlib import Path
from typing import Any

import model_writers
import numpy as np
import pytest
import writers
import xarray as xr

from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources
from geo.forcing.sources import Source
from geo.grids.grid import sample
from geo.grids.ugrid import mesh_of

AREA = Box(writers.LON[0], writers.LAT[0], writers.LON[1], writers.LAT[1])
EAST = {"standard_name": "longitude", "units": "degrees_east"}
NORTH = {"standard_name": "latitude", "units": "degrees_north"}


def check(source: Source, places: str, factor: float = 1.0) -> None:
    """The field of the writers, within what its triangles cost: twice that from centres (see
    test_regrid).
    """
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(*writers.LON, 2000), rng.uniform(*writers.LAT, 2000)
    got = sample(source.grid, source.read(0), lon, lat)
    limit = writers.tolerance() * (2.0 if places == "face" else 1.0)
    assert np.abs(got / factor - np.stack(writers.field(lon, lat, 0.0), -1)).max() < limit


def ugrid(
    path: Path, place: str, *, names: str = "mesh_{}_lon mesh_{}_lat", coordinates: str = "node face", transposed: bool = False,
    start: int = 1, fill: int = -999, declared: bool = True, says: bool = True, attributes: bool = True,
) -> Path:  # fmt: skip
    """A mesh of triangles in rows of four, with edges and a second, coarser mesh in the same file;
    u, v at one place.
    """
    lon, lat, cells = model_writers.mesh()
    edges = np.unique(np.sort(np.concatenate((cells[:, :2], cells[:, 1:])), axis=1), axis=0)
    at = {"node": (lon, lat)} | {
        k: (lon[n].mean(1), lat[n].mean(1)) for k, n in (("face", cells), ("edge", edges))
    }
    table = np.concatenate((cells + start, np.full((len(cells), 1), fill)), axis=1).astype(np.int32)
    dims = ("corner", "cell") if transposed else ("cell", "corner")
    dim = {"node": "point", "face": "cell", "edge": "side"}
    topology = {
        "cf_role": "mesh_topology",
        "topology_dimension": 2,
        "face_node_connectivity": "table",
    }
    topology |= {"edge_node_connectivity": "sides", "face_dimension": "cell"}
    topology |= {f"{k}_coordinates": names.format(k, k) for k in coordinates.split()}
    u, v = writers.slices(*at[place])
    more = {"mesh": "mesh", "location": place} if says else {}
    data: dict[str, Any] = {
        "other": (
            (),
            0,
            {
                "cf_role": "mesh_topology",
                "node_coordinates": "olon olat",
                "face_node_connectivity": "otable",
            },
        ),
        "olon": ("opoint", [0.0, 1.0, 0.0, 1.0], EAST),
        "olat": ("opoint", [0.0, 0.0, 1.0, 1.5], NORTH),
        "otable": (("ocell", "three"), [[0, 1, 2], [1, 3, 2]], {"start_index": 0}),
        "mesh": ((), 0, topology),
        "table": (dims, table.T if transposed else table, {"start_index": start}),
        "sides": (("side", "two_ends"), edges + start),
        "u": (
            ("time", dim[place]),
            u,
            {"units": "m/s", "standard_name": "eastward_sea_water_velocity"} | more,
        ),
        "v": (
            ("time", dim[place]),
            v,
            {"units": "m/s", "standard_name": "northward_sea_water_velocity"} | more,
        ),
    }
    for k in coordinates.split():
        for name, values, said in zip(
            names.format(k, k).split(), at[k], (EAST, NORTH), strict=True
        ):
            data[name] = (dim[k], values, said if attributes else {})
    encoding = {"table": {"_FillValue": fill if declared else None}}
    xr.Dataset(data, {"time": writers.TIMES}).to_netcdf(path, encoding=encoding)
    return path


KINDS: dict[str, dict[str, Any]] = {
    "mesh_face_lon": {},
    "mesh2d_face_x": {"names": "mesh2d_{}_x mesh2d_{}_y"},
    "names that say nothing": {"names": "a{} b{}"},
    "latitude first": {"names": "a{} b{}"},
    "neither names nor attributes": {"names": "a{} b{}", "attributes": False},
    "transposed": {"transposed": True},
    "start_index 0, a fill value that nothing declares": {
        "start": 0,
        "fill": 2_000_000_000,
        "declared": False,
    },
    "start_index 1, 0 for none": {"fill": 0, "declared": False},
    "no mesh at the variable": {"says": False},
    "nodes alone": {"coordinates": "node"},
}


@pytest.mark.parametrize(
    ("kind", "place"),
    [(kind, "face") for kind in KINDS] + [(kind, "node") for kind in ("transposed", "nodes alone")],
)
def test_ugrid(kind: str, place: str, tmp_path: Path) -> None:
    path = ugrid(tmp_path / "a.nc", place, **KINDS[kind])
    if kind == "latitude first":
        data = xr.load_dataset(path, decode_times=False, mask_and_scale=False)
        for key in ("node", "face"):
            data["mesh"].attrs[f"{key}_coordinates"] = f"b{key} a{key}"
        data.to_netcdf(path)
    source = sources.open_source("current", path, box=AREA)
    check(source, place)
    assert any(f"values at their {'centres' if place == 'face' else ''}" in n for n in source.notes)


def test_edges_are_refused(tmp_path: Path) -> None:
    for says in (True, False):
        path = ugrid(tmp_path / f"{says}.nc", "edge", says=says, coordinates="node face edge")
        with pytest.raises(
            UserError,
            match=r'"u" is defined on the edges of its mesh \(side\).*variables = \{ east',
        ):
            sources.open_source("current", path)


def test_a_mesh_in_another_file(tmp_path: Path) -> None:
    data = xr.load_dataset(ugrid(tmp_path / "all.nc", "face"), decode_times=False)
    fields = ["u", "v", "time"]
    data[fields].to_netcdf(tmp_path / "his.nc")
    data.drop_vars([*fields, "sides"]).to_netcdf(tmp_path / "grid.nc")
    check(
        sources.open_source("current", [tmp_path / "his.nc", tmp_path / "grid.nc"], box=AREA),
        "face",
    )


def test_the_key_that_a_refusal_names_works(tmp_path: Path) -> None:
    """Coordinates of any name, without a mesh that says what they are."""
    path = ugrid(tmp_path / "a.nc", "face", names="a{} b{}", attributes=False, says=False)
    data = xr.load_dataset(path, decode_times=False)
    data = data.drop_vars(["mesh", "other"])
    data.to_netcdf(tmp_path / "b.nc")
    with pytest.raises(UserError, match=r"variables = \{ lon = \.\.\., lat = \.\.\. \}"):
        sources.open_source("current", tmp_path / "b.nc")
    source = sources.open_source(
        "current", tmp_path / "b.nc", variables={"lon": "aface", "lat": "bface"}, box=AREA
    )
    check(source, "face")


def fvcom(path: Path, **more: Any) -> Path:
    """An FVCOM history file's variables and attributes: winds whose standard name holds a space,
    exact times apart.
    """
    lon, lat, cells = model_writers.mesh()
    lonc, latc = lon[cells].mean(1), lat[cells].mean(1)
    u, v = writers.slices(lonc, latc)
    days = (writers.TIMES - np.datetime64("1858-11-17")) / np.timedelta64(1, "D")
    at = {"grid": "fvcom_grid", "type": "data", "mesh": "fvcom_mesh", "location": "face"}
    layers = np.repeat(np.array([[-0.1], [-0.9]]), len(lon), 1)
    water = {"units": "meters s-1", "coordinates": "time siglay latc lonc"} | at
    wind = {"units": "meters s-1", "coordinates": "time latc lonc"} | at
    mesh = {
        "cf_role": "mesh_topology", "topology_dimension": 2, "node_coordinates": "lon lat",
        "face_coordinates": "lonc latc", "face_node_connectivity": "nv",
    }  # fmt: skip
    three = ("time", "siglay", "nele")
    weight = np.array([1.0, 0.4])[:, None]
    xr.Dataset(
        {
            "fvcom_mesh": ((), 0, mesh),
            "x": ("node", 0.0 * lon, {"long_name": "nodal x-coordinate", "units": "meters"}),
            "lon": ("node", lon, EAST | {"long_name": "nodal longitude"}),
            "lat": ("node", lat, NORTH | {"long_name": "nodal latitude"}),
            "lonc": ("nele", lonc, EAST | {"long_name": "zonal longitude"}),
            "latc": ("nele", latc, NORTH | {"long_name": "zonal latitude"}),
            "nv": (("three", "nele"), (cells.T + 1).astype(np.int32), {"long_name": "nodes surrounding element"}),
            "siglay": (("siglay", "node"), layers, {"standard_name": "ocean_sigma/general_coordinate", "positive": "up"}),
            "Itime": ("time", np.floor(days).astype(np.int32), {"units": "days since 1858-11-17 00:00:00", "format": "modified julian day (MJD)"}),
            "Itime2": ("time", np.rint(days % 1 * 86_400_000).astype(np.int32), {"units": "msec since 00:00:00"}),
            "u": (three, u[:, None] * weight, {"long_name": "Eastward Water Velocity", "standard_name": "eastward_sea_water_velocity"} | water),
            "v": (three, v[:, None] * weight, {"long_name": "Northward Water Velocity", "standard_name": "Northward_sea_water_velocity"} | water),
            "ua": (("time", "nele"), 0.3 * u, {"long_name": "Vertically Averaged x-velocity"} | water),
            "va": (("time", "nele"), 0.3 * v, {"long_name": "Vertically Averaged y-velocity"} | water),
            **{
                name: (("time", "nele"), 8.0 * values, {"long_name": f"{way} Wind Velocity", "standard_name": f"{way.lower()} wind"} | wind)
                for name, values, way in zip(more.get("winds", ("uwind_speed", "vwind_speed")), (u, v), ("Eastward", "Northward"), strict=True)
            },
        }
    ).to_netcdf(path)  # fmt: skip
    return path


@pytest.mark.parametrize("winds", [("uwind_speed", "vwind_speed"), ("U10", "V10"), ("wx", "wy")])
def test_fvcom_winds_and_currents_in_one_file(winds: tuple[str, str], tmp_path: Path) -> None:
    path = fvcom(tmp_path / "a.nc", winds=winds)
    wind = sources.open_source("wind", path, box=AREA)
    assert (wind.times == writers.TIMES.astype("datetime64[s]")).all()
    assert any("found by standard_name eastward_wind" in note for note in wind.notes)
    check(wind, "face", 8.0)
    current = sources.open_source("current", path, box=AREA)
    assert any("from u, v" in note for note in current.notes)
    check(current, "face")


def test_errors_of_a_wind_are_no_wind(tmp_path: Path) -> None:
    """CF's modifiers follow a standard name after a space, as the words of FVCOM's do."""
    path = fvcom(tmp_path / "a.nc", winds=("u10", "v10"))
    data = xr.load_dataset(path, decode_times=False)
    for name in ("u10", "v10"):
        data[name].attrs["standard_name"] += " standard_error"
    data.to_netcdf(tmp_path / "b.nc")
    with pytest.raises(UserError, match="no wind in the wind file"):
        sources.open_source("wind", tmp_path / "b.nc")


def test_points_without_a_place_are_left_out_of_a_triangulation(tmp_path: Path) -> None:
    """No connectivity, and coordinates of which some are missing: the rest is joined; too few are
    refused in a line.
    """
    rng = np.random.default_rng(5)
    lon, lat = rng.uniform(3.0, 6.0, 300), rng.uniform(59.0, 61.0, 300)
    u, v = 0.2 + 0.1 * (lon - 4.0) + 0.03 * (lat - 60.0), 0.1 - 0.05 * (lon - 4.0)
    lon[::17], lat[5::31] = np.nan, np.inf

    def saved(keep: int) -> Path:
        path = tmp_path / f"{keep}.nc"
        part = slice(0, keep)
        xr.Dataset(
            {"u": ("node", u[part], writers.EAST), "v": ("node", v[part], writers.NORTH)},
            {"lon": ("node", lon[part]), "lat": ("node", lat[part])},
        ).to_netcdf(path)
        return path

    source = sources.open_source("current", saved(300), steady=True)
    values = source.read(0)
    x, y = np.meshgrid(source.grid.lon, source.grid.lat)
    inside = np.isfinite(values[..., 0]) & (abs(x - 4.5) < 0.8) & (abs(y - 60.0) < 0.5)
    assert inside.sum() > 100
    # Linear in longitude, interpolated in tangent planes: edges of half a degree at 60 N bow by h^2
    # tan(lat) / 8 = 1e-3 degrees, times the slope of 0.1 a degree.
    np.testing.assert_allclose(
        values[inside][:, 0], (0.2 + 0.1 * (x - 4.0) + 0.03 * (y - 60.0))[inside], atol=1e-4
    )
    with pytest.raises(
        UserError, match="2 points with a longitude and a latitude span no triangle"
    ):
        sources.open_source("current", saved(3), steady=True)


def linear(lon: Any, lat: Any) -> tuple[Any, Any]:
    """A current [m/s] that is linear in degrees, longitudes taken from 180."""
    x = np.asarray(lon) % 360.0 - 180.0
    return 0.3 + 0.2 * x - 0.1 * (np.asarray(lat) - 40.0), -0.1 + 0.15 * x + 0.25 * (
        np.asarray(lat) - 40.0
    )


def polygons(path: Path, *, centred: bool, corners: int, start_index: bool = True) -> Path:
    """Cells of four or six corners over the antimeridian at 40 N, with values at nodes or at
    centres that the file does not give.
    """
    columns, rows = 25, 17
    x, y = np.meshgrid(
        180.0 + 0.08 * (np.arange(columns) - 12), 40.0 + 0.07 * (np.arange(rows) - 8)
    )
    y = y + 0.004 * np.sin(7 * x)  # cells lie askew
    number = np.arange(x.size).reshape(x.shape)
    wide = corners // 2 - 1  # a cell takes so many steps along its row
    low, high = number[:-1], number[1:]
    cells = np.stack(
        [np.concatenate([low[j, i : i + wide + 1], high[j, i : i + wide + 1][::-1]])
         for j in range(rows - 1) for i in range(0, columns - wide, wide)]
    )  # fmt: skip
    lon, lat = (x.ravel() + 180.0) % 360.0 - 180.0, y.ravel()
    at = (x.ravel()[cells].mean(axis=1), lat[cells].mean(axis=1)) if centred else (lon, lat)
    u, v = linear(*at)
    where = "cell" if centred else "node"
    topology = {"cf_role": "mesh_topology", "topology_dimension": 2, "node_coordinates": "lon lat"}
    topology |= {"face_node_connectivity": "nodes", "face_dimension": "cell"}
    more = {"mesh": "mesh", "location": "face" if centred else "node"}
    xr.Dataset(
        {
            "mesh": ((), 0, topology),
            "nodes": (("cell", "corner"), cells + 1, {"start_index": 1} if start_index else {}),
            "u": (where, u, writers.EAST | more),
            "v": (where, v, writers.NORTH | more),
        },
        {"lon": ("node", lon, EAST), "lat": ("node", lat, NORTH)},
    ).to_netcdf(path)
    return path


@pytest.mark.parametrize("transposed", [False, True])
def test_faces_are_the_longer_side_of_their_table(transposed: bool) -> None:
    """Without face_dimension or coordinates of faces, their number is that of the table."""
    table = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2]], np.int32)
    dims = ("corner", "cell") if transposed else ("cell", "corner")
    data = xr.Dataset(
        {
            "mesh": (
                (),
                0,
                {
                    "cf_role": "mesh_topology",
                    "node_coordinates": "lon lat",
                    "face_node_connectivity": "table",
                },
            ),
            "table": (dims, table.T if transposed else table),
            "u": ("cell", np.zeros(4), {"mesh": "mesh", "location": "face"}),
        },
        {"lon": ("node", np.arange(5.0), EAST), "lat": ("node", np.arange(5.0), NORTH)},
    )
    mesh = mesh_of(data, "u", "cell")
    assert mesh is not None
    assert mesh.place == "face"
    assert mesh.dims["face"] == "cell"


@pytest.mark.parametrize("corners", [4, 6])
@pytest.mark.parametrize("centred", [False, True])
def test_polygons_over_the_antimeridian_are_covered_whole(
    corners: int, centred: bool, tmp_path: Path
) -> None:
    """A linear field comes back everywhere inside; polygons cut into the wrong triangles leave
    holes, or overlap.
    """
    path = polygons(tmp_path / "a.nc", centred=centred, corners=corners, start_index=corners == 4)
    source = sources.open_source("current", path, steady=True)
    rng = np.random.default_rng(2)
    lon, lat = 180.0 + rng.uniform(-0.6, 0.6, 3000), 40.0 + rng.uniform(-0.35, 0.35, 3000)
    got = sample(source.grid, source.read(0), lon, lat)
    assert np.isfinite(got).all()
    # Edges of 0.16 degrees at 40 N bow by h^2 tan(lat) / 8 = 5e-5 degrees; centres of a row of
    # nodes lie 1e-5 off their mean.
    assert np.abs(got - np.stack(linear(lon, lat), -1)).max() < (5e-4 if not centred else 3e-3)


def test_points_round_a_bay_are_not_joined_across_it(tmp_path: Path) -> None:
    """Without connectivity the triangulation of a horseshoe of points has long edges over the land
    inside: nothing is there.
    """
    rng = np.random.default_rng(4)
    lon, lat = 0.05 * np.arange(60)[:, None] + 3.0, 0.04 * np.arange(50)[None] + 58.0
    lon, lat = (np.broadcast_to(v, (60, 50)).ravel() for v in (lon, lat))
    land = (np.abs(lon - 4.5) < 0.7) & (lat > 58.5)
    lon, lat = (v[~land] + 0.006 * rng.standard_normal((~land).sum()) for v in (lon, lat))
    xr.Dataset(
        {
            "u": ("node", 0.2 + 0.1 * (lon - 4.0), writers.EAST),
            "v": ("node", 0.1 + 0.05 * (lat - 59.0), writers.NORTH),
        },
        {"lon": ("node", lon), "lat": ("node", lat)},
    ).to_netcdf(tmp_path / "a.nc")
    source = sources.open_source("current", tmp_path / "a.nc", steady=True)
    x, y = rng.uniform(4.0, 5.0, 500), rng.uniform(58.7, 59.8, 500)  # 0.2 degrees from its shore
    assert np.isnan(sample(source.grid, source.read(0), x, y)).all()
    x, y = rng.uniform(3.1, 3.6, 500), rng.uniform(58.1, 59.8, 500)
    assert np.isfinite(sample(source.grid, source.read(0), x, y)).all()
