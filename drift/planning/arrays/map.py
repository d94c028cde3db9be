"""The picture of an allocation of processing: time along, beams upward by array.

Beams that are processed are filled and say what they add, in per cent of all that could be heard;
the paler ground shows what the others would add. Where beams are more than fit on a page, those
stand there that are processed at some time.
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
LEFT, RIGHT = 1.45, 0.35  # [in] beside the beams
CURVE = 1.15  # [in] height of the curve below
MOST = 100  # beams that fit on a page
NARROW = 0.29  # [in] of a slot, below which there is no room for a number
# of what is heard, between ticks
STEPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5)
FILL = "#0b4f8a"  # of beams that are processed
# of what others would add
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
    """Draw which beams are processed when, and how much is heard by then.

    lines: under the title, of a plan, whose chances are of slots begun again; without them what the
    allocation is worth.
    """
    told = lines or [processing_text.worth(allocation)]
    rows = shown(allocation, hearing)
    y, top = _heights(hearing, rows)
    over, under = 0.95 + 0.2 * len(told), 0.75 + CURVE + 0.45
    height = over + top + under
    on = sheet.begin_page(
        Sheet(
            WIDTH,
            height,
            120,
            left=0.02,
            title=sheet.heading(1 - 0.38 / height, 14, 95),
            beside=75,
            lines=tuple(Row(1 - (0.64 + 0.2 * k) / height, 9.5, 165) for k in range(len(told))),
            caution=Badge(0.985, 1 - 0.38 / height, side="right"),
            footer=sheet.small(0.07 / height, 7, 210),
        )
    )
    sheet.write_head(on, imprint, *told)
    wide = WIDTH - LEFT - RIGHT
    ax = on.figure.add_axes((LEFT / WIDTH, under / height, wide / WIDTH, top / height))
    edges = notation.epochs(names.edges).astype(float)
    _beams(ax, allocation, hearing, names, rows, y, wide)
    ax.set_xlim(edges[0], edges[-1])
    ax.set_ylim(0, top)
    below = on.figure.add_axes((LEFT / WIDTH, 0.75 / height, wide / WIDTH, CURVE / height))
    _heard(
        below, allocation, edges, "heard by then, each slot by itself" if lines else "heard by then"
    )
    _times(below, edges)
    ax.set_xticks(below.get_xticks(), labels=[])
    _legend(on.figure, 1 - (over - 0.43) / height)
    below_beams = "Beams look R relative to their array, T true. " if lines else ""
    if hearing.beams > len(rows):
        below_beams += f"{hearing.beams - len(rows)} beams are not shown: never processed, or the least of them."
    ax.text(
        1,
        -0.08 / top,
        below_beams.strip(),
        fontsize=7.5,
        color=GREY,
        ha="right",
        va="top",
        transform=ax.transAxes,
    )
    sheet.finish_page(on, path, imprint)


def shown(allocation: Allocation, hearing: Hearing) -> list[int]:
    """Return the beams that the picture shows: all, or those that are processed, those of most gain
    first if they are too many.
    """
    if hearing.beams <= MOST:
        return list(range(hearing.beams))
    worth = np.zeros(hearing.beams)
    for slot, beams in enumerate(allocation.chosen):
        worth[list(beams)] += allocation.gain[slot, list(beams)] + 1e-12 * allocation.weight
    order = np.argsort(-worth, kind="stable")[:MOST]
    return sorted(int(beam) for beam in order if worth[beam] > 0)


def _heights(hearing: Hearing, rows: Sequence[int]) -> tuple[Array, float]:
    """Return where the row of each beam begins [in], the first at the top, and the height of all."""
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
    """Draw the beams, what they would add, and those that are processed."""
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
    """Return a gain [%] in at most four letters."""
    return f"{share:.0f}" if share >= 99.95 else f"{share:.1f}" if share >= 9.95 else f"{share:.2f}"


def _heard(ax: Axes, allocation: Allocation, edges: Array, words: str) -> None:
    """Draw what is heard by the end of each slot, and the bound."""
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
    most = min(1.0, 1.15 * max(*values, 1e-3))
    ax.set_ylim(0, most)
    step = next((step for step in STEPS if most / step <= 4.5), STEPS[-1])
    ticks = step * np.arange(int(most / step) + 1)
    ax.set_yticks(ticks, labels=[f"{100 * tick:.3g} %" for tick in ticks])
    ax.tick_params(labelsize=7.5, labelcolor=INK)
    ax.grid(axis="y", color="#d9dfe4", linewidth=0.6)
    ax.text(0.01, 0.94, words, fontsize=8, color=INK, ha="left", va="top", transform=ax.transAxes)


def _times(ax: Axes, edges: Array) -> None:
    """Write times along the axis."""
    ticks = labels.round_times(float(edges[0]), float(edges[-1]), 14)
    ax.set_xticks(
        ticks,
        labels=[f"{notation.format_dtg(np.datetime64(round(tick), 's'))[:6]}Z" for tick in ticks],
    )


def _legend(figure: Figure, y: float) -> None:
    """Write what the colours mean."""
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
