"""The user's own chart on the map of drift serve."""

import io
from pathlib import Path
from typing import Any

import chart_files
import pytest
from desks import Server, on_map, until
from PIL import Image

from drift.apps.serve import charts

pytestmark = pytest.mark.browser

RED, BLUE = (200, 30, 30), (30, 30, 200)


def quarters() -> bytes:
    """A tile whose north-eastern quarter is blue, the rest red."""
    drawn = Image.new("RGB", (256, 256), RED)
    drawn.paste(BLUE, (128, 0, 256, 128))
    file = io.BytesIO()
    drawn.save(file, "png")
    return file.getvalue()


def test_a_first_visit_shows_land(browser: Any, tmp_path: Path) -> None:
    """Before anything is touched, and with nothing kept in the browser: the map stayed empty."""
    with Server(tmp_path.resolve()) as served:
        page = browser.new_page(viewport={"width": 900, "height": 700})
        page.goto(f"http://{served.host}/?token={served.secret.token}")
        until(lambda: on_map(page, "sea.land.getFeatures().length") > 0, 60)
        page.close()


def test_a_chart_lies_where_its_tiles_are(browser: Any, tmp_path: Path) -> None:
    """Tile 1/0/0 has its middle at 90 W 66.51326 N: arctan(sinh(pi / 2)) on the web's Mercator."""
    folder = tmp_path / "cases"
    folder.mkdir()
    whole = {(0, 0, 0): quarters()} | {(1, x, y): quarters() for x in (0, 1) for y in (0, 1)}
    path = chart_files.pmtiles(
        tmp_path / "a.pmtiles", whole, name="Sound <b>", attribution="Office"
    )
    complaints: list[str] = []
    with Server(folder.resolve(), chart=(charts.open_chart(path),)) as served:
        page = browser.new_page(viewport={"width": 900, "height": 700})
        page.on("console", lambda one: one.type == "error" and complaints.append(one.text))
        page.on("pageerror", lambda one: complaints.append(str(one)))
        page.goto(f"http://{served.host}/?token={served.secret.token}")
        page.locator("#layers summary").click()
        box = page.get_by_label("Chart: Sound")
        until(box.count, 60)
        assert "Office" in page.locator("#charts").inner_text()
        page.locator("#layers summary").click()
        on_map(page, "sea.view.setResolution(10000)")

        def seen(lon: float, lat: float) -> tuple[int, int, int]:
            """The colour of the map in its middle, moved there; no cross or label lies on it."""
            on_map(page, f"sea.view.setCenter(sea.map.forward([{lon}, {lat}]))")
            page.wait_for_timeout(700)
            shot = Image.open(io.BytesIO(page.locator("#map").screenshot())).convert("RGB")
            return shot.getpixel((shot.width // 2, shot.height // 2))

        off = 2.0  # [deg] from the middle of the tile
        # a tile may come late on a busy machine
        until(lambda: seen(-90 + off, 66.513 + off) == BLUE, 60)
        until(lambda: seen(-90 - off, 66.513 + off) == RED, 60)
        until(lambda: seen(-90 + off, 66.513 - off) == RED, 60)
        until(lambda: seen(90 + off, -66.513 + 10 * off) == BLUE, 60)  # tile 1/1/1
        page.locator("#layers summary").click()
        box.uncheck()
        until(lambda: seen(-90 + off, 66.513 + off) not in (RED, BLUE), 60)
        page.reload()
        page.locator("#layers summary").click()
        until(box.count, 60)
        assert not box.is_checked()  # what was switched off stays off
        page.close()
    assert complaints == []
