"""Commands of targets that are rarely seen: experiment."""

import argparse
from pathlib import Path

from drift.cli import given as take
from drift.cli.answer import Answer
from drift.output import interrupt


def experiment(given: argparse.Namespace) -> Answer:
    """Follow a target in many runs and several ways, and say how well each does."""
    with interrupt.leaving_at_once():
        from drift.case import tracking
        from drift.cli import progress

        changes = take.changed(given.changes)
        if given.seed is not None:
            changes["seed"] = str(given.seed)
        if given.runs is not None:
            changes["experiment.runs"] = str(given.runs)
        asked = tracking.load(given.case, changes)
        out = given.out or Path(f"{asked.name}-experiment")
    from drift.tracker import command, text

    with progress.progress(quiet=given.quiet or given.json) as tell:
        found = command.experiment(
            asked, out, backend=given.backend, threads=given.threads, overwrite=given.overwrite, tell=tell
        )
    lines = (f"{asked.runs:,} runs of {asked.size:,} particles, seed {asked.seed}", f"Results in {out}")
    return Answer(asked.title, text.facts(found), lines, {"experiment": text.numbers(found)}, out)
