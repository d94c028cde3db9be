"""Map overlay of a plan of towed arrays: start areas, allowed areas and turning points."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from drift.evidence.filter.records import Sortie
from drift.planning.arrays import placement_text
from drift.planning.arrays.placement import Placed
from drift.products.maps.chart import INK, Frame
from drift.products.maps.overlay import Overlay
from geo import notation
from geo.array import Array
from geo.polyline import Area

BEGIN: dict[str, Any] = {"color": "#7a3e00", "linewidth": 0.9, "linestyle": (0, (4, 2))}
ALLOWED: dict[str, Any] = {"color": "#7a3e00", "linewidth": 0.7, "linestyle": (0, (1, 1.5))}
POINTS = {"begins": "o", "turns": "s", "ends": "X"}
# Offset of the labels [points]. Each kind has its own side, because a way's points may be near
# each other.
BESIDE = {"begins": (-4, 3, "right"), "turns": (-4, -8, "right"), "ends": (4, 2, "left")}
POINT: dict[str, Any] = {
    "color": INK,
    "markersize": 3.2,
    "linestyle": "none",
    "markeredgecolor": "white",
    "markeredgewidth": 0.5,
}
GROUND: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}


def plan(placed: Sequence[Placed], sorties: Sequence[Sortie]) -> Overlay:
    """Return the overlay of a plan, the same at all times.

    Args:
        placed: ships with their ways.
        sorties: the planned sortie of each ship.
    """
    tows = [one.sea.tow for one in placed]
    begins = [_ring(tow.begin) for tow in tows]
    allowed = [_ring(tow.allowed) for tow in tows if tow.allowed is not None]
    points = [
        vertex
        for one, sortie in zip(placed, sorties, strict=True)
        for vertex in placement_text.vertices(one, sortie)
    ]

    def draw(ax: Axes, frame: Frame) -> None:
        for rings, style in ((begins, BEGIN), (allowed, ALLOWED)):
            for ring in rings:
                ax.plot(*frame.project(ring[:, 0], ring[:, 1]), zorder=6, **style)
        for time, lon, lat, what in points:
            x, y = (float(v[0]) for v in frame.project(np.array([lon]), np.array([lat])))
            kind = what.split(",")[0]
            ax.plot([x], [y], marker=POINTS[kind], zorder=8, **POINT)
            ax.annotate(
                label(time, what),
                (x, y),
                BESIDE[kind][:2],
                textcoords="offset points",
                ha=BESIDE[kind][2],
                fontsize=5.5,
                color=INK,
                zorder=8,
                bbox=GROUND,
                annotation_clip=True,
            )

    key: list[tuple[Any, str]] = [(Line2D([], [], **BEGIN), "May begin in")]
    if allowed:
        key.append((Line2D([], [], **ALLOWED), "May go in"))
    kinds = dict.fromkeys(what.split(",")[0] for *_, what in points)
    key += [
        (Line2D([], [], marker=POINTS[kind], **POINT), f"{kind.capitalize()}, time and course")
        for kind in kinds
        if kind != "ends"
    ]
    key.append((Line2D([], [], marker=POINTS["ends"], **POINT), "Ends"))
    return Overlay(draw, {}, key)


def label(time: np.datetime64, what: str) -> str:
    """Return the text beside a point: day and time, then the course of the next leg."""
    course = what.partition("course ")[2]
    return f"{notation.format_dtg(time)[:6]}Z" + (f" {course}°" if course else "")


def _ring(area: Area) -> Array:
    """Return an area's closed edge [deg], shape (n, 2), with continuous longitudes."""
    corners = np.array(area.ring)
    corners = np.concatenate([corners, corners[:1]])
    corners[:, 0] = np.degrees(np.unwrap(np.radians(corners[:, 0])))
    return corners
