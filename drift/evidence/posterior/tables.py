"""Posteriors as a table, and as numbers for the summary."""

import math
from typing import Any

import numpy as np

from drift.evidence.posterior import ranking
from drift.evidence.posterior.marginal import LEVELS, Marginal
from drift.evidence.posterior.records import Posteriors, RangedQuantity
from drift.forecast import likeliest
from drift.forecast.likeliest import Shown
from drift.products.files import formats
from geo import notation

ALL = "all"
QUANTILES = [f"q{100 * level:02.0f}" for level in LEVELS]
HOUR = 3600.0
# a scenario below this probability at all stages has no rows of its own
LEAST = 0.01


def csv(posteriors: Posteriors, run: str) -> str:
    """Return the CSV of posteriors: a row per update, quantity and scenario, and one for all.

    A category has one row per value. A scenario without a quantity has no row of it, and a scenario
    that never has a probability of LEAST has no rows. Times are ISO 8601, and their standard
    deviation is in hours.

    Args:
        posteriors: of the run.
        run: the run_id for the last column.
    """
    return formats.csv_rows(
        [
            {
                "update": stage.number,
                "name": stage.name,
                "kind": stage.kind,
                "time": stage.time,
                "date_time_group": notation.format_dtg(stage.time),
                "quantity": told.quantity.name,
                "unit": unit(told),
                "scenario": scenario,
                **cells,
                "ess": stage.marginals[k].ess[row],
            }
            for stage in posteriors.stages
            for k, told in enumerate(posteriors.told)
            for row, scenario in _scenarios(posteriors, k)
            for cells in _cells(posteriors, told, stage.marginals[k], row)
        ],
        run=run,
        digits=".7g",
    )


def unit(told: RangedQuantity) -> str:
    """Return the unit of a quantity in files; for times, that of their standard deviation."""
    return "h" if told.quantity.kind == "time" else told.quantity.unit


def _scenarios(posteriors: Posteriors, k: int) -> list[tuple[int, str]]:
    """Return rows and names of the scenarios that have quantity k, and of all together."""
    ever = np.any(
        [np.nan_to_num(stage.marginals[k].share) > 0 for stage in posteriors.stages], axis=0
    )
    ever[:-1] &= np.max([stage.scenarios for stage in posteriors.stages], axis=0) >= LEAST
    names = posteriors.scenarios
    # the row of all together is then enough
    single = len(names) == 1 or posteriors.told[k].quantity.by_scenario
    return [(j, name) for j, name in enumerate(names) if ever[j] and not single] + [
        (len(names), ALL)
    ]


def _cells(
    posteriors: Posteriors, told: RangedQuantity, found: Marginal, row: int
) -> list[dict[str, Any]]:
    """Return value, share, mean, std and quantiles of a row of a marginal, by column.

    A category has one such row per value.
    """
    if told.quantity.kind == "category":
        shares = zip(
            told.labels, found.table[-1 if told.quantity.by_scenario else row], strict=True
        )
        without = dict.fromkeys(("mean", "std", *QUANTILES), "")
        return [{"value": label, "share": share, **without} for label, share in shares]
    assert found.mean is not None
    assert found.std is not None
    assert found.quantiles is not None
    std = (
        found.std[row] / HOUR
        if told.quantity.kind == "time"
        else found.std[row] * told.quantity.scale
    )
    quantiles = zip(QUANTILES, found.quantiles[row], strict=True)
    return [
        {
            "value": "",
            "share": found.share[row],
            "mean": _written(posteriors, told, found.mean[row]),
            "std": std,
            **{name: _written(posteriors, told, value) for name, value in quantiles},
        }
    ]


def _written(posteriors: Posteriors, told: RangedQuantity, value: float) -> str:
    """Return a value of a quantity as text for files; empty if it is NaN."""
    if not math.isfinite(value):
        return ""
    if told.quantity.kind == "time":
        return notation.iso(moment(posteriors, value))
    return _text(value * told.quantity.scale)


def moment(posteriors: Posteriors, elapsed: float) -> np.datetime64:
    """Return the time at a number of seconds after the start of the run."""
    return posteriors.period.time(round(elapsed))


def summary(posteriors: Posteriors) -> dict[str, Any]:
    """Return the posteriors and the ranking of scenarios for the summary."""
    ranked = ranking.ranking_of(posteriors)
    return {
        "posteriors": summary_of_posteriors(posteriors),
        **({"stories": ranking.summary_of_ranking(ranked)} if ranked else {}),
    }


def summary_of_posteriors(posteriors: Posteriors) -> list[dict[str, Any]]:
    """Return the distributions of all scenarios together, for the summary.

    With many scenarios, the unlikely ones are merged into one.
    """
    shown = likeliest.likeliest_scenarios([stage.scenarios for stage in posteriors.stages])
    return [
        {
            "update": stage.number,
            "name": stage.name,
            "kind": stage.kind,
            "time": stage.time,
            "quantities": {
                told.quantity.name: _numbers(posteriors, told, found, shown)
                for told, found in zip(posteriors.told, stage.marginals, strict=True)
            },
        }
        for stage in posteriors.stages
    ]


def _numbers(
    posteriors: Posteriors, told: RangedQuantity, found: Marginal, shown: Shown
) -> dict[str, Any]:
    share = {"share": float(found.share[-1]), "ess": float(found.ess[-1])}
    if told.quantity.kind == "category":
        labels, values = told.labels, found.table[-1]
        if told.quantity.name == "scenario":
            labels, values = tuple(shown.names(labels)), shown.sums(values)
        return {**share, "values": dict(zip(labels, values.tolist(), strict=True))}
    assert found.mean is not None
    assert found.std is not None
    assert found.quantiles is not None
    time = told.quantity.kind == "time"

    def value(number: float) -> Any:
        if not time:
            return float(number * told.quantity.scale)
        return moment(posteriors, number) if math.isfinite(number) else None

    std = found.std[-1] * (1 / HOUR if time else told.quantity.scale)
    quantiles = {
        name: value(number) for name, number in zip(QUANTILES, found.quantiles[-1], strict=True)
    }
    return {
        **share,
        "unit": unit(told),
        "mean": value(found.mean[-1]),
        "std": float(std),
        **quantiles,
    }


def _text(value: float) -> str:
    """Return a number for CSV; empty if it is unknown."""
    return f"{float(value):.7g}" if np.isfinite(value) else ""
