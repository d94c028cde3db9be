"""The picture of suspend.txt: survival, areas searched, and the value of searching on."""

import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drift.evidence.filter.products.evidence_map import STROKES
from drift.evidence.suspend.decision import Suspension
from drift.evidence.suspend.text import missing_survival_warning, reached
from drift.forecast import effective
from drift.products.maps import labels, page, sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation

SHEET = Sheet(
    14.0,
    6.4,
    120,
    left=0.02,
    title=sheet.heading(0.945, 14),
    lines=(Row(0.903, 10.5),),
    caution=Badge(0.985, 0.95, side="right"),
    rough=Badge(0.0225, 0.862),
    footer=sheet.small(0.015, 7),
)
BOX = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}  # behind words on a panel
NOW = "#a33b20"
ALL: dict[str, Any] = {"color": INK, "linewidth": 2.2}
FOUND, ALIVE = "#cfe0ee", "#0b4f8a"


def plot_suspension(suspension: Suspension, path: Path, imprint: Imprint) -> None:
    """Draw the basis of a decision to suspend."""
    on = sheet.begin_page(SHEET)
    figure = on.figure
    now = notation.format_dtg(suspension.now)
    sheet.write_head(
        on,
        imprint,
        f"Basis of a decision to suspend, as of {now}, given that nothing has been found",
    )
    if suspension.count.few:
        sheet.draw_rough_banner(
            on, effective.banner(suspension.count, "every figure here is rough")
        )
    for words in missing_survival_warning(suspension):
        sheet.write_line(on, sheet.warning(0.825, 9, "center"), words)
    panels = [_alive, _left, _further] if suspension.mortal else [_left, _further]
    wide, high = (
        (0.265, 0.54) if suspension.mortal else (0.43, 0.56)
    )  # without survival times no line needs a legend above
    for panel, left in zip(
        panels, (0.05, 0.38, 0.715) if suspension.mortal else (0.05, 0.55), strict=True
    ):
        panel(figure.add_axes((left, 0.2, wide, high)), suspension)
    _legend(figure, suspension)
    sheet.write_line(on, Row(0.055, 8, colour=GREY, va="center"), _note(suspension))
    sheet.finish_page(on, path, imprint, f"Suspend: {imprint.title}")


def _note(suspension: Suspension) -> str:
    """Return the note on errors: which the panels show, and which they omit and why."""
    notes = []
    if suspension.mortal:
        notes.append("The band is the sampling error only: survival times are far less certain.")
    else:
        notes.append("No panel shows survival: no scenario has survival times.")
    if suspension.further:
        notes.append(
            "Whiskers: two standard errors of the particles, not of winds, currents and sweep widths."
            if suspension.planned
            else "Days have no error bars; drift is ignored, so later days look better than they are."
        )
    return " ".join([*notes, "This is not a recommendation: see suspend.txt."])


def _prepare(ax: Axes, head: str) -> None:
    ax.set_title(head, fontsize=10, color=INK, loc="left", weight="bold")
    ax.set_facecolor("white")
    ax.tick_params(labelsize=8, colors=INK, length=3)
    for spine in ax.spines.values():
        spine.set(color=INK, linewidth=0.8)


def _percents(ax: Axes) -> None:
    ax.set_ylim(0, 1.02)
    ax.set_yticks(np.linspace(0, 1, 6), labels=[f"{100 * y:.0f} %" for y in np.linspace(0, 1, 6)])
    ax.grid(color=INK, alpha=0.2, linewidth=0.5, zorder=0)


def _alive(ax: Axes, suspension: Suspension) -> None:
    """Draw the probability of being alive by time and scenario, with two standard errors."""
    _prepare(ax, "Probability of being alive")
    x = notation.epochs(suspension.times).astype(float)
    for s in range(len(suspension.scenarios) if len(suspension.scenarios) > 1 else 0):
        colour, dashes, _ = STROKES[s % len(STROKES)]
        ax.plot(x, suspension.alive[:, s], color=colour, linestyle=dashes, linewidth=1.4, zorder=3)
    mean, error = suspension.alive[:, -1], 2 * suspension.alive_error[:, -1]
    ax.fill_between(
        x,
        (mean - error).clip(0),
        (mean + error).clip(max=1),
        color=INK,
        alpha=0.15,
        linewidth=0,
        zorder=2,
    )
    ax.plot(x, mean, zorder=4, **ALL)
    now = float(notation.epoch(suspension.now))
    ax.axvline(now, color=NOW, linewidth=1.4, zorder=3)
    at = float(np.interp(now, x, mean))
    ax.plot([now], [at], "o", markersize=6, markerfacecolor="white", markeredgecolor=NOW, zorder=6)
    right = now < (x[0] + x[-1]) / 2
    ax.annotate(
        f"now {notation.percent(at)}",
        (now, at),
        (8 if right else -8, 8),
        textcoords="offset points",
        fontsize=9,
        weight="bold",
        color=NOW,
        ha="left" if right else "right",
        zorder=7,
        bbox=BOX,
    )
    lines = [
        f"{100 * level:.0f} % at {notation.format_dtg(time)[:6]}Z"
        for level, time in reached(suspension)
    ]
    ax.text(
        0.98,
        0.97,
        "\n".join(lines),
        fontsize=8.5,
        color=INK,
        ha="right",
        va="top",
        transform=ax.transAxes,
        zorder=7,
        bbox=BOX,
    )
    ax.set_xlim(x[0], x[-1])
    ticks = labels.round_times(x[0], x[-1], 5)
    ax.set_xticks(
        ticks, labels=[f"{notation.format_dtg(np.datetime64(round(t), 's'))[:6]}Z" for t in ticks]
    )
    _percents(ax)


def _left(ax: Axes, suspension: Suspension) -> None:
    """Draw by scenario the probability found, the probability missed and that never searched."""
    _prepare(ax, "Searched so far")
    rows = [*suspension.scenarios, "all"] if len(suspension.scenarios) > 1 else ["all"]
    which = range(len(suspension.scenarios) + 1) if len(rows) > 1 else [len(suspension.scenarios)]
    y = np.arange(len(rows))
    pos, never = suspension.cumulative[list(which)], suspension.never[list(which)]
    missed = (1 - pos) * (1 - never)
    parts = (
        (pos, ALIVE, "", "cumulative POS: probability of a find"),
        (missed, "#f3d9a4", "////", "searched and missed"),
        ((1 - pos) * never, "#ffffff", "....", "never in a searched area"),
    )
    left = np.zeros(len(rows))
    for width, colour, hatch, word in parts:
        ax.barh(
            y,
            width,
            0.5,
            left,
            facecolor=colour,
            hatch=hatch,
            edgecolor=INK,
            linewidth=0.8,
            label=word,
            zorder=3,
        )
        left = left + width
    for k, name in enumerate(page.shorten_names(rows, 32)):
        words = f"{name}: POS {notation.percent(float(pos[k]))}; of the rest {notation.percent(float(never[k]))} never searched"
        ax.text(0.01, y[k] - 0.33, words, fontsize=7, color=INK, va="bottom")
    ax.set_ylim(len(rows) - 0.5, -0.75)
    ax.set_xlim(0, 1)
    ax.set_yticks([])
    ax.set_xticks(np.linspace(0, 1, 6), labels=[f"{100 * x:.0f} %" for x in np.linspace(0, 1, 6)])
    ax.legend(
        loc="upper left",
        bbox_to_anchor=(0, -0.06),
        fontsize=7.5,
        frameon=False,
        labelcolor=INK,
        handlelength=1.6,
    )


def _further(ax: Axes, suspension: Suspension) -> None:
    """Draw the probability of finding the object, and of finding it alive, by searching on.

    A plan has whiskers of two standard errors. Days on a fixed map have an unknown error beyond the
    sampling error, so whiskers would mislead.
    """
    _prepare(ax, "Further search from now")
    if not suspension.further:
        ax.set_axis_off()
        ax.text(
            0,
            0.9,
            "\n".join(textwrap.wrap(suspension.how, 70)),
            fontsize=9,
            color=INK,
            transform=ax.transAxes,
            va="top",
        )
        return
    x = np.arange(len(suspension.further))
    pos, pos_error = np.array([(end.pos, end.pos_error) for end in suspension.further]).T
    alive, alive_error = np.array([(end.alive, end.alive_error) for end in suspension.further]).T
    series = [(pos, pos_error, FOUND, "found by then")]
    if suspension.mortal:
        series.append((alive, alive_error, ALIVE, "found alive by then"))
    wide = 0.72 / len(series)
    for k, (value, error, colour, word) in enumerate(series):
        at = x + (k - (len(series) - 1) / 2) * wide
        ax.bar(
            at,
            value,
            wide * 0.95,
            facecolor=colour,
            edgecolor=INK,
            linewidth=0.8,
            label=word,
            zorder=3,
        )
        above = 2 * error * suspension.planned
        if suspension.planned:
            ax.errorbar(
                at, value, above, fmt="none", ecolor=INK, elinewidth=0.9, capsize=2, zorder=4
            )
        if len(x) <= 4:
            for i, v in enumerate(value):
                ax.text(
                    at[i],
                    v + above[i] + 0.015,
                    notation.percent(float(v)),
                    fontsize=7.5,
                    color=INK,
                    ha="center",
                    va="bottom",
                )
    middle, half = (len(x) - 1) / 2, max(len(x), 3) / 2
    ax.set_xlim(middle - half - 0.1, middle + half + 0.1)
    ax.set_xticks(
        x,
        labels=[f"{notation.format_dtg(end.until)[:6]}Z" for end in suspension.further],
        rotation=30 if len(x) > 4 else 0,
    )
    _percents(ax)
    ax.set_ylim(0, 1.2)  # room above a bar of 100 % for its figure, and for words above that
    planned = (
        "the plan of plan.txt"
        if suspension.planned
        else "each day like the last 24 h, drift ignored: rough"
    )
    ax.text(
        0.02,
        0.97,
        planned,
        fontsize=8,
        color=INK,
        va="top",
        transform=ax.transAxes,
        zorder=6,
        bbox=BOX,
    )
    ax.legend(
        loc="upper left",
        bbox_to_anchor=(0, -0.09 if len(x) <= 4 else -0.14),
        fontsize=7.5,
        frameon=False,
        ncols=2,
        labelcolor=INK,
    )


def _legend(figure: Figure, suspension: Suspension) -> None:
    """Draw the legend of scenarios."""
    if not suspension.mortal or len(suspension.scenarios) == 1:
        return
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [],
            [],
            color=STROKES[s % len(STROKES)][0],
            linestyle=STROKES[s % len(STROKES)][1],
            linewidth=1.4,
        )
        for s in range(len(suspension.scenarios))
    ]
    names = page.shorten_names(suspension.scenarios, 30)
    sheet.legend(
        figure,
        [*zip(handles, names, strict=True), (Line2D([], [], **ALL), "all, two standard errors")],
        loc="upper left",
        bbox_to_anchor=(0.045, 0.815),
        ncols=len(names) + 1,
        fontsize=8,
    )
