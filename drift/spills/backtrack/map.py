"""The picture of an origin: posterior release place as a map, and release time as bars.

Darker means more, lines differ by their dashes and bars by their fill, so that the picture is
readable in grey. Land comes from the given polygons; nothing is downloaded.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from drift.forecast import effective, mapped
from drift.forecast.products import layers
from drift.products.maps import chart, labels, page, sheet
from drift.products.maps.chart import GREY, INK, Frame
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from drift.products.maps.sheet import Badge, Page, Row, Sheet
from drift.spills.backtrack import backward, outlines, text
from drift.spills.backtrack.backward import Origin
from geo import notation
from geo.array import Array

CAVEAT = (
    "Backtrack: proposes places to look at; it does not use objects that were not found. "
    "The answer is a forward run with this release as its prior, weighted by all finds."
)
LINES = layers.lines((0.5, 0.9))
PRIOR: dict[str, Any] = {
    "color": layers.PRIOR_COLOURS[0],
    "linewidth": 1.6,
    "linestyle": layers.PRIOR_DASHES[0],
}
# prior outline, as a share of its largest density; cells with less have too few draws for a line
ALLOWED = 0.01
ROW = 0.032  # height of a row of warnings over the map, as a share of the page
BY_FINDS: dict[str, Any] = {"facecolor": "#2b2b35", "edgecolor": INK, "linewidth": 0.8}
BY_PRIOR: dict[str, Any] = {
    "facecolor": "#f2efe6",
    "edgecolor": INK,
    "linewidth": 0.8,
    "hatch": "/////",
}
MEAN: dict[str, Any] = {
    "linestyle": "none",
    "marker": "X",
    "color": layers.TRACK,
    "markeredgecolor": "white",
}
FIND: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 6,
    "markerfacecolor": "white",
    "markeredgecolor": layers.LAST_KNOWN,
    "markeredgewidth": 1.6,
}
BADGE = {
    "boxstyle": "circle,pad=0.18",
    "facecolor": "white",
    "edgecolor": layers.LAST_KNOWN,
    "linewidth": 1.2,
}
LISTED = 12  # most finds whose names are listed
MAP = (0.055, 0.17, 0.57, 0.69)  # left, bottom, width, height, as shares of the page
LEFT, RIGHT = 0.66, 0.985  # of the column beside the map
SHEET = Sheet(
    11.7,
    8.3,
    140,
    left=MAP[0],
    title=sheet.heading(0.955, 15),
    lines=(Row(0.922, 12), Row(0.892, 9.5)),
    caution=Badge(RIGHT, 0.922, side="right"),
    rough=Badge(MAP[0] + 0.003, 0.877 - ROW),
    footer=sheet.small(0.017, 7.5),
)


@dataclass(frozen=True)
class _Shown:
    """The release place over all times, as drawn."""

    density: Array  # [% per nmi2], (nlat, nlon)
    containment: Array  # share of the smallest area that holds the cell, (nlat, nlon)
    allowed: shapely.MultiPolygon  # outline of the prior
    areas: dict[float, tuple[shapely.MultiPolygon, float]]  # outline and size [nmi2] by share
    few: bool  # whether too few worlds are effective for certain outlines

    def line(self, share: float) -> dict[str, Any]:
        """Return the style of an area's outline."""
        return layers.unsure(LINES[share]) if self.few else LINES[share]


def plot_origin(origin: Origin, path: Path, setting: Setting) -> None:
    """Draw the result of drift.spills.backtrack.backward.estimate_origin into a PNG.

    setting: its marks are the finds. The label of a mark begins with its number; the rest is listed
    beside the map ("1 first box, 031516Z").
    """
    on = sheet.begin_page(SHEET)
    shown, marks = _shown(origin), setting.marks
    height = MAP[3] - ROW * shown.few
    ax = on.figure.add_axes((*MAP[:3], height))
    frame = _frame(origin, shown, marks, MAP[2] * SHEET.width / (height * SHEET.height))
    chart.prepare(ax, frame)
    mesh = _shade(ax, frame, origin, shown)
    land = chart.land_path(frame, setting.polygons(frame.box()), 1000)
    chart.draw_land(ax, land)
    chart.graticule(ax, frame)
    _outlines(ax, frame, shown)
    _points(ax, on.canvas, frame, origin, shown, marks)
    _bar(on.figure, mesh)
    _words(on, origin, setting.imprint)
    _legend(on.figure, shown, bool(marks), land is not None)
    _times(on.figure, origin)
    _figures(on.figure, origin)
    _names(on.figure, marks)
    sheet.write_line(on, sheet.heading(0.045, 9.5), CAVEAT)
    sheet.finish_page(on, path, setting.imprint)


def _shown(origin: Origin) -> _Shown:
    found = outlines.release_outlines(origin, tuple(LINES))
    area = backward.cell_area(origin)
    prior = origin.prior.sum(axis=0) / area[:, None]
    allowed = outlines.density_outline(origin, prior, ALLOWED * float(prior.max()))
    return _Shown(
        found.density, found.containment, allowed, found.areas, backward.count(origin).few
    )


def _frame(origin: Origin, shown: _Shown, marks: Sequence[Mark], aspect: float) -> Frame:
    """Return the frame of the shaded cells, the finds, and the prior's outline unless far off."""
    rows, columns = (
        np.flatnonzero(outlines.cells_of_share(shown.containment, mapped.SHOWN).any(axis=axis))
        for axis in (1, 0)
    )
    lon, lat = backward.cell_edges(origin.lon), backward.cell_edges(origin.lat)
    middle = float(lon.mean())
    x = [
        lon[columns[0]],
        lon[columns[-1] + 1],
        origin.mean[0],
        *(layers.near(mark.lon, middle) for mark in marks),
    ]
    y = [lat[rows[0]], lat[rows[-1] + 1], origin.mean[1], *(mark.lat for mark in marks)]
    west, south, east, north = shown.allowed.bounds
    margin_x, margin_y = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    x += [max(west, x[0] - margin_x), min(east, x[1] + margin_x)]
    y += [max(south, y[0] - margin_y), min(north, y[1] + margin_y)]
    return chart.frame(np.array(x), np.array(y), aspect, 0.04, least=1000.0)


def _shade(ax: Axes, frame: Frame, origin: Origin, shown: _Shown) -> Any:
    """Shade the cells by their density; the cells above the scale's top hold a tenth."""
    top = float(shown.density[outlines.cells_of_share(shown.containment, 0.1)].min())
    corners = frame.project(
        *np.meshgrid(backward.cell_edges(origin.lon), backward.cell_edges(origin.lat))
    )
    inside = np.ma.masked_where(
        ~outlines.cells_of_share(shown.containment, mapped.SHOWN), shown.density
    )
    norm = PowerNorm(0.5, 0, top)
    return ax.pcolormesh(
        *corners, inside, cmap=layers.shading(), norm=norm, zorder=1, rasterized=True
    )


def _outlines(ax: Axes, frame: Frame, shown: _Shown) -> None:
    """Draw the outlines of the prior and of the areas."""
    layers.rings(ax, frame, shown.allowed, PRIOR)
    for share, (shape, _) in shown.areas.items():
        layers.rings(ax, frame, shape, shown.line(share))
    if shown.few:
        layers.rough(ax, frame, shown.areas[max(shown.areas)][0])


def _points(
    ax: Axes,
    canvas: FigureCanvasAgg,
    frame: Frame,
    origin: Origin,
    shown: _Shown,
    marks: Sequence[Mark],
) -> None:
    """Draw the mean place, the finds with their numbers, and the scale bar in a free corner."""
    x, y = frame.project(origin.mean[0], origin.mean[1])
    ax.plot(x, y, markersize=10, zorder=11, **MEAN)
    texts: list[labels.Point] = []
    for mark in marks:
        mx, my = frame.project(mark.lon, mark.lat)
        ax.plot(mx, my, zorder=12, **FIND)
        style = {"fontsize": 8.5, "weight": "bold", "color": layers.LAST_KNOWN, "bbox": BADGE}
        texts.append((float(mx), float(my), mark.label.partition(" ")[0], style))
    rings = [ring for shape, _ in shown.areas.values() for ring in layers.rings_to_draw(shape)]
    lines = [np.column_stack(frame.project(ring[:, 0], ring[:, 1])) for ring in rings]
    drawn = np.concatenate(
        [*lines, np.array([text[:2] for text in texts]).reshape(-1, 2), [[float(x), float(y)]]]
    )
    bar = chart.scale_bar(ax, frame, chart.free_corner(frame, drawn[:, 0], drawn[:, 1]))
    labels.place_labels(ax, canvas, texts, [bar], must=set(range(len(texts))))


def _bar(figure: Figure, mesh: Any) -> None:
    bar, unit = sheet.density_bar(figure, (MAP[0] + 0.24, 0.106, MAP[2] - 0.24, 0.016), mesh)
    bar.tick_params(labelsize=8, colors=INK, length=3, pad=2)
    figure.text(
        MAP[0], 0.114, f"Probability density [% per {unit}]", fontsize=8.5, va="center", color=INK
    )


def _words(on: Page, origin: Origin, imprint: Imprint) -> None:
    """Write over the map what it shows, and the number of worlds."""
    worlds = f"{origin.worlds:,} worlds, effective {origin.effective:,.0f}"
    sheet.write_head(on, imprint, "Release proposed by tracks back from the finds", worlds)
    if backward.count(origin).few:
        sheet.draw_rough_banner(on, effective.banner(backward.count(origin), backward.ROUGH))


def _legend(figure: Figure, shown: _Shown, finds: bool, land: bool) -> None:
    rows: list[tuple[Any, str]] = [
        (
            Line2D([], [], **shown.line(share)),
            f"{100 * share:.0f} % area: {'rough, ' if shown.few else ''}{labels.number(size)} nmi²",
        )
        for share, (_, size) in shown.areas.items()
    ]
    rows.append((Line2D([], [], **PRIOR), "Allowed before the finds (prior)"))
    rows.append((Line2D([], [], markersize=10, **MEAN), "Mean place"))
    if finds:
        rows.append((Line2D([], [], **FIND), "Find, with its number"))
    if land:
        rows.append((Patch(facecolor=chart.LAND, edgecolor=chart.SHORE), "Land"))
    sheet.legend(
        figure,
        rows,
        loc="upper left",
        bbox_to_anchor=(LEFT, MAP[1] + MAP[3]),
        fontsize=9,
        labelspacing=0.55,
        handlelength=2.8,
        borderaxespad=0,
        borderpad=0,
    )


def _times(figure: Figure, origin: Origin) -> None:
    """Draw the posterior of the release time as bars before its prior, with its middle 80 %."""
    if origin.time.size == 1:
        figure.text(
            LEFT,
            0.55,
            f"Released at {notation.format_dtg(origin.time[0])}, as given",
            fontsize=9.5,
            color=INK,
        )
        return
    ax = figure.add_axes((LEFT + 0.03, 0.475, RIGHT - LEFT - 0.055, 0.155))
    seconds = notation.epochs(origin.time)
    step = float(seconds[1] - seconds[0])
    posterior, prior = (
        100 * probability.sum(axis=(1, 2)) for probability in (origin.probability, origin.prior)
    )
    ax.stairs(
        prior,
        np.append(seconds - step / 2, seconds[-1] + step / 2),
        fill=True,
        zorder=2,
        **BY_PRIOR,
    )
    ax.bar(seconds, posterior, 0.6 * step, zorder=3, **BY_FINDS)
    top = 1.22 * float(max(posterior.max(), prior.max()))
    low, half, high = (notation.epoch(when) for when in _quantiles(origin))
    ax.plot(
        [low, high], [0.92 * top] * 2, color=INK, linewidth=1.2, marker="|", markersize=7, zorder=4
    )
    ax.plot(
        half, 0.92 * top, "D", markersize=5, markerfacecolor="white", markeredgecolor=INK, zorder=5
    )
    ax.set_xlim(seconds[0] - step / 2, seconds[-1] + step / 2)
    ax.set_ylim(0, top)
    ticks = labels.round_times(*ax.get_xlim(), 4)
    ax.set_xticks(
        ticks,
        labels=[f"{notation.format_dtg(np.datetime64(int(tick), 's'))[:6]}Z" for tick in ticks],
    )
    ax.tick_params(labelsize=8, colors=INK, length=3)
    ax.locator_params(axis="y", nbins=4)
    ax.grid(axis="y", color=INK, alpha=0.25, linewidth=0.5, zorder=0)
    for spine in ax.spines.values():
        spine.set(color=INK, linewidth=0.8)
    figure.text(
        LEFT,
        0.642,
        f"Release time, UTC: % in each {_span(step)}",
        fontsize=9,
        weight="bold",
        color=INK,
    )
    middle = Line2D(
        [], [], color=INK, linewidth=1.2, marker="D", markersize=5, markerfacecolor="white"
    )
    sheet.legend(
        figure,
        [
            (Patch(**BY_FINDS), "after the finds"),
            (Patch(**BY_PRIOR), "prior"),
            (middle, "10 - 50 - 90 %"),
        ],
        loc="upper left",
        bbox_to_anchor=(LEFT, 0.444),
        ncols=3,
        fontsize=8,
        borderaxespad=0,
        borderpad=0,
        columnspacing=1.4,
    )


def _figures(figure: Figure, origin: Origin) -> None:
    """Write the posterior in figures."""
    summary = backward.summary_of_origin(origin)
    low, half, high = _quantiles(origin)
    east, north, late = origin.error
    rows = [
        ("Mean place", notation.position(origin.mean[0], origin.mean[1]) or ""),
        ("Half within", text.length_in_words(float(summary["radius_50_km"])) + " of it"),
        ("90 % within", text.length_in_words(float(summary["radius_90_km"])) + " of it"),
        ("Released", f"10 %: before {notation.format_dtg(low)}"),
        ("", f"50 %: before {notation.format_dtg(half)}"),
        ("", f"90 %: before {notation.format_dtg(high)}"),
        (
            "Error of the mean",
            f"{text.length_in_words(float(np.hypot(east, north)) / 1000)}, {text.number(late / 3600)} h",
        ),
    ]
    for k, (name, value) in enumerate(rows):
        figure.text(LEFT, 0.395 - 0.0225 * k, name, fontsize=9, color=GREY)
        figure.text(LEFT + 0.115, 0.395 - 0.0225 * k, value, fontsize=9, color=INK)


def _names(figure: Figure, marks: Sequence[Mark]) -> None:
    """List the finds that have names, by number, in two columns."""
    names = [mark.label for mark in marks if " " in mark.label]
    if len(names) > LISTED:
        names[LISTED - 1 :] = [f"and {len(names) - LISTED + 1} more"]
    if names:
        figure.text(LEFT, 0.223, "Finds", fontsize=9, color=GREY)
    for k, name in enumerate(names):
        column, row = divmod(k, LISTED // 2)
        figure.text(
            LEFT + 0.165 * column, 0.2 - 0.02 * row, page.fit(name, 31), fontsize=8, color=INK
        )


def _quantiles(origin: Origin) -> list[np.datetime64]:
    """Return the times before which 10, 50 and 90 % of the release lie."""
    summary = backward.summary_of_origin(origin)
    return [
        np.datetime64(str(summary[f"time_{share}"]).removesuffix("Z"), "s")
        for share in (10, 50, 90)
    ]


def _span(seconds: float) -> str:
    return f"{seconds / 3600:.3g} h" if seconds >= 3600 else f"{seconds / 60:.3g} min"
