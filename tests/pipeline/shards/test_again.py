"""`--resume`: results of exactly this run are left alone, those of another are replaced once the
new ones are complete.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import same_files
import shards as runs
import trial_case

import drift
from drift.apps.cli import commands
from drift.forecast.products import chapter as forecast_chapter
from drift.pipeline import flow
from drift.pipeline.shards import shelf
from drift.products.files import hidden
from drift.products.files.chapter import OutputBundle
from geo.errors import UserError

SMALL = {"particles": 9000}  # three blocks


@pytest.fixture(scope="module", autouse=True)
def plain() -> Any:
    """Draw no pictures, which take seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forecast_chapter, "PICTURES", {})
        patch.setattr(forecast_chapter, "SCENARIO_PICTURES", {})
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("again")
    runs.case(folder)
    return folder


@pytest.fixture(scope="module")
def case(folder: Path) -> drift.Case:
    return drift.vary(drift.load(folder / "case.toml"), SMALL)


@pytest.fixture(scope="module")
def finished(case: drift.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished") / "out"
    assert drift.run(case, out, shards=2, resume=True) is not None
    return out


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "out"))


def held(folder: Path) -> dict[str, tuple[int, bytes]]:
    return {path.name: (path.stat().st_ino, path.read_bytes()) for path in folder.iterdir()}


def left(out: Path) -> list[str]:
    return sorted(path.name for path in out.parent.iterdir() if path != out)


@pytest.mark.thorough
def test_results_that_stand_are_left_alone(
    case: drift.Case, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = held(out)
    monkeypatch.setattr(flow, "forecast_job", lambda *given: pytest.fail("it is run"))
    assert drift.run(case, out, resume=True) is None
    assert drift.run(case, out, resume=True, shards=3, memory=1.0) is None  # neither changes a bit
    assert held(out) == before
    assert left(out) == []


@pytest.mark.thorough
def test_the_command_line_says_so_in_a_line(
    case: drift.Case, out: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = [
        "run",
        str(folder / "case.toml"),
        "--set",
        "particles=9000",
        "--out",
        str(out),
        "--resume",
    ]
    assert (
        commands.main(
            ["run", str(folder / "case.toml"), "--set", "particles=9000", "--out", str(out)]
        )
        == 2
    )
    assert "is not empty" in capsys.readouterr().err
    # The text of a case tells how it was changed, from Python or from here.
    assert commands.main([*asked, "--quiet"]) == 0
    capsys.readouterr()
    assert commands.main(asked) == 0
    assert (
        capsys.readouterr().out.split()
        == f"{out} holds the results of exactly this run: nothing to do".split()
    )
    assert commands.main([*asked, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "command": "run",
        "unchanged": True,
        "results": str(out),
    }


@pytest.mark.thorough
def test_results_of_another_run_stand_until_the_new_ones_are_complete(
    case: drift.Case, out: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Stopped in the middle; then stopped as nothing but the unfinished folder was left to take
    away; then at rest.
    """
    other, before = drift.vary(case, {"seed": 78}), held(out)

    def half(phase: str, share: float) -> None:
        if phase == "drift" and share >= 0.6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        drift.run(other, out, shards=2, resume=True, report=half)
    assert "holds results of another run: the case and the seed changed since" in caplog.text
    assert held(out) == before
    assert left(out) == [f".out{hidden.UNFINISHED}"]
    with pytest.MonkeyPatch.context() as patch:

        def killed(folder: Path) -> None:
            raise KeyboardInterrupt

        patch.setattr(shelf, "clear", killed)
        with pytest.raises(KeyboardInterrupt):
            drift.run(other, out, shards=2, resume=True)
    assert "1 shards of this run were finished before" in caplog.text
    assert left(out) == [f".out{hidden.UNFINISHED}"]
    assert drift.run(other, out, resume=True) is None
    assert left(out) == []
    drift.run(other, tmp_path / "fresh")
    assert same_files.differences(tmp_path / "fresh", out) == []


@pytest.mark.thorough
def test_killed_while_the_results_are_exchanged(
    case: drift.Case, out: Path, folder: Path, tmp_path: Path
) -> None:
    """The new manifest does not stand: the next run puts the old files back, and replaces them from
    its finished shards.
    """
    before = {name: contents for name, (_, contents) in held(out).items()}
    asked = f"drift.run(drift.vary(drift.load({str(folder / 'case.toml')!r}), {{'particles': 9000, 'seed': 78}}), {str(out)!r}"
    dying = f"""
import os
import drift
from drift.forecast.products import chapter
chapter.PICTURES, chapter.SCENARIO_PICTURES = {{}}, {{}}
rename = os.rename
def last(source, goal):
    if str(goal) == {str(out / "manifest.json")!r}:
        os._exit(9)
    rename(source, goal)
os.rename = last
{asked}, shards=2, resume=True)
"""
    assert (
        subprocess.run(
            [sys.executable, "-c", dying], check=False, stderr=subprocess.DEVNULL
        ).returncode
        == 9
    )
    assert not (out / "manifest.json").exists()
    assert {path.name for path in drift.results(out)} == {*before}
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    other = drift.vary(case, {"seed": 78})
    moved: list[int] = []
    assert (
        drift.run(other, out, shards=2, resume=True, report=lambda phase, share: moved.append(1))
        is not None
    )
    assert left(out) == []
    drift.run(other, tmp_path / "fresh")
    assert same_files.differences(tmp_path / "fresh", out) == []


@pytest.mark.thorough
@pytest.mark.parametrize("fault", ["altered", "gone", "no manifest"])
def test_results_that_are_not_as_they_were_written_are_made_anew(
    case: drift.Case, finished: Path, out: Path, fault: str
) -> None:
    path = out / ("manifest.json" if fault == "no manifest" else "track.csv")
    if fault == "altered":
        path.write_text(path.read_text() + "1\n")
        assert drift.run(case, out, resume=True) is not None
    elif fault == "gone":
        path.unlink()
        assert drift.run(case, out, resume=True) is not None
    else:
        path.unlink()
        with pytest.raises(
            UserError, match="is in the way: it is a file that no run of drift lists"
        ):
            drift.run(case, out, resume=True)
        return
    assert same_files.differences(finished, out) == []
    assert drift.run(case, out, resume=True) is None


def test_what_a_run_follows_from_is_asked(
    finished: Path,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A file of the same name but other bytes, other versions, and a plan's folder, whose forecast
    is another.
    """

    class Begun(Exception):
        pass

    def begin(*given: object) -> None:
        raise Begun

    runs.case(tmp_path)
    own = drift.vary(drift.load(tmp_path / "case.toml"), SMALL)
    out = Path(shutil.copytree(finished, tmp_path / "out"))
    assert drift.run(own, out, resume=True) is None  # it lies elsewhere, and is the same
    with monkeypatch.context() as patch:
        patch.setattr(flow, "open_result", begin)
        land = tmp_path / "land.geojson"
        land.write_text(land.read_text().replace("[2, 2]", "[2, 2.5]"))
        with pytest.raises(Begun):
            drift.run(own, out, resume=True)
        assert "the files changed since" in caplog.text
        runs.case(tmp_path)
        caplog.clear()
        summary = json.loads((out / "summary.json").read_text())
        assert summary["command"] == "run"
        for key, value, said in (
            ("versions", "casp-drift 0", "the versions"),
            ("backend", "cuda", "the backend"),
        ):
            patch.setattr(flow.publication, "summary", lambda *given, s={**summary, key: value}: s)
            with pytest.raises(Begun):
                drift.run(own, out, resume=True)
            assert f": {said} changed since" in caplog.text
    with monkeypatch.context() as patch:
        write = flow.write_results
        patch.setattr(
            flow, "write_results", lambda result, job: write(result, job, more=[OutputBundle()])
        )
        drift.run(own, tmp_path / "plan")
        patch.setattr(flow, "open_result", begin)
        with pytest.raises(Begun):
            drift.run(own, tmp_path / "plan", resume=True)
        assert ": the command changed since" in caplog.text


def test_nothing_to_go_on_with(case: drift.Case) -> None:
    with pytest.raises(UserError, match="needs out: without an output folder"):
        drift.run(case, resume=True)  # type: ignore[call-overload]


@pytest.mark.thorough
def test_forcing_of_files_is_asked_by_its_bytes(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    import model_writers
    import writers

    writers.projected(tmp_path / "current.nc")
    case = trial_case.load(
        tmp_path,
        start="2024-03-05T00:10Z",
        duration="2 h",
        current={"files": "current.nc"},
        scenario={"position": {"at": [4.0, 59.0], "error": "4 km"}},
    )
    assert drift.run(case, tmp_path / "out", resume=True) is not None
    assert drift.run(case, tmp_path / "out", resume=True) is None
    model_writers.curved_true(tmp_path / "current.nc")
    one = drift.run(case, tmp_path / "out", resume=True)
    assert "the forcing and the files changed since" in caplog.text
    assert one is not None
    assert not np.array_equal(
        one.trajectories.lon, drift.run(drift.vary(case, {"seed": 4})).trajectories.lon
    )
    assert os.listdir(tmp_path / "out")
