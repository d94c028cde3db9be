"""What takes no forcing, by a second model of motion: its reach, its coast, and sources that end
before the run does.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import small_case
import trial_case

import drift
from drift.engine.environment import coastline, domain, environment
from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.models.by_name import MODELS
from drift.engine.motion.models.drift import DRIFT
from drift.engine.motion.objects import leeway
from drift.engine.particles.status import Status
from drift.pipeline import run_setup
from geo import sphere
from geo.box import Box
from geo.errors import UserError
from geo.forcing import sources
from geo.grids.grid import Grid

SPEED = {"slow": 0.1, "swift": 20.0}  # [m/s]


@pytest.fixture
def case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> drift.Case:
    """A case of one scenario; beside drift stands a model that is not forced, whose parameter is a
    key of SPEED.
    """
    steaming = replace(
        DRIFT,
        forced=False,
        usual=lambda scenario, wind: SPEED[scenario.motion],
        fastest=lambda scenario, wind, spreads: SPEED[scenario.motion] * (1 + spreads),
    )
    monkeypatch.setitem(MODELS, "steaming", steaming)
    slow = {"toward": 70, "speed": "0.3 m/s"}
    return trial_case.load(
        tmp_path,
        start="2026-11-21T06:00Z",
        duration="10 h",
        current={"table": [{"time": "+0 h", **slow}, {"time": "+5 h", **slow}]},
        scenario={"name": "boat", "position": {"at": [3.0, 2.0], "std": 0}},
    )


def spec(case: drift.Case, *motions: str | None) -> EnsembleSpec:
    """Return what is drawn where one scenario drifts (None) or steams as fast as SPEED says."""
    (boat,) = case.scenarios
    steaming = [
        boat if motion is None else replace(boat, model="steaming", motion=motion)
        for motion in motions
    ]
    return replace(run_setup.ensemble_spec(case), scenarios=tuple(steaming))


def reach(box: Box) -> float:
    """Return the speed [m/s] with which a box is drawn about a point: half its height over the
    run's time.
    """
    return float(np.radians(box.north - box.south) / 2 * sphere.RADIUS / (10 * 3600))


def test_the_reach_of_what_takes_no_current_is_its_own_speed(case: drift.Case) -> None:
    drifting = reach(domain.within_reach(spec(case, None)))
    assert reach(domain.within_reach(spec(case, "slow"))) == pytest.approx(0.1, rel=1e-6)
    assert reach(domain.within_reach(spec(case, "swift"))) == pytest.approx(20.0, rel=1e-6)
    assert 2.5 <= drifting < 20
    assert reach(domain.within_reach(spec(case, None, "slow"))) == drifting
    debris = replace(spec(case, "slow"), debris=(leeway.find_class("water"),))
    assert reach(domain.within_reach(debris)) == drifting


def test_the_utmost_reach_is_its_own_speed_too(case: drift.Case) -> None:
    asked = run_setup.environment_spec(case)
    assert reach(domain.outermost_box(spec(case, "swift"), asked)) == pytest.approx(
        20 * (1 + domain.FARTHEST), rel=1e-6
    )
    drifting = reach(domain.outermost_box(spec(case, None), asked))
    assert drifting > 5.9  # UTMOST_CURRENT and UTMOST_STOKES
    assert reach(domain.outermost_box(spec(case, None, "slow"), asked)) == drifting


def test_the_coast_is_cut_only_where_all_is_lost_without_a_current(case: drift.Case) -> None:
    box = Box(0.0, 0.0, 8.0, 6.0)
    part = replace(sources.constant_field("current", 0.3, 0.0), grid=Grid(2.0, 1.0, 1.0, 1.0, 4, 4))
    assert coastline.coast_box(spec(case, None), box, [part]).north < 4.5
    for motions in (("slow",), (None, "slow")):
        whole = coastline.coast_box(spec(case, *motions), box, [part])
        assert whole.south < box.south
        assert whole.north > box.north
        assert whole == coastline.coast_box(spec(case, *motions), box, [])  # with no current at all


def test_a_current_that_ends_ends_no_run_of_what_takes_none(case: drift.Case) -> None:
    asked = run_setup.environment_spec(case)
    for refused in (
        spec(case, None),
        replace(spec(case, "slow"), debris=(leeway.find_class("water"),)),
    ):
        with pytest.raises(UserError, match="lasts from"):
            environment.open_for(refused, asked, {})
    environment.open_for(spec(case, "slow"), asked, {})


def test_a_short_source_within_a_longer_one_leaves_no_hole(tmp_path: Path) -> None:
    """Two nested currents: one for the whole run, one from its second to its fourth hour."""
    nested = small_case.CASE.replace(
        "[[wind]]", '[[current]]\nname = "bay"\ndataset = "bay"\n[[wind]]'
    ).replace('files = "current.nc"', 'dataset = "sea"')
    (tmp_path / "case.toml").write_text(nested)
    sea = small_case.field()
    bay = sea.isel(time=slice(4, 7), lon=slice(4, 16), lat=slice(4, 14))
    for first, second in ((sea, bay), (bay, sea)):
        result = drift.run(
            drift.load(tmp_path / "case.toml", {"particles": 50}),
            datasets={"sea": first, "bay": second},
        )
        assert "no values" not in " ".join(result.summary["warnings"])
        lost = result.forecast.data["status_probability"].sel(status="outside").values
        assert (lost == 0).all()


def test_what_never_went_ashore_has_no_edge_of_the_shoreline(tmp_path: Path) -> None:
    """Some of it leaves a small domain, the rest is afloat at the end."""
    small = small_case.STEADY + "[domain]\nwest = -90\neast = -87.93\nsouth = 26\nnorth = 29\n"
    (tmp_path / "case.toml").write_text(small)
    result = drift.run(drift.load(tmp_path / "case.toml", {"particles": 50, "max_lost": 1}))
    status = result.trajectories.status[:, -1]
    assert 0 < (status == Status.LEFT).sum() < status.size
    assert (result.trajectories.edge == -1).all()
