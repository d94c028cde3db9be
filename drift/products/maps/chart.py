"""A chart to draw on: projection, extent, land, graticule and scale bar.

The projection is Mercator, centred on the chart, up to 75 degrees of latitude, else Lambert's
azimuthal equal-area projection; north is up in the centre of both. Near a pole the latter is
centred on the pole, and no north arrow is drawn. Neither has a seam at the antimeridian. Axes are
plain Matplotlib axes in projected metres.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cartopy.crs as ccrs
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.markers import TICKDOWN, TICKLEFT
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline
from matplotlib.transforms import Bbox, ScaledTranslation

from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.notation import NMI

SEA, LAND, SHORE, INK = "#f4f7f9", "#d8d4c8", "#6b675c", "#1b2733"
LETTER = 0.62  # [em] mean width of a letter of a position
TICK = 4.0  # length of a tick [typographic points]
GREY, RED = "#55606b", "#c62828"  # colours of secondary text and of warnings
POLAR = 88.0  # [deg] latitude above which a chart is centred on the pole
# [arc minutes] allowed steps of the graticule
STEPS = (
    0.001,
    0.002,
    0.005,
    0.01,
    0.02,
    0.05,
    0.1,
    0.2,
    0.5,
    1,
    2,
    5,
    10,
    15,
    30,
    60,
    120,
    180,
    300,
    600,
    900,
    1800,
)
GLOBE = ccrs.Globe(semimajor_axis=sphere.RADIUS, semiminor_axis=sphere.RADIUS, ellipse=None)
DEGREES = ccrs.Geodetic(globe=GLOBE)


@dataclass(frozen=True)
class Frame:
    """A projection, and the part of it that is drawn: x, y [m]; `centre` is its centre [deg]."""

    crs: Any
    centre: tuple[float, float]
    x: tuple[float, float]
    y: tuple[float, float]
    # centred on a pole: no direction on the paper is north
    about_pole: bool = False

    def project(self, lon: Any, lat: Any) -> tuple[Array, Array]:
        """Return (x, y) [m] of positions [deg], in the same shape; longitudes may be unwrapped."""
        lon, lat = np.broadcast_arrays(np.asarray(lon, float), np.asarray(lat, float))
        # cells may extend beyond a pole
        lon, lat = sphere.near_degrees(lon, self.centre[0]), np.clip(lat, -90.0, 90.0)
        xyz = self.crs.transform_points(DEGREES, lon.ravel(), lat.ravel())
        return xyz[:, 0].reshape(lon.shape), xyz[:, 1].reshape(lon.shape)

    @property
    def is_mercator(self) -> bool:
        """Whether each meridian has one x, and each parallel one y."""
        return isinstance(self.crs, ccrs.Mercator)

    def net(self, lon: Array, lat: Array) -> tuple[Array, Array]:
        """Return (x, y) [m] where meridians (n,) cross parallels (m,) [deg], each (m, n)."""
        if not self.is_mercator:
            return self.project(*np.meshgrid(lon, lat))
        x, y = np.meshgrid(self.project(lon, 0.0)[0], self.project(self.centre[0], lat)[1])
        return x, y

    def holds(self, x: Any, y: Any) -> Array:
        """Return which points [m] are in the frame, bool in the same shape."""
        return np.asarray((self.x[0] <= x) & (x <= self.x[1]) & (self.y[0] <= y) & (y <= self.y[1]))

    def bounds(self) -> tuple[float, float, float, float]:
        """Return (west, south, east, north) [deg] around the frame, unwrapped around its centre."""
        x, y = np.meshgrid(np.linspace(*self.x, 25), np.linspace(*self.y, 25))
        lonlat = DEGREES.transform_points(self.crs, x.ravel(), y.ravel())
        lonlat = lonlat[np.isfinite(lonlat).all(axis=1)]
        lon = sphere.near_degrees(lonlat[:, 0], self.centre[0])
        return (
            float(lon.min()),
            float(lonlat[:, 1].min()),
            float(lon.max()),
            float(lonlat[:, 1].max()),
        )

    def box(self) -> Box:
        """Return the box [deg] around the frame."""
        west, south, east, north = self.bounds()
        return (
            Box(-180.0, south, 180.0, north)
            if east - west >= 360
            else Box(west, south, east, north).grown(0.0, 0.0)
        )


def frame(
    lon: Array, lat: Array, aspect: float, margin: float = 0.08, least: float = 200.0
) -> Frame:
    """Return the frame that shows all positions.

    Args:
        lon, lat: positions [deg], longitudes unwrapped, shape (n,).
        aspect: width / height of the frame.
        margin: margin on each side, as a share of the size.
        least: smallest width and height [m].

    Returns:
        The frame, with a projection that suits its latitudes.
    """
    lon, lat = np.asarray(lon, float), np.asarray(lat, float)
    middle = (float(lon.min() + lon.max()) / 2, float(lat.min() + lat.max()) / 2)
    about_pole = bool(np.abs(lat).max() > POLAR)
    if np.abs(lat).max() <= 75 and np.ptp(lon) < 180:
        crs = ccrs.Mercator(central_longitude=middle[0], globe=GLOBE)
    elif about_pole:
        # the mean longitude of positions all round the pole means nothing
        pole = float(np.copysign(90.0, middle[1]))
        crs = ccrs.LambertAzimuthalEqualArea(
            central_longitude=middle[0], central_latitude=pole, globe=GLOBE
        )
    else:
        crs = ccrs.LambertAzimuthalEqualArea(
            central_longitude=middle[0], central_latitude=middle[1], globe=GLOBE
        )
    unbounded = Frame(crs, middle, (0.0, 1.0), (0.0, 1.0))
    x, y = unbounded.project(lon, lat)
    wide, high = (max(float(np.ptp(v)) * (1 + 2 * margin), least) for v in (x, y))
    wide, high = max(wide, high * aspect), max(high, wide / aspect)
    cx, cy = float(x.min() + x.max()) / 2, float(y.min() + y.max()) / 2
    return Frame(
        crs, middle, (cx - wide / 2, cx + wide / 2), (cy - high / 2, cy + high / 2), about_pole
    )


def prepare(ax: Axes, frame: Frame) -> None:
    """Set the limits, aspect and colours of axes for a frame."""
    ax.set_xlim(*frame.x)
    ax.set_ylim(*frame.y)
    ax.set_aspect("equal", adjustable="box")
    ax.set_facecolor(SEA)
    for spine in ax.spines.values():
        spine.set(color=INK, linewidth=1.0, zorder=20)


def title(ax: Axes, text: str, side: Literal["left", "right"], size: float, **style: Any) -> None:
    """Write a title above a chart, on its left or right side.

    Given `y`, Matplotlib does not measure the labels of all ticks to keep the title clear of them.
    """
    ax.set_title(text, fontsize=size, loc=side, y=1.0, color=INK, **style)


def land_path(frame: Frame, polygons: Iterable[Any], pixels: float) -> Outline | None:
    """Return land as one path in projected metres, clipped to the frame and simplified to a pixel.

    Args:
        frame: the frame of the chart.
        polygons: Shapely polygons [deg].
        pixels: width of the chart in pixels.

    Returns:
        The path; None if there is no land in the frame.
    """
    shapes = np.array(list(polygons), dtype=object)
    if not len(shapes):
        return None
    west, south, east, north = frame.bounds()
    pad = 0.02 * max(east - west, north - south)
    pixel = (frame.x[1] - frame.x[0]) / pixels
    tolerance = 0.5 * pixel / (sphere.RADIUS * np.pi / 180)  # [deg], half a pixel of latitude
    bounds = shapely.bounds(shapes)
    vertices, codes = [], []
    for turn in (-720, -360, 0, 360, 720):
        box = (west + turn - pad, south - pad, east + turn + pad, north + pad)
        meets = (
            (bounds[:, 0] < box[2])
            & (bounds[:, 2] > box[0])
            & (bounds[:, 1] < box[3])
            & (bounds[:, 3] > box[1])
        )
        cut = shapely.simplify(
            shapely.clip_by_rect(shapes[meets], *box), tolerance, preserve_topology=False
        )
        for part in shapely.get_parts(shapely.get_parts(cut)):
            if part.geom_type != "Polygon" or part.is_empty:
                continue
            for ring in (part.exterior, *part.interiors):
                xy = np.array(ring.coords)
                vertices.append(np.column_stack(frame.project(xy[:, 0] - turn, xy[:, 1])))
                codes.append([Outline.MOVETO, *[Outline.LINETO] * (len(xy) - 2), Outline.CLOSEPOLY])
    return Outline(np.concatenate(vertices), np.concatenate(codes)) if vertices else None


def draw_land(ax: Axes, path: Outline | None) -> None:
    """Fill land: above shading, areas and graticule, below routes and marks."""
    if path is not None:
        outline(ax, PathPatch(path, facecolor=LAND, edgecolor=SHORE, linewidth=0.6, zorder=5))


def outline(ax: Axes, patch: PathPatch) -> None:
    """Draw an outline of many points.

    Unlike `add_patch` this skips the data limits, which Matplotlib computes point by point in
    Python.
    """
    ax.add_artist(patch)


def graticule(
    ax: Axes,
    frame: Frame,
    lines: int = 5,
    size: float = 8.0,
    labels: tuple[bool, bool] = (True, True),
) -> None:
    """Draw meridians and parallels, labelled in degrees and minutes on the lower and left edges.

    Args:
        ax: axes of the chart.
        frame: its frame.
        lines: approximate number of lines in each direction.
        size: font size of the labels.
        labels: whether meridians and parallels are labelled.
    """
    west, south, east, north = frame.bounds()
    segments, ticks = [], []
    for low, high, is_lon in ((west, east, True), (south, north, False)):
        step = next((s for s in STEPS if (high - low) * 60 / s <= lines + 1.5), STEPS[-1])
        values = np.arange(np.ceil(low * 60 / step), np.floor(high * 60 / step) + 1) * step / 60
        low, high = (south, north) if is_lon else (west, east)
        beyond = 0.02 * (high - low)
        across = np.linspace(low - beyond, high + beyond, 100)
        across = across.clip(-90, 90) if is_lon else across
        labelled: list[tuple[float, str]] = []
        for value in values:
            x, y = frame.project(*((value, across) if is_lon else (across, value)))
            segments.append(np.column_stack([x, y]))
            edge = _crossing(x, y, frame.y[0]) if is_lon else _crossing(y, x, frame.x[0])
            if (
                edge is not None
                and (frame.x if is_lon else frame.y)[0]
                <= edge
                <= (frame.x if is_lon else frame.y)[1]
            ):
                labelled.append((edge, degrees_minutes(value, is_lon, step)))
        ticks.append(labelled)
    ax.add_collection(
        LineCollection(segments, colors=INK, linewidths=0.4, alpha=0.35, zorder=4), autolim=False
    )
    for is_lon, labelled, shown in zip((True, False), ticks, labels, strict=True):
        _draw_ticks(ax, is_lon, [at for at, _ in labelled])
        low, high = frame.x if is_lon else frame.y
        pixels = ax.bbox.width if is_lon else ax.bbox.height
        letter = LETTER * size / 72 * ax.figure.dpi / pixels * (high - low)
        spans: list[tuple[float, float]] = []
        last = len(labelled) - 1
        # from the middle: a label at an end gives way to its neighbour
        for k in sorted(range(len(labelled)), key=lambda k: k in (0, last)) if shown else ():
            at, text = labelled[k]
            half = letter * len(text) / 2
            end = -1 if at < low + half else int(at > high - half)
            middle = at - end * half
            if all(abs(middle - one) > half + other for one, other in spans):
                _label_tick(ax, is_lon, at, text, size, end)
                spans.append((middle, half))


def _draw_ticks(ax: Axes, is_lon: bool, places: Sequence[float]) -> None:
    """Draw ticks on the lower edge, or on the left one.

    Matplotlib's own axes make five objects a tick, and measure each time they are drawn.
    """
    (ax.xaxis if is_lon else ax.yaxis).set_visible(False)
    edge = [0.0] * len(places)
    ax.plot(
        *((places, edge) if is_lon else (edge, places)),
        transform=ax.get_xaxis_transform() if is_lon else ax.get_yaxis_transform(),
        linestyle="none",
        marker=TICKDOWN if is_lon else TICKLEFT,
        markersize=TICK,
        markeredgewidth=0.8,
        color=INK,
        clip_on=False,
        scalex=False,
        scaley=False,
    )


def _label_tick(ax: Axes, is_lon: bool, place: float, text: str, size: float, end: int) -> None:
    """Write the label of a tick: below it, or on its left and upright.

    end: -1 near the lower end of the axis, where the label begins at the tick, to keep clear of the
    corner and of a neighbouring chart; 1 near the upper, where it ends there; else 0.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    pad = -(TICK + 3.5) / 72  # [in]
    x, y = (0.0, pad) if is_lon else (pad, 0.0)
    away = ScaledTranslation(x, y, figure.dpi_scale_trans)
    axes = ax.get_xaxis_transform() if is_lon else ax.get_yaxis_transform()
    style: dict[str, Any] = {"fontsize": size, "color": INK, "transform": axes + away}
    if is_lon:
        ax.text(place, 0, text, ha=("center", "right", "left")[end], va="top", **style)
    else:
        side = ("center", "top", "bottom")[end]
        ax.text(0, place, text, ha="right", va=side, rotation=90, **style)


def _crossing(along: Array, across: Array, edge: float) -> float | None:
    """Return the coordinate at which a line crosses an edge; None if it does not.

    along, across: coordinates of its points along and across the edge, (n,).
    """
    order = np.argsort(across)
    if not across[order[0]] <= edge <= across[order[-1]]:
        return None
    return float(np.interp(edge, across[order], along[order]))


def degrees_minutes(value: float, is_lon: bool, step: float) -> str:
    """Return an angle like 087°30'W; the step [arc minutes] sets the decimals of the minutes."""
    if is_lon:
        value = sphere.wrap_degrees(value)
    decimals = max(0, int(np.ceil(-np.log10(step) - 1e-9)))
    unit = 10**decimals
    whole = round(abs(value) * 60 * unit)
    degrees, minutes = divmod(whole, 60 * unit)
    name = (
        ""
        if whole in (0, 180 * 60 * unit)
        else ("E" if value > 0 else "W")
        if is_lon
        else ("N" if value > 0 else "S")
    )
    width = 2 if decimals == 0 else 3 + decimals
    return f"{degrees:0{3 if is_lon else 2}d}°{minutes / unit:0{width}.{decimals}f}'{name}"


def scale_bar(ax: Axes, frame: Frame, corner: tuple[float, float], small: bool = False) -> Bbox:
    """Draw a scale bar in nautical miles, and a north arrow beside it.

    Args:
        ax: axes of the chart.
        frame: its frame.
        corner: lower left corner of the bar [axes fraction].
        small: whether the bar is smaller and has no arrow; near a pole there is none either.

    Returns:
        The box of the bar [axes fraction].
    """
    (x0, x1), (y0, y1) = frame.x, frame.y
    high, size = (0.105, 7) if small else (0.075, 8)
    at = (x0 + (x1 - x0) * (corner[0] + 0.12), y0 + (y1 - y0) * (corner[1] + 0.04))
    ends = DEGREES.transform_points(
        frame.crs, np.array([at[0], at[0] + 0.05 * (x1 - x0)]), np.array([at[1]] * 2)
    )
    true_scale = float(sphere.distance(*np.radians(ends[0, :2]), *np.radians(ends[1, :2]))) / (
        0.05 * (x1 - x0)
    )
    longest = 0.2 * (x1 - x0) * true_scale / NMI  # [nmi]
    length = next(
        m * 10.0**e for e in range(4, -6, -1) for m in (5, 2, 1) if m * 10.0**e <= longest
    )
    wide = length * NMI / true_scale / (x1 - x0)  # axes fraction
    left, base = corner[0] + 0.03, corner[1] + 0.018
    for i in range(4):
        ax.add_patch(
            Rectangle(
                (left + i * wide / 4, base),
                wide / 4,
                0.011,
                transform=ax.transAxes,
                facecolor=INK if i % 2 == 0 else "white",
                edgecolor=INK,
                linewidth=0.6,
                zorder=15,
            )
        )
    words = ax.text(
        left,
        base + 0.017,
        f"{length:g} nmi",
        transform=ax.transAxes,
        fontsize=size,
        color=INK,
        va="bottom",
        zorder=15,
    )
    right = max(left + wide, words.get_window_extent().transformed(ax.transAxes.inverted()).x1)
    with_arrow = not (small or frame.about_pole)
    box = Bbox.from_extents(*corner, right + (0.06 if with_arrow else 0.03), corner[1] + high)
    ax.add_patch(
        Rectangle(
            corner,
            box.width,
            box.height,
            transform=ax.transAxes,
            facecolor="white",
            edgecolor=INK,
            linewidth=0.6,
            zorder=14,
        )
    )
    if not with_arrow:
        return box
    arrow = right + 0.042
    ax.annotate(
        "N",
        (arrow, corner[1] + 0.068),
        (arrow, corner[1] + 0.008),
        xycoords="axes fraction",
        textcoords="axes fraction",
        ha="center",
        va="bottom",
        fontsize=8,
        color=INK,
        zorder=15,
        arrowprops={
            "arrowstyle": "-|>",
            "color": INK,
            "linewidth": 1.0,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )
    return box


def free_corner(frame: Frame, x: Array, y: Array) -> tuple[float, float]:
    """Return the corner [axes fraction] where a scale bar covers the fewest points x, y [m]."""
    fx, fy = (
        (x - frame.x[0]) / (frame.x[1] - frame.x[0]),
        (y - frame.y[0]) / (frame.y[1] - frame.y[0]),
    )
    corners = ((0.015, 0.015), (0.685, 0.015), (0.015, 0.91), (0.685, 0.91))
    crowd = [
        np.sum((fx > a - 0.02) & (fx < a + 0.32) & (fy > b - 0.02) & (fy < b + 0.1))
        for a, b in corners
    ]
    return corners[int(np.argmin(crowd))]


def edges(centres: Array) -> Array:
    """Return the edges of cells from their centres, shapes (n,) -> (n + 1,)."""
    if len(centres) == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    middle = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])
