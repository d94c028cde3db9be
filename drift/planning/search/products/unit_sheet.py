"""A4 sheet of a unit: chart of its legs, its task and all turning points.

Turning points are numbered on the chart and in the table, which gives their positions to a
thousandth of a minute, as plotters take them. If they do not fit, the table continues on further
pages.
"""

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.products import layers as search_layers
from drift.planning.search.boats import daylight
from drift.planning.search.boats.availability import moment
from drift.planning.search.products import map as plan_map
from drift.planning.search.products import subareas
from drift.planning.search.products import text as plan_text
from drift.planning.search.products.map import BASE, POINT
from drift.planning.search.products.subareas import Waypoint
from drift.planning.search.records import Plan, Tasking
from drift.products.files import text_sheet
from drift.products.maps import chart, labels, sheet
from drift.products.maps.chart import INK, Frame
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation, sphere
from geo.array import Array
from geo.box import Box

SHEET = Sheet(  # A4
    8.27,
    11.69,
    150,
    left=0.06,
    title=sheet.heading(0.962, 17),
    lines=(Row(0.943, 9.5), Row(0.928, 9.5)),
    caution=Badge(0.95, 0.968, 8.5, "right"),
    rough=Badge(0.95, 0.945, 8.5, "right"),
    footer=sheet.small(0.012, 6.5),
)
MAP = (0.085, 0.535, 0.865, 0.37)  # of the page
INSET = (0.665, 0.30, 0.285, 0.20)
COLUMNS, ROWS, MORE = 3, 28, 105  # of the table: columns, rows on page 1, rows on later pages
TABLE = 0.262  # top of the table, as a share of the page
STEP = 0.0081  # height of a row, as a share of the page
WAY: dict[str, Any] = {"color": "#000000", "linewidth": 0.9, "linestyle": (0, (1, 2.5))}
KINDS = {
    "way": "way",
    "csp": "CSP",
    "leg": "",
    "turn": "round",
    "off": "off",
    "home": "home",
    "base": "base",
}


def pages(plan: Plan) -> list[tuple[str, int, int]]:
    """Return the sheets of a plan: file name, index of the tasking, and page from 1."""
    sheets = []
    for k, (name, tasking) in enumerate(zip(subareas.names(plan), plan.taskings, strict=True)):
        rest = len(subareas.route(name, tasking)) - COLUMNS * ROWS
        many = 1 + max(math.ceil(rest / (COLUMNS * MORE)), 0)
        sheets += [(f"plan-{name}{f'-{p}' if p > 1 else ''}.png", k, p) for p in range(1, many + 1)]
    return sheets


def box(plan: Plan) -> Box:
    """Return the box that encloses everything on the sheets."""
    points = np.concatenate(
        [
            np.concatenate(
                [plan_map.ring(tasking), *subareas.transits(tasking), [tasking.unit.base]]
            )
            for tasking in plan.taskings
        ]
    )
    lon = np.array([_by(value, points[0, 0]) for value in points[:, 0]])
    west = sphere.wrap_degrees(float(lon.min()))
    box = Box(
        west,
        float(points[:, 1].min()),
        west + max(float(np.ptp(lon)), 1e-6),
        float(points[:, 1].max()),
    )
    return box.grown(0.3 + 0.2 * float(np.ptp(lon)), 0.2 + 0.2 * float(np.ptp(points[:, 1])))


def plot_unit_sheet(
    plan: Plan,
    which: int,
    path: Path,
    imprint: Imprint,
    *,
    number: int = 1,
    polygons: Iterable[Any] = (),
) -> None:
    """Draw one page of a unit's sheet.

    Args:
        plan: with the tasking.
        which: index of the tasking.
        path: the picture to write.
        imprint: title and run for the head of the page.
        number: of the page, from 1.
        polygons: land [deg].
    """
    name, tasking = subareas.names(plan)[which], plan.taskings[which]
    way = subareas.route(name, tasking)
    on = sheet.begin_page(SHEET)
    figure = on.figure
    head = f"{name}  {tasking.unit.name}" + (f", page {number}" if number > 1 else "")
    on_scene = f"{notation.format_dtg(tasking.on_scene)} to {plan_map.short(tasking.off_scene)}"
    when = f"On scene {on_scene}. Times are UTC, directions true."
    if plan_text.rough(plan):
        sheet.draw_rough_banner(on, "Few particles: areas and POS are rough")
    sheet.write_head(on, replace(imprint, title=head), imprint.title, when)
    if number == 1:
        land = np.array(list(polygons), dtype=object)
        _chart(figure, on.canvas, tasking, way, land)
        _inset(figure, tasking, land)
        _facts(figure, plan, name, tasking)
        _table(figure, way[: COLUMNS * ROWS], TABLE, ROWS)
    else:
        first = COLUMNS * (ROWS + MORE * (number - 2))
        _table(figure, way[first : first + COLUMNS * MORE], 0.9, MORE)
    sheet.finish_page(on, path, imprint, f"{name} {tasking.unit.name}: {imprint.title}")


def _chart(
    figure: Figure, canvas: FigureCanvasAgg, tasking: Tasking, way: Sequence[Waypoint], land: Array
) -> None:
    """Draw the legs with the numbers of their turning points."""
    ring = plan_map.ring(tasking)
    inner = [point for point in way if point.what in ("csp", "leg", "turn", "off")]
    lon = np.concatenate([ring[:, 0], [_by(point.lon, ring[0, 0]) for point in inner]])
    lat = np.concatenate([ring[:, 1], [point.lat for point in inner]])
    frame = chart.frame(lon, lat, MAP[2] * SHEET.width / (MAP[3] * SHEET.height), margin=0.05)
    ax = figure.add_axes(MAP)
    chart.prepare(ax, frame)
    chart.draw_land(ax, chart.land_path(frame, land, 1500))
    chart.graticule(ax, frame)
    _ways(ax, frame, tasking)
    for searching, points in search_shapes.flown(tasking.sortie):
        style = (
            {**search_layers.LEGS, "linewidth": 1.0}
            if searching
            else {**search_layers.TRANSIT, "linewidth": 1.1}
        )
        plan_map.line(ax, frame, points, style, 8)
    plan_map.line(
        ax, frame, ring, {**search_layers.AREA, "linewidth": 1.2, "linestyle": (0, (6, 3))}, 7.5
    )
    if tasking.sortie.legs is not None:
        plan_map.creep(ax, frame, tasking)
    x, y = frame.project([point.lon for point in inner], [point.lat for point in inner])
    ax.plot(x[1:], y[1:], "o", markersize=2.2, color=INK, zorder=11)
    ax.plot(x[0], y[0], markersize=8, markeredgewidth=1.8, zorder=12, **POINT)
    texts: list[labels.Point] = []
    for k, point in enumerate(inner):
        ends = point.what in ("csp", "off")
        style = {
            "fontsize": 9 if ends else 6.2,
            "color": "#000000",
            "weight": "bold" if ends else "normal",
        }
        texts.append((float(x[k]), float(y[k]), _short(point), style))
    bar = chart.scale_bar(ax, frame, chart.free_corner(frame, x, y))
    labels.place_labels(ax, canvas, texts, [bar], must={0, len(texts) - 1})
    handles = [
        (Line2D([], [], **{**search_layers.LEGS, "linewidth": 1.0}), "Leg of search"),
        (
            Line2D([], [], **{**search_layers.AREA, "linewidth": 1.2, "linestyle": (0, (6, 3))}),
            "Sub-area",
        ),
        (Line2D([], [], **WAY), "Way out and home"),
    ]
    if tasking.sortie.legs is not None and not all(tasking.sortie.legs.searching):
        handles.insert(
            1,
            (
                Line2D([], [], **{**search_layers.TRANSIT, "linewidth": 1.1}),
                "Way round land, no search",
            ),
        )
    sheet.legend(
        figure,
        handles,
        loc="upper left",
        bbox_to_anchor=(MAP[0] - 0.005, MAP[1] - 0.021),
        ncols=len(handles),
        fontsize=7.5,
        borderaxespad=0,
    )


def _ways(ax: Axes, frame: Frame, tasking: Tasking) -> None:
    """Draw the ways out and home."""
    for points in subareas.transits(tasking):
        plan_map.line(ax, frame, points, WAY, 7)


def _inset(figure: Figure, tasking: Tasking, land: Array) -> None:
    """Draw the ways out and home on a small chart that shows them whole."""
    ring = plan_map.ring(tasking)
    ways = subareas.transits(tasking)
    places = np.concatenate([ring, *ways, [tasking.unit.base, tasking.unit.return_to]])
    lon = np.array([_by(v, ring[0, 0]) for v in places[:, 0]])
    frame = chart.frame(
        lon, places[:, 1], INSET[2] * SHEET.width / (INSET[3] * SHEET.height), margin=0.1
    )
    ax = figure.add_axes(INSET)
    chart.prepare(ax, frame)
    chart.draw_land(ax, chart.land_path(frame, land, 600))
    chart.graticule(ax, frame, lines=2, size=6.5)
    _ways(ax, frame, tasking)
    plan_map.line(ax, frame, ring, {**search_layers.AREA, "linewidth": 1.2}, 8)
    x, y = frame.project(*zip(tasking.unit.base, tasking.unit.return_to, strict=True))
    ax.plot(x, y, markersize=6, markeredgewidth=0.8, zorder=12, **BASE)
    chart.scale_bar(ax, frame, chart.free_corner(frame, x, y), small=True)


def _facts(figure: Figure, plan: Plan, name: str, tasking: Tasking) -> None:
    """Write the unit's task, as in the search action plan, and the hours of daylight."""
    lines = [line.removeprefix("      ") for line in plan_text.task(plan, name, tasking)[1:]]
    lines.append(f"{'Daylight':{plan_text.LABEL}}{_light(tasking)}")
    for words in plan.said:
        if words.startswith(f"{tasking.unit.name} "):
            wrapped = textwrap.wrap(
                words.removeprefix(f"{tasking.unit.name} "), text_sheet.WIDE - plan_text.LABEL - 6
            )
            lines += [
                f"{'' if k else 'Harbour':{plan_text.LABEL}}{line}"
                for k, line in enumerate(wrapped)
            ]
    step = min(0.0098, (MAP[1] - 0.045 - TABLE - 0.02) / len(lines))
    for k, line in enumerate(lines):
        y = MAP[1] - 0.045 - step * k
        figure.text(
            0.06,
            y,
            line,
            fontsize=min(7.0, 7.0 * step / 0.0092),
            family="monospace",
            color=INK,
            va="top",
        )


def _light(tasking: Tasking) -> str:
    """Return sunrise and sunset at the commence search point for the day of the search."""
    begin = float(notation.epoch(tasking.on_scene))
    place = subareas.begin(tasking)
    spans = daylight.windows(begin - 86_400, begin + 86_400, *place)
    ahead = [span for span in spans if span[1] > begin]
    if not ahead:
        return "none: polar night"
    rise, fall = ahead[0]
    if rise <= begin - 86_400 and fall >= begin + 86_400:
        return "all day: the sun does not set"
    words = [f"sunrise {plan_map.short(moment(rise))}"] if rise > begin - 86_400 else []
    words += [f"sunset {plan_map.short(moment(fall))}"] if fall < begin + 86_400 else []
    return ", ".join(words)


def _table(figure: Figure, way: Sequence[Waypoint], top: float, rows: int) -> None:
    """Write turning points in columns."""
    wide = 0.89 / COLUMNS
    for column in range(math.ceil(len(way) / rows)):
        x = 0.06 + wide * column
        head = f"{'':4} {'Latitude':11} {'Longitude':12} {'Time':7}"
        figure.text(
            x, top, head, fontsize=6.7, family="monospace", weight="bold", color=INK, va="top"
        )
        for k, point in enumerate(way[column * rows : (column + 1) * rows]):
            text = f"{_short(point):>4} {_place(point)} {plan_map.short(point.time)} {KINDS[point.what]}"
            bold = "bold" if point.what in ("csp", "off") else "normal"
            style: dict[str, Any] = {
                "fontsize": 6.7,
                "family": "monospace",
                "weight": bold,
                "color": INK,
                "va": "top",
            }
            figure.text(x, top - STEP * (k + 1.2), text, **style)


def _short(point: Waypoint) -> str:
    """Return a point's label on its unit's own sheet.

    Search points are CSP, 02, ... END; those on the way out W1, ..., on the way home H1, ...
    """
    word, _, number = point.name.split(" ", 1)[1].partition(" ")
    if number:
        return f"{'W' if word == 'OUT' else 'H'}{int(number)}"
    return {"CENTRE": "MID"}.get(word, word[:4])


def _place(point: Waypoint) -> str:
    """Return a position in degrees and minutes."""
    lon = sphere.wrap_degrees(point.lon)
    return f"{_minutes(point.lat, 2)}{'N' if point.lat >= 0 else 'S'} {_minutes(lon, 3)}{'E' if lon >= 0 else 'W'}"


def _minutes(angle: float, digits: int) -> str:
    """Return an angle in degrees and minutes."""
    thousandths = round(abs(angle) * 60_000)
    return f"{thousandths // 60_000:0{digits}d} {thousandths % 60_000 / 1000:06.3f}"


def _by(lon: float, other: float) -> float:
    """Return a longitude [deg] within 180 degrees of another."""
    return sphere.near_degrees(lon, other)
