"""Map of a bridge: its areas at the requested times, and curves of line crossings.

The shading is the probability density averaged over time, the home range of Bullard 1999 and Horne
et al. 2007. Darker is denser, and areas differ by dashes, so that the map is readable in grey. Land
polygons are an argument; nothing is downloaded.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, PowerNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from drift.products.maps import chart, labels, page, sheet
from drift.products.maps.chart import GREY, INK, Frame
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Row, Sheet
from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges import ellipse, study, text
from drift.tracking.bridges.crossing import Line
from drift.tracking.bridges.study import Answers
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.notation import NMI

MAP = (0.055, 0.09, 0.575, 0.77)  # left, bottom, width, height, as shares of the page
LEFT, WIDE = 0.735, 0.245  # left edge and width of the curves beside the map
SHEET = Sheet(
    11.7,
    8.3,
    140,
    left=MAP[0],
    title=sheet.heading(0.955, 15),
    lines=(Row(0.918, 11),),
    footer=sheet.small(0.017, 7.5),
)
BLUE = "#0b4f8a"
DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)))
# colours, dashes and markers of the study's lines
LINES: tuple[tuple[str, Any, str], ...] = (
    ("#b3261e", "-", "o"),
    ("#1b5e20", (0, (5, 1)), "s"),
    ("#6a3d9a", (0, (1.2, 0.8)), "^"),
    ("#8a5a00", (0, (5, 1, 1.2, 1)), "D"),
)
CELLS, MOMENTS = 180, 121  # of the shading: cells along each side, times averaged over
WIDEST = 0.99  # share of the probability at every time that the frame contains
WORDS = 9  # most times that are labelled


def box(asked: Answers) -> Box:
    """Return a box [deg] that contains the whole chart, for reading the coast."""
    west, south, east, north = _frame(asked).bounds()
    west = sphere.wrap_degrees(west)
    return Box(
        west, max(south, -90.0), west + min((east - west) % 360.0 or 360.0, 360.0), min(north, 90.0)
    )


def _frame(asked: Answers) -> Frame:
    """Return the frame of the chart."""
    bridge = asked.study.bridge
    place = bridges.bridge_at(bridge, np.linspace(bridge.time[0], bridge.time[-1], 41))
    middle = float(np.degrees(place.lon[20]))
    outlines = [
        ellipse.polygon(lon, lat, covariance + np.eye(2) * NMI**2, WIDEST, 36)
        for lon, lat, covariance in zip(place.lon, place.lat, place.covariance, strict=True)
    ]
    points = np.concatenate(outlines)
    aspect = MAP[2] * SHEET.width / (MAP[3] * SHEET.height)
    return chart.frame(
        sphere.near_degrees(points[:, 0], middle),
        points[:, 1].clip(-89.9, 89.9),
        aspect,
        margin=0.04,
    )


def plot_bridge(
    asked: Answers, path: Path, polygons: Iterable[Any], attributes: dict[str, str]
) -> None:
    """Draw the answers into a PNG.

    Args:
        asked: the answers of a study.
        path: the picture to write.
        polygons: land [deg].
        attributes: provenance, written into the file.
    """
    bridge = asked.study.bridge
    on = sheet.begin_page(SHEET)
    hours = (bridge.time[-1] - bridge.time[0]) / 3600
    about = (
        f"{len(asked.study.names)} way points, {hours:g} h, strays by K = {text.spread_rate(bridge.spread_rate)}: "
        f"areas at {asked.position.time.size} times, in closed form"
    )
    imprint = Imprint(
        asked.study.title, "; ".join(f"{k} {v}" for k, v in attributes.items()), attributes
    )
    sheet.write_head(on, imprint, about)
    axes = on.figure.add_axes(MAP)
    frame = _frame(asked)
    chart.prepare(axes, frame)
    mesh = _shading(axes, frame, asked)
    chart.draw_land(axes, chart.land_path(frame, polygons, 1100))
    chart.graticule(axes, frame)
    _lines(axes, frame, asked)
    _ways(axes, frame, asked)
    taken = chart.scale_bar(axes, frame, chart.free_corner(frame, *_means(frame, asked)))
    labels.place_labels(
        axes, on.canvas, _names(frame, asked), [taken], must=set(range(len(asked.study.names)))
    )
    bar, unit = sheet.density_bar(
        on.figure, (MAP[0] + MAP[2] + 0.014, MAP[1] + 0.22, 0.012, 0.3), mesh
    )
    bar.set_title(f"% per\n{unit}", fontsize=7, color=INK, pad=6)
    bar.tick_params(labelsize=7, colors=INK)
    if asked.touches:
        _touches(on.figure.add_axes((LEFT, 0.53, WIDE, 0.29)), asked)
    _areas(
        on.figure.add_axes(
            (LEFT, 0.26 if asked.touches else 0.53, WIDE, 0.19 if asked.touches else 0.29)
        ),
        asked,
    )
    sheet.legend(
        on.figure,
        _key(asked),
        loc="lower left",
        bbox_to_anchor=(LEFT - 0.015, 0.035),
        fontsize=8,
        ncols=2,
        columnspacing=1.2,
        handlelength=2.6,
    )
    with page.literal_text():
        sheet.finish_page(on, path, imprint)


def _means(frame: Frame, asked: Answers, count: int = 121) -> tuple[Array, Array]:
    """Return the mean path on the chart [m]."""
    bridge = asked.study.bridge
    way = bridges.bridge_at(bridge, np.linspace(bridge.time[0], bridge.time[-1], count))
    return frame.project(np.degrees(way.lon), np.degrees(way.lat))


def _shading(axes: Axes, frame: Frame, asked: Answers) -> Any:
    """Shade the density averaged over time [% per nmi2]; return the mesh."""
    bridge = asked.study.bridge
    half = (bridge.time[-1] - bridge.time[0]) / (2 * MOMENTS)
    place = bridges.bridge_at(
        bridge, np.linspace(bridge.time[0] + half, bridge.time[-1] - half, MOMENTS)
    )
    edges = [np.linspace(*side, CELLS + 1) for side in (frame.x, frame.y)]
    x, y = np.meshgrid(*((edge[1:] + edge[:-1]) / 2 for edge in edges))
    lonlat = chart.DEGREES.transform_points(frame.crs, x, y)
    lon, lat = np.radians(lonlat[..., 0]), np.radians(lonlat[..., 1])
    # [m2] variance of a uniform distribution over a cell, added to every position
    cell = ((frame.x[1] - frame.x[0]) / CELLS) ** 2 / 12
    total = np.zeros(x.shape)
    for k in range(MOMENTS):
        covariance = place.covariance[k] + np.eye(2) * cell
        east, north = sphere.offset(place.lon[k], place.lat[k], lon, lat)
        inverse = np.linalg.inv(covariance)
        square = (
            inverse[0, 0] * east**2 + 2 * inverse[0, 1] * east * north + inverse[1, 1] * north**2
        )
        total += np.exp(-0.5 * square) / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))
    density = 100 * NMI**2 * total / MOMENTS
    # Exactly known ends have a very high density that would use up the colour scale.
    top = (
        float(np.quantile(density[density > density.max() / 50], 0.97))
        if density.max() > 0
        else 1.0
    )
    colours = ListedColormap(
        matplotlib.colormaps["magma_r"](np.linspace(0.0, 0.75, 256)), name="bridge"
    )
    shown = np.ma.masked_less(density, top / 400)
    return axes.pcolormesh(
        *edges,
        shown,
        cmap=colours,
        norm=PowerNorm(0.5, 0, top),
        zorder=1,
        rasterized=True,
        alpha=0.85,
    )


def _lines(axes: Axes, frame: Frame, asked: Answers) -> None:
    """Draw the study's lines across the whole chart."""
    for k, touch in enumerate(asked.touches):
        lon, lat = _great_circle(touch.line)
        x, y = frame.project(lon, lat)
        leap = np.hypot(np.diff(x), np.diff(y)) > 3 * (frame.x[1] - frame.x[0])
        x, y = (np.insert(v.astype(float), 1 + np.flatnonzero(leap), np.nan) for v in (x, y))
        colour, dashes, _ = LINES[k % len(LINES)]
        axes.plot(
            x,
            y,
            color=colour,
            linestyle=dashes,
            linewidth=2.0,
            zorder=8,
            scalex=False,
            scaley=False,
        )


def _great_circle(line: Line) -> tuple[Array, Array]:
    """Return points on a line's full great circle [deg], a quarter of a degree apart."""
    east, north = sphere.offset(line.lon[0], line.lat[0], line.lon[1], line.lat[1])
    scale = sphere.RADIUS / np.hypot(east, north)
    turn = np.linspace(-np.pi, np.pi, 1441)
    lon, lat = sphere.destination(
        line.lon[0], line.lat[0], east * scale * turn, north * scale * turn
    )
    return np.degrees(lon), np.degrees(lat)


def _ways(axes: Axes, frame: Frame, asked: Answers) -> None:
    """Draw the mean path, the areas at each time, and the way points."""
    axes.plot(*_means(frame, asked), color=INK, linewidth=1.2, linestyle=(0, (1, 2)), zorder=9)
    for outlines in study.polygons(asked):
        for k, outline in enumerate(outlines):
            x, y = frame.project(*np.vstack([outline, outline[:1]]).T)
            axes.plot(
                x,
                y,
                color=BLUE,
                linewidth=1.5 - 0.3 * min(k, 2),
                linestyle=DASHES[k % len(DASHES)],
                zorder=10,
            )
    bridge = asked.study.bridge
    x, y = frame.project(np.degrees(asked.position.lon), np.degrees(asked.position.lat))
    axes.plot(
        x,
        y,
        linestyle="none",
        marker="o",
        markersize=3.5,
        color=BLUE,
        markeredgecolor="white",
        zorder=11,
    )
    x, y = frame.project(np.degrees(bridge.lon), np.degrees(bridge.lat))
    axes.plot(
        x,
        y,
        linestyle="none",
        marker="*",
        markersize=13,
        color=chart.RED,
        markeredgecolor="white",
        zorder=12,
    )


def _names(frame: Frame, asked: Answers) -> list[labels.Point]:
    """Return the labels of way points, then of some of the times."""
    bridge, place = asked.study.bridge, asked.position
    x, y = frame.project(np.degrees(bridge.lon), np.degrees(bridge.lat))
    bold = {"fontsize": 9, "weight": "bold", "color": INK}
    points: list[labels.Point] = [
        (a, b, name, bold) for a, b, name in zip(x, y, asked.study.names, strict=True)
    ]
    step = int(np.ceil(place.time.size / WORDS))
    x, y = frame.project(np.degrees(place.lon), np.degrees(place.lat))
    for k in range(0, place.time.size, step):
        words = f"+{(place.time[k] - bridge.time[0]) / 3600:.3g} h"
        points.append((float(x[k]), float(y[k]), words, {"fontsize": 8, "color": BLUE}))
    return points


def _touches(axes: Axes, asked: Answers) -> None:
    """Draw the probability that lines have been crossed by a time, with percentiles."""
    bridge = asked.study.bridge
    top = 0.0
    for k, touch in enumerate(asked.touches):
        time, touched = study.curve(touch)
        colour, dashes, mark = LINES[k % len(LINES)]
        axes.plot(
            (time - bridge.time[0]) / 3600, touched, color=colour, linestyle=dashes, linewidth=1.8
        )
        marks = (np.array(touch.percentiles) - bridge.time[0]) / 3600
        axes.plot(
            marks,
            np.array(asked.study.percentiles) * touch.chance.value,
            linestyle="none",
            marker=mark,
            markersize=5,
            color=colour,
            markeredgecolor="white",
        )
        top = max(top, touch.chance.value)
    axes.set_ylim(0, 1.06 * top if top > 0 else 1.0)
    ticks = axes.get_yticks()
    digits = max(0, int(np.ceil(-np.log10(max(top, 1e-12)))) - 1)
    axes.set_yticks(
        ticks[ticks <= 1.06 * max(top, 1e-12)],
        [f"{100 * t:.{digits}f} %" for t in ticks[ticks <= 1.06 * max(top, 1e-12)]],
    )
    by = ", ".join(notation.hundredths(share) for share in asked.study.percentiles)
    axes.set_title(
        f"Line crossed by this time (marks: {by} %)", fontsize=9.5, loc="left", color=INK
    )
    _plain(axes, asked)


def _areas(axes: Axes, asked: Answers) -> None:
    """Draw the size of the areas against time."""
    bridge = asked.study.bridge
    time = np.linspace(bridge.time[0], bridge.time[-1], 241)
    covariance = bridges.bridge_at(bridge, time).covariance
    for k, share in enumerate(asked.study.shares):
        size = ellipse.area(covariance, share)
        axes.plot(
            (time - bridge.time[0]) / 3600,
            size,
            color=BLUE,
            linewidth=1.5,
            linestyle=DASHES[k % len(DASHES)],
        )
    axes.set_ylim(0, None)
    ticks = axes.get_yticks()[:-1]
    axes.set_yticks(ticks, [f"{tick:,.0f}" for tick in ticks])
    axes.set_title("Areas [nmi²]", fontsize=9.5, loc="left", color=INK)
    axes.set_xlabel(
        f"hours after {notation.format_dtg(np.datetime64(round(bridge.time[0]), 's'))}",
        fontsize=8.5,
        color=INK,
    )
    _plain(axes, asked)


def _plain(axes: Axes, asked: Answers) -> None:
    """Format the axes of a curve against time."""
    bridge = asked.study.bridge
    axes.set_xlim(0, (bridge.time[-1] - bridge.time[0]) / 3600)
    axes.tick_params(labelsize=8, colors=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#d5dbe1", linewidth=0.6)
    axes.set_axisbelow(True)


def _key(asked: Answers) -> Sequence[tuple[Any, str]]:
    """Return the legend's symbols and texts."""
    rows: list[tuple[Any, str]] = [
        (Line2D([], [], linestyle="none", marker="*", markersize=11, color=chart.RED), "way point"),
        (Line2D([], [], color=INK, linewidth=1.2, linestyle=(0, (1, 2))), "mean way"),
    ]
    for k, share in enumerate(asked.study.shares):
        style = {
            "color": BLUE,
            "linewidth": 1.5 - 0.3 * min(k, 2),
            "linestyle": DASHES[k % len(DASHES)],
        }
        rows.append((Line2D([], [], **style), f"{notation.hundredths(share)} % area"))
    rows.append((Patch(facecolor="#e0607a", edgecolor=GREY), "density, averaged over time"))
    for k, touch in enumerate(asked.touches):
        chance = f"{touch.chance.value:.3g}"
        colour, dashes, _ = LINES[k % len(LINES)]
        symbol = Line2D([], [], color=colour, linestyle=dashes, linewidth=2)
        rows.append((symbol, f"{page.fit(touch.line.name, 22)}: {chance}"))
    return rows
