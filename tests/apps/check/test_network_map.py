"""The picture of a lane network: its corridors cover what particles may sail and no more, anywhere;
and it is drawn whole.
"""

from pathlib import Path

import globe
import numpy as np
import pytest
import shapely
from matplotlib.patches import PathPatch
from PIL import Image

from drift.apps.check import map as network_map
from drift.case.scenario.network import Chart
from drift.engine.environment import layers
from drift.engine.motion.steering import lanes
from drift.engine.motion.steering.lanes import Network
from drift.products.maps import chart, page
from drift.products.maps.imprint import Imprint, Setting
from geo import polyline
from geo.box import Box

NMI = 1852.0


def bent(lon: float, lat: float) -> Network:
    """Return two lanes with a turn of 70 degrees at a place [deg], one of them one-way."""
    b = globe.point(*np.radians([lon, lat]))
    a = globe.walk(b, -globe.heading(b, np.radians(103.0)), np.asarray(150 * NMI))
    c = globe.walk(b, globe.heading(b, np.radians(33.0)), np.asarray(110 * NMI))
    nodes = globe.lonlat(np.array([a, b, c]))
    return Network(
        ("A", "B", "C"),
        *nodes,
        np.array([0, 1]),
        np.array([1, 2]),
        np.array([14, 14]) * NMI,
        np.array([True, False]),
    )


@pytest.mark.parametrize(("lon", "lat"), [(17.0, 36.0), (179.7, -17.0), (-20.0, 81.0)])
def test_corridors_are_drawn_where_particles_may_be(lon: float, lat: float) -> None:
    """Points on sides just inside the corridor lie in the drawn shape; those just outside do not,
    but at the corner.

    There the shape holds more: what a route sweeps that begins or ends at the corner.
    """
    found = bent(lon, lat)
    places = np.concatenate(layers.middles(found))
    frame = chart.frame(polyline.unwrap(places[:, 0]), places[:, 1], 1.3)
    figure, _ = page.figure(5.0, 4.0)
    ax = figure.add_axes((0, 0, 1, 1))
    chart.prepare(ax, frame)
    overlay = layers.overlay(found, {})
    overlay.draw(ax, frame)
    assert [len(line) > 5 for line in overlay.places["the lanes"]] == [True, True]
    assert [text for _, text in overlay.key] == [
        "Lane; an arrow if it is one-way",
        "Its corridor",
    ]
    (wash,) = (patch for patch in ax.patches if isinstance(patch, PathPatch))
    route = lanes.route(found, ["A", "B", "C"])
    p = globe.point(route.lon, route.lat)
    share = np.linspace(0.03, 0.9, 60), np.linspace(0.1, 0.97, 60)
    for side, inside in ((-0.98, True), (0.0, True), (0.98, True), (-1.03, False), (1.03, False)):
        way = globe.walk(p, globe.heading(p, route.toward), side * route.half)
        x = np.concatenate([globe.part(way[j], way[j + 1], share[j]) for j in (0, 1)])
        drawn = wash.get_path().contains_points(
            np.column_stack(frame.project(*np.degrees(globe.lonlat(x))))
        )
        assert (drawn == inside).all()


def test_the_picture(tmp_path: Path) -> None:
    """Each thing that it shows has its colour, and a view of a part is another picture."""
    found = Chart(bent(179.7, -17.0), {"Box": ((180.1, -18.6), (181.4, -18.5), (181.2, -17.9))})
    setting = Setting(
        Imprint("Lanes", "GSHHG"), lambda box: [shapely.box(-179.0, -16.6, -178.4, -16.2)]
    )
    for name, view in (("whole", None), ("part", Box(178.0, -18.0, 181.0, -16.0))):
        network_map.plot_network(found, tmp_path / f"{name}.png", setting, view)
    assert (tmp_path / "whole.png").read_bytes() != (tmp_path / "part.png").read_bytes()
    with Image.open(tmp_path / "whole.png") as image:
        assert image.size == (13 * 140, 8 * 140)
        colours = {colour for _, colour in image.convert("RGB").getcolors(2**24)}
    for wanted in (layers.INK, layers.AREA["color"], chart.LAND):
        assert tuple(int(wanted[k : k + 2], 16) for k in (1, 3, 5)) in colours
