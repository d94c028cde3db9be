"""Map of a sensor's reach: signal excess and probability of detection, side by side on a chart.

Every pixel is computed on its own, so that no grid is visible, and neither the antimeridian nor a
pole is a seam. Contours at 0 dB and 10, 50 and 90 % keep the map readable in grey.
"""

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from drift.apps.sensor import reach as reaching
from drift.apps.sensor import text
from drift.apps.sensor.records import Looked, Question, Reach
from drift.products.maps import chart, labels, page, sheet
from drift.products.maps.chart import INK, RED, Frame
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Page, Row, Sheet
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.notation import NMI

PIXELS = 520  # along a side of a map
CIRCLE = np.radians(np.arange(0.0, 361.0, 2.0))
STEPS = tuple(m * 10.0**e for e in range(-2, 5) for m in (1, 2, 5))  # [nmi] between rings
RINGS = 6  # most rings
RAYS = 12  # most beams that are drawn
AWAY = np.radians(20.0)  # bearing of the ring labels
SCALES = (10.0, 15.0, 20.0, 30.0)  # [dB] possible ends of the colour scale
WIDE, HIGH, TOP = 5.15, 5.15, 1.05  # [in] size of a map, and height of the text above it
SHARES: tuple[tuple[float, Any], ...] = (
    (0.1, (0, (1, 1.5))),
    (0.5, "-"),
    (0.9, (0, (6, 2))),
)  # contours of the probability of detection, and their dashes


def plot_reach(
    found: Reach, path: Path, imprint: Imprint, land: Callable[[Box], Iterable[Any]]
) -> None:
    """Plot a sensor's reach into a PNG; land: returns the land polygons [deg] in a box."""
    has_excess = found.cells.excess is not None
    width = 2 * (WIDE + 0.55) + 0.3 if has_excess else WIDE + 1.1
    height = HIGH + TOP + 1.55
    left = 0.55 / width
    page_drawn = sheet.begin_page(
        Sheet(
            width,
            height,
            140,
            left=left,
            title=sheet.heading(1 - 0.36 / height, 15),
            lines=(
                Row(1 - 0.60 / height, 10),
                *(Row(1 - at / height, 8.5) for at in (0.79, 0.96)),
            ),
            footer=sheet.small(0.1 / height, 7.5),
        )
    )
    question = found.question
    sheet.write_head(page_drawn, imprint, _capitalized(text.described(question)), *_terms(question))
    frame = _frame(found)
    x, y = (np.linspace(*side, PIXELS + 1) for side in (frame.x, frame.y))
    seen = _pixels(question, frame, x, y)
    polygons = list(land(frame.box()))
    shore = chart.land_path(frame, polygons, 900)
    boxes = [
        (left + k * (WIDE + 0.7) / width, 1.18 / height, WIDE / width, HIGH / height)
        for k in range(1 + has_excess)
    ]
    for k, box in enumerate(boxes):
        axes = page_drawn.figure.add_axes(box)
        chart.prepare(axes, frame)
        shade = _excess if has_excess and k == 0 else _chance
        mesh, title, ticks = shade(axes, x, y, seen)
        axes.set_title(title, fontsize=10, loc="left", color=INK, pad=4)
        chart.draw_land(axes, shore)
        chart.graticule(axes, frame, labels=(True, k == 0))
        _marks(page_drawn, axes, frame, found)
        bar = page_drawn.figure.add_axes(
            (box[0] + 0.1 * box[2], 0.82 / height, 0.8 * box[2], 0.12 / height)
        )
        page_drawn.figure.colorbar(
            mesh,
            cax=bar,
            orientation="horizontal",
            extend="both" if title.startswith("Sig") else "neither",
        )
        bar.set_xticks(*ticks)
        bar.tick_params(labelsize=7.5, colors=INK, length=3)
    key = _key(question, has_excess)
    sheet.legend(
        page_drawn.figure,
        key,
        loc="lower left",
        bbox_to_anchor=(left - 0.01, 0.2 / height),
        fontsize=8,
        ncols=len(key) if has_excess else math.ceil(len(key) / 2),
        columnspacing=1.4,
        handlelength=2.4,
        labelspacing=0.3,
    )
    with page.literal_text():
        sheet.finish_page(page_drawn, path, imprint)


def _capitalized(words: str) -> str:
    return words[:1].upper() + words[1:]


def _terms(question: Question) -> tuple[str, str]:
    """Return two lines on the terms of the sonar equation, or on the POD table."""
    assumed = dict(question.assumed)
    sonar = question.sonar
    if sonar is None:
        return (
            f"A look by the table {getattr(question.sensor.sees, 'name', '')}".rstrip(),
            assumed.get("POD", ""),
        )
    unknown = (
        f", common unknown of all looks {notation.number(sonar.unknown)} dB"
        if sonar.unknown > 0
        else ""
    )
    level = f"Source level {assumed['source level']}"
    return (
        level,
        f"Noise {assumed['noise']}; threshold {notation.number(sonar.threshold)} dB; fluctuation "
        f"{notation.number(sonar.fluctuation)} dB{unknown}",
    )


def _frame(found: Reach) -> Frame:
    """Return the frame that shows the whole reach."""
    lon, lat = _positions(found.question, CIRCLE, np.full(CIRCLE.shape, found.extent))
    return chart.frame(
        sphere.near_degrees(lon, found.question.place[0]), lat, WIDE / HIGH, margin=0.01
    )


def _positions(question: Question, bearing: Array, metres: Array) -> tuple[Array, Array]:
    """Return positions [deg] at bearings [rad] and ranges [m] from the sensor."""
    at = np.radians(question.place)
    lon, lat = sphere.destination(at[0], at[1], np.sin(bearing) * metres, np.cos(bearing) * metres)
    return np.degrees(lon), np.degrees(lat)


def _pixels(question: Question, frame: Frame, x: Array, y: Array) -> Looked:
    """Return the detection in each pixel; NaN for pixels off the Earth."""
    middle = np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2)
    lonlat = np.radians(chart.DEGREES.transform_points(frame.crs, *middle))
    outside = ~np.isfinite(lonlat[..., :2]).all(axis=-1)
    seen = reaching.look(
        question, np.where(outside, 0.0, lonlat[..., 0]), np.where(outside, 0.0, lonlat[..., 1])
    )
    return Looked(
        np.where(outside, np.nan, seen.pod),
        None if seen.excess is None else np.where(outside, np.nan, seen.excess),
    )


def _excess(axes: Axes, x: Array, y: Array, seen: Looked) -> tuple[Any, str, Any]:
    """Shade the signal excess about 0 dB; return the mesh, its title and the ticks of its scale."""
    assert seen.excess is not None
    magnitudes = np.abs(seen.excess[np.isfinite(seen.excess)])
    typical = float(np.quantile(magnitudes, 0.8)) if magnitudes.size else SCALES[0]
    top = next((scale for scale in SCALES if scale >= typical), SCALES[-1])
    colours = matplotlib.colormaps["RdBu_r"]
    mesh = axes.pcolormesh(
        x,
        y,
        np.ma.masked_invalid(seen.excess),
        cmap=colours,
        vmin=-top,
        vmax=top,
        zorder=1,
        rasterized=True,
    )
    _lines(axes, x, y, np.where(np.isfinite(seen.excess), seen.excess, -99.0), [(0.0, "-")])
    ticks = np.linspace(-top, top, 5)
    return mesh, "Signal excess [dB]", (ticks, [f"{tick:+g}" if tick else "0" for tick in ticks])


def _chance(axes: Axes, x: Array, y: Array, seen: Looked) -> tuple[Any, str, Any]:
    """Shade the probability of detection; return the mesh, its title and the ticks of its scale."""
    shown = np.ma.masked_less(np.ma.masked_invalid(seen.pod), 0.005)
    colours = matplotlib.colormaps["YlGnBu"]
    mesh = axes.pcolormesh(x, y, shown, cmap=colours, vmin=0, vmax=1, zorder=1, rasterized=True)
    _lines(axes, x, y, np.nan_to_num(seen.pod), SHARES)
    ticks = np.linspace(0, 1, 6)
    verb = "hears" if seen.excess is not None else "detects"
    return (
        mesh,
        f"Probability that a look {verb} it [%]",
        (ticks, [f"{100 * tick:.0f}" for tick in ticks]),
    )


def _lines(
    axes: Axes, x: Array, y: Array, values: Array, levels: Iterable[tuple[float, Any]]
) -> None:
    middle = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
    for level, dashes in levels:
        if values.min() < level < values.max():
            axes.contour(
                *middle,
                values,
                [level],
                colors=INK,
                linewidths=0.6 if level == SHARES[0][0] else 0.9,
                linestyles=[dashes],
                zorder=3,
            )


def _marks(on: Page, axes: Axes, frame: Frame, found: Reach) -> None:
    """Draw range rings, beams, the array's heading and the sensor."""
    question = found.question
    x0, y0 = frame.project(*question.place)
    step = next(step for step in STEPS if found.extent / NMI / step <= RINGS)
    rings, distances = [], np.arange(1, math.floor(found.extent / NMI / step) + 1) * step
    for miles in distances:
        rings.append(
            np.column_stack(
                frame.project(*_positions(question, CIRCLE, np.full(CIRCLE.shape, miles * NMI)))
            )
        )
        x, y = frame.project(*_positions(question, AWAY, np.array(miles * NMI)))
        axes.text(
            float(x),
            float(y),
            f"{miles:g} nmi" if miles == distances[0] else f"{miles:g}",
            fontsize=7.5,
            color=INK,
            ha="center",
            va="center",
            path_effects=labels.HALO,
            zorder=16,
            clip_on=True,
        )
    axes.add_collection(
        LineCollection(rings, colors=INK, linewidths=0.6, alpha=0.75, zorder=7), autolim=False
    )
    for number, bearing in _rays(question):
        x, y = frame.project(
            *_positions(question, np.full(60, bearing), np.linspace(0.0, 0.93 * found.extent, 60))
        )
        axes.plot(
            x,
            y,
            color=INK,
            linewidth=0.8,
            linestyle=(0, (4, 3)),
            zorder=8,
            scalex=False,
            scaley=False,
        )
        axes.text(
            float(x[-1]),
            float(y[-1]),
            str(number),
            fontsize=8,
            weight="bold",
            color=INK,
            ha="center",
            va="center",
            path_effects=labels.HALO,
            zorder=16,
        )
    if question.has_array:
        x, y = frame.project(
            *_positions(
                question, np.full(2, question.heading), np.array([0.0, 0.17 * found.extent])
            )
        )
        arrow = {
            "arrowstyle": "-|>",
            "color": RED,
            "linewidth": 2.0,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 14,
        }
        axes.annotate("", (x[1], y[1]), (x[0], y[0]), arrowprops=arrow, zorder=12)
    axes.plot(
        [x0],
        [y0],
        linestyle="none",
        marker="*",
        markersize=12,
        color=RED,
        markeredgecolor="white",
        zorder=13,
        scalex=False,
        scaley=False,
    )


def _rays(asked: Question) -> list[tuple[int, float]]:
    """Return numbers and true bearings [rad] of beams, mirror images included; [] if too many."""
    sonar = asked.sonar
    if sonar is None:
        return []
    listened = asked.beams or tuple(range(len(sonar.gain.beams)))
    if len(listened) > RAYS:
        return []
    found = []
    for beam in listened:
        steered = float(sonar.gain.steered[beam])
        if math.isnan(steered):
            continue
        found.append((beam + 1, asked.heading + steered))
        if sonar.gain.mirrored and 1e-6 < steered < math.pi - 1e-6:
            found.append((beam + 1, asked.heading - steered))
    return found


def _key(question: Question, has_excess: bool) -> list[tuple[Any, str]]:
    """Return symbols and their meanings for the legend."""
    rows: list[tuple[Any, str]] = [
        (Line2D([], [], linestyle="none", marker="*", markersize=10, color=RED), "sensor"),
    ]
    if question.has_array:
        arrow = Line2D([], [], color=RED, linewidth=2, marker=">", markevery=[-1], markersize=6)
        rows.append((arrow, "heading of its array"))
    if _rays(question):
        rows.append(
            (
                Line2D([], [], color=INK, linewidth=0.8, linestyle=(0, (4, 3))),
                "processed beam",
            )
        )
    for share, dashes in SHARES:
        name = f"{100 * share:g} %" + (" and 0 dB" if has_excess and share == reaching.HALF else "")
        rows.append((Line2D([], [], color=INK, linewidth=1, linestyle=dashes), name))
    return rows
