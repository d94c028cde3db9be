"""Text on pictures: labels of points that do not overlap, and numbers and scales as text."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.transforms import Bbox

from drift.products.maps import spots
from geo.array import Array
from geo.notation import NMI

HALO = (patheffects.withStroke(linewidth=2.5, foreground="white"),)
LEADER: dict[str, Any] = {
    "arrowstyle": "-",
    "color": "#1b2733",
    "linewidth": 0.8,
    "shrinkA": 0,
    "shrinkB": 0,
    "path_effects": [patheffects.withStroke(linewidth=2.2, foreground="white")],
}
ACROSS = {-1: "right", 0: "center", 1: "left"}  # alignment of a label by its side of the offset
UP = {-1: "top", 0: "center", 1: "bottom"}
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
    outlines: Mapping[int, Array] | None = None,
) -> None:
    """Write labels beside their points; leave out a label that would cover another label or point.

    The label of an area touches this area and no other labelled one, or a thin line leads to it.

    Args:
        ax: axes of the chart.
        canvas: its canvas, which measures text.
        points: (x, y [m], text, style) of each label, most important first.
        taken: boxes that are in use [axes fraction].
        must: indices of labels that are always written, where they overlap least.
        outlines: outlines [m] of what labels name, by index of the label, each (n, 2) with n > 1;
            that of an area is closed.
    """
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    chart, scale = np.array(ax.get_window_extent(renderer).extents), canvas.figure.dpi / 72
    drawn = {i: ax.transData.transform(outline) for i, outline in (outlines or {}).items()}
    areas = {i: spots.area(outline) for i, outline in drawn.items()}
    at = [np.array(ax.transData.transform(point[:2])) for point in points]
    used = [np.array(box.transformed(ax.transAxes).extents) for box in taken]
    used += [np.concatenate([place - 5, place + 5]) for place in at]
    for i in sorted(range(len(points)), key=lambda i: (i not in must, i)):
        x, y, text, style = points[i]
        label = ax.annotate(
            text,
            (x, y),
            (0, 0),
            textcoords="offset points",
            path_effects=HALO,
            zorder=16,
            **style,
        )
        size = np.array(label.get_window_extent(renderer).padded(2).size)
        anchors = np.array([at[i], *(spots.along(drawn[i], chart) if i in drawn else ())])
        others = [area for k, area in areas.items() if k != i]
        spot = spots.best_spot(chart, anchors, size, np.array(used), scale, areas.get(i), others)
        if not spot.fits and i not in must:
            label.remove()
            continue
        across, up = spot.side
        label.xy = tuple(ax.transData.inverted().transform(spot.anchor))
        label.set(position=spot.offset / scale, ha=ACROSS[across], va=UP[up])
        used.append(spot.box)
        if spot.led:
            ax.annotate(
                "",
                label.xy,
                tuple(spot.offset / scale),
                textcoords="offset points",
                zorder=13,
                arrowprops=LEADER,
            )
            many = max(int(np.hypot(*spot.offset) / 6), 2)
            dots = spot.anchor + np.linspace(0, 1, many)[1:-1, None] * spot.offset
            used += [np.concatenate([dot - 2, dot + 2]) for dot in dots]


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
