"""Map of a forcing field: speed as shading and direction as arrows."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from drift.products.maps import chart, page
from drift.products.maps.chart import INK, Frame
from geo.array import Array


def draw_field(
    path: Path,
    lon: Array,
    lat: Array,
    east: Array,
    north: Array,
    *,
    title: str,
    polygons: Iterable[Any] = (),
) -> None:
    """Plot a field's speed as shading and its direction as arrows into a PNG.

    Args:
        path: file of the picture.
        lon: longitudes [deg], ascending, shape (nlon,).
        lat: latitudes [deg], ascending, shape (nlat,).
        east: eastward component [m/s], shape (nlat, nlon); NaN stays blank.
        north: northward component [m/s], shape (nlat, nlon).
        title: title of the map.
        polygons: land, Shapely polygons [deg].
    """
    figure, canvas = page.figure(9.0, 7.2)
    ax = figure.add_axes((0.08, 0.07, 0.76, 0.84))
    frame = chart.frame(
        lon[[0, -1, 0, -1]], lat[[0, -1, -1, 0]], aspect=0.76 * 9.0 / (0.84 * 7.2), margin=0.02
    )
    chart.prepare(ax, frame)
    jump = max(1, max(len(lon), len(lat)) // 800)
    speed = np.hypot(east, north)[::jump, ::jump]
    speeds = speed[np.isfinite(speed)]
    top = float(np.quantile(speeds, 0.995)) if len(speeds) else 1.0
    mesh = ax.pcolormesh(
        *frame.net(chart.edges(lon[::jump]), chart.edges(lat[::jump])),
        np.ma.masked_invalid(speed),
        cmap=matplotlib.colormaps["viridis_r"],
        vmin=0,
        vmax=top or 1.0,
        zorder=1,
        rasterized=True,
    )
    chart.draw_land(ax, chart.land_path(frame, polygons, 900))
    chart.graticule(ax, frame)
    every = (max(1, len(lat) // 22), max(1, len(lon) // 28))
    some = np.s_[every[0] // 2 :: every[0], every[1] // 2 :: every[1]]
    finite = np.isfinite(np.hypot(east, north)[some])
    px, py = (v[some][finite] for v in np.meshgrid(lon, lat))
    u, v = rotate_to_projection(frame, px, py, east[some][finite], north[some][finite])
    ax.quiver(
        *frame.project(px, py),
        u,
        v,
        color=INK,
        scale=22 * max(top, 1e-9),
        width=0.002,
        zorder=4.5,
        pivot="mid",
    )
    bar = figure.add_axes((0.87, 0.15, 0.02, 0.6))
    figure.colorbar(mesh, cax=bar, extend="max", label="speed [m/s]")
    figure.text(0.08, 0.945, page.fit(title, 80), fontsize=12, weight="bold", color=INK)
    page.save(canvas, path, title, None, dpi=110)


def rotate_to_projection(
    frame: Frame, lon: Array, lat: Array, east: Array, north: Array
) -> tuple[Array, Array]:
    """Return vectors [m/s] rotated to the axes of the projection, with unchanged length.

    Args:
        frame: the frame with the projection.
        lon, lat: positions [deg], shape (n,).
        east, north: components [m/s], shape (n,).

    Returns:
        The components along x and y [m/s], each (n,).
    """
    step = 1e-4  # [deg]
    x, y = frame.project(lon, lat)
    along_x, along_y = frame.project(lon + step / np.cos(np.radians(lat)), lat)
    up_x, up_y = frame.project(lon, lat - step)
    u = east * (along_x - x) - north * (up_x - x)
    v = east * (along_y - y) - north * (up_y - y)
    length = np.hypot(u, v)
    scale = np.divide(np.hypot(east, north), length, out=np.zeros_like(length), where=length > 0)
    return u * scale, v * scale
