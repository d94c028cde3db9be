"""What the drawing kit makes in fewer objects or bytes than Matplotlib, against Matplotlib's own."""

import io
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import PowerNorm
from PIL import Image

from drift.forecast.products import layers
from drift.products.maps import chart, page
from drift.products.maps.chart import INK

FRAME = chart.frame(np.array([-71.3, -69.2]), np.array([41.1, 42.4]), aspect=1.2)


def sheet_of_one(bounds=(0.2, 0.2, 0.7, 0.7), scale=1.0):
    figure, canvas = page.figure(3.6 * scale, 3.0 * scale)
    ax = figure.add_axes(bounds)
    chart.prepare(ax, FRAME)
    return figure, canvas, ax


def pixels(canvas: FigureCanvasAgg) -> np.ndarray:
    canvas.draw()
    return np.array(canvas.buffer_rgba())


def test_a_picture_loses_nothing_but_its_transparency(tmp_path) -> None:
    """Pixels, texts and resolution are those that Matplotlib writes."""
    figure, canvas, ax = sheet_of_one()
    chart.graticule(ax, FRAME)
    figure.text(0.5, 0.1, "shade", color="#c62828", alpha=0.4)
    theirs = io.BytesIO()
    texts = {"Title": "A title", "Software": "casp-drift", "seed": "7"}
    figure.savefig(theirs, format="png", dpi=130, metadata=texts)
    page.save(canvas, tmp_path / "a.png", "A title", {"seed": "7"}, dpi=130)
    with Image.open(theirs) as whole, Image.open(tmp_path / "a.png") as ours:
        assert (ours.mode, ours.info) == ("RGB", whole.info)
        assert np.asarray(whole)[..., 3].min() == 255
        np.testing.assert_array_equal(np.asarray(ours), np.asarray(whole)[..., :3])


@pytest.mark.parametrize("labels", [(True, True), (False, True), (True, False)])
def test_ticks_of_a_chart_are_those_of_matplotlib(labels) -> None:
    """Pixel for pixel, with Matplotlib's axes at the places and with the words of ours."""
    _, canvas, ax = sheet_of_one()
    chart.graticule(ax, FRAME, size=7, labels=labels)
    _, other, axes = sheet_of_one()
    chart.graticule(axes, FRAME, size=7, labels=(False, False))
    for k, axis in enumerate((axes.xaxis, axes.yaxis)):
        line = axes.lines[0]
        places = np.asarray(line.get_data()[k], float).tolist()
        line.remove()
        words = {t.get_position()[k]: t.get_text() for t in ax.texts if bool(t.get_rotation()) == k}
        assert bool(words) == labels[k]
        axis.set_visible(True)
        axis.set_ticks(places, labels=[words.get(place, "") for place in places])
        axis.set_tick_params(labelsize=7, length=4, color=INK, labelcolor=INK)
    ours = {text.get_text(): text for text in ax.texts}
    for text in axes.get_yticklabels():
        text.set(rotation=90, va="center")
    for text in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        if text.get_text():
            text.set(ha=ours[text.get_text()].get_ha(), va=ours[text.get_text()].get_va())
    np.testing.assert_array_equal(pixels(canvas), pixels(other))


@pytest.mark.parametrize(("lines", "size"), [(5, 8.0), (3, 7.0), (2, 6.5)])
@pytest.mark.parametrize("shift", np.linspace(0, 1, 9))
def test_every_tick_has_a_label_that_ends_with_the_chart(lines, size, shift) -> None:
    _, canvas, ax = sheet_of_one(scale=2.5 if lines > 3 else 1.0)
    lon, lat = np.array([-71.3, -69.2]) + shift, np.array([41.1, 42.4]) + shift
    here = chart.frame(lon, lat, aspect=1.2)
    chart.prepare(ax, here)
    chart.graticule(ax, here, lines=lines, size=size)
    ticks = sum(len(line.get_xdata()) for line in ax.lines)
    assert ticks == len(ax.texts) >= 2
    own = ax.get_window_extent()
    for text in ax.texts:
        box = text.get_window_extent(canvas.get_renderer())
        if text.get_rotation():
            assert own.y0 - 3 <= box.y0 < box.y1 <= own.y1 + 3
        else:
            assert own.x0 - 3 <= box.x0 < box.x1 <= own.x1 + 3
    boxes = [text.get_window_extent(canvas.get_renderer()) for text in ax.texts]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


@pytest.mark.parametrize("small", [False, True])
@pytest.mark.parametrize("wide", np.geomspace(0.001, 30, 12))
def test_words_of_a_scale_bar_keep_apart_in_its_box(wide, small) -> None:
    _, canvas, ax = sheet_of_one(scale=1.0 if small else 2.5)
    here = chart.frame(np.array([0, wide]), np.array([10, 10 + wide]), aspect=1.2)
    chart.prepare(ax, here)
    box = chart.scale_bar(ax, here, (0.015, 0.015), small=small).transformed(ax.transAxes)
    words = {text.get_text(): text.get_window_extent(canvas.get_renderer()) for text in ax.texts}
    assert sum(text.endswith(" nmi") for text in words) == 1
    texts = [
        text.get_tightbbox(canvas.get_renderer()) for text in ax.texts if text.get_text() != "N"
    ]
    assert all(box.x0 < one.x0 < one.x1 < box.x1 for one in texts)
    assert all(box.y0 < one.y0 < one.y1 < box.y1 for one in texts)
    written = [*words.values()]
    assert not any(a.overlaps(b) for i, a in enumerate(written) for b in written[:i])


def test_shading_of_a_mercator_chart_is_that_of_a_mesh() -> None:
    """To a step of 255 of a colour, which one cuts off and the other rounds.

    Axes that end between pixels would also shift the image by up to half a pixel: these do not.
    """
    rng = np.random.default_rng(3)
    lon, lat = np.linspace(-71.2, -69.5, 34), np.linspace(41.2, 42.3, 29)
    values = rng.random((29, 34))
    values[rng.random(values.shape) < 0.2] = np.nan
    forecast = SimpleNamespace(data=xr.Dataset(coords={"lon": lon, "lat": lat}))
    _, canvas, ax = sheet_of_one((0, 0, 1, 1))
    layers.shade(ax, FRAME, forecast, values, PowerNorm(0.5, 0, 1))
    _, other, axes = sheet_of_one((0, 0, 1, 1))
    axes.pcolormesh(
        *FRAME.net(chart.edges(lon), chart.edges(lat)),
        np.ma.masked_invalid(values),
        cmap=layers.shading(),
        norm=PowerNorm(0.5, 0, 1),
        zorder=1,
    )
    np.testing.assert_allclose(pixels(canvas).astype(int), pixels(other), rtol=0, atol=1)
