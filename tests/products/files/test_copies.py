"""Copies of the process that compute: the results of `map`, whatever becomes of a copy."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from drift.products.files import copies

linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks")


def children() -> set[int]:
    return {child.pid or 0 for child in multiprocessing.active_children()}


@pytest.mark.parametrize("many", [0, 1, 2, 3, 7])
@pytest.mark.parametrize("processes", [1, 2, 3])
def test_results_in_order_by_copies(many: int, processes: int) -> None:
    """Later items are quicker, so that copies finish them first."""

    def squared(item: int) -> tuple[int, int]:
        time.sleep(0.01 * (many - item))
        return item * item, os.getpid()

    before = children()
    done = list(copies.map_in_order(squared, iter(range(many)), processes))
    assert [value for value, _ in done] == [item * item for item in range(many)]
    alone = processes == 1 or sys.platform != "linux"
    assert (os.getpid() in {who for _, who in done}) == (alone and many > 0)
    assert len({who for _, who in done}) == (min(many, 1) if alone else min(many, processes))
    assert children() == before


@linux
@pytest.mark.parametrize("end", ["dies", "hangs", "raises"])
def test_what_a_copy_does_not_answer_is_computed_here(
    monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    owner, before = os.getpid(), children()
    monkeypatch.setattr(copies, "PATIENCE", 0.2)

    def fatal(item: int) -> int:
        if os.getpid() != owner and item in (1, 4):
            if end == "dies":
                os.kill(os.getpid(), signal.SIGKILL)
            elif end == "hangs":
                time.sleep(600)
            raise ValueError("half")
        return 3 * item

    assert list(copies.map_in_order(fatal, range(9), 2)) == [3 * item for item in range(9)]
    assert children() == before


@linux
def test_an_error_is_that_of_this_process() -> None:
    def fails(item: int) -> float:
        return 1 / item

    before = children()
    found = copies.map_in_order(fails, (2, 1, 0, 5), 2)
    assert [next(found), next(found)] == [0.5, 1.0]
    with pytest.raises(ZeroDivisionError):
        next(found)
    assert children() == before


@linux
def test_copies_end_when_their_results_are_no_longer_wanted() -> None:
    before = children()
    found = copies.map_in_order(abs, range(-9, 0), 2)
    assert next(found) == 9
    assert len(children() - before) == 2
    found.close()  # type: ignore[attr-defined]
    assert children() == before


def lives(process: str) -> bool:
    """Return whether a process runs, and is not only waited for by none."""
    try:
        about = (Path("/proc") / process / "stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return about.rpartition(")")[2].split()[0] != "Z"


@linux
def test_copies_die_with_their_owner() -> None:
    code = """
import multiprocessing, time
from drift.products.files import copies
def slow(item):
    time.sleep(600)
def items():
    yield 1
    print(*[child.pid for child in multiprocessing.active_children()], flush=True)
    time.sleep(600)
list(copies.map_in_order(slow, items(), 2))
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        left = owner.stdout.readline().split()
        assert [lives(one) for one in left] == [True, True]
        owner.kill()
    while any(map(lives, left)):  # the time limit of tests ends this
        time.sleep(0.05)


def test_a_system_that_allows_no_more_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> int:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(os, "fork", refused)
    assert list(copies.map_in_order(abs, range(-3, 1), 3)) == [3, 2, 1, 0]


@linux
def test_a_daemon_has_no_copies() -> None:
    """A process that multiprocessing ends with its parent may have no children."""
    here, there = multiprocessing.Pipe()

    def compute(send: Callable[[list[int]], None]) -> None:
        send(list(copies.map_in_order(abs, (-1, -2), 2)))

    context = multiprocessing.get_context("fork")
    process = context.Process(target=compute, args=(there.send,), daemon=True)
    process.start()
    assert here.recv() == [1, 2]
    process.join()
