"""Differences of runs whose motion differs: a shift is its speed by time."""

from pathlib import Path

import numpy as np
import pytest
import small_case
from compared_cases import HOURS, case_of

import drift
from drift.assess.compare import figures

# differences of maps are made on a grid of their own
pytestmark = pytest.mark.usefixtures("coarse_maps")


def test_a_constant_current_more_moves_the_mean_by_its_way(tmp_path: Path) -> None:
    """East 0.2 and north -0.1 m/s for six hours: 4320 and -2160 m, on a sphere, for each particle
    of its own latitude.
    """
    a = case_of(
        tmp_path,
        small_case.STEADY,
        particles=4000,
        current__0__constant={"east": 0.1, "north": 0.05},
    )
    b = drift.vary(a, {"current.0.constant": {"east": 0.3, "north": -0.05}})
    found = drift.compare(a, b)
    (east,), (north,) = (found.at(found.times[-1], name) for name in figures.SHIFT)
    # Parallels bend: x^2 tan(lat) / 2R = 0.8 m; and a degree of longitude widens by y tan(lat) / R
    # = 0.02 % southward.
    assert east.difference == pytest.approx(0.2 * 3600 * HOURS, abs=2.0)
    assert north.difference == pytest.approx(-0.1 * 3600 * HOURS, abs=2.0)
    # Pairs keep together: what is left of the error is that of the widening, 0.02 % of 3 km /
    # sqrt(4000), not 3 km / sqrt(4000).
    assert max(east.error, north.error) < 0.1
    first = found.at(found.times[0], "area")
    assert [(row.difference, row.error) for row in first] == [(0.0, 0.0)] * len(first)


def test_a_dataset_belongs_to_the_case_that_names_it(tmp_path: Path) -> None:
    """0.3 m/s east and north from a dataset in memory, and the same velocity as a constant of the
    other case, which names no dataset.
    """
    named = small_case.CASE.replace('files = "current.nc"', 'dataset = "sea"')
    constant = f"constant = {{ speed = {0.3 * 2**0.5}, toward = 45 }}"
    a = case_of(tmp_path, named, "a")
    b = case_of(tmp_path, small_case.CASE.replace('files = "current.nc"', constant), "b")
    found = drift.compare(a, b, datasets={"sea": small_case.field()})
    for row in found.at(found.times[-1], figures.SHIFT):
        assert abs(row.difference) < 0.1  # 9 km of way, of which float32 keeps seven digits


@pytest.mark.thorough
def test_steps_that_end_elsewhere_share_no_errors_and_this_is_said(tmp_path: Path) -> None:
    """The same current in files whose times are twenty minutes apart: the difference is none but
    for chance.
    """
    field = small_case.field()
    field.to_netcdf(tmp_path / "current.nc")
    field.assign_coords(time=field.time + np.timedelta64(20, "m")).to_netcdf(tmp_path / "later.nc")
    a = case_of(
        tmp_path,
        small_case.CASE,
        particles=2000,
        uncertainty__current={"std": "0.2 m/s", "time": "3 h"},
    )
    assert drift.compare(a, a).notes == ()
    found = drift.compare(a, drift.vary(a, {"current.0.files": "later.nc"}))
    assert len(found.notes) == 1
    assert "are not common to both" in found.notes[0]
    for name in figures.SHIFT:
        (row,) = found.at(found.times[-1], name)
        assert row.error > 10
        assert abs(row.difference) < 4 * row.error  # one in 16,000


def test_backward_against_backward(tmp_path: Path) -> None:
    text = small_case.STEADY.replace('duration = "6 h"', 'duration = "6 h"\ndirection = "backward"')
    a = case_of(tmp_path, text, particles=500, start="2026-11-21T06:00Z", uncertainty="none")
    found = drift.compare(a, drift.vary(a, {"current.0.constant": {"east": 0.5, "north": 0.0}}))
    assert found.times[0] > found.times[-1]
    (east,) = found.at(found.times[-1], "mean, east")
    assert east.difference == pytest.approx(-(0.5 - 0.5 * 1852 / 3600) * 3600 * HOURS, abs=2.0)
