"""The picture of a washup: maps of the coast by expected number and by arrival time, and a table.

The table holds the ten worst stretches. Colours differ by lightness only, and lines are wider for
larger numbers, so that the picture is readable in grey; darker means more, or sooner. Land comes
from the given polygons; nothing is downloaded.
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import shapely
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from drift.forecast import effective
from drift.forecast.products import layers
from drift.products.maps import chart, gazetteer, labels, page, sheet
from drift.products.maps.chart import GREY, INK, Frame
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from drift.products.maps.sheet import Badge, Page, Row, Sheet
from drift.spills.worlds import washup
from geo import notation, sphere
from geo.array import Array
from geo.coast.segments import Segments

WORST = 10
# least probability of any arrival for a stretch to be drawn; lower if hardly any stretch reaches it
LEAST = 0.01
DECADES = 2.5  # decades of the expected number on the colour scale
LETTERS = 170  # most letters in a line of warnings
MOST_WARNED = 6  # most lines of warnings
LINE = 0.0125  # height of a further line of warnings, as a share of the figure
ROW = 0.032  # height of a row of warnings over the maps, as a share of the figure
SHEET = Sheet(
    13.0,
    9.4,
    140,
    left=0.03,
    title=sheet.heading(0.966, 15),
    lines=(Row(0.939, 11.5), Row(0.9155, 9)),
    caution=Badge(0.967, 0.917, side="right"),
    rough=Badge(0.0325, 0.878 - ROW),
    footer=sheet.small(0.012, 7.5),
)
MAP = (0.46, 0.405)  # width and height of a map, of the figure
LEFT, RIGHT = 0.03, 0.03 + MAP[0] + 0.02  # where the maps begin
PATROL, PATROL_INK = "#4fa3d1", "#0b4f8a"
NOTED = 8  # most patrols that are labelled with name, day, time and detection
FIRST: dict[str, Any] = {"facecolor": "#2b2b35", "edgecolor": INK, "linewidth": 0.8}
# box around a rank
BADGE = {"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": INK, "linewidth": 0.8}
BULK: dict[str, Any] = {
    "facecolor": "#f2efe6",
    "edgecolor": INK,
    "linewidth": 0.8,
    "hatch": "/////",
}
WORDS = {
    "ashore": "ashore",
    "afloat": "afloat",
    "pending": "not yet released",
    "sunk": "sunk",
    "gone": "left the domain or the forcing",
    "destroyed": "destroyed at once",
    "found": "found",
}


@dataclass(frozen=True)
class Patrolled:
    """A patrol: its name, time, detection probability, and the numbers of its stretches."""

    name: str
    time: np.datetime64
    detection: float
    segments: Sequence[int]


@dataclass(frozen=True)
class Patrols:
    """The patrols that a picture shows beside the coast."""

    all: Sequence[Patrolled] = ()
    called: str = "patrolled"  # name in the legend
    # whether to map only the surroundings of the patrols, and to list only their stretches
    near: bool = False


NO_PATROLS = Patrols()


@dataclass(frozen=True)
class _Shown:
    """The drawn stretches by expected number (least first), and the ten worst (worst first)."""

    number: Array  # expected number of objects
    first_arrival: Array  # median time of the first arrival [s since 1970]
    lines: list[list[Array]]  # lines (n, 2) [deg] of each stretch
    worst: Array  # listed stretches, indices in the data
    lon: Array  # middles of the listed stretches [deg]
    lat: Array
    rank: Array  # ranks of the listed stretches as in the tables, among all stretches


def plot_washup(
    data: xr.Dataset,
    segments: Segments,
    path: Path,
    setting: Setting,
    *,
    finds: Sequence[Mark] = (),
    patrols: Patrols = NO_PATROLS,
    warning: str | None = None,
    silence: str | None = None,
) -> None:
    """Draw a washup (drift.spills.worlds.washup.build_washup) at its last output time.

    Args:
        data: contents of washup.nc.
        segments: stretches of coast.
        path: the PNG to write.
        setting: its marks are where the objects were released.
        finds: where objects were found, each labelled by its number; the figures are then of
            objects not yet found.
        patrols: drawn beside the coast, the last of them with name, day, time and detection.
        warning: printed on the page, in red.
        silence: up to when the absence of reports is evidence, printed at the foot.
    """
    warned = textwrap.wrap(warning, LETTERS)[:MOST_WARNED] if warning else []
    lower = LINE * max(len(warned) - 1, 0)
    on = sheet.begin_page(replace(SHEET, rough=Badge(0.0325, 0.878 - ROW - lower)))
    near = patrols.near and any(patrol.segments for patrol in patrols.all)
    shown = _shown(
        data,
        segments,
        {int(k) for patrol in patrols.all for k in patrol.segments} if near else None,
    )
    count = _count(data)
    height = MAP[1] - ROW * count.few - lower
    walked = [
        [part for k in patrol.segments for part in _parts(segments, k)] for patrol in patrols.all
    ]
    frame = _extent(
        segments,
        shown,
        [*setting.marks, *finds],
        walked,
        MAP[0] * SHEET.width / (height * SHEET.height),
        near,
    )
    land = chart.land_path(frame, setting.polygons(frame.box()), 1000)
    numbers, times = _scales(shown)
    norm, when = LogNorm(*numbers, clip=True), Normalize(*times)
    widths = 1.4 + 4.6 * np.asarray(norm(np.maximum(shown.number, numbers[0])))
    for left, values, scale, colours in (
        (LEFT, shown.number, norm, _dark_is_more()),
        (RIGHT, shown.first_arrival, when, _dark_is_more().reversed()),
    ):
        ax = on.figure.add_axes((left, 0.465, MAP[0], height))
        chart.prepare(ax, frame)
        chart.draw_land(ax, land)
        chart.graticule(ax, frame, labels=(True, left == LEFT))
        _patrolled(ax, frame, walked)
        _coast(ax, frame, shown, values, widths, scale, colours)
        notes = _beside(frame, patrols.all, walked) if left == LEFT else []
        _points(ax, on.canvas, frame, shown, setting.marks, finds, notes)
    if len(shown.number):
        words = "Expected, not yet found" if finds else "Expected number ashore"
        _bar(
            on.figure,
            norm,
            LEFT,
            words,
            {tick: labels.plain(tick) for tick in _round_numbers(*numbers)},
        )
        words = "Median of the first arrival, UTC"
        _bar(
            on.figure,
            when,
            RIGHT,
            words,
            {tick: _short(tick) for tick in labels.round_times(*times, 6)},
        )
        _chart(on.figure, data, shown)
        visible = [
            mark for mark in setting.marks if frame.holds(*frame.project(mark.lon, mark.lat))
        ]
        _key(on.figure, (setting.known_as, len(visible)), patrols.called if patrols.all else "")
    else:
        end = _moment(data["time"].values[-1])
        text = f"None of the {_spills(data)} simulated spills puts any object ashore by {end}"
        on.figure.text(0.5, 0.25, text, fontsize=13, weight="bold", ha="center", color=INK)
    _words(on, data, setting.imprint, len(finds))
    if count.few:
        sheet.draw_rough_banner(on, effective.banner(count, "numbers, ranges and times are rough"))
    for k, line in enumerate(warned):
        sheet.write_line(on, sheet.warning(0.879 - LINE * k, 7.5, "center"), line)
    if silence:
        sheet.write_line(on, sheet.small(0.0245, 7.5), f"Assumed: {silence}")
    sheet.finish_page(on, path, setting.imprint)


def _parts(segments: Segments, number: int) -> list[Array]:
    """Return the lines of a stretch, each (n, 2) [deg]."""
    return [np.array(part.coords) for part in shapely.get_parts(segments.lines[number])]


def _scales(shown: _Shown) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ends of the colour scales: expected number, and time [s since 1970]."""
    most = float(shown.number.max(initial=0.0)) or 1.0
    hours = np.append(shown.first_arrival, [] if len(shown.first_arrival) else 0.0) / 3600
    first = float(np.floor(hours.min()))
    return (most / 10**DECADES, most), (
        3600 * first,
        3600 * max(float(np.ceil(hours.max())), first + 1),
    )


def _shown(data: xr.Dataset, segments: Segments, only: set[int] | None) -> _Shown:
    """Return the stretches to draw; only: numbers of stretches that may be listed, None: all."""
    ever, number = data["ever"].values, data["expected"].values[-1]
    order = washup.worst_stretches(data)
    drawn = np.flatnonzero(ever[order] >= min(LEAST, 0.1 * ever.max(initial=0.0)))
    index = order[drawn]
    lines = [_parts(segments, number) for number in data["segment"].values[index]]
    listed = (
        drawn
        if only is None
        else np.flatnonzero(np.isin(data["segment"].values[order], list(only)))
    )
    worst = order[listed[:WORST]]
    return _Shown(
        number=number[index[::-1]],
        first_arrival=data["first_arrival"].values[1, index[::-1]],
        lines=lines[::-1],
        worst=worst,
        lon=data["lon"].values[worst],
        lat=data["lat"].values[worst],
        rank=listed[:WORST] + 1,
    )


def _extent(
    segments: Segments,
    shown: _Shown,
    marks: Sequence[Mark],
    walked: Sequence[list[Array]],
    aspect: float,
    near: bool,
) -> Frame:
    """Return the frame of the drawn stretches, patrols and marks; near: of the patrols only.

    If nothing is drawn, all stretches count.
    """
    lines = walked if near else (*shown.lines, *walked)
    marks = [] if near else marks
    points = np.concatenate([part for parts in lines for part in parts] or [np.empty((0, 2))])
    if not len(points):
        points = np.column_stack([segments.lon, segments.lat]).reshape(-1, 2)
    points = np.concatenate(
        [points, np.array([(mark.lon, mark.lat) for mark in marks]).reshape(-1, 2)]
    )
    if not len(points):
        points = np.zeros((1, 2))
    turn = np.radians(points[:, 0])
    middle = float(np.degrees(np.arctan2(np.sin(turn).mean(), np.cos(turn).mean())))
    lon, margin = sphere.near_degrees(points[:, 0], middle), 0.3 if near else 0.06
    return chart.frame(lon, points[:, 1], aspect, margin, least=5000.0)


def _dark_is_more() -> Colormap:
    """Return reversed magma without its nearly white end, which is invisible on a coastline."""
    return ListedColormap(
        matplotlib.colormaps["magma_r"](np.linspace(0.06, 0.98, 128)), name="dark_is_more"
    )


def _coast(
    ax: Axes,
    frame: Frame,
    shown: _Shown,
    values: Array,
    widths: Array,
    scale: Normalize,
    colours: Colormap,
) -> None:
    """Draw the stretches, the worst on top, with an ink outline to contrast with land and sea."""
    parts = [np.column_stack(frame.project(*part.T)) for parts in shown.lines for part in parts]
    owner = np.repeat(np.arange(len(shown.lines)), [len(parts) for parts in shown.lines])
    style: dict[str, Any] = {"capstyle": "round", "joinstyle": "round"}
    inks = colours(scale(values))[owner] if len(values) else []
    # drawn in pieces, so that the casing of worse stretches covers lesser ones
    for i in range(0, len(parts), 64):
        some = slice(i, i + 64)
        thick = widths[owner[some]]
        ax.add_collection(
            LineCollection(parts[some], linewidths=thick + 1.3, colors=INK, zorder=6, **style),
            False,
        )
        ax.add_collection(
            LineCollection(parts[some], linewidths=thick, colors=inks[some], zorder=6, **style),
            False,
        )


def _points(
    ax: Axes,
    canvas: FigureCanvasAgg,
    frame: Frame,
    shown: _Shown,
    marks: Sequence[Mark],
    finds: Sequence[Mark],
    notes: Sequence[labels.Point],
) -> None:
    """Draw the release, the worst stretches, finds, labels of patrols, and the scale bar."""
    texts: list[labels.Point] = []
    x, y = frame.project(shown.lon, shown.lat)
    some = frame.holds(x, y)
    x, y = x[some], y[some]
    ax.plot(
        x,
        y,
        "o",
        markersize=3.6,
        markerfacecolor="white",
        markeredgecolor=INK,
        markeredgewidth=0.8,
        zorder=8,
    )
    for rank, px, py in zip(shown.rank[some], x, y, strict=True):
        style = {"fontsize": 8.5, "weight": "bold", "color": INK, "bbox": BADGE}
        texts.append((float(px), float(py), f"{rank}", style))
    must = len(texts)
    marks, finds = (
        [m for m in own if frame.holds(*frame.project(m.lon, m.lat))] for own in (marks, finds)
    )
    for mark in marks:
        layers.mark_point(ax, frame, mark, 8)
        mx, my = frame.project(mark.lon, mark.lat)
        style = {"fontsize": 9, "color": layers.LAST_KNOWN, "weight": "bold"}
        texts.append((float(mx), float(my), mark.label, style))
    must += len(marks)
    triangle: dict[str, Any] = {
        "markersize": 7,
        "markerfacecolor": "white",
        "markeredgecolor": layers.LAST_KNOWN,
    }
    for mark in finds:
        mx, my = frame.project(mark.lon, mark.lat)
        ax.plot(mx, my, "^", zorder=9, **triangle)
        style = {"fontsize": 8, "color": layers.LAST_KNOWN, "weight": "bold"}
        texts.append((float(mx), float(my), f"▲{mark.label}", style))
    texts += notes
    coast = [np.column_stack(frame.project(*part.T)) for parts in shown.lines for part in parts]
    every = np.concatenate([*coast, np.array([text[:2] for text in texts]).reshape(-1, 2)])
    bar = chart.scale_bar(ax, frame, chart.free_corner(frame, every[:, 0], every[:, 1]))
    taken = [bar, *_along(frame, coast)]
    labels.place_labels(ax, canvas, texts, taken, must=set(range(must)))


def _patrolled(ax: Axes, frame: Frame, walked: Sequence[list[Array]]) -> None:
    """Draw the patrolled stretches as a wide band under the coast."""
    parts = [np.column_stack(frame.project(*part.T)) for parts in walked for part in parts]
    band = LineCollection(
        parts, linewidths=14, colors=PATROL, alpha=0.55, zorder=5, capstyle="butt"
    )
    ax.add_collection(band, autolim=False)


def _beside(
    frame: Frame, patrols: Sequence[Patrolled], walked: Sequence[list[Array]]
) -> list[labels.Point]:
    """Return labels of the last patrols: name, day, time and detection.

    Each stands in the middle of the patrol's longest stretch.
    """
    points: list[labels.Point] = []
    for k in sorted(range(len(patrols)), key=lambda k: patrols[k].time)[-NOTED:]:
        longest = max(walked[k], key=lambda part: float(shapely.LineString(part).length))
        x, y = frame.project(*longest[len(longest) // 2])
        when = f"{notation.day_time(patrols[k].time)} {notation.hundredths(patrols[k].detection)} %"
        words = f"{page.fit(patrols[k].name, 22)}\n{when}"
        points.append(
            (float(x), float(y), words, {"fontsize": 8, "color": PATROL_INK, "weight": "bold"})
        )
    return points


def _along(frame: Frame, coast: Sequence[Array]) -> list[Bbox]:
    """Return small boxes [axes fraction] along lines [m], which labels must avoid."""
    mesh = (frame.x[1] - frame.x[0]) / 60
    dense = [
        shapely.get_coordinates(shapely.segmentize(shapely.LineString(part), mesh / 2))
        for part in coast
    ]
    corner = np.array([frame.x[0], frame.y[0]])
    meshes = np.unique(
        np.floor((np.concatenate([*dense, np.empty((0, 2))]) - corner) / mesh), axis=0
    )
    aspect = (frame.x[1] - frame.x[0]) / (frame.y[1] - frame.y[0])
    return [
        Bbox.from_bounds(x / 60 + 0.004, (y / 60 + 0.004) * aspect, 1 / 120, aspect / 120)
        for x, y in meshes
    ]


def _bar(
    figure: Figure, norm: Normalize, left: float, words: str, ticks: Mapping[float, str]
) -> None:
    """Draw the colour scale of a map under it, with its tick labels."""
    numbers = isinstance(norm, LogNorm)
    colours = _dark_is_more() if numbers else _dark_is_more().reversed()
    figure.text(left, 0.421, words, fontsize=8.5, va="center", color=INK)
    bar = figure.add_axes((left + 0.17, 0.4145, MAP[0] - 0.18, 0.013))
    mappable = matplotlib.cm.ScalarMappable(norm, colours)
    figure.colorbar(
        mappable, cax=bar, orientation="horizontal", extend="min" if numbers else "neither"
    )
    bar.tick_params(labelsize=8, colors=INK, length=3, pad=2)
    bar.set_xticks(list(ticks), labels=list(ticks.values()))
    bar.minorticks_off()


def _chart(figure: Figure, data: xr.Dataset, shown: _Shown) -> None:
    """Draw when the first object and the bulk reach each of the worst stretches, with a table."""
    ax = figure.add_axes((0.285, 0.085, 0.39, 0.265))
    at = data.isel(segment=shown.worst)
    first, bulk = at["first_arrival"].values, at["bulk_arrival"].values
    y = np.arange(len(shown.worst))
    for values, offset, style, tick in ((first, -0.2, FIRST, "white"), (bulk, 0.2, BULK, INK)):
        ax.barh(y + offset, values[2] - values[0], 0.34, values[0], zorder=3, **style)
        ax.scatter(
            values[1], y + offset, 26, tick, marker="D", edgecolor=INK, linewidth=0.9, zorder=5
        )
    begin, end = (notation.epoch(data[name].values.ravel()[-1]) for name in ("start", "time"))
    ax.set_xlim(min(begin, first.min()), max(end, bulk.max()))
    ax.set_ylim(WORST - 0.4, -0.6)
    ticks = labels.round_times(*ax.get_xlim(), 7)
    ax.set_xticks(ticks, labels=[_short(tick) for tick in ticks])
    ax.set_yticks([])
    ax.tick_params(labelsize=8, colors=INK, length=3)
    ax.grid(axis="x", color=INK, alpha=0.25, linewidth=0.5, zorder=0)
    ax.set_facecolor("white")
    for spine in ax.spines.values():
        spine.set(color=INK, linewidth=0.8)
    _rows(ax, at, shown.rank)


def _rows(ax: Axes, at: xr.Dataset, rank: Array) -> None:
    """Write each stretch's rank, name and place left of the chart, and its figures to the right."""
    place = ax.get_yaxis_transform()
    middle = [
        notation.position(*xy) or "" for xy in zip(at["lon"].values, at["lat"].values, strict=True)
    ]
    names = []
    for i, name in enumerate(map(str, at["name"].values)):
        unnamed = middle[i] in name  # the name of a stretch without one is its place
        beside = (
            at["near_distance"].values[i] <= gazetteer.BESIDE
            and not at["near_across_water"].values[i]
        )
        town = f", {at['near'].values[i]}" if beside else ""
        near = page.fit(f"stretch {at['segment'].values[i]}{town}", 27)
        names.append(near if name == middle[i] else page.fit(name, 44 if unnamed else 27))
        middle[i] = "" if unnamed and name != middle[i] else middle[i]
    columns: list[tuple[float, str, str, list[str]]] = [
        (-0.635, "left", "Stretch", names),
        (-0.025, "right", "Middle", middle),
        (0.0, "left", "When, day and time UTC", []),
        (
            1.125,
            "right",
            "10-50-90 %",
            ["-".join(f"{v:,.0f}" for v in row) for row in at["number"].values[:, -1].T],
        ),
        (1.25, "right", "Expected", [labels.number(v) for v in at["expected"].values[-1]]),
        (
            1.385,
            "right",
            "+-",
            [f"{v:.2g}" if np.isfinite(v) else "" for v in at["expected_se"].values[-1]],
        ),
        (
            1.54,
            "right",
            "At least one",
            [notation.percent(v) for v in at["probability"].values[-1]],
        ),
        (
            1.735,
            "right",
            "Ever, unfound" if at["total"].sel(fate="found").values[-1] > 0 else "Ever arrived",
            [labels.number(v) for v in at["arrived"].values[-1]],
        ),
    ]
    for x, side, head, texts in columns:
        ax.text(x, -0.85, head, transform=place, ha=side, va="bottom", fontsize=8, color=GREY)
        for y, text in enumerate(texts):
            ax.text(
                x,
                y,
                text,
                transform=place,
                ha=side,
                va="center",
                fontsize=8.5 if x > 0 else 8,
                color=INK,
            )
    for y in range(at.sizes["segment"]):
        number: dict[str, Any] = {"fontsize": 8, "weight": "bold", "color": INK, "bbox": BADGE}
        ax.text(-0.664, y, f"{rank[y]}", transform=place, ha="center", va="center", **number)


def _key(figure: Figure, marks: tuple[str, int], patrolled: str) -> None:
    """Write the legend of the chart's bars and the maps' marks."""
    shape: dict[str, Any] = {
        "linestyle": "none",
        "marker": "D",
        "markersize": 5,
        "markeredgecolor": INK,
    }
    medians = [Line2D([], [], markerfacecolor=colour, **shape) for colour in ("white", INK)]
    rows: list[tuple[Any, str]] = [
        (Patch(**FIRST), "first object arrives, 10 to 90 %"),
        (Patch(**BULK), "bulk (median of a spill's objects there), 10 to 90 %"),
        (medians, "medians"),
    ]
    if marks[1]:
        symbol = layers.mark_symbol(7, 11)
        rows.append((symbol, marks[0] if marks[1] == 1 else f"{marks[0]}s"))
    if patrolled:
        rows.append((Line2D([], [], color=PATROL, alpha=0.55, linewidth=8), patrolled))
    sheet.legend(
        figure,
        rows,
        loc="center left",
        bbox_to_anchor=(0.024, 0.0465),
        ncols=len(rows),
        fontsize=8,
        borderaxespad=0,
        columnspacing=1.4,
    )
    figure.text(
        0.7,
        0.047,
        "Times are taken from the simulated spills in which an object arrives.\n"
        "+-: sampling error of the expected number.\n"
        f"Not drawn: stretches reached with a probability below {100 * LEAST:g} %.",
        fontsize=7.5,
        color=GREY,
        va="center",
        linespacing=1.4,
    )


def _words(on: Page, data: xr.Dataset, imprint: Imprint, finds: int) -> None:
    """Write title, valid time, basis, account and the number of finds over the maps."""
    begin, end = data["start"].values[()], data["time"].values[-1]
    hours = (end - begin) / np.timedelta64(1, "h")
    valid = f"Washup by {_moment(end)}, {notation.number(round(hours, 2))} h after the start, {notation.format_dtg(begin)}"
    sheet.write_head(on, imprint, valid, _basis(data))
    account = _account(data)
    sheet.write_line(on, sheet.heading(0.8905, min(9.5, 1320 / len(account))), account)
    if finds:
        text = f"▲ after {finds} find{'s' * (finds > 1)}: numbers are of those not yet found"
        on.figure.text(
            0.967, 0.945, text, fontsize=9, color=layers.LAST_KNOWN, ha="right", va="center"
        )


def _basis(data: xr.Dataset) -> str:
    worlds, many = data.sizes["world"], data["effective_worlds"].item()
    each = data["realisations"].item()
    return (
        f"{worlds:,} worlds, effective {many:,.0f}, of {each} simulated "
        f"spill{'s' if each > 1 else ''} each   ·   "
        f"{data['total'].values[:, -1].sum():,.1f}".removesuffix(".0")
        + " objects lost"
    )


def _count(data: xr.Dataset) -> effective.Count:
    return effective.Count(data["effective_worlds"].item(), data.sizes["world"], "worlds")


def _account(data: xr.Dataset) -> str:
    """Return the account at the end in words: expected numbers, with 10 to 90 % if they vary."""
    parts = []
    for fate in ("ashore", "afloat", "pending", "sunk", "gone", "destroyed", "found"):
        at = data.isel(time=-1).sel(fate=fate)
        low, _, high = at["total_number"].values
        if high > 0 or at["total"].item() >= 0.05:
            span = f" ({low:,.0f} to {high:,.0f})" if high > low else ""
            parts.append(f"{WORDS[fate]} {labels.number(at['total'].item())}{span}")
    return "Objects at the end, expected (10 to 90 %):  " + "   ·   ".join(parts)


def _spills(data: xr.Dataset) -> str:
    return f"{data.sizes['world'] * data['realisations'].item():,}"


def _moment(time: np.datetime64) -> str:
    return f"{notation.format_dtg(time)} ({notation.iso(time)}, UTC)"


def _short(seconds: float) -> str:
    """Return a time [s since 1970] as day and time, 211830Z."""
    return notation.day_time(np.datetime64(round(seconds), "s"))


def _round_numbers(low: float, high: float) -> Array:
    """Return 1, 2 and 5 times the powers of ten between two numbers."""
    power = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.outer(power, [1, 2, 5]).ravel()
    return np.asarray(ticks[(ticks >= low) & (ticks <= high)])
