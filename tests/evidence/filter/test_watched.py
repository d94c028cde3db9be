"""Whether anybody looks on changes nothing of how targets go."""

from pathlib import Path

import numpy as np

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.pipeline import run_setup

CASE = """
title = "watched"
start = "2026-06-01T00:00Z"
duration = "7 h"
particles = 3000
seed = 11
output.times = ["+7 h"]
clock.step = "1 h"
coast.source = "none"
[[current]]
name = "set"
constant = { speed = "1.7 kn", toward = 65 }
[[scenario]]
name = "yacht"
weight = 0.6
vessel = { currents = "felt" }
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = ["36 00N 030 00W", "36 02N 029 57W", "36 01N 029 55W", "36 20N 029 40W"]
departure = ["+0 min", "+150 min"]
speed = ["5 kn", "9 kn"]
cross_track = "1 nmi"
[[scenario]]
name = "wanderer"
weight = 0.4
position = { at = "36 10N 029 50W", std = "3 nmi" }
[[scenario.phase]]
course = { course = [40, 200], speed = ["3 kn", "8 kn"], change = "25 min" }
"""
WATCH = """
[[sensor]]
name = "eye"
at = "36 10N 029 45W"
[sensor.sonar]
loss = { transition = "5 km", to = "30 nmi" }
noise = "70 dB"
[[sortie]]
name = "eye"
start = "+20 min"
end = "+6 h"
watch = { sensor = "eye" }
"""


def moved(folder: Path, text: str) -> dict[str, np.ndarray]:
    path = folder / "case.toml"
    path.write_text(text)
    case = case_file.load(path)
    begin = run_setup.prepare(case, run_setup.open_for(case))
    search = run_setup.build_search_filter(case, begin)
    for _ in simulate.run(
        begin.ensemble, begin.scene, begin.clock, case.period.seconds(case.outputs), search=search
    ):
        pass
    begin.scene.forcing.close()
    e = begin.ensemble
    return {
        name: e.columns[name].to_numpy()
        for name in ("lon", "lat", "status", "status_since", "to_time", "leg")
    }


def test_a_watch_changes_no_way(tmp_path: Path) -> None:
    """Targets that the current sets, that turn several times within a step, and that arrive within
    one.
    """
    levels = CASE.replace("vessel = {", 'source_level = "120 dB"\nvessel = {').replace(
        "weight = 0.4", 'weight = 0.4\nsource_level = "120 dB"'
    )
    alone, watched = moved(tmp_path, CASE), moved(tmp_path, levels + WATCH)
    assert 0.2 < np.mean(alone["status"] == 7) < 0.9  # arrived
    for name, column in alone.items():
        assert np.array_equal(column, watched[name]), name
