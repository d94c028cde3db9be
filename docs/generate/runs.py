"""Runs of the shipped cases, and of three small ones, that the gallery shows and from which the
reference of files is made.

Each is the command that its page shows, in a process of its own. A run is kept between builds until
its case, or drift, changes; where the environment variable DRIFT_DOCS_KEEP is set, for good: for
those who write pages.
"""

import csv
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from drift.case import file as case_file

ROOT = Path(__file__).parents[2]
SMALL = tuple(
    Path(__file__).with_name(f"{name}.toml") for name in ("small", "small_spill", "small_arrays")
)
DRIFTERS = "drifters.csv"  # made up: two that go straight on
RESULTS = "results"  # apart from the cases, lest a folder bear the name of one
AT_ONCE = 2  # processes
PARTICLES = 20_000  # a build is to take minutes
SPILL = {"spill.worlds": "1000", "spill.per_world": "60", "spill.redraws": "2"}


@dataclass(frozen=True)
class Run:
    """A command and the folder that it writes."""

    name: str
    words: tuple[str, ...]

    @property
    def command(self) -> str:
        """The command as one would type it."""
        return " ".join(("drift", *self.words))


def needs_data(case: str) -> bool:
    """Return whether a shipped case reads files that do not come along."""
    return "DRIFT_DATA" in (ROOT / "cases" / f"{case}.toml").read_text(encoding="utf-8")


def _of(case: str, command: str = "run") -> Run:
    spilled = "[spill]" in (ROOT / "cases" / f"{case}.toml").read_text(encoding="utf-8")
    fewer = SPILL if spilled else {"particles": str(PARTICLES)}
    changes = (word for key, value in fewer.items() for word in ("--set", f"{key}={value}"))
    return Run(case if command == "run" else f"{case}-{command}", (command, case, *changes))


def shown() -> list[str]:
    """Return the names of the shipped cases that can be run here."""
    cases = [name for name, _ in case_file.shipped()]
    return [case for case in cases if not needs_data(case) or os.environ.get("DRIFT_DATA")]


def every() -> list[Run]:
    """Return all runs, the longest first."""
    small, spill, arrays = (path.name for path in SMALL)
    return [
        _of("overdue_boat", "plan"),
        *(_of(case) for case in shown()),
        Run("small-origin", ("origin", spill)),
        Run("small-patrols", ("plan", spill)),
        Run("small-arrays", ("plan", arrays)),
        Run("small-run", ("run", small)),
        Run("small-compare", ("compare", small, "--set-b", "wind.0.constant.speed=25 kn")),
        Run("small-budget", ("budget", small, "--particles", "4000")),
        Run(
            "small-verify",
            (
                "verify",
                small,
                "--drifters",
                DRIFTERS,
                "--every",
                "6 h",
                "--hours",
                "12",
                "--particles",
                "500",
            ),
        ),
    ]


def results(folder: Path) -> dict[str, Path]:
    """Return the folders of the results by the names of their runs."""
    return {one.name: folder / RESULTS / one.name for one in every()}


def make(docs: Path, folder: Path) -> Iterator[tuple[str, int]]:
    """Run what is not there, or older than what it is made from.

    Yields:
        what has been run last ("" at first), and how many runs are still to end.
    """
    (folder / RESULTS).mkdir(parents=True, exist_ok=True)
    for case in SMALL:
        (folder / case.name).write_bytes(case.read_bytes())
    _drifters(folder / DRIFTERS)
    sources = [
        path
        for room in ("drift", "geo", "kernels", "cases")
        for path in (ROOT / room).rglob("*.*")
        if path.suffix != ".pyc"
    ]
    newest = max(path.stat().st_mtime for path in [*sources, *SMALL, Path(__file__)])
    tutorials = [
        (page, folder.parent / "tutorials" / page.stem)
        for page in sorted((docs / "tutorials").glob("*.md"))
    ]
    with ThreadPoolExecutor(AT_ONCE) as pool:
        jobs = {
            pool.submit(_tutorial, page, place): f"tutorial {page.stem}"
            for page, place in tutorials
            if not _stands(place / "examples.txt", max(newest, page.stat().st_mtime))
        }
        jobs |= {
            pool.submit(_run, one, folder): one.command
            for one in every()
            if not _stands(_printed(one, folder), newest)
        }
        yield "", len(jobs)
        for number, job in enumerate(as_completed(jobs), start=1):
            job.result()
            yield jobs[job], len(jobs) - number


def _printed(one: Run, folder: Path) -> Path:
    """Return the file of what a run has printed, which is written last."""
    return folder / RESULTS / f"{one.name}.txt"


def _run(one: Run, folder: Path) -> None:
    words = ["drift", *one.words, "--out", f"{RESULTS}/{one.name}", "--overwrite", "--threads", "1"]
    _printed(one, folder).write_text(_call(one.command, words, folder), encoding="utf-8")


def _tutorial(page: Path, folder: Path) -> None:
    """Run the examples of a tutorial, whose pictures its page shows."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    _call(page.name, ["generate.examples", str(page), str(folder)], folder)


def _stands(last: Path, newest: float) -> bool:
    return last.exists() and (
        last.stat().st_mtime > newest or bool(os.environ.get("DRIFT_DOCS_KEEP"))
    )


def _call(name: str, words: list[str], folder: Path) -> str:
    """Run a module in a process of its own; return what it printed, or raise RuntimeError with its
    complaints.
    """
    paths = [str(ROOT), str(ROOT / "docs"), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    done = subprocess.run(
        [sys.executable, "-m", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=900,
    )
    if done.returncode:
        raise RuntimeError(f"{name}: {done.stderr[-4000:]}")
    return done.stdout


def _drifters(path: Path) -> None:
    """Write the tracks of two drifters that go to the north-east at 0.3 m/s, a fix an hour."""
    rows = [["id", "time", "lon", "lat"]]
    for drifter, (lon, lat) in {"A": (-90.0, 27.0), "B": (-89.6, 26.8)}.items():
        for hour in range(37):
            time = datetime(2026, 11, 21, 18) + timedelta(hours=hour)
            rows.append(
                [
                    drifter,
                    f"{time.isoformat()}Z",
                    f"{lon + 0.0077 * hour:.5f}",
                    f"{lat + 0.0069 * hour:.5f}",
                ]
            )
    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
