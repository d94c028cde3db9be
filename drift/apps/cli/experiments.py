"""The commands of tracking cases, and of many runs of any case: experiment, track."""

import argparse
from pathlib import Path

from drift.apps.cli import cards
from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt
from geo.errors import UserError


def experiment(given: argparse.Namespace) -> Answer:
    """Run a case many times, in several ways, and say how its figures scatter."""
    with interrupt.leaving_at_once():
        changes = take.changed(given.changes)
        if given.seed is not None:
            changes["seed"] = str(given.seed)
        named = [_variant(text) for text in given.variants]
        if twice := sorted(
            {name for name, _ in named if [other for other, _ in named].count(name) > 1}
        ):
            raise UserError(f'--with "{twice[0]}": there are two of this name')
        variants = dict(named)
        out = given.out or Path(f"{Path(given.case).stem}-experiment")
        from drift.apps.cli import progress
        from drift.assess.experiment import command, text
    with progress.progress(quiet=given.quiet or given.json) as tell:
        found = command.experiment(
            given.case,
            out,
            changes=changes,
            variants=variants,
            figures=given.figures,
            runs=given.runs,
            backend=given.backend,
            threads=given.threads,
            overwrite=given.overwrite,
            tell=tell,
        )
    cards.say_choice(given)
    lines = (f"{found.runs:,} runs, each of {found.about}; seed {found.seed}", f"Results in {out}")
    return Answer(
        found.title,
        text.experiment_facts(found),
        lines,
        {"experiment": text.summary_of_experiment(found)},
        out,
    )


def track(given: argparse.Namespace) -> Answer:
    """Follow a target by its detections."""
    with interrupt.leaving_at_once():
        changes = take.changed(given.changes)
        if given.seed is not None:
            changes["seed"] = str(given.seed)
        out = given.out or Path(f"{Path(given.case).stem}-track")
        from drift.apps.cli import progress
        from drift.apps.track import command, files, text
    with progress.progress(quiet=given.quiet or given.json) as tell:
        found = command.track(
            given.case,
            out,
            changes=changes,
            backend=given.backend,
            threads=given.threads,
            overwrite=given.overwrite,
            tell=tell,
        )
    cards.say_choice(given)
    lines = (f"Map in {out / 'track.png'}, all results in {out}",)
    return Answer(
        found.held.study.title,
        text.track_facts(found),
        lines,
        {"track": files.summary_of_track(found)},
        out,
    )


def checked(given: argparse.Namespace) -> Answer:
    """Validate a tracking case."""
    from drift.apps.track import chase
    from drift.case.tracking import tracking
    from drift.tracking.tracker import said

    changes = take.changed(given.changes)
    if given.seed is not None:
        changes["seed"] = str(given.seed)
    study = tracking.load(given.case, changes)
    chase.check(study, chase.land())
    return Answer(
        f"{study.title}: ready to run", said.tracking_facts(study), numbers={"ready": True}
    )


def _variant(text: str) -> tuple[str, dict[str, str]]:
    """Return name and changes of "NAME: KEY=VALUE; KEY=VALUE"."""
    name, colon, changes = text.partition(":")
    if not colon or not name.strip() or not changes.strip():
        raise UserError(
            f'--with "{text}" must be NAME: KEY=VALUE, several with ; between, like "wet: scenario.0.weight=0.2"'
        )
    return name.strip(), take.changed(
        [change.strip() for change in changes.split(";") if change.strip()], "--with"
    )
