"""The picture of posteriors: small multiples, one column a quantity and one row a stage.

Each row has its own scale. The outline of the first row is drawn over it to the same scale: values
that updates have made likelier rise above the outline, others stay below. Angles are cut opposite
their mean.
"""

import math
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import blended_transform_factory

from drift.evidence.posterior import tables
from drift.evidence.posterior.marginal import BINS, TURN
from drift.evidence.posterior.records import Posteriors, RangedQuantity, Stage
from drift.forecast import effective
from drift.products.maps import labels, page, sheet
from drift.products.maps.chart import GREY, INK, RED
from drift.products.maps.imprint import Setting
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation
from geo.array import Array

A_BAND = 4  # most quantities beside each other
MOST_ROWS = 12  # most rows; if there are more stages, the first and the last ones
NAME = 32  # letters of a value's name
MOST_VALUES = 12  # values of a category; if there are more, the likeliest and all others together
# [in]: names of rows, a chart, its figures, gap between charts
LEFT, PANEL, BESIDE, GAP = 2.65, 1.95, 0.9, 0.34
ROW, OVER, UNDER = 0.5, 0.42, 0.36  # [in]: a row, the heading over a band, the numbers under it
HEAD, FOOT = 1.08, 0.72  # [in] over and under all bands
LETTER = 0.053  # [in] of a value's name, upright
TALL = 0.72  # height of the highest bar as a share of the row
SLICES = (8, 44)  # fewest and most bars of a histogram
TAILS = 0.004  # share on each side that a chart may omit
BEFORE, NOW, LIGHT = "#aab4bd", "#3d7ab5", "#e3e8ec"
ANGLES = (5, 10, 15, 30, 45, 90)  # [deg] between marks of a compass
COMPASS = {0: "N", 90: "E", 180: "S", 270: "W"}


@dataclass(frozen=True)
class Panel:
    """The chart of one quantity: bars of each row, on a common axis."""

    told: RangedQuantity
    edges: Array  # (bars + 1,)
    rows: Array  # (rows, bars) shares
    names: tuple[str, ...] = ()  # of a category's values
    # (bars,) bool: bars of a histogram that are one value with much of the probability
    lone: Array | None = None


def plot_posteriors(posteriors: Posteriors, path: Path, setting: Setting) -> None:
    """Draw the posteriors of a run."""
    stages = shown(posteriors)
    panels = [panel(posteriors, stages, k) for k in range(len(posteriors.told))]
    many = -(-len(panels) // A_BAND)
    across = -(-len(panels) // many)
    bands = [panels[k : k + across] for k in range(0, len(panels), across)]
    under = [max(_height_below(own) for own in band) for band in bands]
    least = effective.Count(min(stage.ess for stage in posteriors.stages), setting.particles)
    head = HEAD + 0.32 * least.few
    width = max(LEFT + across * (PANEL + BESIDE + GAP), 10.5)
    height = head + FOOT + sum(OVER + ROW * len(stages) + own for own in under)
    letters = width * 15
    on = sheet.begin_page(
        Sheet(
            width,
            height,
            120,
            left=0.28 / width,
            title=sheet.heading(1 - 0.4 / height, 14),
            lines=(Row(1 - 0.68 / height, 9.5),),
            caution=Badge(1 - 0.2 / width, 1 - 0.4 / height, side="right"),
            rough=Badge(0.32 / width, 1 - 1.3 / height),
            footer=sheet.small(0.09 / height, 7),
        )
    )
    sheet.write_head(on, setting.imprint, _subtitle(posteriors, stages))
    _key(on.figure, 1 - 0.82 / height, 0.28 / width)
    if least.few:
        sheet.draw_rough_banner(on, effective.banner(least, "shares and quantiles are rough"))
    top = height - head
    for band, below in zip(bands, under, strict=True):
        bottom = top - OVER - ROW * len(stages)
        for k, own in enumerate(band):
            category = own.told.quantity.kind == "category"
            left = LEFT + k * (PANEL + BESIDE + GAP)
            size = (
                left / width,
                bottom / height,
                (PANEL + BESIDE * category) / width,
                ROW * len(stages) / height,
            )
            ax = on.figure.add_axes(size)
            _chart(ax, own, len(stages))
            unit = f" [{own.told.quantity.unit}]" if own.told.quantity.unit else ""
            ax.set_title(
                own.told.quantity.heading + unit,
                fontsize=10,
                weight="bold",
                color=INK,
                loc="left",
                pad=7,
            )
            if not category:
                _figures(ax, posteriors, stages, own.told)
            if k == 0:
                _names(ax, stages)
        top = bottom - below
    on.figure.text(
        0.28 / width,
        0.4 / height,
        _explained(letters),
        fontsize=8,
        color=GREY,
        linespacing=1.35,
        va="center",
    )
    sheet.finish_page(on, path, setting.imprint)


def shown(posteriors: Posteriors) -> list[Stage]:
    """Return the stages of the picture: before the first update, and after the last ones."""
    first, *later = posteriors.stages
    return [first, *later[-(MOST_ROWS - 1) :]]


def panel(posteriors: Posteriors, stages: list[Stage], k: int) -> Panel:
    """Return the chart of quantity k."""
    told = posteriors.told[k]
    table = np.nan_to_num([stage.marginals[k].table[-1] for stage in stages])
    if told.quantity.kind == "category":
        return _of_category(told, table)
    least = min(float(stage.marginals[k].ess[-1]) for stage in stages)
    edges = np.linspace(told.low, told.high, BINS + 1)
    if told.quantity.kind == "circular":
        middles = edges[:-1] + TURN / BINS / 2
        east, north = table.sum(axis=0) @ np.stack([np.sin(middles), np.cos(middles)], axis=1)
        cut = round(((math.atan2(east, north) + math.pi) % TURN) / TURN * BINS) % BINS
        table, edges = np.roll(table, -cut, axis=1), edges + cut * TURN / BINS
    up_to = np.cumsum(table, axis=1)
    inside = (up_to > TAILS * up_to[:, -1:]) & (up_to - table < (1 - TAILS) * up_to[:, -1:])
    a, b = np.flatnonzero(inside.any(axis=0))[[0, -1]]
    bars = int(np.clip(2 * least ** (1 / 3), *SLICES))  # Rice's rule
    wide = -(-(b + 1 - a) // bars)
    b = min(a + wide * -(-(b + 1 - a) // wide), BINS)
    starts = np.arange(a, b, wide)
    rows = np.add.reduceat(table[:, :b], starts, axis=1)
    single = np.maximum.reduceat(table[:, :b], starts, axis=1) > 0.9 * rows
    return Panel(
        told, edges[np.append(starts, b)], rows, lone=np.any(single & _stand_out(rows), axis=0)
    )


def _of_category(told: RangedQuantity, table: Array) -> Panel:
    """Return the chart of a category: one bar a value.

    If there are too many values, the unlikely ones share a bar.
    """
    names = list(told.labels)
    if len(names) > MOST_VALUES:
        kept = np.sort(np.argsort(-table.max(axis=0), kind="stable")[: MOST_VALUES - 1])
        rest = np.setdiff1d(np.arange(len(names)), kept)
        table = np.column_stack([table[:, kept], table[:, rest].sum(axis=1)])
        names = [*(names[k] for k in kept), f"{len(rest):,} others"]
    return Panel(told, np.arange(len(names) + 1) - 0.5, table, tuple(names))


def _height_below(own: Panel) -> float:
    """Return the height [in] of the numbers or names under a chart."""
    if not own.names:
        return UNDER
    return (
        0.2
        + (
            0.115 * 3
            if _names_are_horizontal(own)
            else LETTER * max(map(len, page.shorten_names(own.names, NAME)))
        )
        + 0.12
    )


def _names_are_horizontal(own: Panel) -> bool:
    """Whether the names of values are few enough to be horizontal."""
    return len(own.names) <= 3


def _chart(ax: Axes, own: Panel, many: int) -> None:
    """Draw the bars of all rows, and the outline of the first row over each."""
    category = bool(own.names)
    density = own.rows if category else own.rows / np.diff(own.edges)
    # Bars of a category have one scale in all rows. A histogram is scaled to the height of its row,
    # without the bars that stand out.
    lone = np.zeros(len(own.edges) - 1, bool) if own.lone is None else own.lone
    top = np.where(lone, 0.0, density).max(axis=1)
    # leave space above for the share of such a bar
    tall = TALL * (0.72 if lone.any() else 1.0)
    top = np.full(many, top.max()) if category else np.where(top > 0, top, density.max(axis=1))
    ax.set_xlim(own.edges[0], own.edges[-1])
    ax.set_ylim(many, 0)
    for k in range(many):
        base, scale = k + 0.82 + 0.06 * category, tall / top[k] if top[k] > 0 else 0.0
        ax.axhline(base, color=LIGHT, linewidth=0.8, zorder=1)
        first, now = (np.minimum(row * scale, TALL * 1.06) for row in (density[0], density[k]))
        colour = NOW if k else BEFORE
        if category:
            x, thick = np.arange(len(own.names)), 0.74
            ax.bar(x, -now, thick, base, color=colour, zorder=3)
            if k:
                ax.bar(x, -first, thick, base, fill=False, edgecolor=INK, linewidth=0.6, zorder=4)
            for j in x:
                _percent(
                    ax,
                    float(own.rows[k, j]),
                    float(j),
                    base - max(now[j], first[j] * bool(k)),
                    len(own.names),
                )
        else:
            ax.stairs(base - now, own.edges, baseline=base, fill=True, color=colour, zorder=3)
            if k:
                ax.stairs(
                    base - first, own.edges, baseline=base, color=INK, linewidth=0.7, zorder=4
                )
            for j in np.flatnonzero(lone & (now > tall)):
                _cut_bar(ax, own, k, int(j), (base - now[j], base - TALL))
    for spine in ax.spines.values():
        spine.set(color=INK, linewidth=0.8, visible=False)
    ax.spines["bottom"].set_visible(True)
    ax.set_yticks([])
    _ticks(ax, own)


def _stand_out(rows: Array) -> Array:
    """Return which bars of histograms (rows, bars) would make all others flat."""
    beside = np.pad(rows, ((0, 0), (1, 1)))
    return np.asarray(
        (rows > 0.1 * rows.sum(axis=1, keepdims=True))
        & (rows > 4 * np.maximum(beside[:, :-2], beside[:, 2:]))
    )


def _cut_bar(ax: Axes, own: Panel, row: int, bar: int, y: tuple[float, float]) -> None:
    """Cut a bar that stands out of its row, and write its share beside it.

    y: top of the bar and position of the text.
    """
    middle, right = float(own.edges[bar : bar + 2].mean()), bar < 0.8 * own.rows.shape[1]
    ax.plot(middle, y[0] + 0.1, "_", color="white", markersize=9, markeredgewidth=2.5, zorder=5)
    gap = 0.03 * (own.edges[-1] - own.edges[0]) * (1 if right else -1)
    text = notation.short_percent(float(own.rows[row, bar]))
    ax.text(
        middle + gap,
        y[1],
        text,
        ha="left" if right else "right",
        va="center",
        fontsize=7,
        color=INK,
        zorder=6,
    )


def _percent(ax: Axes, share: float, x: float, y: float, many: int) -> None:
    """Write a share over its bar."""
    text = "" if share <= 0 else notation.percent(share, 0, "")
    ax.text(
        x,
        y - 0.02,
        text,
        ha="center",
        va="bottom",
        fontsize=7.5 if many <= 9 else 6.5,
        color=INK,
        zorder=5,
    )


def _ticks(ax: Axes, own: Panel) -> None:
    """Draw the axis under a chart."""
    told, (low, high) = own.told, ax.get_xlim()
    ax.tick_params(labelsize=7.5, colors=INK, length=3, pad=2)
    if own.names:
        ax.set_xticks(np.arange(len(own.names)))
        ax.tick_params(axis="x", length=0)
        if _names_are_horizontal(own):
            ax.set_xticklabels(
                ["\n".join(textwrap.wrap(page.fit(name, NAME), 16)[:3]) for name in own.names],
                fontsize=7.5,
            )
        else:
            ax.set_xticklabels(page.shorten_names(own.names, NAME), rotation=90, fontsize=7)
    elif told.quantity.kind == "time":
        return
    elif told.quantity.kind == "circular":
        span = math.degrees(high - low)
        step = next((step for step in ANGLES if span / step <= 5), ANGLES[-1])
        marks = (
            np.arange(math.ceil(math.degrees(low) / step), math.degrees(high) // step + 1) * step
        )
        ax.set_xticks(np.radians(marks), [_compass(round(mark) % 360) for mark in marks])
    else:
        from matplotlib.ticker import MaxNLocator

        marks = np.asarray(
            MaxNLocator(4).tick_values(low * told.quantity.scale, high * told.quantity.scale)
        )
        marks = marks[(marks >= low * told.quantity.scale) & (marks <= high * told.quantity.scale)]
        ax.set_xticks(marks / told.quantity.scale, [f"{mark:g}" for mark in marks])


def _compass(angle: int) -> str:
    return f"{angle:03d} {COMPASS[angle]}" if angle in COMPASS else f"{angle:03d}"


def _figures(ax: Axes, posteriors: Posteriors, stages: list[Stage], told: RangedQuantity) -> None:
    """Draw the median and the quantiles under each row, and write them beside it."""
    number = posteriors.told.index(told)
    low, high = ax.get_xlim()
    if told.quantity.kind == "time":
        begin = notation.epoch(posteriors.period.start)
        sign = posteriors.period.direction
        first, last = sorted((begin + sign * low, begin + sign * high))
        times = labels.round_times(first, last, 4)
        ax.set_xticks(
            (times - begin) * sign, [notation.day_time(np.datetime64(round(t), "s")) for t in times]
        )
    beside = blended_transform_factory(ax.transAxes, ax.transData)
    partial = any(stage.marginals[number].share[-1] < 1 - 1e-9 for stage in stages)
    for k, stage in enumerate(stages):
        found = stage.marginals[number]
        assert found.quantiles is not None
        share = float(np.nan_to_num(found.share[-1]))
        if share > 0:
            q = found.quantiles[-1].copy()
            if told.quantity.kind == "circular":
                q = low + (q - low) % TURN
                q[0], q[1] = (x - TURN * (x > q[2]) for x in q[:2])
                q[3], q[4] = (x + TURN * (x < q[2]) for x in q[3:])
            for a, b, wide in ((q[0], q[4], 1.0), (q[1], q[3], 3.0)):
                ax.plot(
                    [max(a, low), min(b, high)],
                    [k + 0.9] * 2,
                    color=INK,
                    linewidth=wide,
                    solid_capstyle="butt",
                    zorder=5,
                )
            ax.plot(q[2], k + 0.9, "o", color="white", markeredgecolor=INK, markersize=4, zorder=6)
            texts = [_value_text(posteriors, told, x) for x in found.quantiles[-1][[2, 0, 4]]]
            ax.text(1.04, k + 0.42, texts[0], transform=beside, fontsize=9, color=INK, va="center")
            ax.text(
                1.04,
                k + 0.66,
                f"{texts[1]}-{texts[2]}",
                transform=beside,
                fontsize=7,
                color=GREY,
                va="center",
            )
        if partial:
            ax.text(
                1.04,
                k + 0.87,
                f"in {notation.short_percent(share)}",
                transform=beside,
                fontsize=7,
                color=GREY,
                va="center",
            )


def _value_text(posteriors: Posteriors, told: RangedQuantity, value: float) -> str:
    """Return a value of a quantity in its unit, as text."""
    if told.quantity.kind == "time":
        return notation.day_time(tables.moment(posteriors, value))
    value = value * told.quantity.scale
    if told.quantity.kind == "circular":
        return f"{round(value) % 360:03d}°"
    return f"{value:.3g}" if value < 100 else f"{value:,.0f}"


def _names(ax: Axes, stages: list[Stage]) -> None:
    """Write the update, its time and the effective particles left of each row."""
    place = blended_transform_factory(ax.transAxes, ax.transData)
    inch = 1 / (ax.get_position().width * ax.get_figure(root=True).get_figwidth())  # type: ignore[union-attr]
    for k, stage in enumerate(stages):
        count = effective.Count(stage.ess)
        name = (
            stage.name
            if stage.kind in ("prior", "sortie", "overdue")
            else f"{page.fit(stage.name, 16)} ({stage.kind})"
        )
        head = page.fit(name, 26) if stage.number == 0 else f"{stage.number}  {page.fit(name, 26)}"
        below = f"{notation.format_dtg(stage.time)}, {count.words}"
        for y, text, size, colour, weight in (
            (
                0.45,
                head,
                9.0,
                GREY if stage.number == 0 else INK,
                "normal" if stage.number == 0 else "bold",
            ),
            (0.75, below, 7.0, RED if count.few else GREY, "normal"),
        ):
            ax.text(
                -0.14 * inch,
                k + y,
                text,
                transform=place,
                ha="right",
                va="center",
                fontsize=size,
                color=colour,
                weight=weight,
            )


def _key(figure: Figure, top: float, left: float) -> None:
    """Draw the legend."""
    rows: list[tuple[Any, str]] = [
        (Patch(color=BEFORE), "before the first update"),
        (Patch(color=NOW), "after an update"),
        (Patch(fill=False, edgecolor=INK, linewidth=0.8), "as before the first"),
        (Line2D([], [], color=INK, linewidth=1), "5 to 95 %"),
        (Line2D([], [], color=INK, linewidth=3), "25 to 75 %"),
        (
            Line2D(
                [], [], color=INK, marker="o", markerfacecolor="white", markersize=4, linestyle=""
            ),
            "median",
        ),
    ]
    sheet.legend(
        figure,
        rows,
        loc="upper left",
        bbox_to_anchor=(left, top),
        ncols=len(rows),
        fontsize=8.5,
        borderaxespad=0,
        borderpad=0,
        handlelength=1.8,
        columnspacing=1.6,
    )


def _subtitle(posteriors: Posteriors, stages: list[Stage]) -> str:
    """Return the line of text under the title: what is shown."""
    many = len(posteriors.stages) - 1
    text = f"Posteriors besides position, before and after {f'each of {many} updates' if many != 1 else '1 update'}"
    if many == 0:
        text = "Posteriors besides position: no searches or observations yet"
    hidden = len(posteriors.stages) - len(stages)
    return text + (f"; {hidden} earlier rows are in posteriors.csv" if hidden else "")


def _explained(letters: float) -> str:
    """Return the explanation of the chart, wrapped to a width in large letters."""
    text = (
        "Outline: before. Tall bars are cut, with the value beside. Bars of scenarios, destinations and sides are shares in %. "
        "Beside a histogram: the median, 5 to 95 %, and the share of the probability to which it applies. "
        "By scenario and in full: posteriors.csv."
    )
    return "\n".join(textwrap.wrap(text, int(1.2 * letters)))
