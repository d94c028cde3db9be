"""A cluster that loses workers or its scheduler: what they lose is done again, and what cannot be
is one line.
"""

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import dask
import distributed
import pytest
import shards as runs

import drift
from drift.pipeline import flow
from drift.pipeline.shards import cluster, work
from drift.products.files import hidden


@pytest.fixture(autouse=True)
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


@pytest.mark.thorough
def test_a_worker_that_is_killed_costs_its_shards_only(
    case: drift.Case, made: drift.Result, client: Any, tmp_path: Path
) -> None:
    killed: list[int] = []

    def report(phase: str, share: float) -> None:
        if phase == "drift" and not killed:
            process = sorted(client.run(os.getpid).values())[0]
            os.kill(process, signal.SIGKILL)
            killed.append(process)

    runs.same(drift.run(case, tmp_path / "out", client=client, shards=9, report=report), made)
    assert killed


@pytest.mark.thorough
def test_a_run_after_one_that_was_stopped_is_its_own(
    case: drift.Case, client: Any, tmp_path: Path
) -> None:
    """On the same workers, while somebody still holds what was raised."""

    def report(phase: str, share: float) -> None:
        if phase == "drift" and share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as held:
        drift.run(case, tmp_path / "one", client=client, shards=9, report=report)
    other = drift.vary(case, {"seed": 5})
    runs.same(drift.run(other, tmp_path / "two", client=client, shards=3), drift.run(other))
    assert held.tb


@pytest.mark.thorough
@pytest.mark.parametrize("another", [True, False])
def test_a_worker_that_is_lost_before_it_hands_over_what_it_did(
    case: drift.Case,
    made: drift.Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    another: bool,
) -> None:
    """All shards are done, one is fetched, and the only worker goes: others do them again; where
    none comes, a line.
    """
    monkeypatch.setattr(cluster, "LOOK", 0.2)
    out, gone = tmp_path / "out", list[bool]()
    with cluster.connect_to_cluster(1, None) as client:

        def report(phase: str, share: float) -> None:
            if phase == "drift" and not gone:
                while (
                    len(list(out.parent.glob(f".{out.name}{hidden.UNFINISHED}/shard-*.json"))) < 9
                ):
                    time.sleep(0.05)
                time.sleep(0.5)  # all have been told of as finished
                client.cluster.scale(0)
                while client.nthreads():
                    time.sleep(0.05)
                gone.append(True)
                if another:
                    client.cluster.scale(1)
                else:
                    monkeypatch.setattr(cluster, "WAIT", 1)

        if another:
            runs.same(drift.run(case, out, client=client, shards=9, report=report), made)
        else:
            with pytest.raises(
                drift.UserError,
                match=r"lost all of its workers; .*: 9 shards .* the same command resumes from them",
            ):
                drift.run(case, out, client=client, shards=9, report=report)
    assert gone


@pytest.mark.thorough
def test_the_scheduler_is_lost_where_shards_meet(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between two stretches of a search nothing is under way."""
    searched, check = runs.searched(tmp_path), cluster.check

    def lost(client: Any, folder: Path | None = None) -> None:
        if folder and list(folder.glob("shard-*-000.json")):
            raise distributed.comm.CommClosedError("in <TCP>: Stream is closed")
        check(client, folder)

    monkeypatch.setattr(cluster, "check", lost)
    with pytest.raises(
        drift.UserError,
        match=r"the cluster is lost .* kept there: the same command resumes from them",
    ):
        drift.run(searched, tmp_path / "out", client=client, shards=3)


@pytest.mark.thorough
def test_the_schedulers_loss_is_one_line(
    case: drift.Case, made: drift.Result, tmp_path: Path
) -> None:
    """Killed in the middle: what is finished is kept, and the same run goes on from there without a
    cluster.
    """
    out, address = tmp_path / "out", tmp_path / "scheduler.json"
    module = [
        sys.executable,
        "-m",
        "distributed.cli.dask_scheduler",
        "--scheduler-file",
        str(address),
        "--port",
        "0",
    ]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with contextlib.ExitStack() as stack:
        scheduler = stack.enter_context(
            subprocess.Popen([*module, "--dashboard-address", "127.0.0.1:0"], **quiet)
        )
        stack.callback(scheduler.kill)
        asked = [
            sys.executable,
            "-m",
            "distributed.cli.dask_worker",
            "--scheduler-file",
            str(address),
            "--no-nanny",
        ]
        helper = stack.enter_context(
            subprocess.Popen([*asked, "--nthreads", "1", "--no-dashboard"], **quiet)
        )
        stack.callback(helper.kill)
        while not address.exists():
            time.sleep(0.1)
        with cluster.connect_to_cluster(None, json.loads(address.read_text())["address"]) as client:
            client.wait_for_workers(1, timeout=60)

            def report(phase: str, share: float) -> None:
                if phase == "drift" and 0 < share < 1:
                    scheduler.kill()

            with pytest.raises(
                drift.UserError,
                match=r"the cluster is lost .* shards are finished and kept there: the same command resumes from them",
            ) as error:
                drift.run(case, out, client=client, shards=9, report=report)
    assert "\n" not in str(error.value)
    # else all that xarray writes from now on would ask the dead one
    assert dask.config.get("scheduler", None) is None
    assert len(list((out.parent / f".{out.name}{hidden.UNFINISHED}").glob(work.INDICES))) >= 1
    runs.same(drift.run(case, out), made)


@pytest.mark.thorough
def test_a_worker_that_dies_while_all_are_asked_is_no_fault(client: Any) -> None:
    """Others are asked, and one that comes in its stead is asked with its first shard."""
    for _ in range(3):
        client.wait_for_workers(2, timeout=60)
        os.kill(max(client.run(os.getpid, on_error="ignore").values()), signal.SIGKILL)
        cluster.check(client)
        assert cluster.workers_of(client).count in (1, 2)


@pytest.mark.thorough
def test_a_worker_that_hangs_is_not_waited_for_for_ever(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes the question, and never answers."""
    client.wait_for_workers(2, timeout=60)
    hangs = max(client.run(os.getpid, on_error="ignore").values())
    monkeypatch.setattr(cluster, "WAIT", 1)
    os.kill(hangs, signal.SIGSTOP)
    try:
        with pytest.raises(
            drift.UserError, match=r"^the cluster is lost \(.*\); nothing is kept yet$"
        ):
            cluster.workers_of(client)
    finally:
        os.kill(hangs, signal.SIGCONT)


@pytest.mark.thorough
def test_a_local_cluster_that_does_not_end_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(distributed.LocalCluster):
        wait = 3600.0

        async def _close(self) -> None:
            await asyncio.sleep(self.wait)
            await super()._close()

    monkeypatch.setattr(distributed, "LocalCluster", Slow)
    monkeypatch.setattr(cluster, "PATIENCE", 5)
    with cluster.connect_to_cluster(1, None) as client:
        left = client.cluster
    assert left.status.name == "running"
    left.wait = 0.0
    left.close(timeout=60)
    assert left.status.name == "closed"
