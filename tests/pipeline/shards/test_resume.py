"""A run in shards writes the same files as in one piece; stopped at any moment it goes on."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import same_files
import shards as runs
from stopped_runs import KILLED, Stopped, shards_of, stopping, unfinished

import drift
from drift.engine.motion import prior, spool
from drift.pipeline import flow, run_setup
from drift.pipeline.shards import divide, shelf, unit, work
from drift.products.files import hidden
from kernels.runtime import runtime
from kernels.step import coast as coasts

PAINTS = False  # pictures of shards are compared by the tests of spills


@pytest.fixture(scope="module")
def whole(case: drift.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the results in one piece."""
    out = tmp_path_factory.mktemp("whole") / "out"
    drift.run(case, out)
    return out


@pytest.fixture
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the files of results out, which take seconds; their contents are compared."""
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


@pytest.mark.thorough
@pytest.mark.parametrize("many", [pytest.param(2, marks=pytest.mark.thorough), 9])
def test_no_number_of_shards_changes_a_bit(case: drift.Case, made: drift.Result, many: int) -> None:
    runs.same(drift.run(case, shards=many), made)


@pytest.mark.parametrize("members", [False, True])
def test_where_and_when_particles_begin_is_drawn_alike_without_how_they_move(
    tmp_path: Path, members: bool
) -> None:
    case = runs.case(tmp_path, members=members)
    runtime.start()
    where = run_setup.open_for(case)
    spec, coast = run_setup.spec_of(case, where), coasts.upload(where.coast)
    own = prior.layout(spec).shards(4)[1]
    whole, still = (prior.draw_ensemble(spec, coast, own, still=still) for still in (False, True))
    assert np.array_equal(whole.tried, still.tried)
    assert {*still.ensemble.columns} < {*whole.ensemble.columns}
    for name, column in still.ensemble.columns.items():
        assert np.array_equal(column.to_numpy(), whole.ensemble.columns[name].to_numpy()), name


@pytest.mark.thorough
def test_members_are_dealt_out_alike_to_shards(tmp_path: Path) -> None:
    case = runs.case(tmp_path, members=True)
    one, many = drift.run(case), drift.run(case, shards=7)
    runs.same(one, many)
    assert one.members is not None
    assert many.members is not None
    assert np.array_equal(one.members.posterior, many.members.posterior)
    assert np.array_equal(one.members.place, many.members.place)
    assert np.ptp(one.members.place[:, 0]) > 0.01  # and they part


@pytest.mark.thorough
def test_no_file_differs(case: drift.Case, whole: Path, tmp_path: Path) -> None:
    drift.run(case, tmp_path / "out", shards=3)
    assert same_files.differences(whole, tmp_path / "out") == []
    assert not unfinished(tmp_path / "out").exists()


@pytest.mark.usefixtures("unwritten")
def test_a_run_that_was_stopped_goes_on(
    case: drift.Case,
    made: drift.Result,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "out"
    for at, kept in ((0.1, 0), (0.55, 2), (0.8, 3)):
        with pytest.raises(Stopped):
            drift.run(case, out, shards=4, report=stopping(at))
        assert not out.exists()
        assert len([name for name in shards_of(out) if name.endswith(".json")]) == kept
    moved: list[int] = []
    fill = unit.Unit._fill
    monkeypatch.setattr(
        unit.Unit, "_fill", lambda *given: (moved.append(given[0].number), fill(*given))[1]
    )
    done = drift.run(case, out, shards=4)
    assert moved == [3]
    assert "3 shards of this run were finished before: it resumes from there" in caplog.text
    runs.same(done, made)
    assert not unfinished(out).exists()


@pytest.mark.usefixtures("unwritten")
def test_the_memory_counts_where_a_run_goes_on(
    case: drift.Case, made: drift.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that was cut into fewer shards than the memory asks for now begins again."""
    out = tmp_path / "out"
    with pytest.raises(Stopped):
        drift.run(case, out, shards=2, report=stopping(0.6))
    monkeypatch.setattr(divide, "LEAST", 8192)
    monkeypatch.setattr(divide, "HELD", 2**17)
    asked, prepare = [], divide.prepare
    monkeypatch.setattr(
        divide, "prepare", lambda *given: (asked.append(given[2]), prepare(*given))[1]
    )
    runs.same(drift.run(case, out, memory=(divide.BASE + 8192 * 2**17) / 2**30), made)
    assert asked == [4]


@pytest.mark.usefixtures("unwritten")
def test_results_in_the_folder_itself(
    case: drift.Case, made: drift.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is finished lies beside it, by whatever name it is given."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(Stopped):
        drift.run(case, ".", shards=4, report=stopping(0.6))
    assert len(shards_of(tmp_path / "here")) == 4
    assert list((tmp_path / "here").iterdir()) == []
    (tmp_path / "link").symlink_to(tmp_path / "here")
    runs.same(drift.run(case, tmp_path / "link", shards=4), made)
    assert not unfinished(tmp_path / "here").exists()


@pytest.mark.usefixtures("unwritten")
def test_two_runs_on_one_folder(
    case: drift.Case, made: drift.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second is refused, until the first has written its results, and does it no harm."""
    out = tmp_path / "out"
    refused: list[str] = []

    def report(phase: str, share: float) -> None:
        if (phase == "drift" and share >= 0.5 and not refused) or (
            phase == "map" and len(refused) == 1
        ):
            with pytest.raises(drift.UserError) as error:
                drift.run(case, out, shards=4)
            refused.append(str(error.value))

    monkeypatch.setattr(flow, "write_results", lambda result, job: report("map", 1.0))
    runs.same(drift.run(case, out, shards=4, report=report), made)
    assert len(refused) == 2
    assert all("another run is at work on it" in words for words in refused)


@pytest.mark.usefixtures("unwritten")
def test_a_full_disk_keeps_what_is_finished(
    case: drift.Case, made: drift.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    usage = work.shutil.disk_usage
    monkeypatch.setattr(
        work.shutil, "disk_usage", lambda folder: type("Usage", (), {"free": 999})()
    )
    with pytest.raises(drift.UserError, match=r"need 1\.8 MiB, and 0\.0 MiB"):
        drift.run(case, out, shards=4)
    monkeypatch.setattr(work.shutil, "disk_usage", usage)
    keep = work.ShardFile._keep

    def full(self: work.ShardFile, name: str, values: np.ndarray) -> int:
        if "00002" in self.file.name and len(self.taken) == 2:
            raise spool.NoRoom("No space left on device")
        return keep(self, name, values)

    monkeypatch.setattr(work.ShardFile, "_keep", full)
    with pytest.raises(
        drift.UserError, match=r"No space left on device; 2 shards are finished and kept there"
    ):
        drift.run(case, out, shards=4)
    assert shards_of(out) == [
        f"shard-0000{k}-000.{kind}" for k in (0, 1) for kind in ("bin", "json")
    ]
    monkeypatch.setattr(work.ShardFile, "_keep", keep)
    runs.same(drift.run(case, out, shards=4), made)


@pytest.mark.usefixtures("unwritten")
def test_a_folder_beside_which_nothing_can_be_made(
    case: drift.Case, made: drift.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mount, or one in a folder of others: what is finished lies in it, and does not count as
    results.
    """
    out = tmp_path / "mount"
    out.mkdir()
    monkeypatch.setattr(shelf.os.path, "ismount", lambda path: Path(path) == out)
    with pytest.raises(Stopped):
        drift.run(case, out, shards=4, report=stopping(0.6))
    assert [path.name for path in tmp_path.iterdir()] == ["mount"]
    assert len(list((out / hidden.UNFINISHED).glob("shard-*"))) == 4
    runs.same(drift.run(case, out, shards=4), made)
    assert list(out.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.usefixtures("unwritten")
def test_a_link_to_a_disk_with_more_room(
    case: drift.Case, made: drift.Result, tmp_path: Path
) -> None:
    """Many results may share it, and its owner's files stay, whatever they are called."""
    roomy = tmp_path / "roomy"
    for path in ("forcing/norkyst.nc", "state-of-play.txt", "shard-00000-000.bin"):
        (roomy / path).parent.mkdir(parents=True, exist_ok=True)
        (roomy / path).write_text("mine")
    for name in ("one", "other"):
        unfinished(tmp_path / name).symlink_to(roomy)
    with pytest.raises(Stopped):
        drift.run(case, tmp_path / "one", shards=4, report=stopping(0.6))
    kept = sorted(path.name for path in roomy.glob("one-*/shard-*"))
    assert len(kept) == 4
    runs.same(drift.run(case, tmp_path / "other", shards=4), made)
    assert sorted(path.name for path in roomy.glob("one-*/shard-*")) == kept
    runs.same(drift.run(case, tmp_path / "one", shards=4), made)
    assert sorted(path.name for path in roomy.iterdir()) == [
        "forcing",
        "shard-00000-000.bin",
        "state-of-play.txt",
    ]
    assert [path.read_text() for path in roomy.rglob("*") if path.is_file()] == ["mine"] * 3
    unfinished(tmp_path / "third").symlink_to(tmp_path / "no disk")
    with pytest.raises(
        drift.UserError,
        match=r"\.third\.unfinished: this link points to a folder that does not exist",
    ):
        drift.run(case, tmp_path / "third", shards=4)


@pytest.mark.thorough
@pytest.mark.usefixtures("unwritten")
@pytest.mark.parametrize("where", ["data", "index"])
def test_killed_while_a_file_is_written(
    case: drift.Case, made: drift.Result, tmp_path: Path, where: str
) -> None:
    """Nothing that Python could clean up after: the process is gone in the middle of the third
    shard's files.
    """
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, str(case.path), str(tmp_path / "out"), where]
    )
    assert killed.returncode == -signal.SIGKILL
    left = {path.name for path in unfinished(tmp_path / "out").glob("shard-*")}
    assert {"shard-00001-000.json", "shard-00002-000.bin"} <= left
    assert "shard-00002-000.json" not in left
    runs.same(drift.run(case, tmp_path / "out", shards=4), made)
    assert list(tmp_path.iterdir()) == []
