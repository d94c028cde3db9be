"""The picture of scenarios by rank, readable for any number of scenarios.

The left chart has the likeliest scenarios as bars, all others together as the last bar, and the
prior of each. Beside it are, for families, the probabilities of the values on each axis.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from drift.engine.motion.steering.family import Along
from drift.evidence.posterior.ranking import Ranking
from drift.forecast import effective
from drift.products.maps import labels, page, sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Setting
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation
from geo.array import Array

BEFORE, NOW, LIGHT = "#aab4bd", "#3d7ab5", "#e3e8ec"
ROW, HEAD, FOOT = 0.36, 1.42, 0.86  # [in]: of a scenario, over and under the charts
NAMES, BARS, FIGURES = 3.15, 2.7, 1.75  # [in]: names, bars, and the figures beside them
LETTERS = 38  # of a name
AXIS, BESIDE = 2.9, 0.4  # [in]: width of an axis' chart, gap between charts
TALL, OVER, BASE = 1.2, 0.3, 0.22  # [in]: least height of an axis' chart, gap, under the bars
LETTER = 0.043  # [in] of a value's name, slanted
WORD = 15  # letters of a value's name
ACROSS = 2  # charts of axes beside each other
AXES = 6  # most axes; if there are more, the first ones
NAMED = 12  # most values on an axis with all names; otherwise every second, third, ..
GRID = "#c9d1d8"


def plot_scenario_ranking(ranking: Ranking, path: Path, setting: Setting) -> None:
    """Draw the scenarios of a run by rank."""
    axes = ranking.axes[:AXES]
    columns = min(ACROSS, len(axes))
    lines = -(-len(axes) // ACROSS)
    rows = ranking.shown.size
    under = max((_height_below(along) for along in axes), default=0.0)
    tall = max(rows * ROW + BASE, lines * (TALL + under + OVER))
    width = max(0.3 + NAMES + BARS + FIGURES + columns * (AXIS + BESIDE) + 0.2, 9.5)
    height = HEAD + tall + FOOT
    on = sheet.begin_page(
        Sheet(
            width,
            height,
            120,
            left=0.28 / width,
            title=sheet.heading(1 - 0.4 / height, 14),
            lines=(Row(1 - 0.68 / height, 9.5),),
            caution=Badge(1 - 0.2 / width, 1 - 0.4 / height, side="right"),
            rough=Badge(3.3 / width, 1 - 0.86 / height, 8),
            footer=sheet.small(0.09 / height, 7),
        )
    )
    sheet.write_head(on, setting.imprint, ranking.words)
    count = effective.Count(ranking.posteriors.stages[-1].ess, setting.particles)
    if count.few:
        sheet.draw_rough_banner(on, effective.banner(count, "probabilities are rough"))
    key: list[tuple[Any, str]] = [
        (Patch(color=NOW), "now"),
        (Line2D([], [], color=INK, linewidth=2.2), "before the first update"),
    ]
    at = {
        "loc": "upper left",
        "bbox_to_anchor": (0.28 / width, 1 - 0.78 / height),
        "borderaxespad": 0,
        "borderpad": 0,
    }
    sheet.legend(on.figure, key, ncols=2, fontsize=8.5, **at)
    bottom = (FOOT + tall - rows * ROW) / height
    ax = on.figure.add_axes(((0.3 + NAMES) / width, bottom, BARS / width, rows * ROW / height))
    _ranks(ax, ranking)
    for k, along in enumerate(axes):
        line, column = divmod(k, ACROSS)
        left = 0.3 + NAMES + BARS + FIGURES + BESIDE + column * (AXIS + BESIDE)
        high = tall / lines - under - OVER
        base = FOOT + tall - (line + 1) * (tall / lines) + OVER + under
        _axis(
            on.figure.add_axes((left / width, base / height, AXIS / width, high / height)),
            along,
            ranking,
        )
    words = "Effective scenarios: exp of the entropy of their probabilities. All scenarios by rank: scenarios.csv."
    if len(ranking.axes) > AXES:
        words += f" {len(ranking.axes) - AXES} more axes: posteriors.csv."
    on.figure.text(0.28 / width, 0.33 / height, words, fontsize=8, color=GREY, va="center")
    sheet.finish_page(on, path, setting.imprint)


def _ranks(ax: Axes, ranking: Ranking) -> None:
    """Draw the likeliest scenarios, and all others together."""
    shown, names = ranking.shown, ranking.posteriors.scenarios
    alone = [k for k in ranking.order.tolist() if k in shown.alone]
    rest = [k for k in ranking.order.tolist() if k not in shown.alone]
    prior, now = (
        [*(float(values[k]) for k in alone)] for values in (ranking.prior, ranking.posterior)
    )
    bar_names = page.shorten_names([names[k] for k in alone], LETTERS)
    if rest:
        prior.append(float(ranking.prior[rest].sum()))
        now.append(float(ranking.posterior[rest].sum()))
        bar_names.append(f"{len(rest):,} others together")
    top = max([*prior[: len(alone)], *now[: len(alone)]]) * 1.02  # the bar of others may be cut
    y = np.arange(len(now))
    ax.barh(
        y, np.minimum(now, top), 0.62, color=[NOW] * len(alone) + [BEFORE] * bool(rest), zorder=3
    )
    known = np.array(prior) <= top
    ax.vlines(
        np.array(prior)[known], y[known] - 0.4, y[known] + 0.4, color=INK, linewidth=2.2, zorder=4
    )
    for k in np.flatnonzero(np.maximum(prior, now) > top).tolist():
        ax.text(
            top * 0.99,
            k,
            "›",
            fontsize=13,
            weight="bold",
            color=INK,
            ha="right",
            va="center_baseline",
            zorder=5,
        )
    ax.set_xlim(0, top)
    ax.set_ylim(len(now) - 0.5, -0.5)
    ax.set_yticks(y, bar_names, fontsize=8.5, color=INK)
    ax.set_title(
        "Likeliest scenarios [%]", fontsize=10, weight="bold", color=INK, loc="left", pad=7
    )
    for k, (before, after) in enumerate(zip(prior, now, strict=True)):
        ax.text(top * 1.03, k - 0.17, notation.percent(after), fontsize=9, color=INK, va="center")
        factor = f", × {_factor(after / before)}" if before > 0 else ""
        ax.text(
            top * 1.03,
            k + 0.22,
            f"{notation.percent(before)} before{factor}",
            fontsize=7,
            color=GREY,
            va="center",
        )
    _plain(ax, "x")


def _factor(value: float) -> str:
    return f"{value:.3g}" if value < 999.5 else labels.number(value)


def _axis(ax: Axes, along: Along, ranking: Ranking) -> None:
    """Draw the probability of each value on an axis."""
    prior, now = along.shares(ranking.prior), along.shares(ranking.posterior)
    x = np.arange(len(now))
    ax.bar(x, now, 0.76, color=NOW, zorder=3)
    ax.hlines(
        prior, x - 0.44, x + 0.44, color=INK, linewidth=1.8 if len(now) <= 40 else 0.8, zorder=4
    )
    top = 1.18 * float(max(prior.max(), now.max()))
    ax.set_ylim(0, top)
    ax.set_xlim(-0.6, len(now) - 0.4)
    if len(now) <= NAMED:
        for k, value in enumerate(np.maximum(now, prior).tolist()):
            ax.text(
                k,
                value + 0.02 * top,
                notation.percent(float(now[k]), 0, ""),
                fontsize=7,
                color=INK,
                ha="center",
                va="bottom",
            )
    value_names, step = page.shorten_names(list(along.axis.labels), WORD), -(-len(now) // NAMED)
    aslant: dict[str, Any] = (
        {"rotation": 45, "ha": "right", "rotation_mode": "anchor"}
        if _names_are_slanted(along)
        else {}
    )
    ax.set_xticks(x[::step], value_names[::step], fontsize=7, color=INK, **aslant)
    ax.set_title(
        page.fit(f"By {along.axis.name} [%]", 28),
        fontsize=9,
        weight="bold",
        color=INK,
        loc="left",
        pad=7,
    )
    if 0 < prior.sum() < 1 - 1e-9:
        words = f"in all {notation.percent(float(now.sum()))}, {notation.percent(float(prior.sum()))} before"
        ax.set_title(words, fontsize=7, color=GREY, loc="right", pad=7)
    _plain(ax, "y")


def _names_are_slanted(along: Along) -> bool:
    """Whether the names of values are too long to be horizontal."""
    names = [label[:WORD] for label in along.axis.labels]
    return len(names) > 6 or sum(map(len, names)) > 30


def _height_below(along: Along) -> float:
    """Return the height [in] of the names of values under a chart."""
    return 0.2 + (
        LETTER * min(max(map(len, along.axis.labels)), WORD) if _names_are_slanted(along) else 0.0
    )


def _plain(ax: Axes, values: str) -> None:
    """Remove all spines of a chart except its base, and draw grid lines at round values."""
    for name, spine in ax.spines.items():
        spine.set(visible=name == ("left" if values == "x" else "bottom"), color=INK, linewidth=0.8)
    along = ax.xaxis if values == "x" else ax.yaxis
    marks = _round(float((ax.get_xlim() if values == "x" else ax.get_ylim())[1]))
    along.set_ticks(marks, [f"{100 * mark:g}" for mark in marks], fontsize=7, color=GREY)
    ax.tick_params(length=0)
    ax.grid(axis="x" if values == "x" else "y", color=GRID, linewidth=0.5, zorder=0)
    ax.set_axisbelow(True)


def _round(top: float) -> Array:
    """Return round shares from 0 to a share."""
    steps = [m * 10.0**k for k in range(-8, 1) for m in (1, 2, 5)]
    step = next((step for step in steps if top / step <= 5), 0.5)
    return np.arange(0, top + 1e-12, step)
