"""Grids that go round the Earth and over its pole: nothing is missing that is inside, and vectors
are right.

The oracle is a rigid rotation about a tilted axis, smooth everywhere, at the pole as well.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from geo.box import Box
from geo.forcing import sources
from geo.forcing.sources import Source
from geo.grids.grid import sample
from geo.sphere import RADIUS

Array = Any
AXIS = np.array([0.42, -0.31, 0.85])  # of the rotation, [m/s] at the surface
JOINT = 58.0  # [deg N] where the cap with two poles begins
POLE = 73.0  # [deg E] of one of them, and of the seam; the other lies opposite
LAND = 14.0  # [deg] round the cap's poles
NX = 120  # columns: 3 degrees
STEP = 2 * np.pi / NX  # [rad]
X = {"units": "m/s", "standard_name": "sea_water_x_velocity"}
Y = {"units": "m/s", "standard_name": "sea_water_y_velocity"}
EAST = {"units": "m/s", "standard_name": "eastward_sea_water_velocity"}
NORTH = {"units": "m/s", "standard_name": "northward_sea_water_velocity"}
SOUTH = -84.0  # row, counted from the fold: 67 S


def place(lon: Array, lat: Array) -> Array:
    """Unit vectors (..., 3) of points [deg]."""
    x, y = np.radians(lon), np.radians(lat)
    return np.stack(
        np.broadcast_arrays(np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)), -1
    )


def truth(lon: Array, lat: Array) -> Array:
    """True (east, north) [m/s] of the rotation, (..., 2)."""
    here, velocity = np.radians(lon), np.cross(AXIS, place(lon, lat))
    east = np.stack((-np.sin(here), np.cos(here), 0 * here), -1)
    return np.stack(
        ((velocity * east).sum(-1), (velocity * np.cross(place(lon, lat), east)).sum(-1)), -1
    )


def tripolar(i: Array, r: Array) -> tuple[Array, Array]:
    """(lon, lat) [deg] of points i columns east of the seam and r rows north of the fold, both any
    real numbers.

    Mercator's rows up to JOINT; then Murray's (1996, doi:10.1006/jcph.1996.0136) bipolar cap: in
    the stereographic plane whose unit circle is JOINT, z = tanh(zeta / 2) maps the strip |Im zeta|
    < pi / 2 to the disc, its middle line to the fold. Both are conformal.
    """
    x, rise = np.broadcast_arrays(np.asarray(i) * STEP % (2 * np.pi), np.asarray(r) * STEP)
    top = np.arctanh(np.sin(np.radians(JOINT)))
    low = np.arcsin(np.tanh(top + np.pi / 2 + np.minimum(rise, -np.pi / 2)))
    turn = np.where(x > np.pi, -1.0, 1.0)
    half = np.clip(np.where(x > np.pi, 2 * np.pi - x, x) / 2, 1e-9, np.pi / 2 - 1e-9)
    z = np.tanh((-np.log(np.tan(half)) - 1j * turn * np.maximum(rise, -np.pi / 2)) / 2)
    high = np.pi / 2 - 2 * np.arctan(np.abs(z) * np.tan(np.radians(90.0 - JOINT) / 2))
    cap = rise > -np.pi / 2
    lon = np.degrees(np.where(cap, np.angle(z), x)) + POLE
    return (lon + 180.0) % 360.0 - 180.0, np.degrees(np.where(cap, high, low))


def along(i: Array, r: Array) -> tuple[Array, Array]:
    """The rotation's components along the grid's own axes, whose x axis is found by a small step
    along the row.
    """
    here = place(*tripolar(i, r))
    axis = place(*tripolar(i + 1e-5, r)) - place(*tripolar(i - 1e-5, r))
    # none at the poles of the cap
    axis /= np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-30)
    velocity = np.cross(AXIS, here)
    return (velocity * axis).sum(-1), (velocity * np.cross(here, axis)).sum(-1)


def dry(lon: Array, lat: Array, radius: float = LAND) -> Array:
    """Land round both poles of the cap and a continent over the equator, at the seam."""
    islands = [
        (POLE, JOINT, radius),
        (POLE - 180.0, JOINT, radius),
        (POLE + 4.0, -20.0, radius - 2.0),
    ]
    near = [
        (place(lon, lat) * place(x, y)).sum(-1) > np.cos(np.radians(size)) for x, y, size in islands
    ]
    return np.any(near, axis=0)


def orca(
    path: Path, *, pivot: str = "T", halo: int = 1, axes: str = "grid", staggered: bool = True, blocks: bool = False,
    north_first: bool = False,
) -> list[Path]:  # fmt: skip
    """NEMO's grid_U and grid_V files; pivot: which points lie on the fold; halo: columns and rows
    stored twice.
    """
    column = np.arange(-halo, NX + halo) + 0.5
    row = np.arange(SOUTH, 0.5 if pivot == "T" else 0.0) + (0.0 if pivot == "T" else 0.5)
    row = np.append(row, row[-1] + 1 + np.arange(halo))
    paths = []
    for k, name in enumerate(("vozocrtx", "vomecrty")):
        shift = (0.5, 0.0) if k == 0 else (0.0, 0.5)
        i, r = np.meshgrid(column + staggered * shift[0], row + staggered * shift[1])
        lon, lat = tripolar(i, r)
        values = along(i, r)[k] if axes == "grid" else truth(lon, lat)[..., k]
        values = np.where(dry(lon, lat), np.nan, values)
        if halo:  # what stands in a halo is nobody's business
            values[:, :halo] = values[:, -halo:] = values[-halo:] = -0.7
        if blocks:
            inner = dry(lon, lat, LAND - 6.0)
            lon, lat, values = (
                np.where(inner, fill, v) for v, fill in ((lon, 0.0), (lat, 0.0), (values, np.nan))
            )
        order = slice(None, None, -1) if north_first else slice(None)
        named = (X, Y)[k] if axes == "grid" else (EAST, NORTH)[k]
        data = xr.Dataset(
            {
                name: (("y", "x"), values[order], named | {"coordinates": "nav_lon nav_lat"}),
                "nav_lon": (("y", "x"), lon[order], {"units": "degrees_east"}),
                "nav_lat": (("y", "x"), lat[order], {"units": "degrees_north"}),
            }
        )
        paths.append(path / f"grid_{'UV'[k]}.nc")
        data.to_netcdf(paths[-1])
    return paths


BOXES = {
    "whole": None,
    "the seam": Box(60.0, -45.0, 90.0, -35.0),
    "the seam in the cap": Box(60.0, 78.0, 95.0, 86.0),
    "the fold": Box(-70.0, 84.0, -20.0, 88.0),
    "the antimeridian": Box(172.0, -12.0, 191.0, 9.0),
    "88 N": Box(-180.0, 86.0, 180.0, 89.0),
    "a strip round the Earth": Box(-180.0, 20.0, 180.0, 30.0),
    "more than half the Earth": Box(100.0, -30.0, 350.0, 30.0),
}


def wet(box: Box | None, count: int = 4000) -> tuple[Array, Array]:
    """Random points in a box, evenly over the sphere, away from land by two cells."""
    rng = np.random.default_rng(11)
    west, south, east, north = (
        (box.west, box.south, box.east, box.north) if box else (-180.0, -65.0, 180.0, 89.0)
    )
    lon = rng.uniform(west, east, count)
    edges = np.sin(np.radians([south, min(north, 89.0 - 1e-6)]))
    lat = np.degrees(np.arcsin(rng.uniform(*edges, count)))
    keep = ~dry(lon, lat, LAND + 6.0)
    return lon[keep], lat[keep]


def check(source: Source, box: Box | None, true: bool = False) -> float:
    """Nothing that is inside is missing, and vectors are right within what both interpolations
    cost; the largest error.

    h^2 / 8 |f''| for the grid and for the tile: f'' is 1 for the rotation, and 2 / d^2 more for
    east and north, which turn round the pole at a distance d: in the tile, and in files of true
    components. The grid's own axes cost nothing.
    """
    lon, lat = wet(box)
    got = sample(source.grid, source.read(0), lon, lat)
    assert np.isfinite(got).all(), f"{np.isnan(got).any(-1).mean():.1%} of wet points are missing"
    off = np.linalg.norm(got - truth(lon, lat), axis=-1)
    turning = np.radians(source.grid.dlon) ** 2  # (dlon cos(lat))^2 / cos(lat)^2
    pole = np.radians(90.0 - np.abs(lat)) if true else np.inf
    limit = (STEP**2 * (1 + 2 / pole**2) + turning * 2 + np.radians(source.grid.dlat) ** 2) / 8
    assert (off < limit).all(), f"{(off / limit).max():.2f} of the limit"
    return float(off.max())


@pytest.mark.parametrize("box", BOXES)
def test_tripolar_boxes(box: str, tmp_path: Path) -> None:
    source = sources.open_source("current", orca(tmp_path), steady=True, box=BOXES[box])
    print(f"{box}: largest error {check(source, BOXES[box]):.4f} m/s of 1")


KINDS = {
    "F pivot": {"pivot": "F"},
    "two halos": {"halo": 2},
    "F pivot, no halo": {"pivot": "F", "halo": 0},
    "T pivot, no halo": {"halo": 0},
    "true components, no halo": {"axes": "true", "pivot": "F", "halo": 0, "staggered": False},
    "blocks at (0, 0)": {"blocks": True},
    "north first": {"north_first": True, "axes": "true"},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("box", [pytest.param("whole", marks=pytest.mark.thorough), "the fold"])
def test_tripolar_kinds(kind: str, box: str, tmp_path: Path) -> None:
    source = sources.open_source(
        "current", orca(tmp_path, **KINDS[kind]), steady=True, box=BOXES[box]
    )
    check(source, BOXES[box], KINDS[kind].get("axes") == "true")


def regular(path: Path, *, halo: int, descending: bool, first: float, wave: bool) -> Path:
    """Longitudes and latitudes in two dimensions, regular in index; wave: rows that are no
    parallels.
    """
    lon, lat = np.meshgrid(first + 2.5 * np.arange(-halo, 144 + halo), np.arange(-70.0, 89.1, 2.5))
    if wave:
        lat = lat + 0.5 * np.sin(np.radians(3 * lon)) * np.cos(np.radians(lat)) ** 2
    order = slice(None, None, -1 if descending else 1)
    values = truth(lon, lat)
    lon = (lon - first) % 360.0 + first if halo == 0 else lon % 360.0
    xr.Dataset(
        {
            "uo": (("y", "x"), values[order, :, 0], EAST),
            "vo": (("y", "x"), values[order, :, 1], NORTH),
            "lon": (("y", "x"), lon[order], {"units": "degrees_east"}),
            "lat": (("y", "x"), lat[order], {"units": "degrees_north"}),
        }
    ).to_netcdf(path)
    return path


@pytest.mark.parametrize("wave", [False, True], ids=["rectilinear", "curved"])
@pytest.mark.parametrize("box", [None, Box(172.0, -12.0, 191.0, 9.0)], ids=["whole", "180"])
@pytest.mark.parametrize(
    ("halo", "descending", "first"),
    [(0, False, 0.0), (1, True, 0.0), (2, False, -180.0), (0, True, 74.0)],
)
def test_regular_in_index(
    halo: int, descending: bool, first: float, box: Box | None, wave: bool, tmp_path: Path
) -> None:
    path = regular(tmp_path / "a.nc", halo=halo, descending=descending, first=first, wave=wave)
    source = sources.open_source("current", path, steady=True, box=box)
    assert source.grid.seamless == (box is None)
    lon, lat = wet(box or Box(-180.0, -65.0, 180.0, 80.0), 1000)
    got = sample(source.grid, source.read(0), lon, lat)
    assert np.isfinite(got).all()
    # east and north turn round the pole, which is 10 degrees away or more: in the source's cells
    # and in the tile's
    turning = 1 + 2 / np.radians(90.0 - np.abs(lat)) ** 2
    limit = 2 * np.radians(2.5) ** 2 * turning / 8
    assert (np.linalg.norm(got - truth(lon, lat), axis=-1) < limit).all()


def turned(lon: float, lat: float, hours: float) -> Array:
    """Where the rotation carries a point in some hours:

    Rodrigues's formula in float64, a unit vector.
    """
    here, axis, angle = (
        place(lon, lat),
        AXIS / np.linalg.norm(AXIS),
        np.linalg.norm(AXIS) * hours * 3600 / RADIUS,
    )
    along_axis = axis * (axis * here).sum() * (1 - np.cos(angle))
    return here * np.cos(angle) + np.cross(axis, here) * np.sin(angle) + along_axis


@pytest.mark.parametrize(
    ("name", "lon", "lat"),
    [
        ("seam", POLE - 0.3, -45.0),
        ("antimeridian", 179.2, -8.0),
        ("fold", -40.0, 82.5),
        ("near the pole", 150.0, 86.6),
    ],
)
def test_a_drifter_of_48_hours(name: str, lon: float, lat: float, tmp_path: Path) -> None:
    """Runge and Kutta's steps of 15 minutes through the tile as particles see it, against the
    closed form.
    """
    box = Box(lon - 12.0, max(lat - 5.0, -89.0), lon + 12.0, min(lat + 5.0, 89.0))
    box = Box(-180.0, 79.0, 180.0, 89.0) if lat > 80.0 else box
    source = sources.open_source("current", orca(tmp_path), steady=True, box=box)
    values, x, y, step = source.read(0), np.radians(lon), np.radians(lat), 900.0

    def rate(x: float, y: float) -> tuple[float, float]:
        u, v = sample(source.grid, values, [np.degrees(x)], [np.degrees(y)])[0]
        return u / (RADIUS * np.cos(y)), v / RADIUS

    for _ in range(192):
        a = rate(x, y)
        b = rate(x + a[0] * step / 2, y + a[1] * step / 2)
        c = rate(x + b[0] * step / 2, y + b[1] * step / 2)
        d = rate(x + c[0] * step, y + c[1] * step)
        x, y = (q + step * (a[k] + 2 * b[k] + 2 * c[k] + d[k]) / 6 for k, q in enumerate((x, y)))
    end, way = turned(lon, lat, 48.0), float(np.linalg.norm(truth(lon, lat))) * 48 * 3600
    off = float(np.linalg.norm(place(np.degrees(x), np.degrees(y)) - end)) * RADIUS
    print(f"{name}: {off:.1f} m of {way / 1e3:.1f} km, {off / way:.4%}")
    grid = source.grid  # what `check` allows, all the way in one direction
    limit = (STEP**2 + 2 * np.radians(grid.dlon) ** 2 + np.radians(grid.dlat) ** 2) / 8
    assert off < limit * 48 * 3600
