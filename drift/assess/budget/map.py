"""Pictures of a budget: bars of each source's share, and a chart of how many models agree."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from drift.assess.budget import text
from drift.assess.budget.consensus import Consensus
from drift.assess.budget.record import Budget
from drift.forecast.products import layers
from drift.products.maps import chart, page, sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation

# [in] width of the page, height of a bar, space about the bars of a time
WIDTH, BAR, GAP = 11.7, 0.17, 0.75
OVER, UNDER = 1.2, 0.75  # [in] above and below all bars
COLOURS = ("#5b8db8", "#0b4f8a", "#a33b20", "#b9802a")  # of the areas, by their shares
CHART = Sheet(
    13.6,
    7.0,
    130,
    left=0.035,
    title=sheet.heading(0.945, 14),
    lines=(Row(0.905, 10.5),),
    caution=Badge(0.985, 0.945, side="right"),
    footer=sheet.small(0.015, 7),
)
PANEL_WIDE, PANEL_HIGH, PANEL_LOW = 0.455, 0.6, 0.215
MOST_PANELS = 2  # smallest and largest area


def plot_budget(found: Budget, path: Path, imprint: Imprint) -> None:
    """Draw the share of each source in each area as bars, with two standard errors."""
    rows = len(found.sources) * (len(found.shares) + 1)
    each = BAR * rows + GAP
    height = OVER + each * len(found.times) + UNDER
    on = sheet.begin_page(
        Sheet(
            WIDTH,
            height,
            130,
            left=0.03,
            title=sheet.heading(1 - 0.4 / height, 15),
            lines=(Row(1 - 0.68 / height, 11), sheet.small(1 - 0.92 / height, 9)),
            caution=Badge(0.985, 1 - 0.4 / height, side="right"),
            footer=sheet.small(0.1 / height, 7),
        )
    )
    greatest = found.greatest
    sheet.write_head(
        on,
        imprint,
        f"What drives the area: mostly {greatest.name}. Advice: {greatest.advice}",
        f"Shapley shares of the {text.areas_in_words(found)} areas, with two standard errors; "
        "they add up to 100 %",
    )
    largest = max(1.0, float((found.share.value + 2 * found.share.error).max()))
    least = min(0.0, float((found.share.value - 2 * found.share.error).min()))
    for number in range(len(found.times)):
        bottom = 1 - (OVER + each * number + 0.35 + BAR * rows) / height
        axes = on.figure.add_axes((0.2, bottom, 0.5, BAR * rows / height))
        _bars(axes, found, number)
        axes.set_xlim(105 * least, 105 * largest)
    key: list[tuple[Any, str]] = [
        (Patch(color=_colour(s)), f"{notation.hundredths(share)} % area")
        for s, share in enumerate(found.shares)
    ]
    sheet.legend(
        on.figure,
        key,
        loc="lower left",
        bbox_to_anchor=(0.2, 0.28 / height),
        ncols=len(key),
        fontsize=9,
        borderpad=0,
    )
    sheet.finish_page(on, path, imprint)


def _colour(share: int) -> str:
    return COLOURS[share % len(COLOURS)]


def _bars(axes: Axes, found: Budget, time: int) -> None:
    """Draw the bars of one time, and write the change without each source at the right."""
    many = len(found.shares)
    for k in range(len(found.sources)):
        for s in range(many):
            place = k * (many + 1) + s
            axes.barh(
                place,
                100 * found.share.value[k, time, s],
                height=0.9,
                color=_colour(s),
                xerr=200 * found.share.error[k, time, s],
                error_kw={"ecolor": INK, "elinewidth": 1.0},
            )
        changes = ", ".join(
            text.change_in_words(float(value)) for value in found.without.value[k, time]
        )
        axes.text(
            1.02,
            k * (many + 1) + (many - 1) / 2,
            f"without it {changes}",
            transform=axes.get_yaxis_transform(),
            fontsize=8.5,
            color=INK,
            va="center",
        )
    middles = np.arange(len(found.sources)) * (many + 1) + (many - 1) / 2
    axes.set_yticks(middles, [source.name for source in found.sources], fontsize=10, color=INK)
    axes.set_ylim(len(found.sources) * (many + 1) - 1.2, -0.8)
    axes.axvline(0, color=GREY, linewidth=0.8)
    sizes = "; ".join(
        f"{notation.hundredths(share)} % {text.size_in_words(found, time, s, '±')} nmi²"
        for s, share in enumerate(found.shares)
    )
    axes.set_title(
        f"{notation.format_dtg(found.times[time])}: areas {sizes}",
        fontsize=10,
        loc="left",
        color=INK,
    )
    axes.tick_params(axis="x", labelsize=8.5, colors=INK)
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_formatter("{x:.0f} %")
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)


def plot_consensus(found: Consensus, path: Path, setting: Setting) -> None:
    """Draw how many models agree at the last time, for the smallest and the largest area."""
    on = sheet.begin_page(CHART)
    data, forecast = found.whole.data, found.whole
    now, many = data["time"].values[-1], len(found.names)
    sheet.write_head(
        on,
        setting.imprint,
        f"Valid {notation.format_dtg(now)}: how many of {many} {found.what} have a place in "
        "their own area",
    )
    aspect = PANEL_WIDE * CHART.width / (PANEL_HIGH * CHART.height)
    frame = layers.extent(forecast, [now], setting.marks, setting.lines, aspect)
    land = chart.land_path(frame, setting.polygons(frame.box()), 700)
    edges = np.unique(np.rint(np.linspace(0, many, min(many, 10) + 1))) + 0.5
    colours = matplotlib.colormaps["viridis_r"]
    norm = BoundaryNorm(edges, colours.N)
    ends = [forecast.shares.index(share) for share in forecast.ends][:MOST_PANELS]
    mesh: Any = None
    for number, s in enumerate(ends):
        axes = on.figure.add_axes((0.035 + number * 0.49, PANEL_LOW, PANEL_WIDE, PANEL_HIGH))
        chart.prepare(axes, frame)
        chart.draw_land(axes, land)
        chart.graticule(axes, frame, lines=4, size=7, labels=(True, number == 0))
        count = found.count[-1, s].astype(np.float64)
        x, y = frame.net(chart.edges(data["lon"].values), chart.edges(data["lat"].values))
        mesh = axes.pcolormesh(
            x,
            y,
            np.ma.masked_equal(count, 0.0),
            cmap=colours,
            norm=norm,
            zorder=1,
            rasterized=True,
        )
        outlines = layers.areas_of(forecast, now, [forecast.shares[s]])
        layers.outline(axes, frame, forecast, outlines, few=False, width=0.9)
        for k, line in enumerate(setting.lines):
            layers.prior_line(axes, frame, line, k)
        for mark in setting.marks:
            layers.mark_point(axes, frame, mark, 6)
        axes.set_title(
            f"{notation.hundredths(forecast.shares[s])} % areas",
            fontsize=10,
            weight="bold",
            loc="left",
            color=INK,
        )
    bar = on.figure.add_axes((0.035, 0.11, 0.455, 0.02))
    on.figure.colorbar(mesh, cax=bar, orientation="horizontal", spacing="proportional")
    bar.xaxis.set_major_locator(MaxNLocator(10, integer=True))
    bar.tick_params(labelsize=8)
    on.figure.text(0.035, 0.14, f"number of {found.what}", fontsize=8.5, color=INK)
    outline: list[tuple[Any, str]] = [
        (Line2D([], [], color=layers.INNERMOST["color"]), f"area of all {found.what} together")
    ]
    sheet.legend(
        on.figure, outline, loc="lower left", bbox_to_anchor=(0.525, 0.09), fontsize=9, borderpad=0
    )
    with page.literal_text():
        sheet.finish_page(on, path, setting.imprint)
