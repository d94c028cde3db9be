"""The picture of a verification: distances by time, shares held by areas, ranks of drifters."""

import itertools
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes

from drift.assess.verify import text as verification_text
from drift.assess.verify import verification
from drift.assess.verify.verification import Verification
from drift.products.maps import sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Row, Sheet
from drift.tracking.tracks.clusters import Estimate
from geo.array import Array
from geo.notation import NMI

BLUE, RED, SAND = "#0b4f8a", "#a33b20", "#b9802a"
# Colours and marks of areas, in order of their shares; the ten marks are distinct in grey too.
MARKS = tuple(zip(itertools.cycle(("#5b8db8", BLUE, RED, SAND)), "so^DvPX<>*", strict=False))
SHEET = Sheet(
    11.7,
    8.3,
    120,
    left=0.05,
    title=sheet.heading(0.955, 15),
    lines=(Row(0.922, 12), sheet.small(0.895, 9)),
    footer=sheet.small(0.02, 7),
)


def plot_verification(result: Verification, path: Path, imprint: Imprint) -> None:
    """Draw a verification into a PNG."""
    on = sheet.begin_page(SHEET)
    figure, doubt = on.figure, verification_text.doubts_about_errors(result)
    about = (
        "forecasts: "
        f"{verification_text.verification_facts(result)['forecasts']}{f'; {doubt}' if doubt else ''}"
    )
    sheet.write_head(on, imprint, verification_text.headline(result), about)
    _distances(figure.add_axes((0.07, 0.5, 0.40, 0.33)), result)
    _held(figure.add_axes((0.56, 0.5, 0.40, 0.33)), result)
    last = f"after {result.leads[-1]:g} h"
    for k, (ranks, title, low, high) in enumerate(
        (
            (result.containment, f"Containment {last}", "in the middle", "outside"),
            (result.along, f"Rank along the drift {last}", "drifter behind", "ahead"),
            (result.across, f"Rank across the drift {last}", "drifter to the left", "to the right"),
        )
    ):
        plot_ranks(
            figure.add_axes((0.07 + 0.315 * k, 0.11, 0.26, 0.26)),
            result,
            ranks[:, -1],
            title,
            low,
            high,
        )
    sheet.finish_page(on, path, imprint, f"{imprint.title}: forecasts of drifters")


def _distances(axes: Axes, result: Verification) -> None:
    """Draw mean separations with two standard errors, their median, persistence and spread."""
    hours = np.append(0.0, result.hours)
    estimates = [result.mean(result.apart[:, k]) for k in range(result.hours.size)]
    mean = np.append(0.0, [estimate.mean for estimate in estimates]) / NMI
    error = np.append(0.0, [estimate.error for estimate in estimates]) / NMI
    axes.fill_between(
        hours,
        mean - 2 * error,
        mean + 2 * error,
        color=BLUE,
        alpha=0.18,
        linewidth=0,
        label="± 2 standard errors",
    )
    axes.plot(
        hours, mean, color=BLUE, linewidth=2.2, label="forecast's mean from the drifter, mean"
    )
    axes.plot(
        hours,
        np.append(0.0, np.median(result.apart, axis=0)) / NMI,
        color=BLUE,
        linewidth=1.1,
        linestyle=(0, (2, 1.5)),
        label="median",
    )
    axes.plot(
        hours,
        np.append(0.0, result.waiting.mean(axis=0)) / NMI,
        color=RED,
        linewidth=1.5,
        linestyle=(0, (6, 2)),
        label="staying put, mean",
    )
    start = result.error / np.sqrt(np.log(2))  # from the radius that holds half
    spread = np.append(start, np.sqrt((result.spread**2).mean(axis=0))) / NMI
    apart = np.append(0.0, np.sqrt((result.apart**2).mean(axis=0))) / NMI
    axes.plot(
        result.leads,
        result.energy.mean(axis=0) / NMI,
        color=GREY,
        marker="D",
        markersize=4,
        linestyle="none",
        label="energy score, mean",
    )
    axes.plot(hours, apart, color=INK, linewidth=1.1, label="from the drifter, root mean square")
    axes.plot(
        hours,
        spread,
        color=SAND,
        linewidth=1.6,
        linestyle=(0, (6, 2, 1, 2)),
        label="spread of the particles, root mean square",
    )
    axes.set_title(
        "Distance [nmi]: forecast error and particle spread should agree",
        fontsize=10,
        loc="left",
        color=INK,
    )
    axes.set_xlabel("hours after the start", fontsize=9)
    axes.set_xlim(0, hours[-1])
    axes.set_ylim(0, None)
    axes.legend(fontsize=7, frameon=False, loc="upper left")
    style_axes(axes)


def _held(axes: Axes, result: Verification) -> None:
    """Draw the share of positions that each area held, by lead, beside its stated share."""
    place = np.arange(result.leads.size, dtype=float)
    for k, (share, (colour, mark)) in enumerate(
        zip(result.shares, itertools.cycle(MARKS), strict=False)
    ):
        estimates = [result.held(lead, share) for lead in range(result.leads.size)]
        shift = 0.5 * ((k + 0.5) / len(result.shares) - 0.5)
        axes.axhline(share, color=colour, linewidth=0.9, linestyle=(0, (6, 2)))
        below = [min(2 * estimate.error, estimate.mean) for estimate in estimates]
        above = [min(2 * estimate.error, 1 - estimate.mean) for estimate in estimates]
        axes.errorbar(
            place + shift,
            [estimate.mean for estimate in estimates],
            [below, above],
            color=colour,
            marker=mark,
            linestyle="none",
            markersize=6,
            capsize=3,
            linewidth=1.2,
            label=f"{100 * share:.0f} % area",
        )
    axes.set_xticks(place, [f"{hours:g} h" for hours in result.leads])
    axes.set_xlim(-0.5, result.leads.size - 0.5)
    axes.set_ylim(0, 1.04)
    axes.set_yticks(np.linspace(0, 1, 6), [f"{tick:.0f} %" for tick in np.linspace(0, 100, 6)])
    axes.set_title(
        "Share of positions held (± 2 standard errors); dashed: as stated",
        fontsize=10,
        loc="left",
        color=INK,
    )
    axes.legend(fontsize=8, frameon=False, loc="lower right", ncols=2)
    style_axes(axes)


class Averaged(Protocol):
    """Scores whose means have standard errors: `Verification.mean`."""

    def mean(self, values: Array, *, share: bool = False) -> Estimate:
        """Return the mean of values by forecast, (n,), with its standard error."""


def plot_ranks(axes: Axes, result: Averaged, ranks: Array, title: str, low: str, high: str) -> None:
    """Draw a histogram of ranks (n,) with two standard errors, and the level of uniform ranks.

    Args:
        axes: to draw in.
        result: computes means over forecasts with their errors.
        ranks: 0 to 1, (n,).
        title: of the diagram.
        low: what rank 0 means.
        high: what rank 1 means.
    """
    number = np.minimum((ranks * verification.BINS).astype(int), verification.BINS - 1)
    estimates = [result.mean(number == k, share=True) for k in range(verification.BINS)]
    middle = (np.arange(verification.BINS) + 0.5) / verification.BINS
    below = [min(2 * estimate.error, estimate.mean) for estimate in estimates]
    above = [2 * estimate.error for estimate in estimates]
    axes.bar(
        middle,
        [estimate.mean for estimate in estimates],
        0.9 / verification.BINS,
        color="#cfe0ee",
        edgecolor=BLUE,
        yerr=[below, above],
        error_kw={"ecolor": GREY, "elinewidth": 0.9},
    )
    axes.axhline(1 / verification.BINS, color=RED, linewidth=1.4, linestyle=(0, (6, 2)))
    axes.set_title(title, fontsize=10, loc="left", color=INK)
    axes.set_xlim(0, 1)
    axes.set_ylim(0, None)
    axes.set_xticks([0, 0.5, 1], [f"0\n{low}", "0.5", f"1\n{high}"], fontsize=8)
    labels = axes.get_xticklabels()
    labels[0].set_horizontalalignment("left")
    labels[-1].set_horizontalalignment("right")
    axes.set_yticks(ticks := axes.get_yticks()[:6], [f"{100 * tick:.0f} %" for tick in ticks])
    style_axes(axes)


def style_axes(axes: Axes) -> None:
    """Style the axes of a diagram: small labels, horizontal lines, no frame at top and right."""
    axes.tick_params(labelsize=8, colors=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#d5dbe1", linewidth=0.6)
    axes.set_axisbelow(True)
