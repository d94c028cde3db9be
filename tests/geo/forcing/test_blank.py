"""A slice that holds nothing between good ones: left out, said with its time, interpolated over as
if it were absent.
"""

from pathlib import Path
from typing import Any

import numpy as np
import writers
import xarray as xr

from geo.box import Box
from geo.forcing import describe, sources

EPOCH = np.datetime64("2024-03-10T00:00:00", "s")
HOUR = np.timedelta64(3600, "s")


def written(path: Path, empty: Any, names: Any = ("uo", "vo"), fill: float = np.nan) -> Path:
    """Write twelve hours of u = 0.01 m/s an hour, of which some hold nothing; land in the west."""
    lon, lat = np.arange(-31.0, -28.9, 0.5), np.arange(39.0, 41.1, 0.5)
    u = np.broadcast_to(0.01 * np.arange(1.0, 13.0)[:, None, None], (12, lat.size, lon.size)).copy()
    data = xr.Dataset(
        {
            "uo": (("time", "lat", "lon"), u, writers.EAST),
            "vo": (("time", "lat", "lon"), 0 * u - 0.2, writers.NORTH),
        },
        {
            "time": ("time", np.arange(12.0), {"units": "hours since 2024-03-10"}),
            "lat": lat,
            "lon": lon,
        },
    )
    for name in ("uo", "vo"):
        data[name][:, :, 0] = np.nan
    for name in names:
        data[name][empty] = fill
    path.unlink(missing_ok=True)
    data.to_netcdf(path)
    return path


def opened(path: Path, first: int = 0, last: int = 11) -> sources.Source:
    source = sources.open_source("current", path, box=Box(-31.0, 39.0, -29.0, 41.0))
    return source.without_blank_slices(EPOCH + first * HOUR, EPOCH + last * HOUR)


def hours(source: sources.Source) -> list[int]:
    return [int((time - EPOCH) / HOUR) for time in source.times]


def test_it_is_left_out_with_its_time(tmp_path: Path) -> None:
    for names in (("uo", "vo"), ("uo",), ("vo",)):
        source = opened(written(tmp_path / "a.nc", [4, 7], names))
        assert hours(source) == [0, 1, 2, 3, 5, 6, 8, 9, 10, 11]
        for k, hour in enumerate(hours(source)):
            np.testing.assert_allclose(source.read(k)[:, 1:, 0], 0.01 * (hour + 1), atol=1e-6)
        assert (
            "WARNING: slices of 100400ZMAR24, 100700ZMAR24 hold no value here: left out"
            in source.notes[-1]
        )
    assert hours(opened(written(tmp_path / "b.nc", [4], fill=-999.0))) == [
        0,
        1,
        2,
        3,
        5,
        6,
        7,
        8,
        9,
        10,
        11,
    ]
    assert hours(opened(written(tmp_path / "c.nc", [0, 11]))) == list(range(1, 11))


def test_only_what_is_wanted_is_looked_at_and_good_slices_stay(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", [4, 10])
    assert hours(opened(path, 2, 6)) == [0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11]
    early = sources.open_source("current", path, box=Box(-31.0, 39.0, -29.0, 41.0))
    # what was looked at once is known
    for first, last, left in ((0, 3, 12), (9, 9, 12), (0, 4, 11), (0, 11, 10)):
        assert (
            early.without_blank_slices(EPOCH + first * HOUR, EPOCH + last * HOUR).times.size == left
        )
    gap = opened(written(tmp_path / "c.nc", [4, 5, 6]), 0, 4)
    assert hours(gap) == [0, 1, 2, 3, 7, 8, 9, 10, 11]
    whole = opened(written(tmp_path / "b.nc", []))
    assert whole.times.size == 12
    assert not any("WARNING" in note for note in whole.notes)


def test_info_says_it(tmp_path: Path) -> None:
    told = "\n".join(
        describe.describe(describe.open_quantities(str(written(tmp_path / "a.nc", [4])))[0])
    )
    assert "the slice of 100400ZMAR24 holds no value here: left out and interpolated over" in told
    assert "11 slices 1 h to 2 h apart" in told
