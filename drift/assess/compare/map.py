"""The picture of a comparison: A, B and B - A side by side, on one extent.

The difference is readable without colour: solid lines surround where B has more, dashed lines where
B has less. Differences within two standard errors are not shaded.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm, TwoSlopeNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator

from drift.assess.compare import text
from drift.assess.compare.figures import SHIFT
from drift.assess.compare.record import Contrast
from drift.forecast import mapped
from drift.forecast.products import layers
from drift.products.maps import chart, page, sheet
from drift.products.maps.chart import INK, Frame
from drift.products.maps.imprint import Setting
from drift.products.maps.sheet import Badge, Page, Row, Sheet
from geo import notation, sphere
from geo.array import Array
from geo.notation import NMI

SHEET = Sheet(
    13.6,
    6.6,
    130,
    left=0.035,
    title=sheet.heading(0.945, 14),
    lines=(Row(0.9, 10.5), Row(0.865, 9)),
    caution=Badge(0.985, 0.945, side="right"),
    footer=sheet.small(0.015, 7),
)
WIDE, HIGH, LOW = 0.3, 0.575, 0.225  # of a panel, and its lower edge
LEFT = (0.035, 0.36, 0.685)
# the ends of PuOr, orange and violet: colour-blind readers can distinguish them too
MORE, LESS = "#7f3b08", "#2d004b"
COLOURS = "PuOr_r"
LEVELS = (0.25, 0.6)  # contour levels, as shares of the largest difference
SURE = 2.0  # standard errors from which a difference is shaded


def plot_comparison(found: Contrast, path: Path, setting: Setting) -> None:
    """Draw the maps of the last output of both cases."""
    on = sheet.begin_page(SHEET)
    at = found.data.isel(time=-1)
    density = {
        name: 100 * at[name].values.astype(np.float64) / (at["cell_area"].values / NMI**2)
        for name in ("probability_a", "probability_b", "difference", "difference_error")
    }
    frame = _frame(found, setting)
    land = chart.land_path(frame, setting.polygons(frame.box()), 500)
    top = max(layers.scale_top(result.forecast.data.isel(time=-1)) for result in (found.a, found.b))
    panels = [on.figure.add_axes((left, LOW, WIDE, HIGH)) for left in LEFT]
    for k, (ax, name, result) in enumerate(
        zip(panels, ("probability_a", "probability_b"), (found.a, found.b), strict=False)
    ):
        _panel(ax, frame, land, setting, first=k == 0)
        shown = np.where(_shaded_cells(at[name].values, density[name]), density[name], np.nan)
        mesh = layers.shade(ax, frame, result.forecast, shown, PowerNorm(0.5, 0, top))
        last = result.forecast.data["time"].values[-1]
        outlines = layers.areas_of(result.forecast, last, result.forecast.ends)
        layers.outline(ax, frame, result.forecast, outlines, few=False, width=0.7)
        ax.set_title(
            page.fit(f"{'AB'[k]}: {found.names[k]}", 52),
            fontsize=9.5,
            weight="bold",
            loc="left",
            color=INK,
        )
    _, unit = sheet.density_bar(on.figure, (0.1, 0.115, 0.45, 0.018), mesh)
    on.figure.text(
        0.1, 0.142, f"A and B: probability density [% per {unit}]", fontsize=8, color=INK
    )
    _difference(on, panels[2], frame, land, setting, found, density, top)
    when = notation.format_dtg(found.times[-1])
    east, north = (next(iter(found.at(found.times[-1], name))) for name in SHIFT)
    shift = (
        ""
        if east.difference != east.difference
        else (
            f"; mean of B relative to that of A: {east.difference / NMI:+.2f} ± {east.error / NMI:.2f} "
            f"nmi east, {north.difference / NMI:+.2f} ± {north.error / NMI:.2f} nmi north"
        )
    )
    areas = "; ".join(
        f"{row.name} area {text.difference_in_words(row)}"
        for row in found.at(found.times[-1], "area")
    )
    sheet.write_head(
        on,
        setting.imprint,
        f"Valid {when}{shift}",
        areas.replace("+-", "±").replace("nmi2", "nmi²"),
    )
    if set(found.given) != {"nothing"}:
        a, b = found.given
        words = f"A and B weighted by {a}" if a == b else f"A weighted by {a}, B by {b}"
        on.figure.text(0.965, 0.865, words, fontsize=9, color=INK, ha="right")
    sheet.finish_page(on, path, setting.imprint)


def _shaded_cells(probability: Array, density: Array) -> Array:
    """Return the cells to shade, bool (nlat, nlon): the densest, up to the shaded share."""
    order = np.argsort(-density, axis=None, kind="stable")
    inside = np.cumsum(probability.ravel()[order], dtype=np.float64)
    shown = np.zeros(density.size, bool)
    shown[order[: int(np.searchsorted(inside, mapped.SHOWN * inside[-1])) + 1]] = True
    return shown.reshape(density.shape) & (density > 0)


def _frame(found: Contrast, setting: Setting) -> Frame:
    """Return the frame that holds the shaded cells of both cases, and the marks."""
    aspect = WIDE * SHEET.width / (HIGH * SHEET.height)
    lon, lat = [], []
    for result in (found.a, found.b):
        last = result.forecast.data["time"].values[-1]
        own = layers.extent(result.forecast, [last], setting.marks, setting.lines, aspect)
        west, south, east, north = own.bounds()
        middle = found.data["lon"].values.mean()
        lon += [sphere.near_degrees(west, middle), sphere.near_degrees(east, middle)]
        lat += [south, north]
    return chart.frame(np.array(lon), np.array(lat), aspect, margin=0.0)


def _panel(ax: Axes, frame: Frame, land: Outline | None, setting: Setting, first: bool) -> None:
    """Draw what all three maps have in common."""
    chart.prepare(ax, frame)
    chart.draw_land(ax, land)
    chart.graticule(ax, frame, lines=3, size=7, labels=(True, first))
    for k, line in enumerate(setting.lines):
        layers.prior_line(ax, frame, line, k)
    for mark in setting.marks:
        layers.mark_point(ax, frame, mark, 6)
    if first:
        chart.scale_bar(ax, frame, (0.015, 0.015), small=True)


def _difference(
    on: Page,
    ax: Axes,
    frame: Frame,
    land: Outline | None,
    setting: Setting,
    found: Contrast,
    density: dict[str, Array],
    top: float,
) -> None:
    """Draw B - A with its contours and its colour scale.

    The scale ends where that of A and B does, because differences along a shore can be much larger.
    """
    _panel(ax, frame, land, setting, first=False)
    change, error = density["difference"], density["difference_error"]
    most = min(float(np.max(np.abs(change))), top)
    sure = np.abs(change) > SURE * error
    scale = TwoSlopeNorm(0.0, -max(most, 1e-12), max(most, 1e-12))
    lon, lat = chart.edges(found.data["lon"].values), chart.edges(found.data["lat"].values)
    x, y = frame.net(lon, lat)
    shown = np.ma.masked_where(~sure | (np.abs(change) < most / 100), change)
    mesh = ax.pcolormesh(x, y, shown, cmap=COLOURS, norm=scale, zorder=1, rasterized=True)
    rows: list[tuple[Any, str]] = []
    runs: tuple[tuple[int, str, Any, str], ...] = (
        (1, MORE, "-", "more"),
        (-1, LESS, (0, (4, 2)), "less"),
    )
    if most > 0:
        x, y = frame.net(found.data["lon"].values, found.data["lat"].values)
        for sign, colour, style, words in runs:
            firm = np.where(sure, np.maximum(sign * change, 0.0), 0.0)
            if firm.max() > LEVELS[0] * most:
                levels = [level * most for level in LEVELS if level * most < firm.max()]
                ax.contour(
                    x, y, firm, levels, colors=colour, linewidths=1.0, linestyles=[style], zorder=3
                )
            rows.append((Line2D([], [], color=colour, linestyle=style), f"B has {words}"))
    else:
        ax.text(
            0.5,
            0.5,
            "no difference",
            ha="center",
            transform=ax.transAxes,
            fontsize=10,
            color=INK,
            zorder=16,
        )
    rows.append((Patch(facecolor=chart.SEA, edgecolor=INK), f"under {SURE:g} standard errors"))
    ax.set_title("B - A", fontsize=9.5, weight="bold", loc="left", color=INK)
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (LEFT[2], 0.045)}
    sheet.legend(
        on.figure, rows, ncols=len(rows), fontsize=7.5, borderaxespad=0, borderpad=0, **place
    )
    bar = on.figure.add_axes((LEFT[2], 0.115, WIDE, 0.018))
    on.figure.colorbar(
        mesh, cax=bar, orientation="horizontal", extend="both" if most == top else "neither"
    )
    bar.xaxis.set_major_locator(MaxNLocator(5))
    bar.tick_params(labelsize=7)
    on.figure.text(LEFT[2], 0.142, "B - A: probability density [% per nmi²]", fontsize=8, color=INK)
