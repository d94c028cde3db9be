"""Forecasts along two dimensions: valid times, the later run where they overlap, one run chosen by
its index.

Run r is u = 0.01 m/s an hour since EPOCH, and v = -0.1 m/s times the number of the run.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import writers
import xarray as xr

from geo.errors import UserError
from geo.forcing import sources
from geo.forcing.reading import memory

EPOCH = np.datetime64("2024-03-10T00:00:00", "s")
HOUR = np.timedelta64(3600, "s")
LEADS = np.arange(0.0, 13.0, 3.0)  # [h]
UNITS = {"units": "hours since 2024-03-10"}


def written(
    path: Path,
    starts: Any,
    reference: str = "init_time",
    lead: str = "step",
    valid: bool = True,
    **about: Any,
) -> Path:
    """Write runs that start at hours since EPOCH, with their valid times or without."""
    starts = np.asarray(starts, float)
    lon, lat = np.arange(-31.0, -28.9, 0.5), np.arange(39.0, 41.1, 0.5)
    hours = starts[:, None] + LEADS[None, :]
    shape = (*hours.shape, lat.size, lon.size)
    u = np.broadcast_to(0.01 * hours[:, :, None, None], shape)
    v = np.broadcast_to(-0.1 * np.arange(1.0, starts.size + 1)[:, None, None, None], shape)
    dims = (reference, lead, "lat", "lon")
    held = xr.Dataset(
        {"uo": (dims, u, writers.EAST), "vo": (dims, v, writers.NORTH)},
        {
            reference: (reference, starts, UNITS | {"standard_name": "forecast_reference_time"}),
            lead: (lead, LEADS, {"units": "hours", "standard_name": "forecast_period"}),
            "lat": lat,
            "lon": lon,
        },
    )
    if valid:
        held["valid_time"] = (reference, lead), hours, UNITS | {"standard_name": "time"}
    held.drop_vars(about.pop("without", [])).to_netcdf(path)
    return path


def check(source: sources.Source, hours: Any, runs: Any) -> None:
    np.testing.assert_array_equal((source.times - EPOCH) / HOUR, hours)
    for k, (hour, run) in enumerate(zip(hours, runs, strict=True)):
        values = source.read(k)
        np.testing.assert_allclose(values[..., 0], 0.01 * hour, atol=1e-6)
        np.testing.assert_allclose(values[..., 1], -0.1 * run, atol=1e-6)


@pytest.mark.parametrize("valid", [True, False])
@pytest.mark.parametrize(
    ("reference", "lead"),
    [("init_time", "step"), ("time", "prediction_timedelta"), ("run", "lead")],
)
def test_one_run(valid: bool, reference: str, lead: str, tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", [6.0], reference, lead, valid)
    source = sources.open_source("current", path)
    check(source, 6 + LEADS, [1] * 5)
    assert any(f"valid times from {reference} and {lead}" in note for note in source.notes)
    with xr.open_dataset(path) as data:
        check(sources.open_source("current", memory.NamedDataset("x", data)), 6 + LEADS, [1] * 5)


def test_the_later_run_wins_and_one_can_be_chosen(tmp_path: Path) -> None:
    for name, starts in (("up", [0.0, 6.0]), ("down", [6.0, 0.0])):
        early, late = (1, 2) if name == "up" else (2, 1)
        path = written(tmp_path / f"{name}.nc", starts)
        source = sources.open_source("current", path)
        check(source, np.arange(0.0, 19.0, 3.0), [early] * 2 + [late] * 5)
        assert any(
            "2 runs from 100000ZMAR24 to 100600ZMAR24: where they overlap the later" in n
            for n in source.notes
        )
        for run in (0, 1):
            chosen = sources.open_source("current", path, variables={"init_time": str(run)})
            check(chosen, starts[run] + LEADS, [run + 1] * 5)
    with pytest.raises(UserError, match=r"variables.init_time = 2: it is an index, 0 to 1"):
        sources.open_source("current", path, variables={"init_time": "2"})


def test_runs_in_files_of_their_own_and_a_lone_start(tmp_path: Path) -> None:
    for k, start in enumerate((0.0, 15.0)):
        with xr.open_dataset(
            written(tmp_path / f"x{k}.nc", [start], valid=False), decode_times=False
        ) as data:
            data.isel(init_time=0).to_netcdf(tmp_path / f"a{k}.nc")
    hours = np.concatenate([LEADS, 15 + LEADS])
    check(sources.open_source("current", str(tmp_path / "a*.nc")), hours, [1] * 10)


def test_runs_whose_starts_nothing_says(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nc", [0.0, 6.0], valid=False, without=["init_time"])
    with pytest.raises(
        UserError,
        match=r"nothing says when.*variables.init_time, and state \[\[current\]\] times = \{ start",
    ):
        sources.open_source("current", path)
    told = {"start": EPOCH + 6 * HOUR, "interval": 3 * HOUR}
    with pytest.raises(
        UserError, match=r"2 along init_time; choose one by its index.*variables.init_time"
    ):
        sources.open_source("current", path, times=told)
    check(
        sources.open_source("current", path, variables={"init_time": "1"}, times=told),
        6 + LEADS,
        [2] * 5,
    )
