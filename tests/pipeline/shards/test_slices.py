"""Winds and currents of files are read and regridded once for all shards, and no bit of a result
differs for it.
"""

import logging
from pathlib import Path

import model_writers
import pytest
import shards as runs
import trial_case
import writers

import drift
from drift.pipeline import flow
from drift.pipeline.shards import shelf, work
from drift.products.files import hidden
from geo.forcing.reading import kept, tile


def case_in(folder: Path) -> drift.Case:
    writers.projected(folder / "current.nc")
    return trial_case.load(
        folder,
        start="2024-03-05T00:10Z",
        duration="5 h",
        particles=20000,
        output={"every": "150 min", "trajectories": 20},
        clock={"step": "30 min"},
        current={"files": "current.nc"},
        wind={"constant": {"speed": "9 m/s", "from": 250}},
        scenario={
            "object": "LIFE-RAFT-DB-10",
            "position": {"at": [4.0, 59.0], "error": "4 km"},
        },
    )


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> drift.Case:
    return case_in(tmp_path_factory.mktemp("slices"))


@pytest.fixture(scope="module")
def made(case: drift.Case) -> drift.Result:
    return drift.run(case)


@pytest.fixture(autouse=True)
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the slices that are regridded, as they are."""
    numbers: list[int] = []
    carry = tile.read_tile
    monkeypatch.setattr(tile, "read_tile", lambda of, i: (numbers.append(i), carry(of, i))[1])
    return numbers


@pytest.fixture
def forgetful(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let memory hold no slice, as where they are large."""
    monkeypatch.setattr(kept, "MOST", 0)


class Stopped(Exception):
    pass


def half(phase: str, share: float) -> None:
    if phase == "drift" and share >= 0.6:
        raise Stopped


def slices_of(out: Path) -> list[Path]:
    return sorted((out.parent / f".{out.name}{hidden.UNFINISHED}" / work.FORCING).glob("*.slice"))


@pytest.mark.thorough
def test_each_slice_is_regridded_once(
    case: drift.Case, made: drift.Result, tmp_path: Path, read: list[int]
) -> None:
    runs.same(drift.run(case, tmp_path / "out", shards=4), made)
    assert sorted(read) == [0, 1, 2]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.usefixtures("forgetful")
def test_each_is_regridded_once_for_all_shards_and_products(
    case: drift.Case, made: drift.Result, tmp_path: Path, read: list[int]
) -> None:
    runs.same(drift.run(case, tmp_path / "out", shards=4), made)
    # Once before anything is stored: is there forcing, how long may steps be?
    assert sorted(read) == [0, 0, 1, 1, 2, 2]
    read.clear()
    drift.run(case, shards=4)  # in a temporary folder
    assert sorted(read) == [0, 0, 1, 1, 2, 2]


@pytest.mark.thorough
@pytest.mark.usefixtures("forgetful")
def test_a_run_that_goes_on_reads_what_was_regridded(
    case: drift.Case, made: drift.Result, tmp_path: Path, read: list[int]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(Stopped):
        drift.run(case, out, shards=4, report=half)
    kept_slices = slices_of(out)
    assert len(kept_slices) == 4  # and the wind, the same everywhere
    damaged = max(kept_slices, key=lambda path: path.stat().st_size)
    held = bytearray(damaged.read_bytes())
    held[len(held) // 2] ^= 64
    damaged.write_bytes(held)
    read.clear()
    runs.same(drift.run(case, out, shards=4), made)
    assert len(read) == 3 + 1  # as the run begins, and the one that was altered
    assert not slices_of(out)


@pytest.mark.usefixtures("forgetful")
@pytest.mark.thorough
def test_without_room_for_them_shards_read_for_themselves(
    case: drift.Case,
    made: drift.Result,
    tmp_path: Path,
    read: list[int],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    out = tmp_path / "out"
    room = shelf.bytes_of_shards(case, 20_000)
    monkeypatch.setattr(
        work.shutil, "disk_usage", lambda folder: type("Usage", (), {"free": room})()
    )
    with caplog.at_level(logging.WARNING, "drift"), pytest.raises(Stopped):
        drift.run(case, out, shards=4, report=half)
    assert "no space to cache the regridded forcing" in caplog.text
    assert not slices_of(out)
    monkeypatch.undo()
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)
    runs.same(drift.run(case, out, shards=4), made)
    assert len(read) > 6


@pytest.mark.thorough
def test_another_forcing_takes_nothing_over(case: drift.Case, tmp_path: Path) -> None:
    """The file is replaced by one of the same name: its slices go, and make room."""
    out = tmp_path / "out"
    own = case_in(tmp_path)
    with pytest.raises(Stopped):
        drift.run(own, out, shards=4, report=half)
    before = {*slices_of(out)}
    model_writers.curved_true(tmp_path / "current.nc")
    with pytest.raises(Stopped):
        drift.run(own, out, shards=4, report=half)
    assert before
    # the wind is the same
    assert not before & {path for path in slices_of(out) if path.stat().st_size > 1000}
    runs.same(drift.run(own, out, shards=4), drift.run(own))


@pytest.mark.thorough
def test_workers_share_them(case: drift.Case, made: drift.Result, tmp_path: Path) -> None:
    """What a worker reads for the first shard is there for the others: the files are those of one
    run.
    """
    from drift.pipeline.shards import cluster

    out, seen = tmp_path / "out", []
    with cluster.connect_to_cluster(2, None) as client:

        def report(phase: str, share: float) -> None:
            seen.append({path: path.stat().st_ino for path in slices_of(out)})

        runs.same(drift.run(case, out, client=client, shards=5, report=report), made)
    last = [one for one in seen if one][-1]
    assert len(last) == 4
    assert all(last[path] == inode for one in seen for path, inode in one.items())
