"""Progress of a run: a bar on a terminal or in a notebook, and nothing in a pipe.

With the environment variable DRIFT_PROGRESS=lines, which `drift serve` sets, it writes lines of
JSON for another program.
"""

import html
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drift.case.record import Case

Report = Callable[[str, float], None]  # (phase, share of it that is done, 0 to 1)
OFTEN = 0.2  # [s] shortest interval between two reports of one phase


def _ignore_progress(phase: str, share: float) -> None:
    """Report nothing."""


def _throttled(report_now: Report) -> Report:
    """Return a reporter that passes on a new phase at once, a share at most 5 times a second."""
    last = ("", 0.0)

    def report(phase: str, share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if phase != last[0] or now - last[1] >= OFTEN:
            last = (phase, now)
            report_now(phase, share)

    return report


def _write_progress_line(phase: str, share: float) -> None:
    """Write progress on standard error as one line: a record separator (RS) and JSON."""
    print(f"\x1e{json.dumps({'phase': phase, 'share': share})}", file=sys.stderr, flush=True)


def _in_notebook() -> bool:
    """Return True in a Jupyter kernel, which can show HTML."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


@contextmanager
def _beneath_cell() -> Iterator[Report]:
    """Yield a function that shows progress beneath a notebook's cell, and remove it at the end."""
    from IPython.display import HTML, display

    shown = display(HTML(""), display_id=True)

    def report(phase: str, share: float) -> None:
        done = f" value='{share:.3f}'" if share > 0 else ""  # without a value the bar pulses
        shown.update(HTML(f"<progress{done}></progress> {html.escape(phase)}"))

    try:
        yield _throttled(report)
    finally:
        shown.update(HTML(""))


@contextmanager
def progress(case: Case | None = None, *, quiet: bool = False) -> Iterator[Report]:
    """Yield a function that shows progress, for the `report` argument of a job.

    Use it as `with drift.progress(case) as report:`. It shows a bar on a terminal (on standard
    error) or in a notebook, elsewhere nothing.

    Args:
        case: a case whose simulated hours per second are shown on a terminal; None: only shares.
        quiet: whether nothing is shown anywhere.

    Returns:
        A context manager that yields the function (phase, share of it that is done, 0 to 1).
    """
    if os.environ.get("DRIFT_PROGRESS") == "lines":
        yield _throttled(_write_progress_line)
        return
    if not quiet and _in_notebook():
        with _beneath_cell() as report_in_notebook:
            yield report_in_notebook
        return
    if quiet or not sys.stderr.isatty():
        yield _ignore_progress
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    hours = abs((case.end - case.start).astype(int)) / 3600 if case else 0.0
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
            # the bar pulses until a share is known
            tasks[phase] = bar.add_task(phase, total=None, rate="")
        speed = next(task.speed for task in bar.tasks if task.id == tasks[phase])
        rate = f"{speed * hours:.1f} h/s" if hours and speed and phase.endswith("drift") else ""
        if share > 0:
            bar.update(tasks[phase], total=1.0, completed=share, rate=rate)

    with bar:
        yield report
