"""The picture of a search: for each sortie the map before it, in the middle of it and after it.

All maps of a page have one extent and one colour scale, so that the effect of a sortie can be
distinguished from drift.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline

from drift.evidence.filter.products import layers as search_layers
from drift.evidence.filter.records import NO_SENSORS, Contact, Look, Sensors, Sortie
from drift.evidence.filter.updates import Update, Updates
from drift.forecast import effective, mapped
from drift.forecast.build import Forecast
from drift.forecast.products import beyond, layers
from drift.products.maps import chart, sheet
from drift.products.maps import page as paper  # `page` is the number of one
from drift.products.maps.chart import INK, Frame
from drift.products.maps.imprint import Setting
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation

A_PAGE = 4  # sorties
WIDE, HIGH = 3.35, 2.85  # [in] of a map
GAP, OVER, HEAD, FOOT, LEFT, RIGHT = 0.14, 0.66, 0.85, 1.0, 0.42, 1.15  # [in]
STAGES = ("before", "mid-search", "after")
RECENT = np.timedelta64(6, "h")  # longest time before a sortie at which contacts are drawn with it
ONE_ROW = 7  # most symbols in one row of the legend; more take two rows
# limit of the scale's top over the median map's, so that a contact does not make the others pale
RANGE = 3.0


def pages(sorties: Sequence[Sortie]) -> int:
    """Return the number of pages that a search needs."""
    return -(-len(sorties) // A_PAGE)


def plot_searches(
    forecast: Forecast,
    sorties: Sequence[Sortie],
    contacts: Sequence[Contact],
    updates: Updates,
    path: Path,
    setting: Setting,
    *,
    page: int,
    sensors: Sensors = NO_SENSORS,
) -> None:
    """Draw one page of a search's maps.

    Args:
        forecast: with outputs at start, middle and end of each sortie, each given all evidence up
            to it.
        sorties: all sorties of the search.
        contacts: of the case.
        updates: of the run.
        path: of the picture.
        setting: title, coast and marks of the map.
        page: number of the page, from 1.
        sensors: of the case.
    """
    # as numbered: each counts when it ends
    in_order = sorted(sorties, key=lambda sortie: sortie.end)
    on_page = in_order[(page - 1) * A_PAGE : page * A_PAGE]
    outputs = [[_index(forecast, time) for time in _moments(sortie)] for sortie in on_page]
    part = replace(forecast, data=forecast.data.isel(time=np.unique(outputs)))
    times = list(part.data["time"].values)
    seen = [
        [c for c in contacts if sortie.start - RECENT <= c.time <= sortie.end] for sortie in on_page
    ]
    every_seen = list(chain(*seen))
    heard = [_sensors_of(sensors, sortie) for sortie in on_page]
    places = search_layers.places([*dict.fromkeys(every_seen)])
    frame = layers.extent(
        part, times, setting.marks, search_layers.extent(on_page), WIDE / HIGH, places.values()
    )
    tops = [layers.scale_top(part.data.isel(time=i)) for i in range(len(times))]
    ways = [overlay(times[-1]) for overlay in setting.overlays]
    norm = PowerNorm(0.5, 0, min(max(tops), RANGE * float(np.median(tops))))
    land = chart.land_path(frame, setting.polygons(frame.box()), 450)
    numbered = {
        update.name: (k, update)
        for k, update in enumerate(updates.all, 1)
        if update.kind == "sortie"
    }

    least, least_at = effective.fewest(forecast.data, np.unique(outputs), setting.particles)
    out = beyond.named(frame, places)
    head = HEAD + 0.3 * (least.few + bool(out))
    size = (LEFT + 3 * WIDE + 2 * GAP + RIGHT, head + len(on_page) * (HIGH + OVER) + FOOT)
    on = sheet.begin_page(_sheet(*size))
    corner = chart.free_corner(frame, *_points_to_keep_clear(frame, part, on_page, times))
    for row, sortie in enumerate(on_page):
        bottom = size[1] - head - (row + 1) * (HIGH + OVER)
        number, update = numbered.get(sortie.name, (0, None))
        name = f"{number}  {sortie.name}" if number else sortie.name
        _heading(on.figure, size, bottom + HIGH + 0.3, name, sortie, update)
        for column, (i, wanted) in enumerate(zip(outputs[row], _moments(sortie), strict=True)):
            left = LEFT + column * (WIDE + GAP)
            ax = on.figure.add_axes(
                (left / size[0], bottom / size[1], WIDE / size[0], HIGH / size[1])
            )
            mesh = _map(ax, frame, forecast, i, norm, land, setting)
            chart.graticule(
                ax, frame, lines=3, size=7, labels=(row == len(on_page) - 1, column == 0)
            )
            for way in ways:
                way.draw(ax, frame)
            search_layers.sortie(ax, frame, sortie, wanted)
            time = forecast.data["time"].values[i]
            for contact in (c for c in seen[row] if c.time <= time):
                search_layers.contact(ax, frame, contact, 0.8)
            for what in (w for w in heard[row] if w in search_layers.begun_sensors(sensors, time)):
                search_layers.sensor(ax, frame, what, 0.8)
            _titles(ax, column, time, wanted, update)
            if row == column == 0:
                chart.scale_bar(ax, frame, corner, small=True)
    contents = _contents(
        sorties, page, any(s.name in numbered for s in on_page), bool(every_seen), setting.particles
    )
    sheet.write_head(on, setting.imprint, contents)
    if least.few:
        when = notation.format_dtg(forecast.data["time"].values[least_at])
        sheet.draw_rough_banner(on, effective.banner(least, "areas and shares are rough", when))
    if out:
        sheet.write_line(on, sheet.warning(1 - (0.93 + 0.3 * least.few) / size[1], 9), out)
    _key(
        on.figure,
        size,
        forecast,
        search_layers.key(on_page, every_seen, 0.9)
        + search_layers.sensor_key([*chain(*heard)], 0.9)
        + [(symbol, paper.fit(text, 44)) for way in ways for symbol, text in way.key]
        + layers.bands(forecast, np.unique(outputs).tolist(), forecast.ends),
        bool(setting.marks),
    )
    _bar(on.figure, size, mesh)
    sheet.finish_page(on, path, setting.imprint)


def _sensors_of(sensors: Sensors, sortie: Sortie) -> list[search_layers.Sensor]:
    """Return the sensors drawn with a sortie: those active about its time, and all lines."""
    told: list[search_layers.Sensor] = list(sensors.lines)
    for what in sensors.telling:
        begin, end = (what.time, what.time) if isinstance(what, Look) else (what.start, what.end)
        if begin <= sortie.end and end >= sortie.start - RECENT:
            told.append(what)
    return told


def _sheet(width: float, height: float) -> Sheet:
    return Sheet(
        width,
        height,
        130,
        left=LEFT / width,
        title=sheet.heading(1 - 0.37 / height, 13),
        lines=(Row(1 - 0.63 / height, 9),),
        caution=Badge(1 - 0.15 / width, 1 - 0.37 / height, 9, "right"),
        rough=Badge(LEFT / width, 1 - 0.93 / height, 9),
        footer=sheet.small(0.12 / height, 7),
    )


def _contents(
    sorties: Sequence[Sortie], page: int, numbered: bool, contacts: bool, particles: int | None
) -> str:
    """Return the line of text under the title: what a page shows."""
    many = len(sorties)
    if all(sortie.planned and sortie.sensor is not None for sortie in sorties):
        parts = [
            f"{many} towed arrays as planned, and the probability that remains if they hear nothing"
        ]
        parts = (
            parts
            if many > 1
            else ["A towed array as planned, and the probability that remains if it hears nothing"]
        )
    else:
        parts = [
            f"{many} sorties that found nothing, in order of end"
            if many > 1
            else "One sortie that found nothing"
        ]
    if many > A_PAGE:
        parts.insert(0, f"Page {page} of {pages(sorties)}")
    if numbered:
        parts.append(f"number{'s' * (many > 1)} as in evidence.png")
    if contacts:
        parts.append(f"contacts from {RECENT // np.timedelta64(1, 'h')} h before the sortie on")
    if particles is not None:
        parts.append(f"{particles:,} particles")
    return "   ·   ".join(parts)


def _moments(sortie: Sortie) -> tuple[Any, Any, Any]:
    return sortie.start, sortie.start + (sortie.end - sortie.start) // 2, sortie.end


def _index(forecast: Forecast, time: Any) -> int:
    """Return the output nearest to a time; of two at the same time, the last.

    The last one includes the updates of that time.
    """
    apart = np.abs(forecast.data["time"].values - time)
    return int(np.flatnonzero(apart == apart.min())[-1])


def _points_to_keep_clear(
    frame: Frame, part: Forecast, some: Sequence[Sortie], times: Sequence[Any]
) -> tuple[Any, Any]:
    """Return the points [m] that the scale bar should not cover."""
    x, y = layers.label_obstacles(frame, part, times)
    for line in search_layers.extent(some):
        px, py = frame.project(line.lon, line.lat)
        x, y = np.append(x, px), np.append(y, py)
    return x, y


def _map(
    ax: Axes,
    frame: Frame,
    forecast: Forecast,
    i: int,
    norm: PowerNorm,
    land: Outline | None,
    setting: Setting,
) -> Any:
    """Draw the probability and the areas of an output; return the shading."""
    chart.prepare(ax, frame)
    at = forecast.data.isel(time=i)
    shown = np.where(at["containment"].values <= mapped.SHOWN, layers.density(forecast, i), np.nan)
    mesh = layers.shade(ax, frame, forecast, shown, norm)
    chart.draw_land(ax, land)
    count = effective.effective_at(forecast.data, i, setting.particles)
    outlines = layers.areas_of(forecast, at["time"].values, forecast.ends)
    layers.outline(ax, frame, forecast, outlines, count.few, width=0.6)
    layers.note(ax, layers.beside(frame, at, count), fontsize=7.5, weight="bold")
    layers.ashore_marks(ax, frame, forecast, i, scale=0.45)
    for mark in setting.marks:
        layers.mark_point(ax, frame, mark, 6)
    return mesh


def _heading(
    figure: Figure,
    size: tuple[float, float],
    y: float,
    name: str,
    sortie: Sortie,
    update: Update | None,
) -> None:
    """Write the heading of a row: name, time and results of the sortie."""
    when = f"{notation.day_time(sortie.start)} to {notation.format_dtg(sortie.end)}"
    parts = [when, *([sortie.kind] if sortie.kind else [])]
    if sortie.frame == "datum" and sortie.marker is None:
        parts.append("drawn at its datum")
    if sortie.completed < 1:
        parts.append(f"{notation.hundredths(sortie.completed)} % completed")
    if update is not None and update.pos is not None:
        parts.append(_pos_text(update))
    words = "   ·   ".join(parts)
    # Letters of 9 points are 0.07 in wide, bold ones of 10.5 points 0.1 in.
    room = size[0] - LEFT - RIGHT - 0.071 * len(words)  # [in]
    name = paper.fit(name, max(room / 0.1, 16))
    figure.text(LEFT / size[0], y / size[1], name, fontsize=10.5, weight="bold", color=INK)
    figure.text((size[0] - RIGHT) / size[0], y / size[1], words, fontsize=9, color=INK, ha="right")


def _pos_text(update: Update) -> str:
    """Return POC x POD = POS in percent; POS alone without a POC."""
    assert update.pos is not None
    pos = f"POS {notation.short_percent(update.pos[-1])}"
    if update.poc is None or update.pod is None or not np.isfinite(update.poc[-1]):
        return pos
    if update.poc[-1] <= 0:
        return f"POC 0 %: none of it was there; {pos}"
    return f"POC {notation.short_percent(update.poc[-1])} × POD {notation.short_percent(update.pod[-1])} = {pos}"


def _titles(ax: Axes, column: int, time: Any, wanted: Any, update: Update | None) -> None:
    """Write the time over a map, and POC, POD or POS by stage.

    If no output is at the wanted time, add the difference.
    """
    apart = (time - wanted) / np.timedelta64(1, "m")
    off = f" ({apart:+.0f} min)" if abs(apart) >= 1 else ""
    text = f"{STAGES[column]} {notation.day_time(time)}{off}"
    chart.title(ax, text, "left", 8.5, weight="bold", pad=3)
    if update is None or update.pos is None:
        return
    words = ""
    if column == 0 and update.poc is not None:
        words = f"POC {notation.short_percent(update.poc[-1])}"
    elif column == 1 and update.pod is not None and update.poc is not None and update.poc[-1] > 0:
        words = f"POD {notation.short_percent(update.pod[-1])}"
    elif column == 2:
        words = f"POS {notation.short_percent(update.pos[-1])}"
        if update.cumulative is not None:
            words += f", cumulative {notation.short_percent(update.cumulative[-1])}"
    chart.title(ax, words, "right", 8.5, pad=3)


def _key(
    figure: Figure,
    size: tuple[float, float],
    forecast: Forecast,
    rows: list[tuple[Any, str]],
    marked: bool,
) -> None:
    """Draw the legend under the maps."""
    rows += layers.small_map_key(forecast, "Position known or reported" if marked else "")
    sheet.legend(
        figure,
        rows,
        loc="center left",
        bbox_to_anchor=(LEFT / size[0], 0.46 / size[1]),
        ncols=len(rows) if len(rows) <= ONE_ROW else -(-len(rows) // 2),
        fontsize=8 if len(rows) <= 2 * ONE_ROW else 7,
        borderaxespad=0,
        columnspacing=1.4,
        handlelength=2.6,
    )


def _bar(figure: Figure, size: tuple[float, float], mesh: Any) -> None:
    """Draw the colour scale right of the maps."""
    box = (size[0] - 0.85) / size[0], (FOOT + 0.25) / size[1], 0.14 / size[0], 2.1 / size[1]
    bar, unit = sheet.density_bar(figure, box, mesh)
    bar.set_title(f"% per {unit}", fontsize=7, color=INK, pad=8)
    bar.tick_params(labelsize=7, colors=INK)
