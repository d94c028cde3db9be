"""The pictures of the page in docs/serve.md: each screen is reached, and shows what its text says.

    DRIFT_SCREENS=1 pytest -m browser tests/apps/serve/browser/test_screens_browser.py

writes the pictures into docs/screens again. Without it nothing is written: the test holds that each
screen can still be reached, and that docs/serve.md has a picture of each, which is small.
"""

import io
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from desk_cases import kayak, swimmer
from desks import Server
from PIL import Image

pytestmark = pytest.mark.browser

DOCS = Path(__file__).parents[4] / "docs"
PICTURES = DOCS / "screens"
LARGEST = 150_000  # [bytes] of a picture
PATIENCE = 180_000  # [ms] on a busy machine
SIZES = {"desktop": {"width": 1280, "height": 800}, "phone": {"width": 390, "height": 844}}
COLOURS = 128  # of a picture
SCREENS = ("cases", "form", "first-map", "result", "search", "plan", "text", "phone")

CASE = f"""{kayak("Kayak or raft overdue", particles=30_000, duration="16 h", every="2 h")}
{swimmer("49 56.0N 005 36.0W", "1.5 nmi")}
[[sortie]]
name = "lifeboat"
start = "+4 h"
speed = "14 kn"
sweep_width = "0.4 nmi"
pattern = {{ kind = "parallel", centre = "49 57N 005 30W", length = "6 nmi", width = "3 nmi", orientation = 75, spacing = "0.5 nmi" }}

[[unit]]
name = "helicopter"
base = "50 06N 005 32W"
ready = "+7 h"
transit_speed = "90 kn"
search_speed = "60 kn"
endurance = "2 h"
daylight = false
sweep_width = "0.4 nmi"

[plan]
begin = "+8 h"
until = "+12 h"
"""


class Screens:
    """The page in a window, whose screens are kept as pictures."""

    def __init__(self, browser: Any, served: Server, size: str) -> None:
        self.context = browser.new_context(viewport=SIZES[size], reduced_motion="reduce")
        self.page = self.context.new_page()
        self.kept: list[str] = []
        self.page.goto(f"http://{served.host}/?token={served.secret.token}")

    def press(self, name: str, exact: bool = True) -> None:
        self.page.get_by_role("button", name=name, exact=exact).click()

    def keep(self, name: str) -> None:
        """Keep what is shown as a picture of the documentation, if these are written."""
        self.page.wait_for_timeout(600)  # until the map is drawn
        self.kept.append(name)
        picture = Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")
        few = picture.quantize(COLOURS, dither=Image.Dither.NONE)
        if os.environ.get("DRIFT_SCREENS"):
            PICTURES.mkdir(exist_ok=True)
            few.save(PICTURES / f"{name}.png", optimize=True)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    folder = tmp_path / "incident"
    folder.mkdir()
    (folder / "overdue.toml").write_text(CASE, encoding="utf-8")
    with Server(folder.resolve()) as one:
        yield one


def test_each_screen_is_reached(browser: Any, served: Server) -> None:
    """In the order of docs/serve.md, on a desktop, and the result on a phone."""
    desk = Screens(browser, served, "desktop")
    page = desk.page
    desk.press("overdue.toml")
    page.get_by_role("heading", name="overdue.toml").wait_for()
    desk.press("Run the forecast")
    page.locator("#headline", has_text="First map, 10,000 particles").wait_for(timeout=PATIENCE)
    page.locator("#at-work", has_text="The full run is at work").wait_for(timeout=PATIENCE)
    desk.keep("first-map")
    page.locator("#changed", has_text="this is its result").wait_for(timeout=PATIENCE)
    desk.press("Run the forecast")
    page.locator("#at-work", has_text="The full run is at work").wait_for(timeout=PATIENCE)
    page.locator("#changed", has_text="this is its result").wait_for(timeout=PATIENCE)
    page.get_by_label("95 % area of the run before").check()
    page.get_by_text("Since then: at").wait_for(timeout=PATIENCE)
    page.locator("#layers summary").click()
    desk.keep("result")
    page.locator("#layers summary").click()
    page.get_by_label("95 % area of the run before").uncheck()
    desk.press("Form")
    desk.keep("form")
    desk.press("Search")
    page.get_by_role("list", name="Sorties").get_by_text("lifeboat").first.wait_for(
        timeout=PATIENCE
    )
    desk.keep("search")
    desk.press("Plan the next search")
    page.locator("#plan-said", has_text="Ready").wait_for(timeout=PATIENCE)
    desk.keep("plan")
    desk.press("Check")
    page.get_by_role("heading", name="Valid").wait_for(timeout=PATIENCE)
    desk.keep("text")
    desk.press("Cases and results")
    page.locator("#runs").get_by_text("overdue-plan").first.wait_for(timeout=PATIENCE)
    desk.keep("cases")
    phone = Screens(browser, served, "phone")
    phone.press("overdue-forecast on the map")
    phone.page.locator("#headline", has_text="most likely").wait_for(timeout=PATIENCE)
    phone.keep("phone")
    assert sorted(desk.kept + phone.kept) == sorted(SCREENS)
    desk.context.close()
    phone.context.close()


def test_the_page_of_the_documentation_has_a_picture_of_each_screen() -> None:
    text = (DOCS / "serve.md").read_text(encoding="utf-8")
    shown = re.findall(r"!\[[^\]]+\]\(screens/([\w-]+)\.png\)", text)
    assert sorted(shown) == sorted(SCREENS)
    assert sorted(one.stem for one in PICTURES.iterdir()) == sorted(SCREENS)
    for one in PICTURES.iterdir():
        assert one.stat().st_size < LARGEST, one.name
        with Image.open(one) as picture:
            size = SIZES["phone" if one.stem == "phone" else "desktop"]
            assert picture.size == (size["width"], size["height"])
