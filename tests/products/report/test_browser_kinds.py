"""report.html in a real browser, of runs near a pole, with beaches, and of every kind."""

import json
import re
from pathlib import Path
from typing import Any

import cartopy.crs as ccrs
import numpy as np
import pytest
import xarray as xr
from opened_report import GLOBE, Opened, middle, ran

import drift

pytestmark = pytest.mark.browser
POLE = """
title = "Near the pole"
start = "160600ZNOV15"
duration = "12 h"
particles = 4000
[output]
every = "6 h"
[[current]]
constant = { speed = "1 kn", toward = 200 }
[uncertainty]
current = { std = "0.2 m/s", time = "6 h" }
[[scenario]]
name = "ice floe"
object = "water"
position = { at = [41.0, 87.3], error = "4 nmi" }
"""


def test_values_near_the_pole(browser: Any, tmp_path: Path) -> None:
    """Lambert's azimuthal equal-area projection, as cartopy has it."""
    results = ran(tmp_path, POLE)
    data = xr.open_dataset(results / "forecast.nc")
    with Opened(browser, results) as opened:
        at = middle(opened)
        assert at["kind"] == "azimuthal"
        crs = ccrs.LambertAzimuthalEqualArea(
            central_longitude=at["lon"], central_latitude=at["lat"], globe=GLOBE
        )
        lon, lat = float(data["datum_lon"][-1]), float(data["datum_lat"][-1])
        text = opened.read(lon + 1.5, lat - 0.1, crs)
        here = re.match(r"(\d+)-([\d.]+)N (\d+)-([\d.]+)E", text)
        resolution = opened.page.evaluate("report.view.getResolution()") / 1852
        assert int(here[1]) * 60 + float(here[2]) == pytest.approx(
            (lat - 0.1) * 60, abs=0.05 + resolution
        )
        east = int(here[3]) * 60 + float(here[4])
        assert east == pytest.approx(
            (lon + 1.5) * 60, abs=0.05 + resolution / np.cos(np.radians(lat))
        )
        assert opened.complaints == []


BEACH = """
title = "Onto a beach"
start = "160600ZNOV15"
duration = "12 h"
particles = 6000
coast.source = "land.geojson"
[[current]]
constant = { speed = "1 kn", toward = 90 }
[uncertainty]
current = { std = "0.3 m/s", time = "6 h" }
[[scenario]]
name = "raft"
object = "water"
position = { at = [0.85, 0.0], error = "3 nmi" }
"""


def test_dots_ashore_have_their_weight(browser: Any, tmp_path: Path) -> None:
    """The likeliest cells that hold half of what is ashore are drawn largest, and over the others:
    by ashore.csv, summed in NumPy.
    """
    land = {"type": "Polygon", "coordinates": [[[1, -2], [2, -2], [2, 2], [1, 2], [1, -2]]]}
    (tmp_path / "land.geojson").write_text(json.dumps(land), encoding="utf-8")
    results = ran(tmp_path, BEACH)
    share = np.sort(
        np.genfromtxt(results / "ashore.csv", delimiter=",", names=True, usecols=3)[
            "probability_ashore"
        ]
    )[::-1]
    before = (np.cumsum(share) - share) / share.sum()
    expected = np.searchsorted([0.5, 0.75, 0.9, 0.97], before, side="right")
    assert len(set(expected)) == 5, "the case is made so that there are dots of every class"
    with Opened(browser, results) as opened:
        of_layer = "report.layers.find(one => one.title === 'Ashore at the end').every"
        drawn = opened.page.evaluate(f"{of_layer}.map(one => one.get('size'))")
        assert drawn == sorted(expected.tolist(), reverse=True)
        sizes, opaque = opened.page.evaluate("[SIZES, OPAQUE]")
        assert sizes == sorted(sizes, reverse=True)
        assert opaque == sorted(opaque, reverse=True)
        assert opened.complaints == []


KINDS = {
    "plan": ("overdue_boat", lambda case, out: drift.plan(case, out), {"particles": 3000}, "Planned areas"),
    "spill": ("gulf_containers", lambda case, out: drift.run(case, out), {"spill.worlds": 100, "spill.redraws": 0}, "Washup by stretch"),
    "patrols": ("gulf_containers", lambda case, out: drift.patrol(case, out), {"spill.worlds": 100, "spill.redraws": 0}, "Planned patrols"),
    "origin": ("gulf_containers", lambda case, out: drift.origin(case, out), {"spill.worlds": 100, "spill.redraws": 0}, "Finds"),
    "steering": ("smuggler_bridge", lambda case, out: drift.run(case, out), {"particles": 3000}, "Itineraries of targets"),
    "no coast": ("cast_submarine", lambda case, out: drift.run(case, out), {"particles": 3000, "coast.source": "none"}, "Contacts"),
}  # fmt: skip
HEADLINES = {
    "plan": r"The plan, \d{6}Z\w+ to \d{6}Z\w+, \d sub-areas?: POS 0\.\d",
    "spill": r"objects are expected ashore .*The stretch with most of them",
}  # of kinds that have one of their own


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_run(browser: Any, tmp_path: Path, kind: str) -> None:
    """Its page opens, plays through all of its times, and has its layers and tables."""
    name, run, changes, layer = KINDS[kind]
    case = drift.vary(drift.load(name), changes)
    run(case, tmp_path / "results")
    with Opened(browser, tmp_path / "results") as opened:
        titles = opened.page.locator("#layers label").all_inner_texts()
        assert layer in titles
        told = HEADLINES.get(kind, r"At \d{6}Z\w+ (it|an object) is most likely ")
        assert kind == "origin" or re.search(told, opened.page.locator("#headline").inner_text())
        for k in range(opened.page.evaluate("report.times.length")):
            opened.show(k)
        assert opened.page.locator("details").count() >= 2
        assert opened.complaints == []
        assert len(opened.asked) == 1
