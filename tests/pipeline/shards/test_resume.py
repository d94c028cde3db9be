"""A run in shards writes the same files as in one piece; stopped at any moment it goes on; what is
altered is done again.
"""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import same_files
import shards as runs

import drift
from drift.apps.cli import commands
from drift.engine.motion import prior, spool
from drift.pipeline import flow, run_setup
from drift.pipeline.shards import divide, machine, shelf, unit, work
from drift.products.files import hidden
from kernels.runtime import memory, runtime
from kernels.step import coast as coasts

PAINTS = False  # pictures of shards are compared by the tests of spills


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> drift.Case:
    return runs.case(tmp_path_factory.mktemp("shards"))


@pytest.fixture(scope="module")
def whole(case: drift.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the results in one piece."""
    out = tmp_path_factory.mktemp("whole") / "out"
    drift.run(case, out)
    return out


@pytest.fixture(scope="module")
def made(case: drift.Case) -> drift.Result:
    return drift.run(case)


@pytest.fixture
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the files of results out, which take seconds; their contents are compared."""
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


def unfinished(out: Path) -> Path:
    return out.parent / f".{out.name}{hidden.UNFINISHED}"


def shards_of(out: Path) -> list[str]:
    return sorted(path.name for path in unfinished(out).glob("shard-*"))


class Stopped(Exception):
    pass


KILLED = """
import os, signal, sys
import drift
from drift.engine.motion import spool
from drift.pipeline.shards import work
case, out, where = sys.argv[1:]
def die():
    os.kill(os.getpid(), signal.SIGKILL)
keep, replace = spool.ShardFile._keep, work.replace
def kept(self, name, values):
    at = keep(self, name, values)
    if where == "data" and "00002" in str(self.file.name) and len(self.taken) == 1:
        self.file.flush()
        die()
    return at
def replaced(path, text):
    if "00002" in path.name:
        path.with_suffix(".new").write_text(text[: len(text) // 2])
        die()
    replace(path, text)
spool.ShardFile._keep, work.replace = kept, replaced
drift.run(drift.load(case), out, shards=4)
"""


def stopping(at: float) -> Callable[[str, float], None]:
    """Return what stops a run once so much of its drift is done."""

    def report(phase: str, share: float) -> None:
        if phase == "drift" and share >= at:
            raise Stopped

    return report


@pytest.fixture(scope="module")
def half(case: drift.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return what a run in four shards leaves that was stopped in the third."""
    out = tmp_path_factory.mktemp("half") / "out"
    with pytest.raises(Stopped):
        drift.run(case, out, shards=4, report=stopping(0.6))
    return unfinished(out)


def put(half: Path, out: Path) -> None:
    """Have a stopped run lie beside a folder, as if it had been asked for with that folder."""
    shutil.copytree(half, unfinished(out))


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
@pytest.mark.parametrize(
    "fault",
    [
        "cut",
        "altered",
        "index",
        "place",
        "foreign",
        *(pytest.param(fault, marks=pytest.mark.thorough) for fault in ("renamed", "gone")),
    ],
)
def test_a_file_that_was_cut_short_or_altered_is_made_again(
    case: drift.Case,
    half: Path,
    made: drift.Result,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    fault: str,
) -> None:
    out = tmp_path / "out"
    put(half, out)
    data, index = unfinished(out) / "shard-00001-000.bin", unfinished(out) / "shard-00001-000.json"
    if fault == "cut":
        os.truncate(data, data.stat().st_size - 1)
    elif fault == "altered":
        with data.open("r+b") as stream:
            stream.seek(4321)
            byte = stream.read(1)
            stream.seek(4321)
            stream.write(bytes([byte[0] ^ 4]))
    elif fault == "index":
        index.write_text(index.read_text()[:-9])
    elif fault == "place":  # longitudes are said to lie where latitudes do
        told = json.loads(index.read_text())
        told["where"][1]["lon"] = told["where"][1]["lat"]
        index.write_text(json.dumps(told))
    elif fault == "foreign":  # of a run with another seed
        with pytest.raises(Stopped):
            drift.run(
                drift.vary(case, {"seed": 78}), tmp_path / "other", shards=4, report=stopping(0.6)
            )
        for path in (data, index):
            shutil.copy(unfinished(tmp_path / "other") / path.name, path)
    elif fault == "renamed":  # another shard's
        for path in (data, index):
            shutil.copy(path.with_name(path.name.replace("00001", "00000")), path)
    else:
        data.unlink()
    done = drift.run(case, out, shards=4)
    assert ("shard-00001-000 of the previous run" in caplog.text) is (fault != "gone")
    runs.same(done, made)


@pytest.mark.usefixtures("unwritten")
@pytest.mark.thorough
def test_a_search_over_an_unfinished_forecast_is_another_run(
    case: drift.Case, half: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not cut into as many shards as that was."""
    out = tmp_path / "out"
    put(half, out)
    sortie = """
[[sortie]]
name = "s"
start = "+2 h"
end = "+4 h"
law = "random"
pod = 0.7
area = { polygon = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]] }
"""
    (tmp_path / "searched.toml").write_text(case.text + sortie)
    (tmp_path / "land.geojson").write_text(runs.SHORE)
    searched = drift.load(tmp_path / "searched.toml")
    asked: list[int] = []
    monkeypatch.setattr(divide, "prepare", lambda *given: asked.append(given[2]))
    done = drift.run(searched, out)
    assert not asked
    monkeypatch.undo()
    assert done.summary["search"]["sorties"]
    runs.same(done, drift.run(searched))


@pytest.mark.usefixtures("unwritten")
def test_what_is_made_afterwards_may_change(
    case: drift.Case, half: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A remark, a title and other areas leave what has been moved as it is."""
    out = tmp_path / "out"
    put(half, out)
    (tmp_path / "land.geojson").write_text(runs.SHORE)
    (tmp_path / "case.toml").write_text(
        'title = "As told at noon" # a remark\n'
        + case.text.replace("output = {", "output = { areas = [40, 80],")
    )
    other, moved = drift.load(tmp_path / "case.toml"), []
    fill = unit.Unit._fill
    monkeypatch.setattr(
        unit.Unit, "_fill", lambda *given: (moved.append(given[0].number), fill(*given))[1]
    )
    done = drift.run(other, out)
    assert moved == [2, 3]
    runs.same(done, drift.run(other))


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
def test_a_refused_run_leaves_nothing(
    case: drift.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*given: object) -> None:
        raise drift.UserError("too much was lost by the end")

    monkeypatch.setattr(run_setup, "check_end", refuse)
    with pytest.raises(drift.UserError, match="was lost by the end"):
        drift.run(case, tmp_path / "out", shards=4)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("unwritten")
def test_another_case_begins_anew_and_says_what_changed(
    case: drift.Case, half: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    out = tmp_path / "out"
    put(half, out)
    other = drift.vary(case, {"seed": 78})
    done = drift.run(other, out, shards=4)
    assert (
        "an unfinished run is there, but the case and the seed changed since: it starts again"
        in caplog.text
    )
    runs.same(done, drift.run(other))


def test_another_processor_is_noticed(
    case: drift.Case,
    half: Path,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "out"
    put(half, out)
    exact = np.exp
    monkeypatch.setattr(
        machine, "FUNCTIONS", (lambda x: np.nextafter(exact(x), 9.0), *machine.FUNCTIONS[1:])
    )
    with pytest.raises(Stopped):
        drift.run(case, out, shards=4, report=stopping(0.1))
    assert "the processor's arithmetic changed since" in caplog.text
    assert not [name for name in shards_of(out) if name.endswith(".json")]


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


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--shards", "0"], "give 1 to 9"),
        (["--shards", "10"], "give 1 to 9"),
        (["--memory", "0.2 GB"], "a run takes 0.7 GiB at least"),
        (["--memory", "plenty"], "--memory"),
        (["--memory", "1e400 GB"], "--memory"),
    ],
)
def test_bad_input_is_one_line(
    case: drift.Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], said: str
) -> None:
    assert commands.main(["run", str(case.path), "--out", str(tmp_path / "out"), *more]) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert said in told[-1]
    assert list(tmp_path.iterdir()) == []


def test_memory_and_the_loss_at_a_stop_choose_the_shards(case: drift.Case) -> None:
    many = drift.vary(case, {"particles": 100_000_000})
    room = 0.8 * 2**30 - divide.BASE
    assert divide.number_of_shards(many, 0.8, None) == -(-100_000_000 // int(room / divide.HELD))
    assert divide.number_of_shards(many, 1e6, None) == 96  # of 2^20
    assert divide.number_of_shards(case, None, None) == 1


def test_the_memory_of_workers_chooses_the_shards(case: drift.Case) -> None:
    """Each has its own: a thousand of them on other machines do not share that of one."""
    many, gib = drift.vary(case, {"particles": 100_000_000}), 2**30
    two = divide.Workers(2, 3, 8 * gib)
    assert divide.number_of_shards(case, None, None, two) == 8
    assert (
        divide.number_of_shards(case, None, None, divide.Workers(64, 1, 8 * gib)) == 9
    )  # its blocks
    assert divide.number_of_shards(many, None, None, divide.Workers(8, 1, 8 * gib)) == 96  # of 2^20
    assert (
        divide.number_of_shards(many, None, None, divide.Workers(64, 1, 8 * gib)) == 256
    )  # 4 each
    tight = 1.6 * gib
    assert divide.number_of_shards(many, None, None, divide.Workers(8, 1, tight)) == -(
        -100_000_000 // int((tight / 2 - divide.BASE) / divide.HELD)
    )
    room = 2.4 * gib / 3 - divide.BASE  # they share with the process that was started
    assert divide.number_of_shards(many, 2.4, None, two) == -(
        -100_000_000 // int(room / divide.HELD)
    )
    with pytest.raises(
        drift.UserError,
        match=r"memory = 2 \(GiB\): 3 processes on one machine take 2\.1 GiB at least; .* fewer workers",
    ):
        divide.number_of_shards(many, 2.0, None, two)
    limited = divide.Workers(2, 3, 8 * gib, 0.8 * gib)  # dask lets each take no more
    room = 0.8 * gib - divide.BASE
    assert divide.number_of_shards(many, 1e6, None, limited) == -(
        -100_000_000 // int(room / divide.HELD)
    )
    with pytest.raises(
        drift.UserError,
        match=r"shards = 4: shards of this size take 5\.4 GiB, and memory is 1 \(GiB\)",
    ):
        divide.number_of_shards(many, 1, 4)
    assert divide.number_of_shards(many, 1, 400) == 400
    with pytest.raises(drift.UserError, match=r"memory = '4 GB': give a number of GiB"):
        divide.number_of_shards(many, "4 GB", None)  # type: ignore[arg-type]


def test_one_piece_that_does_not_fit_is_one_line(
    case: drift.Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "free", lambda: 30_000 * 250 - 1)
    with pytest.raises(
        drift.UserError,
        match=r"30,000 particles in one piece .* of memory are free; .* in shards that fit",
    ):
        drift.run(case, shards=1)
    monkeypatch.setattr(memory, "free", lambda: 30_000 * 250)
    drift.run(case, shards=1)


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


def test_what_is_kept_names_no_machine(case: drift.Case, half: Path, tmp_path: Path) -> None:
    put(half, tmp_path / "out")
    about = json.loads((unfinished(tmp_path / "out") / work.ABOUT).read_text())
    assert set(about) >= {
        "the case",
        "the seed",
        "the versions",
        "the forcing",
        "the processor's arithmetic",
    }
    told = "".join(path.read_text() for path in unfinished(tmp_path / "out").glob("*.json"))
    assert socket.gethostname() not in told
    assert str(case.path.parent) not in told
    assert str(half.parent) not in told
