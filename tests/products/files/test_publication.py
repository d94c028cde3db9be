"""A folder of results is the whole old run's or the whole new one's: stopped at every step, twice
over, and side by side.
"""

import importlib.util
import json
import os
import random
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from places import ROOT
from publishing import (
    NEW,
    OLD,
    SCENES,
    THIRD,
    held,
    hiding,
    posix,
    publish,
    read,
    scene,
    stopped,
    untouched,
)

import drift
from drift.products.files import hidden, manifest, publication
from geo.errors import UserError


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the disk be as slow as it is: nothing here cuts the power."""
    monkeypatch.setattr(os, "fsync", lambda handle: None)


@pytest.mark.parametrize("kind", SCENES)
def test_stopped_at_every_step(kind: str, tmp_path: Path) -> None:
    """Old or new, never else; the user's things stay; the next run leaves no hidden folder."""
    before, seen = SCENES[kind], set()
    for step in range(500):
        folder = tmp_path / str(step) / "out"
        scene(folder, before)
        done = stopped(step, lambda folder=folder: publish(folder, NEW))  # type: ignore[misc]
        told = read(folder)
        assert told in ((before or None), NEW), (step, done)
        assert held(folder) == (told or {})
        seen.add(json.dumps(told, sort_keys=True))
        publish(folder, THIRD)
        assert held(folder) == THIRD
        assert before is None or untouched(folder)
        assert hiding(folder, folder.parent) == []
        if done is None:
            break
    assert done is None
    assert step > (15 if kind == "nothing" else 25)  # as many places at which it was stopped
    assert seen == {json.dumps(one, sort_keys=True) for one in (before or None, NEW)}


def test_stopped_again_while_the_old_result_is_put_back(tmp_path: Path) -> None:
    """At every step of putting back, for every step at which the run was stopped; then once more,
    undisturbed.
    """
    number, old, new = (
        0,
        {"map.png": "old", "only_old.csv": "old"},
        {"map.png": "new", "only_new.csv": "new"},
    )
    for first in range(500):
        for second in range(500):
            folder = tmp_path / str(number := number + 1) / "out"
            scene(folder, old)
            died = stopped(first, lambda folder=folder: publish(folder, new))  # type: ignore[misc]
            again = stopped(second, lambda folder=folder: drift.results(folder))  # type: ignore[misc]
            assert read(folder) in (old, new), (first, second)
            assert untouched(folder)
            if again is None:
                break
        if died is None:
            break
    assert number > 100


@pytest.mark.skipif(
    not Path("/proc/self/fd").exists(), reason="no /proc to ask which file is synced"
)
def test_what_a_power_cut_needs_is_on_the_disk_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The journal before anything moves; all moves before the manifest; the manifest before the old
    files are dropped.
    """
    scene(tmp_path / "out", OLD)
    steps: list[str] = []
    rename, unlink = os.rename, os.unlink

    def renamed(source: Path, goal: Path) -> None:
        steps.append(f"{source.parent.name}->{goal.parent.name}/{goal.name}")
        rename(source, goal)

    def unlinked(path: Any, **more: Any) -> None:
        steps.append(f"drop {Path(path).name}")
        unlink(path, **more)

    monkeypatch.setattr(os, "rename", renamed)
    monkeypatch.setattr(os, "unlink", unlinked)
    monkeypatch.setattr(
        os,
        "fsync",
        lambda handle: steps.append(f"sync {Path(os.readlink(f'/proc/self/fd/{handle}')).name}"),
    )
    publish(tmp_path / "out", NEW)
    staged = {f"sync {name}" for name in (*NEW, "manifest.json", "new")}
    journal = next(i for i, step in enumerate(steps) if step.endswith("/journal.json"))
    first = next(i for i, step in enumerate(steps) if step.endswith("->old/manifest.json"))
    last = steps.index("new->out/manifest.json")
    dropped = steps.index("drop journal.json")
    assert staged <= set(steps[:journal])
    assert any(step.startswith("sync .drift-partial-") for step in steps[journal:first])
    assert not any("->out/" in step for step in steps[:first])
    assert steps[last - 1] == "sync out"
    assert steps[last + 1] == "sync out"
    assert not any("->" in step for step in steps[last + 1 :])
    assert min(i for i, step in enumerate(steps) if step.startswith("drop ")) == dropped > last


@posix
@pytest.mark.parametrize("number", range(12))
def test_a_rename_that_fails_leaves_all_as_it_was(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is a mount of its own, or a disk without room for a name:

    EBUSY or ENOSPC from one rename of many.
    """
    folder = tmp_path / "out"
    scene(folder, OLD)
    before, rename, count = held(folder), os.rename, iter(range(100))

    def failing(source: Path, goal: Path) -> None:
        if next(count) == number:
            raise OSError(16, "Device or resource busy", str(goal))
        rename(source, goal)

    monkeypatch.setattr(os, "rename", failing)
    try:
        publish(folder, NEW)
    except OSError:
        assert drift.results(folder)
        assert held(folder) == before
    else:
        assert number >= 1 + 5 + 5  # the journal, the old run's five files, the new one's five
    assert untouched(folder)
    assert hiding(folder, tmp_path) == []


OBSTACLES: dict[str, tuple[Callable[[Path], object], str]] = {
    "a folder": (lambda path: path.mkdir(), "a folder"),
    "a link": (lambda path: path.symlink_to("notes.txt"), "a link"),
    "a link to nothing": (lambda path: path.symlink_to("nothing"), "a link"),
    "a file of somebody": (lambda path: path.write_text("mine"), "no run of drift lists"),
    "a pipe": (lambda path: os.mkfifo(path), "no run of drift lists"),
}


@posix
@pytest.mark.parametrize("meanwhile", [False, True])
@pytest.mark.parametrize("name", ["map.png", "only_new.csv", "manifest.json"])
@pytest.mark.parametrize("kind", OBSTACLES)
def test_what_is_in_the_way_is_refused_and_stays(
    kind: str, name: str, meanwhile: bool, tmp_path: Path
) -> None:
    """Before the work starts, and where it comes while the run works; the old result is whole
    afterwards.
    """
    make, words = OBSTACLES[kind]
    folder = tmp_path / "out"
    scene(folder, OLD)
    if kind == "a file of somebody" and name != "only_new.csv":
        pytest.skip("a file of a run that was changed by hand is replaced")

    def put() -> None:
        (folder / name).unlink(missing_ok=True)
        make(folder / name)

    if not meanwhile:
        put()
    kinds = {path.name: path.lstat().st_mode for path in folder.iterdir()}

    def attempt() -> None:
        publication.check(folder, True, [*NEW, manifest.NAME])
        with publication.staged(folder) as stage:
            for file, text in NEW.items():
                (stage.new / file).write_text(text)
            put()
            kinds.update(
                {
                    path.name: path.lstat().st_mode
                    for path in folder.iterdir()
                    if path != stage.folder
                }
            )
            publication.publish(stage, "new", True)

    with pytest.raises(UserError) as refusal:
        attempt()
    assert name in str(refusal.value) or (
        meanwhile and name == "manifest.json" and "in the meantime" in str(refusal.value)
    )
    assert words in str(refusal.value) or "in the meantime" in str(refusal.value)
    assert {path.name: path.lstat().st_mode for path in folder.iterdir()} == kinds
    assert untouched(folder)
    rest = {key: text for key, text in OLD.items() if key != name}
    assert {key: (folder / key).read_text() for key in rest} == rest


@posix
def test_a_target_that_is_a_link_or_lies_beside_what_cannot_be_written(tmp_path: Path) -> None:
    """The hidden folder lies in the target: beside the link it would be on another file system, or
    refused.
    """
    (tmp_path / "real").mkdir()
    (tmp_path / "above").mkdir()
    (tmp_path / "above" / "out").symlink_to(tmp_path / "real")
    (tmp_path / "above").chmod(0o555)
    try:
        for files in (OLD, NEW):
            publish(tmp_path / "above" / "out", files)
            assert held(tmp_path / "real") == files
        stopped(25, lambda: publish(tmp_path / "above" / "out", OLD))
        assert read(tmp_path / "real") == NEW  # by its other name
        publish(tmp_path / "real", THIRD)
        assert hiding(tmp_path / "real", tmp_path / "above") == []
    finally:
        (tmp_path / "above").chmod(0o755)
    assert (tmp_path / "above" / "out").is_symlink()


@posix
@pytest.mark.skipif(
    not Path("/dev/shm").is_dir() or os.stat("/dev/shm").st_dev == os.stat("/tmp").st_dev,
    reason="one file system",
)
def test_a_target_on_another_file_system_than_its_link(tmp_path: Path) -> None:
    import tempfile

    with tempfile.TemporaryDirectory(dir="/dev/shm") as elsewhere:
        (tmp_path / "out").symlink_to(elsewhere)
        for files in (OLD, NEW):
            publish(tmp_path / "out", files)
            assert read(tmp_path / "out") == files == held(Path(elsewhere))


@pytest.mark.parametrize("there", [True, False])
def test_of_two_at_once_one_wins_whole_and_the_other_is_told(there: bool, tmp_path: Path) -> None:
    """Both have made their files; whichever publishes first stands."""
    for number in range(10):
        folder, told, ready = tmp_path / str(number) / "out", [], threading.Barrier(2)
        if there:
            scene(folder, OLD)

        def run(
            mine: str,
            folder: Path = folder,
            told: list[str] = told,
            ready: threading.Barrier = ready,
        ) -> None:
            with publication.staged(folder) as stage:
                for name in ("map.png", "summary.json", f"{mine}.csv"):
                    (stage.new / name).write_text(mine)
                ready.wait()
                try:
                    publication.publish(stage, mine, True)
                except UserError as error:
                    told.append(str(error))

        both = [threading.Thread(target=run, args=(mine,)) for mine in ("one", "two")]
        for one in both:
            one.start()
        for one in both:
            one.join()
        files = held(folder)
        (winner,) = set(files.values())
        assert set(files) == {"map.png", "summary.json", f"{winner}.csv"}
        assert read(folder) == files
        (line,) = told
        assert "another run has filled it in the meantime" in line
        assert hiding(folder, folder.parent) == []


@posix
def test_a_living_owner_keeps_its_folder_and_a_killed_one_does_not(tmp_path: Path) -> None:
    program = """
        import sys, time
        from pathlib import Path
        from drift.products.files import publication
        with publication.staged(Path(sys.argv[1])) as stage:
            (stage.new / "map.png").write_text("half")
            print("ready", flush=True)
            time.sleep(60)
    """
    words = [sys.executable, "-c", textwrap.dedent(program), str(tmp_path / "out")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=ROOT) as other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline() == "ready\n"
            publish(tmp_path / "out", OLD)
            (kept,) = hiding(tmp_path)
            assert (tmp_path / kept / "new" / "map.png").exists()
        finally:
            other.kill()
            other.wait()
    publish(tmp_path / "out", NEW)
    assert hiding(tmp_path, tmp_path / "out") == []


@posix
@pytest.mark.parametrize(("age", "gone"), [(3600, False), (90_000, True)])
def test_a_folder_of_another_machine_is_left_for_a_day(
    age: int, gone: bool, tmp_path: Path
) -> None:
    """Its locks may say nothing here."""
    other = tmp_path / f"{hidden.PREFIX}00000000-00000000-00000000-17-abc"
    (other / "new").mkdir(parents=True)
    (other / "lock").touch()
    for path in (other / "lock", other / "new", other):
        os.utime(path, (path.stat().st_mtime - age,) * 2)
    publish(tmp_path / "out", OLD)
    assert other.exists() is not gone


def test_a_reader_is_told_which_file_is_not_as_the_run_wrote_it(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    for there, word in ((False, "does not exist"), (True, "has no manifest.json")):
        if there:
            folder.mkdir()
        with pytest.raises(UserError, match=word):
            drift.results(folder)
    publish(folder, OLD)
    expected = {folder / name for name in (*OLD, manifest.NAME)}
    assert set(drift.results(folder)) == set(drift.results(str(folder))) == expected
    (folder / "notes.txt").write_text("mine")
    assert set(drift.results(folder)) == expected
    (folder / "map.png").write_text("OLD MAP")  # of the same length
    with pytest.raises(UserError, match=r'"map.png" has been changed'):
        drift.results(folder)
    (folder / "map.png").unlink()
    with pytest.raises(UserError, match=r'"map.png" is missing'):
        drift.results(folder)


def test_what_came_in_the_way_of_putting_back_is_told_and_stays(tmp_path: Path) -> None:
    """A user who finds a folder half empty after a crash, and puts something there."""
    for step in range(100):
        folder = tmp_path / str(step) / "out"
        scene(folder, OLD)
        assert stopped(step, lambda folder=folder: publish(folder, NEW)) is not None  # type: ignore[misc]
        if not (folder / "map.png").exists():
            break
    (folder / "map.png").write_text("mine")
    for _ in range(2):
        with pytest.raises(UserError, match=r'"map.png", which is not one of its files'):
            drift.results(folder)
        with pytest.raises(UserError, match=r'"map.png", which is not one of its files'):
            publication.check(folder, True)
    assert (folder / "map.png").read_text() == "mine"
    (folder / "map.png").unlink()
    assert read(folder) == OLD


@pytest.mark.thorough
@posix
def test_real_kills(tmp_path: Path) -> None:
    """A slice of benchmarks/kill_overwrite.py: SIGKILL at seeded moments of processes of their own."""
    path = ROOT / "benchmarks" / "kill_overwrite.py"
    spec = importlib.util.spec_from_file_location("kill_overwrite", path)
    assert spec is not None
    assert spec.loader is not None
    kills = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(kills)
    found = kills.trial(tmp_path / "out", 6, False, random.Random(4))
    assert found["old whole"] + found["new whole"] == 6
    assert found["mixture"] == found["lost"] == 0
    assert found["the user's things changed"] == found["hidden folders after the next run"] == 0
