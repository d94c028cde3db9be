"""The types of the page's scripts, by the TypeScript compiler."""

import os
import subprocess
import sys
from importlib import resources
from pathlib import Path

import pytest

pytestmark = pytest.mark.browser

PROJECT = Path(__file__).parents[1] / "types"


@pytest.fixture
def compiler() -> list[str]:
    """The compiler on the page's scripts; where it is absent CI fails and others skip."""
    program = PROJECT / "node_modules" / ".bin" / ("tsc.cmd" if sys.platform == "win32" else "tsc")
    if not program.exists() and not os.environ.get("CI"):
        pytest.skip("no TypeScript: npm ci --prefix tests/apps/serve/types")
    return [str(program), "--project", str(PROJECT)]


def test_the_types_of_the_scripts_agree(compiler: list[str]) -> None:
    done = subprocess.run(compiler, capture_output=True, text=True, timeout=120)
    assert done.stdout == ""
    assert done.returncode == 0


def test_all_scripts_are_read(compiler: list[str]) -> None:
    done = subprocess.run([*compiler, "--listFilesOnly"], capture_output=True, text=True, timeout=120)  # fmt: skip
    read = {Path(line).name for line in done.stdout.splitlines()}
    scripts = resources.files("drift.apps.serve").joinpath("assets").iterdir()
    assert {one.name for one in scripts if one.name.endswith(".js")} <= read
