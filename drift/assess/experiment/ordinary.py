"""Run a case of `drift run` with many seeds, in several variants."""

import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from drift.assess.experiment.record import Experiment
from drift.case import file as case_file
from drift.forecast.products import tables
from drift.pipeline import flow
from drift.tracking.tracker.figures import Figure
from geo.errors import UserError

AS_IT_IS = "as it is"
USUAL = (
    "outputs.-1.area_nmi2.*",
    "search.cumulative_pos.all",
    "search.log_evidence",
    "spill.totals.*",
)
NAMED = 8  # names of figures that an error message lists


def run_variants(
    name: str,
    changes: Mapping[str, str],
    variants: Mapping[str, Mapping[str, str]],
    paths: Sequence[str],
    runs: int,
    *,
    backend: str,
    threads: int | None,
    tell: Callable[[str, float], None],
) -> Experiment:
    """Run a case and its variants with consecutive seeds, and return their figures.

    Args:
        name: name or file of the case.
        changes: overrides (as in drift.load) for all runs.
        variants: further overrides by the name of each variant.
        paths: paths of numbers in summary.json, like "outputs.-1.area_nmi2.95%", with * for all of
            a table; (): the USUAL ones.
        runs: number of runs of each variant; seeds count up from the case's own.
        backend, threads: as in `drift.assess.experiment.command.experiment`.
        tell: progress callback: the phase, and the share of it that is done, 0 to 1.

    Returns:
        The figures of all runs, by variant.

    Raises:
        UserError: a variant changes the seed or has a reserved name, a case is wrong, or a path
            does not exist.
    """
    if AS_IT_IS in variants:
        raise UserError(
            f'--with "{AS_IT_IS}": this is the name of the unchanged case; take another name'
        )
    if seeded := [variant for variant, overrides in variants.items() if "seed" in overrides]:
        raise UserError(
            f'--with "{seeded[0]}": all variants share their random numbers, so a variant cannot '
            "set seed; give --seed"
        )
    first = case_file.load(name, changes)
    all_variants: dict[str, Mapping[str, str]] = {AS_IT_IS: {}, **variants}
    files = list(first.inputs)
    for overrides in variants.values():  # reports mistakes in variants before the first run
        files += case_file.load(name, {**changes, **overrides}).inputs
    rows: list[list[dict[str, float]]] = []
    done = 0
    for variant, overrides in all_variants.items():
        rows.append([])
        for number in range(runs):
            case = case_file.load(name, {**changes, **overrides, "seed": str(first.seed + number)})
            result = flow.run(case, backend=backend, threads=threads)
            summary = {
                **tables.summary_of_forecast(result.forecast, result.setting.opens),
                **result.summary,
            }
            rows[-1].append(dict(_found(summary, paths, variant)))
            done += 1
            tell("running", done / (runs * len(all_variants)))
    names = list(
        dict.fromkeys(
            path for variant in rows for figures_of_run in variant for path in figures_of_run
        )
    )
    figures = tuple(
        Figure(
            path,
            "",
            np.array(
                [
                    [figures_of_run.get(path, np.nan) for figures_of_run in variant]
                    for variant in rows
                ]
            ),
        )
        for path in names
    )
    description = "; ".join(
        f"{variant}: {', '.join(f'{k}={v}' for k, v in overrides.items())}"
        for variant, overrides in variants.items()
    )
    return Experiment(
        first.title,
        f"{first.text.rstrip()}\n# experiment, {runs} runs: {description}\n",
        first.seed,
        runs,
        f"{first.particles:,} particles",
        tuple(all_variants),
        figures,
        files=tuple(dict.fromkeys(files)),
    )


def _found(
    summary: Mapping[str, Any], paths: Sequence[str], variant: str
) -> Iterator[tuple[str, float]]:
    """Yield the requested numbers of a variant's summary by their paths.

    Without `paths`, yield the USUAL numbers as far as they exist.
    """
    numbers = dict(numbers_by_path(summary))
    for path in paths or USUAL:
        if path.endswith("*"):
            matching = {key: value for key, value in numbers.items() if key.startswith(path[:-1])}
        else:
            matching = {key: value for key, value in numbers.items() if key == path}
        if paths and not matching:
            suggestions = (
                difflib.get_close_matches(path, numbers, n=NAMED, cutoff=0.4)
                or list(numbers)[:NAMED]
            )
            raise UserError(
                f'--figure "{path}": no such number in the summary of this case ({variant}); '
                "similar "
                f"ones: {', '.join(suggestions)}"
            )
        yield from matching.items()


def numbers_by_path(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield each number of a summary with its path; also count the last item of a list as -1."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from numbers_by_path(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, (list, tuple)):
        for k, inner in enumerate(value):
            yield from numbers_by_path(inner, f"{path}.{k}")
        if value:
            yield from numbers_by_path(value[-1], f"{path}.-1")
    elif isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        yield path, float(value)
