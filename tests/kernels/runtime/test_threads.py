"""Threads: of a program that runs cases in several, and of the cores that a run uses."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import trial_case

import drift
from drift.apps.cli import cards, commands
from drift.forecast.products import chapter
from geo.errors import UserError
from kernels.runtime import runtime

HEAD = """
import asyncio, sys, threading
import drift
from kernels.runtime import runtime
cases = [drift.load(sys.argv[1], {"seed": str(seed)}) for seed in (3, 4)]
def seen(case):
    return drift.run(case).probability.values.tobytes()
"""
AT_ONCE = """
found = {}
threads = [threading.Thread(target=lambda k=k: found.update({k: seen(cases[k])})) for k in (0, 1)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
assert [found[k] for k in (0, 1)] == [seen(case) for case in cases]
print("as one after another")
"""
ASYNC = """
runtime.start()
async def both():
    return await asyncio.gather(*(asyncio.to_thread(seen, case) for case in cases))
assert asyncio.run(both()) == [seen(case) for case in cases]
print("as one after another")
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return trial_case.write(
        tmp_path,
        duration="2 h",
        particles=1000,
        clock={"step": "10 min"},
        uncertainty={"diffusivity": "10 m2/s"},
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    "program", [pytest.param(AT_ONCE, id="threads"), pytest.param(ASYNC, id="asyncio")]
)
def test_threads_of_a_program_run_cases_one_after_another(path: Path, program: str) -> None:
    """Whether Taichi was started by the main thread or by neither; the maps are those of the main
    thread, bit for bit.
    """
    made = subprocess.run(
        [sys.executable, "-c", HEAD + program, str(path)], capture_output=True, text=True
    )
    assert (made.returncode, made.stdout) == (0, "as one after another\n"), made.stderr


@pytest.mark.thorough
def test_a_run_may_be_started_while_another_one_reports(path: Path) -> None:
    """From the same thread, as a notebook's callback may."""
    inner = []

    def report(phase: str, share: float) -> None:
        if not inner:
            inner.append(None)
            inner[0] = drift.run(drift.load(path)).probability.values

    outer = drift.run(drift.load(path), report=report).probability.values
    np.testing.assert_array_equal(inner[0], outer)


def test_a_thread_waits_until_another_one_is_done() -> None:
    order = []

    def late() -> None:
        with runtime.alone():
            order.append("late")

    with runtime.alone(), runtime.alone():
        other = threading.Thread(target=late)
        other.start()
        time.sleep(0.05)
        order.append("early")
    other.join()
    assert order == ["early", "late"]


def test_a_graphics_card_serves_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "_started", {"backend": "cuda", "threads": 2, "thread": -1})
    with pytest.raises(UserError, match="a graphics card serves the thread that started it"):
        runtime.start("cuda")


PLAIN = """
import sys
from drift.apps.cli import commands
from drift.forecast.products import chapter
chapter.PICTURES, chapter.SCENARIO_PICTURES = {}, {}
sys.exit(commands.main(sys.argv[1:]))
"""


def test_more_threads_than_cores_are_announced_before_the_run(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(*_: object) -> None:
        raise UserError("stopped here")

    monkeypatch.setattr(cards, "start_backend", stop)
    assert commands.main(["run", str(path), "--threads", str(runtime.cores() + 1)]) != 0
    first, *_ = capsys.readouterr().err.splitlines()
    cores = runtime.cores()
    assert first == f"drift: --threads {cores + 1}: uses {cores}, all the cores available here"


@pytest.mark.thorough
def test_more_threads_than_cores_are_capped_with_a_word(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A billion threads run as all cores do, and change no bit.

    No pictures are drawn: they are of the same numbers.
    """
    words = ["run", str(path), "--out", str(tmp_path / "out"), "--threads", "1000000000"]
    made = subprocess.run(
        [sys.executable, "-c", PLAIN, *words], capture_output=True, text=True, check=True
    )
    assert (
        made.stderr
        == f"drift: --threads 1000000000: uses {runtime.cores()}, all the cores available here\n"
    )
    monkeypatch.setattr(chapter, "PICTURES", {})
    monkeypatch.setattr(chapter, "SCENARIO_PICTURES", {})
    result = drift.run(drift.load(path), out=tmp_path / "few")
    assert result.summary["run"]["particles"] == 1000
    tables = [
        (tmp_path / folder / "track.csv").read_text().splitlines() for folder in ("out", "few")
    ]
    without_id = [[line.rpartition(",")[0] for line in table] for table in tables]
    assert without_id[0] == without_id[1]


def test_cores_follow_the_container_s_quota(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime.os, "sched_getaffinity", lambda process: range(12), raising=False)
    monkeypatch.setattr(runtime, "CGROUPS", tmp_path)
    assert runtime.cores() == 12
    (tmp_path / "cpu").mkdir()
    (tmp_path / "cpu/cpu.cfs_period_us").write_text("100000\n")
    for quota, cores in (("-1", 12), ("250000", 3), ("10000", 1), ("9900000", 12)):
        (tmp_path / "cpu/cpu.cfs_quota_us").write_text(quota + "\n")
        assert runtime.cores() == cores
    for written, cores in (("max 100000\n", 12), ("450000 100000\n", 5), ("nonsense", 12)):
        (tmp_path / "cpu/cpu.cfs_quota_us").write_text("-1\n")
        (tmp_path / "cpu.max").write_text(written)
        assert runtime.cores() == cores
    monkeypatch.delattr(runtime.os, "sched_getaffinity")
    monkeypatch.setattr(runtime.os, "cpu_count", lambda: None)
    assert runtime.cores() == 1
