"""Pictures of a forecast: the map that a planner pins up, small multiples by time, and a forcing field.

Land comes from the polygons handed in; nothing is downloaded. Figures are made and drawn without pyplot and leave no
state behind. Shading runs from light to dark (magma reversed): even steps to the eye and in grey print.
"""

import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from drift import chart, layers, tables
from drift.cells import Array
from drift.chart import INK, Frame
from drift.layers import Line, Mark
from drift.products import Forecast

__all__ = ["Line", "Mark", "draw_field", "draw_map", "draw_snapshots"]


def draw_map(
    forecast: Forecast,
    path: Path,
    *,
    title: str,
    polygons: Iterable[Any] = (),
    marks: Sequence[Mark] = (),
    lines: Sequence[Line] = (),
    footer: str = "",
    synthetic: bool = False,
    time: int = -1,
) -> None:
    """Draw the forecast at one output time (index).

    polygons: shapely land polygons [deg]. footer: a line of where it comes from (case, seed, version).
    synthetic: says on the map that winds or currents are made up.
    """
    figure, canvas = _figure(11.7, 8.3)
    ax = figure.add_axes((0.055, 0.095, 0.665, 0.775))
    at = forecast.data.isel(time=time)
    now = at["time"].values[()]
    outlines = [c for c in forecast.contours if c.time == now]
    here = layers.extent(forecast, [now], marks, lines, aspect=0.665 * 11.7 / (0.775 * 8.3))
    chart.prepare(ax, here)
    density = layers.density(forecast, time)
    shown = np.where(at["containment"].values <= 0.995, density, np.nan)
    mesh = layers.shade(ax, here, forecast, shown, PowerNorm(0.5, 0, layers.scale_top(at)))
    land = chart.land_path(here, polygons, 1100)
    chart.draw_land(ax, land)
    chart.graticule(ax, here)
    for line in lines:
        layers.prior_line(ax, here, line)
    for outline in outlines:
        layers.rings(ax, here, outline.polygon, layers.LINES[outline.share])
    ashore = layers.ashore_marks(ax, here, forecast, time)
    layers.track(ax, canvas, here, forecast, time, marks)

    figure.text(0.055, 0.955, textwrap.shorten(title, 95, placeholder=" …"), fontsize=15, weight="bold", color=INK)
    valid = f"Valid {tables.group(now)}   ({tables.iso(now)}, UTC)"
    figure.text(0.055, 0.92, valid, fontsize=12, color=INK)
    figure.text(0.055, 0.888, _basis(forecast, time), fontsize=9, color=INK)
    if synthetic:
        _warning(figure, 0.985, 0.955, "right", 10)
    _panel(figure, at, mesh, outlines, marks, lines, ashore, land is not None)
    figure.text(0.055, 0.04, _account(at), fontsize=9.5, color=INK)
    if footer:
        figure.text(0.055, 0.015, textwrap.shorten(footer, 190, placeholder=" …"), fontsize=7.5, color="#55606b")
    _save(canvas, path, title, dpi=140)


def draw_snapshots(
    forecast: Forecast,
    path: Path,
    *,
    title: str,
    polygons: Iterable[Any] = (),
    marks: Sequence[Mark] = (),
    footer: str = "",
    synthetic: bool = False,
) -> None:
    """Draw the output times side by side, at most twelve, on one extent and one colour scale."""
    count = forecast.data.sizes["time"]
    picks = np.unique(np.linspace(0, count - 1, min(count, 12)).round().astype(int))
    columns = {1: 1, 2: 2, 4: 2, 7: 4, 8: 4, 10: 4, 11: 4, 12: 4}.get(len(picks), 3)
    rows = -(-len(picks) // columns)
    wide, gap, head, foot, side = 3.0, 0.14, 1.3 if synthetic else 1.0, 0.5, 0.35
    width, height = columns * wide + (columns - 1) * gap + side + 1.1, rows * (wide + 0.28) + head + foot
    figure, canvas = _figure(width, height)
    times = [forecast.data["time"].values[i] for i in picks]
    here = layers.extent(forecast, times, marks, (), aspect=1.0)
    land = chart.land_path(here, polygons, 420)
    densities = [layers.density(forecast, i) for i in picks]
    top = max(layers.scale_top(forecast.data.isel(time=i)) for i in picks)
    norm, mesh = LogNorm(top / 1000, top), None
    for k, (i, density) in enumerate(zip(picks, densities, strict=True)):
        row, column = divmod(k, columns)
        left, bottom = side + column * (wide + gap), height - head - (row + 1) * (wide + 0.28) + 0.28
        ax = figure.add_axes((left / width, bottom / height, wide / width, wide / height))
        chart.prepare(ax, here)
        at = forecast.data.isel(time=i)
        contained = at["containment"].values
        shown = np.where((contained <= 0.995) & (density > 0), np.maximum(density, top / 1000), np.nan)
        mesh = layers.shade(ax, here, forecast, shown, norm)
        chart.draw_land(ax, land)
        below = k + columns >= len(picks)
        chart.graticule(ax, here, lines=3, size=7, labels=(below, column == 0))
        for outline in forecast.contours:
            if outline.time == at["time"].values and outline.share in (0.5, 0.95):
                style = {**layers.LINES[outline.share]}
                layers.rings(ax, here, outline.polygon, {**style, "linewidth": 0.7 * style["linewidth"]})
        layers.ashore_marks(ax, here, forecast, int(i), scale=0.5)
        for mark in marks:
            layers.mark_point(ax, here, mark, 6)
        areas = dict(zip(at["share"].values, at["containment_area"].values / tables.NMI**2, strict=True))
        ax.set_title(tables.group(at["time"].values[()]), fontsize=9, weight="bold", loc="left", pad=3, color=INK)
        ax.set_title(
            f"50 %: {_number(areas[0.5])}   95 %: {_number(areas[0.95])} nmi²",
            fontsize=7,
            loc="right",
            pad=3,
            color=INK,
        )
        if k == 0:
            chart.scale_bar(ax, here, chart.free_corner(here, *layers.occupied(here, forecast, times)), small=True)
    if synthetic:
        _warning(figure, side / width, 1 - 0.9 / height, "left", 8)
    figure.text(side / width, 1 - 0.36 / height, _fit(title, width * 9), fontsize=12, weight="bold", color=INK)
    figure.text(side / width, 1 - 0.62 / height, _fit(_span(times), width * 15), fontsize=8, color=INK)
    if footer:
        figure.text(side / width, 0.1 / height, _fit(footer, width * 17), fontsize=7, color="#55606b")
    if mesh is not None:
        bar = figure.add_axes((1 - 0.8 / width, (foot + 0.5) / height, 0.14 / width, 2.3 / height))
        figure.colorbar(mesh, cax=bar, extend="both")
        bar.set_title("% per nmi²", fontsize=7, color=INK, pad=8)
        bar.tick_params(labelsize=7)
    _save(canvas, path, title, dpi=130)


def draw_field(
    path: Path, lon: Array, lat: Array, east: Array, north: Array, *, title: str, polygons: Iterable[Any] = ()
) -> None:
    """Draw a field's speed [m/s] as shading and its direction as arrows; missing values stay blank.

    lon: (nlon,), lat: (nlat,) [deg], ascending; east, north: (nlat, nlon) [m/s].
    """
    figure, canvas = _figure(9.0, 7.2)
    ax = figure.add_axes((0.08, 0.07, 0.76, 0.84))
    here = chart.frame(lon[[0, -1, 0, -1]], lat[[0, -1, -1, 0]], aspect=0.76 * 9.0 / (0.84 * 7.2), margin=0.02)
    chart.prepare(ax, here)
    jump = max(1, max(len(lon), len(lat)) // 800)
    speed = np.hypot(east, north)[::jump, ::jump]
    speeds = speed[np.isfinite(speed)]
    top = float(np.quantile(speeds, 0.995)) if len(speeds) else 1.0
    mesh = ax.pcolormesh(
        *here.project(*np.meshgrid(layers.edges(lon[::jump]), layers.edges(lat[::jump]))),
        np.ma.masked_invalid(speed),
        cmap=matplotlib.colormaps["viridis_r"],
        vmin=0,
        vmax=top or 1.0,
        zorder=1,
        rasterized=True,
    )
    chart.draw_land(ax, chart.land_path(here, polygons, 900))
    chart.graticule(ax, here)
    every = (max(1, len(lat) // 22), max(1, len(lon) // 28))
    some = np.s_[every[0] // 2 :: every[0], every[1] // 2 :: every[1]]
    known = np.isfinite(np.hypot(east, north)[some])
    px, py = (v[some][known] for v in np.meshgrid(lon, lat))
    u, v = turned(here, px, py, east[some][known], north[some][known])
    ax.quiver(*here.project(px, py), u, v, color=INK, scale=22 * max(top, 1e-9), width=0.002, zorder=4.5, pivot="mid")
    bar = figure.add_axes((0.87, 0.15, 0.02, 0.6))
    figure.colorbar(mesh, cax=bar, extend="max", label="speed [m/s]")
    figure.text(0.08, 0.945, _fit(title, 80), fontsize=12, weight="bold", color=INK)
    _save(canvas, path, title, dpi=110)


def turned(here: Frame, lon: Array, lat: Array, east: Array, north: Array) -> tuple[Array, Array]:
    """Return vectors [m/s] at positions [deg] in the directions of the projection's axes, of the same length; all (n,)."""
    step = 1e-4  # [deg]
    x, y = here.project(lon, lat)
    along_x, along_y = here.project(lon + step / np.cos(np.radians(lat)), lat)
    up_x, up_y = here.project(lon, lat - step)
    u = east * (along_x - x) - north * (up_x - x)
    v = east * (along_y - y) - north * (up_y - y)
    length = np.hypot(u, v)
    scale = np.divide(np.hypot(east, north), length, out=np.zeros_like(length), where=length > 0)
    return u * scale, v * scale


def _warning(figure: Figure, x: float, y: float, side: str, size: float) -> None:
    figure.text(
        x,
        y,
        "SYNTHETIC wind or current: not for operations",
        fontsize=size,
        weight="bold",
        color="white",
        ha=side,
        bbox={"facecolor": layers.LAST_KNOWN, "edgecolor": "none", "boxstyle": "square,pad=0.35"},
    )


def _figure(width: float, height: float) -> tuple[Figure, FigureCanvasAgg]:
    figure = Figure((width, height), facecolor="white")
    return figure, FigureCanvasAgg(figure)


def _save(canvas: FigureCanvasAgg, path: Path, title: str, dpi: int) -> None:
    canvas.figure.savefig(path, format="png", dpi=dpi, metadata={"Title": title, "Software": "casp-drift"})


def _fit(text: str, characters: float) -> str:
    return textwrap.shorten(text, int(characters), placeholder=" …")


def _panel(
    figure: Figure,
    at: Any,
    mesh: Any,
    outlines: Sequence[Any],
    marks: Sequence[Mark],
    lines: Sequence[Line],
    ashore: float,
    land: bool,
) -> None:
    """Write the legend beside the map: areas, symbols, colours."""
    handles: list[Any] = []
    texts: list[str] = []
    for one in outlines:
        handles.append(Line2D([], [], **layers.LINES[one.share]))
        texts.append(f"{one.share:.0%} area: {_number(one.area / tables.NMI**2)} nmi²".replace("%", " %"))
    handles.append(
        Line2D([], [], color=layers.TRACK, linewidth=1.4, marker="o", markersize=4.5, markerfacecolor="white")
    )
    texts.append("Mean track, day and time UTC")
    handles.append(Line2D([], [], color=layers.TRACK, linestyle="none", marker="o", markersize=7))
    texts.append("Mean position at the valid time")
    if marks:
        style: dict[str, Any] = {"color": layers.LAST_KNOWN, "linestyle": "none", "markeredgewidth": 1.6}
        handles.append(
            (
                Line2D([], [], marker="o", markersize=8, markerfacecolor="white", **style),
                Line2D([], [], marker="+", markersize=13, **style),
            )
        )
        texts.append("Last known position" + ("s" if len(marks) > 1 else ""))
    for line in lines:
        handles.append(Line2D([], [], color=layers.PRIOR, linewidth=1.4, linestyle=(0, (5, 2, 1, 2))))
        texts.append(line.label)
    if ashore >= 5e-4:
        handles.append(
            Line2D([], [], color=layers.ASHORE, linestyle="none", marker="^", markersize=9, markeredgecolor="white")
        )
        texts.append(f"Ashore, {_percent(ashore)} in all; size by\nprobability")
    if land:
        handles.append(Patch(facecolor=chart.LAND, edgecolor=chart.SHORE))
        texts.append("Land")
    texts = [textwrap.fill(text, 34) if "\n" not in text else text for text in texts]
    figure.legend(
        handles,
        texts,
        loc="upper left",
        bbox_to_anchor=(0.735, 0.875),
        frameon=False,
        fontsize=9.5,
        labelspacing=0.75,
        handlelength=2.4,
        labelcolor=INK,
        borderaxespad=0,
    )
    mean = tables.position(float(at["mean_lon"]), float(at["mean_lat"])) or "none"
    datum = tables.position(float(at["datum_lon"]), float(at["datum_lat"])) or "none"
    figure.text(
        0.738, 0.40, f"Mean position   {mean}\nDatum (adrift)   {datum}", fontsize=9.5, color=INK, linespacing=1.6
    )
    bar = figure.add_axes((0.745, 0.30, 0.215, 0.022))
    figure.colorbar(mesh, cax=bar, orientation="horizontal", extend="max")
    bar.set_title("Probability density [% per nmi²]", fontsize=9, loc="left", color=INK)
    bar.tick_params(labelsize=8)
    bar.set_xticks([mesh.norm.vmax * f for f in (0, 0.1, 0.35, 1)])
    bar.set_xticklabels([_number(mesh.norm.vmax * f) for f in (0, 0.1, 0.35, 1)])
    bar.minorticks_off()
    figure.text(
        0.738,
        0.195,
        "Areas are the smallest that hold the stated\nshare of the probability adrift or ashore.",
        fontsize=8,
        color="#55606b",
        linespacing=1.4,
    )


def _number(value: float) -> str:
    """Return a positive number to three digits: 1,234 -> 1,230."""
    if not np.isfinite(value):
        return "none"
    if value <= 0:
        return "0"
    if value < 1e-3:
        return f"{value:.1e}"
    digits = 2 - int(np.floor(np.log10(value)))
    return f"{round(value, digits):,.{max(digits, 0)}f}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _account(at: Any) -> str:
    """Return the account in words: what is adrift, ashore, and lost to the map."""
    words = {"adrift": "adrift", "ashore": "ashore", "outside": "outside the forcing", "left": "left the domain"}
    words |= {"sunk": "sunk", "pending": "not yet released"}
    parts = [
        f"{words[str(name)]} {_percent(float(value))}"
        for name, value in zip(at["status"].values, at["status_probability"].values, strict=True)
        if value >= 5e-4 or name in ("adrift", "ashore")
    ]
    return "Account:  " + "   ·   ".join(parts)


def _span(times: Sequence[Any]) -> str:
    """Return in words which times are drawn, and what the numbers over each panel are."""
    return f"{tables.group(times[0])} to {tables.group(times[-1])}, UTC; areas that hold 50 and 95 % (lines), in nmi²"


def _basis(forecast: Forecast, time: int) -> str:
    """Return in words when the forecast starts and how many particles it stands on."""
    times = forecast.data["time"].values
    hours = (times[time] - times[0]) / np.timedelta64(1, "s") / 3600
    many = float(forecast.data["effective_particles"].values[time])
    return f"{hours:g} h after {tables.group(times[0])}   ·   worth {many:,.0f} independent particles"
