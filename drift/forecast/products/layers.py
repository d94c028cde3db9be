"""Chart layers of a forecast: shading, areas, mean track, marks, and probability ashore."""

from collections.abc import Iterable, Sequence
from typing import Any

import matplotlib
import numpy as np
import shapely
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.image import PcolorImage
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from drift.forecast import coastal, effective
from drift.forecast.build import Contour, Forecast
from drift.forecast.mapped import SHOWN
from drift.forecast.products import beyond
from drift.products.maps import chart, gazetteer, labels
from drift.products.maps.chart import Frame
from drift.products.maps.marks import Line, Mark
from geo import notation, sphere
from geo.array import Array
from geo.notation import NMI

INNERMOST: dict[str, Any] = {"color": "#0b4f8a", "linewidth": 2.2, "linestyle": "-"}
BETWEEN: tuple[Any, ...] = (
    (0, (6, 2)),
    (0, (6, 2, 1.5, 2)),
    (0, (10, 3)),
    (0, (4, 1.5, 1.5, 1.5, 1.5, 1.5)),
)
OUTERMOST: dict[str, Any] = {"color": "#0b4f8a", "linewidth": 1.1, "linestyle": (0, (2, 1.5))}
ROUGH: dict[str, Any] = {
    "facecolor": "none",
    "edgecolor": "#55606b",
    "hatch": "////",
    "linewidth": 0.0,
    "alpha": 0.55,
}
BAND = 2.8  # width of a coastal band [typographic points], without its edges
PALEST = 0.35  # opacity of the band of the outermost area
LARGER = 1.6  # factor by which a frame may grow to include a distant place
TRACK, ASHORE, LAST_KNOWN = "#111111", "#7a1fa2", chart.RED
TIMES_APART = 0.06  # least distance of places on the track with a time, as a share of the map
ISLAND = 0.02  # share of an area's size under which an island or a hole is not drawn
PARTIAL: dict[str, Any] = {
    "color": TRACK,
    "linewidth": 0.9,
    "linestyle": (0, (1, 2)),
    "marker": ".",
    "markersize": 3,
}
OTHERS: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 2.6,
    "color": "#55606b",
    "markeredgecolor": "white",
    "markeredgewidth": 0.4,
}
NAME: dict[str, Any] = {"fontsize": 8, "color": "#003b36", "weight": "bold"}
TOWN: dict[str, Any] = {
    "marker": "o",
    "linestyle": "none",
    "markersize": 3,
    "color": "#3b3b3b",
    "markeredgewidth": 0,
}
TOWN_NAME: dict[str, Any] = {"fontsize": 7.5, "color": "#3b3b3b", "style": "italic"}
PRIOR_COLOURS = ("#1b5e20", "#00a0b0", "#5d4037", "#8bc34a", "#000000")
PRIOR_DASHES: tuple[Any, ...] = ((0, (6, 2, 1, 2)), (0, (10, 2.5)), (0, (3, 1, 1, 1, 1, 1)), "-")


def prior_style(which: int) -> dict[str, Any]:
    """Return the style of a scenario's area or trackline; twenty differ, by their dashes also in
    grey print.
    """
    return {
        "color": PRIOR_COLOURS[which % len(PRIOR_COLOURS)],
        "linestyle": PRIOR_DASHES[which % len(PRIOR_DASHES)],
        "linewidth": 1.7,
        "path_effects": [patheffects.withStroke(linewidth=3.2, foreground="white", alpha=0.7)],
    }


def shading() -> Colormap:
    """Magma reversed, without its nearly black end, so that lines on top stay visible."""
    return ListedColormap(
        matplotlib.colormaps["magma_r"](np.linspace(0.03, 0.8, 256)), name="shading"
    )


def extent(
    forecast: Forecast,
    times: Sequence[Any],
    marks: Sequence[Mark],
    lines: Sequence[Line],
    aspect: float,
    also: Iterable[Sequence[Array]] = (),
) -> Frame:
    """Return the frame that holds the shaded cells at these times, the mean track and the marks,
    without outliers.

    also: places, each some shapes (n, 2) [deg]; a place is included unless it makes the frame more
    than LARGER times as wide.
    """
    data = forecast.data
    lon, lat = [data["mean_lon"].values], [data["mean_lat"].values]
    for contour in forecast.contours:
        if (
            contour.time in times
            and contour.share == forecast.shares[-1]
            and not contour.polygon.is_empty
        ):
            if np.abs(contour.polygon.bounds[1::2]).max() > chart.POLAR:
                places = shapely.get_coordinates(contour.polygon)
                lon.append(places[:, 0])
                lat.append(places[:, 1])
                continue
            west, south, east, north = _shaded(forecast, contour)
            lon.append(np.array([west, east]))
            lat.append(np.array([south, north]))
    middle = float(data["lon"].mean())
    for mark in marks:
        lon.append(np.array([near(mark.lon, middle)]))
        lat.append(np.array([mark.lat]))
    for line in lines:
        shift = near(float(np.mean(line.lon)), middle) - float(np.mean(line.lon))
        lon.append(np.asarray(line.lon, float) + shift)
        lat.append(np.asarray(line.lat, float))
    every_lon, every_lat = np.concatenate(lon), np.concatenate(lat)
    finite = np.isfinite(every_lon) & np.isfinite(every_lat)
    if not finite.any():
        every_lon, every_lat, finite = (
            data["lon"].values[[0, -1]],
            data["lat"].values[[0, -1]],
            np.array([True, True]),
        )
    frame = chart.frame(every_lon[finite], every_lat[finite], aspect, margin=0.05)
    for shapes in also:
        if beyond.is_outside_frame(frame, shapes):
            more = [
                *lines,
                *(Line(points[:, 0].tolist(), points[:, 1].tolist(), "") for points in shapes),
            ]
            whole = extent(forecast, times, marks, more, aspect)
            frame, lines = (whole, more) if little(frame, whole) else (frame, lines)
    return frame


def little(frame: Frame, whole: Frame) -> bool:
    """Return whether a whole frame is at most LARGER times as wide as a frame."""
    return whole.x[1] - whole.x[0] <= LARGER * (frame.x[1] - frame.x[0])


def _shaded(forecast: Forecast, contour: Contour) -> tuple[float, float, float, float]:
    """Return the bounds [deg] of the cells shaded at a contour's time.

    To exclude outliers, the bounds extend on each side at most the contour's size beyond it.
    """
    data = forecast.data
    west, south, east, north = contour.polygon.bounds
    cells = (
        data["containment"].values[int(np.flatnonzero(data["time"].values == contour.time)[0])]
        <= SHOWN
    )
    lon, lat = (
        data[name].values[np.flatnonzero(cells.any(axis=axis))]
        for name, axis in (("lon", 0), ("lat", 1))
    )
    if not len(lon):
        return west, south, east, north
    half = (
        chart.edges(data["lon"].values)[1] - data["lon"].values[0],
        chart.edges(data["lat"].values)[1] - data["lat"].values[0],
    )
    wide, high = east - west, north - south
    return (
        min(west, max(lon[0] - half[0], west - wide)),
        min(south, max(lat[0] - half[1], south - high)),
        max(east, min(lon[-1] + half[0], east + wide)),
        max(north, min(lat[-1] + half[1], north + high)),
    )


def near(lon: float, middle: float) -> float:
    """Return a longitude [deg] shifted by whole turns to be nearest to another."""
    return sphere.near_degrees(lon, middle)


def density(forecast: Forecast, time: int) -> Array:
    """Return the probability density [% per nmi2] at a time, (nlat, nlon)."""
    data = forecast.data
    return np.asarray(
        100
        * data["probability"].values[time].astype(np.float64)
        / (data["cell_area"].values / NMI**2)
    )


def scale_top(at: Any) -> float:
    """Return the density [% per nmi2] at the top of the colour scale.

    The cells above it hold a tenth of the probability adrift. Probability ashore has its own
    symbols, and its narrow strip would take most of the scale; it counts only where hardly any is
    adrift.
    """
    mass = at["probability"].values.astype(np.float64).ravel()
    adrift = mass - at["probability_ashore"].values.astype(np.float64).ravel()
    mass = adrift if adrift.sum() > 0.05 * mass.sum() else mass
    there = np.flatnonzero(mass > 0)
    if not there.size:
        return 1e-12
    mass = mass[there]
    density = 100 * mass / (at["cell_area"].values.ravel()[there] / NMI**2)
    order = np.argsort(-density, kind="stable")
    inside = np.cumsum(mass[order])
    return float(density[order[np.searchsorted(inside, 0.1 * inside[-1])]])


def shade(ax: Axes, frame: Frame, forecast: Forecast, values: Array, norm: Any) -> Any:
    """Shade cells that have a value, and return the mesh."""
    rows, columns = (np.flatnonzero(np.isfinite(values).any(axis=axis)) for axis in (1, 0))
    lon, lat = chart.edges(forecast.data["lon"].values), chart.edges(forecast.data["lat"].values)
    r = slice(rows[0], rows[-1] + 1) if len(rows) else slice(0, 1)
    c = slice(columns[0], columns[-1] + 1) if len(columns) else slice(0, 1)
    x, y = frame.net(lon[c.start : c.stop + 1], lat[r.start : r.stop + 1])
    style: dict[str, Any] = {"cmap": shading(), "norm": norm, "zorder": 1}
    shown = np.ma.masked_invalid(values[r, c])
    if not frame.is_mercator:
        return ax.pcolormesh(x, y, shown, rasterized=True, **style)
    image = PcolorImage(ax, x[0], y[:, 0], shown, **style)
    image.set_clip_path(ax.patch)
    ax.add_image(image)
    return image


def rings_to_draw(polygon: shapely.MultiPolygon) -> list[Array]:
    """Return the rings to draw of an area, each (n, 2), without small islands and holes.

    Islands and holes smaller than ISLAND of the area are left out, in pictures only. Where islands
    make up more than a tenth of the area, the larger ones stay.
    """
    if polygon.is_empty:
        return []
    size = np.array([shapely.Polygon(part.exterior).area for part in polygon.geoms])
    order = np.argsort(size, kind="stable")
    small = size[order] < ISLAND * polygon.area
    drop = set(order[small & (np.cumsum(size[order]) < 0.1 * polygon.area)].tolist())
    rings = []
    for i, part in enumerate(polygon.geoms):
        if i not in drop:
            holes = [
                ring
                for ring in part.interiors
                if shapely.Polygon(ring).area >= ISLAND * polygon.area
            ]
            rings += [np.array(ring.coords) for ring in (part.exterior, *holes)]
    return rings


def rings(ax: Axes, frame: Frame, polygon: shapely.MultiPolygon, style: dict[str, Any]) -> None:
    """Draw the outlines of an area."""
    lines = [
        np.column_stack(frame.project(ring[:, 0], ring[:, 1])) for ring in rings_to_draw(polygon)
    ]
    ax.add_collection(
        LineCollection(
            lines,
            colors=style["color"],
            linewidths=style["linewidth"],
            linestyles=[style["linestyle"]],
            path_effects=[
                patheffects.withStroke(
                    linewidth=style["linewidth"] + 1.6, foreground="white", alpha=0.6
                )
            ],
            zorder=3,
        ),
        autolim=False,
    )


def lines(shares: Sequence[float]) -> dict[float, dict[str, Any]]:
    """Return the style of each area's outline by its share, solid for the innermost, dotted for the
    outermost.
    """
    styles = [
        INNERMOST,
        *({**INNERMOST, "linewidth": 1.5, "linestyle": dashes} for dashes in BETWEEN),
    ]
    return dict(
        zip(
            shares,
            [*styles[: len(shares) - 1], OUTERMOST] if len(shares) > 1 else styles,
            strict=False,
        )
    )


def outline_style(share: float, forecast: Forecast, few: bool = False) -> dict[str, Any]:
    """Return the style of an area's outline; few: few effective particles, drawn thin and grey."""
    style = lines(forecast.shares)[share]
    return unsure(style) if few else style


def areas_of(forecast: Forecast, time: Any, shares: Sequence[float]) -> list[Contour]:
    """Return the contours of some shares at a time."""
    return [
        contour for contour in forecast.contours if contour.time == time and contour.share in shares
    ]


def unsure(style: dict[str, Any]) -> dict[str, Any]:
    """Return an outline's style for few effective particles: thin and grey, because it is
    uncertain.
    """
    return {**style, "color": "#55606b", "linewidth": 0.55 * style["linewidth"]}


def widest(outlines: Sequence[Contour]) -> shapely.MultiPolygon:
    """Return the largest area of a time."""
    return (
        max(outlines, key=lambda contour: contour.share).polygon
        if outlines
        else shapely.MultiPolygon()
    )


def rough(ax: Axes, frame: Frame, area: shapely.MultiPolygon) -> None:
    """Hatch an area with few effective particles: its edges are uncertain."""
    rings = [
        Outline(np.column_stack(frame.project(*ring.T)), closed=True)
        for ring in rings_to_draw(area)
    ]
    if rings:
        chart.outline(ax, PathPatch(Outline.make_compound_path(*rings), zorder=2.5, **ROUGH))


def outline(
    ax: Axes,
    frame: Frame,
    forecast: Forecast,
    contours: Sequence[Contour],
    few: bool,
    width: float = 1.0,
) -> None:
    """Draw the outlines of a time's areas, `width` times as wide as usual; hatch them if `few`.

    Coastal parts of the areas are drawn as bands, because an outline a cell or two wide disappears
    under the shoreline.
    """
    if contours:
        _coast(ax, frame, forecast, contours, few, width)
    if few:
        rough(ax, frame, widest(contours))
    for contour in contours:
        style = outline_style(contour.share, forecast, few)
        rings(ax, frame, contour.polygon, {**style, "linewidth": width * style["linewidth"]})


def _coast(
    ax: Axes, frame: Frame, forecast: Forecast, contours: Sequence[Contour], few: bool, width: float
) -> None:
    """Draw the coast inside the areas of a time as bands over the land; see `outline`."""
    time = int(np.flatnonzero(forecast.data["time"].values == contours[0].time)[0])
    found = coastal.coast_lines_by_share(
        forecast.data.isel(time=time), sorted(contour.share for contour in contours)
    )
    for share in sorted(found, reverse=True):
        points, part = shapely.get_coordinates(list(found[share].geoms), return_index=True)
        codes = np.where(np.diff(part, prepend=-1) > 0, Outline.MOVETO, Outline.LINETO)
        path = Outline(np.column_stack(frame.project(*points.T)), codes)
        chart.outline(
            ax, PathPatch(path, fill=False, zorder=5.5, **band(share, forecast, few, width**2))
        )


def band(share: float, forecast: Forecast, few: bool = False, width: float = 1.0) -> dict[str, Any]:
    """Return the style of the coast inside an area: dark for the innermost, pale for the
    outermost, through which the shoreline is seen.
    """
    style, light = (
        outline_style(share, forecast, few),
        forecast.shares.index(share) / max(len(forecast.shares) - 1, 1),
    )
    strokes = [
        patheffects.Stroke(linewidth=(BAND + 1.6) * width, foreground="white", alpha=0.4),
        patheffects.Stroke(
            linewidth=BAND * width, foreground=style["color"], alpha=1 - (1 - PALEST) * light
        ),
    ]
    return {"capstyle": "round", "joinstyle": "round", "path_effects": strokes}


def bands(
    forecast: Forecast, times: Sequence[int], shares: Sequence[float], few: bool = False
) -> list[tuple[Any, str]]:
    """Return the row of a legend for the coast in areas at some times (indices), or no row where
    there is none.
    """
    found = sorted(
        {
            share
            for time in times
            for share in coastal.shares_on_coast(forecast.data.isel(time=time), shares)
        }
    )
    if not found:
        return []
    effects = [band(share, forecast, few, 0.9)["path_effects"] for share in found]
    symbols = [Line2D([], [], solid_capstyle="butt", path_effects=effect) for effect in effects]
    return [(symbols, f"On the coast: {', '.join(map(notation.hundredths, found))} %")]


def small_map_key(forecast: Forecast, marks: str) -> list[tuple[Any, str]]:
    """Return the rows of the legend of small maps: areas and marks; marks: their name, or ""."""
    rows: list[tuple[Any, str]] = []
    for share in forecast.ends:
        style = outline_style(share, forecast)
        symbol = Line2D([], [], **{**style, "linewidth": 0.7 * style["linewidth"]})
        rows.append((symbol, f"{notation.hundredths(share)} % area"))
    return [*rows, (mark_symbol(6, 10, 1.4), marks)] if marks else rows


def ashore_symbol(size: float) -> Line2D:
    """Return the legend symbol of probability ashore, of a size [points]."""
    style: dict[str, Any] = {"color": ASHORE, "linestyle": "none", "markeredgecolor": "white"}
    return Line2D([], [], marker="^", markersize=size, **style)


def note(ax: Axes, texts: Sequence[str], **style: Any) -> None:
    """Write warnings in the lower right corner of a small map."""
    if texts:
        ax.text(
            0.98,
            0.02,
            "\n".join(texts),
            color=LAST_KNOWN,
            ha="right",
            va="bottom",
            transform=ax.transAxes,
            path_effects=labels.HALO,
            zorder=16,
            **style,
        )


def beside(frame: Frame, at: Any, count: effective.Count) -> list[str]:
    """Return the notes of a small map: few effective particles, and probability outside its
    frame.
    """
    notes = [f"only {count.words}"] if count.few else []
    out = beyond.aside(frame, at)
    return [*notes, out] if out else notes


def prior_line(ax: Axes, frame: Frame, line: Line, which: int, scale: float = 1.0) -> None:
    """Draw a scenario's area or trackline in the style of its number; scale: of the line width."""
    style = prior_style(which)
    ax.plot(
        *frame.project(*line.shape().T),
        zorder=8,
        **{**style, "linewidth": scale * style["linewidth"]},
    )


def others(ax: Axes, frame: Frame, places: Sequence[tuple[float, float]]) -> None:
    """Draw the positions [deg] of scenarios without their own mark as dots."""
    if places:
        ax.plot(*frame.project(*np.array(places, float).T), zorder=8, **OTHERS)


def mark_point(ax: Axes, frame: Frame, mark: Mark, size: float) -> None:
    """Draw a mark as a ring with a cross; size: of the ring [points]."""
    x, y = frame.project(mark.lon, mark.lat)
    ax.plot(
        x,
        y,
        "o",
        markersize=size,
        markerfacecolor="white",
        markeredgecolor=LAST_KNOWN,
        markeredgewidth=1.6,
        zorder=12,
    )
    ax.plot(
        x, y, "+", markersize=size * 1.7, markeredgecolor=LAST_KNOWN, markeredgewidth=1.6, zorder=12
    )


def mark_symbol(ring: float, cross: float, width: float = 1.6) -> tuple[Line2D, Line2D]:
    """Return the legend symbols of a mark: a ring and a cross of these sizes [points]."""
    style: dict[str, Any] = {"color": LAST_KNOWN, "linestyle": "none", "markeredgewidth": width}
    return (
        Line2D([], [], marker="o", markersize=ring, markerfacecolor="white", **style),
        Line2D([], [], marker="+", markersize=cross, **style),
    )


def ashore_marks(
    ax: Axes, frame: Frame, forecast: Forecast, time: int, scale: float = 1.0
) -> float:
    """Mark where the object may be ashore, aggregated on a coarse mesh; return the total
    probability.
    """
    ashore = forecast.data["probability_ashore"].values[time].astype(np.float64)
    rows, columns = np.nonzero(ashore)
    total = float(ashore.sum())
    if total < 5e-4:
        return total
    x, y = frame.project(forecast.data["lon"].values[columns], forecast.data["lat"].values[rows])
    weight = ashore[rows, columns]
    net = (frame.x[1] - frame.x[0]) / 45
    bins = np.floor((y - frame.y[0]) / net) * 1000 + np.floor((x - frame.x[0]) / net)
    _, member = np.unique(bins, return_inverse=True)
    sums = np.bincount(member, weight)
    order = np.lexsort((-weight, member))  # a symbol is placed at the likeliest cell of its mesh
    x, y = (v[order[np.searchsorted(member[order], np.arange(len(sums)))]] for v in (x, y))
    keep = sums > 1e-3 * total
    # symbols leave the coastal bands visible
    size = scale**2 * (9 + 50 * sums[keep] / max(sums.max(), 0.02))
    ax.scatter(
        x[keep], y[keep], size, marker="^", color=ASHORE, edgecolor="white", linewidth=0.5, zorder=9
    )
    return total


def label_obstacles(frame: Frame, forecast: Forecast, times: Sequence[Any]) -> tuple[Array, Array]:
    """Return points [m] that labels must not cover: the outer contours and the track."""
    xy = [
        np.column_stack(
            frame.project(forecast.data["mean_lon"].values, forecast.data["mean_lat"].values)
        )
    ]
    xy += [
        np.column_stack(frame.project(*np.array(part.exterior.coords).T))
        for contour in forecast.contours
        if contour.time in times
        for part in contour.polygon.geoms
    ]
    every = np.concatenate(xy)
    return every[:, 0], every[:, 1]


def first_complete_output(forecast: Forecast) -> int:
    """Return the first output whose mean includes practically all releases; see
    effective.released.
    """
    return effective.released(forecast.data)


def _apart(x: Array, y: Array, least: float) -> list[int]:
    """Return the indices of places at least `least` apart, always with the last and the first."""
    picks = list(range(len(x)))[-1:]
    for k in range(len(x) - 2, -1, -1):
        near = np.hypot(x[picks] - x[k], y[picks] - y[k]) < least
        if k == 0 or not near.any():
            picks.append(k)
    return picks[::-1]


def track(
    ax: Axes,
    canvas: FigureCanvasAgg,
    frame: Frame,
    forecast: Forecast,
    time: int,
    marks: Sequence[Mark],
    names: Sequence[tuple[Array, str]] = (),
) -> None:
    """Draw the mean track up to the map's time with its times, marks, names and the scale bar.

    names: shapes (n, 2) [deg] and texts of other objects on the map. They are written where there
    is room, and so are towns, harbours, and the times between the first and the last. Before all
    releases have happened, the mean jumps with each release: that part of the track is thin and
    dotted.
    """
    data = forecast.data
    lon, lat, times = data["mean_lon"].values, data["mean_lat"].values, data["time"].values
    last = range(len(times))[time]
    picks = [i for i in range(last + 1) if np.isfinite(lat[i])]
    x, y = frame.project(lon[picks], lat[picks])
    first = int(np.searchsorted(picks, first_complete_output(forecast)))
    ax.plot(x[first:], y[first:], color="white", linewidth=3.2, zorder=10, solid_capstyle="round")
    ax.plot(x[first:], y[first:], color=TRACK, linewidth=1.4, zorder=10.5)
    ax.plot(
        x[first:], y[first:], "o", color="white", markeredgecolor=TRACK, markersize=4.5, zorder=11
    )
    ax.plot(x[: first + 1], y[: first + 1], zorder=10.2, **PARTIAL)
    ax.plot(x[-1:], y[-1:], "o", color=TRACK, markersize=7, zorder=11.5)
    small = {"fontsize": 8, "color": TRACK}
    texts: list[labels.Point] = []
    for mark in marks:
        mark_point(ax, frame, mark, 9)
        mx, my = frame.project(mark.lon, mark.lat)
        texts.append(
            (
                float(mx),
                float(my),
                mark.label,
                {"fontsize": 9, "color": LAST_KNOWN, "weight": "bold"},
            )
        )
    written = _apart(x, y, TIMES_APART * (frame.x[1] - frame.x[0]))
    times_of = [
        (float(x[k]), float(y[k]), notation.day_time(times[picks[k]]), small) for k in written
    ]
    texts += times_of[-1:] + times_of[:1] * (len(times_of) > 1)
    must = set(range(len(texts)))
    cx, cy = label_obstacles(frame, forecast, [times[last]])
    mx, my = frame.project([m.lon for m in marks], [m.lat for m in marks])
    bar = chart.scale_bar(ax, frame, chart.free_corner(frame, np.append(cx, mx), np.append(cy, my)))
    outlines: dict[int, Array] = {}
    for shape, name in names:
        xy = np.column_stack(frame.project(*shape.T))
        if len(xy) > 1:
            outlines[len(texts)] = xy
        north = xy[np.argmax(xy[:, 1])]
        texts.append((float(north[0]), float(north[1]), name, NAME))
    texts += times_of[1:-1]
    towns = [
        place
        for place in gazetteer.places_in_box(frame.box())
        if frame.holds(*_at(frame, place.lon, place.lat))
    ]
    ax.plot(
        *frame.project([t.lon for t in towns], [t.lat for t in towns]),
        zorder=6,
        scalex=False,
        scaley=False,
        **TOWN,
    )
    texts += [(*_at(frame, place.lon, place.lat), place.name, TOWN_NAME) for place in towns]
    labels.place_labels(ax, canvas, texts, [bar], must, outlines)


def _at(frame: Frame, lon: float, lat: float) -> tuple[float, float]:
    x, y = frame.project(lon, lat)
    return float(x), float(y)
