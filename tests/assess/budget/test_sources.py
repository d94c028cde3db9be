"""What is off where a source of spread is off, and what rejects a case or an option."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trial_case

import drift
from drift.assess.budget import sources
from drift.engine.motion.objects.leeway import find_class
from drift.pipeline import run_setup

CONCAVE = [[-88.0, 27.0], [-87.0, 27.0], [-87.0, 28.0], [-87.1, 28.0], [-87.1, 27.1], [-88.0, 27.1]]


def test_a_raft_midway_keeps_its_spread_and_does_not_jibe(tmp_path: Path) -> None:
    wind = {"constant": {"speed": "20 kn", "toward": 30}}
    case = trial_case.load(tmp_path, wind=wind, scenario={"object": "LIFE-RAFT-DB-10"})
    own = find_class("LIFE-RAFT-DB-10")
    (changed,) = sources.case_without(case, {"side"}).scenarios
    assert changed.jibe_rate == 0 < case.scenarios[0].jibe_rate
    for side in ("right", "left"):
        line, before = getattr(changed.object, side), getattr(own, side)
        assert line.slope == (own.right.slope + own.left.slope) / 2
        assert line.offset == (own.right.offset + own.left.offset) / 2
        assert (line.std, line.spread) == (before.std, before.spread)
    assert changed.object.down == own.down
    (changed,) = sources.case_without(case, {"leeway"}).scenarios
    assert changed.jibe_rate == case.scenarios[0].jibe_rate
    assert {(one.std, one.spread) for one in (changed.object.down, changed.object.left)} == {(0, 0)}
    assert changed.object.right.slope == own.right.slope


def test_errors_are_off_one_by_one(tmp_path: Path) -> None:
    errors = {
        "current": {"std": 0.2, "time": "3 h", "bias": 0.07},
        "wind": {"std": 1.7, "time": "4 h"},
        "diffusivity": "12 m2/s",
    }
    case = trial_case.load(tmp_path, uncertainty=errors)
    off = sources.case_without(case, {"current"})
    assert (off.current_error.std, off.current_error.bias) == (0, 0)
    assert (off.wind_error, off.diffusivity) == (case.wind_error, 12.0)
    off = sources.case_without(case, {"wind", "diffusion"})
    assert (off.wind_error.std, off.diffusivity) == (0, 0)
    assert off.current_error == case.current_error


REPORTS = [
    {"wind": {"speed": "28 kn", "from": 240}, "at": "27 33N 087 50W", "time": "+1 h", "error": "3 kn"},
    {"current": {"speed": "0.9 kn", "toward": 20}, "at": "27 31N 088 01W", "time": "+2 h", "error": "0.1 kn"},
]  # fmt: skip
CHANGE = {"name": "swamped", "rate": "0.2/h", "object": "PIW-1"}


def test_what_is_seen_on_scene_goes_with_its_error(tmp_path: Path) -> None:
    errors = {"current": {"std": 0.2, "time": "3 h"}, "wind": {"std": 2, "time": "4 h"}}
    wind = {"constant": {"speed": "20 kn", "toward": 30}}
    scenario = {"object": "LIFE-RAFT-DB-10", "change": [CHANGE]}
    case = trial_case.load(
        tmp_path, uncertainty=errors, wind=wind, scenario=scenario, report=REPORTS
    )
    where = run_setup.open_for(case)
    keys = [source.key for source in sources.present_sources(case, where)]
    assert keys == ["start", "current", "wind", "leeway", "changes", "side"]
    for off, left in (
        (set(), ["wind", "current"]),
        ({"current"}, ["wind"]),
        ({"wind"}, ["current"]),
        ({"current", "wind", "changes", "leeway"}, []),
    ):
        changed = sources.case_without(case, off)
        assert [report.quantity for report in changed.reports] == left
        run_setup.prepare(changed, where).scene.forcing.close()
    assert changed.scenarios[0].changes == ()
    assert not changed.current_error.tailed
    (midway,) = sources.case_without(case, {"side"}).scenarios
    assert all(one.right.slope == one.left.slope for one in midway.objects)
    (mean,) = sources.case_without(case, {"leeway"}).scenarios
    assert {drifter.down.std for drifter in mean.objects} == {0.0}
    assert len(mean.objects) == 2


def started(case: drift.Case, off: set[str]) -> Any:
    where = run_setup.open_for(case)
    begin = run_setup.prepare(case, where)
    begin.scene.forcing.close()
    sources.hold_ensemble(case, begin.ensemble, off)
    return begin.ensemble


def test_a_start_that_is_off_is_one_place_in_the_area(tmp_path: Path) -> None:
    area = {"polygon": CONCAVE, "time": "+1 h", "until": "+3 h"}
    case = trial_case.load(tmp_path, scenario={"position": None, "area": area})
    ensemble = started(case, {"start"})
    lon, lat = (np.unique(one.to_numpy()) for one in (ensemble.lon, ensemble.lat))
    assert (lon.size, lat.size) == (1, 1)
    degrees = 360 / 2**32
    place = shapely.Point(lon[0] * degrees, lat[0] * degrees)
    ring = shapely.Polygon(CONCAVE)
    assert not ring.contains(ring.centroid)
    assert ring.contains(place)
    (release,) = np.unique(ensemble.release.to_numpy())
    # the median of 500 uniform times errs by half the window over sqrt(500)
    assert release == pytest.approx(2 * 3600, abs=3 * 3600 / np.sqrt(500))


def test_a_trackline_that_is_off_keeps_its_time(tmp_path: Path) -> None:
    track = {
        "waypoints": [[-88.0, 27.0], [-87.5, 27.3]],
        "departure": "+0 h",
        "speed": "10 kn",
        "cross_track": "0 nmi",
    }
    case = trial_case.load(tmp_path, scenario={"position": None, "trackline": track})
    whole, ensemble = started(case, set()), started(case, {"start"})
    lon, lat, release = (getattr(ensemble, name).to_numpy() for name in ("lon", "lat", "release"))
    every = np.stack([getattr(whole, n).to_numpy() for n in ("lon", "lat", "release")])
    one = np.array([lon[0], lat[0], release[0]])
    assert (every == one[:, None]).all(axis=0).any()
    assert np.unique(release).size == 1


def rejected(case: drift.Case, **options: Any) -> str:
    with pytest.raises(drift.UserError) as raised:
        drift.budget(case, **options)
    (line,) = raised.value.lines
    return line


def test_what_is_rejected(tmp_path: Path) -> None:
    case = trial_case.load(tmp_path)
    assert "particles = 3999: must be at least 4,000" in rejected(case, particles=3999)
    assert "must be in the run, from 210000ZNOV26 to 210600ZNOV26" in rejected(case, times=["+7 h"])
    assert '"noon"' in rejected(case, times="noon")
    certain = {"position": {"at": "27 30N 088 00W", "std": 0}}
    assert "nothing is uncertain in this case" in rejected(
        trial_case.load(tmp_path, scenario=certain), particles=4000
    )
    late = {"position": {"at": "27 30N 088 00W", "std": "1 nmi", "time": "+2 h"}}
    line = rejected(trial_case.load(tmp_path, scenario=late), particles=4000, times=["+1 h"])
    assert "100 % of the probability of case.toml is not adrift yet" in line


def test_what_steers_or_is_a_spill_is_rejected() -> None:
    assert "is for search objects" in rejected(drift.load("gulf_containers"))
    assert "steers" in rejected(drift.load("medsearch_transit"))
