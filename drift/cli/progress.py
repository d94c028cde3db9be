"""Progress of a run: a bar with rate and time left on a terminal, nothing where the output is piped.

With the environment variable DRIFT_PROGRESS=lines, which `drift serve` sets, lines of JSON for another program.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drift.case.record import Case

Report = Callable[[str, float], None]  # (what is being done, share of it that is done)


def silent(phase: str, share: float) -> None:
    """Report nothing."""


def lines() -> Report:
    """Return a function that writes progress on standard error, a line each: a mark (RS) and JSON, five a second."""
    last = ("", 0.0)

    def report(phase: str, share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if phase != last[0] or now - last[1] >= 0.2:
            last = (phase, now)
            print(f"\x1e{json.dumps({'phase': phase, 'share': share})}", file=sys.stderr, flush=True)

    return report


@contextmanager
def shown(case: Case | None = None, *, quiet: bool = False) -> Iterator[Report]:
    """Give a function that shows progress, of a case with its rate, on standard error, unless it is to be quiet."""
    if os.environ.get("DRIFT_PROGRESS") == "lines":
        yield lines()
        return
    if quiet or not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    hours = 0.0 if case is None else abs((case.end - case.start).astype(int)) / 3600
    bar = Progress(
        TextColumn("{task.description:<12}"),
        BarColumn(),
        TextColumn("{task.fields[rate]:>14}"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    tasks: dict[str, TaskID] = {}

    def report(phase: str, share: float) -> None:
        if phase not in tasks:
            for done in tasks.values():
                bar.update(done, completed=1.0, visible=False)
            tasks[phase] = bar.add_task(phase, total=None, rate="")  # a pulse until a share is known
        speed = next(task.speed for task in bar.tasks if task.id == tasks[phase])
        rate = f"{speed * hours:.1f} h/s" if speed and phase.endswith("drift") else ""
        if share > 0:
            bar.update(tasks[phase], total=1.0, completed=share, rate=rate)

    with bar:
        yield report
