"""Progress of a run: a bar with rate and time left on a terminal, nothing where the output is piped."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drift.case.record import Case

Report = Callable[[str, float], None]  # (what is being done, share of it that is done)


def silent(phase: str, share: float) -> None:
    """Report nothing."""


@contextmanager
def shown(case: Case, *, quiet: bool = False) -> Iterator[Report]:
    """Give a function that shows the progress of a case, on standard error, unless it is to be quiet."""
    if quiet or not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    hours = abs((case.end - case.start).astype(int)) / 3600
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
