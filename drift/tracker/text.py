"""What an experiment came to, in words and tables."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drift.output import formats
from drift.tracker.experiment import MET, QUANTILES, Outcome
from geo.array import Array
from geo.notation import KNOT, NMI

ERRORS = (("position", "nmi", 1 / NMI), ("course", "deg", float(np.degrees(1.0))), ("speed", "kn", 1 / KNOT))


def alike(found: Outcome, curves: bool = False) -> list[list[int]]:
    """Return the ways of following by their numbers, those together of which no figure differs by a bit.

    curves: nor any error at any time.
    """
    groups: dict[bytes, list[int]] = {}
    for k in range(len(found.study.methods)):
        key = b"".join(figure.values[k].tobytes() for figure in found.figures)
        if curves:
            key += b"".join(values[k].tobytes() for values in vars(found.errors).values())
        groups.setdefault(key, []).append(k)
    return list(groups.values())


def called(found: Outcome, group: list[int]) -> str:
    """Return what ways of following that came to the same are called."""
    return "; ".join(found.study.methods[k].name for k in group)


def facts(found: Outcome) -> Mapping[str, str]:
    """Return a line for each way of following, those that came to the same in one."""
    told = {"sweeps in a run": f"{found.sweeps:,}"}
    for group in alike(found):
        parts = []
        for figure in found.figures:
            mean, error, missing = (row[group[0]] for row in (figure.mean(), figure.error(), figure.missing()))
            if figure.name == "track held" and mean == 100.0:
                continue
            words = f"{figure.name} {_number(mean)} +- {_number(error)} {figure.unit}"
            if figure.name == MET:  # a few runs that take long make its mean
                words += f", median {_number(figure.quantiles()[group[0], QUANTILES.index(0.5)])}"
            parts.append(words + f" (none in {missing} runs)" * bool(missing))
        told[called(found, group)] = "; ".join(parts)
    return told


def _number(value: float) -> str:
    return "none" if not np.isfinite(value) else f"{value:.2f}" if abs(value) < 100 else f"{value:.0f}"


def published(found: Outcome, way: int, name: str) -> float | None:
    """Return the figure that was published of a way of following, None where there is none."""
    return found.study.published.get(found.study.methods[way].name, {}).get(name)


def table(found: Outcome) -> str:
    """Return the figures of each way of following, with what was published beside them."""
    header = ["method", "figure", "unit", "runs", "mean", "standard_error"]
    header += [f"quantile_{100 * share:.0f}" for share in QUANTILES] + ["runs_without", "published", "published_median"]
    rows = []
    for way, method in enumerate(found.study.methods):
        for figure in found.figures:
            rows.append([
                method.name, figure.name, figure.unit, found.study.runs, _cell(figure.mean()[way]), _cell(figure.error()[way]),
                *(_cell(value) for value in figure.quantiles()[way]), int(figure.missing()[way]),
                published(found, way, figure.name), published(found, way, f"median {figure.name}"),
            ])  # fmt: skip
    return formats.csv_text(header, rows)


def runs(found: Outcome) -> str:
    """Return the figures of each run."""
    header = ["method", "run", *(f"{figure.name} [{figure.unit}]".replace(" ", "_") for figure in found.figures)]
    rows = [
        [method.name, run + 1, *(_cell(figure.values[way, run]) for figure in found.figures)]
        for way, method in enumerate(found.study.methods)
        for run in range(found.study.runs)
    ]
    return formats.csv_text(header, rows)


def times(found: Outcome) -> str:
    """Return mean and standard error of each error at each time."""
    header = ["method", "minutes"]
    for name, unit, _ in ERRORS:
        header += [f"{name}_error_{unit}", f"{name}_standard_error_{unit}"]
    rows = []
    curves = [course_of(found, name, scale) for name, _, scale in ERRORS]
    for way, method in enumerate(found.study.methods):
        for k, time in enumerate(found.time):
            rows.append([method.name, time / 60, *(_cell(curve[way, k]) for both in curves for curve in both)])
    return formats.csv_text(header, rows)


def course_of(found: Outcome, name: str, scale: float) -> tuple[Array, Array]:
    """Return (mean, standard error) of an error over the runs that hold a track, each (ways of following, times)."""
    values = getattr(found.errors, name) * scale
    held = np.isfinite(values)
    many = held.sum(axis=1)
    safe = np.maximum(many, 1)
    mean = np.where(many > 0, np.where(held, values, 0.0).sum(axis=1) / safe, np.nan)
    spread = np.where(held, (values - mean[:, None]) ** 2, 0.0).sum(axis=1) / np.maximum(many - 1, 1)
    return mean, np.where(many > 1, np.sqrt(spread / safe), np.nan)


def _cell(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None


def numbers(found: Outcome) -> dict[str, Any]:
    """Return the same for programs."""
    return {
        "runs": found.study.runs, "particles": found.study.size, "seed": found.study.seed, "sweeps": found.sweeps,
        "figures": [
            {
                "method": method.name, "figure": figure.name, "unit": figure.unit, "mean": _cell(figure.mean()[way]),
                "standard_error": _cell(figure.error()[way]), "runs_without": int(figure.missing()[way]),
                "quantiles": {f"{share:g}": _cell(value) for share, value in zip(QUANTILES, figure.quantiles()[way], strict=True)},
                "published": published(found, way, figure.name), "published_median": published(found, way, f"median {figure.name}"),
            }
            for way, method in enumerate(found.study.methods) for figure in found.figures
        ],
    }  # fmt: skip
