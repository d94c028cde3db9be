"""Labels of points on a chart that keep clear of each other."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.transforms import Bbox

HALO = (patheffects.withStroke(linewidth=2.5, foreground="white"),)
LEADER = {"arrowstyle": "-", "color": "#1b2733", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 2}
SPOTS = [
    (radius * np.cos(np.radians(angle)), radius * np.sin(np.radians(angle)))
    for radius in (9, 18, 30, 45)
    for angle in (0, 180, 45, -45, 135, -135, 90, -90)
]  # [typographic points] tried in this order

Point = tuple[float, float, str, dict[str, Any]]  # x, y [m], text, style


def place(ax: Axes, canvas: FigureCanvasAgg, points: Sequence[Point], taken: Sequence[Bbox], must: set[int]) -> None:
    """Write labels beside their points, each where it covers no other label or point; else leave it out.

    taken: boxes [axes fraction] that are in use. must: labels that are written, wherever they disturb least.
    """
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    paper = ax.get_window_extent(renderer)
    boxes = [box.transformed(ax.transAxes) for box in taken]
    for x, y, _, _ in points:
        px, py = ax.transData.transform((x, y))
        boxes.append(Bbox.from_bounds(px - 5, py - 5, 10, 10))
    for i in sorted(range(len(points)), key=lambda i: (i not in must, i)):
        found: list[tuple[int, int, Bbox]] = []
        for k in range(len(SPOTS)):
            label = _write(ax, points[i], k)
            box = label.get_window_extent(renderer).padded(2)
            label.remove()
            inside = paper.x0 <= box.x0 and box.x1 <= paper.x1 and paper.y0 <= box.y0 and box.y1 <= paper.y1
            found.append((sum(box.overlaps(other) for other in boxes) + (0 if inside else 100), k, box))
            if found[-1][0] == 0:
                break
        clashes, k, box = min(found, key=lambda option: option[:2])
        if clashes == 0 or i in must:
            _write(ax, points[i], k)
            boxes.append(box)
            if k >= 8:  # it stands off: a hair line leads to its point
                ax.annotate("", points[i][:2], SPOTS[k], textcoords="offset points", zorder=13, arrowprops=LEADER)


def _write(ax: Axes, point: Point, spot: int) -> Any:
    x, y, text, style = point
    dx, dy = SPOTS[spot]
    sides: dict[str, Any] = {
        "ha": "left" if dx > 1 else "right" if dx < -1 else "center",
        "va": "bottom" if dy > 1 else "top" if dy < -1 else "center",
    }
    return ax.annotate(
        text, (x, y), (dx, dy), textcoords="offset points", path_effects=HALO, zorder=16, **sides, **style
    )
