"""What a sortie costs does not grow with the number of scenarios: its launches do not."""

from pathlib import Path

import pytest

import drift
from kernels.evidence import sweep

HEAD = """
start = "2026-11-21T06:10Z"
duration = "6 h"
particles = 1200
clock.step = "1 h"
coast.source = "none"
resampling.below = 0
[[current]]
name = "ebb"
constant = { speed = "0.6 kn", toward = 70 }
[[current]]
name = "flood"
constant = { speed = "0.4 kn", toward = 235 }
[[sortie]]
name = "grid"
start = "+90 min"
speed = "90 kn"
sweep_width = "1.1 nmi"
sweep_width_uncertainty = "30 %"
pattern = { kind = "parallel", centre = [3.02, 2.01], length = "9 nmi", width = "7 nmi", orientation = 150, spacing = "1 nmi" }
[[sortie]]
name = "datum"
start = "+140 min"
speed = "70 kn"
sweep_width = "0.7 nmi"
frame = "datum"
pattern = { kind = "sector", datum = [3.04, 2.03], radius = "4 nmi" }
"""
STORY = """
[[scenario]]
name = "story {k}"
weight = {weight}
object = "water"
currents = ["{current}"]
position = {{ at = [3.0{k}, 2.01], error = "2 nmi" }}
"""


@pytest.mark.thorough
def test_launches_of_a_sortie_go_by_currents_and_not_by_scenarios(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The grid is the same in every scenario; the pattern about a datum drifts with either current."""
    seen: list[tuple[int, ...]] = []
    failed: list[object] = []
    expose, fail = sweep.expose, sweep.fail

    def counted(ensemble: object, paths: object, *given: object) -> None:
        seen.append(paths.own.scenarios)
        expose(ensemble, paths, *given)

    def missed(*given: object) -> None:
        failed.append(given)
        fail(*given)

    monkeypatch.setattr(sweep, "expose", counted)
    monkeypatch.setattr(sweep, "fail", missed)
    launches = []
    for count in (2, 9):
        stories = [
            STORY.format(k=k, current=("ebb", "flood")[k % 2], weight=1 / count)
            for k in range(count)
        ]
        (tmp_path / "case.toml").write_text(HEAD + "".join(stories))
        seen.clear(), failed.clear()
        drift.run(drift.load(tmp_path / "case.toml", {"output": '{ every = "6 h" }'}))
        of = {
            "ebb": tuple(range(0, count, 2)),
            "flood": tuple(range(1, count, 2)),
            "both": tuple(range(count)),
        }
        launches.append({name: seen.count(which) for name, which in of.items()})
        assert sum(launches[-1].values()) == len(seen)
        launches[-1]["failed"] = len(failed)
    assert launches[0] == launches[1]
    assert 0 < launches[0]["ebb"] == launches[0]["flood"]
    assert launches[0]["both"] > 0
    assert launches[0]["failed"] > 1
