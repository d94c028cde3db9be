"""The picture of scores: the share of finds by containment, and a histogram of containments."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from drift.assess.score import calibration
from drift.assess.score.calibration import Score
from drift.assess.verify import map as verification_map
from drift.assess.verify.map import BLUE, RED
from drift.products.maps import sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Row, Sheet

SHEET = Sheet(
    11.7,
    6.2,
    120,
    left=0.05,
    title=sheet.heading(0.935, 15),
    lines=(Row(0.885, 11),),
    footer=sheet.small(0.02, 7),
)


def plot_score(score: Score, path: Path, imprint: Imprint) -> None:
    """Draw the scores of past cases into a PNG."""
    on = sheet.begin_page(SHEET)
    sheet.write_head(on, imprint, f"{len(score.incidents)} finds: {calibration.verdict(score)}")
    _reliability(on.figure.add_axes((0.07, 0.14, 0.4, 0.64)), score)
    verification_map.plot_ranks(
        on.figure.add_axes((0.56, 0.14, 0.4, 0.64)),
        score,
        score.containment,
        "Containment at the find; line: calibrated",
        "in the middle",
        "outside",
    )
    sheet.finish_page(on, path, imprint)


def _reliability(axes: Axes, score: Score) -> None:
    """Draw the share of finds inside the area of each share, beside what it should be."""
    order = np.sort(score.containment)
    count = len(order)
    axes.step(
        np.concatenate([[0.0], order, [1.0]]),
        np.concatenate([[0.0], np.arange(1, count + 1) / count, [1.0]]),
        where="post",
        color=BLUE,
        linewidth=1.8,
        label="finds inside",
    )
    band = calibration.band(count)
    line = np.array([0.0, 1.0])
    axes.plot(line, line, color=RED, linewidth=1.4, linestyle=(0, (6, 2)), label="calibrated")
    axes.fill_between(
        line,
        np.clip(line - band, 0, 1),
        np.clip(line + band, 0, 1),
        color=GREY,
        alpha=0.18,
        linewidth=0,
        label="95 % of calibrated sets are inside",
    )
    held = score.held
    share = np.array([one.count / one.of for one in held])
    below = share - np.array([one.low for one in held])
    above = np.array([one.high for one in held]) - share
    axes.errorbar(
        [one.share for one in held],
        share,
        [below, above],
        fmt="o",
        color=INK,
        capsize=3,
        markersize=5,
        label="50, 75, 90, 95 % areas, 95 % intervals",
    )
    ticks = np.linspace(0, 1, 6)
    axes.set_xticks(ticks, [f"{100 * tick:.0f} %" for tick in ticks])
    axes.set_yticks(ticks, [f"{100 * tick:.0f} %" for tick in ticks])
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("stated share of the area", fontsize=9)
    axes.set_title("Share of finds inside the area", fontsize=10, loc="left", color=INK)
    axes.legend(fontsize=8, frameon=False, loc="upper left")
    verification_map.style_axes(axes)
