"""`drift info --backend`, and what the command line says of the backend that it took or refuses."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import trial_case
from places import ROOT

from drift.apps.cli import commands
from kernels.runtime import devices, drivers, runtime
from kernels.runtime.devices import Device, Listed

GIB = 2**30
CARD = Device("cuda", 0, "Card", "discrete", "driver 550.54, CUDA 12.4", 80 * GIB, 60 * GIB)
OLD = Device(
    "cuda", 1, "Old card", "discrete", "CUDA 12.4", 2 * GIB, None, "too old", "take another"
)
SOFT = Device("vulkan", 0, "llvmpipe", "software", "llvmpipe Mesa 25.0.7", 24 * GIB, 20 * GIB)
METAL = Listed("metal", (), "it is for macOS on Apple's own processors")
CASE = trial_case.text(duration="1 h", output={"trajectories": 0})


@pytest.fixture
def listing(monkeypatch: pytest.MonkeyPatch):
    def lists(*listed: Listed) -> None:
        by_name = {one.backend: one for one in listed}
        monkeypatch.setattr(drivers, "ask", by_name.__getitem__)

    return lists


Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(params=["here", pytest.param("process", marks=pytest.mark.thorough)])
def shell(
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> Command:
    """Return what does a command on a machine whose drivers are not there.

    That is here, where a backend seems not to have been started and the one that is taken runs
    already, or in a process.
    """
    (tmp_path / "case.toml").write_text(CASE, encoding="utf-8")
    if request.param == "process":
        return lambda *words: apart(tmp_path, *words)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(drivers, "_library", lambda *names: None)
    monkeypatch.setattr(runtime, "_init", lambda backend, threads, device: None)

    def here(*words: str) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(runtime, "_started", {})
        capfd.readouterr()
        status = commands.main(list(words))
        return subprocess.CompletedProcess(words, status, *capfd.readouterr())

    return here


def apart(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Return what the command does in a process of its own."""
    code = "import sys; from kernels.runtime import drivers, devices; from drift.apps.cli import commands\n"
    code += "drivers._library = lambda *names: None\nsys.exit(commands.main(sys.argv[1:]))"
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=200,
    )


def test_cards_are_listed_with_what_auto_takes(listing, capsys: pytest.CaptureFixture[str]) -> None:
    listing(Listed("cuda", (CARD, OLD)), Listed("vulkan", (SOFT,)), METAL)
    assert commands.main(["info", "--backend"]) == 0
    told = capsys.readouterr().out
    rows = [" ".join(line.split()) for line in told.splitlines()]
    assert "cpu this processor processor yes" in rows
    assert "cuda Card * discrete driver 550.54, CUDA 12.4 60.0 GiB of 80.0 GiB free yes" in rows
    assert (
        "cuda Old card discrete CUDA 12.4 unknown of 2.0 GiB free no: too old; take another" in rows
    )
    assert (
        "vulkan llvmpipe software llvmpipe Mesa 25.0.7 the processor's memory yes, for tests: a software device"
        in rows
    )
    assert "metal none no: it is for macOS on Apple's own processors" in rows
    assert rows[-1] == (
        "--backend auto takes cuda: Card, driver 550.54, CUDA 12.4; 60.0 GiB of 80.0 GiB free; "
        "runs with fewer than 100,000 particles use the CPU"
    )


def test_cards_for_programs(listing, capsys: pytest.CaptureFixture[str]) -> None:
    listing(
        Listed("cuda", (), "no NVIDIA driver is found", "install it"),
        Listed("vulkan", (SOFT,)),
        METAL,
    )
    assert commands.main(["info", "--backend", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["auto"]["backend"] == "cpu"
    assert told["auto"]["least_particles"] == devices.WORTH
    assert told["missing"]["cuda"] == {"why": "no NVIDIA driver is found", "remedy": "install it"}
    assert told["devices"] == [
        {
            "backend": "vulkan", "number": 0, "name": "llvmpipe", "kind": "software", "driver": "llvmpipe Mesa 25.0.7",
            "memory_bytes": 24 * GIB, "free_bytes": 20 * GIB, "usable": True, "why": "", "remedy": "", "taken": True,
        }
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ((), "give forcing files, or --backend"),
        (("x.nc", "--backend"), "--backend lists graphics cards: give no files"),
    ],
)
def test_info_takes_files_or_cards(
    words: tuple[str, ...], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert commands.main(["info", *words]) == 2
    assert capsys.readouterr().err.startswith(f"drift: {why}")


def test_a_card_that_is_not_there_is_refused_before_a_file_is_touched_and_the_remedy_works(
    shell: Command, tmp_path: Path
) -> None:
    done = shell("run", "case.toml", "--backend", "cuda", "--out", "out")
    assert done.returncode == 2
    assert done.stderr == (
        "drift: --backend cuda: no NVIDIA driver is found; install NVIDIA's driver (a container: start it with --gpus all), "
        "or use --backend cpu\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]
    mended = shell("run", "case.toml", "--backend", "cpu", "--out", "out")
    assert mended.returncode == 0
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    again = shell("run", "case.toml", "--backend", "vulkan", "--out", "out", "--overwrite")
    assert again.returncode == 2
    assert again.stderr.startswith(
        "drift: --backend vulkan: no Vulkan loader is found; install the card's driver"
    )
    assert {path: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


@pytest.mark.parametrize("command", ["run", "experiment"])
def test_auto_says_in_a_line_what_it_took(command: str, shell: Command, tmp_path: Path) -> None:
    few = ["--runs", "2"] if command == "experiment" else []
    done = shell(command, "case.toml", "--backend", "auto", "--out", "out", "--json", *few)
    assert done.returncode == 0
    line = "drift: --backend auto takes cpu: a card is worth it from 100,000 particles or clouds on, and this has 500"
    assert done.stderr.splitlines().count(line) == 1
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["backend"] == "cpu"
    assert "device" not in summary


def test_auto_is_silent_where_that_is_asked(shell: Command) -> None:
    given = ["--out", "quiet", "--quiet", "--set", "uncertainty=none"]
    quiet = shell("run", "case.toml", "--backend", "auto", *given)
    assert (quiet.returncode, quiet.stderr) == (0, "")


@pytest.mark.thorough
def test_auto_says_that_workers_have_processors(shell: Command) -> None:
    pytest.importorskip("distributed")
    done = shell("run", "case.toml", "--backend", "auto", "--out", "out", "--workers", "1")
    assert done.returncode == 0
    assert (
        "drift: --backend auto takes cpu: workers move particles on processors"
        in done.stderr.splitlines()
    )


def test_serve_refuses_a_card_that_is_not_there_before_it_listens(shell: Command) -> None:
    pytest.importorskip("uvicorn")
    done = shell("serve", ".", "--backend", "cuda", "--no-browser")
    assert done.returncode == 2
    assert done.stderr.startswith("drift: --backend cuda: no NVIDIA driver is found; ")
    assert done.stdout == ""
