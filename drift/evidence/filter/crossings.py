"""How likely each line is crossed, and when first, by scenario: what `[[line]]` asks for."""

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
PARTS = 10  # parts of each, between which percentiles are told
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
        # datetime64[s] (scenarios + 1, 3): times by which 5, 50 and 95 % of the first crossings
        # are; NaT: none
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
    """A line, and what it has seen of particles by the end of the run: see
    drift.evidence.filter.observers.
    """

    line: Line
    stayed: Array  # float32 (n,) log of the probability that each has not crossed it
    when: Array  # float32 (n,) [s after start] when it first did, -1: never


def columns_of(watched: Sequence[Watched]) -> dict[str, Array]:
    """Return what lines have seen as columns, as `build` takes them."""
    return {
        column_of(k, name): getattr(seen, name)
        for k, seen in enumerate(watched)
        for name in ("stayed", "when")
    }


def column_of(number: int, name: str) -> str:
    """Return what the column of a line, by its number, is called."""
    return f"line {number} {name}"


def build_crossings(spec: EnsembleSpec, lines: Sequence[Line], columns: Columns) -> Crossings:
    """Return the first crossings of lines by what they saw of particles and by their `log_weight`
    at the end of the run.
    """
    unit = weights.unit(columns, "log_weight")
    found = [_crossing(spec, line, number, columns, unit) for number, line in enumerate(lines)]
    edges = np.round(np.linspace(0, spec.period.duration, BINS + 1)).astype("timedelta64[s]")
    return Crossings(tuple(s.name for s in spec.scenarios), spec.period.start + edges, tuple(found))


def _crossing(
    spec: EnsembleSpec, line: Line, number: int, columns: Columns, unit: Unit
) -> Crossing:
    told, drawn = [], []
    names = (column_of(number, name) for name in ("stayed", "when"))
    for blocks, log_weight, *seen in columns.parts("log_weight", *names):
        stayed, when = (column.astype(np.float64) for column in seen)
        # no crossing is told as -0
        weight, chance = unit.shares(log_weight), 0.0 - np.expm1(stayed)
        square = weight**2
        told.append(
            blocks.partial(weight, weight * chance, square, square * chance, square * chance**2)
        )
        # Times are drawn: they say how the probability is spread, and the probability itself how
        # much there is.
        share = np.minimum(when / spec.period.duration * PARTS * BINS, PARTS * BINS - 1)
        bins = np.where(when < 0, PARTS * BINS, share).astype(np.int64)
        drawn.append(blocks.partial(weight, code=bins, many=PARTS * BINS + 1))
    sums = partials.merged(told)
    total, hit, squares, cross, both = np.concatenate([sums.by_scenario[:, 0], sums.total]).T
    probability = _ratio(hit, total)
    spread = both - 2 * probability * cross + probability**2 * squares
    error = _ratio(np.sqrt(np.maximum(spread, 0.0)), total)
    first_times = partials.merged(drawn)
    spread_out = np.concatenate(
        [first_times.by_scenario[:, :-1, 0], first_times.total[None, :-1, 0]]
    )
    share = _ratio(spread_out, spread_out.sum(axis=1)[:, None])
    mass = (share * probability[:, None]).reshape(-1, BINS, PARTS).sum(axis=2)
    first = np.stack([_times(spec, row) for row in share])
    return Crossing(line, probability, error, first, mass)


def _ratio(over: Array, under: Array) -> Array:
    """Return a quotient, 0 where there is nothing below."""
    return np.asarray(np.divide(over, under, out=np.zeros(over.shape), where=under > 0))


def _times(spec: EnsembleSpec, share: Array) -> Array:
    """Return the times by which PERCENTS of the first crossings are, from their shares by part of
    the run.
    """
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
    """Return a row for each line and scenario, and one for all together, as CSV; empty: it is not
    crossed.
    """
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


def summary_of_crossings(crossings: Crossings) -> list[dict[str, Any]]:
    """Return the same for the summary, by line."""
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
