"""A process whose Taichi has one thread: the tests have two, and a process keeps the number with
which it started.

One such process does what all tests of a worker ask of it: to start it takes as long as what it is
asked for.
"""

import json
import subprocess
import sys
import tempfile
from typing import Any

from places import HELPERS, ROOT

SERVER = """
import json, os, sys, traceback
sys.path[:0] = sys.argv[1:]
answers, sys.stdout = os.fdopen(os.dup(1), "w"), sys.stderr
os.dup2(2, 1)
from kernels.runtime import runtime
runtime.start("cpu", threads=1)
for line in sys.stdin:
    asked = json.loads(line)
    names = {"given": asked["given"], "answer": None}
    try:
        exec(asked["code"], names)
        told = {"answer": names["answer"], "error": None}
    except BaseException:
        told = {"answer": None, "error": traceback.format_exc()}
    print(json.dumps(told), file=answers, flush=True)
"""


class Process:
    """The process, begun when it is first asked."""

    def __init__(self) -> None:
        self._running: subprocess.Popen[str] | None = None
        self._said = tempfile.TemporaryFile("w+")  # noqa: SIM115 - it lasts as long as the process

    def ask(self, code: str, *given: str) -> Any:
        """Run Python there, which finds `given`; return what it leaves in `answer`."""
        if self._running is None:
            self._running = subprocess.Popen(
                [sys.executable, "-c", SERVER, *map(str, [ROOT, *HELPERS])],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                text=True,
            )
        assert self._running.stdin is not None
        assert self._running.stdout is not None
        print(json.dumps({"code": code, "given": given}), file=self._running.stdin, flush=True)
        line = self._running.stdout.readline()
        if not line:
            self._said.seek(0)
            raise AssertionError(f"the process has ended: {self._said.read()}")
        told = json.loads(line)
        assert told["error"] is None, told["error"]
        return told["answer"]

    def end(self) -> None:
        """End the process."""
        if self._running is not None:
            self._running.communicate()
        self._said.close()
