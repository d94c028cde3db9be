"""The commands `experiment` (many runs of any case) and `track` (tracking cases)."""

import argparse
from pathlib import Path

from drift.apps.cli import cards
from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt
from geo.errors import UserError


def experiment(args: argparse.Namespace) -> Answer:
    """Run a case many times, in several variants, and report the spread of its figures."""
    with interrupt.exit_on_signal():
        changes = take.parse_overrides(args.changes)
        if args.seed is not None:
            changes["seed"] = str(args.seed)
        parsed = [_variant(text) for text in args.variants]
        if repeated := sorted(
            {name for name, _ in parsed if [other for other, _ in parsed].count(name) > 1}
        ):
            raise UserError(
                f'--with "{repeated[0]}": the name is used twice; give each variant its own'
            )
        variants = dict(parsed)
        out = args.out or Path(f"{Path(args.case).stem}-experiment")
        from drift.apps.cli import progress
        from drift.assess.experiment import command, text
    with progress.progress(quiet=args.quiet or args.json) as report:
        found = command.experiment(
            args.case,
            out,
            changes=changes,
            variants=variants,
            figures=args.figures,
            runs=args.runs,
            backend=args.backend,
            threads=args.threads,
            overwrite=args.overwrite,
            tell=report,
        )
    cards.print_backend_choice(args)
    lines = (f"{found.runs:,} runs, each of {found.about}; seed {found.seed}", f"Results in {out}")
    return Answer(
        found.title,
        text.experiment_facts(found),
        lines,
        {"experiment": text.summary_of_experiment(found)},
        out,
    )


def track(args: argparse.Namespace) -> Answer:
    """Estimate a target's track from its detections."""
    with interrupt.exit_on_signal():
        changes = take.parse_overrides(args.changes)
        if args.seed is not None:
            changes["seed"] = str(args.seed)
        out = args.out or Path(f"{Path(args.case).stem}-track")
        from drift.apps.cli import progress
        from drift.apps.track import command, files, text
    with progress.progress(quiet=args.quiet or args.json) as report:
        found = command.track(
            args.case,
            out,
            changes=changes,
            backend=args.backend,
            threads=args.threads,
            overwrite=args.overwrite,
            tell=report,
        )
    cards.print_backend_choice(args)
    lines = (f"Map in {out / 'track.png'}, all results in {out}",)
    return Answer(
        found.held.study.title,
        text.track_facts(found),
        lines,
        {"track": files.summary_of_track(found)},
        out,
    )


def checked(args: argparse.Namespace) -> Answer:
    """Validate a tracking case."""
    from drift.apps.track import chase
    from drift.case.tracking import tracking
    from drift.tracking.tracker import said

    changes = take.parse_overrides(args.changes)
    if args.seed is not None:
        changes["seed"] = str(args.seed)
    study = tracking.load(args.case, changes)
    chase.check_pursuit(study, chase.land())
    return Answer(
        f"{study.title}: ready to run", said.tracking_facts(study), numbers={"ready": True}
    )


def _variant(text: str) -> tuple[str, dict[str, str]]:
    """Return the name and the overrides of a text "NAME: KEY=VALUE; KEY=VALUE"."""
    name, colon, changes = text.partition(":")
    if not colon or not name.strip() or not changes.strip():
        raise UserError(
            f'--with "{text}" must be NAME: KEY=VALUE, several separated by ; like "wet: '
            'scenario.0.weight=0.2"'
        )
    return name.strip(), take.parse_overrides(
        [change.strip() for change in changes.split(";") if change.strip()], "--with"
    )
