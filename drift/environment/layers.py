"""What a chart shows of a lane network: corridors as a wash of colour, the lanes' middles, and arrows on one-way lanes."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from drift.environment import corridors
from drift.maps.chart import Frame
from drift.maps.overlay import Overlay
from drift.motion.lanes import Network
from geo import polyline, sphere
from geo.array import Array

INK, WASH = "#1f4e8c", "#a9c4e6"  # of lanes and their corridors
AREA: dict[str, Any] = {"color": "#7a1f6b", "linewidth": 1.5, "linestyle": (0, (6, 2))}
FINE = 20_000.0  # [m] between points of great circles as drawn
Ring = Sequence[tuple[float, float]]  # corners (lon, lat) [deg]


def overlay(network: Network, areas: Mapping[str, Ring]) -> Overlay:
    """Return a network and areas to patrol as a layer of a chart."""

    def draw(ax: Axes, frame: Frame) -> None:
        lanes(ax, frame, network)
        patrols(ax, frame, areas.values())

    rings = {f'area "{name}"': [np.array(ring)] for name, ring in areas.items()}
    return Overlay(draw, {"the lanes": middles(network), **rings}, key(bool(areas)))


def lanes(ax: Axes, frame: Frame, network: Network) -> None:
    """Draw corridors with all their joints, the middles of lanes, and an arrow on the middle of each one-way lane."""
    quads = [corners for found in corridors.swept(network).values() for corners in found]
    shapes = []
    for corners in quads:
        closed = np.vstack([corners, corners[:1]])
        lon, lat = sphere.track(closed[:, 0], closed[:, 1], FINE)
        shapes.append(shapely.make_valid(shapely.Polygon(np.column_stack(frame.project(*np.degrees([lon, lat]))))))
    whole = shapely.union_all(shapes)
    rings = [np.array(ring.coords) for ring in shapely.get_rings(shapely.get_parts(whole))]
    codes = [[Outline.MOVETO, *[Outline.LINETO] * (len(ring) - 2), Outline.CLOSEPOLY] for ring in rings]
    wash = Outline(np.concatenate(rings), np.concatenate(codes))
    ax.add_patch(PathPatch(wash, facecolor=WASH, edgecolor="none", alpha=0.75, zorder=5.5))
    lines = [np.column_stack(frame.project(*line.T)) for line in middles(network)]
    ax.add_collection(LineCollection(lines, colors=INK, linewidths=0.7, zorder=6), autolim=False)
    for lane in np.flatnonzero(network.one_way):
        line = lines[lane]
        a, b = line[(len(line) - 1) // 2], line[(len(line) - 1) // 2 + 1]
        style = {"arrowstyle": "-|>", "color": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", a + 0.6 * (b - a), a + 0.4 * (b - a), zorder=6.2, arrowprops=style)
    ax.plot(
        *frame.project(*np.degrees([network.lon, network.lat])),
        marker="o", markersize=2.6, linestyle="none", color=INK, zorder=6.3, scalex=False, scaley=False,
    )  # fmt: skip


def patrols(ax: Axes, frame: Frame, rings: Iterable[Ring]) -> None:
    """Draw areas to patrol, whose edges are straight in longitude and latitude."""
    for ring in rings:
        closed = np.array([*ring, ring[0]])
        closed[:, 0] = polyline.unwrap(closed[:, 0])
        fine = shapely.get_coordinates(shapely.segmentize(shapely.LineString(closed), 0.5))
        ax.plot(*frame.project(*fine.T), zorder=6.5, scalex=False, scaley=False, **AREA)


def middles(network: Network) -> list[Array]:
    """Return the middle of each lane, points (lon, lat) [deg] without jumps, (n, 2)."""
    found = []
    for a, b in zip(network.start, network.end, strict=True):
        lon, lat = sphere.track(network.lon[[a, b]], network.lat[[a, b]], FINE)
        found.append(np.column_stack([polyline.unwrap(np.degrees(lon)), np.degrees(lat)]))
    return found


def key(areas: bool = True) -> list[tuple[Any, str]]:
    """Return symbols and texts of a legend."""
    rows: list[tuple[Any, str]] = [
        (Line2D([], [], color=INK, linewidth=0.7, marker="o", markersize=2.6), "Lane; an arrow where it is one-way"),
        (Patch(facecolor=WASH, alpha=0.75), "Its corridor, joints included"),
    ]
    return [*rows, (Line2D([], [], **AREA), "Area of patrol")] if areas else rows
