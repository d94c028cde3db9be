"""The results of an experiment as text, tables and JSON.

A "way" is a variant of the case, or a method of a tracking case.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from drift.assess.experiment.record import Experiment
from drift.products.files import formats
from drift.tracking.tracker.figures import QUANTILES, Figure
from drift.tracking.tracker.study import HELD, MET


def groups_of_equal_ways(found: Experiment, curves: bool = False) -> list[list[int]]:
    """Return groups of ways (by number) whose figures are equal to the last bit.

    With `curves`, their errors over time are equal too.
    """
    groups: dict[bytes, list[int]] = {}
    for k in range(len(found.ways)):
        key = b"".join(figure.values[k].tobytes() for figure in found.figures)
        if curves and found.tracking is not None:
            key += b"".join(curve.values[k].tobytes() for curve in found.tracking.curves)
        groups.setdefault(key, []).append(k)
    return list(groups.values())


def group_name(found: Experiment, group: list[int]) -> str:
    """Return the common name of ways with equal results."""
    return "; ".join(found.ways[k] for k in group)


def experiment_facts(found: Experiment) -> Mapping[str, str]:
    """Return a line of figures for each way; ways with equal results share one.

    A figure in brackets is the mean difference from the first way, run by run.
    """
    lines = {}
    for group in groups_of_equal_ways(found):
        parts = []
        for figure in found.figures:
            mean, error, missing = (
                row[group[0]] for row in (figure.mean(), figure.error(), figure.missing())
            )
            if figure.name == HELD and mean == 100.0:
                continue
            words = " ".join([figure.name, *_mean_and_error(mean, error), figure.unit]).rstrip()
            if apart := difference_from_first(figure, group[0]):
                words += f" ({apart})"
            # the mean depends on a few slow runs; it is undefined if a run never meets the criteria
            if figure.name == MET:
                middle = figure.quantiles()[group[0], QUANTILES.index(0.5)]
                median = (
                    f"median {middle:.3g} {figure.unit}" if np.isfinite(middle) else "median never"
                )
                words = f"{words}, {median}" if np.isfinite(mean) else f"{figure.name} {median}"
                parts.append(words + f" (never in {missing} of {found.runs} runs)" * bool(missing))
                continue
            parts.append(words + f" (none in {missing} runs)" * bool(missing))
        lines[group_name(found, group)] = "; ".join(parts)
    if len(lines) > 1:
        lines["in brackets"] = "the difference from the first, run by run"
    return lines


def difference_from_first(figure: Figure, way: int) -> str:
    """Return the mean difference of a figure from the first way, run by run, as text.

    It is "" for the first way itself, and where the difference is unknown.
    """
    mean, error = (row[way] for row in figure.difference())
    if way == 0 or not np.isfinite(mean):
        return ""
    rounding = 1e-12 * np.abs(figure.values[[0, way]]).max(
        initial=0.0, where=np.isfinite(figure.values[[0, way]])
    )
    return "+0" if abs(mean) <= rounding else " ".join(_mean_and_error(mean, error, sign=True))


def _mean_and_error(mean: float, error: float, sign: bool = False) -> tuple[str, ...]:
    """Return a mean and its standard error (to two digits of it) as texts; sign: show a "+"."""
    plus = "+" if sign else ""
    if not np.isfinite(mean):
        return ("none",)
    if not np.isfinite(error) or error <= 1e-9 * abs(mean):  # all runs equal, up to rounding
        return (f"{mean:{plus}.4g}",)
    digits = max(1 - math.floor(math.log10(error)), 0)
    return f"{mean:{plus},.{digits}f}", "+-", f"{error:,.{digits}f}"


def published_value(found: Experiment, way: int, name: str) -> float | None:
    """Return the published value of a figure for a way; None if there is none."""
    return found.published.get(found.ways[way], {}).get(name)


def experiment_table(found: Experiment) -> str:
    """Return the figures of each way as CSV, with published values beside them."""
    header = ["way", "figure", "unit", "runs", "mean", "standard_error"]
    header += [f"quantile_{100 * share:.0f}" for share in QUANTILES] + [
        "runs_without",
        "difference",
        "difference_standard_error",
        "published",
        "published_median",
    ]
    rows = []
    for way, name in enumerate(found.ways):
        for figure in found.figures:
            rows.append(
                [
                    name,
                    figure.name,
                    figure.unit,
                    found.runs,
                    _cell(figure.mean()[way]),
                    _cell(figure.error()[way]),
                    *(_cell_or_inf(value) for value in figure.quantiles()[way]),
                    int(figure.missing()[way]),
                    *(_cell(value[way]) for value in figure.difference()),
                    published_value(found, way, figure.name),
                    published_value(found, way, f"median {figure.name}"),
                ]
            )
    return formats.csv_text(header, rows)


def runs_csv(found: Experiment) -> str:
    """Return the figures of each run as CSV."""
    header = [
        "way",
        "run",
        *(
            f"{figure.name} [{figure.unit}]".removesuffix(" []").replace(" ", "_")
            for figure in found.figures
        ),
    ]
    rows = [
        [name, run + 1, *(_cell_or_inf(figure.values[way, run]) for figure in found.figures)]
        for way, name in enumerate(found.ways)
        for run in range(found.runs)
    ]
    return formats.csv_text(header, rows)


def curves_csv(found: Experiment) -> str:
    """Return the mean and standard error of each curve at each time as CSV."""
    tracking = found.tracking
    assert tracking is not None
    header = ["way", "minutes"]
    for curve in tracking.curves:
        column, unit = (
            curve.name.replace(" % ", "_percent_").replace(" ", "_"),
            curve.unit.replace("%", "percent"),
        )
        header += [f"{column}_{unit}", f"{column.removesuffix('_error')}_standard_error_{unit}"]
    means = [curve.mean() for curve in tracking.curves]
    rows = []
    for way, name in enumerate(found.ways):
        for k, time in enumerate(tracking.time):
            rows.append(
                [name, time / 60, *(_cell(values[way, k]) for both in means for values in both)]
            )
    return formats.csv_text(header, rows)


def _cell_or_inf(value: float) -> float | None:
    """Return a table value to six digits; inf for a run that never meets the criteria."""
    return float("inf") if np.isposinf(value) else _cell(value)


def _cell(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None


def summary_of_experiment(found: Experiment) -> dict[str, Any]:
    """Return the figures of all ways for summary.json."""
    return {
        "runs": found.runs,
        "seed": found.seed,
        "about": found.about,
        "figures": [
            {
                "way": name,
                "figure": figure.name,
                "unit": figure.unit,
                "mean": _cell(figure.mean()[way]),
                "standard_error": _cell(figure.error()[way]),
                "runs_without": int(figure.missing()[way]),
                **{
                    key: _cell(value[way])
                    for key, value in zip(
                        ("difference", "difference_standard_error"),
                        figure.difference(),
                        strict=True,
                    )
                },
                "quantiles": {
                    f"{share:g}": _cell(value)
                    for share, value in zip(QUANTILES, figure.quantiles()[way], strict=True)
                },
                "published": published_value(found, way, figure.name),
                "published_median": published_value(found, way, f"median {figure.name}"),
            }
            for way, name in enumerate(found.ways)
            for figure in found.figures
        ],
    }
