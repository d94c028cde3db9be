"""Odd names, files and folders in every command: one line and exit status 2, never a traceback or a
wait without end.
"""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import small_case
import xarray as xr

import drift
from drift.apps.cli.commands import main
from drift.engine.motion import spool
from drift.engine.motion.period import Period
from drift.products.files import temporary
from geo.errors import UserError
from geo.files import dataset
from geo.forcing import describe, sources

posix = pytest.mark.skipif(os.name != "posix", reason="pipes, devices and names of POSIX")


def line(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return the one line with which a command refuses."""
    status = main(words)
    captured = capsys.readouterr()
    assert (status, captured.out) == (2, ""), captured
    (told,) = captured.err.strip().splitlines()
    assert told.startswith("drift: ")
    return told


def sparse(path: Path) -> None:
    with open(path, "wb") as file:
        file.truncate(10 * 2**30)


CASES: dict[str, tuple[str, Callable[[Path], object] | None, str]] = {
    "300 letters": ("n" * 300, None, "name too long"),
    "300 letters and .toml": ("n" * 300 + ".toml", None, "name too long"),
    "no name": ("", None, "directory"),
    "a pipe": ("pipe.toml", os.mkfifo, "a pipe or a device"),
    "a pipe by a name like a shipped case's": ("pipe", os.mkfifo, "a pipe or a device"),
    "no end": ("/dev/zero", None, "a pipe or a device"),
    "a folder": ("folder.toml", os.mkdir, "directory"),
    "a loop of links": ("loop.toml", lambda path: path.symlink_to(path), "links"),
    "10 GB": ("big.toml", sparse, "10,240 MiB"),
    "nested without end": (
        "deep.toml",
        lambda path: path.write_text("a = " + "[" * 100_000),
        "not valid TOML",
    ),
    "bytes": ("bytes.toml", lambda path: path.write_bytes(b"\x00\xff" * 50), "not text in UTF-8"),
    "a name that is not text": (os.fsdecode(b"x\xff.toml"), None, "no case"),
    "below a file": ("file/x", lambda path: path.parent.write_text(""), "no case"),
}


@posix
@pytest.mark.parametrize("kind", CASES)
def test_cases(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name, make, word = CASES[kind]
    monkeypatch.chdir(tmp_path)
    if make is not None:
        make(Path(name))
    for command in ("check", "run", "plan", "origin"):
        assert word in line(capsys, command, name)
    with pytest.raises(UserError, match=word):
        drift.load(name)
    with pytest.raises(UserError, match=r"null (byte|character)"):
        drift.load("a\0b")


def test_a_case_whose_results_have_too_long_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The name of the case is 255 letters long, and "-forecast" comes after it."""
    monkeypatch.chdir(tmp_path)
    Path("n" * 250 + ".toml").write_text(small_case.STEADY)
    assert "name another with --out" in line(capsys, "run", "n" * 250 + ".toml")


PLOTS: dict[str, tuple[str, Callable[[Path], object] | None]] = {
    "no such folder": ("none/x.png", None),
    "a folder": ("x.png", os.mkdir),
    "another kind": ("x.jpg", None),
    "no name": ("", None),
    "300 letters": ("n" * 300 + ".png", None),
    "a pipe": ("x.png", lambda path: os.mkfifo(path)),
    "a loop of links": ("x.png", lambda path: path.symlink_to(path)),
    "a folder in which nobody can write": ("/proc/x.png", None),
}


@posix
@pytest.mark.parametrize("kind", PLOTS)
def test_plots(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Refused before anything is read: nothing is printed, and nothing is left."""
    name, make = PLOTS[kind]
    monkeypatch.chdir(tmp_path)
    small_case.field().to_netcdf("f.nc")
    if make is not None:
        make(Path(name))
    before = sorted(os.listdir())
    if kind.endswith("can write"):
        assert main(["info", "f.nc", "--plot", name]) == 2
    else:
        assert "--plot" in line(capsys, "info", "f.nc", "--plot", name)
    assert sorted(os.listdir()) == before


def test_a_plot_that_fails_half_way_leaves_the_one_of_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from drift.products.maps import field

    def full(path: Path, *arguments: Any, **more: Any) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(field, "draw_field", full)
    small_case.field().to_netcdf("f.nc")
    Path("x.png").write_bytes(b"old")
    assert main(["info", "f.nc", "--plot", "x.png"]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert sorted(os.listdir()) == ["f.nc", "x.png"]
    assert Path("x.png").read_bytes() == b"old"


class Damaged(dict[str, Any]):
    """Attributes that cannot be read."""

    error: Exception = RuntimeError("NetCDF: HDF error")

    def items(self) -> Any:
        raise self.error

    __getitem__ = get = keys = __iter__ = __contains__ = lambda self, *rest: self.items()  # type: ignore[assignment]


@pytest.mark.parametrize(
    "error",
    [RuntimeError("NetCDF: HDF error"), OSError(-101, "NetCDF: HDF error"), UnicodeDecodeError("utf-8", b"\xff", 0, 1, "bad")],
)  # fmt: skip
def test_attributes_that_cannot_be_read(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Libraries read some of them when they are asked for, long after the opening."""
    small_case.field().to_netcdf(tmp_path / "f.nc")
    broken, real = Damaged(), dataset.open_one
    broken.error = error
    reads: tuple[Callable[[Path], object], ...] = (
        lambda path: describe.open_quantities([path]),
        lambda path: sources.open_source("current", path),
    )
    for read in reads:
        with monkeypatch.context() as patch:

            def opened(
                path: str, quantity: str, *more: float, patch: pytest.MonkeyPatch = patch
            ) -> xr.Dataset:
                data = real(path, quantity, *more)
                patch.setattr(xr.Variable, "attrs", property(lambda self: broken))
                return data

            patch.setattr(dataset, "open_one", opened)
            with pytest.raises(UserError, match=r'f\.nc": .*damaged.*\[\[current\]\] files'):
                read(tmp_path / "f.nc")


def test_faults_of_our_own_are_not_blamed_on_the_file() -> None:
    def ours() -> None:
        raise KeyError("x")

    with pytest.raises(KeyError), dataset.reporting_damage(["f.nc"], "current"):
        ours()
    with pytest.raises(UserError, match="KeyError"), dataset.reporting_damage(["f.nc"], "current"):
        xr.Dataset()["x"]  # raised inside a library


def stored(outputs: int = 3, n: int = 1000) -> spool.SnapshotStore:
    """Return a spool of particles at some times."""
    begin = np.datetime64("2026-01-01", "s")
    column = np.zeros(n, np.float32)
    ensemble = SimpleNamespace(
        n=n,
        bounds=np.array([0, n]),
        scenarios=[(0, n)],
        log_weight=SimpleNamespace(to_numpy=lambda: column),
    )
    moments = (
        SimpleNamespace(
            lon=column,
            lat=column,
            status=column,
            log_weight=column,
            elapsed=k,
            ancestors=None,
            lineage=None,
        )
        for k in range(outputs)
    )
    return spool.SnapshotStore.of_run(
        Period(begin, begin + np.timedelta64(outputs, "s"), 1), ensemble, moments, outputs
    )  # type: ignore[arg-type]


def test_room_for_the_particles_is_known_before_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """3 times of 1,000 particles of two positions, a status and a weight: 39,000 bytes."""
    monkeypatch.setattr(temporary.shutil, "disk_usage", lambda folder: SimpleNamespace(free=38_999))
    with pytest.raises(UserError, match=r"temporary folder .*TMPDIR"):
        stored()


@posix
def test_a_temporary_folder_that_fills_up_or_is_not_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if Path("/dev/full").exists():
        monkeypatch.setattr(tempfile, "TemporaryFile", lambda: open("/dev/full", "w+b"))  # noqa: SIM115
        with pytest.raises(UserError, match=r"No space left on device.*TMPDIR"):
            stored()
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "none"))
    with pytest.raises(UserError, match=r"temporary folder .*No such file"):
        stored()


def test_the_folder_for_results_may_be_text(tmp_path: Path) -> None:
    """In Python, as everybody writes it first."""
    (tmp_path / "trial.toml").write_text(small_case.STEADY)
    drift.run(drift.load(str(tmp_path / "trial.toml")), str(tmp_path / "out"))
    assert (tmp_path / "out" / "forecast.nc") in drift.results(str(tmp_path / "out"))
