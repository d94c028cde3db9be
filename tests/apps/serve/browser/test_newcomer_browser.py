"""What misled somebody who had never seen the page, each in a real browser."""

import time
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
from desks import Server, until

pytestmark = pytest.mark.browser

PATIENCE = 60_000  # [ms] on a busy machine
CASE = """title = "a kayak"
start = 2017-04-21T18:30:00Z
duration = "24 h"
particles = 2000
[[scenario]]
name = "last known position"
object = "PERSON-POWERED-VESSEL-1"
position = { at = "50 02.2N 005 31.7W", error = "1 nmi" }
[[current]]
constant = { speed = "0.7 kn", toward = 75 }
[[wind]]
constant = { speed = "16 kn", from = 235 }
"""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("outer") / "cases"
    folder.mkdir()
    with Server(folder.resolve()) as one:
        yield one


@pytest.fixture
def page(browser: Any, served: Server) -> Iterator[Any]:
    """The page with a case open in the form."""
    (served.folder / "case.toml").write_text(CASE, encoding="utf-8")
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    page = context.new_page()
    page.set_default_timeout(PATIENCE)
    page.goto(f"http://{served.host}/?token={served.secret.token}")
    page.get_by_role("button", name="case.toml").click()
    until(lambda: page.get_by_label("Position", exact=True).input_value(), 60)
    yield page
    context.close()


def saved(served: Server) -> Any:
    return tomllib.loads((served.folder / "case.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("key", [False, True])
def test_the_field_typed_last_is_saved(page: Any, served: Server, key: bool) -> None:
    """However slowly the server writes it into the text."""

    def slowly(route: Any) -> None:
        time.sleep(1.2)  # [s]
        route.continue_()

    page.route("**/api/form/set", slowly)
    page.get_by_label("Forecast for").fill("31 h")
    if key:
        page.keyboard.press("Control+s")
    else:
        page.get_by_role("button", name="Save").click()
    page.locator("#said").get_by_text("Saved.").wait_for()
    assert saved(served)["duration"] == "31 h"
    assert "not saved" not in page.locator("#said").inner_text()


def test_a_field_that_cannot_be_read_stops_the_run(page: Any, served: Server) -> None:
    page.route("**/api/form/set", lambda route: route.fulfill(status=422, json={"error": "no"}))
    page.get_by_label("Forecast for").fill("31 h")
    page.get_by_role("button", name="Run the forecast").click()
    page.get_by_text("A field of the form cannot be read").wait_for()
    assert saved(served)["duration"] == "24 h"
    assert page.evaluate("fetch('/api/jobs').then(one => one.json())")["jobs"] == []
    page.get_by_role("button", name="Text", exact=True).click()  # what is typed there counts
    page.locator("#text").fill(CASE.replace("24 h", "30 h"))
    page.get_by_role("button", name="Save").click()
    page.locator("#said").get_by_text("Saved.").wait_for()
    assert saved(served)["duration"] == "30 h"


def test_a_plan_without_units_shows_where_to_add_one(page: Any, served: Server) -> None:
    """And no job begins. The new unit is open; as a helicopter it flies like one."""
    page.get_by_role("button", name="Plan the next search").click()
    page.get_by_text("A plan needs at least one unit").first.wait_for()
    assert page.evaluate("document.activeElement.id") == "add-unit"
    assert page.evaluate("fetch('/api/jobs').then(one => one.json())")["jobs"] == []
    page.get_by_role("button", name="Add a unit").click()
    speed = page.get_by_label("Search speed", exact=True)
    speed.wait_for()
    assert page.get_by_label("Base", exact=True).input_value() == ""
    page.get_by_text("base is missing").or_(
        page.get_by_text("is missing: type it")
    ).first.wait_for()
    page.get_by_label("Endurance on scene").fill("2 h 30 min")
    page.get_by_label("Is", exact=True).select_option("Helicopter")
    until(lambda: speed.input_value() == "90 kn", 60)
    assert page.get_by_label("Endurance on scene").input_value() == "2 h 30 min"  # it was typed


def test_a_tab_begins_at_its_top_with_the_object_in_sight(page: Any) -> None:
    assert page.evaluate(IN_SIGHT)
    page.locator("#panel").evaluate("one => { one.scrollTop = one.scrollHeight; }")
    page.get_by_role("button", name="Search", exact=True).click()
    assert page.locator("#panel").evaluate("one => one.scrollTop") == 0
    page.get_by_role("button", name="Form", exact=True).click()
    assert page.evaluate(IN_SIGHT)
    page.get_by_label("Find", exact=True).fill("kayak")
    page.get_by_role("button", name="Cases and results").click()
    page.get_by_role("button", name="New search").click()
    page.get_by_role("heading", name="search_").wait_for()
    assert page.get_by_label("Find", exact=True).input_value() == ""


IN_SIGHT = """() => {
  const list = document.getElementById("object");
  const [outer, inner] = [list, list.selectedOptions[0]].map((one) => one.getBoundingClientRect());
  return inner.height > 0 && inner.top >= outer.top && inner.bottom <= outer.bottom;
}"""


@pytest.mark.parametrize(("hours", "late"), [(30, True), (300, False), (20, False)])
def test_a_forecast_that_ended_before_now_is_marked(page: Any, hours: int, late: bool) -> None:
    """Of 24 hours, from so long ago; a case of the past is none of today's."""
    page.get_by_label("Time", exact=True).fill(
        page.evaluate(f"group(Date.now() / 1000 - {hours} * 3600)")
    )
    page.get_by_label("Title", exact=True).fill(f"{hours} h ago")
    page.get_by_label("Forecast for").focus()
    until(lambda: f"{hours} h ago" in page.locator("#text").input_value(), 60)
    told = page.locator("#ends")
    until(lambda: ("ago" in told.inner_text()) == late and "2017" not in told.inner_text(), 30)
    assert told.inner_text().startswith("to ")


def test_a_failed_run_names_the_field_of_the_form(page: Any) -> None:
    """Not the key of the text; the sentence below the title no longer says that it has started."""
    page.get_by_label("Forecast for").fill("inf")
    page.keyboard.press("Tab")
    page.locator("p.beside", has_text="inf").first.wait_for()
    page.get_by_role("button", name="Run the forecast").click()
    wrong = page.locator("#jobs .wrong").first
    wrong.wait_for()
    assert wrong.inner_text().startswith('"Forecast for" in the form: ')
    page.locator("#said").get_by_text("Forecast failed").wait_for()


def test_what_only_the_text_sets_is_said_in_words(page: Any) -> None:
    page.get_by_role("button", name="Text", exact=True).click()
    page.locator("#text").fill(f'output.every = "2 h"\n{page.locator("#text").input_value()}')
    page.get_by_role("button", name="Form", exact=True).click()
    told = page.locator("#unknown").get_by_text("The text also sets how often maps are made")
    told.wait_for()
