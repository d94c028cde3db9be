"""What importing the kernels prints: nothing, also where standard output is a notebook's."""

import subprocess
import sys

from places import ROOT

WRAPPED = "import io, sys; sys.stdout = io.StringIO(); from kernels.runtime import runtime; sys.__stdout__.write(sys.stdout.getvalue())"


def test_nothing_is_said_where_standard_output_is_wrapped() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WRAPPED],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert done.stdout == done.stderr == ""
