"""Timeline chart of a beam allocation: time on the x axis, beams by array on the y axis.

Processed beams are filled and labelled with their gain in percent of the total weight. The paler
background shows the gain that the other beams would have. If there are too many beams for a page,
only beams that are processed at some time are shown.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from drift.planning.arrays import processing_text
from drift.planning.arrays.records import Allocation, Hearing, Names
from drift.products.maps import labels, page, sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation
from geo.array import Array

WIDTH = 14.0  # [in]
ROW = 0.15  # [in] height of a beam's row
GAP = 0.09  # [in] between arrays
LEFT, RIGHT = 1.45, 0.35  # [in] margins beside the beams
CURVE = 1.15  # [in] height of the curve below
MOST = 100  # most beams on a page
NARROW = 0.29  # [in] narrowest slot in which a number fits
# candidate tick distances of the probability axis
STEPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5)
FILL = "#0b4f8a"  # of beams that are processed
# of the gain that beams which are not processed would have
GROUND = ListedColormap(colormaps["YlOrBr"](np.linspace(0.0, 0.42, 128)))
LINE: dict[str, Any] = {"color": INK, "linewidth": 1.4}


def plot_processing(
    allocation: Allocation,
    hearing: Hearing,
    names: Names,
    path: Path,
    imprint: Imprint,
    lines: Sequence[str] = (),
) -> None:
    """Draw which beams are processed when, and the cumulative probability of hearing.

    Args:
        allocation: which beams are processed when.
        hearing: detection probabilities of all beams.
        names: of arrays, beams and processors.
        path: the picture to write.
        imprint: title and run for the head of the page.
        lines: text under the title, for plans whose probabilities hold for each slot by itself.
            Empty: the value of the allocation.
    """
    head = lines or [processing_text.worth(allocation)]
    rows = shown(allocation, hearing)
    y, top = _heights(hearing, rows)
    head_height, foot_height = 0.95 + 0.2 * len(head), 0.75 + CURVE + 0.45
    height = head_height + top + foot_height
    sheet_page = sheet.begin_page(
        Sheet(
            WIDTH,
            height,
            120,
            left=0.02,
            title=sheet.heading(1 - 0.38 / height, 14),
            lines=tuple(Row(1 - (0.64 + 0.2 * k) / height, 9.5) for k in range(len(head))),
            caution=Badge(0.985, 1 - 0.38 / height, side="right"),
            footer=sheet.small(0.07 / height, 7),
        )
    )
    sheet.write_head(sheet_page, imprint, *head)
    wide = WIDTH - LEFT - RIGHT
    ax = sheet_page.figure.add_axes(
        (LEFT / WIDTH, foot_height / height, wide / WIDTH, top / height)
    )
    edges = notation.epochs(names.edges).astype(float)
    _beams(ax, allocation, hearing, names, rows, y, wide)
    ax.set_xlim(edges[0], edges[-1])
    ax.set_ylim(0, top)
    curve_axes = sheet_page.figure.add_axes(
        (LEFT / WIDTH, 0.75 / height, wide / WIDTH, CURVE / height)
    )
    _heard(
        curve_axes,
        allocation,
        edges,
        "heard by then, each slot by itself" if lines else "heard by then",
    )
    _times(curve_axes, edges)
    ax.set_xticks(curve_axes.get_xticks(), labels=[])
    _legend(sheet_page.figure, 1 - (head_height - 0.43) / height)
    footnote = "Beams look R relative to their array, T true. " if lines else ""
    if hearing.beams > len(rows):
        footnote += (
            f"{hearing.beams - len(rows)} beams are not shown: never processed, or processed least."
        )
    ax.text(
        1,
        -0.08 / top,
        footnote.strip(),
        fontsize=7.5,
        color=GREY,
        ha="right",
        va="top",
        transform=ax.transAxes,
    )
    sheet.finish_page(sheet_page, path, imprint)


def shown(allocation: Allocation, hearing: Hearing) -> list[int]:
    """Return the beams that the chart shows.

    These are all beams, or the processed ones if there are more than `MOST`, and of too many
    processed ones those of highest gain.
    """
    if hearing.beams <= MOST:
        return list(range(hearing.beams))
    gain = np.zeros(hearing.beams)
    for slot, beams in enumerate(allocation.chosen):
        gain[list(beams)] += allocation.gain[slot, list(beams)] + 1e-12 * allocation.weight
    order = np.argsort(-gain, kind="stable")[:MOST]
    return sorted(int(beam) for beam in order if gain[beam] > 0)


def _heights(hearing: Hearing, rows: Sequence[int]) -> tuple[Array, float]:
    """Return the lower edge of each beam's row [in], the first on top, and the total height."""
    array = hearing.array[list(rows)] if len(rows) else np.zeros(0, int)
    breaks = np.concatenate([[0], np.cumsum(np.diff(array) != 0)]) if len(rows) else np.zeros(0)
    top = max(ROW * len(rows) + GAP * (float(breaks[-1]) if len(rows) else 0), 1.0)
    return top - ROW * (np.arange(len(rows)) + 1) - GAP * breaks, top


def _beams(
    ax: Axes,
    allocation: Allocation,
    hearing: Hearing,
    names: Names,
    rows: Sequence[int],
    y: Array,
    wide: float,
) -> None:
    """Draw each beam's gain as the background, and bars where it is processed."""
    for side in ("top", "right", "left", "bottom"):
        ax.spines[side].set_visible(False)
    edges = notation.epochs(names.edges).astype(float)
    share = 100 * np.nan_to_num(allocation.gain) / allocation.weight
    norm = PowerNorm(0.5, 0, max(float(share.max()), 1e-9))
    chosen = [set(beams) for beams in allocation.chosen]
    room = wide * np.diff(edges) / (edges[-1] - edges[0])
    for k, beam in enumerate(rows):
        ax.pcolormesh(
            edges,
            [y[k], y[k] + ROW],
            share[None, :, beam],
            cmap=GROUND,
            norm=norm,
            edgecolors="white",
            linewidth=0.4,
            zorder=2,
        )
        used = [slot for slot in range(hearing.slots) if beam in chosen[slot]]
        ax.barh(
            [y[k] + 0.5 * ROW] * len(used),
            np.diff(edges)[used],
            0.94 * ROW,
            edges[:-1][used],
            facecolor=FILL,
            edgecolor="white",
            linewidth=0.6,
            zorder=3,
        )
        for slot in used:
            if room[slot] >= NARROW:
                ax.text(
                    edges[slot : slot + 2].mean(),
                    y[k] + 0.47 * ROW,
                    _percent(float(share[slot, beam])),
                    fontsize=6.6,
                    color="white",
                    weight="bold",
                    ha="center",
                    va="center_baseline",
                    zorder=4,
                )
    ax.set_yticks(y + 0.5 * ROW, labels=[page.fit(names.beams[beam], 14) for beam in rows])
    ax.tick_params(axis="y", labelsize=6.2, length=0, pad=2, labelcolor=INK)
    ax.tick_params(axis="x", length=0)
    array = hearing.array[list(rows)] if len(rows) else np.zeros(0, int)
    for number in np.unique(array).tolist():
        own = np.flatnonzero(array == number)
        middle = (y[own[0]] + ROW + y[own[-1]]) / 2
        upright = len(own) * ROW > 0.085 * min(len(names.arrays[number]), 24)
        ax.text(
            -0.088,
            middle,
            page.fit(names.arrays[number], 24 if upright else 12),
            fontsize=9,
            weight="bold",
            color=INK,
            rotation=90 if upright else 0,
            ha="center",
            va="center",
            transform=ax.get_yaxis_transform(),
        )


def _percent(share: float) -> str:
    """Return a gain [%] in at most four characters."""
    return f"{share:.0f}" if share >= 99.95 else f"{share:.1f}" if share >= 9.95 else f"{share:.2f}"


def _heard(ax: Axes, allocation: Allocation, edges: Array, words: str) -> None:
    """Draw the probability of having heard by the end of each slot, and the bound."""
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.set_xlim(edges[0], edges[-1])
    heard = np.concatenate([[0.0], allocation.by_slot]) / allocation.weight
    ax.plot(edges, heard, zorder=4, **LINE)
    ax.fill_between(edges, 0, heard, color=FILL, alpha=0.12, linewidth=0)
    values = [float(heard[-1])]
    if not allocation.exact:
        bound = allocation.bound / allocation.weight
        values.append(bound)
        ax.plot(edges[-1:], [bound], marker="v", markersize=5, color=GREY, clip_on=False, zorder=5)
    highest = min(1.0, 1.15 * max(*values, 1e-3))
    ax.set_ylim(0, highest)
    step = next((step for step in STEPS if highest / step <= 4.5), STEPS[-1])
    ticks = step * np.arange(int(highest / step) + 1)
    ax.set_yticks(ticks, labels=[f"{100 * tick:.3g} %" for tick in ticks])
    ax.tick_params(labelsize=7.5, labelcolor=INK)
    ax.grid(axis="y", color="#d9dfe4", linewidth=0.6)
    ax.text(0.01, 0.94, words, fontsize=8, color=INK, ha="left", va="top", transform=ax.transAxes)


def _times(ax: Axes, edges: Array) -> None:
    """Label the time axis."""
    ticks = labels.round_times(float(edges[0]), float(edges[-1]), 14)
    ax.set_xticks(
        ticks,
        labels=[f"{notation.format_dtg(np.datetime64(round(tick), 's'))[:6]}Z" for tick in ticks],
    )


def _legend(figure: Figure, y: float) -> None:
    """Draw the legend."""
    rows = [
        (Patch(facecolor=FILL), "processed; the number: what would be lost without it, % of all"),
        (Patch(facecolor=GROUND(0.75)), "not processed; the darker, the more it would add"),
        (Line2D([], [], **LINE), "heard by the end of each slot"),
        (
            Line2D([], [], marker="v", markersize=5, color=GREY, linestyle="none"),
            "bound on every choice",
        ),
    ]
    sheet.legend(
        figure,
        rows,
        loc="upper left",
        bbox_to_anchor=(0.015, y),
        ncols=len(rows),
        fontsize=8,
        borderaxespad=0,
        handlelength=1.6,
        columnspacing=1.8,
    )
