"""Workers of a dask cluster write the same as one process; clusters that cannot serve are rejected
in one line.
"""

import importlib
import os
import time
from pathlib import Path
from typing import Any

import distributed
import pytest
import shards as runs
import writers
import xarray as xr

import drift
from drift import version
from drift.engine.motion import spool
from drift.forecast import cloud
from drift.pipeline import flow, run_setup
from drift.pipeline.shards import cluster, divide, fingerprint, machine, unit, worker
from kernels.runtime import memory

FEW_WATERS = """
start = "2024-03-05T00:10Z"
duration = "5 h"
particles = 30000
coast.source = "none"
[[current]]
files = "current.nc"
[[wind]]
constant = { speed = "9 m/s", from = 250 }
[[scenario]]
name = "in it"
weight = 0.2
object = "LIFE-RAFT-DB-10"
position = { at = [4.0, 59.0], error = "20 km", time = "+0 h" }
[[scenario]]
name = "north of it"
weight = 0.8
object = "LIFE-RAFT-DB-10"
position = { at = [4.0, 61.5], error = "20 km", time = "+0 h" }
"""


@pytest.fixture(autouse=True)
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


@pytest.mark.thorough
def test_two_workers_make_the_same(
    case: drift.Case, made: drift.Result, client: Any, tmp_path: Path
) -> None:
    shares: list[float] = []
    done = drift.run(
        case,
        tmp_path / "out",
        client=client,
        shards=5,
        report=lambda phase, share: shares.append(share) if phase == "drift" else None,
    )
    runs.same(done, made)
    assert shares == sorted(shares)
    assert shares[0] < 0.5
    assert shares[-1] == 1.0


@pytest.mark.thorough
def test_workers_read_the_particles_for_the_products(
    case: drift.Case,
    made: drift.Result,
    client: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The process that waits for them reads the tracks alone; killed at the maps, it resumes."""

    def stop(*given: object) -> None:
        raise InterruptedError

    monkeypatch.setattr(spool.SnapshotStore, "parts", lambda *given: pytest.fail("it reads"))
    with monkeypatch.context() as stopped:
        stopped.setattr(cloud, "merge_deposits", stop)
        with pytest.raises(InterruptedError):
            drift.run(case, tmp_path / "out", client=client, shards=5)
    monkeypatch.setattr(cluster, "move_shards_on_cluster", _none_is_missing)
    runs.same(drift.run(case, tmp_path / "out", client=client, shards=5), made)


def _none_is_missing(client: object, kept: object, mark: object, units: list[object], *_: object):
    assert not units


@pytest.mark.thorough
def test_workers_see_whether_there_is_forcing_as_the_run_begins(
    case: drift.Case,
    made: drift.Result,
    client: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not the process that waits for them; what they refuse is refused in the same words, before
    anything is moved.
    """
    monkeypatch.setattr(
        divide, "check_shard_start", lambda *given: pytest.fail("the one process draws")
    )
    runs.same(drift.run(case, tmp_path / "out", client=client, shards=5), made)
    monkeypatch.undo()
    monkeypatch.setattr(cluster, "move_shards_on_cluster", lambda *given: pytest.fail("it moves"))
    monkeypatch.setattr(unit.Unit, "move", lambda *given: pytest.fail("it moves"))
    writers.regular(tmp_path / "current.nc")
    for text in (  # all on land, and more than half where there is no current
        runs.CASE.replace("at = [-0.02, 0.05]", "at = [0.3, 0.05]"),
        FEW_WATERS,
    ):
        (tmp_path / "land.geojson").write_text(runs.SHORE)
        (tmp_path / "case.toml").write_text(text)
        own = drift.load(tmp_path / "case.toml")
        with pytest.raises(drift.UserError) as alone:
            drift.run(own, tmp_path / "refused", shards=5)
        with pytest.raises(drift.UserError) as dealt:
            drift.run(own, tmp_path / "refused", client=client, shards=5)
        assert str(dealt.value) == str(alone.value)
        assert not list(tmp_path.glob(".refused*"))


def test_workers_of_another_kind_are_refused(
    case: drift.Case, client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = version.versions()
    monkeypatch.setattr(version, "versions", lambda: {**mine, "numpy": "1.0"})
    with pytest.raises(
        drift.UserError, match=r"worker tcp.*: the versions: .*; here: .*numpy 1\.0"
    ):
        drift.run(case, tmp_path / "out", client=client, shards=3)
    monkeypatch.undo()
    monkeypatch.setattr(machine, "arithmetic", lambda: "vax 0")
    with pytest.raises(drift.UserError, match=r"the processor's arithmetic: .*; here: vax 0"):
        drift.run(case, tmp_path / "out", client=client, shards=3)


def test_a_worker_that_comes_late_is_asked_too(client: Any, case: drift.Case) -> None:
    """What does not see the same is refused with the shard that it was given, whenever it came."""
    where = run_setup.open_for(case)
    mark = fingerprint.fingerprint_of(case, where, 3)
    for name, other in (
        ("the processor's arithmetic", "vax 0"),
        ("the forcing", "another"),
        ("the coast", "none"),
    ):
        told = client.submit(
            worker.begun, case, case, {**mark, name: other}, None, None, pure=False
        )
        with pytest.raises(
            drift.UserError, match=f"{name} differs from the machine where the run was started"
        ):
            told.result()


@pytest.mark.thorough
def test_a_worker_opens_a_file_that_has_changed_again(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is the same case to the letter, and the worker has it open, as after a run that was
    killed.
    """
    monkeypatch.setattr(cluster, "release", lambda client: None)
    (tmp_path / "case.toml").write_text(FEW_WATERS.replace("61.5", "59.2"))
    current = xr.load_dataset(writers.regular(tmp_path / "current.nc"))
    case = drift.load(tmp_path / "case.toml")
    for factor in (1.0, -0.6):
        current["uo"].values = factor * current["uo"].values
        current.to_netcdf(tmp_path / "new.nc")
        os.replace(tmp_path / "new.nc", tmp_path / "current.nc")
        runs.same(drift.run(case, tmp_path / "out", client=client, shards=3), drift.run(case))


@pytest.mark.thorough
def test_the_folder_may_be_named_from_here(
    case: drift.Case,
    made: drift.Result,
    client: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Workers may have begun elsewhere."""
    monkeypatch.chdir(tmp_path)
    runs.same(drift.run(case, "out", client=client, shards=5), made)


@pytest.mark.thorough
def test_workers_let_go_of_a_run_that_is_over(
    case: drift.Case, client: Any, tmp_path: Path
) -> None:
    drift.run(case, tmp_path / "out", client=client, shards=3)
    until = time.monotonic() + 30
    while any(
        client.run(
            lambda: len(importlib.import_module("drift.pipeline.shards.worker")._open)
        ).values()
    ):
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.thorough
def test_a_client_that_is_closed_is_one_line(case: drift.Case, tmp_path: Path) -> None:
    with cluster.connect_to_cluster(1, None) as client:
        pass
    with pytest.raises(drift.UserError, match="the client is closed"):
        drift.run(case, tmp_path / "out", client=client)


@pytest.mark.thorough
def test_a_cluster_without_workers(
    case: drift.Case,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The first is waited for; where none comes, or all go for good, that is one line."""
    monkeypatch.setattr(cluster, "WAIT", 2)
    monkeypatch.setattr(cluster, "LOOK", 0.2)
    with cluster.connect_to_cluster(1, None) as client:
        client.cluster.scale(0)
        while client.nthreads():
            time.sleep(0.05)
        with pytest.raises(drift.UserError, match="the cluster has no workers; start some"):
            drift.run(case, tmp_path / "out", client=client)
        assert "drift waits for the first" in caplog.text
        client.cluster.scale(1)  # comes while it waits, and goes in the middle
        monkeypatch.setattr(cluster, "WAIT", 30)

        def report(phase: str, share: float) -> None:
            if phase == "drift" and 0 < share < 1:
                monkeypatch.setattr(cluster, "WAIT", 1)
                client.cluster.scale(0)

        with pytest.raises(
            drift.UserError,
            match=r"(lost all of its workers|is lost).*kept there: the same command resumes from them",
        ):
            drift.run(case, tmp_path / "out", client=client, shards=9, report=report)


@pytest.mark.parametrize(
    ("workers", "address", "said"),
    [
        (0, None, "--workers 0 must be at least 1"),
        (2, "tcp://127.0.0.1:1", "give one of them"),
        (None, "tcp://127.0.0.1:1", "no cluster answers there"),
        (None, "nowhere://", "no cluster answers there"),
        (None, "nonsense", r"nonsense: no cluster answers there \(missing port"),
    ],
)
def test_no_such_cluster(
    workers: int | None, address: str | None, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 1)
    with pytest.raises(drift.UserError, match=said), cluster.connect_to_cluster(workers, address):
        pass


def test_a_worker_that_cannot_answer_is_refused(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That is another matter than one that is gone: it would be given shards."""

    def refuses(*given: object) -> None:
        raise PermissionError(13, "Permission denied")

    client.wait_for_workers(1, timeout=60)
    monkeypatch.setattr(worker, "about", refuses)
    with pytest.raises(
        drift.UserError, match=r"worker tcp.*: .*Permission denied.*; install the same versions"
    ):
        cluster.check(client)
    monkeypatch.setattr(worker, "room", refuses)
    with pytest.raises(drift.UserError, match=r"worker tcp.*: .*Permission denied"):
        cluster.workers_of(client)


@pytest.mark.thorough
def test_workers_say_how_much_memory_they_have(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two on this machine, and the process that was started."""
    client.wait_for_workers(2, timeout=60)
    found = cluster.workers_of(client)
    assert (found.count, found.together) == (2, 3)
    assert found.free == pytest.approx(memory.free() / 3, rel=0.3)
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, memory_limit="1 GB", dashboard_address="127.0.0.1:0"
        ) as local,
        distributed.Client(local, set_as_default=False) as other,
    ):
        assert cluster.workers_of(other).limit == 1e9  # what dask lets it take
        monkeypatch.setattr(worker, "host", lambda: "elsewhere")
        assert cluster.workers_of(other).together == 1


def test_datasets_in_memory_stay_here(case: drift.Case, client: Any) -> None:
    with pytest.raises(drift.UserError, match="workers read files"):
        drift.run(case, datasets={"x": object()}, client=client)


@pytest.mark.thorough
def test_workers_search(client: Any, tmp_path: Path) -> None:
    """They stop to ask how likely a doubtful contact was, and go on."""
    searched = runs.searched(tmp_path)
    runs.same(drift.run(searched, client=client, shards=3), drift.run(searched))


@pytest.mark.thorough
def test_workers_have_no_gpu(case: drift.Case, client: Any) -> None:
    with pytest.raises(
        drift.UserError, match='backend = "cuda": workers move particles on processors'
    ):
        drift.run(case, client=client, backend="cuda")


@pytest.mark.thorough
def test_threads_of_this_process_are_no_workers(case: drift.Case, tmp_path: Path) -> None:
    with (
        distributed.Client(
            processes=False, n_workers=1, set_as_default=False, dashboard_address=None
        ) as threads,
        pytest.raises(
            drift.UserError, match="threads of this process; begin it with processes=True"
        ),
    ):
        drift.run(case, tmp_path / "out", client=threads, shards=3)
