"""Work on cases: each in a process of its own, one at a time, checks beside runs; none outlives the
server.

So a crash or a cancelled run costs the server nothing, and what the case may open is bounded in
that process (`geo.files.fence`). The process watches its standard input, which ends when this one
does, however it ends.
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
}  # commands, and what their folders are called
START = "from drift.apps.cli import tethered; tethered.main"
MARK = "\x1e"  # begins a line that tells progress
MOST_WAITING = 20
MOST_KEPT = 30  # jobs that are remembered
MOST_LINES = 400  # of a log, the last ones
LONGEST_LINE = 1200  # letters
GIB = 2**30  # [bytes]
GRACE = 10.0  # [s] from asking a process to end to ending it by force

# these have other reasons than a lack of memory
CRASHES = ("SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE")

Lane = asyncio.Queue["Job"]


@dataclass(frozen=True)
class Limits:
    """The most that a job may take, and where its particles move."""

    hours: float = 12.0
    memory: float = float("inf")  # [GiB] of each of its processes
    backend: str = "cpu"


@dataclass
class Job:
    """A command on a case. state: waiting, running, done, failed or cancelled."""

    number: int
    kind: str
    case: str
    digest: str  # of the case when it was asked for
    state: str = "waiting"
    out: str | None = None  # name of the folder of its results
    phase: str = ""
    share: float = 0.0
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=MOST_LINES))
    started: float | None = None
    took: float | None = None  # [s]
    process: asyncio.subprocess.Process | None = None

    @property
    def over(self) -> bool:
        """Whether nothing more will come of it."""
        return self.state in {"done", "failed", "cancelled"}

    def told(self) -> dict[str, Any]:
        """Return what the page shows of it."""
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
            "state": self.state,
            "out": self.out,
            "phase": self.phase,
            "share": self.share,
            "took": took,
            "lines": list(self.lines),
        }


class Jobs:
    """The jobs of a server: what waits, what runs, what has ended."""

    def __init__(self, folder: Path, allowed: fence.Fence, limits: Limits) -> None:
        self._folder, self._fence, self._limits = folder, allowed, limits
        self._jobs: dict[int, Job] = {}
        self._lanes: dict[bool, Lane] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._closing = False

    async def open(self) -> None:
        """Begin to work."""
        self._lanes = {True: asyncio.Queue(), False: asyncio.Queue()}
        self._tasks = [asyncio.create_task(self._work(lane)) for lane in self._lanes.values()]

    async def close(self) -> None:
        """End all work, and every process with it."""
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
        """Return a job, None where there is none of the number."""
        return self._jobs.get(number)

    def add(self, kind: str, case: str, digest: str) -> Job | None:
        """Put a job at the end of its queue; None where too many wait."""
        if sum(job.state == "waiting" for job in self._jobs.values()) >= MOST_WAITING:
            return None
        job = Job(max(self._jobs, default=0) + 1, kind, case, digest)
        self._jobs[job.number] = job
        for old in [number for number, one in self._jobs.items() if one.over][
            : max(len(self._jobs) - MOST_KEPT, 0)
        ]:
            del self._jobs[old]
        self._lanes[kind == "check"].put_nowait(job)
        return job

    async def cancel(self, job: Job) -> None:
        """End a job: one that waits at once, one that runs within GRACE."""
        if job.over:
            return
        before, job.state = job.state, "cancelled"
        if before == "running" and job.process is not None:
            await _end(job.process)

    async def _work(self, lane: Lane) -> None:
        while not self._closing:
            job = await lane.get()
            if job.state != "waiting":
                continue
            job.state, job.started = "running", time.monotonic()
            try:
                status = await self._carry_out(job)
            except Exception as error:  # one job must not end the lane of all
                job.lines.append(
                    f"drift: {error.strerror if isinstance(error, OSError) else error}"
                )
                status = 1
            if job.state == "running":
                job.state = "done" if status == 0 else "failed"
            job.took, job.process = time.monotonic() - job.started, None

    async def _carry_out(self, job: Job) -> int:
        """Run the command in a process and return its exit status."""
        if shelf.read_case(self._folder, job.case)[1] != job.digest:
            raise ValueError(f"{job.case} was changed after this was asked for; ask again")
        given = [job.kind, str(self._folder / job.case)]
        if (what := KINDS[job.kind]) is not None:
            job.out = _free(self._folder, f"{job.case.removesuffix('.toml')}-{what}")
            given += ["--out", str(self._folder / job.out)]
            given += [] if self._limits.backend == "cpu" else ["--backend", self._limits.backend]
        # Python looks for modules where it starts: neither in the served folder, nor in any that
        # others can write.
        path = [place for place in sys.path if place and Path(place).resolve() != self._folder]
        memory = int(self._limits.memory * GIB) if self._limits.memory < float("inf") else None
        code = f"import sys; sys.path[:] = {path!r}; {START}({memory!r})"
        with tempfile.TemporaryDirectory(prefix="drift-desk-", ignore_cleanup_errors=True) as empty:
            job.process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-c",
                code,
                *given,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT,
                cwd=empty,
                env=self._environment(empty),
                start_new_session=os.name == "posix",
            )
            overdue = asyncio.create_task(_end_after(job.process, self._limits.hours * 3600))
            try:
                if job.state == "cancelled":  # while it was started
                    await _end(job.process)
                assert job.process.stdout is not None
                await _read(job.process.stdout, lambda line: _take(job, line))
                status = await job.process.wait()
                if job.state == "running" and (why := self._fate(job, status)):
                    job.lines.append(f"drift: {why}")
                return status
            finally:
                overdue.cancel()
                if job.process.returncode is None:
                    _kill(job.process)

    def _fate(self, job: Job, status: int) -> str:
        """Return why a job ended, where it could not say it itself; "" where it could."""
        assert job.started is not None
        if status == 0:
            return ""
        if time.monotonic() - job.started >= self._limits.hours * 3600:
            return f"ended, as it took more than {self._limits.hours:g} h; drift serve --hours allows more"
        if status >= 0:
            return ""
        name = (
            signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
        )
        if name in CRASHES:
            whole = (
                " after its results were complete"
                if job.out and (self._folder / job.out).is_dir()
                else ""
            )
            return f"a library crashed ({name}){whole}; try again; if it crashes again, report it with the case"
        most = (
            f", which is limited to {self._limits.memory:.3g} GiB"
            if self._limits.memory < float("inf")
            else ""
        )
        return f"ended by {name}, as happens when memory runs out{most} (drift serve --memory)"

    def _environment(self, empty: str) -> dict[str, str]:
        own = {
            fence.NAME: fence.fence_text(self._fence),
            "DRIFT_PROGRESS": "lines",
            "TMPDIR": empty,
        }
        return os.environ | own | {"PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8:replace"}


def _free(folder: Path, name: str) -> str:
    """Return a name for a folder of results that nothing has yet: no result is overwritten from the
    page.
    """
    stem = name[: names.LONGEST - 5].rstrip(" .")
    for k in range(1, 1000):
        if not os.path.lexists(folder / (free := stem if k == 1 else f"{stem}-{k}")):
            return free
    raise ValueError(f"there are a thousand results {stem} already; move some away")


def _take(job: Job, line: str) -> None:
    """Take in a line of a process: progress, or one for the log."""
    if not line.startswith(MARK):
        job.lines.append(
            "".join(letter if letter.isprintable() else " " for letter in line)[
                :LONGEST_LINE
            ].rstrip()
        )
        return
    with contextlib.suppress(ValueError, KeyError, TypeError, OverflowError, RecursionError):
        told = json.loads(line[1:LONGEST_LINE])
        share = float(told["share"])
        if 0 <= share <= 1:  # neither is NaN
            job.phase, job.share = (
                "".join(letter for letter in str(told["phase"]) if letter.isprintable())[:100],
                share,
            )


async def _read(stream: asyncio.StreamReader, take: Callable[[str], None]) -> None:
    """Hand on the lines of a stream until it ends, of an endless one the beginning."""
    rest = b""
    while data := await stream.read(2**16):
        *whole, rest = (rest + data).split(b"\n")
        for line in whole:
            take(line.decode("utf-8", "replace"))
        rest = rest[:LONGEST_LINE]
    if rest:
        take(rest.decode("utf-8", "replace"))


async def _end(process: asyncio.subprocess.Process) -> None:
    """Ask a process to end, so that it leaves nothing half written; end it by force where it does
    not.
    """
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        await asyncio.wait_for(process.wait(), GRACE)
    except TimeoutError:
        _kill(process)


async def _end_after(process: asyncio.subprocess.Process, seconds: float) -> None:
    """End a process that takes too long."""
    await asyncio.sleep(seconds)
    await _end(process)


def _kill(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)  # it leads a group of its own
        else:
            process.kill()
