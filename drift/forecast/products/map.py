"""Pictures of a forecast: the main map, and small maps by time.

Land comes from the polygons given; nothing is downloaded. Figures are made without pyplot and leave
no global state. Shading runs from light to dark (magma reversed), in even perceptual steps also in
grey print.
"""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline

from drift.forecast import coastal, effective, mapped
from drift.forecast.build import Contour, Forecast
from drift.forecast.products import beyond, layers
from drift.forecast.products import words as forecast_words
from drift.products.maps import chart, labels, sheet
from drift.products.maps.chart import GREY, INK, Frame
from drift.products.maps.imprint import Setting
from drift.products.maps.overlay import AtTime
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation
from geo.array import Array
from geo.notation import NMI

WARNED = 105  # characters in a row of warnings, which ends where the legend begins
KEY = 2.0  # [in] width of a row of the key of small maps
ROW = 0.03  # height of a row of warnings over the map, as a share of the page
SHEET = Sheet(
    11.7,
    8.3,
    140,
    left=0.055,
    title=sheet.heading(0.955, 15),
    lines=(Row(0.92, 12), Row(0.888, 9)),
    caution=Badge(0.985, 0.955, side="right"),
    rough=Badge(0.058, 0.884 - ROW, 11),
    footer=sheet.small(0.015, 7.5),
)


def draw_map(
    forecast: Forecast,
    path: Path,
    setting: Setting,
    *,
    time: int = -1,
    overlays: Sequence[AtTime] = (),
) -> None:
    """Draw the forecast at one output (index) into a file; overlays: layers of other topics by
    time.
    """
    sheet.finish_page(_draw_page(forecast, setting, time, overlays), path, setting.imprint)


def figure(
    forecast: Forecast, setting: Setting, *, time: int = -1, overlays: Sequence[AtTime] = ()
) -> Figure:
    """Return the picture of `draw_map` as a Matplotlib figure."""
    on = _draw_page(forecast, setting, time, overlays)
    sheet.write_footer(on, setting.imprint)
    return on.figure


def _draw_page(
    forecast: Forecast, setting: Setting, time: int, overlays: Sequence[AtTime]
) -> sheet.Page:
    on = sheet.begin_page(SHEET)
    at = forecast.data.isel(time=time)
    now = at["time"].values[()]
    drawn_over = [overlay(now) for overlay in (*setting.overlays, *overlays)]
    places = {name: shapes for overlay in drawn_over for name, shapes in overlay.places.items()}
    count = effective.effective_at(forecast.data, time, setting.particles)
    height, frame, warnings = _layout(forecast, setting, time, count, places)
    ax = on.figure.add_axes((0.055, 0.095, 0.665, height))
    chart.prepare(ax, frame)
    density = layers.density(forecast, time)
    shown = np.where(at["containment"].values <= mapped.SHOWN, density, np.nan)
    mesh = layers.shade(ax, frame, forecast, shown, PowerNorm(0.5, 0, layers.scale_top(at)))
    land = chart.land_path(frame, setting.polygons(frame.box()), 1100)
    chart.draw_land(ax, land)
    chart.graticule(ax, frame)
    for i, line in enumerate(setting.lines):
        layers.prior_line(ax, frame, line, i)
    layers.others(ax, frame, setting.others)
    outlines = layers.areas_of(forecast, now, forecast.shares)
    layers.outline(ax, frame, forecast, outlines, count.few)
    for overlay in drawn_over:
        overlay.draw(ax, frame)
    ashore = layers.ashore_marks(ax, frame, forecast, time)
    priors = [(line.shape(), line.label) for line in setting.lines]
    names = [*priors, *(name for overlay in drawn_over for name in overlay.names)]
    layers.track(ax, on.canvas, frame, forecast, time, setting.marks, names)

    valid = f"Valid {notation.format_dtg(now)}   ({notation.iso(now)}, UTC)"
    sheet.write_head(
        on, setting.imprint, valid, forecast_words.basis(forecast, time, setting.particles)
    )
    if count.few:
        sheet.draw_rough_banner(on, effective.banner(count))
    for k, text in enumerate(warnings, 1 + count.few):
        sheet.write_line(on, sheet.warning(0.879 - ROW * k, 9.5), text)
    rows = _rows(forecast, setting, time, outlines, ashore, land is not None, count.few)
    rows += [row for overlay in drawn_over for row in overlay.key]
    _legend(on.figure, rows)
    _panel(on.figure, at, mesh)
    on.figure.text(0.055, 0.04, forecast_words.account(at), fontsize=9.5, color=INK)
    return on


def _layout(
    forecast: Forecast,
    setting: Setting,
    time: int,
    count: effective.Count,
    places: Mapping[str, Sequence[Array]],
) -> tuple[float, Frame, list[str]]:
    """Return the map's height [share of the page], its frame, and the rows of warnings above it.

    A warning of probability outside the frame adds rows, which make the map lower and change the
    frame.
    """
    at = forecast.data.isel(time=time)
    now = at["time"].values[()]
    texts = (
        forecast_words.off_map_warning(at),
        forecast_words.unshaded(at),
        *effective.parts(forecast.data, time),
    )
    warnings = [line for text in texts for line in textwrap.wrap(text, WARNED)]

    def under(rows: int) -> tuple[float, Frame, list[str]]:
        """Return the map's height and frame below some rows of text, and the warning of what it
        leaves out.
        """
        height = 0.775 - ROW * (count.few + rows)
        aspect = 0.665 * SHEET.width / (height * SHEET.height)
        frame = layers.extent(
            forecast, [now], setting.marks, setting.lines, aspect, places.values()
        )
        return (
            height,
            frame,
            textwrap.wrap(beyond.outside_frame_sentence(frame, at, places), WARNED),
        )

    height, frame, left_out = under(len(warnings))
    if left_out:
        height, frame, left_out = under(len(warnings) + len(left_out))
    return height, frame, [*warnings, *left_out]


def draw_snapshots(
    forecast: Forecast, path: Path, setting: Setting, *, overlays: Sequence[AtTime] = ()
) -> None:
    """Draw the output times as small maps, at most twelve, with one extent and colour scale; see
    draw_map.
    """
    count, imprint = forecast.data.sizes["time"], setting.imprint
    picks = np.unique(np.linspace(0, count - 1, min(count, 12)).round().astype(int)).tolist()
    columns = {1: 1, 2: 2, 4: 2, 7: 4, 8: 4, 10: 4, 11: 4, 12: 4}.get(len(picks), 3)
    rows = -(-len(picks) // columns)
    # A panel with hardly any releases says so itself: see effective.RELEASED.
    out = [i for i in picks if i >= layers.first_complete_output(forecast)]
    least, least_at = effective.fewest(forecast.data, out, setting.particles)
    wide, gap, side = 3.0, 0.14, 0.35
    head = 1.0 + 0.3 * (bool(imprint.caution) + least.few)
    key = layers.small_map_key(forecast, setting.known_as if setting.marks else "")
    key += layers.bands(forecast, picks, forecast.ends)
    if (
        float(forecast.data["probability_ashore"].values[picks].sum(axis=(1, 2)).max())
        >= labels.TINY
    ):
        key.append((layers.ashore_symbol(6), "Ashore"))
    key += [
        row for overlay in overlays for row in overlay(forecast.data["time"].values[picks[-1]]).key
    ]
    width = columns * wide + (columns - 1) * gap + side + 1.1
    beside = max(int((width - side) / KEY), 1)  # rows of the key in a line
    foot = 0.4 + 0.2 * (1 + -(-len(key) // beside))
    height = rows * (wide + 0.28) + head + foot
    on = sheet.begin_page(
        Sheet(
            width,
            height,
            130,
            left=side / width,
            title=sheet.heading(1 - 0.36 / height, 12),
            lines=(Row(1 - 0.62 / height, 8),),
            caution=Badge(side / width, 1 - 0.9 / height, 8),
            rough=Badge(side / width, 1 - (0.9 + 0.3 * bool(imprint.caution)) / height, 8),
            footer=sheet.small(0.1 / height, 7),
        )
    )
    times = [forecast.data["time"].values[i] for i in picks]
    frame = layers.extent(forecast, times, setting.marks, (), aspect=1.0)
    land = chart.land_path(frame, setting.polygons(frame.box()), 420)
    # Maps with few effective particles must not set the colour scale of the others.
    sure = [i for i in picks if not effective.effective_at(forecast.data, i).few]
    top = max(layers.scale_top(forecast.data.isel(time=i)) for i in sure or picks)
    for k, i in enumerate(picks):
        row, column = divmod(k, columns)
        left, bottom = (
            side + column * (wide + gap),
            height - head - (row + 1) * (wide + 0.28) + 0.28,
        )
        ax = on.figure.add_axes((left / width, bottom / height, wide / width, wide / height))
        at, waiting = forecast.data.isel(time=i), forecast_words.waiting(forecast.data)
        notes = (
            [_off_map(at, waiting)]
            if forecast_words.off_map_warning(at) and np.isfinite(at["mean_lat"])
            else []
        )
        mesh = small_map(ax, frame, forecast, i, top, land, setting, overlays, notes)
        when = notation.format_dtg(at["time"].values[()])
        chart.title(ax, when, "left", 9, weight="bold", pad=3)
        chart.title(ax, sizes(at, waiting), "right", 7, pad=3)
        chart.graticule(ax, frame, lines=3, size=7, labels=(k + columns >= len(picks), column == 0))
        if k == 0:
            chart.scale_bar(
                ax,
                frame,
                chart.free_corner(frame, *layers.label_obstacles(frame, forecast, times)),
                small=True,
            )
    sheet.write_head(
        on, imprint, _with_particles(forecast_words.span(times, forecast.ends), setting.particles)
    )
    if least.few:
        when = notation.format_dtg(forecast.data["time"].values[least_at])
        sheet.draw_rough_banner(on, effective.banner(least, "areas are rough", when))
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (side / width, 0.3 / height)}
    sheet.legend(on.figure, key, ncols=beside, fontsize=8, borderaxespad=0, borderpad=0, **place)
    log_bar(on.figure, (1 - 0.8 / width, (foot + 0.5) / height, 0.14 / width, 2.3 / height), mesh)
    sheet.finish_page(on, path, imprint)


def small_map(
    ax: Axes,
    frame: Frame,
    forecast: Forecast,
    i: int,
    top: float,
    land: Outline | None,
    setting: Setting,
    overlays: Sequence[AtTime],
    notes: Sequence[str] = (),
) -> Any:
    """Draw one output with its smallest and its largest area; return the shading.

    notes: warnings besides few particles and probability outside the frame. top: density [% per
    nmi2] at the upper end of the colour scale, which spans three powers of ten.
    """
    at, density = forecast.data.isel(time=i), layers.density(forecast, i)
    chart.prepare(ax, frame)
    holds = (at["containment"].values <= mapped.SHOWN) & (density > 0)
    shown = np.where(holds, np.maximum(density, top / 1000), np.nan)
    mesh = layers.shade(ax, frame, forecast, shown, LogNorm(top / 1000, top))
    chart.draw_land(ax, land)
    count = effective.effective_at(forecast.data, i, setting.particles)
    outlines = layers.areas_of(forecast, at["time"].values, forecast.ends)
    layers.outline(ax, frame, forecast, outlines, count.few, width=0.7)
    for overlay in overlays:
        overlay(at["time"].values[()]).draw(ax, frame)
    layers.ashore_marks(ax, frame, forecast, i, scale=0.5)
    for mark in setting.marks:
        layers.mark_point(ax, frame, mark, 6)
    layers.note(ax, [*notes, *layers.beside(frame, at, count)], fontsize=7)
    return mesh


def log_bar(figure: Figure, box: tuple[float, float, float, float], mesh: Any) -> None:
    """Draw a logarithmic colour scale of density with powers of ten.

    box: left, bottom, width, height of the page.
    """
    bar, top = figure.add_axes(box), mesh.norm.vmax
    figure.colorbar(mesh, cax=bar, extend="both")
    per, unit = labels.density_unit(top)
    powers = 10.0 ** np.arange(np.ceil(np.log10(top * per) - 3), np.floor(np.log10(top * per)) + 1)
    bar.set_yticks(powers / per, labels=[labels.plain(v) for v in powers])
    bar.minorticks_off()
    bar.set_title(f"% per {unit}", fontsize=7, color=INK, pad=8)
    bar.tick_params(labelsize=7)


def _with_particles(text: str, particles: int | None) -> str:
    return text if particles is None else f"{text}; {particles:,} particles"


def sizes(at: Any, waiting: str) -> str:
    """Return the text above a panel: the areas, or why there are none."""
    areas = list(zip(at["share"].values, at["containment_area"].values / NMI**2, strict=True))
    if np.isfinite(areas[0][1]):
        ends = dict.fromkeys((areas[0], areas[-1]))
        return (
            "   ".join(
                f"{notation.hundredths(share)} %: {labels.number(area)}" for share, area in ends
            )
            + " nmi²"
        )
    return waiting if forecast_words.statuses(at)["pending"] > 0 else "nothing left on the map"


def _off_map(at: Any, waiting: str) -> str:
    """Return a short text on the probability that a panel does not show."""
    now = forecast_words.statuses(at)
    told = {
        "pending": waiting,
        "sunk": "sunk",
        "left": "left the domain",
        "outside": "out of forcing",
    }
    return "\n".join(
        f"{notation.percent(now[name])} {words}" for name, words in told.items() if now[name] > 0
    )


def _rows(
    forecast: Forecast,
    setting: Setting,
    time: int,
    outlines: Sequence[Contour],
    ashore: float,
    land: bool,
    few: bool,
) -> list[tuple[Any, str]]:
    """Return symbols and texts of the legend: areas, track, priors, probability ashore; few: few
    particles.
    """
    rows: list[tuple[Any, str]] = []
    for outline in outlines:
        size = labels.number(outline.area / NMI**2)
        words = (
            f"{notation.hundredths(outline.share)} % area: {'rough, ' if few else ''}{size} nmi²"
        )
        rows.append((Line2D([], [], **layers.outline_style(outline.share, forecast, few)), words))
    rows += layers.bands(forecast, [time], forecast.shares, few)
    if few and outlines:
        rows.append((Patch(**layers.ROUGH), "Rough: too few effective particles"))
    style: dict[str, Any] = {"color": layers.TRACK, "marker": "o"}
    first, last = layers.first_complete_output(forecast), range(forecast.data.sizes["time"])[time]
    if first <= last:
        rows.append(
            (
                Line2D([], [], linewidth=1.4, markersize=4.5, markerfacecolor="white", **style),
                "Mean track, day and time UTC",
            )
        )
    if np.isfinite(forecast.data["mean_lat"].values[:first]).any():
        rows.append(
            (Line2D([], [], **layers.PARTIAL), f"Mean of the part {_afloat(forecast)} so far")
        )
    rows.append(
        (Line2D([], [], linestyle="none", markersize=7, **style), "Mean position at the valid time")
    )
    if setting.marks:
        many = len(setting.marks) > 1
        name = setting.known_as.replace("osition", "ositions") if many else setting.known_as
        rows.append(
            (layers.mark_symbol(8, 13), f"{name} of the likeliest" if setting.others else name)
        )
    if setting.others:
        rows.append((Line2D([], [], **layers.OTHERS), f"{len(setting.others):,} others"))
    for i, line in enumerate(setting.lines):
        kind = "area" if line.closed else "trackline"
        rows.append((Line2D([], [], **layers.prior_style(i)), f"Start {kind}: {line.label}"))
    if ashore >= labels.TINY:
        where = coastal.coast_in_words(forecast.data.isel(time=time))
        told = f"Ashore, {notation.percent(ashore)} in all, size by probability{'; ' if where else ''}{where}"
        rows.append((layers.ashore_symbol(9), told))
    if land:
        rows.append((Patch(facecolor=chart.LAND, edgecolor=chart.SHORE), "Land"))
    return rows


def _afloat(forecast: Forecast) -> str:
    """Return the word for moving particles while others have not started to move."""
    return "under way" if forecast_words.steers(forecast.data) else "adrift"


def _legend(figure: Figure, rows: Sequence[tuple[Any, str]]) -> None:
    """Draw the legend beside the map, in the largest font that ends above the positions."""
    for size in (9.5, 8.0, 6.5, 5.0):
        wide = int(34 * 9.5 / size)
        legend = sheet.legend(
            figure,
            [(symbol, textwrap.fill(text, wide)) for symbol, text in rows],
            loc="upper left",
            bbox_to_anchor=(0.735, 0.875),
            fontsize=size,
            labelspacing=0.75,
            handlelength=2.8,
            borderaxespad=0,
        )
        if size == 5.0 or legend.get_window_extent().y0 > 0.425 * figure.bbox.height:
            return
        legend.remove()


def _panel(figure: Figure, at: Any, mesh: Any) -> None:
    """Write positions, the colour bar and the sizes of the areas beside the map."""
    mean = notation.position(float(at["mean_lon"]), float(at["mean_lat"])) or "none"
    datum = notation.position(float(at["datum_lon"]), float(at["datum_lat"])) or "none"
    called = f"Datum ({forecast_words.moving_text(at)})"
    apart = "   " if len(called) <= 20 else "\n    "
    figure.text(
        0.738,
        0.36,
        f"Mean position   {mean}\n{called}{apart}{datum}",
        fontsize=9.5,
        color=INK,
        linespacing=1.6,
    )
    bar, unit = sheet.density_bar(figure, (0.745, 0.27, 0.215, 0.022), mesh)
    bar.set_title(f"Probability density [% per {unit}]", fontsize=9, loc="left", color=INK)
    bar.tick_params(labelsize=8)
    figure.text(
        0.738,
        0.145,
        f"Areas are the smallest that hold the stated\nshare of the probability {forecast_words.on_map_text(at)}.\n"
        f"Shaded: {100 * mapped.SHOWN:g} %. Islands and holes of under\n"
        f"{100 * layers.ISLAND:g} % of an area are not drawn.",
        fontsize=8,
        color=GREY,
        linespacing=1.4,
    )
