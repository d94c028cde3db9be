"""The map of drift serve where longitudes jump from 180 E to 180 W."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from desks import Server, on_map, until

pytestmark = pytest.mark.browser

EARTH = 6371008.8  # [m]
WORLD = 2 * math.pi * EARTH  # [m] width of the map
CASE = """
title = "Near the seam"
start = "211830ZNOV26"
duration = "3 h"
[[scenario]]
name = "person"
object = "PIW-1"
position = { at = "17 20.0S 179 57.0E", error = "6 nmi" }
[[wind]]
constant = { speed = "15 kn", from = 265 }
[[current]]
constant = { speed = "1 kn", toward = 75 }
"""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    folder = tmp_path / "cases"
    folder.mkdir()
    (folder / "seam.toml").write_text(CASE, encoding="utf-8")
    with Server(folder.resolve()) as one:
        yield one


def test_a_map_across_180_degrees(browser: Any, served: Server) -> None:
    """Areas lie on both sides; the shoreline does too; and the next world looks the same."""
    page = browser.new_page(viewport={"width": 900, "height": 900})
    page.goto(f"http://{served.host}/?token={served.secret.token}")
    page.get_by_role("button", name="seam.toml").click()
    until(lambda: page.locator("#at").input_value(), 60)
    page.get_by_role("button", name="First map").click()
    until(lambda: page.locator("#headline").inner_text().startswith("First map,"), 120)
    west, _, east, _ = on_map(page, "sea.view.calculateExtent(sea.chart.getSize())")
    assert west < WORLD / 2 < east
    assert east - west < WORLD / 90  # it does not show the whole Earth to have both sides
    extents = on_map(page, "sea.shown.areas.every.map((one) => one.getGeometry().getExtent())")
    assert extents
    for left, _, right, _ in extents:
        # RFC 7946 cuts areas at 180 degrees: one of several parts reaches both ends of the world
        assert right - left < 200_000 or (left, right) == pytest.approx((-WORLD / 2, WORLD / 2))
    assert any(right - left > 200_000 for left, _, right, _ in extents)

    requests: list[str] = []
    page.on("request", lambda one: one.url.endswith("/coast") and requests.append(one.url))

    def ends() -> tuple[bool, bool]:
        """Whether land begins just west of 180 E, and ends just east of 180 W."""
        lands = on_map(page, "sea.land.getFeatures().map((one) => one.getGeometry().getExtent())")
        return (
            any(WORLD / 2 - 100_000 < left < WORLD / 2 for left, _, _, _ in lands),
            any(-WORLD / 2 < right < -WORLD / 2 + 100_000 for _, _, right, _ in lands),
        )

    def picture(turns: int) -> bytes:
        on_map(page, f"sea.view.setCenter([{WORLD * (0.5 + turns)} + 40000, -1952000])")
        page.wait_for_timeout(700)
        until(lambda: ends() == (True, True), 60)
        page.wait_for_timeout(300)
        return bytes(page.locator("#map").screenshot())

    here = picture(0)
    asked = len(requests)
    assert picture(1) == here
    assert picture(-1) == here
    assert len(requests) == asked  # the shoreline is there already
    page.close()
