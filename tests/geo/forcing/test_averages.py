"""Means: placed at the middle of their interval, wherever they are stamped and however the file
says so.

Every file holds means of a current that is linear in time, u = 0.0005 m/s an hour since EPOCH: the
mean over an interval is the value at its middle, so that a mean at any other time has the wrong
value.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import writers
import xarray as xr

from geo.errors import UserError
from geo.forcing import describe, sources
from geo.forcing.reading import memory

EPOCH = np.datetime64("2024-03-10T00:00:00", "s")
MEAN = {"cell_methods": "time: mean"}
HOUR = np.timedelta64(3600, "s")


def written(
    path: Path,
    edges: Any,
    stamp: float,
    bounds: bool = False,
    axis: dict[str, Any] | None = None,
    about: dict[str, Any] | None = None,
    whole: dict[str, Any] | None = None,
    **more: Any,
) -> Path:
    """Write means between edges [h since EPOCH]; stamp: 0 at the start of an interval, 1 at its
    end.
    """
    lon, lat = np.arange(-31.0, -28.9, 0.5), np.arange(39.0, 41.1, 0.5)
    edges = np.asarray(edges, float)
    begin, end = edges[:-1], edges[1:]
    u = np.broadcast_to(0.00025 * (begin + end)[:, None, None], (len(begin), lat.size, lon.size))
    dims, about = ("time", "lat", "lon"), MEAN if about is None else about
    numbers = begin + stamp * (end - begin)
    data = xr.Dataset(
        {"uo": (dims, u, writers.EAST | about), "vo": (dims, 0 * u - 0.2, writers.NORTH | about)},
        {
            "time": ("time", numbers, {"units": "hours since 2024-03-10"} | (axis or {})),
            "lat": lat,
            "lon": lon,
        },
        whole,
    )
    if bounds:
        data["time"].attrs["bounds"] = "time_bnds"
        data["time_bnds"] = ("time", "nv"), np.stack([begin, end], axis=1)
    data = data.assign(more)
    path.unlink(missing_ok=True)
    data.to_netcdf(path)
    return path


def check(source: sources.Source, edges: Any) -> None:
    """Hold every slice to the middle of its interval, and the outermost to its edges."""
    edges = np.asarray(edges, float)
    hours = (source.times - EPOCH) / HOUR
    middles = (edges[:-1] + edges[1:]) / 2
    np.testing.assert_allclose(hours, [edges[0], *middles, edges[-1]])
    for k, hour in enumerate(hours[1:-1], 1):
        np.testing.assert_allclose(source.read(k)[..., 0], 0.0005 * hour, atol=1e-6)
    for outer, inner in ((0, 1), (-1, -2)):
        k = np.arange(len(hours))
        np.testing.assert_array_equal(source.read(k[outer]), source.read(k[inner]))


DAYS = np.arange(0.0, 145.0, 24.0)


@pytest.mark.parametrize("stamp", [0.0, 0.5, 1.0])
def test_bounds_say_it(stamp: float, tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", DAYS, stamp, bounds=True)
    source = sources.open_source("current", path)
    check(source, DAYS)
    with xr.open_dataset(path) as data:
        np.testing.assert_array_equal(
            sources.open_source("current", memory.NamedDataset("x", data)).times, source.times
        )
    check(
        sources.open_source(
            "current", written(tmp_path / "b.nc", DAYS, stamp, bounds=True, about={})
        ),
        DAYS,
    )
    told = "\n".join(describe.describe(source))
    assert (
        "101200ZMAR24 to 151200ZMAR24, 6 slices every 24 h, held from 100000ZMAR24 to 160000ZMAR24"
        in told
    )
    assert (
        "means over 24 h, each placed at the middle of its interval (by their time bounds)" in told
    )


def test_bounds_in_other_units_packed_or_turned(tmp_path: Path) -> None:
    first = written(tmp_path / "a.nc", DAYS, 1.0, bounds=True)
    with xr.open_dataset(first, decode_times=False) as data:
        data.load()
    pairs = np.stack([DAYS[:-1], DAYS[1:]], axis=1)
    days = ("time", "nv"), pairs / 24, {"units": "days since 2024-03-10"}
    data.assign(time_bnds=days).to_netcdf(tmp_path / "days.nc")
    data.assign(time_bnds=(("time", "nv"), pairs[:, ::-1])).to_netcdf(tmp_path / "turned.nc")
    packing = {
        "time_bnds": {"dtype": "i2", "scale_factor": 12.0, "add_offset": 24.0, "_FillValue": -32768}
    }
    data.to_netcdf(tmp_path / "packed.nc", encoding=packing)
    data.assign(time_bnds=(("nv", "time"), pairs.T)).to_netcdf(tmp_path / "across.nc")
    for name in ("days", "turned", "packed", "across"):
        check(sources.open_source("current", tmp_path / f"{name}.nc"), DAYS)


def test_months_have_lengths_of_their_own(tmp_path: Path) -> None:
    firsts = np.arange("2024-01", "2024-07", dtype="datetime64[M]").astype("datetime64[s]")
    edges = (firsts - EPOCH) / HOUR
    check(
        sources.open_source("current", written(tmp_path / "a.nc", edges, 0.0, bounds=True)), edges
    )
    for stamp, where in ((0.0, "start"), (1.0, "end")):
        path = written(tmp_path / f"{where}.nc", edges, stamp)
        check(sources.open_source("current", path, times={"stamp": where}), edges)
    silent = sources.open_source(
        "current", written(tmp_path / "b.nc", edges, 0.0, about={})
    )  # as ERA5's; 732 h: the median of 29 to 31 days
    assert any("WARNING: means over 732 h (slices a month apart)" in note for note in silent.notes)
    np.testing.assert_array_equal(silent.times, firsts[:-1])


def test_files_of_one_mean_each_are_joined(tmp_path: Path) -> None:
    for k in range(4):
        written(tmp_path / f"d{k}.nc", DAYS[k : k + 2], 0.0)
    source = sources.open_source("current", str(tmp_path / "d*.nc"), times={"stamp": "start"})
    check(source, DAYS[:5])


def test_without_bounds_the_case_says_where_means_are_stamped(tmp_path: Path) -> None:
    for stamp, where in ((0.0, "start"), (1.0, "end")):
        path = written(tmp_path / f"{where}.nc", DAYS, stamp)
        source = sources.open_source("current", path)
        np.testing.assert_array_equal((source.times - EPOCH) / HOUR, DAYS[:-1] + 24 * stamp)
        warned = next(note for note in source.notes if note.startswith("WARNING: means over 24 h"))
        assert "which may be 12 h off; state [[current]] times.stamp" in warned
        check(sources.open_source("current", path, times={"stamp": where}), DAYS)
        as_it_stands = sources.open_source("current", path, times={"stamp": "instant"})
        np.testing.assert_array_equal(as_it_stands.times, source.times)
        assert not any("WARNING" in note for note in as_it_stands.notes)


def test_an_absent_mean_leaves_the_others_where_they_are(tmp_path: Path) -> None:
    with xr.open_dataset(written(tmp_path / "a.nc", DAYS, 0.0), decode_times=False) as data:
        data.isel(time=[0, 1, 2, 4, 5]).to_netcdf(tmp_path / "b.nc")
    source = sources.open_source("current", tmp_path / "b.nc", times={"stamp": "start"})
    np.testing.assert_array_equal((source.times - EPOCH) / HOUR, [0, 12, 36, 60, 108, 132, 144])


def test_stamps_at_half_their_spacing_are_middles(tmp_path: Path) -> None:
    for edges in (DAYS, np.arange(7.0), np.arange(0.0, 19.0, 3.0)):
        source = sources.open_source("current", written(tmp_path / "a.nc", edges, 0.5))
        check(source, edges)
        assert not any("WARNING" in note for note in source.notes)


@pytest.mark.parametrize("where", ["name", "attribute"])
def test_copernicus_stamps_means_at_their_start(where: str, tmp_path: Path) -> None:
    called = "cmems_mod_glo_phy_anfc_0.083deg_P1D-m"
    path = tmp_path / (f"{called}_uo-vo_9.92W-1.50W.nc" if where == "name" else "a.nc")
    whole = {"id": called} if where == "attribute" else None
    area = {"cell_methods": "area: mean"}
    check(sources.open_source("current", written(path, DAYS, 0.0, about=area, whole=whole)), DAYS)
    # files as they are made
    noon = sources.open_source("current", written(path, DAYS, 0.5, about=area, whole=whole))
    check(noon, DAYS)
    instant = tmp_path / "cmems_mod_glo_wav_anfc_0.083deg_PT3H-i_x.nc"
    source = sources.open_source(
        "current", written(instant, np.arange(0.0, 19.0, 3.0), 0.0, about=area)
    )
    np.testing.assert_array_equal((source.times - EPOCH) / HOUR, np.arange(0.0, 18.0, 3.0))


def test_nemo_is_read_by_the_times_that_its_coordinates_name(tmp_path: Path) -> None:
    about = MEAN | {"coordinates": "time_centered"}
    centred = (
        "time",
        (DAYS[:-1] + DAYS[1:]) / 2,
        {"units": "hours since 2024-03-10", "bounds": "time_centered_bounds"},
    )
    pairs = ("time", "axis_nbounds"), np.stack([DAYS[:-1], DAYS[1:]], axis=1)
    path = written(
        tmp_path / "a.nc",
        DAYS,
        1.0,
        axis={"axis": "T"},
        about=about,
        time_centered=centred,
        time_centered_bounds=pairs,
    )
    check(sources.open_source("current", path), DAYS)


def test_what_is_no_mean_stays_where_it_is(tmp_path: Path) -> None:
    for about in (
        {"cell_methods": "area: mean time: point"},
        {"cell_methods": "area: mean"},
        {"GRIB_stepType": "instant"},
    ):
        source = sources.open_source("current", written(tmp_path / "a.nc", DAYS, 1.0, about=about))
        np.testing.assert_array_equal((source.times - EPOCH) / HOUR, DAYS[1:])
    point = {"cell_methods": "time: point"}
    source = sources.open_source(
        "current", written(tmp_path / "b.nc", DAYS, 1.0, bounds=True, about=point)
    )
    np.testing.assert_array_equal((source.times - EPOCH) / HOUR, DAYS[1:])


@pytest.mark.parametrize(
    "method",
    [
        "time: maximum",
        "lon: lat: time: sum",
        "time: standard_deviation",
        "time: mean within years time: mean over years",
    ],
)
def test_what_is_no_velocity_at_a_time_is_refused(method: str, tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", DAYS, 1.0, about={"cell_methods": method})
    with pytest.raises(
        UserError, match=r'no velocity at a time.*variables = .*stamp = "instant".*steady = true'
    ):
        sources.open_source("current", path)
    source = sources.open_source("current", path, times={"stamp": "instant"})
    np.testing.assert_array_equal((source.times - EPOCH) / HOUR, DAYS[1:])
    assert len(sources.open_source("current", path, steady=True).times) == 0


def test_what_grib_says_of_a_step_holds_in_netcdf_too(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", DAYS, 1.0, about={"GRIB_stepType": "avg"})
    check(sources.open_source("current", path), DAYS)
    with pytest.raises(
        UserError, match=r"is the max over a time \(GRIB_stepType max\), no velocity"
    ):
        sources.open_source(
            "current", written(tmp_path / "b.nc", DAYS, 1.0, about={"GRIB_stepType": "max"})
        )
    sloppy = written(tmp_path / "c.nc", DAYS, 1.0, about={"cell_methods": "time: snapshot"})
    np.testing.assert_array_equal(
        (sources.open_source("current", sloppy).times - EPOCH) / HOUR, DAYS[1:]
    )


def test_bounds_that_contradict_their_times_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", DAYS, 1.0, bounds=True)
    with xr.open_dataset(path, decode_times=False) as data:
        data.load()
    wrong = ("time", "nv"), np.stack([DAYS[:-1], DAYS[1:]], axis=1) + 1000
    data.assign(time_bnds=wrong).to_netcdf(tmp_path / "b.nc")
    ages = ("time", "nv"), np.stack([DAYS[1:] - 2e5, DAYS[1:] + 1e4], axis=1)
    ages[1][::2] -= 5e4  # middles fall where times rise
    data.assign(time_bnds=ages).to_netcdf(tmp_path / "c.nc")
    for name in ("b", "c"):
        with pytest.raises(
            UserError,
            match=r'"time_bnds".*times = \{ stamp = "instant" \}.*"start", "middle" or "end"',
        ):
            sources.open_source("current", tmp_path / f"{name}.nc")
        check(sources.open_source("current", tmp_path / f"{name}.nc", times={"stamp": "end"}), DAYS)
        source = sources.open_source("current", tmp_path / f"{name}.nc", times={"stamp": "instant"})
        np.testing.assert_array_equal((source.times - EPOCH) / HOUR, DAYS[1:])
    data.assign(time_bnds=(("time", "nv"), np.full((6, 2), np.nan))).to_netcdf(tmp_path / "d.nc")
    source = sources.open_source("current", tmp_path / "d.nc")
    assert any("missing values: not used" in note for note in source.notes)


def test_stated_times_may_be_those_of_means(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", DAYS, 0.0)
    told = {"start": EPOCH, "interval": np.timedelta64(24, "h")}
    check(sources.open_source("current", path, times=told | {"stamp": "start"}), DAYS)
    np.testing.assert_array_equal(
        (sources.open_source("current", path, times=told).times - EPOCH) / HOUR, DAYS[:-1]
    )


@pytest.mark.parametrize("spacing", [1.0, 3.0, 6.0])
def test_what_interpolated_means_keep_of_a_tide(spacing: float) -> None:
    """docs/forcing.md: of a sinusoid (sin x / x)^3 with x = pi T / P, of instants (sin x / x)^2."""
    period, fine = 12.42, np.arange(0.0, 12.42 * 50, 0.01)
    x = np.pi * spacing / period
    middles = np.arange(-24.0, fine[-1] + 24, spacing) + spacing / 2
    instants = np.cos(2 * np.pi * middles / period)
    means = np.sin(x) / x * instants
    wave = np.exp(-2j * np.pi * fine / period)
    for values, power in ((means, 3), (instants, 2)):
        kept = 2 * abs(np.mean(np.interp(fine, middles, values) * wave))
        assert kept == pytest.approx((np.sin(x) / x) ** power, abs=5e-3)
