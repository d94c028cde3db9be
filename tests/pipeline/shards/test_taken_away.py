"""What a run in shards needs is taken away while it lasts: files of its folder, workers as they
answer; and Ctrl-C in the terminal that it shares with its workers.
"""

import logging
import os
import pickle
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shards as runs

import drift
from drift.apps.cli import commands
from drift.engine.particles.ensemble import Layout
from drift.pipeline import flow
from drift.pipeline.shards import cluster, shelf, unit, work
from drift.products.files import hidden, interrupt
from kernels.runtime import runtime

MARK = {"the case": "one"}


@pytest.fixture(autouse=True)
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


def read_after(out: Path, size: int | None) -> None:
    """Read a checked file of a shard after it was cut to a size [bytes]; None: deleted."""
    with shelf.open_shelf(out, MARK, 0) as kept:
        with kept.also("shard-00000", 5) as reel:
            reel.note("values", np.arange(5.0))
        found = kept.read("shard-00000")
        assert found.noted("values").tolist() == [0, 1, 2, 3, 4]
        data = kept.folder / "shard-00000.bin"
        data.unlink() if size is None else os.truncate(data, size)
        found.noted("values")


@pytest.mark.parametrize(("size", "why"), [(None, "No such file or directory"), (39, "truncated")])
def test_a_file_that_is_deleted_or_cut_short_after_its_check(
    tmp_path: Path, size: int | None, why: str
) -> None:
    """Its digest has been checked, and a product reads it: one line, and the rest is kept."""
    with pytest.raises(
        drift.UserError,
        match=rf"^{tmp_path}/\.out\.unfinished/shard-00000\.bin: {why}; do not delete .*; "
        "1 shards are finished and kept there: the same command resumes from them$",
    ):
        read_after(tmp_path / "out", size)
    with shelf.open_shelf(tmp_path / "out", MARK, 0) as kept, pytest.raises(work.Gone):
        kept.read("shard-00000")


def test_errors_of_other_files_stay_theirs(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), shelf.open_shelf(tmp_path / "out", MARK, 0):
        (tmp_path / "winds.nc").open()
    with pytest.raises(OSError, match="no file at all"), shelf.open_shelf(None, MARK, 0):
        raise OSError("no file at all")


def test_a_folder_without_shards_says_so(tmp_path: Path) -> None:
    kept = work.Work(tmp_path, "")
    assert kept.kept == "no shard is finished and kept there: the same command starts again"


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), interrupt.Terminated()])
@pytest.mark.parametrize(("place", "finished"), [("out", 1), ("out", 0), (None, 1)])
def test_an_interrupt_says_what_is_kept(
    stop: BaseException,
    place: str | None,
    finished: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """And the same command finds it; a temporary folder, or one without shards, keeps nothing."""
    out = tmp_path / place if place else None

    def stopped(argv: object) -> int:
        with shelf.open_shelf(out, MARK, 0) as kept:
            if finished:
                with kept.also("shard-00000", 5) as reel:
                    reel.note("values", np.arange(5.0))
            raise type(stop)

    monkeypatch.setattr(commands, "_dispatch", stopped)
    status = commands.main([])
    kept = (
        f"; {tmp_path}/.out.unfinished: 1 shards are finished and kept there: the same command resumes from them"
        if out and finished
        else ""
    )
    words = {130: "interrupted", 143: "terminated on request"}[status]
    assert capsys.readouterr().err == f"drift: {words}; no incomplete file is left{kept}\n"
    with shelf.open_shelf(tmp_path / "out", MARK, 0) as again:
        assert again.finished("shard-00000") == bool(kept)


def test_a_run_begins_again_while_a_worker_deletes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker deletes what it could not finish: between the listing of the folder and deleting."""
    kept = work.Work(tmp_path, work.run_of(MARK))
    listed = [tmp_path / "shard-00001.bin", tmp_path / "shard-00002.bin"]
    listed[1].touch()
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: iter(listed))
    kept.begin_anew()
    assert not listed[1].exists()


@pytest.mark.thorough
def test_a_file_is_deleted_as_workers_make_the_products(
    case: drift.Case,
    made: drift.Result,
    client: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same command has a worker repeat that shard."""
    out = tmp_path / "out"
    folder = tmp_path / f".out{hidden.UNFINISHED}"

    def report(phase: str, share: float) -> None:
        if phase == "map":
            (folder / "shard-00003-000.bin").unlink(missing_ok=True)

    with pytest.raises(drift.UserError, match=r"/shard-00003-000\.bin: No such file .* 5 shards"):
        drift.run(case, out, client=client, shards=5, report=report)
    monkeypatch.setattr(unit.Unit, "_fill", lambda *given: pytest.fail("it moves"))
    runs.same(drift.run(case, out, client=client), made)


def test_particles_moved_here_can_be_read_by_a_worker() -> None:
    """Of a damaged shard, say: their layout goes there without the arrays of this device."""
    runtime.start()
    layout = Layout((0, 3, 5), (7, 9001), (4096, 4096))
    layout.batch((0, 1))
    there = pickle.loads(pickle.dumps(layout))
    assert there == layout
    assert there.blocks.places.tolist() == [7, 8, 9, 9001, 9002]


@pytest.mark.thorough
def test_a_folder_is_deleted_as_workers_move(client: Any, tmp_path: Path) -> None:
    with pytest.raises(
        drift.UserError, match=r"out\.unfinished: deleted while the run needs it; the same command"
    ):
        cluster.check(client, tmp_path / ".out.unfinished")
    (tmp_path / ".out.unfinished").mkdir()
    with pytest.raises(drift.UserError, match=r"^worker tcp\S+ does not see "):
        cluster.check(client, tmp_path / ".out.unfinished")


@pytest.mark.thorough
def test_all_workers_are_lost_as_they_answer(
    case: drift.Case, made: drift.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what each was to read, dask gives nothing to those that come in their stead."""
    monkeypatch.setattr(cluster, "LOOK", 0.2)
    result_of, lost = cluster._result_of, list[bool]()
    with cluster.connect_to_cluster(1, None) as client:

        def wait(asked: Any, task: Any, kept: Any, current: Any = None) -> Any:
            if current is not None and not lost:
                client.cluster.scale(0)
                while client.nthreads():
                    time.sleep(0.05)
                lost.append(True)
                client.cluster.scale(1)
            return result_of(asked, task, kept, current)

        monkeypatch.setattr(cluster, "_result_of", wait)
        runs.same(drift.run(case, tmp_path / "out", client=client, shards=5), made)
    assert lost


@pytest.mark.thorough
@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for one process")
def test_ctrl_c_is_left_to_the_process_that_waits() -> None:
    """A terminal sends it to all processes; a worker would print where it stood. So does one that
    comes for a killed one; and dask says nothing as the run is unwound.
    """
    with cluster.connect_to_cluster(1, None) as client:
        assert not logging.getLogger("distributed.scheduler").isEnabledFor(logging.CRITICAL)
        before: set[int] = set()
        for _ in range(2):
            while not (process := {*client.run(os.getpid, on_error="ignore").values()} - before):
                client.wait_for_workers(1, timeout=60)
            os.kill(*process, signal.SIGINT)
            assert client.submit(os.getpid, pure=False).result(timeout=30) in process
            before |= process
            os.kill(*process, signal.SIGKILL)
