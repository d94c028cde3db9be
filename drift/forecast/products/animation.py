"""A forecast as an animation: its outputs one after the other, on one map and one colour scale."""

import io
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from PIL import Image

from drift.forecast import effective
from drift.forecast.build import Forecast
from drift.forecast.products import layers
from drift.forecast.products import map as forecast_map
from drift.forecast.products import words as forecast_words
from drift.products.maps import chart, sheet
from drift.products.maps.chart import Frame
from drift.products.maps.imprint import Setting
from drift.products.maps.overlay import AtTime, Overlay
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation
from geo.array import Array

SHEET = Sheet(
    9.6,
    8.4,
    100,
    left=0.07,
    title=sheet.heading(0.955, 14),
    lines=(Row(0.92, 12), Row(0.89, 9)),
    caution=Badge(0.985, 0.955, side="right"),
    rough=Badge(0.07, 0.855),
    footer=sheet.small(0.012, 7),
)
FLOWN: dict[str, Any] = {"color": "#0d3b2e", "linewidth": 0.8}
MAP = (0.07, 0.07, 0.8, 0.77)  # left, bottom, width, height of the page
WHOLE = 12_000  # [ms] that the animation takes, as far as its frames stay within:
SHORTEST, LONGEST = 120, 900  # [ms] of a frame
LAST = 2500  # [ms] of the last frame, before it begins again
COLOURS = 255  # of a GIF, which are those of all frames together


def animate(
    forecast: Forecast, setting: Setting, legs: Sequence[tuple[np.datetime64, Array]] = ()
) -> bytes:
    """Return an animated GIF with a frame for each output.

    Args:
        forecast: outputs in ascending order of time.
        setting: land, marks and the words on every picture.
        legs: of sorties, which are shown from the time that stands with them; each (n, 2) [deg].
    """
    pictures = list(_frames(forecast, setting, partial(_flown, legs)))
    # One palette for all: colours that change from frame to frame flicker.
    sample = Image.fromarray(np.concatenate([np.asarray(picture)[::4] for picture in pictures]))
    palette = sample.quantize(COLOURS, dither=Image.Dither.NONE)
    first, *others = (
        picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures
    )
    each = int(np.clip(WHOLE / len(pictures), SHORTEST, LONGEST))
    file = io.BytesIO()
    first.save(
        file,
        "gif",
        save_all=True,
        append_images=others,
        duration=[each] * (len(pictures) - 1) + [LAST],
        loop=0,
        comment=setting.imprint.footer.encode(),
    )
    return file.getvalue()


def _flown(legs: Sequence[tuple[np.datetime64, Array]], now: np.datetime64) -> Overlay:
    def draw(ax: Axes, frame: Frame) -> None:
        for start, line in legs:
            if start <= now:
                ax.plot(*frame.project(*line.T), **FLOWN)

    return Overlay(draw, {}, ())


def _frames(forecast: Forecast, setting: Setting, flown: AtTime) -> Iterator[Image.Image]:
    times = list(forecast.data["time"].values)
    aspect = MAP[2] * SHEET.width / (MAP[3] * SHEET.height)
    frame = layers.extent(forecast, times, setting.marks, (), aspect)
    land = chart.land_path(frame, setting.polygons(frame.box()), 800)
    sure = [i for i in range(len(times)) if not effective.effective_at(forecast.data, i).few]
    top = max(layers.scale_top(forecast.data.isel(time=i)) for i in sure or range(len(times)))
    corner = chart.free_corner(frame, *layers.label_obstacles(frame, forecast, times))
    waiting = forecast_words.waiting(forecast.data)
    for i in range(len(times)):
        at = forecast.data.isel(time=i)
        on = sheet.begin_page(SHEET)
        ax = on.figure.add_axes(MAP)
        mesh = forecast_map.small_map(ax, frame, forecast, i, top, land, setting, [flown])
        chart.graticule(ax, frame)
        chart.scale_bar(ax, frame, corner)
        valid = f"Valid {notation.format_dtg(times[i])}   ({notation.iso(times[i])}, UTC)"
        sheet.write_head(on, setting.imprint, valid, forecast_map.sizes(at, waiting))
        count = effective.effective_at(forecast.data, i, setting.particles)
        if count.few:
            sheet.draw_rough_banner(on, effective.banner(count))
        forecast_map.log_bar(on.figure, (0.9, 0.3, 0.015, 0.3), mesh)
        sheet.write_footer(on, setting.imprint)
        file = io.BytesIO()
        on.figure.savefig(file, format="png", dpi=SHEET.dpi)
        yield Image.open(file).convert("RGB")
