"""The story of a spill in a real browser, from lost containers to patrols, without a line of TOML."""

import csv
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from desk_pages import PATIENCE, SIZES, Page
from desks import Server, mistakes, until

pytestmark = pytest.mark.browser

SHORE, SEA = (5.2, 53.4003), (5.0, 53.6)  # on the north beach of Terschelling, and 25 km off it
SHIP = """\
time,lon,lat
2026-11-28T00:00:00Z,4.6,53.50
2026-11-28T02:00:00Z,5.1,53.53
2026-11-28T04:00:00Z,5.6,53.58
"""
DROP = """(text) => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([text], "ais.csv", { type: "text/csv" }));
  document.body.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
}"""
PIXEL = """([lon, lat]) => import("/assets/map.js").then(({ chart, map }) => {
  chart.renderSync(); // the map may just have moved
  return chart.getPixelFromCoordinate(map.forward([lon, lat]));
})"""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    folder = tmp_path / "cases"
    folder.mkdir()
    with Server(folder.resolve()) as one:
        yield one


def click_at(desk: Page, place: tuple[float, float]) -> None:
    """Click on a place of the map, which is on the screen."""
    desk.page.locator("#map").scroll_into_view_if_needed()
    x, y = desk.page.evaluate(PIXEL, list(place))
    desk.page.locator("#map").click(position={"x": x, "y": y})


def type_into(desk: Page, label: str, value: str) -> None:
    box = desk.page.get_by_label(label, exact=True)
    box.fill(value)
    box.press("Tab")


def number_lost(desk: Page, k: int, words: str, objects: Any) -> None:
    """Type how many of a class were lost, and wait until the text has the number of all."""
    desk.page.locator(f'[data-own="spill.class.{k}.number"]').fill(words)
    desk.page.keyboard.press("Tab")
    until(lambda: desk.tables()["spill"].get("objects") == objects, 60)


def lose_containers(desk: Page) -> None:
    """Say in the form that containers were lost: place, times, numbers, wind and current."""
    page = desk.page
    desk.press("New search")
    page.get_by_label("Adrift", exact=True).select_option("spill")
    until(lambda: "spill" in desk.tables(), 60)
    type_into(desk, "Position", "53 29.0N 005 12.0E")
    type_into(desk, "Time", "280000ZNOV26")
    until(lambda: desk.tables()["start"] == "280000ZNOV26", 60)
    page.locator('[data-row="spill.class.0"] > summary').click()
    number_lost(desk, 0, "60", 60)
    page.get_by_label("Wind", exact=True).select_option("constant")
    type_into(desk, "Wind speed", "22 kn")
    type_into(desk, "Wind from, degrees true", "340")
    page.get_by_label("Current", exact=True).select_option("constant")
    type_into(desk, "Current speed", "0.4 kn")
    type_into(desk, "Current toward, degrees true", "80")
    until(lambda: desk.tables().get("current"), 60)
    desk.press("First map")
    page.locator("#headline").get_by_text("objects are expected ashore").wait_for(timeout=PATIENCE)


@pytest.mark.parametrize("size", SIZES)
def test_from_containers_to_patrols(browser: Any, served: Server, size: str) -> None:
    desk = Page(browser, served, size)
    page = desk.page
    lose_containers(desk)
    assert page.locator("#rank-list li").first.inner_text().strip() == "1 to 3"
    (name,) = (re.sub(r".*(search_[\d-]+).*", r"\1", page.locator("#editor-title").inner_text()),)
    # a second kind of object; the first keeps its number
    desk.press("Add another kind")
    page.locator('[data-own="spill.class.1.number"]').wait_for(timeout=PATIENCE)
    desk.fill("spill.class.1.name", "drum")
    number_lost(desk, 1, "30 to 50", [90, 110])
    page.locator("#form details summary", has_text="How they were lost").click()
    desk.fill("spill.worlds", "150")
    until(lambda: not mistakes(page), 60)
    desk.press("Run the forecast")
    on_map = page.get_by_role("button", name="Areas on the map")
    on_map.wait_for(timeout=PATIENCE)
    on_map.click()
    rows = page.locator("#stretch-rows li")
    rows.first.wait_for(timeout=PATIENCE)
    check_the_list(desk, served.folder / f"{name}-forecast")
    check_the_list_and_the_map(desk)
    find_on_the_map(desk)
    plan_patrols(desk, name)
    assert page.evaluate("document.documentElement.scrollWidth") <= SIZES[size]["width"]
    assert desk.complaints == []
    assert desk.outside == []
    desk.context.close()
    _check_access(browser, served, size, name)


def check_the_list(desk: Page, run: Path) -> None:
    """The list has the stretches of washup.csv, by rank, and those of a class by that class."""
    page = desk.page
    with open(run / "washup.csv", encoding="utf-8") as file:
        stretches = list(csv.DictReader(file))

    def listed() -> list[str]:
        return [str(one) for one in page.locator("#stretch-rows .link").all_inner_texts()]

    worst = [row for row in stretches if float(row["expected"]) >= 0.005][:15]
    assert len(listed()) == len(worst)
    for words, row in zip(listed(), worst, strict=True):
        assert words.startswith(f"{row['rank']}. ")
        assert row["name"] in words
    figures = page.locator("#stretch-rows li p").first.inner_text()
    assert figures.startswith(f"{float(worst[0]['expected']):.0f} on average")
    assert f"({worst[0]['number_10']} to {worst[0]['number_90']})" in figures
    page.locator("#stretch-class").select_option(label="drum")
    by_drum = sorted(stretches, key=lambda row: -float(row["expected_drum"]))
    until(lambda: by_drum[0]["name"] in listed()[0], 30)
    page.get_by_text("if it is drum").wait_for(timeout=PATIENCE)  # and the areas are of drums
    page.locator("#stretch-class").select_option(label="all objects")
    page.wait_for_timeout(500)


def check_the_list_and_the_map(desk: Page) -> None:
    """A stretch of the list is shown on the map; one that is clicked there is chosen in the list."""
    page = desk.page
    at_end = page.locator("#washup-words").inner_text()
    page.get_by_role("button", name="Earlier").click()
    until(lambda: page.locator("#washup-words").inner_text() != at_end, 30)
    page.get_by_role("button", name="Later").click()
    second = page.locator("#stretch-rows .link").nth(1)
    second.focus()
    page.keyboard.press("Enter")
    assert second.get_attribute("aria-pressed") == "true"
    chosen = """() => import("/assets/map.js").then(({ chart }) => {
      const features = chart.getLayers().getArray().flatMap((one) => one.getSource().getFeatures());
      const band = features.find((one) => one.get("strong") && one.get("look") === "stretch");
      return chart.getPixelFromCoordinate(band.getGeometry().getCoordinateAt(0.3));
    })"""
    first = page.locator("#stretch-rows .link").first
    first.click()
    page.wait_for_timeout(500)
    x, y = page.evaluate(chosen)
    desk.press("Form")
    page.locator("#map").click(position={"x": x, "y": y})
    first.wait_for(timeout=PATIENCE)  # the list is shown again
    assert first.get_attribute("aria-pressed") == "true"


def find_on_the_map(desk: Page) -> None:
    """A find in the open sea gets the run's own message; on the shore it is taken."""
    page = desk.page
    desk.press("Finds and patrols")
    page.evaluate("import('/assets/map.js').then((sea) => sea.look_at([[4.8, 53.3], [5.6, 53.7]]))")
    desk.press("Drop a find on the map")
    click_at(desk, SEA)
    until(lambda: desk.tables().get("find"), 60)
    desk.fill("find.0.time", "281200ZNOV26")
    wrong = page.locator("p.beside", has_text="off the coast; the nearest coast is at")
    wrong.wait_for(timeout=PATIENCE)
    assert page.locator('[data-own="find.0.at"]').get_attribute("aria-invalid") == "true"
    desk.press("Place: click on the map")
    click_at(desk, SHORE)
    wrong.wait_for(state="detached", timeout=PATIENCE)
    page.get_by_label("What it is").select_option("drum")
    until(lambda: desk.tables()["find"][0].get("class") == "drum", 60)


def plan_patrols(desk: Page, name: str) -> None:
    page = desk.page
    desk.press("Add a team")
    until(lambda: desk.tables().get("patrol_unit"), 60)
    desk.fill("patrol_unit.0.first", "281400ZNOV26")
    desk.fill("patrol_unit.0.base", "53 23N 005 16E")
    desk.fill("patrol_unit.0.length", "25 km")
    until(lambda: not mistakes(page), 60)
    desk.press("Plan the patrols")
    keep = page.get_by_role("button", name=re.compile("Keep team.* as carried out"))
    keep.first.wait_for(timeout=PATIENCE)
    assert "objects found on average" in page.locator("#patrols-total").inner_text()
    assert page.get_by_role("link", name="schedule of the patrols").get_attribute("href")
    keep.first.click()
    until(lambda: desk.tables().get("patrol"), 60)
    assert desk.tables()["patrol"][0]["name"] == "team, 281400ZNOV26"
    assert desk.tables()["patrol"][0]["time"] == "2026-11-28T14:00:00Z"


def _check_access(browser: Any, served: Server, size: str, name: str) -> None:
    """A plan of the list opens its case; with all rows open axe knows of no violation."""
    from axe_playwright_python.sync_playwright import Axe

    desk = Page(browser, served, size, bypass_csp=True)
    page = desk.page
    desk.press(f"{name}-plan on the map")
    page.locator("#patrol-list li").first.wait_for(timeout=PATIENCE)
    violations = Axe().run(page).response["violations"]
    assert [(one["id"], [node["html"] for node in one["nodes"]][:3]) for one in violations] == []
    for tab in ("Finds and patrols", "Form"):
        desk.press(tab)
        for summary in page.locator("#form summary:visible").all():
            summary.click()
        violations = Axe().run(page).response["violations"]
        assert [
            (one["id"], [node["html"] for node in one["nodes"]][:3]) for one in violations
        ] == []
    desk.context.close()


def test_a_ship_and_her_track(browser: Any, served: Server) -> None:
    """A CSV file of the ship's fixes, dropped; then points, typed and clicked; then back to a search."""
    desk = Page(browser, served, "desktop")
    page = desk.page
    desk.press("New search")
    page.get_by_label("Adrift", exact=True).select_option("spill")
    page.get_by_label("Ship's track, with times").check()
    page.evaluate(DROP, SHIP)
    until(lambda: desk.tables().get("spill", {}).get("track") == "ais.csv", 60)
    assert (served.folder / "ais.csv").read_text() == SHIP
    type_into(desk, "Time", "280000ZNOV26")
    desk.press("Add a time of loss")
    page.locator('[data-own="spill.loss.0.begin"]').wait_for(timeout=PATIENCE)
    page.locator('[data-own="spill.loss.0.begin"]').fill("280030ZNOV26 to 280200ZNOV26")
    page.keyboard.press("Tab")
    until(lambda: len(desk.tables()["spill"]["loss"][0]["begin"]) == 2, 60)
    number_lost(desk, 0, "20", 20)
    page.get_by_label("Current", exact=True).select_option("constant")
    type_into(desk, "Current speed", "0.4 kn")
    type_into(desk, "Current toward, degrees true", "80")
    page.get_by_label("Wind", exact=True).select_option("constant")
    type_into(desk, "Wind speed", "22 kn")
    type_into(desk, "Wind from, degrees true", "340")
    page.locator("summary", has_text="280030ZNOV26 to 280300ZNOV26").wait_for(timeout=PATIENCE)
    drawn = """() => import("/assets/map.js").then(({ chart }) => chart.getLayers().getArray()
      .flatMap((one) => one.getSource().getFeatures()).map((one) => one.get("label")))"""
    assert {"ship's track", "280030ZNOV26 to 280300ZNOV26"} <= set(page.evaluate(drawn))
    # typed points take the place of the file
    page.get_by_label("The ship's track is").select_option("typed")
    until(lambda: "track" not in desk.tables()["spill"], 60)
    box = page.locator('textarea[data-own="spill.track"]')
    box.fill("53 30N 004 36E, 280000ZNOV26\n53 32N 005 06E, 280200ZNOV26")
    box.press("Tab")
    until(lambda: len(desk.tables()["spill"].get("track", [])) == 2, 60)
    desk.press("Where the ship was, with its times: one place a line: click on the map")
    click_at(desk, (5.6, 53.58))
    until(lambda: len(desk.tables()["spill"]["track"]) == 3, 60)
    page.locator("p.beside", has_text="the time is missing").wait_for(timeout=PATIENCE)
    page.get_by_label("Adrift", exact=True).select_option("search")
    page.locator("p.beside", has_text="a ship's track cannot").wait_for(timeout=PATIENCE)
    assert "spill" in desk.tables()
    assert desk.complaints == []
    desk.context.close()
