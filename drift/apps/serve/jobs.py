"""Jobs of the desk: each command runs in its own process, one at a time, checks beside runs.

A crash or a cancelled run cannot harm the server, and a process can only open what its fence allows
(`geo.files.fence`). Each process watches its standard input, which closes when the server ends in
whatever way, so that no job outlives the server.
"""

import asyncio
import contextlib
import json
import os
import signal
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drift.apps.serve import names, shelf
from geo.files import fence

KINDS = {
    "check": None,
    "run": "forecast",
    "plan": "plan",
    "origin": "origin",
}  # commands on a case, and the suffix of their result folders
# of `drift fetch`: how much it would download, and the download
FETCHES = {"size": None, "fetch": "forcing"}
QUICK = frozenset({"check", "size"})  # they have a queue of their own, and are not logged
START = "from drift.apps.cli import tethered; tethered.main"
MARK = "\x1e"  # begins a line of progress
MOST_WAITING = 20
MOST_KEPT = 30  # jobs that are listed
MOST_LINES = 400  # last lines of a log that are kept
LONGEST_LINE = 1200  # characters
GIB = 2**30  # [bytes]
GRACE = 10.0  # [s] from terminating a process to killing it

# signals that do not point to a lack of memory
CRASHES = ("SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE")

Lane = asyncio.Queue["Job"]


@dataclass(frozen=True)
class Limits:
    """The limits of a job, and the backend of its particles."""

    hours: float = 12.0
    memory: float = float("inf")  # [GiB] of each of its processes
    backend: str = "cpu"


@dataclass(frozen=True)
class Download:
    """The options of a `drift fetch`, and what its process may read, ask and write."""

    arguments: tuple[str, ...]
    fence: fence.Fence


@dataclass
class Job:
    """A command on a case, or a download for one; state is waiting, running, done, failed or cancelled."""

    number: int
    kind: str
    case: str
    digest: str  # of the case when the job was requested
    user: str = ""  # who requested it
    state: str = "waiting"
    out: str | None = None  # name of the folder of its results
    phase: str = ""
    share: float = 0.0
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=MOST_LINES))
    started: float | None = None
    took: float | None = None  # [s]
    process: asyncio.subprocess.Process | None = None
    download: Download | None = None

    @property
    def over(self) -> bool:
        """Whether the job has ended."""
        return self.state in {"done", "failed", "cancelled"}

    def summary(self) -> dict[str, Any]:
        """Return what the page shows of the job."""
        took = (
            time.monotonic() - self.started
            if self.took is None and self.started is not None
            else self.took
        )
        return {
            "number": self.number,
            "kind": self.kind,
            "case": self.case,
            "digest": self.digest,
            "user": self.user,
            "state": self.state,
            "out": self.out,
            "phase": self.phase,
            "share": self.share,
            "took": took,
            "lines": list(self.lines),
        }


class Jobs:
    """All jobs of a server, in two queues: checks and sizes, and everything else."""

    def __init__(
        self,
        folder: Path,
        allowed: fence.Fence,
        limits: Limits,
        ended: Callable[[Job], None] = lambda job: None,
    ) -> None:
        self._folder, self._fence, self._limits = folder, allowed, limits
        self._ended = ended  # called when a job that was started has ended
        self._jobs: dict[int, Job] = {}
        self._lanes: dict[bool, Lane] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._closing = False

    async def open(self) -> None:
        """Start the tasks that work on the queues."""
        self._lanes = {True: asyncio.Queue(), False: asyncio.Queue()}
        self._tasks = [asyncio.create_task(self._work(lane)) for lane in self._lanes.values()]

    async def close(self) -> None:
        """Cancel all jobs and end their processes."""
        self._closing = True
        for job in self._jobs.values():
            await self.cancel(job)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def all(self) -> list[Job]:
        """Return the jobs, the newest first."""
        return list(reversed(self._jobs.values()))

    def get(self, number: int) -> Job | None:
        """Return a job by number; None if there is none."""
        return self._jobs.get(number)

    def add(
        self, kind: str, case: str, digest: str, user: str = "", download: Download | None = None
    ) -> Job | None:
        """Add a job to its queue; return None if too many wait."""
        if sum(job.state == "waiting" for job in self._jobs.values()) >= MOST_WAITING:
            return None
        number = max(self._jobs, default=0) + 1
        job = Job(number, kind, case, digest, user, download=download)
        self._jobs[job.number] = job
        for old in [number for number, one in self._jobs.items() if one.over][
            : max(len(self._jobs) - MOST_KEPT, 0)
        ]:
            del self._jobs[old]
        self._lanes[kind in QUICK].put_nowait(job)
        return job

    async def cancel(self, job: Job) -> None:
        """Cancel a job: a waiting one at once, a running one within GRACE."""
        if job.over:
            return
        previous, job.state = job.state, "cancelled"
        if previous == "running" and job.process is not None:
            await _end(job.process)

    async def _work(self, lane: Lane) -> None:
        while not self._closing:
            job = await lane.get()
            if job.state != "waiting":
                continue
            job.state, job.started = "running", time.monotonic()
            try:
                status = await self._carry_out(job)
            except Exception as error:  # one job must not end its whole queue
                job.lines.append(
                    f"drift: {error.strerror if isinstance(error, OSError) else error}"
                )
                status = 1
            if job.state == "running":
                job.state = "done" if status == 0 else "failed"
            job.took, job.process = time.monotonic() - job.started, None
            self._ended(job)

    async def _carry_out(self, job: Job) -> int:
        """Run the command in a process and return its exit status."""
        arguments = self._arguments(job)
        allowed = self._fence if job.download is None else job.download.fence
        code = python_code(self._folder, self._limits, START)
        with tempfile.TemporaryDirectory(prefix="drift-desk-", ignore_cleanup_errors=True) as empty:
            job.process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-c",
                code,
                *arguments,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT,
                cwd=empty,
                env=environment(allowed, empty) | {"DRIFT_PROGRESS": "lines"},
                start_new_session=os.name == "posix",
            )
            timeout = asyncio.create_task(_end_after(job.process, self._limits.hours * 3600))
            try:
                if job.state == "cancelled":  # while the process was starting
                    await _end(job.process)
                assert job.process.stdout is not None
                await _read(job.process.stdout, lambda line: _take(job, line))
                status = await job.process.wait()
                if job.state == "running" and (why := self._fate(job, status)):
                    job.lines.append(f"drift: {why}")
                return status
            finally:
                timeout.cancel()
                if job.process.returncode is None:
                    kill(job.process)

    def _arguments(self, job: Job) -> list[str]:
        """Return the command of a job, and set the folder of its results."""
        if job.download is not None:
            arguments = ["fetch", *job.download.arguments]
            arguments += ["--dry-run"] if job.kind == "size" else []
        elif shelf.read_case(self._folder, job.case)[1] != job.digest:
            raise ValueError(
                f"{job.case} was changed after this job was requested; request it again"
            )
        else:
            arguments = [job.kind, str(self._folder / job.case)]
        if (suffix := (KINDS | FETCHES)[job.kind]) is not None:
            job.out = _unused_name(self._folder, f"{job.case.removesuffix('.toml')}-{suffix}")
            arguments += ["--out", str(self._folder / job.out)]
            if job.download is None and self._limits.backend != "cpu":
                arguments += ["--backend", self._limits.backend]
        return arguments

    def _fate(self, job: Job, status: int) -> str:
        """Return why a job ended, if the process could not report it itself; else ""."""
        assert job.started is not None
        if status == 0:
            return ""
        if time.monotonic() - job.started >= self._limits.hours * 3600:
            return f"stopped after the limit of {self._limits.hours:g} h; drift serve --hours allows more"
        if status >= 0:
            return ""
        name = (
            signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
        )
        if name in CRASHES:
            when = (
                " after its results were complete"
                if job.out and (self._folder / job.out).is_dir()
                else ""
            )
            return f"a library crashed ({name}){when}; try again; if it crashes again, report it with the case"
        limit = (
            f", which is limited to {self._limits.memory:.3g} GiB"
            if self._limits.memory < float("inf")
            else ""
        )
        return f"killed by {name}, as happens when memory runs out{limit} (drift serve --memory)"


def python_code(folder: Path, limits: Limits, start: str) -> str:
    """Return the Python code of a fenced process; start: the function that it calls.

    Python looks for modules in its start folder: that must not be the served folder, nor one that
    others can write to.
    """
    path = [place for place in sys.path if place and Path(place).resolve() != folder]
    memory = int(limits.memory * GIB) if limits.memory < float("inf") else None
    return f"import sys; sys.path[:] = {path!r}; {start}({memory!r})"


def environment(allowed: fence.Fence, empty: str) -> dict[str, str]:
    """Return the environment of a fenced process; empty: its folder for temporary files."""
    own = {fence.NAME: fence.fence_text(allowed), "TMPDIR": empty}
    return os.environ | own | {"PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8:replace"}


def _unused_name(folder: Path, name: str) -> str:
    """Return an unused name for a results folder: the page never overwrites a result."""
    stem = name[: names.LONGEST - 5].rstrip(" .")
    for k in range(1, 1000):
        if not os.path.lexists(folder / (candidate := stem if k == 1 else f"{stem}-{k}")):
            return candidate
    raise ValueError(f"there are a thousand results {stem} already; move some away")


def _take(job: Job, line: str) -> None:
    """Process a line of output: progress, or a line for the log."""
    if not line.startswith(MARK):
        job.lines.append(
            "".join(letter if letter.isprintable() else " " for letter in line)[
                :LONGEST_LINE
            ].rstrip()
        )
        return
    with contextlib.suppress(ValueError, KeyError, TypeError, OverflowError, RecursionError):
        progress = json.loads(line[1:LONGEST_LINE])
        share = float(progress["share"])
        if 0 <= share <= 1:  # neither is NaN
            job.phase, job.share = (
                "".join(letter for letter in str(progress["phase"]) if letter.isprintable())[:100],
                share,
            )


async def _read(stream: asyncio.StreamReader, take: Callable[[str], None]) -> None:
    """Pass on the lines of a stream until it ends; overlong lines are cut."""
    rest = b""
    while data := await stream.read(2**16):
        *whole, rest = (rest + data).split(b"\n")
        for line in whole:
            take(line.decode("utf-8", "replace"))
        rest = rest[:LONGEST_LINE]
    if rest:
        take(rest.decode("utf-8", "replace"))


async def _end(process: asyncio.subprocess.Process) -> None:
    """Terminate a process, so that it can clean up; kill it after GRACE."""
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        await asyncio.wait_for(process.wait(), GRACE)
    except TimeoutError:
        kill(process)


async def _end_after(process: asyncio.subprocess.Process, seconds: float) -> None:
    """End a process after a time limit."""
    await asyncio.sleep(seconds)
    await _end(process)


def kill(process: asyncio.subprocess.Process) -> None:
    """Kill a process and all that it started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)  # it leads its own process group
        else:
            process.kill()
