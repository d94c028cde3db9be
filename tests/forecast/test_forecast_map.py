"""Pictures: that they show what they must, without warnings, downloads or overlap.

How they look, a person judges.
"""

import struct
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from drift.engine.particles.snapshot import Snapshot
from drift.engine.particles.status import Status
from drift.forecast import build as forecast_build
from drift.forecast.products import layers
from drift.forecast.products import map as forecast_map
from drift.forecast.products import words as forecast_words
from drift.products.maps import chart, field, labels, page
from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Line, Mark
from geo import notation, sphere

# or whatever else a picture must not be believed of
WRONG = "NO ERROR of current and wind in this forecast"


def forecast(lon, lat, spread=6000.0, ashore=True, n=4000):
    rng = np.random.default_rng(5)
    east, north = rng.normal(0, spread, n), rng.normal(0, 1.7 * spread, n)
    snapshots = []
    for i in range(5):
        x, y = sphere.destination(
            np.radians(lon), np.radians(lat), east + 1.5 * i * spread, north + 0.7 * i * spread
        )
        status = np.where(
            (np.arange(n) % 7 == 0) & (i > 2) & ashore, Status.ASHORE, Status.ADRIFT
        ).astype(np.int32)
        time = np.datetime64("2026-11-21T18:30:00") + np.timedelta64(6 * i, "h")
        place = sphere.to_binary(np.degrees(x)), sphere.to_binary(np.degrees(y))
        snapshots.append(Snapshot(time, *place, np.full(n, 1 / n), status, np.zeros(n, np.int32)))
    return forecast_build.build_forecast(snapshots, scenarios=["only"])


def size(path):
    head = path.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", head[16:24])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("lon", "lat", "spread"),
    [
        pytest.param(-87.5, 28.7, 6000.0, marks=pytest.mark.thorough),
        (179.9, -17.5, 6000.0),
        (20.0, 84.0, 20_000.0),
        pytest.param(-140.0, 0.1, 400_000.0, marks=pytest.mark.thorough),
        (5.1, 60.3, 10.0),
    ],
)
def test_pictures_anywhere_and_at_any_size(tmp_path, lon, lat, spread):
    made = forecast(lon, lat, spread)
    step = np.degrees(spread / sphere.RADIUS)
    land = [
        shapely.box(lon + 4 * step, lat - 20 * step, lon + 400 * step, min(lat + 3 * step, 89)),
        shapely.box(lon - 360, lat, lon - 359, lat + 1),
    ]
    setting = Setting(
        Imprint("A test " * 30), polygons=lambda box: land, marks=[Mark(lon, lat, "LKP 21/1830Z")]
    )
    cautioned = replace(
        setting,
        imprint=Imprint("A test " * 30, footer="casp-drift", caution=WRONG),
        lines=[Line([lon, lon + step, lon + step], [lat, lat, lat + step], "Area", closed=True)],
    )
    forecast_map.draw_map(made, tmp_path / "map.png", cautioned)
    forecast_map.draw_snapshots(made, tmp_path / "snapshots.png", setting)
    assert size(tmp_path / "map.png") == (1638, 1162)
    assert min(size(tmp_path / "snapshots.png")) > 500


@pytest.mark.parametrize("many", [1, 5])
def test_small_maps_have_a_key_clear_of_their_other_texts(tmp_path, monkeypatch, many):
    figures = []
    monkeypatch.setattr(page, "save", lambda canvas, *rest, **more: figures.append(canvas.figure))
    made = forecast(-87.5, 28.7)
    made = replace(made, data=made.data.isel(time=slice(-many, None)))
    setting = Setting(Imprint("t", footer="casp-drift"), marks=[Mark(-87.5, 28.7)])
    forecast_map.draw_snapshots(made, tmp_path / "a.png", setting)
    (figure,) = figures
    (key,) = figure.legends
    rows = [text.get_text() for text in key.get_texts()]
    assert rows[:3] == ["50 % area", "95 % area", "Last known position"]
    assert "Ashore" in rows
    box = key.get_window_extent()
    assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
    ticks = [text for ax in figure.axes for text in ax.texts if text.get_text()]
    others = [text.get_window_extent() for text in (*figure.texts, *ticks)]
    assert not any(box.overlaps(other) for other in others)


def test_pictures_of_nothing(tmp_path):
    n = 10
    one = Snapshot(
        np.datetime64("2026-11-21T18:30:00"),
        sphere.to_binary(np.full(n, -87.0)),
        sphere.to_binary(np.full(n, 28.0)),
        np.full(n, 1 / n),
        np.full(n, Status.PENDING, np.int32),
        np.zeros(n, np.int32),
    )
    made = forecast_build.build_forecast([one], scenarios=["x"])
    setting = Setting(Imprint("pending"), marks=[Mark(-87.0, 28.0)])
    forecast_map.draw_map(made, tmp_path / "map.png", setting)
    forecast_map.draw_snapshots(made, tmp_path / "snapshots.png", setting)


def test_a_field_with_gaps(tmp_path):
    lon, lat = np.linspace(175.0, 184.0, 61), np.linspace(-20.0, -14.0, 37)
    x, y = np.meshgrid(lon, lat)
    east, north = np.cos(y) * 0.4, np.sin(x) * 0.3
    east[10:20, 5:9] = np.nan
    field.draw_field(
        tmp_path / "a.png",
        lon,
        lat,
        east,
        north,
        title="current",
        polygons=[shapely.box(178, -18, 179, -17)],
    )
    field.draw_field(
        tmp_path / "b.png", lon, lat, np.full_like(east, np.nan), north, title="nothing"
    )
    field.draw_field(tmp_path / "c.png", lon, lat, 0 * x, 0 * x, title="still")
    assert size(tmp_path / "a.png") == size(tmp_path / "b.png") == (990, 792)


def test_arrows_point_where_the_water_goes():
    """Angles stay in Mercator; in the azimuthal projection a meridian d degrees off turns by d
    sin(lat), the convergence.
    """
    lon, east, north = np.array([170.0, 178.0, 186.0]), np.full(3, 0.3), np.full(3, 0.4)
    here = chart.frame(np.array([170.0, 186.0]), np.array([30.0, 40.0]), 1.0)
    u, v = field.rotate_to_projection(here, lon, np.full(3, 33.0), east, north)
    np.testing.assert_allclose(u, 0.3, atol=1e-5)
    np.testing.assert_allclose(v, 0.4, atol=1e-5)
    here = chart.frame(np.array([170.0, 186.0]), np.array([80.0, 81.0]), 1.0)
    u, v = field.rotate_to_projection(here, lon, np.full(3, 80.5), east, north)
    turn = np.degrees(np.arctan2(v, u) - np.arctan2(4, 3))
    # west of the centre north leans to the right: clockwise; 0.1 degrees as the projection is not
    # quite conformal
    np.testing.assert_allclose(turn, np.array([-8, 0, 8]) * np.sin(np.radians(80.5)), atol=0.1)
    np.testing.assert_allclose(np.hypot(u, v), 0.5, rtol=1e-12)


@pytest.mark.parametrize("turn", [0.0, 360.0])  # a mark may be written as -179 or as 181
def test_the_frame_shows_area_track_and_marks_but_not_outliers(turn):
    made = forecast(179.9, -17.5)
    times = [made.data["time"].values[-1]]
    far = Mark(-179.0 + turn, -18.4, "LKP")
    here = layers.extent(made, times, [far], (), aspect=1.3)
    west, south, east, north = next(
        c for c in made.contours if c.time == times[0] and c.share == 0.95
    ).polygon.bounds
    x, y = here.project(
        [west, east, far.lon, *made.data["mean_lon"].values],
        [south, north, far.lat, *made.data["mean_lat"].values],
    )
    assert (x > here.x[0]).all()
    assert (x < here.x[1]).all()
    assert (y > here.y[0]).all()
    assert (y < here.y[1]).all()
    assert (here.x[1] - here.x[0]) / (here.y[1] - here.y[0]) == pytest.approx(1.3)
    assert west < here.centre[0] < 181.0  # between the area and the mark, not round the Earth
    plain = layers.extent(made, times, [], (), aspect=1.3)
    grid = made.data["lat"].values
    assert (plain.y[1] - plain.y[0]) < 1.2 * sphere.RADIUS * np.radians(
        grid[-1] - grid[0]
    ) / np.cos(np.radians(17.5))


def test_projection_is_centred_conformal_and_blind_to_turns():
    here = chart.frame(np.array([178.0, 184.0]), np.array([-19.0, -12.0]), 1.0)
    x, y = here.project([181.0, -179.0, 541.0], [-15.0, -15.0, -15.0])
    np.testing.assert_allclose(x, 0, atol=1e-3)
    dx = here.project(181.001, -15.0)[0] - x[0]
    dy = here.project(181.0, -15.0 + 0.001 * np.cos(np.radians(15.0)))[1] - y[0]
    assert dx == pytest.approx(dy, rel=1e-4)


@pytest.mark.parametrize(
    ("value", "is_lon", "step", "text"),
    [
        (-87.5, True, 30, "087°30'W"),
        (28.0, False, 15, "28°00'N"),
        (180.5, True, 30, "179°30'W"),
        (180.0, True, 60, "180°00'"),
        (0.0, False, 60, "00°00'"),
        (-0.0125, False, 0.05, "00°00.75'S"),
        (5.999999999, True, 1, "006°00'E"),
    ],
)
def test_graticule_labels(value, is_lon, step, text):
    assert chart.degrees_minutes(value, is_lon, step) == text


def test_labels_keep_apart():
    figure = Figure((6, 5))
    canvas = FigureCanvasAgg(figure)
    ax = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    rng = np.random.default_rng(1)
    points = [
        (float(x), float(y), f"22{i:02d}00Z", {"fontsize": 8})
        for i, (x, y) in enumerate(rng.random((60, 2)) ** 2)
    ]
    labels.place_labels(ax, canvas, points, [], must={0})
    written = [t for t in ax.texts if t.get_text()]
    boxes = [t.get_window_extent(canvas.get_renderer()) for t in written]
    assert 10 < len(boxes) < 60
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert any(t.get_text() == "220000Z" for t in written)


def leaders(ax):
    """Return the lines that lead to labels: start at the label and end, [px], (n, 2) each."""
    trans = ax.figure.dpi / 72
    lines = [text for text in ax.texts if not text.get_text()]
    ends = np.array([ax.transData.transform(line.xy) for line in lines]).reshape(-1, 2)
    return ends + trans * np.array([line.get_position() for line in lines]).reshape(-1, 2), ends


@pytest.mark.parametrize("many", [1, 4, 13, 40])
def test_a_label_of_an_area_touches_it_alone_or_a_line_leads_there(many):
    """Squares and tracks that overlap more, the more they are, as sorties about one place do."""
    figure = Figure((8, 6))
    canvas = FigureCanvasAgg(figure)
    ax = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    rng = np.random.default_rng(many)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    shapes = [
        rng.normal(0.5, 0.13, 2) + rng.uniform(0.03, 0.12) * square[: 2 if i % 5 == 4 else 5]
        for i in range(many)
    ]
    points = [(*shape[0], f"sortie {i}", {"fontsize": 8}) for i, shape in enumerate(shapes)]
    mark = (0.5, 0.5, "LKP", {"fontsize": 9})
    must = set(range(1, 5)) & set(range(1, many + 1))
    labels.place_labels(ax, canvas, [mark, *points], [], {0, *must}, dict(enumerate(shapes, 1)))
    written = {text.get_text(): text for text in ax.texts if text.get_text()}
    assert {"LKP", *(f"sortie {i - 1}" for i in must)} <= set(written)
    assert len(written) >= min(many, 12)
    boxes = {
        name: shapely.box(*text.get_window_extent(canvas.get_renderer()).extents)
        for name, text in written.items()
    }
    drawn = {
        f"sortie {i}": (shapely.Polygon if len(shape) > 2 else shapely.LineString)(
            ax.transData.transform(shape)
        )
        for i, shape in enumerate(shapes)
    }
    starts, ends = leaders(ax)
    for name in written.keys() & drawn.keys():
        touched = {other for other, area in drawn.items() if boxes[name].intersects(area)}
        touched |= {name} if boxes[name].distance(drawn[name]) < 3 else set()
        led = [
            boxes[name].distance(shapely.Point(start)) < 4
            and shapely.boundary(drawn[name]).union(drawn[name]).distance(shapely.Point(end)) < 2
            for start, end in zip(starts, ends, strict=True)
        ]
        assert touched == {name} or any(led), name
    within = shapely.box(*ax.get_window_extent().padded(1).extents)  # hinting: a pixel
    assert not [name for name, box in boxes.items() if not within.contains(box)]


def test_times_of_the_track_keep_apart_and_the_first_and_the_last_stay():
    """A track that turns in a small circle, as under a tide, among sorties."""
    made = forecast(-87.5, 28.7, spread=3000.0)
    angle = np.linspace(0, 2 * np.pi, made.data.sizes["time"])
    made.data["mean_lon"][:] = -87.5 + 0.01 * np.cos(angle)
    made.data["mean_lat"][:] = 28.7 + 0.01 * np.sin(angle)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    ring[-1] = ring[0]
    names = [((-87.5, 28.7) + 0.03 * k * ring, f"sortie {k}") for k in range(1, 5)]
    figure = Figure((11, 8))
    canvas = FigureCanvasAgg(figure)
    ax = figure.add_axes((0.055, 0.095, 0.665, 0.775))
    here = layers.extent(made, made.data["time"].values[-1:], (), (), aspect=1.18)
    chart.prepare(ax, here)
    layers.track(ax, canvas, here, made, -1, (), names)
    written = {text.get_text(): text for text in ax.texts if text.get_text()}
    times = [notation.day_time(time) for time in made.data["time"].values]
    assert {times[0], times[-1], *(name for _, name in names)} <= set(written)
    assert len(set(times) & set(written)) < len(times)
    boxes = [
        written[name].get_window_extent(canvas.get_renderer()) for name in written if name != "N"
    ]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_land_is_thinned_to_the_pixel_and_keeps_holes():
    angle = np.linspace(0, 2 * np.pi, 200_001)
    lake = [(179.95, -17.05), (180.05, -17.05), (180.05, -16.95), (179.95, -16.95)]
    ring = np.column_stack(
        [180 + (0.6 + 1e-4 * np.sin(5000 * angle)) * np.cos(angle), -17 + 0.6 * np.sin(angle)]
    )
    here = chart.frame(np.array([179.0, 181.0]), np.array([-18.0, -16.0]), 1.0)
    path = chart.land_path(here, [shapely.Polygon(ring, [lake])], 1000)
    assert len(path.vertices) < 3000
    assert path.contains_point([float(v) for v in here.project(180.3, -17.0)])
    assert np.sum(path.codes == path.MOVETO) == 2
    turned = chart.land_path(
        here, [shapely.Polygon(ring - [360, 0], [np.array(lake) - [360, 0]])], 1000
    )
    np.testing.assert_allclose(turned.vertices[:, 1].max(), path.vertices[:, 1].max(), atol=500)
    assert chart.land_path(here, [], 1000) is None


def test_small_islands_and_holes_are_not_drawn_unless_they_are_many():
    def square(x, side):
        return shapely.box(x, 0, x + side, side)

    big = square(0, 10).difference(shapely.box(4, 4, 8, 8)).difference(shapely.box(1, 1, 2, 2))
    whole = shapely.MultiPolygon([big, square(20, 1), square(30, 2)])
    lengths = sorted(float(np.ptp(ring[:, 0])) for ring in layers.rings_to_draw(whole))
    assert lengths == [2, 4, 10]  # 1 x 1 is less than 2 % of 88, as island and as hole
    many = shapely.MultiPolygon([square(2 * i, 1) for i in range(100)])
    assert len(layers.rings_to_draw(many)) >= 90
    assert layers.rings_to_draw(shapely.MultiPolygon()) == []


def test_the_track_is_whole_once_all_is_released():
    made = forecast(-87.5, 28.7)
    account = made.data["status_probability"].values
    account[:] = 0
    account[:, Status.PENDING] = [1, 0.8, 0.112, 0.105, 0.1]  # a tenth is never released
    account[:, Status.ADRIFT] = 1 - account[:, Status.PENDING]
    assert layers.first_complete_output(made) == 3


@pytest.mark.parametrize("top", [3e-7, 0.0916, 0.0322, 0.341, 1.0, 7.3, 99.0, 4e5])
def test_colour_bars_have_round_numbers(top):
    per, _ = labels.density_unit(top)
    ticks = labels.ticks(top * per)
    assert 3 <= len(ticks) <= 6
    assert ticks[0] == 0
    assert ticks[-1] <= top * per < 100
    assert all(labels.plain(v).replace(",", "").strip("0.") in ("1", "2", "5") for v in ticks[1:])
    assert np.diff(np.sqrt(ticks / (top * per))).min() > 0.13


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0, "0 %"),
        (1e-6, "< 0.1 %"),
        (0.069, "6.9 %"),
        (0.99999, "> 99.9 %"),
        (1 - 1e-12, "100 %"),
        (1, "100 %"),
        (0.9994, "99.9 %"),
    ],
)
def test_percent_tells_none_from_little(share, text):
    assert notation.percent(share) == text


def test_what_is_off_the_map_is_said():
    at = forecast(-87.5, 28.7).data.isel(time=0)
    account = at["status_probability"].values
    for outside, left, words in (
        (0.01, 0, ""),
        (
            0.069,
            0,
            "6.9 % of the probability ran out of forcing and is not on the map; areas are shares of the rest",
        ),
        (
            0.2,
            0.05,
            "25.0 % of the probability is not on the map: 20.0 % ran out of forcing, 5.0 % left the domain; areas",
        ),
    ):
        account[:] = 0
        account[[Status.ADRIFT, Status.OUTSIDE, Status.LEFT]] = 1 - outside - left, outside, left
        assert forecast_words.off_map_warning(at).startswith(words)
        assert bool(forecast_words.off_map_warning(at)) == bool(words)
        assert "ashore" not in forecast_words.account(at)


def test_a_backward_run_counts_hours_before():
    made = forecast(-87.5, 28.7)
    assert (
        forecast_words.basis(made, -1, 4000)
        == "24 h after 211830ZNOV26   ·   4,000 particles, effective 4,000"
    )
    back = replace(made, data=made.data.isel(time=slice(None, None, -1)))
    assert forecast_words.basis(back, -1, None).startswith("24 h before 221830ZNOV26")


@pytest.mark.thorough
def test_provenance_is_in_the_picture(tmp_path):
    made = forecast(-87.5, 28.7)
    setting = Setting(
        Imprint("t", attributes={"case": "title = 'Bjørnøya → 1'"}), marks=[Mark(-87.5, 28.7)]
    )
    for name in ("a.png", "b.png"):
        forecast_map.draw_map(made, tmp_path / name, setting)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.text["case"] == "title = 'Bjørnøya → 1'"


@pytest.mark.thorough
def test_pyplot_stays_out():
    program = (
        "import sys, drift.forecast.products.map; sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
