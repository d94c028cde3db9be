"""Resampling across scenarios can leave a scenario without particles, so later stretches have fewer
shards: workers still read all shards of the outputs before.
"""

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shards as runs
import trial_case

import drift
from drift.pipeline.shards import cluster, work
from drift.pipeline.shards import run as shards_run

SEEN = """
[[contact]]
name = "seen"
time = "+2 h"
position = { at = "27 40N 087 59W", std = "1 nmi" }
[resampling]
below = 0.9
across_scenarios = true
"""
PLACES = {"north": "27 40N 088 01W", "south": "27 10N 088 10W"}


def load(folder: Path) -> drift.Case:
    """Return a case of two blocks, one a scenario, of which the contact leaves the first."""
    scenarios = [
        {"name": name, "object": "water", "position": {"at": place, "std": "1 nmi"}}
        for name, place in PLACES.items()
    ]
    output = {"every": "1 h", "trajectories": 20}
    return trial_case.load(
        folder, SEEN, scenario=scenarios, duration="3 h", particles=2000, output=output
    )


def check_first_map(result: drift.Result) -> None:
    """Half of the probability is in the south before the contact, and nothing after it."""
    south = result.probability.sel(lat=slice(None, 27.4)).sum(["lat", "lon"]).values
    assert south[0] == pytest.approx(0.5, abs=1e-6)
    assert south[-1] == 0.0
    assert np.allclose(result.probability.sum(["lat", "lon"]), 1, atol=1e-6)


def test_outputs_before_resampling_are_read_from_all_their_shards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The client answers here, one task after another."""
    case = load(tmp_path)
    asked: list[int] = []

    def submit(function: Any, mark: object, output: Any, question: Any, **more: object) -> Any:
        asked.append(output.n)
        return question(output)

    client = SimpleNamespace(
        nthreads=lambda: {"one": 1, "other": 1},
        wait_for_workers=lambda *given, **more: None,
        submit=submit,
        cancel=lambda tasks: None,
    )
    monkeypatch.setattr(cluster, "_result_of", lambda client, task, *more: task)
    kept = work.Work(tmp_path, "")
    deal = partial(cluster.answer_on_workers, client, kept, {})
    monkeypatch.setattr(shards_run, "answer_here", deal)
    check_first_map(drift.run(case, shards=2))
    assert {*asked} == {2000}


@pytest.mark.thorough
def test_workers_read_all_shards_of_outputs_before_resampling(client: Any, tmp_path: Path) -> None:
    case = load(tmp_path)
    done = drift.run(case, client=client, shards=2)
    check_first_map(done)
    runs.same(done, drift.run(case))
