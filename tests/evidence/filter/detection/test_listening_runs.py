"""Watches of passive sonars in whole runs: outputs, threads, resampling and shards change nothing."""

import math
from pathlib import Path

import numpy as np
import pytest
import sonars
from listening_arrays import LEVELS, LOOK, MOVING, RAFT, STEAD, WATCH, array, everything
from one_thread import Process
from sonars import run

import drift
from drift.pipeline import flow, run_setup


@pytest.mark.thorough
def test_outputs_show_watches_under_way_and_change_nothing(tmp_path: Path) -> None:
    """In the middle of a watch weights are those of a watch that ends there; the end has the same
    bits.
    """
    text = everything(tmp_path)
    plain = run(tmp_path, text)
    more = run(tmp_path, text, outputs=[0.31, 1.1, 1.25, 2.9, 3.3, 4.0, 5.5])
    assert plain.said.tobytes() == more.said.tobytes()
    assert len(np.unique(plain.said)) > 200
    sonar = array(at=STEAD, heading=205.0, levels=LEVELS)
    whole = run(tmp_path, MOVING + sonar.text(tmp_path) + WATCH, outputs=[2.2])
    part = run(tmp_path, MOVING + sonar.text(tmp_path) + WATCH.replace("+5.6 h", "+2.2 h"))
    then = (
        next(m for m in whole.moments if m.elapsed == 7920).log_weight.astype(float)
        - whole.moments[0].log_weight
    )
    np.testing.assert_array_equal(then, part.said)


THREADS = """
from pathlib import Path
import sonars
answer = sonars.run(Path(given[0]), given[1]).said.tobytes().hex()
"""


@pytest.mark.thorough
def test_one_thread_and_two(one_thread: Process, tmp_path: Path) -> None:
    text = everything(tmp_path)
    assert one_thread.ask(THREADS, str(tmp_path), text) == run(tmp_path, text).said.tobytes().hex()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("method", "across"),
    [
        pytest.param("kahn", "false", marks=pytest.mark.thorough),
        ("systematic", "true"),
    ],
)
def test_resampling_keeps_what_has_been_heard(tmp_path: Path, method: str, across: str) -> None:
    """Resampled in the middle of watches that share an unknown: evidence by scenario within 3.5
    standard errors of the draw.
    """
    text = everything(tmp_path)
    text += '[[look]]\nname = "y"\ntime = "+2.1 h"\nsees = "something"\n'
    text += 'at = [-30.2, 36.0]\nradius = "14 nmi"\nfalse_alarms = 0.05\n'
    plain = run(tmp_path, text, particles=2000)
    anew = run(
        tmp_path,
        text + f'[resampling]\nmethod = "{method}"\nbelow = 0.9\nacross_scenarios = {across}\n',
        particles=2000,
    )
    assert any(update.resampled for update in anew.updates.all)
    found, exact = (
        sum(update.log_evidence[:4] for update in ran.updates.all) for ran in (anew, plain)
    )
    for k in range(4):
        likelihood = np.exp(plain.said[plain.scenario == k])
        error = likelihood.std() / likelihood.mean() / math.sqrt(likelihood.size)
        # The draw adds at most as much again as there is between particles.
        assert abs(found[k] - exact[k]) < 3.5 * math.sqrt(2) * error, k


@pytest.mark.thorough
@pytest.mark.usefixtures("coarse_maps")
def test_in_shards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three shards tell to the bit what one piece does: tracks with weights, updates."""
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)
    text = sonars.HEAD.replace("DURATION", "6").replace("PARTICLES", "9000").replace(
        "STEP", "60"
    ) + everything(tmp_path)
    text = text.replace("output.times = []", 'output.every = "6 h"\noutput.trajectories = 9000')
    (tmp_path / "case.toml").write_text(text)
    case = drift.load(tmp_path / "case.toml")
    one, three = drift.run(case), drift.run(case, shards=3)
    for name in ("lon", "lat", "status", "weight"):
        assert (
            getattr(one.trajectories, name).tobytes() == getattr(three.trajectories, name).tobytes()
        ), name
    assert one.updates is not None
    assert three.updates is not None
    assert len(one.updates.all) == 3
    for a, b in zip(one.updates.all, three.updates.all, strict=True):
        assert np.asarray(a.log_evidence).tobytes() == np.asarray(b.log_evidence).tobytes()


def test_memory_of_what_listens_is_reckoned(tmp_path: Path) -> None:
    """A watch keeps 17 numbers of four bytes for each value of its unknown, of which there are 8,
    and an output a copy.
    """
    path = tmp_path / "case.toml"
    head = sonars.HEAD.replace("DURATION", "6").replace("PARTICLES", "100").replace("STEP", "60")
    sonar = array(at=STEAD, heading=205.0, unknown=3.0)
    found = []
    for watch in (
        "",
        WATCH.replace("5.6", "2"),
        WATCH.replace("5.6", "2") + WATCH.replace("0.3", "2").replace('"w"', '"v"'),
    ):
        path.write_text(head + RAFT + sonar.text(tmp_path) + LOOK + watch)
        found.append(run_setup.extra_bytes_per_particle(drift.load(path)))
    assert 2 * 17 * 4 * 8 <= found[1] - found[0] < 2 * 17 * 4 * 8 + 50
    assert found[2] - found[1] < 50  # it begins when the other is over
