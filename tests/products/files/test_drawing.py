"""Pictures that copies of the process draw: all are there, whatever becomes of a copy."""

import gc
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from drift.products.files import copies, drawing
from drift.products.files.drawing import Draw

linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks")


def drawn(pictures: dict[str, Draw], folder: Path, processes: int) -> list[float]:
    """Draw pictures; return the shares that were told."""
    folder.mkdir()
    told: list[float] = []
    with drawing.draw_in_parallel(pictures, folder, processes) as finish:
        finish(told.append)
    assert sorted(p.name for p in folder.iterdir()) == sorted(pictures)
    return told


def by_whom(path: Path) -> None:
    """Draw, slowly enough that all processes get some, who draws."""
    time.sleep(0.05)
    path.write_text(str(os.getpid()))


@pytest.mark.parametrize("processes", [1, 2, 3])
def test_each_picture_is_drawn_once_and_told(tmp_path: Path, processes: int) -> None:
    many = {f"{k}.png": by_whom for k in range(8)}
    told = drawn(many, tmp_path / "out", processes)
    assert told == [k / 8 for k in range(1, 9)]
    who = {(tmp_path / "out" / name).read_text() for name in many}
    assert len(who) == (processes if sys.platform == "linux" else 1)
    assert drawn({}, tmp_path / "none", processes) == []


@linux
def test_only_copies_leave_the_results_out_of_the_search_for_cycles(tmp_path: Path) -> None:
    result: list[object] = []

    def is_searched(path: Path) -> None:
        time.sleep(0.05)
        path.write_text(f"{os.getpid()} {any(one is result for one in gc.get_objects())}")

    many = {f"{k}.png": is_searched for k in range(8)}
    drawn(many, tmp_path / "out", 2)
    told = {tuple((tmp_path / "out" / name).read_text().split()) for name in many}
    assert len(told) == 2
    assert all((who == str(os.getpid())) == (found == "True") for who, found in told)


def children() -> set[str]:
    """Return the processes that this one has begun and not waited for; tests before may have left
    some.
    """
    return set(
        " ".join(path.read_text() for path in Path("/proc/self/task").glob("*/children")).split()
    )


@linux
@pytest.mark.parametrize("end", ["dies", "hangs", "raises"])
def test_what_a_copy_does_not_finish_is_drawn_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    owner, before = os.getpid(), children()
    monkeypatch.setattr(copies, "PATIENCE", 0.3)

    def fatal(path: Path) -> None:
        by_whom(path)
        if os.getpid() != owner:
            path.write_text("half")
            if end == "dies":
                os.kill(os.getpid(), signal.SIGKILL)
            elif end == "hangs":
                time.sleep(600)
            raise ValueError("half")

    drawn({"a.png": fatal, "b.png": by_whom, "c.png": fatal, "d.png": fatal}, tmp_path / "out", 3)
    assert "half" not in {path.read_text() for path in (tmp_path / "out").iterdir()}
    assert children() == before  # no copy is left


@linux
def test_a_copy_warns_as_this_process_does(tmp_path: Path) -> None:
    def doubtful(path: Path) -> None:
        by_whom(path)
        warnings.warn(f"{path.name} is pale", stacklevel=2)

    with pytest.warns(UserWarning, match="is pale") as said:
        drawn({f"{k}.png": doubtful for k in range(4)}, tmp_path / "out", 2)
    assert sorted(str(one.message) for one in said) == [f"{k}.png is pale" for k in range(4)]


@linux
def test_a_system_that_grants_no_copy_costs_no_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused() -> int:
        raise BlockingIOError("no more processes")

    monkeypatch.setattr(os, "fork", refused)
    drawn({f"{k}.png": by_whom for k in range(3)}, tmp_path / "out", 4)


@linux
def test_copies_end_with_what_failed_here(tmp_path: Path) -> None:
    def slow(path: Path) -> None:
        time.sleep(600)

    before = children()
    with (
        pytest.raises(KeyboardInterrupt),
        drawing.draw_in_parallel({"a.png": slow, "b.png": slow}, tmp_path, 2),
    ):
        raise KeyboardInterrupt
    assert children() == before


OWNER = """
import os, sys, time
from pathlib import Path
from drift.products.files import copies, drawing
def slow(path):
    path.write_text(str(os.getpid()))
    time.sleep(600)
with drawing.draw_in_parallel({"a.png": slow, "b.png": slow}, Path(sys.argv[1]), 2):
    time.sleep(600)
"""


@linux
def test_no_copy_outlives_an_owner_that_is_killed(tmp_path: Path) -> None:
    def until(what: Callable[[], object]) -> None:
        end = time.monotonic() + 60
        while not what():
            assert time.monotonic() < end
            time.sleep(0.02)

    owner = subprocess.Popen([sys.executable, "-c", OWNER, str(tmp_path)])
    until(lambda: (tmp_path / "a.png").exists() and (tmp_path / "a.png").read_text())
    state = Path("/proc", (tmp_path / "a.png").read_text(), "stat")
    owner.kill()
    owner.wait()
    until(lambda: not state.exists() or state.read_text().split()[2] == "Z")
