"""A result on the map in a real browser: the first map that its run refines in place, scenarios, the
outline of the run before, layers, the slider that plays, and a file that is dropped.
"""

import io
import json
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from desk_cases import kayak, swimmer
from desks import Server, on_map, until

pytestmark = pytest.mark.browser

PATIENCE = 180_000  # [ms] on a busy machine
SIZE = {"width": 1400, "height": 950}
CASE = kayak("Kayak or swimmer", particles=3000, duration="8 h", every="2 h") + swimmer(
    "49 50.0N 005 48.0W", "0.7 nmi"
)
GPX = '<gpx version="1.1"><trk><trkseg><trkpt lat="49.93" lon="-5.62"><time>2026-11-28T14:40:00Z</time></trkpt><trkpt lat="49.93" lon="-5.52"><time>2026-11-28T15:00:00Z</time></trkpt></trkseg></trk></gpx>'
DROP = """([name, text]) => {
  const data = new DataTransfer();
  data.items.add(new File([text], name, { type: "application/gpx+xml" }));
  const dropped = new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true });
  document.querySelector("#map").dispatchEvent(dropped);
  return dropped.defaultPrevented; // else the browser would open the file
}"""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server for all tests here: the later ones have the results of the first."""
    folder = tmp_path_factory.mktemp("desk") / "cases"
    folder.mkdir()
    (folder / "two.toml").write_text(CASE, encoding="utf-8")
    (folder / "other.toml").write_text(CASE.replace("Kayak or", "Another"), encoding="utf-8")
    with Server(folder.resolve()) as one:
        yield one


class Desk:
    """A page of the server, and what the browser complains of."""

    def __init__(self, browser: Any, served: Server, **options: Any) -> None:
        self.context = browser.new_context(viewport=SIZE, **options)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.page.on(
            "console", lambda told: told.type == "error" and self.complaints.append(told.text)
        )
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(f"http://{served.host}/?token={served.secret.token}")

    def __enter__(self) -> "Desk":
        return self

    def __exit__(self, *_: object) -> None:
        self.context.close()

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).click()

    def shows(self, element: str, words: str | re.Pattern[str]) -> str:
        """Wait until an element has some words, and return all of them."""
        found = self.page.locator(element, has_text=words)
        found.wait_for(timeout=PATIENCE)
        return str(found.inner_text())

    def open(self, case: str) -> None:
        self.press(case)
        self.page.get_by_role("heading", name=case).wait_for()

    def view(self) -> Any:
        return on_map(self.page, "[...sea.view.getCenter(), sea.view.getResolution()]")

    def time(self) -> Any:
        return on_map(self.page, "sea.shown.times[sea.shown.index]")


def test_the_full_run_takes_the_place_of_the_first_map(browser: Any, served: Server) -> None:
    """View, time and layers stay; then a second run keeps the scenario and the run before too."""
    with Desk(browser, served) as desk:
        page = desk.page
        desk.open("two.toml")
        desk.press("Run the forecast")
        desk.shows("#headline", "First map, 10,000 particles")
        page.get_by_role("button", name="Earlier").click()
        page.locator("#layers summary").click()
        page.get_by_label("Particles").uncheck()
        on_map(page, "sea.view.adjustCenter([3000, -2000])")
        page.wait_for_timeout(100)
        view, time = desk.view(), desk.time()
        words = desk.shows("#changed", "this is its result")
        assert desk.shows("#headline", "Areas of two-forecast: At")
        # the same place to a mile or so, by 3,000 instead of 10,000 particles
        assert re.search(r"the most likely place (moved [\d.]+ nmi [\w-]+|has not moved)", words)
        assert re.search(r"the 50 % area is (still )?[\d.]+", words)
        assert desk.view() == view
        assert desk.time() == time
        assert on_map(page, "sea.shown.told.particles.lon.length") == 5
        assert page.locator("#at-work").is_hidden()
        # a scenario of it, then the next run
        page.locator("#story").select_option("swimmer")
        desk.shows("#headline", "Areas of two-forecast, if it is swimmer")
        assert desk.view() == view
        desk.press("Run the forecast")
        desk.shows("#headline", "First map, 10,000 particles")
        desk.shows("#changed", "this is its result")
        desk.shows("#headline", "Areas of two-forecast-2, if it is swimmer")
        assert page.locator("#story").input_value() == "swimmer"
        # the run before: its outline, and that nothing has changed since
        since = page.get_by_label("95 % area of the run before")
        assert "two-forecast" in page.locator("#since-line").inner_text()
        since.check()
        told = desk.shows("#since-words", "Since then: at")
        assert "the most likely place has not moved" in told
        outlines = """async () => {
          const { chart } = await import("/assets/map.js");
          const layer = chart.getLayers().getArray().find((one) => one.getZIndex() === 9);
          return layer.getSource().getFeatures().map((one) => one.getGeometry().getExtent());
        }"""
        extents = page.evaluate(outlines)
        features = json.loads((served.folder / "two-forecast" / "contours.geojson").read_text())
        now = on_map(page, "new Date(1000 * sea.shown.times[sea.shown.index]).toISOString()")[:19]
        lons = [
            lon
            for one in features["features"]
            if one["properties"]["level"] == 0.95 and one["properties"]["time"].startswith(now)
            for part in one["geometry"]["coordinates"]
            for lon, _ in part[0]
        ]
        metres = 6_371_000 * 3.141592653589793 / 180  # of a degree, within the map's own radius
        assert min(one[0] for one in extents) == pytest.approx(min(lons) * metres, rel=2e-3)
        assert max(one[2] for one in extents) == pytest.approx(max(lons) * metres, rel=2e-3)
        since.uncheck()
        assert page.evaluate(outlines) == []
        assert page.locator("#since-words").is_hidden()
        assert desk.complaints == []


def test_nothing_is_taken_from_under_the_user(browser: Any, served: Server) -> None:
    """With another case open when the run ends, a notice has a button; the map stays until then."""
    with Desk(browser, served) as desk:
        page = desk.page
        desk.open("two.toml")
        desk.press("Run the forecast")
        desk.shows("#headline", "First map, 10,000 particles")
        page.get_by_role("button", name="Cases and results").click()
        desk.open("other.toml")
        desk.shows("#changed", "The full run of two.toml has ended.")
        assert on_map(page, "sea.shown.told") is None
        page.get_by_role("button", name="Show it on the map").focus()
        page.keyboard.press("Enter")
        desk.shows("#headline", re.compile(r"Areas of two-forecast-\d: At"))
        assert page.locator("#changed").inner_text() == ""
        assert desk.complaints == []


def test_scenarios_layers_and_play(browser: Any, served: Server) -> None:
    """By keyboard: a scenario's areas, each layer off and on, and the slider that plays."""
    with Desk(browser, served, reduced_motion="reduce") as desk:
        page = desk.page
        page.get_by_role("button", name="two-forecast on the map").click()
        desk.shows("#headline", "Areas of two-forecast: At")
        options = page.locator("#story option").all_inner_texts()
        assert [one.split(" (")[0] for one in options] == [
            "all, each as likely as it is", "only kayak", "only swimmer",
        ]  # fmt: skip
        west = "sea.shown.areas.every.map((one) => one.getGeometry().getExtent()[0])"
        both = on_map(page, west)
        page.locator("#story").select_option("kayak")
        desk.shows("#headline", "if it is kayak")
        assert min(on_map(page, west)) > min(both)  # the swimmer is to the west of the kayak
        page.locator("#story").select_option("")
        desk.shows("#headline", "Areas of two-forecast: At")
        assert on_map(page, west) == both
        hidden = "sea.chart.getLayers().getArray().filter((one) => !one.getVisible()).length"
        page.locator("#layers summary").focus()
        page.keyboard.press("Enter")
        for box in page.locator("[data-layer]").all():
            box.focus()
            page.keyboard.press("Space")
            assert on_map(page, hidden) >= 1
            page.keyboard.press("Space")
            assert on_map(page, hidden) == 0
        # calm motion: each time for two seconds, and the last one is the end
        page.locator("#slider").focus()
        page.keyboard.press("End")
        page.keyboard.press("ArrowLeft")
        page.locator("#play").focus()
        page.keyboard.press("Enter")
        assert page.locator("#play").inner_text() == "Pause"
        assert page.locator("#now").get_attribute("aria-live") == "off"
        until(lambda: page.locator("#play").inner_text() == "Play", 30)
        assert on_map(page, "sea.shown.index") == 4
        page.locator("#play").click()  # from the end: again from the start
        assert on_map(page, "sea.shown.index") == 0
        page.locator("#play").click()
        assert page.locator("#play").get_attribute("aria-pressed") == "false"
        assert desk.complaints == []


def test_export_and_a_dropped_file(browser: Any, served: Server) -> None:
    """One file to mail, with its size before it is saved; a GPX file becomes a sortie."""
    from axe_playwright_python.sync_playwright import Axe

    with Desk(browser, served, bypass_csp=True) as desk:
        page = desk.page
        desk.open("two.toml")
        page.get_by_role("button", name="Cases and results").click()
        page.get_by_role("button", name="two-forecast on the map").click()
        desk.shows("#headline", "Areas of two-forecast: At")
        page.locator("#export-box summary").click()
        page.locator("#layers summary").click()
        made = page.locator("#export")
        made.get_by_role("button", name="Make the file").click()
        link = made.get_by_role("link", name="Save two-forecast.zip")
        link.wait_for(timeout=PATIENCE)
        with page.expect_download(timeout=PATIENCE) as saved:
            link.click()
        content = Path(saved.value.path()).read_bytes()
        assert saved.value.suggested_filename == "two-forecast.zip"
        size = (
            f"{len(content) / 1e6:.1f} MB"
            if len(content) >= 1e6
            else f"{len(content) / 1e3:.0f} kB"
        )
        assert size in made.inner_text()
        names = zipfile.ZipFile(io.BytesIO(content)).namelist()
        assert {"report.html", "summary.txt", "case.toml", "forecast.kml"} <= set(names)
        violations = Axe().run(page).response["violations"]
        assert [(one["id"], [n["html"] for n in one["nodes"]][:3]) for one in violations] == []
        assert page.evaluate(DROP, ["sweep.txt", "x"])
        desk.shows("#trouble", "sweep.txt is no track: only GPX files")
        assert page.evaluate(DROP, ["sweep.gpx", GPX])
        until(lambda: 'track = "sweep.gpx"' in page.locator("#text").input_value(), 60)
        assert (served.folder / "sweep.gpx").read_text(encoding="utf-8") == GPX
        # nothing is replaced: the same name again is rejected
        assert page.evaluate(DROP, ["sweep.gpx", GPX + " "])
        page.get_by_text("sweep.gpx exists already").wait_for(timeout=PATIENCE)
        assert (served.folder / "sweep.gpx").read_text(encoding="utf-8") == GPX
