"""How likely each line is crossed, and when first, by scenario: what `[[line]]` asks for."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drift.motion.ensemble_spec import EnsembleSpec
from drift.output import formats
from drift.particles import weights
from drift.particles.ensemble import Ensemble
from drift.search.observers import Observer
from drift.search.records import Line
from geo import notation
from geo.array import Array

ALL = "all"
PERCENTS = (5, 50, 95)
BINS = 240  # of the run, in which first crossings are counted
HEADER = [
    "line",
    "scenario",
    "probability",
    "standard_error",
    *(f"first_{percent:02d}" for percent in PERCENTS),
    *(f"date_time_group_{percent:02d}" for percent in PERCENTS),
    "run_id",
]


@dataclass(frozen=True)
class Crossing:
    """First crossings of one line, given all that was seen in the run.

    Arrays have a row for each scenario, then one for all together.
    """

    line: Line
    probability: Array  # (scenarios + 1,) that it is crossed, or touched, in the run
    error: Array  # (scenarios + 1,) standard error of that, of the particles alone
    first: (
        Array  # datetime64[s] (scenarios + 1, 3): times by which 5, 50 and 95 % of the first crossings are; NaT: none
    )
    mass: Array  # (scenarios + 1, BINS): probability of a first crossing by part of the run; adds up to `probability`


@dataclass(frozen=True)
class Crossings:
    """All lines of a run."""

    scenarios: tuple[str, ...]
    edges: Array  # datetime64[s] (BINS + 1,), between the parts of the run
    all: tuple[Crossing, ...] = ()


def build(spec: EnsembleSpec, lines: Sequence[Observer], ensemble: Ensemble) -> Crossings:
    """Return the first crossings of lines by the weights of an ensemble at the end of its run."""
    edges = np.linspace(0, spec.period.duration, BINS + 1)
    weight = weights.normalised(ensemble.log_weight.to_numpy(), ensemble.blocks)
    found = [_crossing(spec, seen, ensemble, weight, edges) for seen in lines]
    times = spec.period.start + np.round(edges).astype("timedelta64[s]")
    return Crossings(tuple(s.name for s in spec.scenarios), times, tuple(found))


def _crossing(spec: EnsembleSpec, seen: Observer, ensemble: Ensemble, weight: Array, edges: Array) -> Crossing:
    assert isinstance(seen.what, Line)
    stayed, when = (column.to_numpy().astype(np.float64) for column in seen.ready(ensemble.n))
    chance = -np.expm1(stayed)
    rows = [*ensemble.scenarios, (0, ensemble.n)]
    probability, error = np.zeros(len(rows)), np.zeros(len(rows))
    mass, first = np.zeros((len(rows), BINS)), np.full((len(rows), len(PERCENTS)), "NaT", "datetime64[s]")
    for row, (a, b) in enumerate(rows):
        total = weight[a:b].sum()
        if total == 0:
            continue
        own = weight[a:b] / total
        probability[row] = own @ chance[a:b]
        error[row] = np.sqrt((own**2) @ (chance[a:b] - probability[row]) ** 2)
        hit = when[a:b] >= 0
        counted = own[hit].sum()
        if counted == 0:
            continue
        # Times are drawn, so that they say how the probability is spread, and the probability itself how much there is.
        mass[row] = np.histogram(when[a:b][hit], edges, weights=own[hit])[0] * probability[row] / counted
        order = np.argsort(when[a:b][hit], kind="stable")
        running = np.cumsum(own[hit][order]) / counted
        at = np.minimum(np.searchsorted(running, np.array(PERCENTS) / 100), order.size - 1)
        first[row] = spec.period.start + np.round(when[a:b][hit][order][at]).astype("timedelta64[s]")
    return Crossing(seen.what, probability, error, first, mass)


def csv(crossings: Crossings | None, run: str) -> str:
    """Return a row for each line and scenario, and one for all together, as CSV; empty: it is not crossed."""
    rows = []
    assert crossings is not None
    for crossing in crossings.all:
        for row, scenario in enumerate([*crossings.scenarios, ALL]):
            times = [None if np.isnat(time) else time for time in crossing.first[row]]
            rows.append(
                [
                    crossing.line.name,
                    scenario,
                    f"{crossing.probability[row]:.6g}",
                    f"{crossing.error[row]:.2g}",
                    *("" if time is None else notation.iso(time) for time in times),
                    *("" if time is None else notation.group(time) for time in times),
                    run,
                ]
            )
    return formats.csv_text(HEADER, rows)


def numbers(crossings: Crossings) -> list[dict[str, Any]]:
    """Return the same for the summary, by line."""
    return [
        {
            "name": crossing.line.name,
            "probability": {
                ALL: float(crossing.probability[-1]),
                "scenarios": dict(zip(crossings.scenarios, crossing.probability[:-1].tolist(), strict=True)),
            },
            "standard_error": float(crossing.error[-1]),
            "first": {
                f"{percent} %": None if np.isnat(time) else time
                for percent, time in zip(PERCENTS, crossing.first[-1], strict=True)
            },
        }
        for crossing in crossings.all
    ]
