"""The story of a first map in a real browser: a kayaker is overdue; no TOML is written by hand."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from desk_pages import PATIENCE, SIZES, Page
from desks import Server, on_map, until

pytestmark = pytest.mark.browser


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    folder = tmp_path / "cases"
    folder.mkdir()
    with Server(folder.resolve()) as one:
        yield one


@pytest.mark.parametrize("size", SIZES)
def test_a_kayaker_is_overdue(browser: Any, served: Server, size: str) -> None:
    """Position typed and clicked, time, object, wind and current typed; a first map, then the run.

    The text has what was typed, the browser complains of nothing, and sends no request outside.
    """
    from axe_playwright_python.sync_playwright import Axe

    desk = Page(browser, served, size)
    page = desk.page
    page.get_by_role("button", name="New search").click()
    at = page.get_by_label("Position", exact=True)
    # what is missing stands beside its field
    at.locator("xpath=../following-sibling::p[1]").get_by_text("the place is missing").wait_for(
        timeout=PATIENCE
    )

    def becomes(value: Any, *keys: Any) -> None:
        def is_so() -> bool:
            found = desk.tables()
            for key in keys:
                if key not in (found if isinstance(found, dict) else range(len(found))):
                    return False
                found = found[key]
            return bool(found == value)

        until(is_so, 60)

    at.fill("50 02.2N 005 31.7W")
    at.press("Tab")
    becomes("50 02.2N 005 31.7W", "scenario", 0, "position", "at")
    becomes("1 nmi", "scenario", 0, "position", "error")
    # the map has gone there: its middle, clicked, is within a mile
    until(
        lambda: abs(on_map(page, "sea.map.inverse(sea.view.getCenter())[1]") - 50.0367) < 0.01, 60
    )
    page.get_by_role("button", name="Click on the map").first.click()
    page.locator("#map").click(position={"x": 120, "y": 330})
    until(lambda: desk.tables()["scenario"][0]["position"]["at"] != "50 02.2N 005 31.7W", 60)
    at.fill("49 55.0N 005 40.0W")  # for where the click was may be on land
    at.press("Tab")
    becomes("49 55.0N 005 40.0W", "scenario", 0, "position", "at")
    page.get_by_label("Time", exact=True).fill("281234ZNOV26")
    page.get_by_label("Time", exact=True).press("Tab")
    becomes("281234ZNOV26", "start")
    until(lambda: page.locator("#picker").input_value() == "2026-11-28T12:34", 60)
    page.get_by_label("Find", exact=True).fill("kayak")
    page.locator("#object").select_option("PERSON-POWERED-VESSEL-1")
    becomes("PERSON-POWERED-VESSEL-1", "scenario", 0, "object")
    for words, direction, speed, degrees in (
        ("Wind", "from", "18 kn", 235),
        ("Current", "toward", "1 kn", 75),
    ):
        page.get_by_label(words, exact=True).select_option("constant")
        page.get_by_label(f"{words} speed").fill(speed)
        page.get_by_label(f"{words} {direction}").fill(str(degrees))
        page.keyboard.press("Tab")
        becomes({"speed": speed, direction: degrees}, words.lower(), 0, "constant")
    page.get_by_label("Forecast for").fill("6 h")
    page.get_by_label("Forecast for").press("Tab")
    becomes("6 h", "duration")
    page.get_by_role("button", name="First map").click()
    told = page.locator("#headline")
    until(lambda: told.inner_text() not in ("", "Making a first map ..."), 120)
    assert told.inner_text().startswith("First map, 10,000 particles"), told.inner_text()
    assert on_map(page, "sea.shown.times.length") == 3  # every 3 h of 6
    page.get_by_role("button", name="Earlier").click()
    assert page.locator("#now").inner_text() == "281534ZNOV26 (+3 h)"
    assert page.evaluate("document.documentElement.scrollWidth") <= SIZES[size]["width"]
    found = on_map(page, "sea.shown.areas.every.length")
    assert found == 9  # three areas at each of three times
    assert desk.complaints == []
    if size == "desktop":
        page.get_by_role("button", name="Text", exact=True).click()
        text = page.locator("#text").input_value()
        page.locator("#text").fill(text.replace("particles = 100_000", "particles = 2000"))
        page.get_by_role("button", name="Form", exact=True).click()
        page.get_by_role("button", name="Run the forecast").click()
        page.get_by_role("link", name=re.compile("Open the report")).wait_for(timeout=PATIENCE)
        page.get_by_role("button", name="Areas on the map").click()
        page.get_by_text("Areas of search_").wait_for(timeout=PATIENCE)
        assert list(served.folder.glob("search_*.toml"))
    desk.context.close()
    with browser.new_context(viewport=SIZES[size], bypass_csp=True) as checked:
        page = checked.new_page()
        page.goto(f"http://{served.host}/?token={served.secret.token}")
        page.get_by_role("button", name="New search").click()
        page.get_by_text("the place is missing").first.wait_for(timeout=PATIENCE)
        violations = Axe().run(page).response["violations"]
    assert [(one["id"], [node["html"] for node in one["nodes"]][:3]) for one in violations] == []
    assert desk.outside == []
