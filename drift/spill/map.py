"""The picture of a washup: the coast by expected number, by arrival time, and when the ten worst stretches get theirs.

Colour runs with lightness alone and width runs with the number, so that the picture reads in grey; dark is more, and
sooner. Land comes from the polygons handed in; nothing is downloaded.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
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
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from drift.forecast import effective, layers
from drift.maps import chart, labels, page, sheet
from drift.maps.chart import GREY, INK, Frame
from drift.maps.imprint import Imprint
from drift.maps.marks import Mark
from drift.maps.sheet import Badge, Page, Row, Sheet
from drift.spill import washup
from geo import notation, sphere
from geo.array import Array
from geo.coast.segments import Segments

WORST = 10
LEAST = 0.01  # probability of any arrival under which a stretch is not drawn, unless hardly any has more
DECADES = 2.5  # of the expected number on the colour scale
ROW = 0.032  # of the figure, the row of a warning over the maps
SHEET = Sheet(
    13.0, 9.4, 140, left=0.03, title=sheet.heading(0.966, 15, 95), lines=(Row(0.939, 11.5), Row(0.9155, 9)),
    caution=Badge(0.967, 0.917, side="right"), rough=Badge(0.0325, 0.878 - ROW), footer=sheet.small(0.012, 7.5, 190),
)  # fmt: skip
MAP = (0.46, 0.405)  # of the figure
PATROL, PATROL_INK = "#4fa3d1", "#0b4f8a"
TOLD = 8  # patrols beside which day, time and detection are written
FIRST: dict[str, Any] = {"facecolor": "#2b2b35", "edgecolor": INK, "linewidth": 0.8}
BULK: dict[str, Any] = {"facecolor": "#f2efe6", "edgecolor": INK, "linewidth": 0.8, "hatch": "/////"}
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
    """A patrol: its name, when it was, what share it finds of what lies there, and its stretches by number."""

    name: str
    time: np.datetime64
    detection: float
    segments: Sequence[int]


@dataclass(frozen=True)
class _Shown:
    """What is drawn: stretches in order of their number (least first), and the ten worst of them (worst first)."""

    index: Array  # of the stretches in the data
    number: Array  # expected
    sooner: Array  # median time of the first arrival [s since 1970]
    lines: list[list[Array]]  # of each stretch, its parts' (n, 2) [deg]
    worst: Array  # those that are listed, indices in the data
    rank: Array  # of these, as the tables number them: stretches that are not drawn have theirs too


def draw(
    data: xr.Dataset,
    segments: Segments,
    path: Path,
    imprint: Imprint,
    *,
    polygons: Iterable[Any] = (),
    marks: Sequence[Mark] = (),
    known_as: str = "Release",
    finds: Sequence[Mark] = (),
    patrols: Sequence[Patrolled] = (),
    patrolled: str = "patrolled",
    near: bool = False,
    warning: str | None = None,
) -> None:
    """Draw a washup (see drift.spill.washup.build) at its last output time.

    polygons: shapely land polygons [deg]. marks: where the objects were released; known_as: what they are. finds: where
    objects were found, each labelled by its number; numbers are of those not yet found. patrols: drawn beside the
    coast, the last of them with name, day, time and detection; patrolled: what they are called. near: the maps show
    what is patrolled, and of the rest what lies about it, and the table lists that. warning: printed on the page, in
    red.
    """
    on = sheet.begin(SHEET)
    figure = on.figure
    near = near and any(one.segments for one in patrols)
    shown = _shown(data, segments, {int(k) for one in patrols for k in one.segments} if near else None)
    bottom, count = 0.465, _count(data)
    high = MAP[1] - ROW * count.few
    walked = [
        [np.array(part.coords) for k in one.segments for part in shapely.get_parts(segments.lines[k])]
        for one in patrols
    ]
    here = _extent(segments, shown, marks, walked, MAP[0] * SHEET.width / (high * SHEET.height), near)
    land = chart.land_path(here, polygons, 1000)
    most = float(shown.number.max(initial=0.0)) or 1.0
    numbers = (most / 10**DECADES, most)
    hours = np.append(shown.sooner, [] if len(shown.sooner) else 0.0) / 3600
    first = float(np.floor(hours.min()))
    times = (3600 * first, 3600 * max(float(np.ceil(hours.max())), first + 1))
    norm, when = LogNorm(*numbers, clip=True), Normalize(*times)
    widths = 1.4 + 4.6 * np.asarray(norm(np.maximum(shown.number, numbers[0])))
    for left, values, scale, colours in (
        (0.03, shown.number, norm, _dark_is_more()),
        (0.03 + MAP[0] + 0.02, shown.sooner, when, _dark_is_more().reversed()),
    ):
        ax = figure.add_axes((left, bottom, MAP[0], high))
        chart.prepare(ax, here)
        chart.draw_land(ax, land)
        chart.graticule(ax, here, labels=(True, left < 0.1))
        _patrolled(ax, here, walked)
        _coast(ax, here, shown, values, widths, scale, colours)
        fx, fy = here.project(np.array([m.lon for m in finds]), np.array([m.lat for m in finds]))
        some = _within(here, fx, fy)
        ax.plot(
            fx[some], fy[some], "^", markersize=7, markerfacecolor="white", markeredgecolor=layers.LAST_KNOWN, zorder=9
        )
        beside = _told(here, patrols, walked) if left < 0.1 else []
        _points(ax, on.canvas, here, data, shown, marks, finds, beside)
    if len(shown.index):
        bar = _bar(
            figure, norm, _dark_is_more(), 0.03, "min", "Expected, not yet found" if finds else "Expected number ashore"
        )
        ticks = _round_numbers(*numbers)
        bar.set_xticks(ticks, labels=[labels.plain(tick) for tick in ticks])
        bar.minorticks_off()
        bar = _bar(
            figure,
            when,
            _dark_is_more().reversed(),
            0.03 + MAP[0] + 0.02,
            "neither",
            "Median of the first arrival, UTC",
        )
        ticks = labels.round_times(*times, 6)
        bar.set_xticks(ticks, labels=[_short(tick) for tick in ticks])
        _chart(figure, data, shown)
        there = [mark for mark in marks if _within(here, *here.project(mark.lon, mark.lat))]
        _key(figure, (known_as, len(there)), patrolled if patrols else "")
    else:
        text = (
            f"None of the {_spills(data)} simulated spills puts any object ashore by {_moment(data['time'].values[-1])}"
        )
        figure.text(0.5, 0.25, text, fontsize=13, weight="bold", ha="center", color=INK)
    _words(on, data, imprint)
    if finds:
        told = f"▲ after {len(finds)} find{'s' * (len(finds) > 1)}: numbers are of those not yet found"
        figure.text(0.967, 0.945, told, fontsize=9, color=layers.LAST_KNOWN, ha="right", va="center")
    if count.few:
        sheet.rough(on, effective.banner(count, "numbers, ranges and times are rough"))
    if warning:
        sheet.say(on, sheet.warning(0.879, 7.5, 210, "center"), warning)
    sheet.end(on, path, imprint)


def _shown(data: xr.Dataset, segments: Segments, told: set[int] | None) -> _Shown:
    """Return what is drawn; told: numbers of the stretches that are listed instead of the worst of all."""
    ever, number = data["ever"].values, data["expected"].values[-1]
    order = washup.worst(data)
    drawn = np.flatnonzero(ever[order] >= min(LEAST, 0.1 * ever.max(initial=0.0)))
    index = order[drawn]
    lines = [
        [np.array(part.coords) for part in shapely.get_parts(segments.lines[i])] for i in data["segment"].values[index]
    ]
    listed = drawn if told is None else np.flatnonzero(np.isin(data["segment"].values[order], list(told)))
    return _Shown(
        index=index[::-1],
        number=number[index[::-1]],
        sooner=data["first_arrival"].values[1, index[::-1]],
        lines=lines[::-1],
        worst=order[listed[:WORST]],
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
    """Return the frame of the stretches that are drawn, or of all if none is, of what was patrolled, and of the marks; near: of patrols alone."""
    lines = walked if near else (*shown.lines, *walked)
    marks = [] if near else marks
    points = np.concatenate([part for parts in lines for part in parts] or [np.empty((0, 2))])
    if not len(points):
        points = np.column_stack([segments.lon, segments.lat]).reshape(-1, 2)
    points = np.concatenate([points, np.array([(mark.lon, mark.lat) for mark in marks]).reshape(-1, 2)])
    if not len(points):
        points = np.zeros((1, 2))
    turn = np.radians(points[:, 0])
    middle = float(np.degrees(np.arctan2(np.sin(turn).mean(), np.cos(turn).mean())))
    lon, margin = sphere.near_degrees(points[:, 0], middle), 0.3 if near else 0.06
    return chart.frame(lon, points[:, 1], aspect, margin, least=5000.0)


def _dark_is_more() -> Colormap:
    """Magma reversed without its nearly white end, which a coastline does not show."""
    return ListedColormap(matplotlib.colormaps["magma_r"](np.linspace(0.06, 0.98, 128)), name="dark_is_more")


def _coast(
    ax: Axes, here: Frame, shown: _Shown, values: Array, widths: Array, scale: Normalize, colours: Colormap
) -> None:
    """Draw the stretches, the worst on top, each cased in ink: the lightest stand out from land and sea too."""
    parts = [np.column_stack(here.project(*part.T)) for parts in shown.lines for part in parts]
    owner = np.repeat(np.arange(len(shown.lines)), [len(parts) for parts in shown.lines])
    style: dict[str, Any] = {"capstyle": "round", "joinstyle": "round"}
    inks = colours(scale(values))[owner] if len(values) else []
    for i in range(0, len(parts), 64):  # in pieces, so that the casing of the worst covers the lesser ones
        some = slice(i, i + 64)
        thick = widths[owner[some]]
        ax.add_collection(LineCollection(parts[some], linewidths=thick + 1.3, colors=INK, zorder=6, **style), False)
        ax.add_collection(LineCollection(parts[some], linewidths=thick, colors=inks[some], zorder=6, **style), False)


def _points(
    ax: Axes,
    canvas: FigureCanvasAgg,
    here: Frame,
    data: xr.Dataset,
    shown: _Shown,
    marks: Sequence[Mark],
    finds: Sequence[Mark],
    told: Sequence[labels.Point],
) -> None:
    """Draw the release, the numbers of the worst stretches and of finds, what is told of patrols, and the scale bar, apart."""
    texts: list[labels.Point] = []
    badge = {"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": INK, "linewidth": 0.8}
    x, y = here.project(data["lon"].values[shown.worst], data["lat"].values[shown.worst])
    some = _within(here, x, y)
    x, y = x[some], y[some]
    ax.plot(x, y, "o", markersize=3.6, markerfacecolor="white", markeredgecolor=INK, markeredgewidth=0.8, zorder=8)
    for rank, px, py in zip(shown.rank[some], x, y, strict=True):
        style = {"fontsize": 8.5, "weight": "bold", "color": INK, "bbox": badge}
        texts.append((float(px), float(py), f"{rank}", style))
    must = len(texts)
    marks, finds = ([m for m in own if _within(here, *here.project(m.lon, m.lat))] for own in (marks, finds))
    for mark in marks:
        layers.mark_point(ax, here, mark, 8)
        mx, my = here.project(mark.lon, mark.lat)
        style = {"fontsize": 9, "color": layers.LAST_KNOWN, "weight": "bold"}
        texts.append((float(mx), float(my), mark.label, style))
    must += len(marks)
    for mark in finds:
        mx, my = here.project(mark.lon, mark.lat)
        style = {"fontsize": 8, "color": layers.LAST_KNOWN, "weight": "bold"}
        texts.append((float(mx), float(my), f"▲{mark.label}", style))
    texts += told
    coast = [np.column_stack(here.project(*part.T)) for parts in shown.lines for part in parts]
    every = np.concatenate([*coast, np.array([text[:2] for text in texts]).reshape(-1, 2)])
    bar = chart.scale_bar(ax, here, chart.free_corner(here, every[:, 0], every[:, 1]))
    taken = [bar, *_along(here, coast)]
    labels.place(ax, canvas, texts, taken, must=set(range(must)))


def _within(here: Frame, x: Array, y: Array) -> Array:
    """Return whether points [m] are on a map."""
    return np.asarray((here.x[0] <= x) & (x <= here.x[1]) & (here.y[0] <= y) & (y <= here.y[1]))


def _patrolled(ax: Axes, here: Frame, walked: Sequence[list[Array]]) -> None:
    """Draw what was patrolled as a wide band under the coast."""
    parts = [np.column_stack(here.project(*part.T)) for parts in walked for part in parts]
    band = LineCollection(parts, linewidths=14, colors=PATROL, alpha=0.55, zorder=5, capstyle="butt")
    ax.add_collection(band, autolim=False)


def _told(here: Frame, patrols: Sequence[Patrolled], walked: Sequence[list[Array]]) -> list[labels.Point]:
    """Return what is written beside the last of the patrols: name, day, time and detection, at the middle of their longest stretch."""
    found: list[labels.Point] = []
    order = sorted(range(len(patrols)), key=lambda k: patrols[k].time)[-TOLD:]
    for k in order:
        longest = max(walked[k], key=lambda part: float(shapely.LineString(part).length))
        x, y = here.project(*longest[len(longest) // 2])
        told = f"{notation.group(patrols[k].time)[:6]}Z {100 * patrols[k].detection:.0f} %"
        words = f"{page.fit(patrols[k].name, 22)}\n{told}"
        found.append((float(x), float(y), words, {"fontsize": 8, "color": PATROL_INK, "weight": "bold"}))
    return found


def _along(here: Frame, coast: Sequence[Array]) -> list[Bbox]:
    """Return small boxes [axes fraction] along lines [m], for labels to keep off."""
    mesh = (here.x[1] - here.x[0]) / 60
    dense = [shapely.get_coordinates(shapely.segmentize(shapely.LineString(part), mesh / 2)) for part in coast]
    corner = np.array([here.x[0], here.y[0]])
    meshes = np.unique(np.floor((np.concatenate([*dense, np.empty((0, 2))]) - corner) / mesh), axis=0)
    aspect = (here.x[1] - here.x[0]) / (here.y[1] - here.y[0])
    return [Bbox.from_bounds(x / 60 + 0.004, (y / 60 + 0.004) * aspect, 1 / 120, aspect / 120) for x, y in meshes]


def _bar(figure: Figure, norm: Normalize, colours: Colormap, left: float, extend: str, words: str) -> Axes:
    figure.text(left, 0.421, words, fontsize=8.5, va="center", color=INK)
    bar = figure.add_axes((left + 0.17, 0.4145, MAP[0] - 0.18, 0.013))
    mappable = matplotlib.cm.ScalarMappable(norm, colours)
    figure.colorbar(mappable, cax=bar, orientation="horizontal", extend=extend)
    bar.tick_params(labelsize=8, colors=INK, length=3, pad=2)
    return bar


def _chart(figure: Figure, data: xr.Dataset, shown: _Shown) -> None:
    """Draw when the first object and the bulk come to each of the worst stretches, with the numbers beside it."""
    ax = figure.add_axes((0.285, 0.085, 0.39, 0.265))
    at = data.isel(segment=shown.worst)
    first, bulk = at["first_arrival"].values, at["bulk_arrival"].values
    y = np.arange(len(shown.worst))
    for values, offset, style, tick in ((first, -0.2, FIRST, "white"), (bulk, 0.2, BULK, INK)):
        ax.barh(y + offset, values[2] - values[0], 0.34, values[0], zorder=3, **style)
        ax.scatter(values[1], y + offset, 26, tick, marker="D", edgecolor=INK, linewidth=0.9, zorder=5)
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
    """Write each stretch's number and name and place left of the chart, its numbers right of it."""
    place = ax.get_yaxis_transform()
    middle = [notation.position(*xy) or "" for xy in zip(at["lon"].values, at["lat"].values, strict=True)]
    names = []
    for i, name in enumerate(map(str, at["name"].values)):
        told = middle[i] in name  # a stretch without a name is called by its place
        names.append(f"stretch {at['segment'].values[i]}" if name == middle[i] else page.fit(name, 44 if told else 27))
        middle[i] = "" if told and name != middle[i] else middle[i]
    columns: list[tuple[float, str, str, list[str]]] = [
        (-0.635, "left", "Stretch", names),
        (-0.025, "right", "Middle", middle),
        (0.0, "left", "When, day and time UTC", []),
        (1.125, "right", "Expected", [labels.number(v) for v in at["expected"].values[-1]]),
        (1.225, "right", "± error", [f"{v:.2g}" if np.isfinite(v) else "" for v in at["expected_se"].values[-1]]),
        (
            1.40,
            "right",
            "10 - 50 - 90 %",
            [" - ".join(f"{v:,.0f}" for v in row) for row in at["number"].values[:, -1].T],
        ),
        (1.56, "right", "At least one", [labels.percent(v) for v in at["probability"].values[-1]]),
        (1.72, "right", "Ever arrived", [labels.number(v) for v in at["arrived"].values[-1]]),
    ]
    for x, side, head, texts in columns:
        ax.text(x, -0.85, head, transform=place, ha=side, va="bottom", fontsize=8, color=GREY)
        for y, text in enumerate(texts):
            ax.text(x, y, text, transform=place, ha=side, va="center", fontsize=8.5 if x > 0 else 8, color=INK)
    badge = {"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": INK, "linewidth": 0.8}
    for y in range(at.sizes["segment"]):
        ax.text(
            -0.664, y, f"{rank[y]}", transform=place, ha="center", va="center", fontsize=8, weight="bold", color=INK, bbox=badge
        )  # fmt: skip


def _key(figure: Figure, marks: tuple[str, int], patrolled: str) -> None:
    """Write under the chart what its bars and the marks on the maps are."""
    shape: dict[str, Any] = {"linestyle": "none", "marker": "D", "markersize": 5, "markeredgecolor": INK}
    medians = (Line2D([], [], markerfacecolor="white", **shape), Line2D([], [], markerfacecolor=INK, **shape))
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
        bbox_to_anchor=(0.024, 0.042),
        ncols=len(rows),
        fontsize=8,
        borderaxespad=0,
        columnspacing=1.4,
        handler_map={medians: HandlerTuple(None)},
    )
    figure.text(
        0.7,
        0.044,
        "Times: of the simulated spills in which any arrives there.\n± error: standard error. Stretches that any object reaches\n"
        f"with under {100 * LEAST:g} % are not drawn, unless few have more.",
        fontsize=7.5,
        color=GREY,
        va="center",
        linespacing=1.4,
    )


def _words(on: Page, data: xr.Dataset, imprint: Imprint) -> None:
    """Write title, valid time, basis and account over the maps."""
    begin, end = data["start"].values[()], data["time"].values[-1]
    hours = (end - begin) / np.timedelta64(1, "h")
    valid = f"Washup by {_moment(end)}, {hours:g} h after the start, {notation.group(begin)}"
    sheet.head(on, imprint, valid, _basis(data))
    account = _account(data)
    sheet.say(on, sheet.heading(0.8905, min(9.5, 1320 / len(account))), account)


def _basis(data: xr.Dataset) -> str:
    worlds, many = data.sizes["world"], data["effective_worlds"].item()
    each = data["realisations"].item()
    return (
        f"{worlds:,} worlds, effective {many:,.0f}, of {each} simulated spill{'s' if each > 1 else ''} each   ·   "
        f"{data['total'].values[:, -1].sum():,.1f}".removesuffix(".0")
        + " objects lost"
    )


def _count(data: xr.Dataset) -> effective.Count:
    return effective.Count(data["effective_worlds"].item(), data.sizes["world"], "worlds")


def _account(data: xr.Dataset) -> str:
    """Return the account at the end in words: expected numbers, and 10 to 90 % of them where they vary."""
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
    return f"{notation.group(time)} ({notation.iso(time)}, UTC)"


def _short(seconds: float) -> str:
    """Return a time [s since 1970] as day and time, 211830Z."""
    return f"{notation.group(np.datetime64(round(seconds), 's'))[:6]}Z"


def _round_numbers(low: float, high: float) -> Array:
    """Return 1, 2 and 5 times the powers of ten between two numbers."""
    power = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.outer(power, [1, 2, 5]).ravel()
    return np.asarray(ticks[(ticks >= low) & (ticks <= high)])
