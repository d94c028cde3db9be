"""Map of `drift track`: detections, estimated track, and clouds with areas at the times shown."""

import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import shapely
from matplotlib.axes import Axes

from drift.apps.track import text
from drift.apps.track.record import Chased, Regained
from drift.products.maps import chart, labels, page, sheet
from drift.products.maps.chart import GREY, INK, RED, Frame
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Row, Sheet
from drift.tracking.tracker import density, holding
from drift.tracking.tracker import path as paths
from drift.tracking.tracker.detections import Detections
from geo import notation, sphere
from geo.array import Array
from geo.box import Box
from geo.notation import KNOT, NMI

WIDTH, HEIGHT = 11.7, 9.6  # [in]
MAP = (0.05, 0.06, 0.655, 0.845)
KEY = 0.725  # left edge of the legend
DOTS = 1500  # particles drawn of a cloud
LINES = {0.5: 1.8, 0.9: 0.8}  # widths of the areas' outlines, by share
RAY = 24  # points along a bearing
PATH, CARRIED = "#e65100", "#c2185b"
WINDOWS = (7.2, 1.0)  # [deg, kn] kernel widths of the course and speed densities, as in Borovies


def plot_track(
    found: Regained, path: Path, imprint: Imprint, land: Callable[[Box], Iterable[Any]]
) -> None:
    """Plot a track with its cloud at the times shown into a PNG.

    land: returns the land polygons [deg] in a box.
    """
    page_drawn = sheet.begin_page(
        Sheet(
            WIDTH,
            HEIGHT,
            130,
            left=MAP[0],
            title=sheet.heading(1 - 0.4 / HEIGHT, 15),
            lines=(Row(1 - 0.68 / HEIGHT, 10),),
            footer=sheet.small(0.1 / HEIGHT, 7.5),
        )
    )
    study = found.held.study
    sheet.write_head(
        page_drawn,
        imprint,
        f"{study.methods[0].name}: {study.size:,} particles, {len(found.held.sweeps):,} sweeps and times",
    )
    axes = page_drawn.figure.add_axes(MAP)
    frame = _frame(found)
    chart.prepare(axes, frame)
    chart.draw_land(axes, chart.land_path(frame, land(frame.box()), 1100))
    chart.graticule(axes, frame)
    key = [
        *_tracker(axes, frame, found),
        *_detections(axes, frame, found),
        *_clouds(axes, frame, found),
    ]
    key += _estimate(axes, frame, found)
    key += _carried(axes, frame, found)
    if isinstance(found.chased, Chased):
        key += _pursuit_path(axes, frame, found, found.chased)
    elif found.chased is not None:
        key.append(
            (
                axes.plot([], [], linestyle="none")[0],
                textwrap.fill(f"no path: {found.chased.why}", 46),
            )
        )
    chart.scale_bar(axes, frame, chart.free_corner(frame, *_projected_places(frame, found)))
    _times(page_drawn, axes, frame, found)
    if any(one.cloud is not None for one in found.held.shown):
        _densities(page_drawn, found)
    sheet.legend(
        page_drawn.figure,
        key,
        loc="upper left",
        bbox_to_anchor=(KEY - 0.01, MAP[1] + MAP[3] + 0.01),
        fontsize=8.5,
        handlelength=2.2,
        labelspacing=0.7,
    )
    with page.literal_text():
        sheet.finish_page(page_drawn, path, imprint)


def _places(found: Regained) -> tuple[Array, Array]:
    """Return all positions [deg] that the chart must show.

    Clouds count by their areas, as a few particles may be far outside of them.
    """
    held = found.held
    parts = [
        held.place[np.isfinite(held.within)],
        held.carried[_after_last_detection(found)],
        _tracker_positions(found)[0],
        _detected_positions(found),
    ]
    if isinstance(found.chased, Chased):
        parts.append(found.chased.found.path.place)
    outlines = [
        region.outline for one in held.shown for region in held.areas[held.row(one.time)].values()
    ]
    lon, lat = np.hstack(
        [
            paths.degrees(np.concatenate(parts)),
            *(shapely.get_coordinates(one).T for one in outlines),
        ]
    )
    return sphere.near_degrees(lon, lon[0]), lat


def _detected_positions(found: Regained) -> Array:
    """Return the positions of detections with bearing and range, unit vectors (n, 3)."""
    detections, study = found.held.study.target, found.held.study
    assert isinstance(detections, Detections)
    lon, lat = np.radians(paths.degrees(study.tracker.at(detections.time)[0]))
    to = sphere.destination(
        lon,
        lat,
        np.sin(detections.bearing) * detections.range,
        np.cos(detections.bearing) * detections.range,
    )
    place = paths.vector(*to)
    return place[np.isfinite(place[:, 0])]


def _tracker_positions(found: Regained) -> tuple[Array, Array]:
    """Return known positions and times [s] of the tracker, up to the start of the pursuit path."""
    study = found.held.study
    way, end = study.tracker, study.end
    if isinstance(found.chased, Chased) and holding.pursues(study) and not study.logged:
        end = min(end, found.chased.found.path.time[0])
    time = np.linspace(
        max(way.time[0], 0.0), max(min(way.time[-1], end), max(way.time[0], 0.0)), 200
    )
    return way.at(time)[0], time


def _frame(found: Regained) -> Frame:
    return chart.frame(*_places(found), MAP[2] * WIDTH / (MAP[3] * HEIGHT), margin=0.05)


def _project(frame: Frame, place: Array) -> tuple[Array, Array]:
    return frame.project(*paths.degrees(place))


def _projected_places(frame: Frame, found: Regained) -> tuple[Array, Array]:
    return frame.project(*_places(found))


def _tracker(axes: Axes, frame: Frame, found: Regained) -> list[tuple[Any, str]]:
    place, _ = _tracker_positions(found)
    (line,) = axes.plot(*_project(frame, place), color="#0b4f8a", linewidth=1.4, zorder=7)
    (end,) = axes.plot(*_project(frame, place[-1:]), "o", color="#0b4f8a", markersize=6, zorder=9)
    return [((line, end), "tracker, and its last known position")]


def _detections(axes: Axes, frame: Frame, found: Regained) -> list[tuple[Any, str]]:
    """Draw a ray for each detection, as long as its range or the sensor's reach.

    A range without a bearing becomes a circle.
    """
    detections, study = found.held.study.target, found.held.study
    assert isinstance(detections, Detections)
    symbols, spot = [], None
    styles = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (5, 2, 1.5, 2)))
    for number, sensor in enumerate(study.sensors):
        line = None
        for k in np.flatnonzero(detections.sensor == number):
            lon, lat = np.radians(paths.degrees(study.tracker.at([detections.time[k]])[0]))
            if np.isnan(detections.bearing[k]):
                bearing, far = np.linspace(0, 2 * np.pi, 10 * RAY), detections.range[k]
            else:
                length = sensor.reach if np.isnan(detections.range[k]) else detections.range[k]
                bearing, far = detections.bearing[k], length * np.linspace(0, 1, RAY)
            to = sphere.destination(lon, lat, np.sin(bearing) * far, np.cos(bearing) * far)
            x, y = frame.project(*np.degrees(to))
            (line,) = axes.plot(
                x,
                y,
                color=GREY,
                linewidth=0.9,
                linestyle=styles[number % len(styles)],
                zorder=6,
                scalex=False,
                scaley=False,
            )
            if not np.isnan(detections.range[k]) and not np.isnan(detections.bearing[k]):
                (spot,) = axes.plot(
                    x[-1:], y[-1:], "+", color=INK, markersize=7, zorder=9, linestyle="none"
                )
        if line is not None:
            symbols.append((line, f"detection by {sensor.name}"))
    return symbols if spot is None else [*symbols, (spot, "place by a bearing and a range")]


def _clouds(axes: Axes, frame: Frame, found: Regained) -> list[tuple[Any, str]]:
    """Draw the cloud at each time shown with the outlines of its areas; later ones are darker."""
    symbols: list[tuple[Any, str]] = []
    colours = _colours(found)
    held = found.held
    for one, colour in zip(held.shown, colours, strict=True):
        when, cloud, regions = (
            notation.format_dtg(text.moment(found, one.time)),
            one.cloud,
            held.areas[held.row(one.time)],
        )
        if cloud is None:
            symbols.append((axes.plot([], [], linestyle="none")[0], f"{when}: no track is held"))
            continue
        # Systematic sampling: the number of dots is proportional to the weight.
        rows = np.searchsorted(np.cumsum(cloud.weight), (np.arange(DOTS) + 0.5) / DOTS).clip(
            max=len(cloud.weight) - 1
        )
        axes.plot(
            *_project(frame, cloud.place[rows]),
            ".",
            color=colour,
            markersize=3.2,
            alpha=0.6,
            zorder=3,
            markeredgewidth=0,
        )
        for share, region in regions.items():
            for ring in shapely.get_rings(shapely.get_parts(region.outline)):
                lon, lat = np.array(ring.coords).T
                seam = np.abs(lat) == 90  # a ring round a pole is closed along the pole
                axes.plot(
                    *(np.where(seam, np.nan, v) for v in frame.project(lon, lat)),
                    color=colour,
                    zorder=4,
                    linewidth=LINES[share],
                )
        (symbol,) = axes.plot([], [], "o", color=colour, markersize=7)
        symbols.append((symbol, f"{when}: area of\n{text.sizes(regions)}"))
    if any(one.cloud is not None for one in held.shown):
        for share, width in LINES.items():
            symbols.append(
                (
                    axes.plot([], [], color=GREY, linewidth=width)[0],
                    f"area of {notation.hundredths(share)} %",
                )
            )
    return symbols


def _colours(found: Regained) -> Any:
    """Return a colour for each time shown, shape (n, 4)."""
    return matplotlib.colormaps["viridis_r"](np.linspace(0.0, 1.0, len(found.held.shown)))


def _densities(on: sheet.Page, found: Regained) -> None:
    """Plot the densities of the particles' courses and speeds at the times shown."""
    fastest = found.held.study.methods[0].behaviour.fastest / KNOT
    panels = (
        ("Course [deg]", np.linspace(0, 360, 361), WINDOWS[0], 360.0, np.arange(0, 361, 90)),
        ("Speed [kn]", np.linspace(0, 1.05 * fastest, 300), WINDOWS[1], None, None),
    )
    for number, (title, at, width, period, ticks) in enumerate(panels):
        axes: Axes = on.figure.add_axes(
            (KEY + 0.01, MAP[1] + 0.02 + 0.165 * (1 - number), 0.245, 0.11)
        )
        for one, colour in zip(found.held.shown, _colours(found), strict=True):
            if (cloud := one.cloud) is not None:
                course = np.degrees(paths.course(cloud.place, cloud.velocity))
                speed = np.linalg.norm(cloud.velocity, axis=1) * sphere.RADIUS / KNOT
                values = speed if period is None else course
                axes.plot(
                    at,
                    density.along(values, cloud.weight, width, at, period),
                    color=colour,
                    linewidth=1.4,
                )
        axes.set_title(
            f"{title}: density at those times", fontsize=8.5, color=INK, loc="left", pad=3
        )
        axes.set_xlim(at[0], at[-1])
        axes.set_ylim(bottom=0)
        if ticks is not None:
            axes.set_xticks(ticks)
        axes.set_yticks([])
        axes.tick_params(labelsize=7.5, colors=INK)
        for side in ("top", "right", "left"):
            axes.spines[side].set_visible(False)


def _estimate(axes: Axes, frame: Frame, found: Regained) -> list[tuple[Any, str]]:
    """Draw the estimates that are inside their areas; a single one is a dot."""
    held = found.held
    inside = np.isfinite(held.within)
    x, y = (np.where(inside, v, np.nan) for v in _project(frame, held.place))
    (line,) = axes.plot(x, y, color=RED, linewidth=1.6, zorder=8)
    alone = inside & ~np.append(inside[1:], False) & ~np.append(False, inside[:-1])
    axes.plot(x[alone], y[alone], ".", color=RED, markersize=4, zorder=8)
    shown = [k for one in held.shown if inside[k := held.row(one.time)]]
    (spot,) = axes.plot(x[shown], y[shown], "o", color=RED, markersize=5, zorder=9)
    symbols: list[tuple[Any, str]] = [
        ((line, spot), "estimated track, and where it is at those times")
    ]
    if (held.count > 0)[~inside].any():
        symbols.append(
            (
                axes.plot([], [], linestyle="none")[0],
                "left out where the mean is outside its areas",
            )
        )
    return symbols


def _after_last_detection(found: Regained) -> Array:
    """Return which rows are at or after the last detection of a track, bool (n,)."""
    held = found.held
    known = np.flatnonzero(held.detected & np.isfinite(held.carried[:, 0]))
    return np.arange(len(held.time)) >= (known[-1] if known.size else len(held.time))


def _carried(axes: Axes, frame: Frame, found: Regained) -> list[tuple[Any, str]]:
    """Draw where the last detection is if it went on at the mean velocity that it had."""
    rows = _after_last_detection(found)
    if rows.sum() < 2:
        return []
    x, y = _project(frame, found.held.carried[rows])
    (line,) = axes.plot(x, y, color=CARRIED, linewidth=1.4, linestyle=(0, (4, 2)), zorder=8)
    return [(line, "last detection carried forward")]


def _times(on: sheet.Page, axes: Axes, frame: Frame, found: Regained) -> None:
    """Write the time of day next to the estimates shown."""
    held = found.held
    points: list[labels.Point] = []
    for one in held.shown:
        k = held.row(one.time)
        if np.isfinite(held.within[k]):
            x, y = _project(frame, held.place[k : k + 1])
            when = notation.day_time(text.moment(found, one.time))
            points.append((float(x[0]), float(y[0]), when, {"fontsize": 8, "color": RED}))
    labels.place_labels(axes, on.canvas, points, (), set(range(len(points))))


def _pursuit_path(
    axes: Axes, frame: Frame, found: Regained, chased: Chased
) -> list[tuple[Any, str]]:
    """Draw the path with its looks; filled circles mark where it was replanned."""
    pursuit = found.held.study.pursuit
    assert pursuit is not None
    x, y = _project(frame, chased.found.path.place)
    looks = int(np.isin(chased.found.path.time, pursuit.times).sum())
    (line,) = axes.plot(x, y, color=PATH, linewidth=2.2, zorder=10)
    (spots,) = axes.plot(
        x[:looks], y[:looks], "o", color=PATH, markerfacecolor="white", markersize=5, zorder=11
    )
    replanned = list(chased.found.plans)
    (plans,) = axes.plot(x[replanned], y[replanned], "o", color=PATH, markersize=5.5, zorder=12)
    description = (
        f"path to {pursuit.aim} it, looks every "
        f"{notation.number(pursuit.interval / 60)} min\nto {notation.number(pursuit.reach / NMI)} nmi"
    )
    symbols: list[tuple[Any, str]] = [
        ((line, spots), description),
        (plans, "planned, or replanned"),
    ]
    if pursuit.to is not None:
        (goal,) = axes.plot(
            *frame.project(*np.degrees(np.array(pursuit.to))[:, None]),
            "*",
            color=PATH,
            markersize=13,
            zorder=13,
        )
        symbols.append((goal, "its destination"))
    return symbols
