"""Zeros that are land are decided once a source, whatever the domain."""

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr
from surveyed_files import HOURS, LAT, LON, SMALL, case, fields, saved, shore

import drift
from geo.box import Box
from geo.forcing import sources
from geo.grids import fill
from geo.grids.grid import Grid, sample


def zero_land(path: Path) -> tuple[Path, Any, Any, Any]:
    """A file whose land is zero and whose south-west corner is missing; its values, and where the
    land is.
    """
    u, v = fields()
    land = shore(*np.meshgrid(LON, LAT))
    u[:, land], v[:, land] = 0.0, 0.0
    u[:, :12, :9], v[:, :12, :9] = np.nan, np.nan
    return saved(path, u, v), u, v, land


WIDE = {"west": 2.0, "south": 57.0, "east": 8.0, "north": 63.0}


def ends(folder: Path, files: Path, domain: dict[str, float]) -> Any:
    tracks = drift.run(case(folder, domain, files=files)).trajectories
    return tracks.lon, tracks.lat, tracks.status


@pytest.mark.thorough
def test_zeros_that_are_land_are_land_whatever_the_domain(tmp_path: Path) -> None:
    """Land is zero and a far corner is missing: two domains, one with that corner, give the same
    tracks.

    Taken as still water, land within one domain alone moved these tracks by kilometres. Places in a
    tile are float32 numbers of cells from its own corner, here up to 60, so 4e-6 of a cell: 0.02 m
    in a field that changes by a tenth a cell.
    """
    path = zero_land(tmp_path / "a.nc")[0]
    small, wide = ends(tmp_path, path, SMALL), ends(tmp_path, path, WIDE)
    assert (small[2][:, -1] == 0).sum() > 20
    # those that stay inside both
    afloat = (small[2] == wide[2]).all(axis=1) & (small[2][:, -1] == 0)
    assert afloat.sum() > 20
    for a, b in zip(small[:2], wide[:2], strict=True):
        assert np.abs(a[afloat].astype(int) - b[afloat])[:, -1].max() * 0.0093 < 0.1  # [m]
    for box in (Box(3.5, 58.9, 7.5, 61.6), Box(2.0, 57.0, 8.0, 63.0), None):
        source = sources.open_source("current", path, box=box)
        values = source.read(3)
        lon, lat = np.meshgrid(source.grid.lon, source.grid.lat)
        inside = lat > 58.0
        np.testing.assert_array_equal(np.isnan(values[..., 0])[inside], shore(lon, lat)[inside])
        assert any(
            "exactly zero at all 8 times looked at: taken as land" in note for note in source.notes
        )


def test_tracks_beside_zero_land_are_those_of_a_float64_integration(tmp_path: Path) -> None:
    """Where three nodes round a particle are wet, RK4 in float64 on the raw values gives the same
    track to metres.
    """
    path, u, v, land = zero_land(tmp_path / "a.nc")
    sure = drift.vary(case(tmp_path, WIDE, files=path), {"uncertainty": "none"})
    tracks = drift.run(sure).trajectories
    grid = Grid(float(LON[0]), float(LAT[0]), 0.1, 0.05, len(LON), len(LAT))
    u[:, land], v[:, land] = np.nan, np.nan
    both = np.stack((u, v), axis=-1)

    def velocity(lon: Any, lat: Any, hour: float) -> Any:
        k = min(int(hour // 6), len(HOURS) - 2)
        share = hour / 6 - k
        gone = ~np.isfinite(lon + lat)  # it met a missing corner: NaN from there on
        at = np.where(gone, 4.6, lon), np.where(gone, 60.0, lat)
        result = (1 - share) * sample(grid, both[k], *at) + share * sample(grid, both[k + 1], *at)
        return np.where(gone[:, None], np.nan, result)

    degrees = 180 / np.pi / 6_371_008.8
    lon, lat = (np.asarray(c[:, 0], float) * 360 / 2**32 for c in (tracks.lon, tracks.lat))
    way = np.zeros(len(lon))
    h = 0.5
    for n in range(192):
        stages = []
        for back, t in ((None, 0.0), (0, h / 2), (1, h / 2), (2, h)):
            at = (
                (lon, lat)
                if back is None
                else (lon + t * stages[back][0], lat + t * stages[back][1])
            )
            e, nn = velocity(*at, n * h + t).T * 3600 * degrees
            stages.append((e / np.cos(np.radians(at[1])), nn))
        step = [
            sum(w * s[i] for w, s in zip((1, 2, 2, 1), stages, strict=True)) * h / 6 for i in (0, 1)
        ]
        way += np.hypot(step[0] * np.cos(np.radians(lat)), step[1]) / degrees
        lon, lat = lon + step[0], lat + step[1]
    last = [np.asarray(c[:, -1], float) * 360 / 2**32 for c in (tracks.lon, tracks.lat)]
    apart = np.hypot((last[0] - lon) * np.cos(np.radians(lat)), last[1] - lat) / degrees
    free = np.isfinite(apart)  # the oracle fills no coast: it ends where a corner is missing
    assert free.sum() > 12
    print(
        f"median {np.median(apart[free]):.2f} m, worst {apart[free].max():.2f} m, {(apart / way)[free].max():.2e} of the way"
    )
    # 192 steps of float32 increments (1e-7 of some 700 m each) and of 9 mm positions, grown by the
    # shear and by velocities off by 4e-7 m/s for 96 h, 0.14 m
    assert apart[free].max() < 0.3


def test_zeros_packed_with_an_offset_are_zeros_too(tmp_path: Path) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, land], v[:, land] = 0.0, 0.0
    path = saved(
        tmp_path / "a.nc",
        u,
        v,
        dtype="int16",
        scale_factor=np.float32(0.00031),
        add_offset=np.float32(0.2337),
    )
    with netCDF4.Dataset(path) as raw:
        assert (raw["uo"][0][land] != 0).all()  # none of them decodes to zero
    source = sources.open_source("current", path)
    np.testing.assert_array_equal(np.isnan(source.read(5)[..., 0]), land)


def test_still_water_stays_where_the_file_or_the_case_says_so(tmp_path: Path) -> None:
    u, v = fields()
    u[:, 20:40, 20:40], v[:, 20:40, 20:40] = 0.0, 0.0
    path = saved(tmp_path / "a.nc", u, v)
    assert sources.open_source("current", path, variables={"mask": "none"}).missing == 0
    u[3:6] = 0.0  # slack everywhere for a while is no land
    v[3:6] = 0.0
    u[:3, 20:40, 20:40] = 0.01
    assert sources.open_source("current", saved(tmp_path / "b.nc", u, v)).missing == 0
    calm = saved(tmp_path / "c.nc", 0 * u, 0 * v)
    assert sources.open_source("current", calm).missing == 0


@pytest.mark.parametrize("later", [0, 1])
def test_zeros_of_files_that_are_packed_differently(later: int, tmp_path: Path) -> None:
    """Whichever of the two comes first in time: each number is zero by its own file's packing."""
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, land], v[:, land] = 0.0, 0.0
    packings = ((0.00031, 0.2337), (0.00047, 0.0))
    paths = [
        saved(
            tmp_path / f"{k}.nc",
            u,
            v,
            hours=HOURS + 100 * (k == later),
            dtype="int16",
            scale_factor=a,
            add_offset=b,
        )
        for k, (a, b) in enumerate(packings)
    ]
    source = sources.open_source("current", paths)
    for k in (0, 20):
        np.testing.assert_array_equal(np.isnan(source.read(k)[..., 0]), land)


def test_only_both_components_at_zero_are_land_and_missing_values_are_not_called_zero(
    tmp_path: Path,
) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, 10:25], v[:, :, 5:9] = 0.0, 0.0  # flows due north, and due east
    missing = saved(tmp_path / "a.nc", np.where(land, np.nan, u), np.where(land, np.nan, v))
    both = np.zeros(land.shape, bool)
    both[10:25, 5:9] = True  # 60 points where they cross, 0.8 %: still water, taken as land
    source = sources.open_source("current", missing)
    np.testing.assert_array_equal(np.isnan(source.read(4)[..., 0]), land | both)
    zero = saved(tmp_path / "b.nc", np.where(land, 0.0, u + 1e-3 * both), np.where(land, 0.0, v))
    np.testing.assert_array_equal(
        np.isnan(sources.open_source("current", zero).read(4)[..., 0]), land
    )
    plain = fields()
    source = sources.open_source(
        "current", saved(tmp_path / "c.nc", *(np.where(land, np.nan, w) for w in plain))
    )
    assert not any("exactly zero" in note for note in source.notes)


def test_a_mask_says_which_of_its_values_is_water_and_one_of_ones_says_nothing(
    tmp_path: Path,
) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    land = shore(x, y)
    u[:, land], v[:, land] = 0.0, 0.0
    masks = {
        "plain": ((~land).astype("int8"), {}),
        "flags": (
            land.astype("int8"),
            {"flag_values": np.int8([0, 1]), "flag_meanings": "water land"},
        ),
        "ones": (np.ones(land.shape, "int8"), {}),
    }
    for name, (values, said) in masks.items():
        path = saved(tmp_path / f"{name}.nc", u, v)
        with xr.open_dataset(path, decode_times=False) as data:
            data.load().assign(tmask=(("lat", "lon"), values, said)).to_netcdf(
                tmp_path / f"{name}2.nc"
            )
        source = sources.open_source("current", tmp_path / f"{name}2.nc")
        np.testing.assert_array_equal(np.isnan(source.read(2)[..., 0]), land, err_msg=name)


@pytest.mark.parametrize(("points", "dry"), [(61, True), (30, False)])
def test_over_half_a_percent_of_zeros_is_land_and_less_is_not(
    points: int, dry: bool, tmp_path: Path
) -> None:
    """61 points of 7,381 are 0.8 %, 30 are 0.4 %; at the first time, which is looked at, they are
    missing.
    """
    u, v = fields()
    u[:, -1, :points], v[:, -1, :points] = 0.0, 0.0
    u[0, -1], v[0, -1] = np.nan, np.nan
    source = sources.open_source("current", saved(tmp_path / "a.nc", u, v))
    assert np.isnan(source.read(5)[-1, :30]).all() == dry
    assert np.isfinite(source.read(5)[:-1]).all()


def test_a_lee_of_stokes_drift_is_no_land_where_land_is_missing(tmp_path: Path) -> None:
    u, v = fields()
    x, y = np.meshgrid(LON, LAT)
    u[:, shore(x, y)], v[:, shore(x, y)] = np.nan, np.nan
    u[:, 40:60, 20:30], v[:, 40:60, 20:30] = 0.0, 0.0
    chosen = {"east": "uo", "north": "vo"}
    source = sources.open_source("stokes", saved(tmp_path / "a.nc", u, v), variables=chosen)
    np.testing.assert_array_equal(np.isnan(source.read(4)[..., 0]), shore(x, y))


def test_what_stands_still_until_the_last_times_is_water(tmp_path: Path) -> None:
    """A river that starts to flow after three quarters of the file: all eight slices count, to the
    last.

    It does not make land of 30 points that are still all the time: they are too few.
    """
    u, v = fields()
    u[:, -1, :30], v[:, -1, :30] = 0.0, 0.0
    u[:13, 50:70, 10:20], v[:13, 50:70, 10:20] = 0.0, 0.0
    source = sources.open_source("current", saved(tmp_path / "a.nc", u, v))
    assert source.missing == 0
    assert all(np.isfinite(source.read(k)).all() for k in (0, 12, 16))


def test_water_that_flows_due_east_makes_no_land_of_a_few_still_points(tmp_path: Path) -> None:
    """A quarter of one component is zero, but only 30 points of 7,381 are in both: too few to be
    land.
    """
    u, v = fields()
    u[:, 10:40] = 0.0
    v[:, 12, 10:40] = 0.0
    source = sources.open_source("current", saved(tmp_path / "a.nc", u, v))
    assert np.isfinite(source.read(5)).all()


def test_a_calm_is_no_land(tmp_path: Path) -> None:
    """Winds blow over land too, and are zero in a calm that lasts."""
    u, v = fields()
    u[:, 50:70, 10:20], v[:, 50:70, 10:20] = 0.0, 0.0
    path = saved(tmp_path / "a.nc", 20 * u, 20 * v)
    source = sources.open_source("wind", path, variables={"east": "uo", "north": "vo"})
    assert (source.read(5)[50:70, 10:20] == 0.0).all()


def test_what_is_filled_does_not_depend_on_the_box(tmp_path: Path) -> None:
    """Boxes whose edge lies beside the coast, as a 30 km bay of the whole file is filled there."""
    lon, lat = np.arange(2.0, 8.0, 0.05), np.arange(57.0, 63.0, 0.03)
    u, v = fields(lon, lat)
    x, y = np.meshgrid(lon, lat)
    land = shore(x, y) | (np.abs(x - 4.3) < 0.31) & (y > 59.2)
    u[:, land], v[:, land] = np.nan, np.nan
    path = saved(tmp_path / "a.nc", u, v, lon=lon, lat=lat)

    def filled(box: Box | None) -> tuple[Any, Any]:
        source = sources.open_source("current", path, box=box)
        grid = source.grid
        return grid, fill.fill(
            source.read(3), 3, reach=fill.REACH, bands=fill.bands(grid), within=source.domain
        )

    grid, whole = filled(None)
    for box in (Box(4.3, 59.4, 5.4, 60.8), Box(4.0, 58.0, 4.35, 61.0), Box(4.4, 60.0, 7.0, 60.6)):
        own, part = filled(box)
        j = np.flatnonzero((grid.lat >= box.south) & (grid.lat <= box.north))
        i = np.flatnonzero((grid.lon >= box.west) & (grid.lon <= box.east))
        rows = np.searchsorted(own.lat, grid.lat[j] - 1e-6)
        columns = np.searchsorted(own.lon, grid.lon[i] - 1e-6)
        np.testing.assert_array_equal(part[np.ix_(rows, columns)], whole[np.ix_(j, i)])
