"""Many runs of a case of drift run, seeds apart, in several variants."""

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
NAMED = 8  # numbers of a summary that a refusal names


def run(
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
    """Return figures of runs of a case with the seeds that follow its own, as it is and in
    variants.

    changes: of the case in all runs, and variants: further ones by name, as overrides of
    drift.load. paths: of numbers in summary.json, like "outputs.-1.area_nmi2.95%", * for all of a
    table; () for the usual ones. Raises UserError.
    """
    if AS_IT_IS in variants:
        raise UserError(
            f'--with "{AS_IT_IS}": so the case is called without changes; take another name'
        )
    if seeded := [way for way, own in variants.items() if "seed" in own]:
        raise UserError(
            f'--with "{seeded[0]}": seed is of all variants, whose random numbers are common; give --seed'
        )
    first = case_file.load(name, changes)
    ways: dict[str, Mapping[str, str]] = {AS_IT_IS: {}, **variants}
    files = list(first.inputs)
    for own in variants.values():  # all that is wrong is told before the first run
        files += case_file.load(name, {**changes, **own}).inputs
    rows: list[list[dict[str, float]]] = []
    done = 0
    for way, own in ways.items():
        rows.append([])
        for number in range(runs):
            case = case_file.load(name, {**changes, **own, "seed": str(first.seed + number)})
            result = flow.run(case, backend=backend, threads=threads)
            summary = {
                **tables.summary_of_forecast(result.forecast, result.setting.opens),
                **result.summary,
            }
            rows[-1].append(dict(_found(summary, paths, way)))
            done += 1
            tell("running", done / (runs * len(ways)))
    names = list(dict.fromkeys(path for way in rows for one in way for path in one))
    figures = tuple(
        Figure(path, "", np.array([[one.get(path, np.nan) for one in way] for way in rows]))
        for path in names
    )
    asked = "; ".join(
        f"{way}: {', '.join(f'{k}={v}' for k, v in own.items())}" for way, own in variants.items()
    )
    return Experiment(
        first.title,
        f"{first.text.rstrip()}\n# experiment, {runs} runs: {asked}\n",
        first.seed,
        runs,
        f"{first.particles:,} particles",
        tuple(ways),
        figures,
        files=tuple(dict.fromkeys(files)),
    )


def _found(
    summary: Mapping[str, Any], paths: Sequence[str], way: str
) -> Iterator[tuple[str, float]]:
    """Give the numbers that are asked for, by their paths; of the usual ones those that there are;
    way: whose summary it is.
    """
    every = dict(numbers_by_path(summary))
    for path in paths or USUAL:
        if path.endswith("*"):
            own = {key: value for key, value in every.items() if key.startswith(path[:-1])}
        else:
            own = {key: value for key, value in every.items() if key == path}
        if paths and not own:
            near = (
                difflib.get_close_matches(path, every, n=NAMED, cutoff=0.4) or list(every)[:NAMED]
            )
            raise UserError(
                f'--figure "{path}": no such number in the summary of this case, {way}; some are: {", ".join(near)}'
            )
        yield from own.items()


def numbers_by_path(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Give all numbers of a summary by their paths; the last of a list by -1 too."""
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
