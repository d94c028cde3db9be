"""A stopped run goes on only with what fits: altered files, another case and another processor are
noticed.
"""

import json
import os
import shutil
import socket
from pathlib import Path

import numpy as np
import pytest
import shards as runs
from stopped_runs import Stopped, shards_of, stopping, unfinished

import drift
from drift.pipeline import flow
from drift.pipeline.shards import divide, machine, unit, work

PAINTS = False  # pictures of shards are compared by the tests of spills


@pytest.fixture
def unwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the files of results out, which take seconds; their contents are compared."""
    monkeypatch.setattr(flow, "write_results", lambda *given, **more: None)


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
