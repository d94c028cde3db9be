"""The kernel's fence: files that libraries open by themselves, in a process as `drift serve` starts
them.
"""

import re
import subprocess
import sys
from pathlib import Path

import hostile_netcdf
import pytest
from places import ROOT

from geo.files import fence, landlock

READ = """
import sys
from drift.apps.cli import tethered
if sys.argv[1] == "enclosed":
    tethered.enclose()
from geo.files import dataset
values = dataset.open_one(sys.argv[2], "current")["uo"].values
print("read" if (values == 0.25).all() else values)
"""


def done(code: str, *given: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return what a process prints whose fence is a folder."""
    monkeypatch.setenv(fence.NAME, fence.fence_text(fence.Fence((folder,))))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    one = subprocess.run(
        [sys.executable, "-c", code, *given],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
    )
    return one.stdout + one.stderr


@pytest.fixture
def inside(tmp_path: Path) -> Path:
    (tmp_path / "inside").mkdir()
    (tmp_path / "secret.nc").write_text("secret", encoding="utf-8")
    return (tmp_path / "inside").resolve()


needs = pytest.mark.skipif(not landlock.version(), reason="this system has no Landlock")


@pytest.mark.thorough
@needs
@pytest.mark.parametrize(
    "how",
    [
        pytest.param(how, marks=[pytest.mark.thorough] * (how == "storage"))
        for how in hostile_netcdf.FILES
    ],
)
def test_no_file_that_a_netcdf_file_names_is_read(
    inside: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """The library reads it where the kernel does not hold the fence, and where it lies in the
    folder.
    """
    hostile_netcdf.secret(inside.parent / "secret.nc", how)
    hostile_netcdf.write(inside / "x.nc", how, inside.parent / "secret.nc")
    assert (
        done(READ, "open", str(inside / "x.nc"), folder=inside, monkeypatch=monkeypatch) == "read\n"
    )
    told = done(READ, "enclosed", str(inside / "x.nc"), folder=inside, monkeypatch=monkeypatch)
    assert re.search("NetCDF: HDF error|truncated or damaged", told.splitlines()[-1])
    hostile_netcdf.secret(inside / "own.nc", how)
    hostile_netcdf.write(inside / "y.nc", how, inside / "own.nc")
    assert (
        done(READ, "enclosed", str(inside / "y.nc"), folder=inside, monkeypatch=monkeypatch)
        == "read\n"
    )


TRY = """
import os, subprocess, sys, tempfile
from drift.apps.cli import tethered
tethered.enclose()
def opens(path, how=os.O_RDONLY):
    try:
        os.close(os.open(path, how))
        return True
    except PermissionError:
        return False
print([opens(path) for path in sys.argv[1:]])
print(subprocess.run([sys.executable, "-c", "open(__import__('sys').argv[1])", sys.argv[1]], capture_output=True).returncode)
os.mkdir("a"), os.mkdir("b"), open("a/x", "w").close(), os.rename("a/x", "b/x")
print(os.listdir("b"), tempfile.TemporaryFile().write(b"12"))
"""


@needs
def test_what_is_outside_is_closed(inside: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also to processes that it starts; what it works with is open: moving files from folder to
    folder, other files.
    """
    (inside / "in").write_text("", encoding="utf-8")
    (inside / "link").symlink_to(inside.parent / "secret.nc")
    monkeypatch.setenv("TMPDIR", str(inside))
    closed = [
        str(inside.parent / "secret.nc"),
        str(inside / "link"),
        "/proc/self/environ",
        "/proc/self/mem",
        "/etc/passwd",
    ]
    told = done(
        TRY, *closed, str(inside / "in"), "/dev/null", folder=inside, monkeypatch=monkeypatch
    ).splitlines()
    assert told == [str([False] * len(closed) + [True, True]), "1", "['x'] 2"]


WRITE = """
import os, sys
from pathlib import Path
from drift.apps.cli import tethered
tethered.enclose()
def fails(act, *given):
    try:
        act(*given)
    except PermissionError:
        return True
    return False
served, other = Path(sys.argv[1]), Path(sys.argv[2])
(served / "results").mkdir()
(served / "results" / "map.png").write_text("map")
os.replace(served / "results", served / "forecast")
(served / "forecast" / "map.png").write_text("shorter")
acts = {
    "new": lambda: (other / "new").write_text("x"), "write": lambda: (other / "own").write_text("x"),
    "append": lambda: open(other / "own", "a").close(), "truncate": lambda: os.truncate(other / "own", 0),
    "remove": lambda: (other / "own").unlink(), "folder": lambda: (other / "folder").mkdir(),
    "rename": lambda: os.rename(other / "own", other / "else"), "link": lambda: (other / "link").symlink_to("own"),
    "move out": lambda: os.rename(served / "forecast" / "map.png", other / "map.png"),
    "through a link": lambda: (served / "out").write_text("x"),
}
print([name for name, act in acts.items() if not fails(act)])
"""


@needs
def test_nothing_outside_the_served_folder_is_written(
    inside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not even into a folder that may be read: results go into the served one."""
    allowed = inside.parent / "allowed"
    allowed.mkdir()
    (allowed / "own").write_text("own", encoding="utf-8")
    (inside / "out").symlink_to(allowed / "own")
    monkeypatch.setenv(
        fence.NAME, fence.fence_text(fence.Fence((inside, allowed), writable=(inside,)))
    )
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    (inside.parent / "scratch").mkdir()
    one = subprocess.run(
        [sys.executable, "-c", WRITE, str(inside), str(allowed)],
        cwd=inside.parent / "scratch",
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert one.stdout + one.stderr == "[]\n"
    assert [path.name for path in allowed.iterdir()] == ["own"]
    assert (allowed / "own").read_text(encoding="utf-8") == "own"
    assert (inside / "forecast" / "map.png").read_text(encoding="utf-8") == "shorter"


def test_the_home_folder_is_not_opened_for_a_module(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """`python -m drift serve` looks for modules where it was started; that may be the home folder,
    or that served.
    """
    served = tmp_path / "at" / "served"
    monkeypatch.setattr(
        sys,
        "path",
        [str(tmp_path / "at"), str(served), str(Path.home()), "/", "", str(tmp_path / "modules")],
    )
    own = set(landlock._own([served]))
    assert tmp_path / "modules" in own
    assert not own & {tmp_path / "at", served, Path.home(), Path("/")}


def test_a_system_without(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of the first version, which could rename nothing, no use is made; the fence of names remains."""
    monkeypatch.setattr(landlock, "_call", lambda *_: 1)
    assert landlock.version() == 0
    assert not landlock.enclose([tmp_path])

    def refuse(*_: object) -> int:
        raise OSError

    monkeypatch.setattr(landlock, "_call", refuse)
    assert not landlock.enclose([tmp_path])


CARDS = """
import sys
from drift.apps.cli import tethered
tethered.enclose(cards=True)
from kernels.runtime import drivers
print(drivers.ask("vulkan").devices == (), end=" ")
try:
    open(sys.argv[1]).read()
except PermissionError:
    print("held")
"""


@needs
def test_graphics_cards_are_still_listed_and_other_files_are_not_read(
    inside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a command may use cards; here the software device of Vulkan stands in for one."""
    from kernels.runtime import drivers

    none = drivers.ask("vulkan").devices == ()
    assert (
        done(CARDS, str(inside.parent / "secret.nc"), folder=inside, monkeypatch=monkeypatch)
        == f"{none} held\n"
    )
