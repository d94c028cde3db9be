"""The story of a search in a real browser, from the call to a tasking, without a line of TOML."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from desk_cases import kayak
from desk_pages import PATIENCE, SIZES, Page
from desks import Server, mistakes, until

pytestmark = pytest.mark.browser

GPX = '<gpx version="1.1"><trk><trkseg>{}</trkseg></trk></gpx>'
TRACK = GPX.format(
    "".join(
        f'<trkpt lat="{lat}" lon="{lon}"><time>2026-11-28T{time}Z</time></trkpt>'
        for lat, lon, time in (
            (49.93, -5.62, "14:40:00"),
            (49.93, -5.52, "15:00:00"),
            (49.95, -5.52, "15:06:00"),
            (49.95, -5.62, "15:26:00"),
        )
    )
)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    folder = tmp_path / "cases"
    folder.mkdir()
    with Server(folder.resolve()) as one:
        yield one


CALL = kayak("Kayak overdue", particles=2000, duration="16 h", every="4 h")


@pytest.mark.parametrize("size", SIZES)
def test_from_the_call_to_a_tasking(browser: Any, served: Server, size: str) -> None:
    """First map, run, a sortie, a find, a unit, a plan; a sub-area is moved and kept.

    The call itself is in test_form_browser.
    """
    (served.folder / "kayak.toml").write_text(CALL, encoding="utf-8")
    desk = Page(browser, served, size)
    page = desk.page
    desk.press("kayak.toml")
    desk.press("First map")
    page.get_by_text("First map, 10,000 particles").wait_for(timeout=PATIENCE)
    desk.press("Run the forecast")
    page.get_by_role("link", name=re.compile("Open the report of kayak-forecast")).wait_for(
        timeout=PATIENCE
    )
    desk.press("Search")
    # a sortie: its kind, its middle by a click, its spacing
    page.get_by_label("One more").first.select_option("creeping")
    desk.press("Add a sortie")
    until(lambda: desk.tables().get("sortie"), 60)
    page.locator('[data-own="sortie.0.pattern.centre"]').wait_for(timeout=PATIENCE)
    # nothing is invented: the time and the place are asked for beside their fields
    for key, words in (
        ("start", "the time is missing"),
        ("pattern.centre", "the place is missing"),
    ):
        field = page.locator(f'[data-own="sortie.0.{key}"]')
        assert field.input_value() == ""
        beside = field.locator("xpath=../following-sibling::p[1]")
        beside.get_by_text(words).wait_for(timeout=PATIENCE)
    desk.press("Middle: click on the map")
    page.locator("#map").click(position={"x": 150, "y": 200})
    until(lambda: desk.tables()["sortie"][0]["pattern"]["centre"] != "", 60)
    desk.fill("sortie.0.pattern.centre", "49 57N 005 34W")
    desk.fill("sortie.0.pattern.spacing", "0.5 nmi")
    desk.fill("sortie.0.start", "+4 h")
    # 6 by 3 nmi at 0.5 nmi: 12 legs of 2.5 nmi, 11 cross legs of 0.5 nmi
    page.get_by_text("35.5 nmi in 23 legs").wait_for(timeout=PATIENCE)
    desk.fill("sortie.0.speed", "14 furlong")
    wrong = page.locator("p.beside")
    wrong.get_by_text("furlong").wait_for(timeout=PATIENCE)
    assert page.locator('[data-own="sortie.0.speed"]').get_attribute("aria-invalid") == "true"
    desk.fill("sortie.0.speed", "14 kn")
    # a track that was made good, as a file
    page.locator("#new-track").set_input_files(
        {"name": "lifeboat.gpx", "mimeType": "application/gpx+xml", "buffer": TRACK.encode()}
    )
    until(lambda: len(desk.tables().get("sortie", [])) == 2, 60)
    assert (served.folder / "lifeboat.gpx").read_text() == TRACK
    assert desk.tables()["sortie"][1]["track"] == "lifeboat.gpx"
    desk.fill("sortie.1.start", "281430ZNOV26")
    # a unit, and the time of the plan
    desk.press("Add a unit")
    until(lambda: desk.tables().get("unit"), 60)
    desk.fill("unit.0.base", "50 06N 005 32W")
    desk.fill("plan.begin", "+8 h")
    desk.fill("plan.until", "+15 h")
    until(lambda: not mistakes(page), 60)
    desk.press("Plan the next search")
    moved = page.get_by_role("button", name="Move A-1")
    moved.wait_for(timeout=PATIENCE)
    page.locator("#plan-said").get_by_text("Ready").wait_for(timeout=PATIENCE)
    stated = json.loads((served.folder / "kayak-plan" / "plan.json").read_text())
    assert f"{100 * stated['pos']:.1f} %" in page.locator("#plan-total").inner_text()
    moved.focus()
    for key in ("Shift+ArrowRight", "Shift+ArrowRight", "]", "]"):
        page.keyboard.press(key)
    page.locator("#plan-now").get_by_text("As moved").wait_for(timeout=PATIENCE)
    page.locator('[data-pos="A-1"]').get_by_text("as moved").wait_for(timeout=PATIENCE)
    page.wait_for_timeout(500)
    assert int(page.locator("#plan-said").get_attribute("data-ms") or "9999") < 500
    by_keys = page.locator("#plan-now").inner_text()
    # by the mouse: the area goes where it is dragged
    page.locator("#map").evaluate("map => map.scrollIntoView()")  # on a phone it is above
    box = page.locator("#map").bounding_box()
    x, y = page.evaluate(MIDDLE_OF_AREA)
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + x - 20, box["y"] + y + 30, steps=4)
    page.mouse.up()
    until(lambda: page.locator("#plan-now").inner_text() != by_keys, 60)
    page.wait_for_timeout(500)
    desk.press("Keep A-1 as a sortie")
    until(lambda: len(desk.tables()["sortie"]) == 3, 60)
    kept = desk.tables()["sortie"][2]
    assert kept["name"] == "A-1 unit, moved by hand"
    row = stated["taskings"][0]
    turned = kept["pattern"]["orientation"] - row["orientation_deg"]
    assert abs((turned - 10 + 180) % 360 - 180) < 1e-3
    assert page.evaluate("document.documentElement.scrollWidth") <= SIZES[size]["width"]
    assert page.get_by_role("link", name="sheet A-1").get_attribute("href")
    assert desk.complaints == []
    assert desk.outside == []
    desk.context.close()
    _check_access(browser, served, size)


MIDDLE_OF_AREA = """async () => {
  const { chart } = await import("/assets/map.js");
  const features = chart.getLayers().getArray().flatMap((one) => one.getSource().getFeatures());
  const area = features.find((one) => one.get("area") === "A-1" && one.get("look") === "planned");
  return chart.getPixelFromCoordinate(area.getGeometry().getInteriorPoint().getCoordinates());
}"""


def _check_access(browser: Any, served: Server, size: str) -> None:
    """A plan of the list opens its case; with all rows open axe knows of no violation."""
    from axe_playwright_python.sync_playwright import Axe

    desk = Page(browser, served, size, bypass_csp=True)
    page = desk.page
    desk.press("kayak-plan on the map")
    page.locator("#plan-said").get_by_text("Ready").wait_for(timeout=PATIENCE)
    assert [row["name"] for row in desk.tables()["sortie"]] == ["search", "lifeboat"]
    for summary in page.locator("#form summary:visible").all():
        summary.click()
    violations = Axe().run(page).response["violations"]
    assert [(one["id"], [node["html"] for node in one["nodes"]][:3]) for one in violations] == []
    desk.context.close()
