"""Buoys and reports in runs of several shards: searched, in ensembles of the current, in spills."""

from pathlib import Path

import numpy as np
import pytest
import shards
import spills

import drift
from drift.engine.motion import simulate
from drift.pipeline import run_setup
from kernels.runtime import runtime

BUOYS = """
[[drifter]]
track = "near.csv"
[[drifter]]
track = "windy.csv"
windage = "2 %"
error = "40 m"
"""
REPORTS = """
[[report]]
current = { speed = "0.9 kn", toward = 75 }
at = [-0.03, -0.02]
time = "2026-11-20T23:20Z"
error = "0.1 m/s"
[[report]]
wind = { speed = "15 kn", from = 238 }
at = [-0.04, 0.05]
time = "2026-11-21T01:05Z"
error = "2 kn"
"""


def write_tracks(folder: Path, begin: str, minutes: list[int]) -> None:
    """Write two tracks east and west of (0, 0)."""
    start = np.datetime64(begin)
    for name, place, pace in (
        ("near", (-0.01, 0.04), (0.00032, 0.00024)),
        ("windy", (-0.08, 0.02), (0.00036, 0.00007)),
    ):
        rows = [
            f"{start + np.timedelta64(t, 'm')}:00Z,{place[0] + pace[0] * t},{place[1] + pace[1] * t}"
            for t in minutes
        ]
        (folder / f"{name}.csv").write_text("\n".join(["time,lon,lat", *rows]) + "\n")


def with_buoys(folder: Path) -> drift.Case:
    """Return the case that stands in a folder, with two buoys and two reports."""
    write_tracks(folder, "2026-11-21T00:10", [0, 20, 45, 90, 150, 170])
    path = folder / "case.toml"
    path.write_text(path.read_text() + BUOYS + REPORTS)
    return drift.load(path)


@pytest.mark.thorough
@pytest.mark.parametrize("members", [False, True])
def test_the_same_bits_in_shards(tmp_path: Path, members: bool) -> None:
    shards.case(tmp_path, members=members)
    case = with_buoys(tmp_path)
    whole = drift.run(case)
    shards.same(whole, drift.run(case, shards=3))
    assert len(whole.summary["drifters"]["buoys"]) == 2
    assert len(whole.summary["reports"]["reports"]) == 2


@pytest.mark.thorough
def test_the_same_bits_in_a_search_in_shards(tmp_path: Path) -> None:
    """With a contact of debris, which shares the errors at buoys with its object."""
    shards.searched(tmp_path)
    case = with_buoys(tmp_path)
    whole = drift.run(case)
    shards.same(whole, drift.run(case, shards=2))
    areas = whole.summary["drifters"]["area_nmi2"]
    assert areas["with"]["95%"] < areas["without"]["95%"]


def spilled(folder: Path) -> drift.Case:
    """Return a spill with two buoys and a report of the current."""
    write_tracks(folder, "2026-11-21T00:00", [0, 60, 120, 180, 240])
    (folder / "land.geojson").write_text(spills.SHORE)
    text = spills.CASE.format(
        more=BUOYS.replace('windage = "2 %"', "") + REPORTS[: REPORTS.rindex("[[report]]")],
        duration="1 d",
        objects=60,
        worlds=240,
        per_world=20,
        seed=3,
    )
    path = folder / "case.toml"
    error = 'diffusivity = "50 m2/s"\ncurrent = { std = "0.2 m/s", time = "6 h" }'
    path.write_text(text.replace('diffusivity = "50 m2/s"', error))
    return drift.load(path)


@pytest.mark.thorough
def test_the_same_bits_of_a_spill_in_shards(tmp_path: Path) -> None:
    case = spilled(tmp_path)
    whole, divided = drift.run(case), drift.run(case, shards=2)
    assert whole.washup.identical(divided.washup)
    assert whole.forecast.data.identical(divided.forecast.data)


def test_the_objects_of_a_world_share_one_course_of_the_errors(tmp_path: Path) -> None:
    case = spilled(tmp_path)
    runtime.start()
    begin = run_setup.prepare(case, run_setup.open_for(case))
    for moment in simulate.run(begin.ensemble, begin.scene, begin.clock, np.array([3600])):
        assert moment.elapsed == 3600
    begin.scene.forcing.close()
    buoys = begin.scene.buoys
    (sight,) = buoys.sights
    np.testing.assert_allclose(buoys.places[:, sight.place] - [-0.03, -0.02], 0, atol=1e-12)
    world = begin.ensemble.world.to_numpy()
    states = np.stack(
        [begin.ensemble.own[f"buoy_state_0_{side}"].to_numpy() for side in ("east", "north")]
    )
    first = np.unique(world, return_index=True)[1]
    np.testing.assert_array_equal(states, states[:, first][:, world])
    assert np.unique(states[0]).size == case.spill.worlds
    own = begin.ensemble.own["current_error_east"].to_numpy()
    assert np.unique(own).size > 10 * case.spill.worlds
