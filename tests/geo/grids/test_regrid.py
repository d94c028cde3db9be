"""The same field on every kind of grid reads back the same, within the error of bilinear
interpolation.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import model_writers
import numpy as np
import pyproj
import pytest
import writers
import xarray as xr

from geo import sphere
from geo.box import Box
from geo.files import reference_system
from geo.forcing import sources
from geo.forcing.sources import Source
from geo.grids import layout, regrid, rotation
from geo.grids.grid import sample

KINDS: dict[str, Callable[[Path], Any]] = {
    "regular": lambda p: writers.regular(p / "a.nc"),
    "0..360, descending, lon before lat": lambda p: writers.east_of_zero(p / "a.nc"),
    "packed cm/s": lambda p: writers.packed(p / "a.nc"),
    "projected": lambda p: writers.projected(p / "a.nc"),
    "ROMS, rho points and angle": lambda p: model_writers.roms(p / "a.nc"),
    "ROMS, own points, angle in degrees": lambda p: model_writers.roms(
        p / "a.nc", own_points=True, angle="deg"
    ),
    "ROMS, no angle": lambda p: model_writers.roms(p / "a.nc", own_points=True, angle=""),
    "NEMO, U and V files": model_writers.nemo,
    "curved, true components": lambda p: model_writers.curved_true(p / "a.nc"),
    "FVCOM": lambda p: model_writers.fvcom(p / "a.nc"),
    "SCHISM": lambda p: model_writers.schism(p / "a.nc"),
    "rotated pole": lambda p: model_writers.rotated(p / "a.nc"),
    "points repeated for every time": lambda p: model_writers.repeated(p / "a.nc"),
    "points in a grid file": model_writers.apart,
    "D-Flow FM": lambda p: model_writers.dflow(p / "a.nc"),
}
AREA = Box(writers.LON[0], writers.LAT[0], writers.LON[1], writers.LAT[1])


def somewhere(count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.uniform(*writers.LON, count), rng.uniform(*writers.LAT, count)


def worst(source: Source, i: int) -> float:
    """Largest error [m/s] of a slice, sampled as a particle would, against the closed form."""
    lon, lat = somewhere()
    got = sample(source.grid, source.read(i), lon, lat)
    assert np.isfinite(got).all()
    return float(np.abs(got - np.stack(writers.field(lon, lat, 3.0 * i), -1)).max())


@pytest.mark.parametrize(
    "box",
    [pytest.param(None, id="whole", marks=pytest.mark.thorough), pytest.param(AREA, id="cropped")],
)
@pytest.mark.parametrize("kind", KINDS)
def test_same_field_on_every_grid(kind: str, box: Box | None, tmp_path: Path) -> None:
    source = sources.open_source("current", KINDS[kind](tmp_path), box=box)
    assert (source.times == writers.TIMES.astype("datetime64[s]")).all()
    # elements' centres carried to nodes first: means over 3 elements round a node, each 2/3 of a
    # cell away
    extra = 2.0 if kind in ("FVCOM", "D-Flow FM") else 1.0
    assert worst(source, 0) < writers.tolerance() * extra
    assert worst(source, 2) < writers.tolerance() * extra
    values = source.read(1)
    assert values.dtype == np.float32
    assert values.flags.c_contiguous
    assert values.shape == (source.grid.nlat, source.grid.nlon, 2)
    if box is not None:
        assert source.grid.box.west <= box.west
        assert source.grid.box.east >= box.east


@pytest.mark.parametrize("angle", ["rad", "deg"])
def test_a_files_own_angle_is_taken_in_radians_or_degrees(angle: str, tmp_path: Path) -> None:
    """It has no units where it is in degrees; without a word on it directions would be computed
    from the points.
    """
    source = sources.open_source(
        "current", model_writers.roms(tmp_path / "a.nc", own_points=True, angle=angle)
    )
    said = '"angle", in degrees, gives' if angle == "deg" else '"angle" gives'
    assert any(f"{said} the direction of the grid's x axis" in note for note in source.notes)


def test_tolerance_can_fail() -> None:
    """A rotation wrong by one degree would not pass: the tolerance is below what it does to 0.9
    m/s.
    """
    assert writers.tolerance() < 0.9 * np.radians(1.0)


def test_cost_is_told(tmp_path: Path) -> None:
    notes = " ".join(sources.open_source("current", writers.projected(tmp_path / "a.nc")).notes)
    assert "regridding cost: rms error" in notes
    assert "of wet points lost" in notes
    assert "rotated from the projection's axes" in notes


def test_plane_axes_against_pyproj_convergence() -> None:
    """The x axis lies at minus PROJ's meridian convergence from east, whose sign is checked by a
    step to the north.
    """
    crs = pyproj.CRS.from_user_input(writers.STEREO)
    to = pyproj.Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    plane = layout.Plane(np.arange(2.0), np.arange(2.0), np.arange(2), np.arange(2), to)
    lon, lat = np.array([4.0, 70.0, 178.5, -120.0]), np.array([60.0, 75.0, 66.0, 80.0])
    axes = rotation.plane_axes(plane, lon, lat)
    convergence = pyproj.Proj(writers.STEREO).get_factors(lon, lat).meridian_convergence
    north = pyproj.Proj(writers.STEREO)(lon, lat + 1e-5), pyproj.Proj(writers.STEREO)(lon, lat)
    # of true north, clockwise
    checked = np.degrees(np.arctan2(north[0][0] - north[1][0], north[0][1] - north[1][1]))
    # two ways to the sign
    np.testing.assert_allclose((checked + convergence + 180) % 360 - 180, 0, atol=1e-3)
    angle = np.degrees(np.arctan2(axes[:, 1], axes[:, 0]))
    np.testing.assert_allclose((angle - checked + 180) % 360 - 180, 0, atol=1e-3)
    np.testing.assert_allclose(axes[:, 2], -axes[:, 1], atol=1e-6)  # conformal: y is x turned left
    np.testing.assert_allclose(axes[:, 3], axes[:, 0], atol=1e-6)


def test_axes_of_a_plane_whose_x_grows_to_the_west() -> None:
    """By small steps of the plane itself, on the sphere: x and y are left-handed there."""
    crs = "+proj=laea +lat_0=70 +lon_0=-20 +R=6371007 +axis=wnu +type=crs"
    projection = pyproj.Transformer.from_crs(
        crs, "+proj=longlat +R=6371007 +type=crs", always_xy=False
    )
    plane = layout.Plane(np.zeros(2), np.zeros(2), np.zeros(2, int), np.zeros(2, int), projection)
    lon, lat = np.array([-31.0, -12.0, 4.0]), np.array([66.0, 74.0, 59.0])
    axes = rotation.plane_axes(plane, lon, lat)
    x, y = plane.to_plane(lon, lat)
    assert (np.diff(x) < 0).all()
    for k, (dx, dy) in enumerate(((1.0, 0.0), (0.0, 1.0))):
        ahead, behind = plane.to_lonlat(x + dx, y + dy), plane.to_lonlat(x - dx, y - dy)
        way = np.stack(sphere.offset(*np.radians(behind), *np.radians(ahead)), -1)
        np.testing.assert_allclose(
            axes[:, 2 * k : 2 * k + 2], way / np.hypot(*way.T)[:, None], atol=2e-6
        )


def test_curved_angle_at_80_north_and_over_the_antimeridian() -> None:
    to = pyproj.Proj("+proj=stere +lat_0=80 +lon_0=179.5 +R=6371008.8")
    x, y = np.meshgrid(np.arange(-60e3, 60e3, 4e3), np.arange(-50e3, 50e3, 4e3))
    lon, lat = (np.asarray(v) for v in model_writers.turned(to, x, y, 0.6))
    assert lon.min() < -178
    assert lon.max() > 178
    east0, north0 = to(lon, lat)
    east1, north1 = to(lon, lat + 1e-6)
    wanted = 0.6 - (np.arctan2(north1 - north0, east1 - east0) - np.pi / 2)
    apart = (rotation.curved_angle(lon, lat) - wanted + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(apart).max() < 1e-5 * 10  # second order: (4 km / R)^2 tan(80 deg) is 2e-6


def test_curved_grid_over_the_antimeridian(tmp_path: Path) -> None:
    """A turned grid about (180, -17) with longitudes that jump from 180 to -180 inside it."""
    to = pyproj.Proj("+proj=stere +lat_0=-17 +lon_0=180 +R=6371000")
    x, y = np.meshgrid(np.arange(-250e3, 250e3, 6e3), np.arange(-200e3, 200e3, 6e3))
    lon, lat = model_writers.turned(to, x, y, np.radians(20))

    def field(lon: Any, lat: Any) -> tuple[Any, Any]:
        d = (lon - 180.0 + 180.0) % 360.0 - 180.0
        return 0.3 + 0.2 * d, -0.1 + 0.1 * (lat + 17.0) - 0.05 * d

    u, v = field(lon, lat)
    a, b = writers.in_plane(to, lon, lat, u, v)
    turn = np.radians(20)
    a, b = a * np.cos(turn) + b * np.sin(turn), -a * np.sin(turn) + b * np.cos(turn)
    data = xr.Dataset(
        {"u": (("j", "i"), a, writers.ALONG_X), "v": (("j", "i"), b, writers.ALONG_Y)},
        {"lon": (("j", "i"), lon), "lat": (("j", "i"), lat)},
    )
    data.to_netcdf(tmp_path / "a.nc")
    for box in (None, Box(179.0, -18.0, 181.0, -16.0)):
        source = sources.open_source("current", tmp_path / "a.nc", steady=True, box=box)
        assert source.grid.nlon < 400  # and not the whole Earth round
        rng = np.random.default_rng(1)
        lon, lat = rng.uniform(179.0, 181.0, 500), rng.uniform(-18.0, -16.0, 500)
        got = sample(source.grid, source.read(0), lon, lat)
        # linear field: only components turning within a cell are left, 6 km / R * tan(17) * 0.5 m/s
        # and float32
        np.testing.assert_allclose(got, np.stack(field(lon, lat), -1), atol=5e-4)


def test_a_plane_that_holds_the_pole(tmp_path: Path) -> None:
    """All longitudes round the pole: the tile is seamless, and has values up to the pole."""
    to = pyproj.Proj(writers.STEREO)
    # the pole lies amid a cell
    x, y = np.arange(-2.475e6, 2.5e6, 50e3), np.arange(-1.975e6, 2.6e6, 50e3)
    lon, lat = to(*np.meshgrid(x, y), inverse=True)

    def field(lon: Any, lat: Any) -> tuple[Any, Any]:
        return 0.3 + 0.1 * np.cos(np.radians(lon)), 0.2 * np.sin(np.radians(2 * lon)) + 0.01 * (
            lat - 80
        )

    a, b = writers.in_plane(to, lon, lat, *field(lon, lat))
    mapping = pyproj.CRS.from_user_input(writers.STEREO).to_cf()
    axes = {"X": ("X", x / 1e3, {"units": "km"}), "Y": ("Y", y / 1e3, {"units": "km"})}
    extra = {"grid_mapping": "crs"}
    xr.Dataset(
        {
            "u": (("Y", "X"), a, writers.ALONG_X | extra),
            "v": (("Y", "X"), b, writers.ALONG_Y | extra),
            "crs": ((), 0, mapping),
        },
        axes,
    ).to_netcdf(tmp_path / "a.nc")
    rng = np.random.default_rng(4)
    for box in (None, Box(170.0, 78.0, 200.0, 85.0)):
        source = sources.open_source("current", tmp_path / "a.nc", steady=True, box=box)
        assert source.grid.seamless == (box is None)
        assert (source.grid.lat[-1] == pytest.approx(90.0)) == (box is None)
        lon, lat = (
            rng.uniform(*((170.0, 200.0) if box else (-180.0, 180.0)), 2000),
            rng.uniform(78.0, 85.0, 2000),
        )
        got = sample(source.grid, source.read(0), lon, lat)
        # a 50 km cell is 5 degrees of longitude at 85 N: (0.09 rad)^2 / 8 of vectors that turn once
        # and twice round
        np.testing.assert_allclose(
            got, np.stack(field(lon, lat), -1), atol=(3**2 * 0.3) * 0.09**2 / 8 * 2
        )


def test_mercator_spacing_is_carried(tmp_path: Path) -> None:
    # Mercator's own steps
    lat = np.degrees(np.arctan(np.sinh(np.radians(np.arange(70.0, 76.0, 0.1)))))
    lon = np.arange(1.0, 7.0, 0.1)
    u, v = writers.slices(*np.meshgrid(lon, lat))
    dims = ("time", "lat", "lon")
    xr.Dataset(
        {"uo": (dims, u, writers.EAST), "vo": (dims, v, writers.NORTH)},
        {"time": writers.TIMES, "lat": lat, "lon": lon},
    ).to_netcdf(tmp_path / "a.nc")
    source = sources.open_source("current", tmp_path / "a.nc")
    assert source.grid.dlon == pytest.approx(0.1)
    assert source.grid.dlat < 0.03  # half of 0.1 cos(60 N)
    assert worst(source, 1) < writers.tolerance()


def test_land_keeps_its_outline(tmp_path: Path) -> None:
    """Nodes whose weight on water is under one half are missing; the loss is told; water never
    turns to zero.
    """
    path = model_writers.roms(tmp_path / "a.nc", own_points=True)
    data = xr.open_dataset(path).load()
    data.close()
    for name in ("u", "v"):
        lon, lat = data[f"lon_{name}"].values, data[f"lat_{name}"].values
        land = np.hypot((lon - 4.0) * 0.515, lat - 59.0) < 0.3
        data[name] = data[name].where(~xr.DataArray(land, dims=data[f"lon_{name}"].dims))
    data.to_netcdf(tmp_path / "b.nc")
    source = sources.open_source("current", tmp_path / "b.nc", box=AREA)
    lon, lat = np.meshgrid(source.grid.lon, source.grid.lat)
    away = np.hypot((lon - 4.0) * 0.515, lat - 59.0)
    dry = np.isnan(source.read(0)[..., 0])
    assert dry[away < 0.3 - 1.5 * writers.CELL].all()
    assert not dry[away > 0.3 + 1.5 * writers.CELL].any()
    # at the rim a present node is a mean of wet neighbours within a cell: first order in the cell
    wet = ~dry
    error = np.abs(source.read(0)[wet] - np.stack(writers.field(lon[wet], lat[wet], 0.0), -1)).max()
    assert error < 0.5 * (writers.KX * 2 + writers.KY) * writers.CELL * 1.5
    lost = float(source.notes[-1].split(", ")[-1].split("%")[0])
    assert 0 < lost < 5


def test_coarse_triangles_larger_than_the_box(tmp_path: Path) -> None:
    source = sources.open_source(
        "current", model_writers.schism(tmp_path / "a.nc"), box=Box(4.01, 59.01, 4.02, 59.015)
    )
    got = sample(source.grid, source.read(0), [4.015], [59.012])
    np.testing.assert_allclose(got[0], writers.field(4.015, 59.012, 0.0), atol=writers.tolerance())


def test_triangles_are_capped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from geo.grids import target

    monkeypatch.setattr(target, "MOST_NODES", 500)
    source = sources.open_source("current", model_writers.schism(tmp_path / "a.nc"))
    assert source.grid.nlon * source.grid.nlat <= 600
    assert any("coarser" in note for note in source.notes)


@pytest.mark.parametrize(
    "earth",
    [{}, {"earth_radius": 6.371e6}, {"semi_major_axis": 6378137.0, "semi_minor_axis": 6356752.0}],
)
def test_a_reference_system_is_that_of_pyproj(earth: dict[str, float]) -> None:
    """Though pyproj is told where Greenwich is, which it would look up in half a second."""
    pole = {"grid_north_pole_latitude": 40.0, "grid_north_pole_longitude": -170.0}
    mapping = {"grid_mapping_name": "rotated_latitude_longitude"} | pole | earth
    for more in ({}, {"longitude_of_prime_meridian": 2.5}):
        assert (
            reference_system.parse_reference_system(mapping | more).to_json()
            == pyproj.CRS.from_cf(mapping | more).to_json()
        )


@pytest.mark.parametrize(
    ("kind", "times"), [("curved, true components", 1), ("ROMS, own points, angle in degrees", 2)]
)
def test_points_that_both_components_share_are_weighed_once(
    kind: str, times: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []
    weights = regrid.weights
    monkeypatch.setattr(
        regrid, "weights", lambda *given: (made.append(given[0]), weights(*given))[1]
    )
    sources.open_source("current", KINDS[kind](tmp_path))
    assert len(made) == times
