"""The picture of a search: for each sortie the map before it, in the middle of it and after it has failed.

All maps of a page have one extent and one colour scale, so that a hole that a sortie has made can be told from drift.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path as Outline

from drift.forecast import beyond, effective, layers
from drift.forecast.build import Forecast
from drift.maps import chart, labels, sheet
from drift.maps import page as paper  # `page` is the number of one
from drift.maps.chart import INK, Frame
from drift.maps.imprint import Imprint
from drift.maps.marks import Mark
from drift.maps.sheet import Badge, Row, Sheet
from drift.search import layers as search_layers
from drift.search.records import Contact, Sortie
from drift.search.updates import Update, Updates
from geo import notation

A_PAGE = 4  # sorties
WIDE, HIGH = 3.35, 2.85  # [in] of a map
GAP, OVER, HEAD, FOOT, LEFT, RIGHT = 0.14, 0.66, 0.85, 1.0, 0.42, 1.15  # [in]
STAGES = ("before", "mid-search", "after")
RECENT = np.timedelta64(6, "h")  # before a sortie, from when on contacts are drawn with it
RANGE = 3.0  # densest map over the middle one on the colour scale: a contact must not make the others pale


def pages(sorties: Sequence[Sortie]) -> int:
    """Return the number of pages that a search needs."""
    return -(-len(sorties) // A_PAGE)


def draw(
    forecast: Forecast,
    sorties: Sequence[Sortie],
    contacts: Sequence[Contact],
    updates: Updates,
    path: Path,
    imprint: Imprint,
    *,
    page: int,
    polygons: Iterable[Any] = (),
    marks: Sequence[Mark] = (),
    particles: int | None = None,
) -> None:
    """Draw one page (from 1) of a search's maps; see drift.forecast.map.draw_map for the rest.

    forecast: with outputs at start, middle and end of each sortie, each given all that was seen up to it.
    """
    first = (page - 1) * A_PAGE
    some = sorties[first : first + A_PAGE]
    picks = [[_index(forecast, time) for time in _moments(one)] for one in some]
    part = replace(forecast, data=forecast.data.isel(time=np.unique(picks)))
    times = list(part.data["time"].values)
    seen = [[one for one in contacts if sortie.start - RECENT <= one.time <= sortie.end] for sortie in some]
    places = search_layers.places([*dict.fromkeys(chain(*seen))])
    here = layers.extent(part, times, marks, search_layers.extent(some), WIDE / HIGH, places.values())
    tops = [layers.scale_top(part.data.isel(time=i)) for i in range(len(times))]
    norm = PowerNorm(0.5, 0, min(max(tops), RANGE * float(np.median(tops))))
    land = chart.land_path(here, polygons, 450)
    known = {update.name: (k, update) for k, update in enumerate(updates.all, 1) if update.kind == "sortie"}

    least, least_at = effective.fewest(forecast.data, np.unique(picks), particles)
    out = beyond.named(here, places)
    head = HEAD + 0.3 * (least.few + bool(out))
    size = (LEFT + 3 * WIDE + 2 * GAP + RIGHT, head + len(some) * (HIGH + OVER) + FOOT)
    on = sheet.begin(
        Sheet(
            *size, 130, left=LEFT / size[0], title=sheet.heading(1 - 0.37 / size[1], 13, 100), beside=68,
            lines=(Row(1 - 0.63 / size[1], 9),), caution=Badge(1 - 0.15 / size[0], 1 - 0.37 / size[1], 9, "right"),
            rough=Badge(LEFT / size[0], 1 - 0.93 / size[1], 9), footer=sheet.small(0.12 / size[1], 7, size[0] * 17),
        )
    )  # fmt: skip
    figure = on.figure
    corner = chart.free_corner(here, *_busy(here, part, some, times))
    mesh = None
    for row, (sortie, indices) in enumerate(zip(some, picks, strict=True)):
        bottom = size[1] - head - (row + 1) * (HIGH + OVER)
        number, update = known.get(sortie.name, (0, None))
        _heading(
            figure, size, bottom + HIGH + 0.3, f"{number}  {sortie.name}" if number else sortie.name, sortie, update
        )
        for column, (i, wanted) in enumerate(zip(indices, _moments(sortie), strict=True)):
            left = LEFT + column * (WIDE + GAP)
            ax = figure.add_axes((left / size[0], bottom / size[1], WIDE / size[0], HIGH / size[1]))
            count = effective.at(forecast.data, i, particles)
            mesh = _map(ax, here, forecast, i, norm, land, count)
            chart.graticule(ax, here, lines=3, size=7, labels=(row == len(some) - 1, column == 0))
            search_layers.sortie(ax, here, sortie, wanted)
            for one in seen[row]:
                if one.time <= forecast.data["time"].values[i]:
                    search_layers.contact(ax, here, one, 0.8)
            for mark in marks:
                layers.mark_point(ax, here, mark, 6)
            _titles(ax, column, forecast.data["time"].values[i], wanted, update)
            if row == column == 0:
                chart.scale_bar(ax, here, corner, small=True)
    told = _told(sorties, page, numbered=any(sortie.name in known for sortie in some), contacts=any(seen))
    if particles is not None:
        told += f"   ·   {particles:,} particles"
    sheet.head(on, imprint, told)
    if least.few:
        when = notation.group(forecast.data["time"].values[least_at])
        sheet.rough(on, effective.banner(least, "areas and shares are rough", when))
    if out:
        sheet.say(on, sheet.warning(1 - (0.93 + 0.3 * least.few) / size[1], 9, size[0] * 12), out)
    _key(figure, size, forecast, search_layers.key(some, list(chain(*seen)), 0.9), bool(marks))
    _bar(figure, size, mesh)
    sheet.end(on, path, imprint)


def _told(sorties: Sequence[Sortie], page: int, *, numbered: bool, contacts: bool) -> str:
    """Return in a line what a page shows."""
    many = len(sorties)
    parts = [f"{many} sorties that found nothing, in order of start" if many > 1 else "One sortie that found nothing"]
    if many > A_PAGE:
        parts.insert(0, f"Page {page} of {pages(sorties)}")
    if numbered:
        parts.append("numbered as in evidence.png" if many > 1 else "its number as in evidence.png")
    if contacts:
        parts.append(f"contacts from {RECENT // np.timedelta64(1, 'h')} h before the sortie on")
    return "   ·   ".join(parts)


def _moments(one: Sortie) -> tuple[Any, Any, Any]:
    return one.start, one.start + (one.end - one.start) // 2, one.end


def _index(forecast: Forecast, time: Any) -> int:
    """Return the output nearest to a time; of equal ones the last, which knows more."""
    apart = np.abs(forecast.data["time"].values - time)
    return int(np.flatnonzero(apart == apart.min())[-1])


def _busy(here: Frame, part: Forecast, some: Sequence[Sortie], times: Sequence[Any]) -> tuple[Any, Any]:
    """Return points [m] that the scale bar should not cover."""
    x, y = layers.occupied(here, part, times)
    for line in search_layers.extent(some):
        px, py = here.project(line.lon, line.lat)
        x, y = np.append(x, px), np.append(y, py)
    return x, y


def _map(
    ax: Axes,
    here: Frame,
    forecast: Forecast,
    i: int,
    norm: PowerNorm,
    land: Outline | None,
    count: effective.Count,
) -> Any:
    """Draw the probability at an output with its smallest and its largest area; return the shading."""
    chart.prepare(ax, here)
    at = forecast.data.isel(time=i)
    shown = np.where(at["containment"].values <= layers.SHOWN, layers.density(forecast, i), np.nan)
    mesh = layers.shade(ax, here, forecast, shown, norm)
    chart.draw_land(ax, land)
    outlines = layers.areas_of(forecast, at["time"].values, forecast.ends)
    if count.few:
        layers.rough(ax, here, layers.widest(outlines))
    for outline in outlines:
        style = layers.line(outline.share, forecast, count.few)
        layers.rings(ax, here, outline.polygon, {**style, "linewidth": 0.6 * style["linewidth"]})
    if notes := layers.beside(here, at, count):
        words: dict[str, Any] = {"fontsize": 7.5, "weight": "bold", "color": layers.LAST_KNOWN, "zorder": 16}
        words |= {"ha": "right", "va": "bottom", "transform": ax.transAxes, "path_effects": labels.HALO}
        ax.text(0.98, 0.02, "\n".join(notes), **words)
    layers.ashore_marks(ax, here, forecast, i, scale=0.45)
    return mesh


def _heading(
    figure: Figure, size: tuple[float, float], y: float, name: str, sortie: Sortie, update: Update | None
) -> None:
    """Write over a row which sortie it is, when it was and what it was worth."""
    when = f"{notation.group(sortie.start)[:6]}Z to {notation.group(sortie.end)}"
    parts = [when, *([sortie.kind] if sortie.kind else [])]
    if sortie.frame == "datum" and sortie.marker is None:
        parts.append("drawn at its datum")
    if sortie.completed < 1:
        parts.append(f"{100 * sortie.completed:.0f} % completed")
    if update is not None and update.pos is not None:
        parts.append(_worth(update))
    told = "   ·   ".join(parts)
    room = (
        size[0] - LEFT - RIGHT - 0.071 * len(told)
    )  # [in]; letters of 9 points are 0.07 in wide, bold ones of 10.5 0.1
    figure.text(
        LEFT / size[0], y / size[1], paper.fit(name, max(room / 0.1, 16)), fontsize=10.5, weight="bold", color=INK
    )
    figure.text((size[0] - RIGHT) / size[0], y / size[1], told, fontsize=9, color=INK, ha="right")


def _worth(update: Update) -> str:
    """Return POC x POD = POS in percent; a watch has no area, and a POS alone."""
    assert update.pos is not None
    pos = f"POS {_percent(update.pos[-1])}"
    if update.poc is None or update.pod is None or not np.isfinite(update.poc[-1]):
        return pos
    if update.poc[-1] <= 0:
        return f"POC 0 %: none of it was there; {pos}"
    return f"POC {_percent(update.poc[-1])} × POD {_percent(update.pod[-1])} = {pos}"


def _titles(ax: Axes, column: int, time: Any, wanted: Any, update: Update | None) -> None:
    """Write over a map its time, and what that stage says; where no output is at the time, by how much it is off."""
    apart = (time - wanted) / np.timedelta64(1, "m")
    off = f" ({apart:+.0f} min)" if abs(apart) >= 1 else ""
    text = f"{STAGES[column]} {notation.group(time)[:6]}Z{off}"
    ax.set_title(text, fontsize=8.5, weight="bold", loc="left", pad=3, color=INK)
    if update is None or update.pos is None:
        return
    words = ""
    if column == 0 and update.poc is not None:
        words = f"POC {_percent(update.poc[-1])}"
    elif column == 1 and update.pod is not None and update.poc is not None and update.poc[-1] > 0:
        words = f"POD {_percent(update.pod[-1])}"
    elif column == 2:
        words = f"POS {_percent(update.pos[-1])}"
        if update.cumulative is not None:
            words += f", cumulative {_percent(update.cumulative[-1])}"
    ax.set_title(words, fontsize=8.5, loc="right", pad=3, color=INK)


def _percent(share: float) -> str:
    return labels.percent(float(share)) if share < 0.0995 or share > 0.995 else f"{100 * share:.0f} %"


def _key(
    figure: Figure, size: tuple[float, float], forecast: Forecast, rows: list[tuple[Any, str]], marked: bool
) -> None:
    """Write under the maps what the lines and symbols are."""
    for share in forecast.ends:
        style = layers.line(share, forecast)
        symbol = Line2D([], [], **{**style, "linewidth": 0.6 * style["linewidth"]})
        rows.append((symbol, f"{notation.percent(share)} % area"))
    if marked:
        rows.append((layers.mark_symbol(6, 10, 1.4), "Position known or reported"))
    sheet.legend(
        figure,
        rows,
        loc="center left",
        bbox_to_anchor=(LEFT / size[0], 0.46 / size[1]),
        ncols=len(rows),
        fontsize=8,
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
