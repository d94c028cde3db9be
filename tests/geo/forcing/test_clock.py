"""Times of slices: units of time against UDUNITS, zones, dates, orders, and times that are not
there.

Every file holds a current that is linear in time, u = 0.01 m/s an hour since EPOCH: a slice that
stands at the wrong time has the wrong value.
"""

from pathlib import Path
from typing import Any

import cftime
import numpy as np
import pytest
import writers
import xarray as xr

from geo.errors import UserError
from geo.forcing import sources
from geo.forcing.reading import memory
from geo.forcing.times import epoch

EPOCH = np.datetime64("2024-03-10T00:00:00", "s")
HOURS = np.arange(6.0)

# [s] from EPOCH to the number 0, by UDUNITS 2.2.28 through cf-units 3.3.1; None: it rejects the
# units.
UDUNITS = {
    "hours since 2024-03-10 00:00:00-6": 21600, "hours since 2024-03-10 00:00:00 -6": 21600,
    "hours since 2024-03-10 00:00:00 -6:00": 21600, "hours since 2024-03-10 00:00:00 +1:00": -3600,
    "hours since 2024-03-10 00:00:00 -3:30": 12600, "hours since 2024-03-10 00:00:00 -0600": 21600,
    "hours since 2024-03-10 00:00:00+0530": -19800, "hours since 2024-03-10 00:00:00 -600": 21600,
    "hours since 2024-03-10 00:00:00 +8": -28800, "hours since 2024-03-10 00:00:00 6": -21600,
    "hours since 2024-03-10 00:00:00 6:00": -21600, "hours since 2024-03-10 00:00:00 0600": -21600,
    "hours since 2024-03-10 00:00:00 -6:0": 21600, "hours since 2024-03-10 00:00:00 +14": -50400,
    "hours since 2024-03-10 00:00:00 -6:00 UTC": 21600, "hours since 2024-03-10 00:00 -6 ": 21600,
    "hours since 2024-03-10 00:00:00 UTC": 0, "hours since 2024-03-10 00:00:00Z": 0, "hours since 2024-03-10 utc": 0,
    "hours since 2024-03-10 00:00:00 GMT": 0, "hours since 2024-03-10T06:00:00-06:00": 43200,
    "hours since 2024-03-10T06": 21600, "hours since 2024-03-10 06": 21600, "hours since 2024-03-10 0630": 23400,
    "hours since 20240310T063015 -6": 45015, "hours since 20240310T06-6": 43200, "hours since 20240310": 0,
    "hours since 2024-03-10 06:30-6:00": 45000, "hours since 2024-03": -777600, "hours since 2024-3-1 0": -777600,
    "Hours since 2024-03-10": 0, "hours SINCE 2024-03-10": 0, "hours after 2024-03-10": 0, "hours @ 2024-03-10": 0,
    "hour from 2024-03-10": 0, "hr ref 2024-03-10": 0, "weeks since 2024-03-10": 0, "6 hours since 2024-03-10": 0,
    "hours since 2024-03-10 00:00:00 MDT": None, "hours since 2024-03-10 00:00:00 EST": None,
    "hours since 2024-03-10 00:00:00 local": None, "hours since 2024-03-10 00:00:00 UTC+8": None,
    "hours since 2024-03-10 00:00:00 UTC-05:00": None, "hours since 2024-03-10 00:00:00 GMT+1": None,
    "hours since 2024-03-10 00:00:00 -6.5": None, "hours since 2024-03-10 00:00:00 rubbish": None,
    "hours since 2024-03-10 00:00:00 -6h": None, "hours since 2024-03-10 00:00:00 am": None,
    "hours since 2024-03-10_00:00:00": None, "hours since 2024-03-10 24:00": None,
}  # fmt: skip
LENGTHS = {"weeks": 604800.0, "6 hours": 21600.0}  # [s] of those that do not count hours


@pytest.mark.parametrize("units", UDUNITS)
def test_units_of_time_are_read_as_udunits_reads_them(units: str) -> None:
    expected = UDUNITS[units]
    if expected is None:
        with pytest.raises(UserError):
            epoch.parse(units)
        return
    since = epoch.parse(units)
    date = cftime.num2date(0.0, since.units, "standard", only_use_cftime_datetimes=True)
    zero = np.datetime64(date.isoformat(), "s") - np.timedelta64(since.zone, "s")
    assert (zero - EPOCH).astype(int) == expected
    assert since.seconds == next(
        (s for text, s in LENGTHS.items() if units.startswith(text)), 3600.0
    )


@pytest.mark.parametrize(
    "units", ["hours since 2024/03/10", "hours since 2024 03 10", "hours since 2024/3/10 00:00"]
)
def test_dates_with_slashes_or_blanks(units: str, tmp_path: Path) -> None:
    check(sources.open_source("current", written(tmp_path, units=units)))


def written(
    folder: Path,
    hours: Any = HOURS,
    units: str = "hours since 2024-03-10",
    shift: float = 0.0,
    name: str = "a.nc",
    **about: Any,
) -> Path:
    """Write a current whose slices hold at hours since EPOCH, numbered `shift` more."""
    lon, lat = np.arange(-31.0, -28.9, 0.5), np.arange(39.0, 41.1, 0.5)
    real = np.nan_to_num(np.asarray(hours, float), nan=40.0)
    u = np.broadcast_to(0.01 * real[:, None, None], (len(real), lat.size, lon.size))
    dims = ("time", "lat", "lon")
    numbers = np.asarray(hours, float) + shift
    (folder / name).unlink(missing_ok=True)
    xr.Dataset(
        {"uo": (dims, u, writers.EAST), "vo": (dims, 0 * u - 0.2, writers.NORTH)},
        {"time": ("time", numbers, {"units": units} | about), "lat": lat, "lon": lon},
    ).to_netcdf(folder / name, encoding={"time": {"_FillValue": 1e30}})
    return folder / name


def check(source: sources.Source, first: float = 0.0, last: float = 5.0, count: int = 6) -> None:
    """Hold every slice to the time that it is given: u is 0.01 m/s an hour since EPOCH."""
    hours = (source.times - EPOCH) / np.timedelta64(1, "h")
    assert (hours[0], hours[-1], len(hours)) == (first, last, count)
    assert (np.diff(hours) > 0).all()
    for k, hour in enumerate(hours):
        np.testing.assert_allclose(source.read(k)[..., 0], 0.01 * hour, atol=1e-6)


def test_zones_in_files_and_in_memory(tmp_path: Path) -> None:
    # xarray misreads the last two
    for units, ahead in (("-6", -6), (" +1:00", 1), (" 6:00", 6), (" -600", -6)):
        path = written(
            tmp_path,
            units=f"hours since 2024-03-10 00:00:00{units}",
            shift=ahead,
            name=f"{ahead}{units[0]}.nc",
        )
        check(sources.open_source("current", path))
        with xr.open_dataset(path) as data:
            check(sources.open_source("current", memory.NamedDataset("x", data)))


@pytest.mark.parametrize("zone", ["MDT", "local", "UTC+8"])
def test_a_zone_without_meaning_is_refused_and_can_be_stated(zone: str, tmp_path: Path) -> None:
    path = written(tmp_path, units=f"hours since 2024-03-10 00:00:00 {zone}", shift=-6)
    said = {"zone": "-06:00"}
    with pytest.raises(UserError, match=r'zone.*\[\[current\]\] times = \{ zone = "-06:00" \}'):
        sources.open_source("current", path)
    source = sources.open_source("current", path, times=said)
    check(source)
    assert any("-6 h from UTC, as the case says" in note for note in source.notes)
    with xr.open_dataset(path) as data:  # xarray drops the zone, or takes it for another
        with pytest.raises(UserError, match=r"times = \{ zone"):
            sources.open_source("current", memory.NamedDataset("x", data))
        check(sources.open_source("current", memory.NamedDataset("x", data), times=said))
    with pytest.raises(UserError, match=r'"Mars".*"UTC" and hours ahead'):
        sources.open_source("current", path, times={"zone": "Mars"})


def test_times_in_any_order_are_sorted(tmp_path: Path) -> None:
    for order, words in ((HOURS[::-1], "decrease"), (HOURS[[3, 1, 0, 5, 2, 4]], "not in order")):
        source = sources.open_source("current", written(tmp_path, order))
        check(source)
        assert any(words in note and "sorted" in note for note in source.notes)


@pytest.mark.parametrize(
    "units", ["hours since 2024-03-10", "hours since 2024-03-10 00:00 MDT", "day as %Y%m%d"]
)
def test_stated_times_never_run_data_backward(units: str, tmp_path: Path) -> None:
    told = {"start": EPOCH, "interval": np.timedelta64(3600, "s")}
    for name, hours in (("up.nc", HOURS), ("down.nc", HOURS[::-1])):
        check(
            sources.open_source("current", written(tmp_path, hours, units, name=name), times=told)
        )
    early = written(tmp_path, HOURS[:3][::-1], units, name="z1.nc")
    late = written(tmp_path, HOURS[3:][::-1], units, name="b2.nc")
    if "since" in units:  # the files' own numbers tell which is earlier
        check(sources.open_source("current", [late, early], times=told))
    check(sources.open_source("current", [early, late], times=told))


def test_times_missing_at_the_end_are_left_out_and_inside_are_refused(tmp_path: Path) -> None:
    source = sources.open_source("current", written(tmp_path, [*HOURS, np.nan, np.nan]))
    check(source)
    assert any("2 slices at the end have no time" in note for note in source.notes)
    undeclared = written(tmp_path, [*HOURS, 9.969209968386869e36], name="u.nc")
    with xr.open_dataset(undeclared, decode_times=False) as data:
        data.uo[-1] = 0.1
        data.load().to_netcdf(tmp_path / "v.nc", encoding={"time": {"_FillValue": None}})
    check(sources.open_source("current", tmp_path / "v.nc"))
    with pytest.raises(UserError, match=r'"time" has missing values; state \[\[current\]\] times'):
        sources.open_source("current", written(tmp_path, [0.0, np.nan, 2.0]))


def test_slices_of_one_time(tmp_path: Path) -> None:
    same = written(tmp_path, [0.0, 1.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    source = sources.open_source("current", same)
    check(source)
    assert any("1 slices repeat the time and values of another" in note for note in source.notes)
    with xr.open_dataset(same, decode_times=False) as data:
        data.load()
    data.uo[:] = 0.01 * np.arange(7.0)[:, None, None]
    data.to_netcdf(tmp_path / "other.nc")
    with pytest.raises(
        UserError,
        match=r"slices 2 and 3 have the same time, 100100ZMAR24, but different values.*times = \{ start",
    ):
        sources.open_source("current", tmp_path / "other.nc")
    told = {"start": EPOCH, "interval": np.timedelta64(3600, "s")}
    check(sources.open_source("current", tmp_path / "other.nc", times=told), last=6.0, count=7)


@pytest.mark.parametrize(
    "rest", ["/06:00:00", ", 06:00:00", "_06:00:00", " at 06:00", " 06:00:00 PM"]
)
@pytest.mark.parametrize("zone", [None, 0])
def test_a_time_of_day_that_is_not_read_is_no_zone(rest: str, zone: int | None) -> None:
    """Stated with `zone`, it would be dropped as if it were one: six hours of the track."""
    with pytest.raises(UserError, match="is no time of day") as refusal:
        epoch.parse(f"hours since 2024-03-10{rest}", zone)
    assert not isinstance(refusal.value, epoch.ZoneError)
