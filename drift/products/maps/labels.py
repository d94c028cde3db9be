"""Text on pictures: labels of points that do not overlap, and numbers and scales as text."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.transforms import Bbox

from geo.array import Array
from geo.notation import NMI

HALO = (patheffects.withStroke(linewidth=2.5, foreground="white"),)
LEADER = {"arrowstyle": "-", "color": "#1b2733", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 2}
# Offsets of a label from its point [typographic points], tried in this order.
SPOTS = [
    (radius * np.cos(np.radians(angle)), radius * np.sin(np.radians(angle)))
    for radius in (9, 18, 30, 45)
    for angle in (0, 180, 45, -45, 135, -135, 90, -90)
]
TINY = 5e-4  # share below which a percentage would be printed as 0.0 %
# Units of area [nmi2], from large to small.
UNITS = (
    *((10.0**k, f"{10**k:,} nmi²") for k in (8, 6, 4, 2)),
    (1.0, "nmi²"),
    *((10.0**k / NMI**2, f"{10**k:,} m²") for k in (4, 2)),
    (1 / NMI**2, "m²"),
)

Point = tuple[float, float, str, dict[str, Any]]  # x, y [m], text, style
STEPS = (1, 2, 3, 6, 12, 24, 48, 72, 120, 240, 480, 960)  # [h] allowed steps of a time axis


def place_labels(
    ax: Axes,
    canvas: FigureCanvasAgg,
    points: Sequence[Point],
    taken: Sequence[Bbox],
    must: set[int],
) -> None:
    """Write labels beside their points; leave out a label that would cover another label or point.

    Args:
        ax: axes of the chart.
        canvas: its canvas, which measures text.
        points: (x, y [m], text, style) of each label, most important first.
        taken: boxes that are in use [axes fraction].
        must: indices of labels that are always written, where they overlap least.
    """
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    frame_box = ax.get_window_extent(renderer)
    boxes = [box.transformed(ax.transAxes) for box in taken]
    for x, y, _, _ in points:
        px, py = ax.transData.transform((x, y))
        boxes.append(Bbox.from_bounds(px - 5, py - 5, 10, 10))
    for i in sorted(range(len(points)), key=lambda i: (i not in must, i)):
        options: list[tuple[int, int, Bbox]] = []
        for k in range(len(SPOTS)):
            label = _write(ax, points[i], k)
            box = label.get_window_extent(renderer).padded(2)
            label.remove()
            inside = (
                frame_box.x0 <= box.x0
                and box.x1 <= frame_box.x1
                and frame_box.y0 <= box.y0
                and box.y1 <= frame_box.y1
            )
            options.append(
                (sum(box.overlaps(other) for other in boxes) + (0 if inside else 100), k, box)
            )
            if options[-1][0] == 0:
                break
        clashes, k, box = min(options, key=lambda option: option[:2])
        if clashes == 0 or i in must:
            _write(ax, points[i], k)
            boxes.append(box)
            if k >= 8:  # the label is far away: a thin line leads to its point
                ax.annotate(
                    "",
                    points[i][:2],
                    SPOTS[k],
                    textcoords="offset points",
                    zorder=13,
                    arrowprops=LEADER,
                )


def _write(ax: Axes, point: Point, spot: int) -> Any:
    x, y, text, style = point
    dx, dy = SPOTS[spot]
    sides: dict[str, Any] = {
        "ha": "left" if dx > 1 else "right" if dx < -1 else "center",
        "va": "bottom" if dy > 1 else "top" if dy < -1 else "center",
    }
    return ax.annotate(
        text,
        (x, y),
        (dx, dy),
        textcoords="offset points",
        path_effects=HALO,
        zorder=16,
        **sides,
        **style,
    )


def number(value: float) -> str:
    """Return a positive number with three significant digits: 1,234 -> 1,230."""
    if not np.isfinite(value):
        return "none"
    if value <= 0:
        return "0"
    if value < 1e-3:
        return f"{value:.1e}"
    digits = 2 - int(np.floor(np.log10(value)))
    return f"{round(value, digits):,.{max(digits, 0)}f}"


def density_unit(top: float) -> tuple[float, str]:
    """Return a unit of area [nmi2], and its name, that suits a density [% per nmi2].

    The unit is nmi2 for densities from 0.01 to 100.
    """
    if 0.01 <= top < 100:
        return 1.0, "nmi²"
    return next(((area, name) for area, name in UNITS if top * area < 100), UNITS[-1])


def ticks(top: float) -> Array:
    """Return 0 and round numbers up to `top`, well apart on a square-root scale.

    Round numbers are 1, 2 or 5 times a power of ten.
    """
    power = int(np.floor(np.log10(top)))
    values = [np.inf]
    for candidate in (m * 10.0**e for e in range(power, power - 3, -1) for m in (5, 2, 1)):
        if (
            candidate <= top * (1 + 1e-9)
            and np.sqrt(min(values[-1], 4 * top) / top) - np.sqrt(candidate / top) >= 0.18
        ):
            values.append(candidate)
    return np.array([0.0, *(v for v in values[:0:-1] if np.sqrt(v / top) >= 0.14)])


def plain(value: float) -> str:
    """Return a round number without an exponent: 0.005, 2, 1,000."""
    return (
        f"{value:,.0f}"
        if value >= 1
        else str(np.format_float_positional(value, precision=12, trim="-"))
    )


def round_times(begin: float, end: float, many: int) -> Array:
    """Return at most `many` round times [s since 1970] between two times, the same every day."""
    hours = (end - begin) / 3600
    step = 3600 * next((step for step in STEPS if hours / step <= many), STEPS[-1])
    return np.arange(np.ceil(begin / step), np.floor(end / step) + 1) * step
