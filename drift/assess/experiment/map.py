"""The picture of an experiment.

For a tracking case: the errors of each method over time, beside published values. Otherwise: each
run's figures.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from drift.assess.experiment import text
from drift.assess.experiment.record import Experiment
from drift.products.maps import page, sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Row, Sheet
from drift.tracking.tracker.experiment import Outcome
from drift.tracking.tracker.study import MET

# [in] width of the page, height of a panel with its gap, height of a line of the legend
WIDTH, PANEL, KEY = 11.7, 2.1, 0.21
COLOURS = ("#0b4f8a", "#b3261e", "#1b5e20", "#8a5a00", "#6a3d9a", "#00838f", "#37474f", "#c2185b")
MANY = 0.5  # share of the runs that must hold a track at a time for the mean to be drawn
DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)), (0, (1, 1)))


def plot_experiment(found: Experiment, path: Path, imprint: Imprint) -> None:
    """Draw an experiment into a PNG: errors over time of a tracking case, or each run's figures."""
    if found.tracking is None:
        _scatter(found, path, imprint)
    else:
        _curves(found, found.tracking, path, imprint)


def _scatter(found: Experiment, path: Path, imprint: Imprint) -> None:
    """Draw each figure of each variant: runs as dots, with their mean and two standard errors."""
    row, gap = 0.24, 0.62  # [in]
    each = row * len(found.ways) + gap
    height = 1.0 + each * max(len(found.figures), 1) + 0.45
    on = sheet.begin_page(
        Sheet(
            WIDTH,
            height,
            130,
            left=0.03,
            title=sheet.heading(1 - 0.4 / height, 15),
            lines=(Row(1 - 0.68 / height, 10),),
            footer=sheet.small(0.1 / height, 7.5),
        )
    )
    sheet.write_head(
        on,
        imprint,
        f"{found.runs:,} runs, each of {found.about}: dots are runs, bars the mean and two "
        "standard errors"
        + (
            "; at the right the difference from the first, run by run"
            if len(found.ways) > 1
            else ""
        ),
    )
    for number, figure in enumerate(found.figures):
        bottom = 1 - (1.0 + each * number + gap * 0.4 + row * len(found.ways)) / height
        axes: Axes = on.figure.add_axes(
            (0.2, bottom, 0.76 if len(found.ways) == 1 else 0.63, row * len(found.ways) / height)
        )
        _dress(axes, figure.name)
        mean, error = figure.mean(), figure.error()
        for k in range(len(found.ways)):
            colour = COLOURS[k % len(COLOURS)]
            axes.plot(
                figure.values[k], np.full(found.runs, k), ".", color=colour, alpha=0.5, markersize=5
            )
            axes.text(
                1.02,
                k,
                text.difference_from_first(figure, k),
                fontsize=8.5,
                color=INK,
                va="center",
                transform=axes.get_yaxis_transform(),
            )
            axes.errorbar(
                mean[k],
                k,
                xerr=2 * np.nan_to_num(error[k]),
                fmt="|",
                color=INK,
                markersize=11,
                capsize=0,
            )
        axes.set_ylim(len(found.ways) - 0.4, -0.6)
        axes.set_yticks(range(len(found.ways)), page.shorten_names(found.ways, 26))
    with page.literal_text():
        sheet.finish_page(on, path, imprint)


def _curves(experiment: Experiment, outcome: Outcome, path: Path, imprint: Imprint) -> None:
    """Draw the errors of a tracking case over time, and how often areas hold the target."""
    groups = text.groups_of_equal_ways(experiment, curves=True)
    met = next((figure for figure in outcome.figures if figure.name == MET), None)
    panels = len(outcome.curves) + (met is not None)
    over, under = 1.05, 0.75 + KEY * (len(groups) + 2)
    height = over + panels * PANEL + under
    on = sheet.begin_page(
        Sheet(
            WIDTH,
            height,
            130,
            left=0.07,
            title=sheet.heading(1 - 0.4 / height, 15),
            lines=(Row(1 - 0.68 / height, 10),),
            footer=sheet.small(0.1 / height, 7.5),
        )
    )
    study = outcome.study
    sheet.write_head(
        on,
        imprint,
        f"{study.runs:,} runs of {study.size:,} particles, {outcome.sweeps:,} sweeps each: mean "
        "over the runs that hold a track, at times when at least half do; shaded: one standard error "
        "on either side",
    )
    styles = _styles(outcome, groups)
    symbols: list[tuple[Any, str]] = []
    for number, curve in enumerate(outcome.curves):
        axes = _panel(
            on, height, over, number, f"{curve.name[0].upper()}{curve.name[1:]} [{curve.unit}]"
        )
        mean, error = curve.mean()
        mean = np.where(np.isfinite(curve.values).mean(axis=1) >= MANY, mean, np.nan)
        for group, (colour, dash) in zip(groups, styles, strict=True):
            (line,) = axes.plot(
                outcome.time / 60, mean[group[0]], color=colour, linestyle=dash, linewidth=1.5
            )
            axes.fill_between(
                outcome.time / 60,
                mean[group[0]] - error[group[0]],
                mean[group[0]] + error[group[0]],
                color=colour,
                alpha=0.18,
                linewidth=0,
            )
            values = [
                v
                for way in group
                if (v := text.published_value(experiment, way, curve.name)) is not None
            ]
            if values:
                axes.plot(
                    [1.012],
                    [np.mean(values)],
                    marker="<",
                    color=colour,
                    markersize=6,
                    transform=axes.get_yaxis_transform(),
                    clip_on=False,
                )
            if number == 0:
                symbols.append((line, text.group_name(experiment, group)))
        axes.set_ylim(0, None if curve.right is None else 100)
        if curve.right is not None:
            axes.axhline(curve.right, color=GREY, linewidth=0.9, zorder=1)
        _window(axes, outcome)
        if number < len(outcome.curves) - 1:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel("Minutes after the start", fontsize=9, color=INK)
    if met is not None:
        axes = _panel(on, height, over + 0.3, panels - 1, "Criteria met [% of runs]")
        ended = met.values[np.isfinite(met.values)]
        last = max(min(1.05 * float(ended.max(initial=0.0)), study.end / 60), study.every / 60)
        for group, (colour, dash) in zip(groups, styles, strict=True):
            times = np.sort(met.values[group[0]][np.isfinite(met.values[group[0]])])
            share = 100 * np.arange(1, len(times) + 1) / study.runs
            axes.step(
                np.concatenate([[0], times, [max(last, times.max(initial=0.0))]]),
                np.concatenate([[0], share, share[-1:] if share.size else [0]]),
                where="post",
                color=colour,
                linestyle=dash,
                linewidth=1.5,
            )
            for middle in [
                v
                for way in group
                if (v := text.published_value(experiment, way, f"median {MET}")) is not None
            ]:
                axes.plot([middle], [50], marker="v", color=colour, markersize=6)
        axes.set_xlim(0, last)
        axes.set_ylim(0, 100)
        axes.set_xlabel("Minutes after the start", fontsize=9, color=INK)
    names = {name for figures in study.published.values() for name in figures}
    for marker, some, statistic in (
        ("<", names - {f"median {MET}"}, "mean"),
        ("v", names & {f"median {MET}"}, "median"),
    ):
        if some:
            symbols.append(
                (
                    axes.plot([], [], marker=marker, color=GREY, linestyle="none")[0],
                    f"published {statistic}",
                )
            )
    if np.isfinite(study.window[1]) or study.window[0] > 0:
        symbols.append(
            (
                axes.axvspan(np.nan, np.nan, color="#e8eef4"),
                "time over which the table's figures are averaged",
            )
        )
    sheet.legend(
        on.figure,
        symbols,
        loc="lower left",
        bbox_to_anchor=(0.06, 0.28 / height),
        fontsize=8.5,
        handlelength=3.2,
    )
    with page.literal_text():
        sheet.finish_page(on, path, imprint)


def _styles(outcome: Outcome, groups: list[list[int]]) -> list[tuple[str, Any]]:
    """Return colour and dashes of each group: colour by behaviour, dashes within a behaviour."""
    laws = [outcome.study.methods[group[0]].behaviour for group in groups]
    known = list(dict.fromkeys(laws))
    return [
        (COLOURS[known.index(law) % len(COLOURS)], DASHES[laws[:k].count(law) % len(DASHES)])
        for k, law in enumerate(laws)
    ]


def _panel(on: sheet.Page, height: float, over: float, number: int, title: str) -> Axes:
    bottom = 1 - (over + (number + 1) * PANEL - 0.12) / height
    axes: Axes = on.figure.add_axes((0.07, bottom, 0.89, (PANEL - 0.3) / height))
    _dress(axes, title)
    return axes


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=9.5, color=INK, loc="left", pad=3)
    axes.tick_params(labelsize=8.5, colors=INK)
    axes.grid(color="#d5dde5", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _window(axes: Axes, outcome: Outcome) -> None:
    """Shade the time over which figures are averaged, unless it is the whole run."""
    axes.set_xlim(0, outcome.study.end / 60)
    low, high = outcome.study.window
    if np.isfinite(high) or low > 0:
        axes.axvspan(low / 60, min(high, outcome.study.end) / 60, color="#e8eef4", zorder=0)
