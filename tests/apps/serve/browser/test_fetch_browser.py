"""Winds and currents from a provider, in a real browser: the size, the download, the forecast's text."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hostile
import netCDF4
import pytest
from desk_pages import PATIENCE, Page
from desks import Server, until
from ocean_servers import AXES, TABLE, ocean

pytestmark = pytest.mark.browser

CASE = """title = "a raft" # as called in
start = "2024-03-01T06:00Z"
duration = "7 h"
particles = 500
coast.source = "none"
[[scenario]]
name = "raft"
object = "PIW-1"
position = { at = "37 24N 001 18E", error = "1 nmi" }
"""


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """A desk whose user has a catalogue with a provider on this machine."""
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "raft.toml").write_text(CASE, encoding="utf-8")
    own = tmp_path / "config" / "casp-drift"
    own.mkdir(parents=True)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    lon, lat, _ = AXES["plain"]
    with hostile.serving(hostile.speaking_dap(ocean(lon, lat))) as address:
        (own / "providers.toml").write_text(
            TABLE.format(address=address, protocol="opendap"), encoding="utf-8"
        )
        with Server((tmp_path / "cases").resolve()) as one:
            yield one


BOX = """(look) => import("/assets/map.js").then((sea) => {
  const layers = sea.chart.getLayers().getArray().filter((one) => one.getVisible() && one.getSource()?.getFeatures);
  const found = layers.flatMap((one) => one.getSource().getFeatures()).find((one) => one.get("look") === look && one.get("box"));
  if (!found) return null;
  const [x0, y0, x1, y1] = found.getGeometry().getExtent();
  return [...sea.map.inverse([x0, y0]), ...sea.map.inverse([x1, y1])];
})"""  # west, south, east, north [deg] of a box on the map


def test_a_current_is_fetched(browser: Any, served: Server) -> None:
    """By the keyboard; the size comes first, and the files stand in the form at the end."""
    from axe_playwright_python.sync_playwright import Axe

    desk = Page(browser, served, "desktop", bypass_csp=True)
    page = desk.page
    page.set_default_timeout(PATIENCE)
    page.get_by_role("button", name="raft.toml").click()
    until(lambda: page.get_by_label("Position", exact=True).input_value(), 60)
    box = page.locator("#fetch-box > summary")
    box.focus()
    page.keyboard.press("Enter")
    page.get_by_label("Wind from", exact=True).select_option("")  # the provider has currents
    page.get_by_label("Current from", exact=True).select_option("trial")
    assert not (served.folder / "raft-forcing").exists()
    page.get_by_role("button", name="How much is it?").press("Enter")
    fetch = page.get_by_role("button", name="Fetch them")
    fetch.wait_for()
    assert "trial" in page.get_by_role("region", name="What would be downloaded").inner_text()
    assert not (served.folder / "raft-forcing").exists()  # nothing yet but its size
    violations = Axe().run(page).response["violations"]
    assert [(one["id"], [node["html"] for node in one["nodes"]][:3]) for one in violations] == []
    fetch.press("Enter")
    page.locator("#said").get_by_text("now reads the files in raft-forcing").wait_for()
    assert list((served.folder / "raft-forcing").glob("current-trial-*.nc"))
    current = tomllib.loads(page.locator("#text").input_value())["current"]
    assert current[0]["files"] == "raft-forcing/current-trial-*.nc"
    assert "# as called in" in page.locator("#text").input_value()
    assert page.get_by_label("Current", exact=True).input_value() == "files"
    ticked = page.locator("[data-rows=current] input:checked")
    assert ticked.get_attribute("value") == "raft-forcing/current-trial-*.nc"
    page.locator("[data-rows=current] small").get_by_text("current, 010").wait_for()
    # the map has the box of the files, and that of the run
    (path,) = (served.folder / "raft-forcing").glob("current-trial-*.nc")
    with netCDF4.Dataset(path) as data:
        lon, lat = data["lon"][:], data["lat"][:]
    expected = [lon.min(), lat.min(), lon.max(), lat.max()]
    until(lambda: page.evaluate(BOX, "covers_current"), 60)
    assert page.evaluate(BOX, "covers_current") == pytest.approx(expected, abs=1e-6)
    text = page.locator("#text").input_value()
    box = served.json("POST", "/api/domain", {"text": text, "name": "raft.toml"})["box"]
    assert page.evaluate(BOX, "domain") == pytest.approx(box, abs=1e-6)
    assert expected[0] < box[0] < 1.3 < box[2] < expected[2]  # so much was fetched
    page.locator("#layers > summary").click()
    page.get_by_label("Domain of the run").uncheck()
    assert page.evaluate(BOX, "domain") is None
    assert page.evaluate(BOX, "covers_current") is not None
    assert desk.outside == []
    desk.context.close()
