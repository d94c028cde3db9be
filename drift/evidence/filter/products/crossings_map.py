"""The picture of lines: the probability of having crossed each by time, by scenario."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from drift.evidence.filter.crossings import Crossing, Crossings
from drift.evidence.filter.products import particles_left
from drift.evidence.filter.products.evidence_map import STROKES
from drift.evidence.filter.updates import Updates
from drift.forecast import effective
from drift.products.maps import labels, page, sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Setting
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation

MOST = 6  # most lines; if there are more, those likeliest to be crossed
CURVES = 7  # most scenarios with their own curve: those likeliest to cross
ACROSS = 3  # panels in a row
# [in] width of the page, height of a panel, gap between panels, left margin
WIDTH, HIGH, GAP, MARGIN = 14.0, 2.6, 0.85, 0.75


def plot_crossings(updates: Updates, path: Path, setting: Setting) -> None:
    """Draw the probability of having crossed each line by time, with quantiles of the time."""
    crossings = updates.crossings
    assert crossings is not None
    few = bool(updates.all) and particles_left.lowest(updates, setting.particles).few
    every = sorted(crossings.all, key=lambda crossing: -float(crossing.probability[-1]))
    shown, curves = every[:MOST], _scenarios_with_curves(crossings)
    rows = -(-len(shown) // ACROSS)
    below = 0.32 * few  # [in] height of a warning
    width, height = WIDTH, 1.55 + below + rows * (HIGH + 0.75)
    columns = min(len(shown), ACROSS)
    wide = (WIDTH - MARGIN - 0.3 - (columns - 1) * GAP) / columns
    on = sheet.begin_page(
        Sheet(
            width,
            height,
            120,
            left=0.02,
            title=sheet.heading(1 - 0.4 / height, 14),
            lines=(Row(1 - 0.68 / height, 9.5),),
            caution=Badge(0.985, 1 - 0.4 / height, side="right"),
            rough=Badge(0.0225, 1 - 1.0 / height),
            footer=sheet.small(0.07 / height, 7),
        )
    )
    sheet.write_head(on, setting.imprint, _subtitle(every, len(shown)))
    if few:
        least = particles_left.lowest(updates, setting.particles)
        sheet.draw_rough_banner(on, effective.banner(least, "probabilities of crossing are rough"))
    for k, crossing in enumerate(shown):
        left = MARGIN + (k % ACROSS) * (wide + GAP)
        bottom = height - 1.35 - below - (k // ACROSS + 1) * (HIGH + 0.75) + 0.72
        ax = on.figure.add_axes((left / width, bottom / height, wide / width, HIGH / height))
        _panel(ax, crossings, crossing, curves)
    names = page.shorten_names([crossings.scenarios[j] for j in curves], 34)
    symbols = [(_stroke(j), name) for j, name in zip(curves, names, strict=True)]
    if len(crossings.scenarios) > 1:
        symbols.append((Line2D([], [], color="#111111", linewidth=2.4), "all together"))
        sheet.legend(
            on.figure,
            symbols,
            loc="upper left",
            bbox_to_anchor=(0.02, 1 - (0.8 + below) / height),
            ncols=min(4, len(symbols)),
            fontsize=9,
            borderaxespad=0,
            borderpad=0,
            handlelength=4.0,
            columnspacing=2.0,
        )
    sheet.finish_page(on, path, setting.imprint)


def _scenarios_with_curves(crossings: Crossings) -> list[int]:
    """Return the scenarios with their own curve; none if there is only one scenario."""
    if len(crossings.scenarios) < 2:
        return []
    most = np.max([crossing.probability[:-1] for crossing in crossings.all], axis=0)
    return sorted(np.argsort(-most, kind="stable")[:CURVES].tolist())


def _stroke(j: int) -> Line2D:
    colour, dashes, _ = STROKES[j % len(STROKES)]
    return Line2D([], [], color=colour, linestyle=dashes, linewidth=1.4)


def _subtitle(every: list[Crossing], shown: int) -> str:
    """Return the line of text under the title: what is drawn."""
    parts = ["Probability that a line has been crossed, by time, given all observations of the run"]
    if len(every) > shown:
        parts.append(f"the {shown} likeliest of {len(every)} lines; all are in lines.csv")
    return "   ·   ".join([*parts, "dots: 5, 50 and 95 % of the first crossings"])


def _panel(ax: Axes, crossings: Crossings, crossing: Crossing, curves: list[int]) -> None:
    """Draw the curves of one line."""
    x = notation.epochs(crossings.edges).astype(float)
    name = page.fit(crossing.line.name, 30)
    share, error = (
        notation.percent(float(values[-1])) for values in (crossing.probability, crossing.error)
    )
    words = (
        f"{name}: {share} (± {error})" if crossing.probability[-1] > 0 else f"{name}: not crossed"
    )
    ax.set_title(words, fontsize=10, color=INK, loc="left", weight="bold")
    top = 0.0
    for j in [*curves, len(crossings.scenarios)]:
        y = np.concatenate([[0.0], np.cumsum(crossing.mass[j])])
        top = max(top, float(y[-1]))
        if j < len(crossings.scenarios):
            colour, dashes, _ = STROKES[j % len(STROKES)]
            ax.plot(x, y, color=colour, linestyle=dashes, linewidth=1.4, zorder=4)
            continue
        ax.plot(x, y, color="#111111", linewidth=2.4, zorder=5)
        known = crossing.first[j][~np.isnat(crossing.first[j])]
        at = notation.epochs(known).astype(float)
        ax.plot(
            at,
            np.interp(at, x, y),
            "o",
            color="#111111",
            markersize=5,
            markeredgecolor="white",
            zorder=6,
        )
    high = min(1.0, 1.15 * top) if top > 0 else 1.0
    ax.set_ylim(0, high)
    levels = np.asarray(MaxNLocator(5).tick_values(0, 100 * high))
    levels = levels[(levels >= 0) & (levels <= 100 * high)]
    ax.set_yticks(levels / 100, labels=[f"{level:g} %" for level in levels])
    ax.set_xlim(x[0], x[-1])
    ticks = labels.round_times(x[0], x[-1], 4)
    ax.set_xticks(ticks, labels=[notation.day_time(np.datetime64(round(t), "s")) for t in ticks])
    ax.tick_params(labelsize=8, colors=INK, length=3)
    ax.grid(color=INK, alpha=0.2, linewidth=0.5, zorder=0)
    for spine in ax.spines.values():
        spine.set(color=INK, linewidth=0.8)
    if top == 0:
        ax.text(
            0.5,
            0.5,
            "no particle has touched it",
            transform=ax.transAxes,
            ha="center",
            fontsize=9,
            color=GREY,
        )
