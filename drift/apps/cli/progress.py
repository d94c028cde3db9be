"""Progress of a run: a bar with rate and time left on a terminal, a bar in a notebook, nothing
where the output is piped.

With the environment variable DRIFT_PROGRESS=lines, which `drift serve` sets, lines of JSON for
another program.
"""

import html
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drift.case.record import Case

Report = Callable[[str, float], None]  # (what is being done, share of it that is done)
OFTEN = 0.2  # [s] between what other programs and notebooks are told of one phase


def silent(phase: str, share: float) -> None:
    """Report nothing."""


def sparing(tell: Report) -> Report:
    """Return a function that reports each phase at once, and its share five times a second at most."""
    last = ("", 0.0)

    def report(phase: str, share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if phase != last[0] or now - last[1] >= OFTEN:
            last = (phase, now)
            tell(phase, share)

    return report


def line(phase: str, share: float) -> None:
    """Write progress on standard error as a line: a mark (RS) and JSON."""
    print(f"\x1e{json.dumps({'phase': phase, 'share': share})}", file=sys.stderr, flush=True)


def _in_notebook() -> bool:
    """Whether what runs this is a Jupyter kernel, which shows HTML."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


@contextmanager
def _beneath_cell() -> Iterator[Report]:
    """Give a function that shows progress beneath a notebook's cell, where nothing of it stays."""
    from IPython.display import HTML, display

    shown = display(HTML(""), display_id=True)

    def report(phase: str, share: float) -> None:
        done = f" value='{share:.3f}'" if share > 0 else ""  # none: a pulse
        shown.update(HTML(f"<progress{done}></progress> {html.escape(phase)}"))

    try:
        yield sparing(report)
    finally:
        shown.update(HTML(""))


@contextmanager
def progress(case: Case | None = None, *, quiet: bool = False) -> Iterator[Report]:
    """Give a function that shows how far a job is, for its `report`: `with drift.progress(case) as
    report:`.

    It shows a bar on a terminal, by standard error, or in a notebook; elsewhere nothing.

    Args:
        case: whose simulated hours a second are shown on a terminal; None: shares alone.
        quiet: whether nothing is shown anywhere.

    Returns:
        A context with the function (phase, share of it that is done, 0 to 1).
    """
    if os.environ.get("DRIFT_PROGRESS") == "lines":
        yield sparing(line)
        return
    if not quiet and _in_notebook():
        with _beneath_cell() as tell:
            yield tell
        return
    if quiet or not sys.stderr.isatty():
        yield silent
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
            # a pulse until a share is known
            tasks[phase] = bar.add_task(phase, total=None, rate="")
        speed = next(task.speed for task in bar.tasks if task.id == tasks[phase])
        rate = f"{speed * hours:.1f} h/s" if hours and speed and phase.endswith("drift") else ""
        if share > 0:
            bar.update(tasks[phase], total=1.0, completed=share, rate=rate)

    with bar:
        yield report
