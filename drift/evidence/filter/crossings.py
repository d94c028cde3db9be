"""Probability and time of the first crossing of each `[[line]]`, by scenario."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.particles import partials, weights
from drift.engine.particles.columns import Columns
from drift.engine.particles.weights import Unit
from drift.evidence.filter.records import Line
from drift.products.files import formats
from geo import notation
from geo.array import Array

ALL = "all"
PERCENTS = (5, 50, 95)
BINS = 240  # parts of the run, in which first crossings are counted
PARTS = 10  # parts of each bin, for the resolution of percentiles


@dataclass(frozen=True)
class Crossing:
    """First crossings of one line, given all evidence of the run.

    Arrays have one row per scenario, then one for all together.
    """

    line: Line
    probability: Array  # (scenarios + 1,) that it is crossed, or touched, in the run
    error: Array  # (scenarios + 1,) Monte Carlo standard error of `probability`
    first: (
        # datetime64[s] (scenarios + 1, 3): 5, 50 and 95 % quantiles of the time of first crossing;
        # NaT: no crossing
        Array
    )
    # (scenarios + 1, BINS): probability of a first crossing by part of the run; adds up to
    # `probability`
    mass: Array


@dataclass(frozen=True)
class Crossings:
    """All lines of a run."""

    scenarios: tuple[str, ...]
    edges: Array  # datetime64[s] (BINS + 1,), between the parts of the run
    all: tuple[Crossing, ...] = ()


class Watched(NamedTuple):
    """A line and its observations of the particles by the end of the run.

    See drift.evidence.filter.observers.
    """

    line: Line
    stayed: Array  # float32 (n,) log of the probability that each has not crossed it
    when: Array  # float32 (n,) [s after start] when it first did, -1: never


def columns_of(watched: Sequence[Watched]) -> dict[str, Array]:
    """Return the observations of lines as columns for `build_crossings`."""
    return {
        _column_of(k, name): getattr(seen, name)
        for k, seen in enumerate(watched)
        for name in ("stayed", "when")
    }


def _column_of(number: int, name: str) -> str:
    """Return the name of a column of a line, given the number of the line."""
    return f"line {number} {name}"


def build_crossings(spec: EnsembleSpec, lines: Sequence[Line], columns: Columns) -> Crossings:
    """Return the first crossings of lines.

    Args:
        spec: scenarios and period of the run.
        lines: the lines of the case.
        columns: the columns of `columns_of` and `log_weight` at the end of the run.
    """
    unit = weights.normalising_scale(columns, "log_weight")
    found = [_crossing(spec, line, number, columns, unit) for number, line in enumerate(lines)]
    edges = np.round(np.linspace(0, spec.period.duration, BINS + 1)).astype("timedelta64[s]")
    return Crossings(tuple(s.name for s in spec.scenarios), spec.period.start + edges, tuple(found))


def _crossing(
    spec: EnsembleSpec, line: Line, number: int, columns: Columns, unit: Unit
) -> Crossing:
    moments, times_drawn = [], []
    names = (_column_of(number, name) for name in ("stayed", "when"))
    for blocks, log_weight, *seen in columns.parts("log_weight", *names):
        stayed, when = (column.astype(np.float64) for column in seen)
        # 0.0 - ... avoids -0 for particles that never cross
        weight, chance = unit.shares(log_weight), 0.0 - np.expm1(stayed)
        square = weight**2
        moments.append(
            blocks.partial(weight, weight * chance, square, square * chance, square * chance**2)
        )
        # Crossing times are sampled. They give the distribution over time; its total is the
        # probability, which is computed without sampling.
        share = np.minimum(when / spec.period.duration * PARTS * BINS, PARTS * BINS - 1)
        bins = np.where(when < 0, PARTS * BINS, share).astype(np.int64)
        times_drawn.append(blocks.partial(weight, code=bins, many=PARTS * BINS + 1))
    sums = partials.merge_partials(moments)
    total, hit, squares, cross, both = np.concatenate([sums.by_scenario[:, 0], sums.total]).T
    probability = _ratio(hit, total)
    spread = both - 2 * probability * cross + probability**2 * squares
    error = _ratio(np.sqrt(np.maximum(spread, 0.0)), total)
    first_times = partials.merge_partials(times_drawn)
    spread_out = np.concatenate(
        [first_times.by_scenario[:, :-1, 0], first_times.total[None, :-1, 0]]
    )
    share = _ratio(spread_out, spread_out.sum(axis=1)[:, None])
    mass = (share * probability[:, None]).reshape(-1, BINS, PARTS).sum(axis=2)
    first = np.stack([_times(spec, row) for row in share])
    return Crossing(line, probability, error, first, mass)


def _ratio(over: Array, under: Array) -> Array:
    """Return a quotient, 0 where the divisor is 0."""
    return np.asarray(np.divide(over, under, out=np.zeros(over.shape), where=under > 0))


def _times(spec: EnsembleSpec, share: Array) -> Array:
    """Return the PERCENTS quantiles of the first crossing, from shares by part of the run."""
    if share.sum() == 0:
        return np.full(len(PERCENTS), "NaT", "datetime64[s]")
    edges, running = (
        np.linspace(0, spec.period.duration, share.size + 1),
        np.append(0.0, np.cumsum(share)),
    )
    rises = np.append(True, np.diff(running) > 0)
    at = np.interp(np.array(PERCENTS) / 100, running[rises], edges[rises])
    return np.asarray(spec.period.start + np.round(at).astype("timedelta64[s]"))


def csv(crossings: Crossings | None, run: str) -> str:
    """Return the CSV of crossings: a row per line and scenario, and one for all together.

    Times are empty if the line is not crossed.
    """
    rows = []
    assert crossings is not None
    for crossing in crossings.all:
        for row, scenario in enumerate([*crossings.scenarios, ALL]):
            own: dict[str, Any] = {
                "line": crossing.line.name,
                "scenario": scenario,
                "probability": crossing.probability[row],
                "standard_error": f"{crossing.error[row]:.2g}",
            }
            times = dict(zip(PERCENTS, crossing.first[row], strict=True))
            own |= {f"first_{percent:02d}": time for percent, time in times.items()}
            own |= {
                f"date_time_group_{percent:02d}": ""
                if np.isnat(time)
                else notation.format_dtg(time)
                for percent, time in times.items()
            }
            rows.append(own)
    return formats.csv_rows(rows, run=run, digits=".6g")


def summary_of_crossings(crossings: Crossings) -> list[dict[str, Any]]:
    """Return the crossings for the summary, one entry per line."""
    return [
        {
            "name": crossing.line.name,
            "probability": {
                ALL: float(crossing.probability[-1]),
                "scenarios": dict(
                    zip(crossings.scenarios, crossing.probability[:-1].tolist(), strict=True)
                ),
            },
            "standard_error": float(crossing.error[-1]),
            "first": {
                f"{percent} %": None if np.isnat(time) else time
                for percent, time in zip(PERCENTS, crossing.first[-1], strict=True)
            },
        }
        for crossing in crossings.all
    ]
