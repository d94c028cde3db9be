"""Commands that run or score a case: run, plan, origin, compare, budget, verify, score and more."""

import argparse
import gc
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt
from geo.errors import UserError


def run(args: argparse.Namespace) -> Answer:
    """Forecast a case."""
    with _prepared_run(args, "forecast") as (case, out, options):
        from drift.apps.cli import outcome
        from drift.forecast.products import tables
        from drift.pipeline import flow, run_metadata
        from drift.pipeline.shards import cluster
        from drift.products.files import publication, writer

        options |= take.shard_options(args)
        with cluster.connect_to_cluster(args.workers, args.cluster) as client:
            result = flow.run(case, out, client=client, resume=args.resume, **options)
    if result is None:
        line = f"{out} holds the results of exactly this run: nothing to do"
        stored = publication.summary(out, writer.SUMMARY)
        met, expected, status = _evaluate_expectation(case, stored) if stored else ({}, {}, 0)
        lines = (line, *(f"{name}: {words}" for name, words in met.items()))
        return Answer("", met, lines, {"unchanged": True} | expected, out, status)
    metadata = result.summary["run"]
    summary = {
        **tables.summary_of_forecast(result.forecast, result.setting.opens),
        **result.summary,
    }
    facts = outcome.spill(summary) if case.spill else outcome.forecast(summary)
    met, expected, status = _evaluate_expectation(case, summary)
    # Steered targets move exactly: only drift has a numerical scheme and step errors.
    scheme = (
        f"{metadata['scheme']}, step {metadata['step_s']} s, " if run_metadata.drifts(case) else ""
    )
    basis = f"{metadata['particles']:,} particles, {scheme}seed {metadata['seed']}"
    return Answer(
        case.title,
        facts | met,
        (f"{basis}\nResults in {out}",),
        outcome.summary_of_outcome(summary) | expected,
        out,
        status,
    )


def _evaluate_expectation(
    case: Any, numbers: Mapping[str, Any]
) -> tuple[dict[str, str], dict[str, Any], int]:
    """Compare a run with its case's [expect]; return facts, numbers for programs and exit status.

    numbers: the content of summary.json.
    """
    from drift.case import expect

    verdict = expect.evaluate(case.expect, numbers["outputs"][-1])
    if not verdict:
        return {}, {}, 0
    if verdict["met"]:
        return {"expect": "as [expect] says"}, {"expect": verdict}, 0
    return {"missed [expect]": "; ".join(verdict["misses"])}, {"expect": verdict}, 1


def plan(args: argparse.Namespace) -> Answer:
    """Plan the next search, or the next patrols of a spill."""
    with _prepared_run(args, "plan") as (case, out, options):
        from drift.pipeline.shards import cluster
        from drift.planning import plans

        if case.processing:
            from drift.planning.arrays.processing_plan import PLANNER
        elif case.tows:
            from drift.planning.arrays.planner import PLANNER
        elif case.spill:
            from drift.planning.patrols.patrol import PLANNER
        else:
            from drift.planning.search.planner import PLANNER
        options |= take.shard_options(args)
        with cluster.connect_to_cluster(args.workers, args.cluster) as client:
            made = plans.propose(PLANNER, case, out, client=client, **options)
    texts = ", ".join(f"{what} in {out / file}" for what, file in made.texts.items())
    return Answer(case.title, made.facts, (f"{texts}, all results in {out}",), made.numbers, out)


def origin(args: argparse.Namespace) -> Answer:
    """Run a spill backward from its finds."""
    with _prepared_run(args, "origin") as (case, out, options):
        from drift.apps.cli import outcome
        from drift.pipeline import flow, run_metadata
        from drift.spills.backtrack import backward

        release = flow.origin(case, out, **options)
    found = backward.summary_of_origin(release)
    warnings = [*backward.origin_warnings(release), *run_metadata.case_warnings(case)]
    numbers = {"origin": found, "warnings": warnings}
    return Answer(case.title, outcome.origin(found, warnings), (f"Results in {out}",), numbers, out)


def compare(args: argparse.Namespace) -> Answer:
    """Run two cases on the same random numbers and report the differences."""
    with _prepared_run(args, "compare") as (case, out, options):
        from drift.assess.compare import contrast, text

        with interrupt.exit_on_signal():
            changes = {
                **take.parse_overrides(args.changes),
                **take.parse_overrides(args.changes_b, "--set-b"),
            }
            if args.other is None and not args.changes_b:
                raise UserError(
                    "compare: nothing to compare with; name a second case, or change one by --set-b KEY=VALUE"
                )
            overrides = [f"{key}={value}" for key, value in changes.items()]
            other = take.load_case(args.other or args.case, overrides, args.seed)
        found = contrast.compare(case, other, out, plan=args.plan, **options)
    return Answer(
        found.title,
        text.comparison_facts(found),
        (f"Results in {out}",),
        text.summary_of_comparison(found),
        out,
    )


def budget(args: argparse.Namespace) -> Answer:
    """Show what drives the areas of a case."""
    with _prepared_run(args, "budget") as (case, out, options):
        from drift.assess.budget import command, text

        found = command.budget(case, out, times=args.times, particles=args.particles, **options)
    many = 2 ** len(found.sources)
    line = f"{many} forecasts of {found.particles:,} particles, seed {case.seed}\nResults in {out}"
    facts, numbers = text.budget_facts(found), {"budget": text.summary_of_budget(found)}
    return Answer(f"{case.title}: what drives the area", facts, (line,), numbers, out)


def verify(args: argparse.Namespace) -> Answer:
    """Forecast real drifters from many starts and score the forecasts."""
    drifters = take.drifter_reading_options(args)
    quantities = take.quantities_in_columns(drifters["columns"])
    drifters |= {
        "every": take.parse_positive_quantity(args.every, "s", "--every", "12 h"),
        "error": take.parse_positive_quantity(args.error, "m", "--error", "100 m"),
        "hours": args.hours,
        "particles": args.particles,
    }
    with _prepared_run(args, "verify", quantities) as (case, out, options):
        from drift.assess.verify import files, verification
        from drift.assess.verify import text as verification_text

        verified = verification.verify(case, args.drifters, out, **drifters, **options)
    facts, numbers = (
        verification_text.verification_facts(verified),
        {"verification": files.summary_of_verification(verified)},
    )
    return Answer(case.title, facts, (f"Results in {out}",), numbers, out)


def score(args: argparse.Namespace) -> Answer:
    """Score finished runs against the places where the objects were found."""
    within = take.parse_positive_quantity(args.within, "s", "--within", "1 h")
    out = args.out or Path("score")
    with interrupt.exit_on_signal():
        from drift.assess.score import command, text

        found = command.score(
            args.folders, out, found=args.found, within=within, overwrite=args.overwrite
        )
    facts, numbers = text.score_facts(found), {"score": text.summary_of_score(found)}
    return Answer("Scores of past cases", facts, (f"Results in {out}",), numbers, out)


def fit_errors(args: argparse.Namespace) -> Answer:
    """Fit a case's [uncertainty] to tracks of real drifters."""
    drifters = take.drifter_reading_options(args)
    with interrupt.exit_on_signal():  # nothing is written
        case = take.load_case(
            args.case,
            args.changes,
            args.seed,
            along=take.quantities_in_columns(drifters["columns"]),
        )
        from drift.assess.verify import fitting, fitting_text

        fitted = fitting.fit_errors(case, args.drifters, held_out=args.hold_out, **drifters)
    toml = fitting_text.toml(fitted)
    title = f"{case.title}: errors that fit the drifters"
    return Answer(title, fitting_text.fitting_facts(fitted), (f"\n{toml}",), {"toml": toml})


def check(args: argparse.Namespace) -> Answer:
    """Validate a case and its forcing without running."""
    with interrupt.exit_on_signal():  # nothing is written
        from drift.case.tracking import tracking

        if tracking.is_tracking_case(args.case):
            from drift.apps.cli import experiments

            return experiments.checked(args)
        case = take.load_case(args.case, args.changes, args.seed)
        from drift.apps.check import check

        facts = check.check(case)
    ready = "warning" not in facts
    return Answer(
        f"{case.title}: {'ready to run' if ready else 'not ready'}",
        facts,
        numbers={"ready": ready},
    )


@contextmanager
def _not_collected() -> Iterator[None]:
    """Keep Python's search for cycles away from what is imported: it would go through it time and
    again, for a second in all.

    Only the first time in a process: what is garbage then stays.
    """
    if gc.get_freeze_count():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@contextmanager
def _prepared_run(
    args: argparse.Namespace, kind: str, along: Collection[str] = ()
) -> Iterator[tuple[Any, Path, dict[str, Any]]]:
    """Yield the case, the folder for its results and the run options, and show progress meanwhile.

    along: quantities that the case needs no sources for.
    """
    with interrupt.exit_on_signal(), _not_collected():
        case = take.load_case(args.case, args.changes, args.seed, along=along)
        out = args.out or Path(f"{case.path.stem}-{kind}")
        if args.threads is not None and args.threads < 1:
            raise UserError(f"--threads {args.threads} must be at least 1")
        from drift.apps.check import outlook
        from drift.apps.cli import progress
        from drift.pipeline import flow  # noqa: F401 - flow: slow imports happen before the bar
        from kernels.runtime import runtime

        cores = runtime.cores()
        if args.threads is not None and args.threads > cores:
            print(
                f"drift: --threads {args.threads}: uses {cores}, all the cores available here",
                file=sys.stderr,
            )

    scale = take.shard_options(args) if hasattr(args, "shards") else {}
    distributed = getattr(args, "workers", None) or getattr(args, "cluster", None)
    with interrupt.exit_on_signal():
        from drift.apps.cli import cards

        cards.start_backend(args, out, case.particles, bool(distributed))
    needs = (
        None if distributed else outlook.shard_needs(case, scale.get("memory"), scale.get("shards"))
    )
    for caution in (outlook.caution_about_work(case), needs):
        if caution:
            print(f"drift: {caution}", file=sys.stderr)
    with progress.progress(case, quiet=args.quiet) as show:

        def report(phase: str, share: float) -> None:
            interrupt.raise_if_interrupted()
            show(phase, share)

        options = {
            "threads": args.threads,
            "backend": args.backend,
            "overwrite": args.overwrite,
            "report": report,
        }
        yield case, out, options
