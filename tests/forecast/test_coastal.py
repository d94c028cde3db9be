"""Areas on the coast: which cells they are, how they are joined, what is said of them, and that
they are seen on a picture.
"""

from types import SimpleNamespace

import numpy as np
import pytest
import shapely
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from pyproj import Geod

from drift.forecast import coastal
from drift.forecast.build import Contour
from drift.forecast.products import layers, report
from drift.products.maps import chart
from geo import sphere

SHARES = (0.5, 0.75, 0.95)
# 1: half ashore, of the 50 % area; 2: of the 75 % area; 3: of the 95 % area; 4: beyond; 5: of the
# 50 % area, but mostly adrift.
CELLS = np.array([
    [0, 0, 0, 0, 0, 0, 0, 3],
    [1, 1, 1, 2, 2, 0, 0, 0],
    [0, 5, 5, 0, 0, 3, 4, 0],
])  # fmt: skip
STEP = (0.02, 0.01)  # [deg] of longitude and latitude


def at(lon=10.0, lat=40.0, cells=CELLS):
    held = np.select(
        [np.isin(cells, (1, 5)), cells == 2, cells == 3, cells == 4], [0.5, 0.75, 0.95, 0.97], 1.0
    )
    mass = (cells > 0) / np.maximum(cells, 1.0) / 20
    rows, columns = (np.arange(size) for size in cells.shape)
    return xr.Dataset(
        {
            "containment": (("lat", "lon"), held),
            "probability": (("lat", "lon"), mass),
            "probability_ashore": (("lat", "lon"), np.where(cells == 5, 0.4, 0.6) * mass),
            "cell_area": (("lat", "lon"), np.ones(cells.shape)),
        },
        {"lon": lon + STEP[0] * columns, "lat": lat + STEP[1] * rows, "time": np.datetime64("2026-11-21T18:00:00", "ns")},
    )  # fmt: skip


def test_each_cell_of_the_coast_is_told_of_its_smallest_area():
    found = coastal.coast_lines_by_share(at(), SHARES)
    assert list(found) == [0.5, 0.75, 0.95]
    # Three cells in a row, and two that go on from them; what is mostly adrift is sea, and what is
    # beyond is not told.
    assert shapely.equals(
        found[0.5], shapely.LineString([(10.0, 40.01), (10.04, 40.01)]).normalize()
    )
    assert found[0.75].bounds == pytest.approx((10.04, 40.01, 10.08, 40.01))
    # One goes on aslant round a corner; the other stands alone, and is half a cell wide.
    lengths = sorted(part.length for part in found[0.95].geoms)
    assert lengths == pytest.approx([STEP[0] / 2, np.hypot(*STEP)])
    assert list(coastal.coast_lines_by_share(at(), (0.5, 0.95))) == [0.5, 0.95]
    assert coastal.coast_lines_by_share(at(), (0.4,)) == {}


def test_a_patch_of_cells_is_joined_without_slanting_lines():
    """Every pair of neighbours by a side is joined once: 3 x 4 cells have 3 x 3 and 2 x 4 such
    pairs.
    """
    lines = coastal.coast_lines_by_share(at(cells=np.ones((3, 4), int)), SHARES)[0.5]
    assert lines.length == pytest.approx(9 * STEP[0] + 8 * STEP[1])


def test_where_half_of_what_is_ashore_lies_is_said_with_its_extent():
    """Of five cells the densest that hold half are two, their ends told and their distance by
    pyproj; then others, farther apart.
    """
    data = at(cells=np.where(CELLS == 0, 0, 1))
    weight = np.zeros(CELLS.shape)
    weight[1, :5] = [3, 2.5, 1, 1, 2]
    data["probability_ashore"].values[:] = weight / 20
    data = data.assign_coords(lon=10 + 0.1 * np.arange(8))
    wide = Geod(ellps="sphere").inv(10.0, 40.01, 10.1, 40.01)[2] / 1852
    assert (
        coastal.coast_in_words(data)
        == f"half of it within {wide:.0f} nmi, from 40-00.6N 010-00.0E to 40-00.6N 010-06.0E"
    )
    data["probability_ashore"].values[1, 4] = 4 / 20
    wide = Geod(ellps="sphere").inv(10.0, 40.01, 10.4, 40.01)[2] / 1852
    assert (
        coastal.coast_in_words(data)
        == f"half of it within {wide:.0f} nmi, from 40-00.6N 010-00.0E to 40-00.6N 010-24.0E"
    )
    assert (
        coastal.coast_in_words(at(cells=np.where(np.arange(24).reshape(3, 8) == 9, 1, 0)))
        == "half of it at 40-00.6N 010-01.2E"
    )
    assert coastal.coast_in_words(at(cells=np.zeros((3, 8), int))) == ""


@pytest.mark.parametrize("lon", [10.0, 179.95])
def test_areas_on_the_coast_are_seen_over_the_land(lon):
    """Over land to its very cells, each area shows its own lightness as wide as it is told to be;
    half a pixel of each edge is blended.
    """
    data = at(lon).expand_dims("time")
    polygon = shapely.MultiPolygon([shapely.box(lon, 40.0, lon + 0.14, 40.02)])
    contours = [Contour(data["time"].values[0], share, 1.0, polygon) for share in SHARES]
    made = SimpleNamespace(data=data, shares=SHARES, contours=contours)
    frame = chart.frame(lon + np.array([-0.05, 0.2]), np.array([39.95, 40.07]), aspect=1.5)
    figure = Figure((9, 6), dpi=140)  # [dots an inch] as map.png
    canvas = FigureCanvasAgg(figure)
    ax = figure.add_axes((0, 0, 1, 1))
    chart.prepare(ax, frame)
    chart.draw_land(ax, chart.land_path(frame, [shapely.box(lon - 1, 39, lon + 1, 41)], 900))
    layers.outline(ax, frame, made, contours, few=False)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3] / 255
    for share, lines in coastal.coast_lines_by_share(data.isel(time=0), SHARES).items():
        colour = np.array(to_rgb(chart.LAND))
        for stroke in layers.band(share, made)["path_effects"]:
            alpha = stroke._gc["alpha"]
            colour = (1 - alpha) * colour + alpha * np.array(to_rgb(stroke._gc["foreground"]))
        places = shapely.get_coordinates(
            shapely.line_interpolate_point(shapely.get_parts(lines), 0.5, normalized=True)
        )
        shown = (
            ax.transData.transform(np.column_stack(frame.project(*places.T))).round().astype(int)
        )
        for x, y in shown:
            up = pixels[len(pixels) - 1 - y - 12 : len(pixels) - y + 12, x]
            assert (np.abs(up - colour).max(axis=1) < 0.02).sum() >= layers.BAND / 72 * 140 - 2


def test_the_shoreline_is_seen_through_the_coast_of_the_outermost_area():
    """Two strokes over land and over the shoreline keep more than a third of their difference."""
    land, shore = np.array(to_rgb(chart.LAND)), np.array(to_rgb(chart.SHORE))
    made = SimpleNamespace(shares=SHARES)
    kept = [
        np.prod([1 - stroke._gc["alpha"] for stroke in layers.band(share, made)["path_effects"]])
        for share in sorted(SHARES)
    ]
    assert kept[0] == 0
    assert np.all(np.diff(kept) > 0)
    assert kept[-1] > 1 / 3
    assert np.abs(kept[-1] * (land - shore)).max() > 1 / 8


def test_the_report_tells_each_area_of_the_coast_at_its_times():
    data = xr.concat(
        [
            at(179.95).assign_coords(time=np.datetime64(day, "ns"))
            for day in ("2026-11-21", "2026-11-22")
        ],
        "time",
    )
    outputs = [data.isel(time=k) for k in range(2)]
    (leaf,) = report._on_coast(SimpleNamespace(data=data, shares=SHARES), outputs)
    told = [(one["properties"]["time"], one["properties"]["level"]) for one in leaf["features"]]
    assert told == [
        (f"2026-11-{day}T00:00:00Z", share)
        for day in (21, 22)
        for share in sorted(SHARES, reverse=True)
    ]
    lon = [
        x for one in leaf["features"] for line in one["geometry"]["coordinates"] for x, _ in line
    ]
    assert min(lon) < -179.9
    assert max(lon) > 179.9
    assert max(map(abs, lon)) <= 180


def test_the_length_of_coast_is_that_of_its_cells_and_a_slanting_one_is_no_longer():
    east = np.zeros((7, 20), int)
    east[3, 2:18] = 1  # 15 steps of 0.02 deg along 40.03 N
    geod = Geod(a=sphere.RADIUS, b=sphere.RADIUS)
    expected = geod.inv(10.04, 40.03, 10.34, 40.03)[2]
    assert coastal.coast_length(at(cells=east), 0.5) == pytest.approx(expected, rel=1e-3)
    assert coastal.coast_length(at(cells=np.zeros((3, 3), int)), 0.5) == 0
    east[3, 8:11] = 0  # 5 and 6 steps: the water between them is no coast
    parts = sum(geod.inv(x, 40.03, y, 40.03)[2] for x, y in ((10.04, 10.14), (10.22, 10.34)))
    assert coastal.coast_length(at(cells=east), 0.5) == pytest.approx(parts, rel=1e-3)
    slanting = np.zeros((20, 20), int)
    for k in range(18):  # a staircase from corner to corner
        slanting[k, k : k + 2] = 1
    expected = geod.inv(10.0, 40.0, 10.36, 40.17)[2]
    assert coastal.coast_length(at(cells=slanting), 0.5) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(("cell", "told"), [(1, True), (5, False)])
def test_where_most_of_an_area_is_ashore_it_is_of_the_coast(cell, told):
    cells = np.zeros((3, 4), int)
    cells[1, 1:3] = cell  # 60 or 40 % of it ashore
    assert coastal.mostly_on_coast(at(cells=cells), 0.5) == told


def test_the_shading_is_pale_at_times_when_more_is_ashore_than_adrift():
    share = [[0.8, 0.2], [0.4, 0.6], [0.1, 0.3]]
    data = xr.Dataset(
        {"status_probability": (("time", "status"), share)}, {"status": ["adrift", "ashore"]}
    )
    assert report._mostly_ashore(data) == [False, True, True]
