"""Every benchmark still runs: each in its smallest mode, in a process of its own, as a reader of
the README starts it.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import DATA, ROOT

pytestmark = pytest.mark.benchmarks
FOLDER = ROOT / "benchmarks"
FILES = sorted(FOLDER.glob("*.py"))
SCRIPTS = [path.stem for path in FILES if "__main__" in path.read_text(encoding="utf-8")]
# [s] with nothing compiled, and others at work: it hangs. Compiled, and at rest, none takes 20.
LIMIT = 250


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_smallest_mode_runs_and_prints(name: str, tmp_path: Path) -> None:
    """What the machine lacks is a line that it prints, no failure."""
    done = subprocess.run(
        [sys.executable, FOLDER / f"{name}.py", "--smallest"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT), "DRIFT_DATA": str(DATA)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=LIMIT,
    )  # fmt: skip
    print(done.stdout)
    assert done.returncode == 0
    assert done.stdout.strip()
    assert "Traceback (most recent call last)" not in done.stdout
    assert not list(tmp_path.iterdir()), "it leaves files where it was started"


@pytest.mark.parametrize("name", sorted({path.stem for path in FILES} - set(SCRIPTS)))
def test_what_does_not_start_is_used(name: str) -> None:
    """A file that no test starts is a part of one that is."""
    users = [
        path
        for path in FILES
        if path.stem != name and f"import {name}" in path.read_text(encoding="utf-8")
    ]
    users += [path for path in FILES if f"from {name} import" in path.read_text(encoding="utf-8")]
    assert users
