"""The picture of where a sensor hears: signal excess and probability of detection, side by side on
the coast.

Every pixel is asked for itself, so that no grid shows, and neither the antimeridian nor a pole is a
seam. Lines mark 0 dB and 10, 50 and 90 %, so that it reads in grey.
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
RINGS = 6  # at most
RAYS = 12  # beams that are drawn, at most
AWAY = np.radians(20.0)  # bearing on which the ranges of rings are written
SCALES = (10.0, 15.0, 20.0, 30.0)  # [dB] to which the colours go
WIDE, HIGH, TOP = 5.15, 5.15, 1.05  # [in] of a map, and of the words above it
SHARES: tuple[tuple[float, Any], ...] = (
    (0.1, (0, (1, 1.5))),
    (0.5, "-"),
    (0.9, (0, (6, 2))),
)  # lines of the probability of detection


def plot_reach(
    found: Reach, path: Path, imprint: Imprint, land: Callable[[Box], Iterable[Any]]
) -> None:
    """Draw where a sensor hears into a PNG; land: returns its polygons [deg] in a box."""
    both = found.cells.excess is not None
    width = 2 * (WIDE + 0.55) + 0.3 if both else WIDE + 1.1
    height = HIGH + TOP + 1.55
    left = 0.55 / width
    letters = 105 if both else 48
    on = sheet.begin(
        Sheet(
            width,
            height,
            140,
            left=left,
            title=sheet.heading(1 - 0.36 / height, 15, 0.85 * letters),
            lines=(
                Row(1 - 0.60 / height, 10, 1.3 * letters),
                *(Row(1 - at / height, 8.5, 1.5 * letters) for at in (0.79, 0.96)),
            ),
            footer=sheet.small(0.1 / height, 7.5, 1.7 * letters),
        )
    )
    asked = found.question
    sheet.head(on, imprint, _capital(text.described(asked)), *_terms(asked))
    frame = _frame(found)
    x, y = (np.linspace(*side, PIXELS + 1) for side in (frame.x, frame.y))
    seen = _pixels(asked, frame, x, y)
    polygons = list(land(frame.box()))
    shore = chart.land_path(frame, polygons, 900)
    boxes = [
        (left + k * (WIDE + 0.7) / width, 1.18 / height, WIDE / width, HIGH / height)
        for k in range(1 + both)
    ]
    for k, box in enumerate(boxes):
        axes = on.figure.add_axes(box)
        chart.prepare(axes, frame)
        shade = _excess if both and k == 0 else _chance
        mesh, title, ticks = shade(axes, x, y, seen)
        axes.set_title(title, fontsize=10, loc="left", color=INK, pad=4)
        chart.draw_land(axes, shore)
        chart.graticule(axes, frame, labels=(True, k == 0))
        _marks(on, axes, frame, found)
        bar = on.figure.add_axes(
            (box[0] + 0.1 * box[2], 0.82 / height, 0.8 * box[2], 0.12 / height)
        )
        on.figure.colorbar(
            mesh,
            cax=bar,
            orientation="horizontal",
            extend="both" if title.startswith("Sig") else "neither",
        )
        bar.set_xticks(*ticks)
        bar.tick_params(labelsize=7.5, colors=INK, length=3)
    key = _key(asked, both)
    sheet.legend(
        on.figure,
        key,
        loc="lower left",
        bbox_to_anchor=(left - 0.01, 0.2 / height),
        fontsize=8,
        ncols=len(key) if both else math.ceil(len(key) / 2),
        columnspacing=1.4,
        handlelength=2.4,
        labelspacing=0.3,
    )
    with page.literal():
        sheet.end(on, path, imprint)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _terms(asked: Question) -> tuple[str, str]:
    """Return what the maps are of: the source level, or a table; and what a look takes besides."""
    told = dict(asked.assumed)
    sonar = asked.sonar
    if sonar is None:
        return f"A look by the table {getattr(asked.sensor.sees, 'name', '')}".rstrip(), told.get(
            "POD", ""
        )
    unknown = (
        f", unknown to all looks {notation.number(sonar.unknown)} dB" if sonar.unknown > 0 else ""
    )
    level = f"Source level {told['source level']}"
    return (
        level,
        f"Noise {told['noise']}; threshold {notation.number(sonar.threshold)} dB; fluctuation {notation.number(sonar.fluctuation)} dB{unknown}",
    )


def _frame(found: Reach) -> Frame:
    """Return the frame that shows all that is heard."""
    lon, lat = _way(found.question, CIRCLE, np.full(CIRCLE.shape, found.extent))
    return chart.frame(
        sphere.near_degrees(lon, found.question.place[0]), lat, WIDE / HIGH, margin=0.01
    )


def _way(asked: Question, bearing: Array, metres: Array) -> tuple[Array, Array]:
    """Return positions [deg] on bearings [rad] and at ranges from the sensor."""
    at = np.radians(asked.place)
    lon, lat = sphere.destination(at[0], at[1], np.sin(bearing) * metres, np.cos(bearing) * metres)
    return np.degrees(lon), np.degrees(lat)


def _pixels(asked: Question, frame: Frame, x: Array, y: Array) -> Looked:
    """Return what is heard in each pixel; NaN off the Earth's map."""
    middle = np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2)
    lonlat = np.radians(chart.DEGREES.transform_points(frame.crs, *middle))
    off = ~np.isfinite(lonlat[..., :2]).all(axis=-1)
    seen = reaching.look(
        asked, np.where(off, 0.0, lonlat[..., 0]), np.where(off, 0.0, lonlat[..., 1])
    )
    return Looked(
        np.where(off, np.nan, seen.pod),
        None if seen.excess is None else np.where(off, np.nan, seen.excess),
    )


def _excess(axes: Axes, x: Array, y: Array, seen: Looked) -> tuple[Any, str, Any]:
    """Shade the signal excess about 0 dB; return the mesh, its title and the ticks of its scale."""
    assert seen.excess is not None
    known = np.abs(seen.excess[np.isfinite(seen.excess)])
    usual = float(np.quantile(known, 0.8)) if known.size else SCALES[0]
    top = next((scale for scale in SCALES if scale >= usual), SCALES[-1])
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
        f"Chance that a look {verb} it [%]",
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
    """Draw rings of range, beams, the array's heading and the sensor."""
    asked = found.question
    x0, y0 = frame.project(*asked.place)
    step = next(step for step in STEPS if found.extent / NMI / step <= RINGS)
    rings, every = [], np.arange(1, math.floor(found.extent / NMI / step) + 1) * step
    for miles in every:
        rings.append(
            np.column_stack(frame.project(*_way(asked, CIRCLE, np.full(CIRCLE.shape, miles * NMI))))
        )
        x, y = frame.project(*_way(asked, AWAY, np.array(miles * NMI)))
        axes.text(
            float(x),
            float(y),
            f"{miles:g} nmi" if miles == every[0] else f"{miles:g}",
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
    for number, bearing in rays(asked):
        x, y = frame.project(
            *_way(asked, np.full(60, bearing), np.linspace(0.0, 0.93 * found.extent, 60))
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
    if asked.has_array:
        x, y = frame.project(
            *_way(asked, np.full(2, asked.heading), np.array([0.0, 0.17 * found.extent]))
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


def rays(asked: Question) -> list[tuple[int, float]]:
    """Return numbers and true bearings [rad] of the beams to draw, with their mirror images; none
    where they are many.
    """
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


def _key(asked: Question, both: bool) -> list[tuple[Any, str]]:
    """Return symbols and what they mean."""
    rows: list[tuple[Any, str]] = [
        (Line2D([], [], linestyle="none", marker="*", markersize=10, color=RED), "sensor"),
    ]
    if asked.has_array:
        arrow = Line2D([], [], color=RED, linewidth=2, marker=">", markevery=[-1], markersize=6)
        rows.append((arrow, "heading of its array"))
    if rays(asked):
        rows.append(
            (
                Line2D([], [], color=INK, linewidth=0.8, linestyle=(0, (4, 3))),
                "beam that is listened to",
            )
        )
    for share, dashes in SHARES:
        name = f"{100 * share:g} %" + (" and 0 dB" if both and share == reaching.HALF else "")
        rows.append((Line2D([], [], color=INK, linewidth=1, linestyle=dashes), name))
    return rows
