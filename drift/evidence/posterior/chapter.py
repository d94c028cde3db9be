"""Output files of posteriors: tables, numbers of the summary, and pictures.

They are separate from the outputs of the forecast and of the search: a run with steering targets
has priors to report before any search, and a forecast has no updates.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drift.evidence.posterior import ranking, tables
from drift.evidence.posterior.ranking import Ranking
from drift.evidence.posterior.records import Posteriors
from drift.products.files.chapter import Contents, OutputBundle, Stamped, bind_outputs
from drift.products.maps.imprint import Setting
from drift.products.report import leaves

RANKS = 30  # scenarios that the report lists


@dataclass(frozen=True)
class PosteriorOutputs:
    """The data from which the files and pictures are made."""

    posteriors: Posteriors
    setting: Setting


def _draw(matter: PosteriorOutputs, path: Path) -> None:
    # imported here, since importing Matplotlib takes a second
    from drift.evidence.posterior import map as posterior_map

    posterior_map.plot_posteriors(matter.posteriors, path, matter.setting)


def _draw_ranking(ranking: Ranking, setting: Setting, path: Path) -> None:
    from drift.evidence.posterior import scenarios_map

    scenarios_map.plot_scenario_ranking(ranking, path, setting)


FILES: dict[str, Callable[[PosteriorOutputs, Stamped], Contents]] = {
    "posteriors.csv": lambda matter, stamped: tables.csv(matter.posteriors, stamped["run_id"]),
}
PICTURES: dict[str, Callable[[PosteriorOutputs, Path], None]] = {
    "posteriors.png": _draw,
}
# Files of several scenarios after at least one update.
RANKED: dict[str, Callable[[Ranking, Stamped], Contents]] = {
    "scenarios.csv": lambda ranked, stamped: ranking.csv(ranked, stamped["run_id"]),
}
# Pictures of more scenarios than maps show separately, or of families.
MANY: dict[str, Callable[[Ranking, Setting, Path], None]] = {
    "scenarios.png": _draw_ranking,
}


def posterior_bundle(matter: PosteriorOutputs) -> OutputBundle:
    """Return the outputs of posteriors."""
    numbers = tables.summary(matter.posteriors)
    files, pictures = bind_outputs(FILES, matter), bind_outputs(PICTURES, matter)
    ranked = ranking.ranking_of(matter.posteriors)
    if ranked is not None:
        files |= bind_outputs(RANKED, ranked)
        if _many(ranked):
            pictures |= {name: partial(draw, ranked, matter.setting) for name, draw in MANY.items()}
    return OutputBundle(
        numbers, files, pictures, leaves=(partial(_leaves, matter.posteriors, ranked),)
    )


def _many(ranked: Ranking) -> bool:
    """Whether there are families, or more scenarios than are shown separately."""
    return bool(ranked.axes) or ranked.shown.size < len(ranked.prior)


def _leaves(posteriors: Posteriors, ranked: Ranking | None) -> list[Any]:
    columns = [
        ("time", "Time", "time"),
        ("name", "After", "words"),
        ("quantity", "Quantity", "words"),
        ("unit", "Unit", "words"),
        ("value", "Value", "words"),
        ("share", "Share", "share"),
        ("mean", "Mean", "words"),
        ("std", "Standard deviation", "words"),
        ("q05", "5 %", "words"),
        ("q50", "Median", "words"),
        ("q95", "95 %", "words"),
    ]
    note = "All scenarios together; posteriors.csv has those of each."
    quantities = [one.quantity.name for one in posteriors.told]
    shown: list[Any] = []
    if ranked is not None and _many(ranked):
        shown += _ranked(ranked)
        quantities.remove("scenario")
    if quantities:
        where: dict[str, str | list[str]] = {"scenario": "all", "quantity": quantities}
        shown.append(
            leaves.table_leaf(
                "Posteriors besides position",
                columns,
                file="posteriors.csv",
                where=where,
                note=note,
            )
        )
    return shown


def _ranked(ranked: Ranking) -> list[Any]:
    """Return tables of the likeliest scenarios and of the axes of families."""
    columns = [
        ("", "Rank", "count"),
        ("", "Scenario", "words"),
        ("", "Before", "share"),
        ("", "Now", "share"),
        ("", "Factor", "factor"),
        ("", "Together", "share"),
    ]
    first = ranked.order[:RANKS]
    figures = zip(
        *(values[first].tolist() for values in (ranked.prior, ranked.posterior, ranked.factor)),
        np.cumsum(ranked.posterior[first]).tolist(),
        strict=True,
    )
    names = [ranked.posteriors.scenarios[k] for k in first]
    rows = [
        [rank, name, prior, now, factor if math.isfinite(factor) else None, total]
        for rank, (name, (prior, now, factor, total)) in enumerate(
            zip(names, figures, strict=True), 1
        )
    ]
    note = f"{ranked.words}; scenarios.csv has all of them."
    found = [leaves.table_leaf("Scenarios by rank", columns, rows=rows, note=note)]
    by_axis = [
        [along.axis.name, label, prior, now]
        for along in ranked.axes
        for label, prior, now in zip(
            along.axis.labels,
            *(along.shares(p).tolist() for p in (ranked.prior, ranked.posterior)),
            strict=True,
        )
    ]
    if by_axis:
        heads = [
            ("", "Axis", "words"),
            ("", "Value", "words"),
            ("", "Before", "share"),
            ("", "Now", "share"),
        ]
        found.append(
            leaves.table_leaf(
                "Scenarios by axis", heads, rows=by_axis, note="All scenarios that have the axis."
            )
        )
    return found
