"""Where compiled kernels cannot be kept: a line, and the process ends well.

The folder of the cache lies below a file, which no user can make, the superuser neither.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from places import ROOT

from kernels.runtime import runtime

LAUNCH = """
import numpy as np
import taichi as ti
from kernels.runtime import runtime

@ti.kernel
def double(values: ti.types.ndarray()):
    for i in values:
        values[i] *= 2

runtime.start(threads=1)
held = runtime.upload(np.full(3, 1.5, np.float32))
double(held)
print(held.to_numpy())
"""


def launched(
    folder: Path, code: str = LAUNCH, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Return what a process does that starts Taichi and launches a kernel."""
    (folder / "launch.py").write_text(code, encoding="utf-8")
    own = {name: value for name, value in os.environ.items() if name != "XDG_CACHE_HOME"}
    return subprocess.run(
        [sys.executable, "launch.py"],
        cwd=folder,
        env=own | {"PYTHONPATH": str(ROOT)} | environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.mark.thorough
@pytest.mark.parametrize("named", [False, pytest.param(True, marks=pytest.mark.thorough)])
def test_a_cache_that_cannot_be_written_costs_a_line(tmp_path: Path, named: bool) -> None:
    """Of the home, and of the variable; the remedy that the line names works."""
    (tmp_path / "file").write_text("", encoding="utf-8")
    place = tmp_path / "file" / ".cache"
    done = launched(
        tmp_path,
        **({"TI_OFFLINE_CACHE_FILE_PATH": str(place)} if named else {"HOME": str(place.parent)}),
    )
    assert (done.returncode, done.stdout) == (0, "[3. 3. 3.]\n")
    assert done.stderr.count("\n") == 1
    assert f"cache {place}" in done.stderr
    mended = launched(
        tmp_path, HOME=str(tmp_path / "file"), TI_OFFLINE_CACHE_FILE_PATH=str(tmp_path / "kept")
    )
    assert (mended.returncode, mended.stdout, mended.stderr) == (0, "[3. 3. 3.]\n", "")
    assert list((tmp_path / "kept").glob("*.tic"))


@pytest.mark.thorough
def test_a_lock_of_a_killed_process_does_not_close_the_cache(tmp_path: Path) -> None:
    """Taichi itself, with a lock that no process holds, keeps no kernel."""
    kept = tmp_path / "kept"
    kept.mkdir()
    lock = kept / "ticache.lock"
    lock.touch()
    named = {"TI_OFFLINE_CACHE_FILE_PATH": str(kept)}
    assert launched(tmp_path, **named).stdout == "[3. 3. 3.]\n"
    assert [file.name for file in kept.iterdir()] == ["ticache.lock"]
    os.utime(lock, (lock.stat().st_mtime - 301,) * 2)
    assert launched(tmp_path, **named).stdout == "[3. 3. 3.]\n"
    assert list(kept.glob("*.tic"))
    assert not lock.exists()


@pytest.mark.thorough
def test_a_process_that_skips_its_shutdown_keeps_its_kernels(tmp_path: Path) -> None:
    """Only Taichi's own end writes them otherwise; what `atexit` is to do is done as well."""
    code = LAUNCH + "\nimport atexit, sys\natexit.register(print, 'at exit')\n"
    code += "from drift.apps.cli import commands\ncommands.main = lambda: 3\ncommands.leave()\n"
    done = launched(tmp_path, code, TI_OFFLINE_CACHE_FILE_PATH=str(tmp_path / "kept"))
    assert (done.returncode, done.stdout, done.stderr) == (3, "[3. 3. 3.]\nat exit\n", "")
    assert list((tmp_path / "kept").glob("*.tic"))
    assert list((tmp_path / "kept").glob("*.tcb"))


@pytest.mark.parametrize(("age", "stays"), [(290, True), (310, False)])
def test_only_a_lock_of_minutes_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, age: int, stays: bool
) -> None:
    """A lock of moments may be held by another process that writes its kernels."""
    lock = tmp_path / "ticache.lock"
    lock.touch()
    os.utime(lock, (time.time() - age,) * 2)
    monkeypatch.setenv(runtime.NAMED, str(tmp_path))
    assert runtime._caching()["offline_cache"]
    assert lock.exists() == stays


@pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
def test_too_little_memory_to_start_is_told_and_the_remedy_helps(tmp_path: Path) -> None:
    """The line does not advise the backend that has just failed; with the limit that it names the
    backend starts.
    """
    code = "import sys, resource; resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2); sys.argv[:] = ['launch.py']; "
    code += "exec(compile(open('launch.py').read(), 'launch.py', 'exec'))"
    (tmp_path / "launch.py").write_text(LAUNCH, encoding="utf-8")
    done = [
        subprocess.run(
            [sys.executable, "-c", code, str(limit)],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            timeout=120,
        )
        for limit in (1200 * 2**20, 3 * 2**30)
    ]
    last = done[0].stderr.strip().splitlines()[-1]
    assert "not enough memory to start the backend 'cpu'" in last
    assert "--backend cpu" not in last
    assert "it needs 2 to 3 GiB of address space: raise the limit" in last
    assert (done[1].returncode, done[1].stdout) == (0, "[3. 3. 3.]\n")
