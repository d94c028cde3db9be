"""Chart of a lane network: its lanes and patrol areas, with the names of nodes and areas."""

from pathlib import Path

import numpy as np
import shapely

from drift.case.scenario.network import Chart
from drift.engine.environment import layers
from drift.products.maps import chart, labels, sheet
from drift.products.maps.chart import INK
from drift.products.maps.imprint import Setting
from drift.products.maps.labels import Point
from drift.products.maps.sheet import Row, Sheet
from geo.box import Box

SHEET = Sheet(
    13.0,
    8.0,
    140,
    left=0.04,
    title=sheet.heading(0.955, 15),
    lines=(Row(0.925, 10),),
    footer=sheet.small(0.012, 7.5),
)
MAP = (0.04, 0.075, 0.93, 0.83)  # left, bottom, width, height, of the page


def plot_network(found: Chart, path: Path, setting: Setting, view: Box | None = None) -> None:
    """Plot a network and its patrol areas on a chart.

    Args:
        found: the network and its areas.
        path: file of the picture.
        setting: gives the title and the land polygons.
        view: the part to draw; None: all of it.
    """
    page = sheet.begin_page(SHEET)
    network = found.network
    lon, lat = np.degrees(network.lon), np.degrees(network.lat)
    corners = np.concatenate(
        [*layers.middles(network), *(np.array(ring) for ring in found.areas.values())]
    )
    if view is not None:
        corners = np.array([[view.west, view.south], [view.east, view.north]])
    frame = chart.frame(
        corners[:, 0], corners[:, 1], MAP[2] * SHEET.width / (MAP[3] * SHEET.height), margin=0.03
    )
    ax = page.figure.add_axes(MAP)
    chart.prepare(ax, frame)
    chart.draw_land(ax, chart.land_path(frame, setting.polygons(frame.box()), 1600))
    chart.graticule(ax, frame, lines=8)
    layers.lanes(ax, frame, network)
    layers.patrols(ax, frame, found.areas.values())
    corner = chart.free_corner(frame, *frame.project(lon, lat))
    bar = chart.scale_bar(ax, frame, corner)
    x, y = frame.project(lon, lat)
    style = {"fontsize": 6.5, "color": INK}
    points: list[Point] = [
        (float(x[k]), float(y[k]), network.name[k], style)
        for k in np.flatnonzero(frame.holds(x, y))
    ]
    for name, ring in found.areas.items():
        middle = shapely.Polygon(ring).representative_point()
        at = frame.project(middle.x, middle.y)
        if frame.holds(*at):
            words = {"fontsize": 8.5, "weight": "bold", "color": layers.AREA["color"]}
            points.append((float(at[0]), float(at[1]), name, words))
    labels.place_labels(ax, page.canvas, points, [bar], set(range(len(network.name), len(points))))
    sheet.legend(
        page.figure,
        layers.key(bool(found.areas)),
        loc="lower right",
        ncols=3,
        fontsize=8.5,
        bbox_to_anchor=(0.97, 0.012),
    )
    count = (
        f"{len(network.name)} nodes, {network.start.size} lanes, {len(found.areas)} patrol areas"
    )
    sheet.write_head(page, setting.imprint, count)
    sheet.finish_page(page, path, setting.imprint)
