"""Remedies that errors of a case's forcing name, followed: sources that end early, that do not go
together, that are apart.

The current is linear in time and the same everywhere, u = 0.05 m/s an hour since 06:00: a drifter's
way is its integral.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import trial_case
import writers
import xarray as xr

import drift
from drift.engine.environment import ambient
from drift.pipeline import run_setup
from geo.errors import UserError


def written(path: Path, hours: range, shift: float = 0.0) -> Path:
    lon, lat = np.arange(-33.0 + shift, -26.9 + shift, 0.5), np.arange(37.0, 43.1, 0.5)
    u = np.broadcast_to(
        0.05 * np.array(hours, float)[:, None, None], (len(hours), lat.size, lon.size)
    )
    dims = ("time", "lat", "lon")
    xr.Dataset(
        {"uo": (dims, u, writers.EAST), "vo": (dims, 0 * u, writers.NORTH)},
        {
            "time": ("time", np.array(hours, float), {"units": "hours since 2024-03-10T06"}),
            "lat": lat,
            "lon": lon,
        },
    ).to_netcdf(path)
    return path


def case_of(folder: Path, sources: str, *changes: tuple[str, str]) -> drift.Case:
    text = trial_case.text(
        sources,
        start="2024-03-10T06:00Z",
        duration="8 h",
        particles=200,
        uncertainty="none",
        current=None,
        scenario={"position": {"at": [-30.0, 40.0], "error": "1 m"}},
    )
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "case.toml").write_text(text, encoding="utf-8")
    return drift.load(folder / "case.toml")


def eastward(case: drift.Case) -> list[float]:
    """Return the current at the drifter's place through the run [m/s], hourly."""
    sources = run_setup.open_for(case).scenarios[0]
    times = case.start + np.arange(0, case.period.duration + 1, 3600).astype("timedelta64[s]")
    flow = ambient.ambient_at(sources, "current", times, np.array([-30.0]), np.array([40.0]))
    return [float(x) for x in flow[:, 0, 0]]


def refused(case: drift.Case, words: str) -> None:
    with pytest.raises(UserError) as caught:
        run_setup.open_for(case)
    assert re.search(words, str(caught.value), re.S), str(caught.value)


def test_a_source_that_ends_before_the_run(tmp_path: Path) -> None:
    written(tmp_path / "a.nc", range(5))
    one = '[[current]]\nname = "a"\nfiles = "a.nc"'
    refused(
        case_of(tmp_path, one), r"Change start, duration or end, or add another \[\[current\]\]"
    )
    assert eastward(case_of(tmp_path, one, ("8 h", "4 h"))) == pytest.approx(0.05 * np.arange(5))
    written(tmp_path / "b.nc", range(4, 10))
    both = one + '\n[[current]]\nname = "b"\nfiles = "b.nc"'
    assert eastward(case_of(tmp_path, both)) == pytest.approx(0.05 * np.arange(9))


def test_files_that_do_not_go_together_as_sources_of_their_own(tmp_path: Path) -> None:
    written(tmp_path / "a.nc", range(5))
    written(tmp_path / "b.nc", range(4, 10), 0.25)
    refused(
        case_of(tmp_path, '[[current]]\nfiles = ["a.nc", "b.nc"]'),
        "another grid.*source of its own",
    )
    apart = '[[current]]\nname = "a"\nfiles = "a.nc"\n[[current]]\nname = "b"\nfiles = "b.nc"'
    assert eastward(case_of(tmp_path, apart)) == pytest.approx(0.05 * np.arange(9))


def test_an_empty_slice_is_said_and_the_current_goes_on(tmp_path: Path) -> None:
    with xr.open_dataset(written(tmp_path / "a.nc", range(10)), decode_times=False) as data:
        data.load()
    data.uo[3] = np.nan
    data.vo[3] = np.nan
    data.to_netcdf(tmp_path / "b.nc")
    case = case_of(tmp_path, '[[current]]\nname = "b"\nfiles = "b.nc"')
    where = run_setup.open_for(case)
    assert any(
        "the slice of 100900ZMAR24 holds no value here" in note for note in where.sources[0].notes
    )
    assert eastward(case) == pytest.approx(0.05 * np.arange(9))
    result = drift.run(case, out=None)
    assert any(
        'current "b": the slice of 100900ZMAR24' in words for words in result.summary["warnings"]
    )


@pytest.mark.parametrize("stamp", ["start", "end"])
def test_a_run_in_means_ends_where_the_field_that_they_are_of_leads(
    stamp: str, tmp_path: Path
) -> None:
    """A mean of a field linear in time is its value at the middle: the way is the integral, 0.05
    m/s/h x t^2 / 2.
    """
    hours = np.arange(-3.0, 15.0, 3.0)
    path = written(tmp_path / "a.nc", range(len(hours)))
    with xr.open_dataset(path, decode_times=False) as data:
        data.load()
    middles = hours + 1.5
    data.uo[:] = 0.05 * middles[:, None, None]
    data.uo.attrs["cell_methods"] = data.vo.attrs["cell_methods"] = "time: mean"
    data["time"] = (
        "time",
        hours if stamp == "start" else hours + 3,
        {"units": "hours since 2024-03-10T06"},
    )
    data.to_netcdf(tmp_path / "m.nc")
    case = case_of(tmp_path, f'[[current]]\nfiles = "m.nc"\ntimes = {{ stamp = "{stamp}" }}')
    assert eastward(case) == pytest.approx(0.05 * np.arange(9))
