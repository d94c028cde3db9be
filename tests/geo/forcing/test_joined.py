"""Files of one source that overlap in time, or say the same in other ways: joined, without a hole,
to the right field.
"""

from pathlib import Path
from typing import Any

import linear
import numpy as np
import pytest
import xarray as xr

from geo.errors import UserError
from geo.forcing import describe, sources
from geo.forcing.sources import Source
from geo.grids.grid import sample

FIRST, SECOND = np.arange(0.0, 13.0), np.arange(12.0, 25.0)
AFTER = np.arange(13.0, 25.0)
NEAR = 2e-6  # [m/s] single precision
PLACE = (-29.1, 41.33)


def opened(*paths: Path, quantity: str = "current", **options: Any) -> Source:
    source = sources.open_source(quantity, paths, **options)
    hours = (source.times - source.times[0]) / np.timedelta64(1, "h")
    assert (np.diff(hours) > 0).all()
    return source


def shifts(source: Source) -> dict[int, float]:
    """Return by how much the current east at PLACE is above the field, by hour."""
    hours = (source.times - np.datetime64("2024-03-10")) / np.timedelta64(1, "h")
    found = {}
    for k, hour in enumerate(hours):
        value = sample(source.grid, source.read(k), [PLACE[0]], [PLACE[1]])[0, 0]
        found[round(float(hour))] = round(float(value - linear.field(*PLACE, hour)[0]), 5)
    return found


def run(path: Path, hours: Any, plus: float = 0.0, **attributes: Any) -> Path:
    """Write a forecast that is `plus` m/s above the field, east and north."""
    data = linear.dataset(hours)
    for name in ("uo", "vo"):
        data[name].values += plus
    return linear.written(path, data.assign(attributes))


# --- times that several files have ------------------------------------------------------------------------------


def test_a_boundary_that_files_share_counts_once(tmp_path: Path) -> None:
    paths = [run(tmp_path / f"{k}.nc", np.arange(8.0 * k, 8.0 * k + 9)) for k in range(3)]
    source = opened(*paths)
    assert len(source.times) == 25
    assert linear.worst(source) < NEAR
    assert any("0.nc and 1.nc; 1.nc and 2.nc" in note for note in source.notes)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_later_run_wins_from_its_first_time_on(order: Any, tmp_path: Path) -> None:
    """Every other hour of the later run has no time in common with the earlier one: slices must not
    alternate.
    """
    earlier = run(tmp_path / "z.nc", np.arange(0.0, 25.0), plus=0.1)
    later = run(tmp_path / "a.nc", np.arange(6.0, 31.0, 2.0))
    source = opened(*[(earlier, later)[k] for k in order])
    wanted = dict.fromkeys(range(6), 0.1) | dict.fromkeys(range(6, 31, 2), 0.0)
    assert shifts(source) == wanted
    assert any(
        "a.nc instead of z.nc from 100600ZMAR24 to 110000ZMAR24" in note for note in source.notes
    )


def test_equal_runs_keep_all_their_times(tmp_path: Path) -> None:
    source = opened(
        run(tmp_path / "a.nc", np.arange(0.0, 25.0)),
        run(tmp_path / "b.nc", np.arange(6.0, 31.0, 2.0)),
    )
    assert len(source.times) == 25 + 3
    assert linear.worst(source) < NEAR


def test_a_run_inside_another_and_three_that_overlap(tmp_path: Path) -> None:
    outer, inner = (
        run(tmp_path / "a.nc", np.arange(0.0, 25.0), 0.1),
        run(tmp_path / "b.nc", np.arange(8.0, 13.0), 0.2),
    )
    assert shifts(opened(outer, inner)) == {h: 0.2 if 8 <= h <= 12 else 0.1 for h in range(25)}
    runs = [run(tmp_path / f"r{k}.nc", np.arange(6.0 * k, 6.0 * k + 19), 0.1 * k) for k in range(3)]
    assert shifts(opened(*runs)) == {h: round(0.1 * min(h // 6, 2), 5) for h in range(31)}


def test_runs_say_when_they_began(tmp_path: Path) -> None:
    """A hindcast that was made later reaches further back: its reference time counts, not its first
    slice.
    """
    said = {"standard_name": "forecast_reference_time", "units": linear.UNITS}
    old = run(tmp_path / "a.nc", np.arange(6.0, 25.0), 0.1, forecast_reference_time=((), 6.0, said))
    new = run(
        tmp_path / "b.nc", np.arange(0.0, 13.0), 0.0, forecast_reference_time=((), 12.0, said)
    )
    assert shifts(opened(old, new)) == {h: 0.1 if h > 12 else 0.0 for h in range(25)}


def test_info_knows_the_names_of_every_file(tmp_path: Path) -> None:
    paths = [
        linear.written(tmp_path / "a.nc", linear.dataset(FIRST)),
        linear.written(tmp_path / "b.nc", renamed(linear.dataset(AFTER))),
        linear.written(tmp_path / "c.nc", linear.dataset(FIRST, names=linear.WIND)),
    ]
    current, wind = describe.open_quantities([str(path) for path in paths])
    assert (len(current.times), len(wind.times)) == (25, 13)
    assert any(
        "b.nc: ucur, vcur are called uo, vo in other files" in note for note in current.notes
    )
    assert not any("b.nc" in note for note in wind.notes)


# --- the same in other ways -------------------------------------------------------------------------------------


def around(data: xr.Dataset) -> xr.Dataset:
    return data.assign_coords(lon=("lon", data.lon.values % 360.0, data.lon.attrs))


def falling(data: xr.Dataset) -> xr.Dataset:
    return data.isel(lat=slice(None, None, -1), lon=slice(None, None, -1))


def renamed(data: xr.Dataset) -> xr.Dataset:
    return data.rename(uo="ucur", vo="vcur", lon="longitude", lat="latitude", time="valid_time")


def in_knots(data: xr.Dataset) -> xr.Dataset:
    return data.assign(
        {
            n: data[n].copy(data=data[n] * 3600 / 1852).assign_attrs(units="knots")
            for n in ("uo", "vo")
        }
    )


def crosswise(data: xr.Dataset) -> xr.Dataset:
    return data.transpose("lon", "lat", "time")


def swapped(data: xr.Dataset) -> xr.Dataset:
    return data.rename(lat="lon", lon="lat")


def spelt(data: xr.Dataset) -> xr.Dataset:
    return data.assign({n: data[n].assign_attrs(units="metres per second") for n in ("uo", "vo")})


def wider(data: xr.Dataset) -> xr.Dataset:
    hours = data.time.values
    return linear.dataset(hours, np.arange(-36.0, -23.9, 0.5), np.arange(35.0, 44.01, 0.25))


OTHER = [around, falling, renamed, in_knots, crosswise, swapped, spelt, wider]


@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize("other", OTHER)
def test_files_that_say_it_otherwise_are_joined(other: Any, turn: bool, tmp_path: Path) -> None:
    paths = [tmp_path / "a.nc", tmp_path / "b.nc", tmp_path / "c.nc"]
    for k, path in enumerate(paths):
        data = linear.dataset(np.arange(8.0 * k, 8.0 * k + 8))
        linear.written(path, other(data) if (k == 1) != turn else data)
    source = opened(*paths)
    assert len(source.times) == 24
    assert linear.worst(source) < NEAR
    assert source.grid.lon0 == pytest.approx(-34.0)


def test_all_of_it_at_once_across_the_antimeridian(tmp_path: Path) -> None:
    """The second file runs 0 to 360, from Greenwich, with rising longitudes that meet in the middle
    of the field.
    """
    lon, lat = np.arange(176.0, 184.1, 0.5), linear.LAT
    first = linear.dataset(FIRST, lon - 210.0, lat).assign_coords(
        lon=("lon", lon, {"units": "degrees_east"})
    )
    turned = (lon + 180.0) % 360.0 - 180.0
    second = linear.dataset(AFTER, lon - 210.0, lat).assign_coords(
        lon=("lon", turned, {"units": "degrees_east"})
    )
    paths = [
        linear.written(tmp_path / "a.nc", first),
        linear.written(tmp_path / "b.nc", in_knots(falling(second.sortby("lon")))),
    ]
    source = opened(*paths)
    for k, hour in enumerate(range(25)):
        right = np.stack(linear.field(np.array([177.7, 179.9, 180.2]) - 210.0, 40.3, hour), -1)
        got = sample(source.grid, source.read(k), [177.7, 179.9, -179.8], [40.3] * 3)
        np.testing.assert_allclose(got, right, atol=NEAR)


def test_curved_grids_turned_and_counted_from_zero(tmp_path: Path) -> None:
    x, y = np.meshgrid(linear.LON, linear.LAT)
    lon = x + 0.02 * (y - 40)
    paths = []
    for k, hours in enumerate((FIRST, AFTER)):
        u, v = linear.field(lon, y, hours[:, None, None])
        held = linear.dataset(hours)
        data = xr.Dataset(
            {
                "uo": (("time", "y", "x"), u, held.uo.attrs),
                "vo": (("time", "y", "x"), v, held.vo.attrs),
                "lon": (("y", "x"), lon % 360.0 if k else lon, {"units": "degrees_east"}),
                "lat": (("y", "x"), y, {"units": "degrees_north"}),
                "time": held.time,
            }
        )
        paths.append(
            linear.written(tmp_path / f"{k}.nc", data.isel(y=slice(None, None, -1)) if k else data)
        )
    assert linear.worst(opened(*paths)) < 1e-4  # edges are great circles


def test_components_in_files_of_their_own_under_other_names(tmp_path: Path) -> None:
    paths = []
    for hours, names in ((FIRST, ("uo", "vo")), (AFTER, ("water_u", "water_v"))):
        data = linear.dataset(hours)
        for old, new in zip(("uo", "vo"), names, strict=True):
            paths.append(linear.written(tmp_path / f"{new}.nc", data[[old]].rename({old: new})))
    source = opened(*paths)
    assert len(source.times) == 25
    assert linear.worst(source) < NEAR


def test_packed_by_other_scales(tmp_path: Path) -> None:
    paths = []
    for k, scale in enumerate((0.0001, 0.0002, 0.00005)):
        how = {"dtype": "i2", "scale_factor": scale, "add_offset": 0.3, "_FillValue": -32768}
        paths.append(
            linear.written(
                tmp_path / f"{k}.nc",
                linear.dataset(np.arange(8.0 * k, 8.0 * k + 9)),
                uo=how,
                vo=how,
            )
        )
    source = opened(*paths)
    assert len(source.times) == 25
    assert linear.worst(source) < 0.00011
    assert any("equal values" in note for note in source.notes)


def test_grids_of_other_points_are_refused_still(tmp_path: Path) -> None:
    first = run(tmp_path / "a.nc", FIRST)
    for k, (lon, lat) in enumerate(
        (
            (linear.LON + 0.2, linear.LAT),
            (linear.LON, linear.LAT[::2]),
            (linear.LON[::2], linear.LAT),
        )
    ):
        second = linear.written(tmp_path / f"b{k}.nc", linear.dataset(AFTER, lon, lat))
        with pytest.raises(UserError, match="another grid"):
            opened(first, second)


# --- ERA5's versions --------------------------------------------------------------------------------------------


def versions(hours: Any, final: Any, labels: Any) -> xr.Dataset:
    """Return a file of the old format: final values in the first of two versions, preliminary ones
    in the second.
    """
    data = linear.dataset(hours, names=linear.WIND)
    there = np.isin(hours, final)[:, None, None]
    held = {}
    for name in ("u10", "v10"):
        both = [np.where(there, data[name], np.nan), np.where(there, np.nan, data[name])]
        pair = np.stack(both if str(labels[0]).endswith("1") else both[::-1], 1)
        held[name] = (("time", "expver", "lat", "lon"), pair, data[name].attrs)
    return data.drop_vars(["u10", "v10"]).assign(held).assign_coords(expver=("expver", labels))


@pytest.mark.parametrize("labels", [[1, 5], [5, 1], ["0001", "0005"]])
def test_final_and_preliminary_values_are_joined(labels: Any, tmp_path: Path) -> None:
    path = linear.written(tmp_path / "a.nc", versions(FIRST, FIRST[:7], labels))
    source = opened(path, quantity="wind")
    assert source.missing == 0
    assert linear.worst(source) < NEAR
    assert any("expver" in note for note in source.notes)
    one = opened(
        path, quantity="wind", variables={"expver": list(map(str, labels)).index(str(labels[0]))}
    )
    assert np.isnan(one.read(12 if str(labels[0]).endswith("1") else 0)).all()
    plain = linear.written(tmp_path / "b.nc", linear.dataset(AFTER, names=linear.WIND))
    assert linear.worst(opened(path, plain, quantity="wind")) < NEAR


def test_the_new_format_says_the_version_of_each_time(tmp_path: Path) -> None:
    """Preliminary values of the file that begins later do not replace final ones."""
    paths = []
    for k, (hours, plus) in enumerate(((np.arange(0.0, 13.0), 0.0), (np.arange(6.0, 25.0), 0.7))):
        data = linear.dataset(hours, names=linear.WIND).rename(
            time="valid_time", lon="longitude", lat="latitude"
        )
        for name in ("u10", "v10"):
            data[name].values += plus
            data[name].attrs["coordinates"] = "number valid_time latitude longitude expver"
        said = np.array(["0005" if k else "0001"] * len(hours), object)
        paths.append(
            linear.written(
                tmp_path / f"{k}.nc", data.assign(expver=("valid_time", said), number=((), 0))
            )
        )
    assert shifts(opened(*paths, quantity="wind")) == {h: 0.7 if h > 12 else 0.0 for h in range(25)}
