"""The picture of where and when a spill may have been released: the posterior of its place as a map, of its time as bars.

Dark is more, lines differ by their dashes and bars by their fill, so that it reads in grey. Land comes from the
polygons handed in; nothing is downloaded.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import contourpy
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from drift.backtrack import backward
from drift.backtrack.backward import Origin
from drift.forecast import areas, density, effective, layers
from drift.maps import chart, labels, page, sheet
from drift.maps.chart import GREY, INK, Frame
from drift.maps.imprint import Imprint
from drift.maps.marks import Mark
from drift.maps.sheet import Badge, Page, Row, Sheet
from geo import notation
from geo.array import Array
from geo.notation import NMI

CAVEAT = (
    "Backward: proposes where to look; objects not found are left out. The answer is a forward run with this release as "
    "its prior, weighted by all finds."
)
LINES = layers.lines((0.5, 0.9))
PRIOR: dict[str, Any] = {"color": layers.PRIOR_COLOURS[0], "linewidth": 1.6, "linestyle": layers.PRIOR_DASHES[0]}
ALLOWED = 0.01  # of the prior's largest density: under that its cells hold too few draws for a line
FLOOR = float(np.exp(-4.0))  # of a line's density: less counts as that, so that lines stay near the cells that matter
ROW = 0.032  # of the page, the row of a warning over the map
BELIEVED: dict[str, Any] = {"facecolor": "#2b2b35", "edgecolor": INK, "linewidth": 0.8}
ASSUMED: dict[str, Any] = {"facecolor": "#f2efe6", "edgecolor": INK, "linewidth": 0.8, "hatch": "/////"}
MEAN: dict[str, Any] = {"linestyle": "none", "marker": "X", "color": layers.TRACK, "markeredgecolor": "white"}
FIND: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 6,
    "markerfacecolor": "white",
    "markeredgecolor": layers.LAST_KNOWN,
    "markeredgewidth": 1.6,
}
BADGE = {"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": layers.LAST_KNOWN, "linewidth": 1.2}
LISTED = 12  # finds whose names are told
MAP = (0.055, 0.17, 0.57, 0.69)  # left, bottom, width, height, of the figure
LEFT, RIGHT = 0.66, 0.985  # of what stands beside the map
SHEET = Sheet(
    11.7, 8.3, 140, left=MAP[0], title=sheet.heading(0.955, 15, 95), lines=(Row(0.922, 12), Row(0.892, 9.5)),
    caution=Badge(RIGHT, 0.922, side="right"), rough=Badge(MAP[0] + 0.003, 0.877 - ROW), footer=sheet.small(0.017, 7.5, 190),
)  # fmt: skip


@dataclass(frozen=True)
class _Shown:
    """The release place over all times: densities [% per nmi2] and the share whose area holds a cell, (nlat, nlon)."""

    density: Array
    containment: Array
    allowed: shapely.MultiPolygon
    areas: dict[float, tuple[shapely.MultiPolygon, float]]  # outline and size [nmi2] by share


def draw(
    found: Origin,
    path: Path,
    imprint: Imprint,
    *,
    polygons: Iterable[Any] = (),
    marks: Sequence[Mark] = (),
) -> None:
    """Draw what drift.backtrack.backward.backward found.

    polygons: shapely land polygons [deg]. marks: the finds, their labels beginning with their numbers: what follows is
    listed beside the map ("1 first box, 031516Z").
    """
    on = sheet.begin(SHEET)
    figure = on.figure
    shown = _shown(found)
    high = MAP[3] - ROW * backward.count(found).few
    ax = figure.add_axes((*MAP[:3], high))
    here = _extent(found, shown, marks, MAP[2] * SHEET.width / (high * SHEET.height))
    chart.prepare(ax, here)
    norm = PowerNorm(0.5, 0, _top(shown))
    corners = here.project(*np.meshgrid(backward.edges(found.lon), backward.edges(found.lat)))
    inside = np.ma.masked_where(~_within(shown.containment, layers.SHOWN), shown.density)
    mesh = ax.pcolormesh(*corners, inside, cmap=layers.shading(), norm=norm, zorder=1, rasterized=True)
    land = chart.land_path(here, polygons, 1000)
    chart.draw_land(ax, land)
    chart.graticule(ax, here)
    layers.rings(ax, here, shown.allowed, PRIOR)
    few = backward.count(found).few
    for share, (outline, _) in shown.areas.items():
        layers.rings(ax, here, outline, layers.unsure(LINES[share]) if few else LINES[share])
    if few:
        layers.rough(ax, here, shown.areas[max(shown.areas)][0])
    _points(ax, on.canvas, here, found, shown, marks)
    _bar(figure, mesh)
    _words(on, found, imprint)
    _legend(figure, shown, len(marks), land is not None, few)
    _times(figure, found)
    _figures(figure, found)
    _names(figure, marks)
    sheet.say(on, sheet.heading(0.045, 9.5), CAVEAT)
    sheet.end(on, path, imprint)


def _shown(found: Origin) -> _Shown:
    mass, area = found.probability.sum(axis=0), backward.cell_area(found)
    height = 100 * mass / (area[:, None] / NMI**2)
    contained, levels, sizes, _ = areas.containment(mass, area, density.Calibration(density.KNOTS))
    outlines = {}
    for share in LINES:
        inside = _within(contained, share)
        last, next_one = float(height[inside].min()), float(height.max(where=~inside, initial=0.0))
        least = float(np.sqrt(last * max(next_one, last * FLOOR)))  # between the last cell inside and the first outside
        outlines[share] = (_outline(found, height, least), float(np.interp(share, levels, sizes)) / NMI**2)
    assumed = found.prior.sum(axis=0) / area[:, None]
    return _Shown(height, contained, _outline(found, assumed, ALLOWED * float(assumed.max())), outlines)


def _within(containment: Array, share: float) -> Array:
    """Return the cells that hold a share, at least one."""
    return np.asarray(containment <= max(share, float(containment.min())))


def _outline(found: Origin, height: Array, least: float) -> shapely.MultiPolygon:
    """Return where a density exceeds `least` [deg], its logarithm taken linear between the centres of cells."""
    floor = least * FLOOR
    field = np.pad(np.log(np.maximum(height, floor)), 1, constant_values=np.log(floor))
    lon, lat = (
        np.concatenate([[2 * edge[0] - axis[0]], axis, [2 * edge[-1] - axis[-1]]])
        for axis, edge in ((axis, backward.edges(axis)) for axis in (found.lon, found.lat))
    )
    lines: Any = contourpy.contour_generator(lon, lat, field, fill_type=contourpy.FillType.OuterOffset)
    rings = [
        [points[a:b] for a, b in itertools.pairwise(offsets)]
        for points, offsets in zip(*lines.filled(np.log(least), np.inf), strict=True)
    ]
    return shapely.MultiPolygon([shapely.Polygon(one[0], one[1:]) for one in rings])


def _top(shown: _Shown) -> float:
    """Return the density that ends the colour scale: what exceeds it holds a tenth."""
    return float(shown.density[_within(shown.containment, 0.1)].min())


def _extent(found: Origin, shown: _Shown, marks: Sequence[Mark], aspect: float) -> Frame:
    """Return the frame of the shaded cells, the finds, and the prior's outline where it is not far off."""
    rows, columns = (np.flatnonzero(_within(shown.containment, layers.SHOWN).any(axis=axis)) for axis in (1, 0))
    lon, lat = backward.edges(found.lon), backward.edges(found.lat)
    middle = float(lon.mean())
    x = [lon[columns[0]], lon[columns[-1] + 1], found.mean[0], *(layers.near(mark.lon, middle) for mark in marks)]
    y = [lat[rows[0]], lat[rows[-1] + 1], found.mean[1], *(mark.lat for mark in marks)]
    west, south, east, north = shown.allowed.bounds
    wide, high = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    x += [max(west, x[0] - wide), min(east, x[1] + wide)]
    y += [max(south, y[0] - high), min(north, y[1] + high)]
    return chart.frame(np.array(x), np.array(y), aspect, 0.04, least=1000.0)


def _points(
    ax: Axes, canvas: FigureCanvasAgg, here: Frame, found: Origin, shown: _Shown, marks: Sequence[Mark]
) -> None:
    """Draw the mean place, the finds with their numbers, and the scale bar in a free corner."""
    x, y = here.project(found.mean[0], found.mean[1])
    ax.plot(x, y, markersize=10, zorder=11, **MEAN)
    texts: list[labels.Point] = []
    for mark in marks:
        mx, my = here.project(mark.lon, mark.lat)
        ax.plot(mx, my, zorder=12, **FIND)
        style = {"fontsize": 8.5, "weight": "bold", "color": layers.LAST_KNOWN, "bbox": BADGE}
        texts.append((float(mx), float(my), mark.label.partition(" ")[0], style))
    around = [ring for outline, _ in shown.areas.values() for ring in layers.kept(outline)]
    lines = [np.column_stack(here.project(ring[:, 0], ring[:, 1])) for ring in around]
    every = np.concatenate([*lines, np.array([text[:2] for text in texts]).reshape(-1, 2), [[float(x), float(y)]]])
    bar = chart.scale_bar(ax, here, chart.free_corner(here, every[:, 0], every[:, 1]))
    labels.place(ax, canvas, texts, [bar], must=set(range(len(texts))))


def _bar(figure: Figure, mesh: Any) -> None:
    bar, unit = sheet.density_bar(figure, (MAP[0] + 0.24, 0.106, MAP[2] - 0.24, 0.016), mesh)
    bar.tick_params(labelsize=8, colors=INK, length=3, pad=2)
    figure.text(MAP[0], 0.114, f"Probability density [% per {unit}]", fontsize=8.5, va="center", color=INK)


def _words(on: Page, found: Origin, imprint: Imprint) -> None:
    """Write over the map what it is, and how much it stands on."""
    worlds = f"{found.worlds:,} worlds, effective {found.effective:,.0f}"
    sheet.head(on, imprint, "Release proposed by tracks back from the finds", worlds)
    if backward.count(found).few:
        sheet.rough(on, effective.banner(backward.count(found), backward.ROUGH))


def _legend(figure: Figure, shown: _Shown, finds: int, land: bool, few: bool) -> None:
    rows: list[tuple[Any, str]] = [
        (
            Line2D([], [], **(layers.unsure(LINES[share]) if few else LINES[share])),
            f"{100 * share:.0f} % area: {'rough, ' if few else ''}{labels.number(size)} nmi²",
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


def _times(figure: Figure, found: Origin) -> None:
    """Draw the release time's probability as bars before its prior's, and its middle 80 % over them."""
    if found.time.size == 1:
        figure.text(LEFT, 0.55, f"Released at {notation.group(found.time[0])}, as given", fontsize=9.5, color=INK)
        return
    ax = figure.add_axes((LEFT + 0.03, 0.475, RIGHT - LEFT - 0.055, 0.155))
    seconds = notation.epochs(found.time)
    step = float(seconds[1] - seconds[0])
    believed, assumed = (100 * chance.sum(axis=(1, 2)) for chance in (found.probability, found.prior))
    ax.stairs(assumed, np.append(seconds - step / 2, seconds[-1] + step / 2), fill=True, zorder=2, **ASSUMED)
    ax.bar(seconds, believed, 0.6 * step, zorder=3, **BELIEVED)
    top = 1.22 * float(max(believed.max(), assumed.max()))
    low, half, high = (notation.epoch(when) for when in _quantiles(found))
    ax.plot([low, high], [0.92 * top] * 2, color=INK, linewidth=1.2, marker="|", markersize=7, zorder=4)
    ax.plot(half, 0.92 * top, "D", markersize=5, markerfacecolor="white", markeredgecolor=INK, zorder=5)
    ax.set_xlim(seconds[0] - step / 2, seconds[-1] + step / 2)
    ax.set_ylim(0, top)
    ticks = labels.round_times(*ax.get_xlim(), 4)
    ax.set_xticks(ticks, labels=[f"{notation.group(np.datetime64(int(tick), 's'))[:6]}Z" for tick in ticks])
    ax.tick_params(labelsize=8, colors=INK, length=3)
    ax.locator_params(axis="y", nbins=4)
    ax.grid(axis="y", color=INK, alpha=0.25, linewidth=0.5, zorder=0)
    for spine in ax.spines.values():
        spine.set(color=INK, linewidth=0.8)
    figure.text(LEFT, 0.642, f"Release time, UTC: % in each {_span(step)}", fontsize=9, weight="bold", color=INK)
    middle = Line2D([], [], color=INK, linewidth=1.2, marker="D", markersize=5, markerfacecolor="white")
    sheet.legend(
        figure,
        [(Patch(**BELIEVED), "by the finds"), (Patch(**ASSUMED), "prior"), (middle, "10 - 50 - 90 %")],
        loc="upper left",
        bbox_to_anchor=(LEFT, 0.444),
        ncols=3,
        fontsize=8,
        borderaxespad=0,
        borderpad=0,
        columnspacing=1.4,
    )


def _figures(figure: Figure, found: Origin) -> None:
    """Write the posterior in figures."""
    told = backward.summary(found)
    low, half, high = _quantiles(found)
    east, north, late = found.error
    rows = [
        ("Mean place", notation.position(found.mean[0], found.mean[1]) or ""),
        ("Half within", _length(1000 * float(told["radius_50_km"])) + " of it"),
        ("90 % within", _length(1000 * float(told["radius_90_km"])) + " of it"),
        ("Released", f"10 %: before {notation.group(low)}"),
        ("", f"50 %: before {notation.group(half)}"),
        ("", f"90 %: before {notation.group(high)}"),
        ("Error of the mean", f"{_length(float(np.hypot(east, north)))}, {late / 3600:.2g} h"),
    ]
    for k, (name, value) in enumerate(rows):
        figure.text(LEFT, 0.395 - 0.0225 * k, name, fontsize=9, color=GREY)
        figure.text(LEFT + 0.115, 0.395 - 0.0225 * k, value, fontsize=9, color=INK)


def _names(figure: Figure, marks: Sequence[Mark]) -> None:
    """List the finds by number, where they have names, in two columns."""
    names = [mark.label for mark in marks if " " in mark.label]
    if len(names) > LISTED:
        names[LISTED - 1 :] = [f"and {len(names) - LISTED + 1} more"]
    if names:
        figure.text(LEFT, 0.223, "Finds", fontsize=9, color=GREY)
    for k, name in enumerate(names):
        column, row = divmod(k, LISTED // 2)
        figure.text(LEFT + 0.165 * column, 0.2 - 0.02 * row, page.fit(name, 31), fontsize=8, color=INK)


def _quantiles(found: Origin) -> list[np.datetime64]:
    """Return the times before which 10, 50 and 90 % of the release lies."""
    told = backward.summary(found)
    return [np.datetime64(str(told[f"time_{share}"]).removesuffix("Z"), "s") for share in (10, 50, 90)]


def _length(metres: float) -> str:
    return f"{labels.number(metres / NMI)} nmi ({labels.number(metres / 1000)} km)"


def _span(seconds: float) -> str:
    return f"{seconds / 3600:.3g} h" if seconds >= 3600 else f"{seconds / 60:.3g} min"
