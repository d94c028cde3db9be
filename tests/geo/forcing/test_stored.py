"""Slices on disk: made once for all processes, every bit as it was; what was cut short, altered or
did not fit is made again.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geo.array import Array
from geo.forcing.reading.kept import Shelf, SliceCache
from geo.forcing.reading.stored import Stored

# a denormal number too
VALUES = np.array([[[0.1, -0.0], [np.nan, np.inf], [3e-39, 7.0]]], np.float32)
KEY = ("current", 0.1, 3)


class Maker:
    """Makes a slice, and counts how often."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self) -> Array:
        self.calls += 1
        return VALUES.copy()


def same(got: Array) -> bool:
    return (
        got.shape == VALUES.shape and got.dtype == np.float32 and got.tobytes() == VALUES.tobytes()
    )


def slice_of(folder: Path) -> Path:
    (path,) = folder.glob("*.slice")
    return path


def test_what_one_has_made_others_read(tmp_path: Path) -> None:
    make = Maker()
    assert same(Stored(tmp_path).get(KEY, make))
    assert same(Stored(tmp_path).get(KEY, make))
    assert make.calls == 1
    Stored(tmp_path).get(("wind", 0.1, 3), make)
    assert make.calls == 2


def test_what_is_read_can_be_written_to_and_changes_no_file(tmp_path: Path) -> None:
    """A device copies an argument back after a kernel."""
    store, make = Stored(tmp_path), Maker()
    store.get(KEY, make)
    store.get(KEY, make)[...] = 5.0
    assert same(Stored(tmp_path).get(KEY, make))
    assert make.calls == 1


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size - 1)


def emptied(path: Path) -> None:
    os.truncate(path, 0)


def lengthened(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b"1")


def flipped(at: int) -> Callable[[Path], None]:
    def flip(path: Path) -> None:
        held = bytearray(path.read_bytes())
        held[at] ^= 1
        path.write_bytes(held)

    return flip


def of_another(path: Path) -> None:
    """Put a whole slice of another key under its name."""
    other = path.parent / "other"
    other.mkdir()
    Stored(other).get("another", lambda: VALUES + 1)
    os.replace(slice_of(other), path)


SHAPE = -16 - 16  # the middle of three numbers of eight bytes before the digest


@pytest.mark.parametrize(
    "fault",
    [cut, emptied, lengthened, flipped(3), flipped(-1), flipped(SHAPE), of_another, Path.unlink],
)
def test_what_is_not_as_it_was_written_is_made_again(
    tmp_path: Path, fault: Callable[[Path], None]
) -> None:
    make = Maker()
    Stored(tmp_path).get(KEY, make)
    fault(slice_of(tmp_path))
    assert same(Stored(tmp_path).get(KEY, make))
    assert make.calls == 2
    assert same(Stored(tmp_path).get(KEY, make))
    assert make.calls == 2


def test_a_full_disk_costs_the_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make = Maker()

    def full(*where: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    assert same(Stored(tmp_path).get(KEY, make))
    assert [path.suffix for path in tmp_path.iterdir()] == [".lock"]
    monkeypatch.undo()
    assert same(Stored(tmp_path / "gone").get(KEY, make))  # neither a folder nor a lock
    assert make.calls == 2


def test_of_several_processes_one_makes_it(tmp_path: Path) -> None:
    """Four ask at once, the first of whom dies while it makes it; of the others one does."""
    code = f"""
import os, pathlib, sys, time
import numpy as np
from geo.forcing.reading.stored import Stored
folder = pathlib.Path({str(tmp_path)!r})
def make():
    try:
        (folder / "first").touch(exist_ok=False)
    except FileExistsError:
        with open(folder / "made", "a") as log:
            log.write("x")
        time.sleep(0.3)
        return np.arange(12, dtype=np.float32).reshape(2, 3, 2)
    time.sleep(0.3)
    os._exit(9)
print(Stored(folder).get("key", make).sum())
"""
    together = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    told = sorted(process.communicate(timeout=60)[0].strip() for process in together)
    assert told == ["", "66.0", "66.0", "66.0"]
    assert (tmp_path / "made").read_text() == "x"


def test_what_is_in_memory_goes_to_the_store_and_comes_from_there(tmp_path: Path) -> None:
    finished, make = SliceCache(first=True), Maker()
    shelf = Shelf("part", finished)
    shelf.made(make, 2, 0)
    finished.store(tmp_path)
    held = shelf.find(2, 0)
    assert held is not None
    assert same(held)
    other = SliceCache()
    other.store(tmp_path)
    assert same(Shelf("part", other).made(make, 2, 0))
    assert make.calls == 1
    finished.store(None)
    assert shelf.find(2, 0) is None
    assert same(shelf.made(make, 2, 0))
    assert make.calls == 2
