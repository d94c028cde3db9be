"""Map of a search plan: sub-areas, legs and search points on the probability map."""

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.products import layers as search_layers
from drift.forecast import effective, mapped
from drift.forecast.build import Forecast
from drift.forecast.products import beyond, layers
from drift.planning.search.products import subareas
from drift.planning.search.products import text as plan_text
from drift.planning.search.records import Plan, Tasking
from drift.products.maps import chart, labels, page, sheet
from drift.products.maps.chart import INK, Frame
from drift.products.maps.imprint import Setting
from drift.products.maps.marks import Line, Mark
from drift.products.maps.sheet import Badge, Page, Row, Sheet
from geo import notation, sphere
from geo.array import Array
from geo.notation import KNOT, NMI

MAP = (0.055, 0.085, 0.60, 0.775)  # of the page
POINT: dict[str, Any] = {
    "marker": "o",
    "linestyle": "none",
    "markerfacecolor": "white",
    "markeredgecolor": "#000000",
}
BASE: dict[str, Any] = {
    "marker": "s",
    "linestyle": "none",
    "color": "#000000",
    "markeredgecolor": "white",
}
ROW = 0.03  # height of a row of warnings over the map, as a share of the page
FIGURES = 2.72  # [em] width of "0.12  "
LATER = (0, (6, 2.5))  # dashes of sub-areas of later rounds
SHEET = Sheet(
    11.7,
    8.3,
    140,
    left=0.055,
    title=sheet.heading(0.955, 15),
    lines=(sheet.heading(0.92, 12.5), Row(0.887, 9.5, right=0.66)),
    caution=Badge(0.985, 0.96, side="right"),
    rough=Badge(0.058, 0.876 - ROW),
    footer=sheet.small(0.012, 7.5),
)


def plot_plan(
    forecast: Forecast, plan: Plan, path: Path, setting: Setting, *, time: int | None = None
) -> None:
    """Draw a plan on the probability map at an output.

    Args:
        forecast: given the plan's failure.
        plan: to be drawn.
        path: the picture to write.
        setting: of the map.
        time: index of the output; None: the one nearest to the middle of the plan's first round.
    """
    i = nearest(forecast, plan) if time is None else range(forecast.data.sizes["time"])[time]
    at = forecast.data.isel(time=i)
    on = sheet.begin_page(SHEET)
    count = effective.effective_at(forecast.data, i, setting.particles)
    least = (
        count if count.few else min(_particle_counts(plan, count), key=lambda count: count.number)
    )
    frame, high, out = _framed(forecast, plan, i, setting.marks, MAP[3] - ROW * least.few)
    ax = on.figure.add_axes((*MAP[:3], high))
    chart.prepare(ax, frame)
    shown = np.where(at["containment"].values <= mapped.SHOWN, layers.density(forecast, i), np.nan)
    mesh = layers.shade(ax, frame, forecast, shown, PowerNorm(0.5, 0, layers.scale_top(at)))
    land = chart.land_path(frame, setting.polygons(frame.box()), 1000)
    chart.draw_land(ax, land)
    chart.graticule(ax, frame)
    ways = [overlay(at["time"].values[()]) for overlay in setting.overlays]
    for way in ways:
        way.draw(ax, frame)
    outlines = layers.areas_of(forecast, at["time"].values[()], forecast.ends)
    layers.outline(ax, frame, forecast, outlines, count.few, width=0.7)
    ashore = layers.ashore_marks(ax, frame, forecast, i)
    _plan(ax, on.canvas, frame, forecast, plan, i, setting.marks)
    _write_head(on, plan, notation.format_dtg(at["time"].values[()]), setting)
    if least.few:
        sheet.draw_rough_banner(on, effective.banner(least, "areas and POS are rough"))
    for k, text in enumerate(out, 1 + least.few):
        sheet.write_line(on, sheet.warning(0.875 - ROW * k, 9), text)
    more = layers.bands(forecast, [i], forecast.ends, count.few)
    more += [(symbol, page.fit(text, 34)) for way in ways for symbol, text in way.key]
    _legend(
        on.figure,
        plan,
        forecast,
        outlines,
        len(setting.marks),
        ashore,
        land is not None,
        count.few,
        more,
    )
    _panel(on.figure, plan)
    _bar(on.figure, mesh)
    sheet.finish_page(on, path, setting.imprint)


def _framed(
    forecast: Forecast, plan: Plan, i: int, marks: Sequence[Mark], high: float
) -> tuple[Frame, float, list[str]]:
    """Return the map's frame, its height (share of the page) and lines on what is outside."""
    frame = _extent(forecast, plan, i, marks, high)
    at = forecast.data.isel(time=i)
    outside = textwrap.wrap(beyond.outside_frame_sentence(frame, at), 110)
    if outside:
        high -= ROW * len(outside)
        frame = _extent(forecast, plan, i, marks, high)
        outside = textwrap.wrap(beyond.outside_frame_sentence(frame, at), 110)
    return frame, high, outside


def _write_head(on: Page, plan: Plan, time: str, setting: Setting) -> None:
    """Write the plan's value and the time of the probability over the map."""
    imprint = setting.imprint
    when = f"Probability at {time}, given that all searches until then have failed"
    many = "" if setting.particles is None else f"   ·   {setting.particles:,} particles"
    sheet.write_head(on, imprint, f"Plan: {plan_text.worth(plan)}", when + many)


def nearest(forecast: Forecast, plan: Plan) -> int:
    """Return the output nearest to the middle of the first round's time on scene.

    For an empty plan it is the last output.
    """
    first = [tasking for tasking in plan.taskings if tasking.round == plan.taskings[0].round]
    if not first:
        return int(forecast.data.sizes["time"]) - 1
    begin, end = (
        min(tasking.on_scene for tasking in first),
        max(tasking.off_scene for tasking in first),
    )
    return int(np.argmin(np.abs(forecast.data["time"].values - (begin + (end - begin) // 2))))


def _particle_counts(plan: Plan, shown: effective.Count) -> list[effective.Count]:
    """Return the effective particle numbers behind the plan's figures and the map."""
    return [
        shown,
        *(count for count in (plan.scored_on, plan.made_on) if count is not None and count.few),
    ]


def _extent(forecast: Forecast, plan: Plan, i: int, marks: Sequence[Mark], high: float) -> Frame:
    """Return the frame of the sub-areas and the probability.

    Bases are included if they enlarge it only a little.
    """
    rings = [ring(tasking) for tasking in plan.taskings]
    lines = [Line(around[:, 0].tolist(), around[:, 1].tolist(), "") for around in rings]
    now = type(forecast)(forecast.data.isel(time=[i]), forecast.contours)
    times, aspect = [now.data["time"].values[0]], MAP[2] * SHEET.width / (high * SHEET.height)
    frame = layers.extent(now, times, marks, lines, aspect)
    bases = [Mark(*place) for t in plan.taskings for place in (t.unit.base, t.unit.return_to)]
    frame_with_bases = layers.extent(now, times, [*marks, *bases], lines, aspect)
    return frame_with_bases if layers.little(frame, frame_with_bases) else frame


def ring(tasking: Tasking) -> Array:
    """Return the closed outline of a sub-area, shape (n, 2) [deg]."""
    corners = np.array(subareas.corners(tasking))
    return search_shapes.curve(
        np.append(corners[:, 0], corners[0, 0]), np.append(corners[:, 1], corners[0, 1])
    )


def _plan(
    ax: Axes,
    canvas: FigureCanvasAgg,
    frame: Frame,
    forecast: Forecast,
    plan: Plan,
    i: int,
    marks: Sequence[Mark],
) -> None:
    """Draw sub-areas, legs, ways, search points and bases with their names, and the scale bar."""
    texts: list[labels.Point] = []
    outlines: dict[int, Array] = {}
    busy = list(layers.label_obstacles(frame, forecast, [forecast.data["time"].values[i]]))
    for name, tasking in zip(subareas.names(plan), plan.taskings, strict=True):
        for points in subareas.transits(tasking):
            line(
                ax,
                frame,
                points,
                {"color": "#000000", "linewidth": 0.9, "linestyle": (0, (1, 2.5))},
                7,
            )
        for searching, points in search_shapes.flown(tasking.sortie):
            line(ax, frame, points, search_layers.LEGS if searching else search_layers.TRANSIT, 8)
        around = ring(tasking)
        style = {
            **search_layers.AREA,
            "linewidth": 2.0,
            "linestyle": "-" if tasking.round == 1 else LATER,
        }
        line(ax, frame, around, style, 8.5)
        x, y = frame.project(around[:, 0], around[:, 1])
        busy = [np.append(busy[0], x), np.append(busy[1], y)]
        outlines[len(texts)] = np.column_stack([x, y])
        if tasking.sortie.legs is not None:
            creep(ax, frame, tasking)
        x, y = frame.project(*subareas.begin(tasking))
        ax.plot(x, y, markersize=7.5, markeredgewidth=1.8, zorder=12, **POINT)
        bold = {"fontsize": 9.5, "weight": "bold", "color": "#000000"}
        # Areas searched at different times may overlap, so the label gives the time.
        label = f"{name} {page.fit(tasking.unit.name, 26)}\n{short(tasking.on_scene)}"
        texts.append((float(x), float(y), label, bold))
    must = len(texts)
    for mark in marks:
        layers.mark_point(ax, frame, mark, 8)
        x, y = frame.project(mark.lon, mark.lat)
        texts.append(
            (
                float(x),
                float(y),
                mark.label,
                {"fontsize": 8.5, "color": layers.LAST_KNOWN, "weight": "bold"},
            )
        )
    units = [tasking.unit for tasking in plan.taskings]
    for place in sorted({place for unit in units for place in (unit.base, unit.return_to)}):
        x, y = frame.project(*place)
        if frame.x[0] < x < frame.x[1] and frame.y[0] < y < frame.y[1]:
            ax.plot(x, y, markersize=8, markeredgewidth=1.0, zorder=12, **BASE)
            names_at_base = [unit.name for unit in units if place in (unit.base, unit.return_to)]
            texts.append(
                (
                    float(x),
                    float(y),
                    _units_at_base(list(dict.fromkeys(names_at_base))),
                    {"fontsize": 8, "color": INK},
                )
            )
    texts += _base_labels_at_edge(frame, plan)
    bar = chart.scale_bar(ax, frame, chart.free_corner(frame, *busy))
    labels.place_labels(ax, canvas, texts, [bar], set(range(must)), outlines)


def line(ax: Axes, frame: Frame, points: Array, style: dict[str, Any], zorder: float) -> None:
    """Draw a line through positions [deg], with a halo unless it is thin."""
    halo = [
        patheffects.withStroke(linewidth=style["linewidth"] + 1.8, foreground="white", alpha=0.8)
    ]
    x, y = frame.project(points[:, 0], points[:, 1])
    ax.plot(
        x,
        y,
        zorder=zorder,
        scalex=False,
        scaley=False,
        path_effects=halo if style["linewidth"] >= 0.9 else None,
        **style,
    )


def creep(ax: Axes, frame: Frame, tasking: Tasking) -> None:
    """Draw an arrow in the direction of creep in the middle of a parallel sub-area."""
    if tasking.manner.pattern != "parallel":
        return
    reach = 0.22 * tasking.width
    ends = []
    for sign in (-1, 1):
        east, north = sign * reach * np.sin(tasking.creep), sign * reach * np.cos(tasking.creep)
        lon, lat = sphere.destination(
            math.radians(tasking.centre[0]), math.radians(tasking.centre[1]), east, north
        )
        ends.append((np.degrees(lon), np.degrees(lat)))
    (x0, y0), (x1, y1) = (frame.project(*end) for end in ends)
    arrow = {
        "arrowstyle": "-|>,head_width=0.28,head_length=0.5",
        "color": "#000000",
        "linewidth": 1.5,
    }
    arrow |= {
        "shrinkA": 0,
        "shrinkB": 0,
        "path_effects": [patheffects.withStroke(linewidth=3.5, foreground="white")],
    }
    ax.annotate("", (float(x1), float(y1)), (float(x0), float(y0)), arrowprops=arrow, zorder=11)


def _base_labels_at_edge(frame: Frame, plan: Plan) -> list[labels.Point]:
    """Return labels at the chart's edge: distance and bearing of each base beyond it."""
    texts: list[labels.Point] = []
    for place in sorted({tasking.unit.base for tasking in plan.taskings}):
        x, y = (float(v) for v in frame.project(*place))
        if frame.x[0] < x < frame.x[1] and frame.y[0] < y < frame.y[1]:
            continue
        based = [tasking for tasking in plan.taskings if tasking.unit.base == place]
        begin = subareas.begin(based[0])
        px, py = (float(v) for v in frame.project(*begin))
        shares = [
            (edge - start) / (end - start)
            for start, end, edges in ((px, x, frame.x), (py, y, frame.y))
            for edge in edges
            if abs(end - start) > 1e-6 and (edge - start) / (end - start) > 0
        ]
        share = 0.97 * min([1.0, *shares])
        start, goal = np.radians(begin), np.radians(place)
        far = float(sphere.distance(*start, *goal)) / NMI
        east, north = sphere.offset(*start, *goal)
        way = subareas.degrees(math.atan2(float(east), float(north)))
        words = f"{_units_at_base(list(dict.fromkeys(o.unit.name for o in based)))}\nbase {far:.0f} nmi, {way:03d}T"
        texts.append(
            (px + share * (x - px), py + share * (y - py), words, {"fontsize": 8, "color": INK})
        )
    return texts


def _units_at_base(units: list[str]) -> str:
    """Return the first of the units at a base, and the number of others."""
    more = f" and {len(units) - 1} more" if len(units) > 1 else ""
    return f"{page.fit(units[0], 26)}{more}"


def _legend(
    figure: Figure,
    plan: Plan,
    forecast: Forecast,
    outlines: Sequence[Any],
    marks: int,
    ashore: float,
    land: bool,
    few: bool,
    more: Sequence[tuple[Any, str]],
) -> None:
    """Draw the legend."""
    rows: list[tuple[Any, str]] = [
        (Line2D([], [], **{**search_layers.AREA, "linewidth": 2.0}), "Sub-area"),
        (Line2D([], [], **search_layers.LEGS), "Legs; arrow: creep"),
        (Line2D([], [], markersize=7.5, markeredgewidth=1.8, **POINT), "Commence search point"),
        (Line2D([], [], markersize=8, **BASE), "Base"),
        (
            Line2D([], [], color="#000000", linewidth=0.9, linestyle=(0, (1, 2.5))),
            "Way out and home",
        ),
    ]
    if any(tasking.round > 1 for tasking in plan.taskings):
        rows.insert(
            1,
            (
                Line2D([], [], **{**search_layers.AREA, "linewidth": 2.0, "linestyle": LATER}),
                "Later round",
            ),
        )
    for outline in outlines:
        style = layers.outline_style(outline.share, forecast, few)
        symbol = Line2D([], [], **{**style, "linewidth": 0.7 * style["linewidth"]})
        size = f"{'rough, ' if few else ''}{labels.number(outline.area / NMI**2)}"
        rows.append((symbol, f"{notation.hundredths(outline.share)} % area: {size} nmi²"))
    if few and outlines:
        rows.append((Patch(**layers.ROUGH), "Rough: few particles"))
    if marks:
        rows.append((layers.mark_symbol(7, 11), "Position known or reported"))
    if ashore >= labels.TINY:
        rows.append((layers.ashore_symbol(8), f"Ashore, {notation.percent(ashore)}"))
    if land:
        rows.append((Patch(facecolor=chart.LAND, edgecolor=chart.SHORE), "Land"))
    rows += more
    sheet.legend(
        figure,
        rows,
        loc="lower left",
        bbox_to_anchor=(0.672, 0.035),
        ncols=2,
        fontsize=7.8,
        labelspacing=0.6,
        handlelength=2.4,
        columnspacing=1.2,
        borderaxespad=0,
    )


def _panel(figure: Figure, plan: Plan) -> None:
    """Write the figures of the plan and its taskings beside the map, as large as they fit."""
    lines: list[tuple[str, float, str, float]] = []  # text, height in lines, weight, indent [em]

    def say(text: str, high: float = 1.0, weight: str = "normal", indent: float = 0.0) -> None:
        """Append a line of text."""
        lines.append((text, high, weight, indent))

    for name, tasking in zip(subareas.names(plan), plan.taskings, strict=True):
        say(
            f"{name}  {page.fit(tasking.unit.name, 26)}   POS {notation.probability(tasking.pos)}",
            1.15,
            "bold",
        )
        say(
            f"on scene {short(tasking.on_scene)} to {short(tasking.off_scene)}, home {short(tasking.home)}"
        )
        extent = f"{tasking.length / NMI:.1f} × {tasking.width / NMI:.1f} nmi"
        along = f"along {subareas.degrees(tasking.orientation):03d}T"
        say(f"{extent} {along}, {notation.number(tasking.unit.search_speed / KNOT)} kn")
        if tasking.sortie.legs is not None:
            say(f"CSP {notation.position(*subareas.begin(tasking))}")
            apart = f"{plan_text.SPACING.get(tasking.manner.pattern, 'spacing').lower()} {tasking.spacing / NMI:.2f} nmi"
            many = f"{tasking.legs} leg{'s' * (tasking.legs != 1)}"
            if tasking.manner.pattern == "parallel":
                say(
                    f"{many}, {apart}, creep {subareas.degrees(tasking.creep):03d}T",
                    1.0 + 0.35 * tasking.manner.plain,
                )
            else:
                say(f"{many}, {apart}")
            if not tasking.manner.plain:
                say(subareas.pattern(tasking), 1.35)
        else:
            say(f"centre {notation.position(*tasking.centre)}", 1.35)
    if not plan.taskings:
        say("No unit can search in this period.", 1.5, "bold")
    say("POS by scenario", 1.05, "bold")
    for scenario, pos in subareas.scenario_pos(plan):
        say(f"{notation.probability(pos)}  {page.fit(scenario, 40)}")
    if plan.alternatives:
        say("", 0.3)
        say("Compared, on the planning particles", 1.05, "bold")
        say(f"{notation.probability(plan.seen)}  this plan")
        for other in plan.alternatives:
            first, *rest = textwrap.wrap(other.name, 46) or [""]
            say(f"{notation.probability(other.value)}  {first}")
            if rest:
                say(page.fit(" ".join(rest), 46), indent=FIGURES)
    top, bottom = 0.9, 0.295
    step = min(0.0215, (top - bottom) / sum(high for _, high, _, _ in lines))
    size, y = min(9.0, 9.0 * step / 0.0205), top
    for text, high, weight, indent in lines:
        x = 0.672 + indent * size / 72 / SHEET.width
        figure.text(x, y, text, fontsize=size, weight=weight, color=INK, va="top")
        y -= step * high


def _bar(figure: Figure, mesh: Any) -> None:
    """Draw the colour bar of the probability density."""
    bar, unit = sheet.density_bar(figure, (0.675, 0.225, 0.215, 0.016), mesh)
    bar.set_title(f"Probability density [% per {unit}]", fontsize=8.5, loc="left", color=INK, pad=4)
    bar.tick_params(labelsize=7.5)


def short(time: np.datetime64) -> str:
    """Return a time without its month: 161350Z."""
    return f"{notation.format_dtg(time)[:6]}Z"
