"""The command line: exit statuses, one-line refusals, lists, quick starts."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from drift.apps.cli import commands as cli
from drift.apps.cli import terminal


def call(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    status = cli.main(words)
    streams = capsys.readouterr()
    return status, streams.out, streams.err


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "--help")
    assert (status, err) == (0, "")
    for command in ("run", "compare", "check", "cases", "new", "objects", "info"):
        assert f"  {command} " in out
    assert call(capsys)[0] == 0
    assert call(capsys, "--version")[1].startswith("drift ")


def test_objects_lists_and_searches(capsys: pytest.CaptureFixture[str]) -> None:
    _, whole, _ = call(capsys, "objects")
    assert (
        sum(line.strip() != "" for line in whole.splitlines()) == 92 + 10 + 16
    )  # classes, headings and notes, search objects
    assert "upwind, as published, in winds below [m/s]: PIW-3 2.5, LIFE-RAFT-DB-10 0.7" in whole
    status, out, _ = call(capsys, "objects", "raft", "15-50", "light")
    assert status == 0
    assert "LIFE-RAFT-DB-19" in out
    assert "0.38  -3.33" in out
    assert "-0.59  +1.59" in out
    assert "DB-18" not in out
    assert "search_object of LIFE-RAFT-DB-19: Raft 15 person to Raft 25 person, by capacity" in out
    status, out, _ = call(capsys, "objects", "jet", "boat")
    assert status == 0
    assert "no class of jet boats: small powerboats are nearest" in out


def test_cases_lists_titles(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "cases")
    assert status == 0
    assert "overdue_boat" in out
    assert "synthetic" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("fly",), "invalid choice: 'fly'"),
        (("run",), "required: CASE"),
        (("run", "nowhere"), 'no case "nowhere"'),
        (("run", "overdue_boat", "--backend", "abacus"), "invalid choice: 'abacus'"),
        (("run", "overdue_boat", "--threads", "0"), "--threads 0 must be at least 1"),
        (("run", "overdue_boat", "--seed", "x"), "invalid int value"),
        (("check", "overdue_boat", "--set", "clock.step"), '--set "clock.step" must be KEY=VALUE'),
        (("check", "overdue_boat", "--set", "clock.step=blue"), 'clock.step: "blue" is not a step'),
        (("check", "overdue_boat", "--set", "duration=12 parsecs"), "is a unit of another kind"),
        (("check", "overdue_boat", "--seed", "-3"), "seed: -3 must be 0 to"),
        (("check", "overdue_boat", "--set", "particles=0"), "0 particles"),
        (("objects", "spaceship"), 'no leeway class contains "spaceship"'),
    ],
)
def test_users_errors_are_one_line(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = call(capsys, *words)
    assert (status, out) == (2, "")
    assert err.startswith("drift: ")
    assert err.count("\n") == 1
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_interrupt_and_own_errors(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(error: BaseException) -> Any:
        def raising(given: object) -> None:
            raise error

        return raising

    monkeypatch.setitem(cli.COMMANDS, "cases", fail(KeyboardInterrupt()))
    status, out, err = call(capsys, "cases")
    assert (status, out, err.count("\n")) == (130, "", 1)
    monkeypatch.setitem(cli.COMMANDS, "cases", fail(ZeroDivisionError("oops")))
    status, out, err = call(capsys, "cases")
    assert (status, out) == (1, "")
    assert err.splitlines()[-1] == "drift: internal error in drift: ZeroDivisionError: oops"
    assert "Traceback" in err


def started(*words: str) -> tuple[float, subprocess.CompletedProcess[str]]:
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "drift", *words],
        capture_output=True,
        text=True,
        check=True,
    )
    return time.perf_counter() - begin, done


@pytest.mark.parametrize("words", [("--help",), ("objects",)])
def test_quick_starts_import_nothing_heavy(words: tuple[str, ...]) -> None:
    _, done = started(*words)
    for heavy in ("taichi", "xarray", "matplotlib", "pydantic", "pint", "shapely", "numpy"):
        assert f" {heavy}\n" not in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for one process")
@pytest.mark.parametrize(
    "delay", [0.3, 0.8, pytest.param(3.0, marks=pytest.mark.thorough)]
)  # [s] while importing, while reading or drifting
def test_interrupted_run_leaves_nothing(tmp_path: Path, delay: float) -> None:
    ready = "from drift.apps.cli import commands; print(flush=True); commands.leave()"
    words = [
        sys.executable,
        "-c",
        ready,
        "run",
        "overdue_boat",
        "--set",
        "particles=1_000_000",
        "--out",
        "results",
    ]
    running = subprocess.Popen(
        words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert running.stdout is not None
    assert running.stdout.readline() == "\n"  # it has started, however busy the machine is
    time.sleep(delay)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, out) == (130, "")
    assert err == "drift: interrupted; no incomplete file is left\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="no SIGPIPE")
def test_reader_that_leaves_early() -> None:
    done = subprocess.run(
        f"'{sys.executable}' -m drift objects | head -n 1",
        shell=True,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""


@pytest.mark.parametrize("width", [60, 80, 120])
def test_facts_fold_at_the_terminals_width_and_are_whole_in_a_pipe(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    """No letter is lost, not even of a path that no line holds; what is folded hangs under its own
    column.
    """
    title = "Overdue boat, somewhere in the Gulf of Mexico with a title that is rather long indeed for a terminal: ready"
    told = {
        'sortie "HC-144 about the last call, the second of the day"': "23 legs, 221330ZNOV26 to 221553ZNOV26, "
        * 4,
        "current sea": "/data/" + "without_any_space/" * 12 + "sea.nc",
    }
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    terminal.print_facts(title, told)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    rows = "".join("".join(line.split()) for line in lines)
    assert rows.startswith("".join(title.split()))
    edge = next(line.index("23 legs") for line in lines if "23 legs" in line)
    columns = (
        "".join(line[at].strip() for line in lines[2:])
        for at in (slice(0, edge), slice(edge, None))
    )
    for column, texts in zip(columns, (told.keys(), told.values()), strict=True):
        assert all("".join(text.split()) in "".join(column.split()) for text in texts)
    monkeypatch.undo()
    terminal.print_facts(title, told)
    assert len(capsys.readouterr().out.strip().splitlines()) == 3


def test_info_takes_the_keys_of_a_case_and_names_the_right_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lon, lat = np.linspace(3.0, 6.0, 7), np.linspace(59.0, 61.0, 9)
    x, y = np.meshgrid(lon, lat)
    for name, east, north, said in (
        ("sea.nc", "ue", "vn", {"units": "cm s-1"}),
        ("air.nc", "u10", "v10", {"units": "m s-1"}),
    ):
        values = {
            east: (("lat", "lon"), 20.0 + x, said),
            north: (("lat", "lon"), 10.0 - y / 10, said),
        }
        xr.Dataset(values, {"lon": lon, "lat": lat}).to_netcdf(tmp_path / name)
    sea, air = str(tmp_path / "sea.nc"), str(tmp_path / "air.nc")
    chosen = ["--set", "variables.east=ue", "--set", "variables.north=vn", "--set", "steady=true"]
    status, _, refusal = call(capsys, "info", sea, *chosen)
    assert status == 2
    assert (
        "nothing says whether ue and vn are a current, a wind or a Stokes drift; say which: --as"
        in refusal
    )
    status, told, _ = call(capsys, "info", sea, *chosen, "--as", "current")
    assert status == 0
    assert "current: sea.nc" in told
    assert (
        f"mean vector {np.mean(20 + x) / 100:+.2f} east, {np.mean(10 - y / 10) / 100:+.2f} north"
        in told
    )
    status, _, refusal = call(capsys, "info", sea, *chosen, "--as", "current", "--set", "units=kn")
    assert status == 2
    # by the file's name, not "current 1"
    assert "sea.nc: ue, vn can't be a current: mean 13" in refusal
    status, _, refusal = call(capsys, "info", air, "--set", "steadi=true")
    assert status == 2
    assert 'did you mean "steady"' in refusal
    with xr.open_dataset(tmp_path / "sea.nc") as data:
        data.rename(ue="water_u", vn="water_v").to_netcdf(tmp_path / "named.nc")
    status, told, _ = call(capsys, "info", air, str(tmp_path / "named.nc"), "--set", "steady=true")
    assert status == 0
    assert "current: named.nc" in told
    assert "wind: air.nc" in told
