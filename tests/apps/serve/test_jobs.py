"""Jobs of drift serve: what they may read, their progress, and their end."""

import asyncio
import http.client
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import hostile_netcdf
import pytest
import small_case
from desks import NASTY, Server, finished, until
from places import ROOT

from drift.apps.serve import jobs, shelf
from geo.files import fence, landlock

# minutes of work, to be cancelled
LONG = 'particles = 200000\nduration = "240 h"\nclock.step = "60 s"'
SLOW = small_case.STEADY.replace("particles = 500", "").replace('duration = "6 h"', LONG)


def ask_for(served: Server, kind: str, name: str, text: str) -> Any:
    digest = served.json("POST", f"/api/cases/{name}", {"text": text, "digest": None})["digest"]
    return served.json("POST", "/api/jobs", {"kind": kind, "case": name, "digest": digest})[
        "number"
    ]


def over(served: Server, number: int) -> Any:
    return until(
        lambda: (job := served.job(number))["state"] in ("done", "failed", "cancelled") and job, 120
    )


OUTSIDE = ("/etc/passwd", "../secret.toml", "/etc/*", "*/../../*.toml", "linked/summary.json", "link.toml", "http://169.254.169.254/x", "file:///etc/passwd", "${HOME}/x.nc")  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [pytest.param("check", marks=pytest.mark.thorough), "run"])
def test_a_case_reads_nothing_outside(served: Server, kind: str) -> None:
    """Every way of naming it is refused, a line each, where files are opened: in the process of the
    job.
    """
    sources = "".join(
        f"[[current]]\nname = 'c{k}'\nfiles = '{written}'\n" for k, written in enumerate(OUTSIDE)
    )
    text = small_case.STEADY.replace("[[wind]]", f"{sources}[[wind]]").replace('coast.source = "none"', 'coast.source = "/etc/passwd"\ncoast.lakes = "link.toml"')  # fmt: skip
    job = over(served, ask_for(served, kind, f"out-{kind}.toml", text))
    told = "\n".join(job["lines"])
    assert job["state"] == "failed"
    for k in range(len(OUTSIDE)):
        line = next(line for line in job["lines"] if f'current "c{k}"' in line)
        assert "outside the folders" in line or "may not be" in line
    assert os.environ["HOME"] not in told
    assert "root:" not in told
    assert not (served.folder / f"out-{kind}-forecast").exists()


@pytest.mark.thorough
def test_a_shoreline_outside_is_refused_too(served: Server) -> None:
    text = small_case.STEADY.replace('coast.source = "none"', 'coast.source = "../secret.toml"')
    job = over(served, ask_for(served, "check", "shore.toml", text))
    assert job["state"] == "failed"
    assert "outside the folders" in "\n".join(job["lines"])


@pytest.mark.skipif(not landlock.version(), reason="this system has no Landlock")
@pytest.mark.thorough
def test_no_current_is_taken_from_a_file_that_a_file_names(served: Server) -> None:
    """A netCDF-4 file in the folder with its values in one outside: the kernel refuses the job what
    the library asks for.
    """
    hostile_netcdf.secret(served.folder.parent / "values.bin", "storage")
    hostile_netcdf.write(
        served.folder / "current.nc", "storage", served.folder.parent / "values.bin"
    )
    job = over(served, ask_for(served, "check", "hostile.toml", small_case.CASE))
    assert job["state"] == "failed"
    assert "cannot read slice 0 of uo (NetCDF: HDF error)" in job["lines"][-1]


@pytest.mark.thorough
def test_a_run_tells_progress_and_ends_in_a_report(
    served: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No file is overwritten, and no module in the folder is imported.

    A numpy.py among the cases would run as the user, also where the server was started there by
    `python -m drift`.
    """
    monkeypatch.syspath_prepend(str(served.folder))
    (served.folder / "numpy.py").write_text("raise SystemExit('owned')", encoding="utf-8")
    finished(served.folder / "good-forecast")
    job = over(
        served,
        ask_for(served, "run", "good.toml", small_case.STEADY.replace('"trial"', f'"{NASTY}"')),
    )
    (served.folder / "numpy.py").unlink()
    assert (job["state"], job["out"]) == ("done", "good-forecast-2"), "\n".join(job["lines"])
    assert job["phase"]  # it did tell
    status, _, data = served.ask(
        "GET", f"/runs/good-forecast-2/{job['key']}/report.html", Cookie=None
    )
    assert (status, b"Content-Security-Policy" in data) == (200, True)
    assert NASTY.encode() not in data
    told = served.json("GET", "/api/folder")["runs"]
    assert next(run for run in told if run["name"] == "good-forecast-2")["kind"] == "forecast"


def test_a_case_changed_after_it_was_asked_for_does_not_run(served: Server) -> None:
    digest = served.json(
        "POST", "/api/cases/later.toml", {"text": small_case.STEADY, "digest": None}
    )["digest"]
    (served.folder / "later.toml").write_text("title = 1", encoding="utf-8")
    job = over(
        served,
        served.json("POST", "/api/jobs", {"kind": "run", "case": "later.toml", "digest": digest})[
            "number"
        ],
    )
    assert (job["state"], "was changed after" in job["lines"][-1]) == ("failed", True)


@pytest.mark.thorough
def test_one_run_at_a_time_and_a_cancelled_one_leaves_nothing(served: Server) -> None:
    first = ask_for(served, "run", "slow.toml", SLOW)
    second = ask_for(served, "run", "second.toml", small_case.STEADY)
    checked = ask_for(served, "check", "third.toml", small_case.STEADY)
    until(lambda: served.job(first)["phase"] == "drift", 120)
    assert served.job(second)["state"] == "waiting"
    assert over(served, checked)["state"] == "done"  # a check need not wait
    assert served.job(first)["state"] == "running"
    assert served.json("POST", f"/api/jobs/{first}/cancel", {})["state"] == "cancelled"
    assert over(served, second)["state"] == "done"
    assert not (served.folder / "slow-forecast").exists()
    assert not [
        path.name
        for path in served.folder.iterdir()
        if path.name.startswith(".") and path.name != ".hidden.toml"
    ]


def ended(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    does: str,
    limits: jobs.Limits,
    cancel: str = "",
    kind: str = "check",
) -> jobs.Job:
    """Return a job, once it is over, whose process does something else; cancel: a line of its log
    upon which it is.
    """

    async def carried_out() -> jobs.Job:
        waiting = jobs.Jobs(folder, fence.Fence((folder,)), limits)
        await waiting.open()
        job = waiting.add(kind, "case.toml", shelf.read_case(folder, "case.toml")[1])
        assert job is not None
        for _ in range(300):
            if job.over:
                break
            if cancel and any(line.startswith(cancel) for line in job.lines):
                await waiting.cancel(job)
            await asyncio.sleep(0.05)
        await waiting.close()
        return job

    monkeypatch.setattr(jobs, "START", does)
    (folder / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    return asyncio.run(carried_out())


def test_a_job_works_in_an_empty_folder_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where Python and libraries look for files of theirs there are none that a case's owner has
    put there.
    """
    tells = "import os, tempfile; print(os.getcwd(), os.listdir(), tempfile.gettempdir()); (lambda memory: None)"
    job = ended(tmp_path, monkeypatch, tells, jobs.Limits())
    place, listed, scratch = job.lines[0].split()
    assert (job.state, listed, scratch) == ("done", "[]", place)
    assert not Path(place).is_relative_to(tmp_path)
    assert not Path(place).is_relative_to(Path.cwd())
    assert not Path(place).exists()  # any more


@pytest.mark.parametrize(
    ("kind", "backend", "given"),
    [("run", "auto", True), ("run", "cpu", False), ("check", "auto", False)],
)
def test_a_job_is_given_the_backend_that_is_served(
    kind: str, backend: str, given: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tells = "import sys; print(' '.join(sys.argv[1:])); (lambda memory: None)"
    job = ended(tmp_path, monkeypatch, tells, jobs.Limits(backend=backend), kind=kind)
    assert job.lines[0].endswith("--backend auto") == given
    assert ("--backend" in job.lines[0]) == given


def test_the_processes_of_a_job_end_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By force where they do not end by themselves, also those that the job's process started."""
    deaf = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); import time"
    starts = f"import sys, subprocess; print('pid', subprocess.Popen([sys.executable, '-c', '{deaf}; time.sleep(60)']).pid)"
    monkeypatch.setattr(jobs, "GRACE", 1.0)
    job = ended(
        tmp_path,
        monkeypatch,
        f"{deaf}; {starts}; time.sleep(60); (lambda memory: None)",
        jobs.Limits(),
        "pid",
    )
    assert job.state == "cancelled"
    until(lambda: not _runs(int(job.lines[0].split()[1])), 10)


def _runs(process: int) -> bool:
    """Whether a process is there, and not only waits for its end to be taken note of."""
    told = Path(f"/proc/{process}/stat")
    try:
        os.kill(process, 0)
        return not told.exists() or told.read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


FATES = {  # what a process does, and what its log ends with
    "it takes too long": ("import time; time.sleep(60); (lambda memory: None)", "after the limit of 0.0005 h; drift serve --hours"),
    "a library crashes": ("import os; os.kill(os.getpid(), 11); (lambda memory: None)", "a library crashed (SIGSEGV); try"),
    "it is killed": ("import os; os.kill(os.getpid(), 9); (lambda memory: None)", "by SIGKILL, as happens when memory"),
    "it asks for too much": (
        "from drift.apps.cli import commands, tethered; commands._dispatch = lambda argv: bytearray(2**33); tethered.main",
        "not enough memory (",
    ),
    "Taichi asks for too much": (
        "from drift.apps.cli import commands, tethered; import numpy as np; from kernels.runtime import runtime; import taichi as ti; "
        "commands._dispatch = lambda argv: (runtime.start(threads=1), ti.ndarray(ti.f32, 2**30)); tethered.main",
        "not enough memory ([host_memory_pool",
    ),
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("fate", FATES)
def test_a_job_that_takes_too_much_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fate: str
) -> None:
    does, line = FATES[fate]
    most = jobs.Limits(hours=0.0005 if "long" in fate else 1.0, memory=2.0)
    monkeypatch.syspath_prepend(ROOT)
    job = ended(tmp_path, monkeypatch, does, most)
    assert job.state == "failed"
    assert line in job.lines[-1], job.lines
    assert "Traceback" not in "\n".join(job.lines)


def started(folder: Path, *options: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "drift", "serve", str(folder), "--no-browser", *options],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
    )  # fmt: skip


def children() -> dict[int, int]:
    """Return the parent of each process."""
    found = {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            found[int(place.name)] = int((place / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    return found


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are not listed here")
@pytest.mark.parametrize(
    "how", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.thorough)]
)
def test_no_run_outlives_the_server(tmp_path: Path, how: signal.Signals) -> None:
    (tmp_path / "slow.toml").write_text(SLOW, encoding="utf-8")
    with started(tmp_path) as process:
        assert process.stdout is not None
        shown = [process.stdout.readline() for _ in range(3)]
        token = shown[1].split("token=")[1].strip()
        port = int(shown[1].split("/?")[0].rpartition(":")[2])
        line = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        line.request("GET", f"/?token={token}")
        answer = line.getresponse()
        answer.read()
        own = {"Cookie": answer.headers["Set-Cookie"].split(";")[0], "Origin": f"http://127.0.0.1:{port}", "Content-Type": "application/json"}  # fmt: skip
        body = {"kind": "run", "case": "slow.toml", "digest": shelf.digest(SLOW.encode())}
        line.request("POST", "/api/jobs", json.dumps(body), own)
        assert line.getresponse().read()
        run = until(
            lambda: [child for child, parent in children().items() if parent == process.pid], 30
        )
        time.sleep(3.0)  # into its imports, or further
        process.send_signal(how)
        process.wait(30)
        line.close()
    until(lambda: not any(Path(f"/proc/{pid}").exists() and "Z" not in Path(f"/proc/{pid}/stat").read_text().split()[2] for pid in run), 25)  # fmt: skip
    assert not (tmp_path / "slow-forecast").exists()


def test_a_job_that_tells_nothing_ends_with_the_server_too() -> None:
    """One that tells progress meets a closed pipe; one that waits for a file or an address would go
    on.
    """
    silent = "import time; from drift.apps.cli import commands, tethered; commands.leave = lambda: time.sleep(60); tethered.main()"
    with subprocess.Popen(
        [sys.executable, "-c", silent], stdin=subprocess.PIPE, cwd=ROOT
    ) as process:
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(2)  # it goes on as long as its input does
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(20) in (-signal.SIGTERM, 128 + signal.SIGTERM)
