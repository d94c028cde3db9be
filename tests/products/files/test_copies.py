"""Copies of the process that compute: the results of `map`, whatever becomes of a copy."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drift.products.files import copies

linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks")


def children() -> set[str]:
    """Return the processes that this one has begun and not waited for."""
    return set(
        " ".join(path.read_text() for path in Path("/proc/self/task").glob("*/children")).split()
    )


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
def test_a_thread_that_reads_standard_input_holds_no_copy_up() -> None:
    """As in a process of `drift serve`, which is asked through it."""
    code = """
import sys, threading, time
from drift.products.files import copies
threading.Thread(target=sys.stdin.buffer.readline, daemon=True).start()
time.sleep(0.2)
print(sum(map(len, copies.map_in_order(lambda item: item, [bytes(10**6)] * 3, 2))))
"""
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as one:
        assert one.stdout is not None
        assert one.stdout.readline() == "3000000\n"
        one.kill()


@linux
@pytest.mark.parametrize("end", ["dies", "hangs"])
def test_a_copy_that_takes_no_item(monkeypatch: pytest.MonkeyPatch, end: str) -> None:
    """The item is larger than what a pipe holds."""
    before = children()
    monkeypatch.setattr(copies, "PATIENCE", 0.2)
    how = {"dies": lambda owner: False, "hangs": lambda owner: time.sleep(600)}
    monkeypatch.setattr(copies, "follow_owner", how[end])
    item = bytes(10**6)
    assert list(copies.map_in_order(len, [item] * 5, 2)) == [10**6] * 5
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
import pathlib, time
from drift.products.files import copies
def slow(item):
    time.sleep(600)
def items():
    yield 1
    print(*[p.read_text() for p in pathlib.Path("/proc/self/task").glob("*/children")], flush=True)
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
