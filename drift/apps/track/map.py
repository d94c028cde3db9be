"""The picture of a contact that was lost: what was detected, its track, and its cloud with areas at
the times shown.
"""

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
KEY = 0.725  # left edge of the key
DOTS = 1500  # drawn of a cloud
LINES = {0.5: 1.8, 0.9: 0.8}  # widths of the areas' outlines, by share
RAY = 24  # points along a bearing
PATH = "#e65100"
WINDOWS = (7.2, 1.0)  # [deg, kn] of courses and speeds, as Borovies has them


def plot_track(
    found: Regained, path: Path, imprint: Imprint, land: Callable[[Box], Iterable[Any]]
) -> None:
    """Draw a track with its cloud at the times shown into a PNG; land: returns its polygons [deg]
    in a box.
    """
    on = sheet.begin(
        Sheet(
            WIDTH,
            HEIGHT,
            130,
            left=MAP[0],
            title=sheet.heading(1 - 0.4 / HEIGHT, 15, 95),
            lines=(Row(1 - 0.68 / HEIGHT, 10, 150),),
            footer=sheet.small(0.1 / HEIGHT, 7.5, 190),
        )
    )
    study = found.held.study
    sheet.head(
        on,
        imprint,
        f"{study.methods[0].name}: {study.size:,} particles, {len(found.held.sweeps):,} sweeps and times",
    )
    axes = on.figure.add_axes(MAP)
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
    if isinstance(found.chased, Chased):
        key += _chase(axes, frame, found, found.chased)
    elif found.chased is not None:
        key.append(
            (
                axes.plot([], [], linestyle="none")[0],
                textwrap.fill(f"no path: {found.chased.why}", 46),
            )
        )
    chart.scale_bar(axes, frame, chart.free_corner(frame, *_dots(frame, found)))
    _times(on, axes, frame, found)
    if any(one.cloud is not None for one in found.held.shown):
        _densities(on, found)
    sheet.legend(
        on.figure,
        key,
        loc="upper left",
        bbox_to_anchor=(KEY - 0.01, MAP[1] + MAP[3] + 0.01),
        fontsize=8.5,
        handlelength=2.2,
        labelspacing=0.7,
    )
    with page.literal():
        sheet.end(on, path, imprint)


def _places(found: Regained) -> tuple[Array, Array]:
    """Return all positions [deg] that the chart has to show; of clouds the areas, for few particles
    may be far beyond them.
    """
    held = found.held
    parts = [held.place[np.isfinite(held.within)], _own(found)[0], _plots(found)]
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


def _plots(found: Regained) -> Array:
    """Return where bearings and ranges put what was detected, unit vectors (n, 3)."""
    seen, study = found.held.study.target, found.held.study
    assert isinstance(seen, Detections)
    lon, lat = np.radians(paths.degrees(study.tracker.at(seen.time)[0]))
    to = sphere.destination(
        lon, lat, np.sin(seen.bearing) * seen.range, np.cos(seen.bearing) * seen.range
    )
    place = paths.vector(*to)
    return place[np.isfinite(place[:, 0])]


def _own(found: Regained) -> tuple[Array, Array]:
    """Return places and times [s] of the tracker while it is known; not where it was to go had it
    not gone the path.
    """
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


def _dots(frame: Frame, found: Regained) -> tuple[Array, Array]:
    return frame.project(*_places(found))


def _tracker(axes: Axes, frame: Frame, found: Regained) -> list[tuple[Any, str]]:
    place, _ = _own(found)
    (line,) = axes.plot(*_project(frame, place), color="#0b4f8a", linewidth=1.4, zorder=7)
    (end,) = axes.plot(*_project(frame, place[-1:]), "o", color="#0b4f8a", markersize=6, zorder=9)
    return [((line, end), "tracker, and where it was last known to be")]


def _detections(axes: Axes, frame: Frame, found: Regained) -> list[tuple[Any, str]]:
    """Draw a ray to each detection, as long as its range, or as far as the sensor reaches; of a
    range alone the circle.
    """
    seen, study = found.held.study.target, found.held.study
    assert isinstance(seen, Detections)
    symbols, spot = [], None
    styles = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (5, 2, 1.5, 2)))
    for number, sensor in enumerate(study.sensors):
        line = None
        for k in np.flatnonzero(seen.sensor == number):
            lon, lat = np.radians(paths.degrees(study.tracker.at([seen.time[k]])[0]))
            if np.isnan(seen.bearing[k]):
                bearing, far = np.linspace(0, 2 * np.pi, 10 * RAY), seen.range[k]
            else:
                whole = sensor.reach if np.isnan(seen.range[k]) else seen.range[k]
                bearing, far = seen.bearing[k], whole * np.linspace(0, 1, RAY)
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
            if not np.isnan(seen.range[k]) and not np.isnan(seen.bearing[k]):
                (spot,) = axes.plot(
                    x[-1:], y[-1:], "+", color=INK, markersize=7, zorder=9, linestyle="none"
                )
        if line is not None:
            symbols.append((line, f"detection by {sensor.name}"))
    return symbols if spot is None else [*symbols, (spot, "place by a bearing and a range")]


def _clouds(axes: Axes, frame: Frame, found: Regained) -> list[tuple[Any, str]]:
    """Draw the cloud at each time shown, later ones warmer, with the outlines of its areas."""
    symbols: list[tuple[Any, str]] = []
    colours = _colours(found)
    held = found.held
    for one, colour in zip(held.shown, colours, strict=True):
        when, cloud, regions = (
            notation.group(text.moment(found, one.time)),
            one.cloud,
            held.areas[held.row(one.time)],
        )
        if cloud is None:
            symbols.append((axes.plot([], [], linestyle="none")[0], f"{when}: no track is held"))
            continue
        # Dots are as many as the weight they stand for.
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
                seam = np.abs(lat) == 90  # a ring round a pole is closed along it
                axes.plot(
                    *(np.where(seam, np.nan, v) for v in frame.project(lon, lat)),
                    color=colour,
                    zorder=4,
                    linewidth=LINES[share],
                )
        (sign,) = axes.plot([], [], "o", color=colour, markersize=7)
        symbols.append((sign, f"{when}: area of\n{text.sizes(regions)}"))
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
    """Return a colour for each time shown."""
    return matplotlib.colormaps["viridis_r"](np.linspace(0.0, 1.0, len(found.held.shown)))


def _densities(on: sheet.Page, found: Regained) -> None:
    """Draw how dense courses and speeds of the particles are at the times shown."""
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
    """Draw the estimates that lie in their areas; one at a time of its own is a dot."""
    held = found.held
    good = np.isfinite(held.within)
    x, y = (np.where(good, v, np.nan) for v in _project(frame, held.place))
    (line,) = axes.plot(x, y, color=RED, linewidth=1.6, zorder=8)
    alone = good & ~np.append(good[1:], False) & ~np.append(False, good[:-1])
    axes.plot(x[alone], y[alone], ".", color=RED, markersize=4, zorder=8)
    shown = [k for one in held.shown if good[k := held.row(one.time)]]
    (spot,) = axes.plot(x[shown], y[shown], "o", color=RED, markersize=5, zorder=9)
    symbols: list[tuple[Any, str]] = [
        ((line, spot), "estimated track, and where it is at those times")
    ]
    if (held.count > 0)[~good].any():
        symbols.append(
            (
                axes.plot([], [], linestyle="none")[0],
                "left out where the mean lies outside its areas",
            )
        )
    return symbols


def _times(on: sheet.Page, axes: Axes, frame: Frame, found: Regained) -> None:
    """Write the time of day beside the estimates shown."""
    held = found.held
    points: list[labels.Point] = []
    for one in held.shown:
        k = held.row(one.time)
        if np.isfinite(held.within[k]):
            x, y = _project(frame, held.place[k : k + 1])
            when = notation.day_time(text.moment(found, one.time))
            points.append((float(x[0]), float(y[0]), when, {"fontsize": 8, "color": RED}))
    labels.place_labels(axes, on.canvas, points, (), set(range(len(points))))


def _chase(axes: Axes, frame: Frame, found: Regained, chased: Chased) -> list[tuple[Any, str]]:
    """Draw the path with its looks, filled where it was planned again."""
    chase = found.held.study.pursuit
    assert chase is not None
    x, y = _project(frame, chased.found.path.place)
    looks = int(np.isin(chased.found.path.time, chase.times).sum())
    (line,) = axes.plot(x, y, color=PATH, linewidth=2.2, zorder=10)
    (spots,) = axes.plot(
        x[:looks], y[:looks], "o", color=PATH, markerfacecolor="white", markersize=5, zorder=11
    )
    anew = list(chased.found.plans)
    (plans,) = axes.plot(x[anew], y[anew], "o", color=PATH, markersize=5.5, zorder=12)
    about = f"path to {chase.aim} it, looks every {notation.number(chase.interval / 60)} min\nto {notation.number(chase.reach / NMI)} nmi"
    symbols: list[tuple[Any, str]] = [((line, spots), about), (plans, "planned, or planned again")]
    if chase.to is not None:
        (goal,) = axes.plot(
            *frame.project(*np.degrees(np.array(chase.to))[:, None]),
            "*",
            color=PATH,
            markersize=13,
            zorder=13,
        )
        symbols.append((goal, "its destination"))
    return symbols
