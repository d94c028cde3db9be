"""Markup in all names that a user can give, as a second user sees them in a real browser."""

from collections.abc import Iterator
from typing import Any

import pytest
import trial_case
from desks import Server

import drift
from drift.apps.serve import users

pytestmark = pytest.mark.browser

PATIENCE = 60_000  # [ms] on a busy machine
MARKUP = "<img src=x onerror=\"document.title='hit'\">"
PEOPLE = (users.User(f"ANNA{MARKUP}"), users.User("BEN"))  # the command line takes no such name
UNIT = {
    "name": MARKUP,
    "base": "27 50N 088 10W",
    "search_speed": "14 kn",
    "endurance": "4 h",
    "sweep_width": "0.5 nmi",
}
SORTIE = {
    "name": f"sortie {MARKUP}",
    "start": "+1 h",
    "end": "+2 h",
    "speed": "90 kn",
    "sweep_width": "0.4 nmi",
    "area": {"centre": "27 30N 088 00W", "length": "6 nmi", "width": "3 nmi", "orientation": 20},
}
CONTACT = {
    "name": f"contact {MARKUP}",
    "time": "+3 h",
    "position": {"at": "27 30N 087 58W", "error": "2 nmi"},
}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("outer") / "cases"
    folder.mkdir()
    scenarios = [
        {**trial_case.RAFT, "name": name, "weight": 0.5} for name in (f"raft {MARKUP}", "other")
    ]
    path = trial_case.write(
        folder,
        title=f"title {MARKUP}",
        scenario=scenarios,
        sortie=[SORTIE],
        contact=[CONTACT],
        unit=[UNIT],
    )
    drift.run(drift.load(path), out=folder / "case-forecast")
    with Server(folder.resolve(), people=PEOPLE) as one:
        yield one


def test_names_are_text_everywhere(browser: Any, served: Server) -> None:
    """News, log, lists, rows, labels, choices, the short text and the report: no element is made
    of a name, and no script of it runs.
    """
    contexts = [browser.new_context(viewport={"width": 1440, "height": 900}) for _ in PEOPLE]
    anna, ben = (context.new_page() for context in contexts)
    for page, user in zip((anna, ben), PEOPLE, strict=True):
        page.set_default_timeout(PATIENCE)
        page.goto(f"http://{served.host}/?token={user.token}")
        page.get_by_role("button", name="case.toml").click()
        page.get_by_role("heading", name="case.toml").wait_for()

    def harmless(page: Any) -> None:
        assert page.locator('img[src="x"]').count() == 0
        assert page.title() != "hit"

    ben.wait_for_timeout(1600)  # has asked for news once
    anna.get_by_role("button", name="Text", exact=True).click()
    anna.locator("#text").fill(f"# by Anna\n{anna.locator('#text').input_value()}")
    anna.get_by_role("button", name="Save").click()
    ben.locator("#news").get_by_text(f"ANNA{MARKUP} saved case.toml").wait_for()
    ben.get_by_role("button", name="Cases and results").click()
    ben.get_by_text("Log: who did what").click()
    ben.locator("#log").get_by_text(MARKUP).first.wait_for()
    ben.get_by_role("button", name="case-forecast on the map").click()
    ben.locator("#story option", has_text=MARKUP).first.wait_for(state="attached")
    ben.get_by_role("button", name="Form", exact=True).click()
    ben.locator("#scenario option", has_text=MARKUP).first.wait_for(state="attached")
    ben.get_by_role("button", name="Search", exact=True).click()
    for rows in ("#sortie-rows", "#contact-rows", "#unit-rows"):
        ben.locator(rows).get_by_text(MARKUP).first.wait_for()
    harmless(ben)
    ben.get_by_role("button", name="Cases and results").click()
    ben.get_by_role("button", name="Copy a short text").first.click()
    ben.locator("pre.note", has_text=MARKUP).wait_for()
    harmless(ben)
    with contexts[1].expect_page() as opened:
        ben.get_by_role("link", name=f"title {MARKUP}").click()
    report = opened.value
    report.get_by_role("heading", name=MARKUP).first.wait_for()
    harmless(report)
    harmless(anna)
    for context in contexts:
        context.close()
