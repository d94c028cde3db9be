"""Two users and a guest at one desk, each in a browser of their own."""

from collections.abc import Iterator
from typing import Any

import pytest
import small_case
from desks import Server, until

import drift
from drift.apps.serve import users

pytestmark = pytest.mark.browser

PEOPLE = (users.User("ANNA"), users.User("BEN"), users.User("PRESS", guest=True))
SECONDS = 2  # within which others learn of a change


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("outer") / "cases"
    folder.mkdir()
    (folder / "case.toml").write_text(small_case.STEADY, encoding="utf-8")
    drift.run(drift.load(folder / "case.toml"), out=folder / "result")
    with Server(folder.resolve(), people=PEOPLE) as one:
        yield one


@pytest.fixture
def pages(browser: Any, served: Server) -> Iterator[list[Any]]:
    """The page of each, with the case open."""
    contexts = [browser.new_context() for _ in PEOPLE]
    opened = []
    for context, user in zip(contexts, PEOPLE, strict=True):
        page = context.new_page()
        page.goto(f"http://{served.host}/?token={user.token}")
        page.get_by_role("button", name="case.toml").click()
        page.get_by_role("heading", name="case.toml").wait_for()
        page.get_by_role("button", name="Text", exact=True).click()
        opened.append(page)
    yield opened
    for context in contexts:
        context.close()


def test_each_sees_what_the_others_do(served: Server, pages: list[Any]) -> None:
    anna, ben, press = pages
    text = anna.locator("#text").input_value()
    anna.locator("#text").fill(f"# by Anna\n{text}")
    ben.locator("#text").fill(f"# by Ben\n{text}")
    anna.wait_for_timeout(1600)  # all have asked once
    anna.get_by_role("button", name="Save").click()
    told = ben.locator("#news").get_by_text("ANNA saved case.toml")
    told.wait_for(timeout=1000 * (SECONDS + 3))  # some more on a busy machine
    ben.get_by_text("ANNA has saved another version").wait_for()
    ben.get_by_role("button", name="Save").click()
    ben.get_by_text("was changed in the meantime").wait_for()
    assert ben.locator("#text").input_value().startswith("# by Ben\n")  # nothing is lost
    assert (served.folder / "case.toml").read_text(encoding="utf-8").startswith("# by Anna\n")
    press.locator("#news").get_by_text("Somebody saved case.toml").wait_for()
    assert "ANNA" not in anna.locator("#news").inner_text()  # what one does oneself is no news
    ben.on("dialog", lambda dialog: dialog.accept())
    ben.get_by_role("button", name="Cases and results").click()
    ben.locator("#log-box summary").click()
    ben.locator("#log").get_by_text("ANNA saved case.toml").wait_for()


def test_a_guest_looks_only(pages: list[Any]) -> None:
    press = pages[2]
    press.get_by_text("PRESS, you are a guest").wait_for()
    for name in ("Save", "First map", "Run the forecast"):
        assert press.get_by_role("button", name=name).count() == 0
    assert press.evaluate("document.getElementById('text').readOnly")
    press.get_by_role("button", name="Cases and results").click()
    assert press.get_by_role("button", name="New search").count() == 0
    assert press.locator("#log-box").is_hidden()


def test_a_short_text(pages: list[Any]) -> None:
    """It is on the page, and in the clipboard if the browser lets it."""
    anna = pages[0]
    anna.context.grant_permissions(["clipboard-read", "clipboard-write"])
    anna.get_by_role("button", name="Cases and results").click()
    anna.get_by_role("button", name="Copy a short text about result").click()
    note = anna.locator("pre.note")
    until(lambda: note.inner_text(), 60)
    words = note.inner_text()
    assert "most likely" in words
    assert "50 % in " in words
    anna.get_by_text("Copied.").wait_for()
    assert anna.evaluate("navigator.clipboard.readText()").strip() == words.strip()
