"""Probability outside the frame of a picture is reported with its share and position: against
projections of our own.
"""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pyproj
import pytest
import searches
from weighted_snapshots import BEGIN, snapshot

from drift.evidence.filter.products import layers as search_layers
from drift.forecast import build as forecast_build
from drift.forecast.products import beyond, layers
from drift.forecast.products import map as forecast_map
from drift.products.maps.imprint import Imprint, Setting
from geo import notation, sphere


def two(lon, lat, east, north, share):
    """Return a forecast of a cloud with a share of the probability some way off [m], and where that
    lies [deg].
    """
    rng = np.random.default_rng(4)
    n, k = 40_000, 8000
    off = np.where(np.arange(n) < k, 1.0, 0.0)
    x, y = sphere.destination(
        *np.radians([lon, lat]),
        east * off + rng.normal(0, 3000, n),
        north * off + rng.normal(0, 5000, n),
    )
    weight = np.where(off > 0, share / k, (1 - share) / (n - k))
    there = np.degrees(sphere.destination(*np.radians([lon, lat]), east, north))
    return forecast_build.build_forecast(
        [snapshot(np.degrees(x), np.degrees(y), weight, 0)], scenarios=["only"]
    ), there


@pytest.mark.parametrize(
    ("lon", "lat", "east", "north", "point"),
    [
        (4.3, 60.2, 250e3, 210e3, "NE"),
        (179.8, -38.2, 300e3, -20e3, "E"),
        (-179.9, 12.1, -260e3, -240e3, "SW"),
    ],
)
@pytest.mark.thorough
def test_what_a_frame_leaves_out_is_told_with_its_share_and_place(
    tmp_path, words, lon, lat, east, north, point
):
    """2 % of the probability 300 km off: the frame holds the 95 % area, and what is shaded near it."""
    made, there = two(lon, lat, east, north, 0.02)
    here = layers.extent(made, [BEGIN], (), (), 1.1)
    at = made.data.isel(time=0)
    mercator = pyproj.Proj(proj="merc", lon_0=here.centre[0], R=sphere.RADIUS)
    mass = at["probability"].values.astype(float)
    x, y = mercator(*np.meshgrid(at["lon"].values, at["lat"].values))
    out = (x < here.x[0]) | (x > here.x[1]) | (y < here.y[0]) | (y > here.y[1])
    share = f"{100 * mass[out].sum():.1f} %"
    assert mass[out].sum() == pytest.approx(0.02, abs=0.004)  # and what strays from the main cloud
    told = beyond.outside_frame_sentence(here, at)
    assert told.startswith(
        f"{share} of the probability lies outside this frame, to the {point} (around "
    )
    place = told.partition("(around ")[2].rstrip(")")
    lat_text, lon_text = place.split()
    found = [
        (int(t[:-1].split("-")[0]) + float(t[:-1].split("-")[1]) / 60)
        * (-1 if t[-1] in "SW" else 1)
        for t in (lon_text, lat_text)
    ]
    far = pyproj.Geod(a=sphere.RADIUS, b=sphere.RADIUS).inv(*found, *there)[2]
    # the mean of 8,000 of 5 km each: 60 m; cells and tenths of a minute come on top
    assert far < 1000
    forecast_map.draw_map(made, tmp_path / "map.png", Setting(Imprint("t")))
    assert any(
        f" % of the probability lies outside this frame, to the {point} (around " in text
        for text in words
    )
    forecast_map.draw_snapshots(made, tmp_path / "snapshots.png", Setting(Imprint("t")))
    assert any(text.endswith(f"% outside the frame, {point}") for text in words)


def test_a_place_just_beyond_the_frame_is_shown_and_one_far_off_is_told(tmp_path, words):
    made, _ = two(4.3, 60.2, 0.0, 0.0, 0.5)
    here = layers.extent(made, [BEGIN], (), (), 1.1)
    # width of the frame [deg], in Mercator
    step = np.degrees((here.x[1] - here.x[0]) / sphere.RADIUS)
    near, far = (np.array([[here.centre[0] + k * step, here.centre[1]]]) for k in (0.65, 5.0))
    assert beyond.is_outside_frame(here, [near])
    assert not beyond.is_outside_frame(
        here, [np.array([[here.centre[0] - k, here.centre[1]] for k in (5.0, 0.0, -5.0)])]
    )
    wider = layers.extent(made, [BEGIN], (), (), 1.1, also=[[far], [near]])
    assert not beyond.is_outside_frame(wider, [near])
    assert beyond.is_outside_frame(wider, [far])
    contact = SimpleNamespace(name="flare", time=BEGIN, kind="range", sensor=(far[0, 0], far[0, 1]))
    contact = searches.Contact(**vars(contact), range=900.0, range_std=100.0)
    forecast_map.draw_map(
        made,
        tmp_path / "map.png",
        Setting(Imprint("t")),
        overlays=[partial(search_layers.reminder, (), [contact])],
    )
    where = notation.position(*far[0])
    assert any(
        f'outside this frame: contact "flare", to the E (around {where})' in text for text in words
    )
