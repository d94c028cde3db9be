"""Commands that work on a case: run, plan, origin, compare, verify, fit-errors, check."""

import argparse
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drift.apps.cli import given as take
from drift.apps.cli.answer import Answer
from drift.products.files import interrupt
from geo.errors import UserError


def run(given: argparse.Namespace) -> Answer:
    """Forecast a case."""
    with _started(given, "forecast") as (case, out, options):
        from drift.apps.cli import outcome
        from drift.forecast.products import tables
        from drift.pipeline import flow, run_metadata
        from drift.pipeline.shards import cluster
        from drift.products.files import publication, writer

        options |= take.scale(given)
        with cluster.connected(given.workers, given.cluster) as client:
            result = flow.run(case, out, client=client, resume=given.resume, **options)
    if result is None:
        line = f"{out} holds the results of exactly this run: nothing to do"
        kept = publication.summary(out, writer.SUMMARY)
        met, expected, status = _expected(case, kept) if kept else ({}, {}, 0)
        lines = (line, *(f"{name}: {words}" for name, words in met.items()))
        return Answer("", met, lines, {"unchanged": True} | expected, out, status)
    made = result.summary["run"]
    last = {**tables.summary_of_forecast(result.forecast, result.setting.opens), **result.summary}
    told = outcome.spill(last) if case.spill else outcome.forecast(last)
    met, expected, status = _expected(case, last)
    # What steers is moved exactly: only drift has a scheme and errors of its step.
    scheme = f"{made['scheme']}, step {made['step_s']} s, " if run_metadata.drifts(case) else ""
    basis = f"{made['particles']:,} particles, {scheme}seed {made['seed']}"
    return Answer(
        case.title,
        told | met,
        (f"{basis}\nResults in {out}",),
        outcome.summary_of_outcome(last) | expected,
        out,
        status,
    )


def _expected(case: Any, numbers: Mapping[str, Any]) -> tuple[dict[str, str], dict[str, Any], int]:
    """Compare a run with its case's [expect]: return a line, numbers for programs, and the exit
    status.

    numbers: those of its summary.
    """
    from drift.case import expect

    told = expect.evaluate(case.expect, numbers["outputs"][-1])
    if not told:
        return {}, {}, 0
    if told["met"]:
        return {"expect": "as [expect] says"}, {"expect": told}, 0
    return {"missed [expect]": "; ".join(told["misses"])}, {"expect": told}, 1


def plan(given: argparse.Namespace) -> Answer:
    """Plan the next search, or the next patrols of a spill."""
    with _started(given, "plan") as (case, out, options):
        from drift.apps.cli import outcome
        from drift.pipeline.shards import cluster
        from drift.planning.patrols import files as patrol_files
        from drift.planning.patrols import patrol
        from drift.planning.search import planner

        options |= take.scale(given)
        with cluster.connected(given.workers, given.cluster) as client:
            if case.processing:
                from drift.planning.arrays import placement_text, processing_plan, processing_text

                processed, _ = processing_plan.allocate(case, out, client=client, **options)
            elif case.tows:
                from drift.planning.arrays import placement_text
                from drift.planning.arrays import planner as array_planner

                arrays, _ = array_planner.place(case, out, client=client, **options)
            elif case.spill:
                patrols, result = patrol.patrol(case, out, client=client, **options)
            else:
                search_plan, _ = planner.plan(case, out, client=client, **options)
    if case.processing:
        told, numbers = (
            processing_text.processing_facts(processed),
            processing_text.plan_numbers(processed),
        )
        line = f"Plan of processing in {out / 'processing.txt'}, all results in {out}"
        if processed.towed is not None:
            towed = placement_text.placement_facts(processed.towed)
            told = (
                {"towed arrays": towed.pop("plan")}
                | towed
                | {"processing": told.pop("plan")}
                | told
            )
            numbers = {"arrays": placement_text.summary_of_placement(processed.towed)} | numbers
            line = f"Plan of towed arrays in {out / 'arrays.txt'}, of processing in {out / 'processing.txt'}, all results in {out}"
        return Answer(case.title, told, (line,), numbers, out)
    if case.tows:
        line = f"Plan in {out / 'arrays.txt'}, all results in {out}"
        return Answer(
            case.title,
            placement_text.placement_facts(arrays),
            (line,),
            placement_text.summary_of_placement(arrays),
            out,
        )
    if case.spill:
        assert result.aftermath is not None
        told, line = (
            patrol_files.patrol_facts(patrols, result.aftermath),
            f"Patrols in {out / 'patrols.txt'}",
        )
        return Answer(
            case.title,
            told,
            (f"{line}, all results in {out}",),
            patrol_files.summary_of_patrols(patrols),
            out,
        )
    line = f"Search action plan in {out / 'plan.txt'}, all results in {out}"
    return Answer(
        case.title, outcome.plan(search_plan), (line,), outcome.plan_numbers(search_plan), out
    )


def origin(given: argparse.Namespace) -> Answer:
    """Run a spill backward from its finds."""
    with _started(given, "origin") as (case, out, options):
        from drift.apps.cli import outcome
        from drift.pipeline import flow
        from drift.spills.backtrack import backward

        release = flow.origin(case, out, **options)
    found, warnings = backward.summary(release), backward.warnings(release)
    numbers = {"origin": found, "warnings": list(warnings)}
    return Answer(case.title, outcome.origin(found, warnings), (f"Results in {out}",), numbers, out)


def compare(given: argparse.Namespace) -> Answer:
    """Run two cases on the same random numbers and say what differs."""
    with _started(given, "compare") as (case, out, options):
        from drift.assess.compare import contrast, text

        with interrupt.leaving_at_once():
            changes = {**take.changed(given.changes), **take.changed(given.changes_b, "--set-b")}
            if given.other is None and not given.changes_b:
                raise UserError(
                    "compare: nothing to compare with; name a second case, or change one by --set-b KEY=VALUE"
                )
            both = [f"{key}={value}" for key, value in changes.items()]
            other = take.case(given.other or given.case, both, given.seed)
        found = contrast.compare(case, other, out, plan=given.plan, **options)
    return Answer(
        found.title,
        text.comparison_facts(found),
        (f"Results in {out}",),
        text.summary_of_comparison(found),
        out,
    )


def verify(given: argparse.Namespace) -> Answer:
    """Forecast real drifters from many starts."""
    drifters = take.drifters(given)
    along = take.along(drifters["columns"])
    drifters |= {
        "every": take.quantity(given.every, "s", "--every", "12 h"),
        "error": take.quantity(given.error, "m", "--error", "100 m"),
        "hours": given.hours,
        "particles": given.particles,
    }
    with _started(given, "verify", along) as (case, out, options):
        from drift.assess.verify import files, verification
        from drift.assess.verify import text as verification_text

        verified = verification.verify(case, given.drifters, out, **drifters, **options)
    told, numbers = (
        verification_text.verification_facts(verified),
        {"verification": files.summary_of_verification(verified)},
    )
    return Answer(case.title, told, (f"Results in {out}",), numbers, out)


def fit_errors(given: argparse.Namespace) -> Answer:
    """Fit a case's [uncertainty] to real drifters."""
    drifters = take.drifters(given)
    with interrupt.leaving_at_once():  # nothing is written
        case = take.case(
            given.case, given.changes, given.seed, along=take.along(drifters["columns"])
        )
        from drift.assess.verify import fitting, fitting_text

        fitted = fitting.fit_errors(case, given.drifters, held_out=given.hold_out, **drifters)
    toml = fitting_text.toml(fitted)
    title = f"{case.title}: errors that suit the drifters"
    return Answer(title, fitting_text.fitting_facts(fitted), (f"\n{toml}",), {"toml": toml})


def check(given: argparse.Namespace) -> Answer:
    """Validate a case and its forcing without running."""
    with interrupt.leaving_at_once():  # nothing is written
        from drift.case.tracking import tracking

        if tracking.is_one(given.case):
            from drift.apps.cli import experiments

            return experiments.checked(given)
        case = take.case(given.case, given.changes, given.seed)
        from drift.apps.check import check

        understood = check.check(case)
    ready = "warning" not in understood
    return Answer(
        f"{case.title}: {'ready to run' if ready else 'not ready'}",
        understood,
        numbers={"ready": ready},
    )


@contextmanager
def _started(
    given: argparse.Namespace, kind: str, along: Collection[str] = ()
) -> Iterator[tuple[Any, Path, dict[str, Any]]]:
    """Give the case, the folder for its results, and how to run it, showing progress meanwhile.

    along: quantities that the case needs no sources of.
    """
    with interrupt.leaving_at_once():
        case = take.case(given.case, given.changes, given.seed, along=along)
        out = given.out or Path(f"{case.path.stem}-{kind}")
        if given.threads is not None and given.threads < 1:
            raise UserError(f"--threads {given.threads} must be at least 1")
        from drift.apps.check import outlook
        from drift.apps.cli import progress
        from drift.pipeline import flow  # noqa: F401 - flow: what is slow to import is imported here
        from kernels.runtime import runtime

        cores = runtime.cores()
        if given.threads is not None and given.threads > cores:
            print(
                f"drift: --threads {given.threads}: runs on {cores}, all the cores it may use here",
                file=sys.stderr,
            )

    scale = take.scale(given) if hasattr(given, "shards") else {}
    elsewhere = getattr(given, "workers", None) or getattr(given, "cluster", None)
    with interrupt.leaving_at_once():
        from drift.apps.cli import cards

        cards.start(given, out, case.particles, bool(elsewhere))
    needs = None if elsewhere else outlook.needs(case, scale.get("memory"), scale.get("shards"))
    for worth in (outlook.caution(case), needs):
        if worth:
            print(f"drift: {worth}", file=sys.stderr)
    with progress.progress(case, quiet=given.quiet) as show:

        def report(phase: str, share: float) -> None:
            interrupt.heed()
            show(phase, share)

        options = {
            "threads": given.threads,
            "backend": given.backend,
            "overwrite": given.overwrite,
            "report": report,
        }
        yield case, out, options
