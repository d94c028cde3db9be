"""The scenario picture: the combined map and one conditional map per scenario with its probability.

All maps have one time, one extent and one colour scale.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.lines import Line2D

from drift.forecast import effective
from drift.forecast.build import Forecast
from drift.forecast.by_scenario import OneScenario, forecasts_by_scenario
from drift.forecast.products import layers
from drift.forecast.products import map as forecast_map
from drift.forecast.products import words as forecast_words
from drift.products.maps import chart, labels, page, sheet
from drift.products.maps.chart import INK
from drift.products.maps.imprint import Setting
from drift.products.maps.marks import Line
from drift.products.maps.overlay import AtTime
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation

WIDE, GAP, OVER, SIDE = 3.0, 0.14, 0.46, 0.35  # [in] of a map, between maps, over each, left of all
LETTERS = 30  # characters of a scenario's name above its map
LIKELY = 0.01  # probability from which a scenario's area is included in the maps' extent


def plot_scenarios(
    forecast: Forecast, path: Path, setting: Setting, *, overlays: Sequence[AtTime] = ()
) -> None:
    """Draw the scenarios at the last output; overlays: as in
    drift.forecast.products.map.draw_snapshots.
    """
    found, imprint = forecasts_by_scenario(forecast, -1), setting.imprint
    now = forecast.data["time"].values[-1]
    last = replace(forecast, data=forecast.data.isel(time=[-1]))
    all_of = "All classes" if "effective_worlds" in last.data else "All scenarios"
    panels = [OneScenario(all_of, 1.0, 1.0, last), *found]
    names = page.shorten_names([story.name for story in panels], LETTERS)
    few = [story.name for story in panels if _count(story, setting).few]
    sure = [story for story in panels if story.name not in few] or panels
    columns = min(len(panels), 4)
    rows = -(-len(panels) // columns)
    head, foot = 1.0 + 0.3 * (bool(imprint.caution) + bool(few)), 0.85
    width, height = columns * (WIDE + GAP) - GAP + SIDE + 1.1, rows * (WIDE + OVER) + head + foot
    on = sheet.begin_page(
        Sheet(
            width,
            height,
            130,
            left=SIDE / width,
            title=sheet.heading(1 - 0.36 / height, 12),
            lines=(Row(1 - 0.62 / height, 8),),
            caution=Badge(SIDE / width, 1 - 0.9 / height, 8),
            rough=Badge(SIDE / width, 1 - (0.9 + 0.3 * bool(imprint.caution)) / height, 8),
            footer=sheet.small(0.1 / height, 7),
        )
    )
    reach = [
        Line(*_bounds(story), "")
        for story in found
        if story.now >= LIKELY and story.forecast.contours
    ]
    frame = layers.extent(last, [now], setting.marks, [*setting.lines, *reach], aspect=1.0)
    land = chart.land_path(frame, setting.polygons(frame.box()), 420)
    top = max(layers.scale_top(story.forecast.data.isel(time=0)) for story in sure)
    for k, story in enumerate(panels):
        row, column = divmod(k, columns)
        left, bottom = (
            SIDE + column * (WIDE + GAP),
            height - head - (row + 1) * (WIDE + OVER) + OVER - 0.2,
        )
        ax = on.figure.add_axes((left / width, bottom / height, WIDE / width, WIDE / height))
        own = _scenario_setting(setting, story) if k else setting
        away = 1 - float(story.forecast.data["probability"].sum())
        notes = (
            [f"{notation.percent(away)} not on the map"]
            if away > forecast_words.TELLING and story.now > 0
            else []
        )
        mesh = forecast_map.small_map(ax, frame, story.forecast, 0, top, land, own, overlays, notes)
        for line in own.lines:
            layers.prior_line(ax, frame, line, setting.lines.index(line), 0.7)
        _titles(ax, story, names[k], whole=k == 0)
        chart.graticule(
            ax, frame, lines=3, size=7, labels=(k + columns >= len(panels), column == 0)
        )
        if k == 0:
            chart.scale_bar(
                ax,
                frame,
                chart.free_corner(frame, *layers.label_obstacles(frame, forecast, [now])),
                small=True,
            )
    sheet.write_head(on, imprint, _contents(forecast, setting, found))
    if few:
        listed = "; ".join(few[:3]) + (f" and {len(few) - 3} more" if len(few) > 3 else "")
        sheet.draw_rough_banner(on, f"TOO FEW EFFECTIVE PARTICLES, areas are rough: {listed}")
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (SIDE / width, 0.3 / height)}
    key = _legend_rows(panels, setting) + [row for overlay in overlays for row in overlay(now).key]
    sheet.legend(on.figure, key, ncols=len(key), fontsize=8, borderaxespad=0, borderpad=0, **place)
    forecast_map.log_bar(
        on.figure, (1 - 0.8 / width, (foot + 0.5) / height, 0.14 / width, 2.3 / height), mesh
    )
    sheet.finish_page(on, path, imprint)


def _count(story: OneScenario, setting: Setting) -> effective.Count:
    return effective.effective_at(story.forecast.data, 0, setting.particles)


def _bounds(story: OneScenario) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the range of longitude and latitude [deg] of a scenario's largest area."""
    west, south, east, north = layers.widest(story.forecast.contours).bounds
    return (west, east), (south, north)


def _scenario_setting(setting: Setting, story: OneScenario) -> Setting:
    """Return a setting with the marks of one scenario only, as drift.forecast.starts labels them.

    Releases belong to all scenarios.
    """
    marks = [mark for mark in setting.marks if mark.label.partition(", ")[2] in ("", story.name)]
    return replace(
        setting, marks=marks, lines=[line for line in setting.lines if line.label == story.name]
    )


def _titles(ax: Any, story: OneScenario, name: str, whole: bool) -> None:
    """Write a scenario's name, its prior and posterior probability and its areas above its map."""
    at = story.forecast.data.isel(time=0)
    chart.title(ax, name, "left", 9, weight="bold", pad=14)
    small: dict[str, Any] = {"fontsize": 7, "color": INK, "transform": ax.transAxes}
    ax.text(
        1, 1.015, forecast_map.sizes(at, "") if story.now > 0 else "ruled out", ha="right", **small
    )
    if not whole:
        chart.title(ax, notation.percent(story.now), "right", 9, weight="bold", pad=14)
        ax.text(0, 1.015, f"{notation.percent(story.before)} at first", **small)


def _contents(forecast: Forecast, setting: Setting, found: Sequence[OneScenario]) -> str:
    """Return a one-line description of the page."""
    many = forecast.data.sizes["scenario"]
    held = forecast_words.small_map_caption(forecast.ends)
    classes = "effective_worlds" in forecast.data
    parts = [
        notation.format_dtg(forecast.data["time"].values[-1]),
        "each class separately, with its share"
        if classes
        else "each as if it were true, with its probability",
        held,
    ]
    if many > len(found):
        parts.insert(1, f"the likeliest {len(found) - 1} of {many} and the others together")
    if setting.particles is not None:
        parts.append(f"{setting.particles:,} particles")
    return "; ".join(parts)


def _legend_rows(panels: Sequence[OneScenario], setting: Setting) -> list[tuple[Any, str]]:
    """Return the legend: symbols and their texts."""
    every = panels[0].forecast
    rows = layers.small_map_key(every, setting.known_as if setting.marks else "")
    rows += next(
        filter(None, (layers.bands(story.forecast, [0], every.ends) for story in panels)), []
    )
    if any(
        float(story.forecast.data["probability_ashore"].sum()) >= labels.TINY for story in panels
    ):
        rows.append((layers.ashore_symbol(6), "Ashore"))
    rows += [
        (Line2D([], [], **layers.prior_style(i)), f"Start: {line.label}")
        for i, line in enumerate(setting.lines)
    ]
    return [(symbol, page.fit(text, 34)) for symbol, text in rows]
