"""report.html in a real browser, Chromium without a window: what it shows against forecast.nc and
cartopy's projections.
"""

import re
from pathlib import Path
from typing import Any

import cartopy.crs as ccrs
import numpy as np
import pytest
import xarray as xr
from opened_report import GLOBE, Opened, middle, ran

import drift
from drift.pipeline import flow
from geo import notation

pytestmark = pytest.mark.browser
NASTY = "</script><img src=x onerror=alert(1)>"
# Off Taveuni, whose middle 180 degrees crosses: two scenarios, one with a hostile name, a sortie, a
# sighting.
SEAM = f"""
title = "Taveuni {NASTY}"
start = "160600ZNOV15"
duration = "18 h"
particles = 6000
seed = 5
[output]
every = "3 h"
[[current]]
constant = {{ speed = "0.7 kn", toward = 35 }}
[[wind]]
constant = {{ speed = "11 kn", from = 140 }}
[uncertainty]
current = {{ std = "0.15 m/s", time = "5 h" }}
wind = {{ std = "1.5 m/s", time = "6 h" }}
[[scenario]]
name = "raft {NASTY}"
weight = 0.7
object = "LIFE-RAFT-DB-11"
search_object = "Raft 4 person"
position = {{ at = [179.83, -17.35], error = "3 nmi" }}
[[scenario]]
name = "swimmer"
weight = 0.3
object = "PIW-1"
search_object = "Person in Water"
position = {{ at = [-179.95, -17.2], error = "2 nmi" }}
[[sortie]]
name = "first light"
start = "161700ZNOV15"
speed = "90 kn"
sweep_width = "0.5 nmi"
pattern = {{ kind = "parallel", centre = [179.97, -17.15], length = "20 nmi", width = "12 nmi", orientation = 30, spacing = "1 nmi" }}
[[contact]]
name = "strobe"
time = "161100ZNOV15"
position = {{ at = [179.95, -17.22], error = "4 nmi" }}
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("seam"), SEAM)


def test_it_opens_without_a_request_or_a_complaint(browser: Any, results: Path) -> None:
    """Names from the case are text, whatever they hold."""
    with Opened(browser, results) as opened:
        assert opened.asked == [(results / flow.REPORT).as_uri()]
        assert opened.complaints == []
        assert opened.page.locator("h1").inner_text() == f"Taveuni {NASTY}"
        assert opened.page.locator("img:not([src^='data:image/png;'])").count() == 0
        assert opened.page.locator("#story option").all_inner_texts() == [
            "All scenarios",
            f"raft {NASTY}",
            "swimmer",
        ]


def test_nothing_can_be_fetched(browser: Any, results: Path) -> None:
    """The page's own policy refuses even what needs no network, and scripts that are not its own."""
    with Opened(browser, results) as opened:
        refused = "fetch('data:,x').then(() => 'came', () => 'refused')"
        assert opened.page.evaluate(refused) == "refused"
        opened.page.evaluate(
            "document.body.append(Object.assign(document.createElement('script'), {textContent: 'window.run = 1'}))"
        )
        assert opened.page.evaluate("window.run") is None


def test_names_are_above_all_lines_and_go_with_their_layer(browser: Any, results: Path) -> None:
    with Opened(browser, results) as opened:
        order = """() => {
          const own = report.layers.filter(one => one.nameplates), of = one => one.getZIndex();
          return [Math.min(...own.map(one => of(one.nameplates))), Math.max(...report.layers.map(one => of(one.layer)))];
        }"""
        lowest_name, highest_line = opened.page.evaluate(order)
        assert lowest_name > highest_line
        shown = "report.layers.filter(one => one.nameplates && one.nameplates.getVisible() !== one.layer.getVisible()).length"
        assert opened.page.evaluate(shown) == 0
        opened.page.locator("#layers label", has_text="Sorties").click()
        visible = "report.layers.find(one => one.title === 'Sorties').nameplates.getVisible()"
        assert opened.page.evaluate(visible) is False


def test_the_slider_moves_through_the_outputs(browser: Any, results: Path) -> None:
    """By keys, by the buttons, by a row of the table, and by playing; what is told is track.csv's."""
    data = xr.open_dataset(results / "forecast.nc")
    groups = [notation.format_dtg(time) for time in data["time"].values]
    with Opened(browser, results) as opened:
        page = opened.page
        now = page.locator("#now")
        # It opens after the only sortie, which is neither the first output nor the last.
        assert now.inner_text().startswith(
            notation.format_dtg(drift.load(results.parent / "case.toml").sorties[0].end)
        )
        assert not now.inner_text().startswith((groups[0], groups[-1]))
        page.locator("#slider").focus()
        page.keyboard.press("Home")
        assert now.inner_text().startswith(groups[0])
        for expected in groups[1:4]:
            page.keyboard.press("ArrowRight")
            assert now.inner_text().startswith(expected)
        page.locator("#before").click()
        assert now.inner_text().startswith(groups[2])
        page.locator("tr[data-time]").nth(4).click()
        assert now.inner_text().startswith(groups[4])
        # The table's row is marked in a later frame of the browser than the heading is written.
        page.wait_for_function(
            "group => document.querySelector('tr.current th')?.innerText === group", arg=groups[4]
        )
        area = float(data["containment_area"].sel(share=0.95).values[4]) / 1852**2
        told = re.search(r"95 % area ([\d.,]+) nmi²", page.locator("#spoken").inner_text())
        assert float(told[1].replace(",", "")) == pytest.approx(area, rel=0.006)  # three digits
        page.locator("#play").click()
        page.wait_for_function("() => report.state.index !== 4", timeout=5000)
        page.locator("#play").click()
        assert page.locator("#play").get_attribute("aria-pressed") == "false"


def test_values_under_the_pointer(browser: Any, results: Path) -> None:
    """Position to a pixel, density to half a level and two digits, on both sides of 180 degrees."""
    data = xr.open_dataset(results / "forecast.nc")
    density = data["probability"].values / data["cell_area"].values * 1852**2
    rng = np.random.default_rng(1)
    sides = set()
    with Opened(browser, results) as opened:
        crs = ccrs.Mercator(central_longitude=middle(opened)["lon"], globe=GLOBE)
        pixel = (
            opened.page.evaluate("report.view.getResolution()") / 1852 * 1.2
        )  # [arc minutes], and of the tenths that are told
        for time in (1, 4, data.sizes["time"] - 1):
            opened.show(time)
            rows, columns = np.nonzero(density[time] > 0.02 * density[time].max())
            for k in rng.choice(len(rows), 6, replace=False):
                lon, lat = float(data["lon"][columns[k]]), float(data["lat"][rows[k]])
                text = opened.read(lon, lat, crs)
                sides.add(re.match(r"\S+ \S+([EW])", text)[1])
                degrees = re.match(r"(\d+)-([\d.]+)([NS]) (\d+)-([\d.]+)([EW])", text).groups()
                told_lat = (int(degrees[0]) + float(degrees[1]) / 60) * (
                    1 if degrees[2] == "N" else -1
                )
                told_lon = (int(degrees[3]) + float(degrees[4]) / 60) * (
                    1 if degrees[5] == "E" else -1
                )
                assert abs(told_lat - lat) * 60 <= 0.05 + pixel
                assert abs((told_lon - lon + 180) % 360 - 180) * 60 <= 0.05 + pixel
                value = float(re.search(r"([\d.e-]+) % per nmi²", text)[1])
                around = (
                    density[
                        time,
                        max(rows[k] - 1, 0) : rows[k] + 2,
                        max(columns[k] - 1, 0) : columns[k] + 2,
                    ]
                    * 100
                )
                # Half a level and half a digit of two; the pointer is on a whole pixel, perhaps in
                # the next cell.
                assert (
                    around.min() * (1 - 0.0233 - 0.05)
                    <= value
                    <= around.max() * (1 + 0.0233 + 0.05)
                )
    assert sides == {"E", "W"}


def test_layers_can_be_switched(browser: Any, results: Path) -> None:
    """Each changes the picture, and the sample's tracks come when they are asked for."""
    with Opened(browser, results) as opened:
        page = opened.page
        opened.show(page.evaluate("report.times.length") - 1)
        titles = page.locator("#layers label").all_inner_texts()
        assert titles[:2] == ["Probability", "Areas"]
        for wanted in (
            "Tracks of a sample",
            "Where it began",
            "Current",
            "Wind",
            "Sorties",
            "Legs flown",
            "Contacts",
        ):
            assert wanted in titles
        # of which none need lie in view
        for title in (one for one in titles if one != "Towns and harbours"):
            before = page.locator("#map").screenshot()
            page.locator("#layers label", has_text=re.compile(f"^{title}$")).locator(
                "input"
            ).click()
            page.wait_for_timeout(250)
            assert page.locator("#map").screenshot() != before, title


def test_sorties_and_contacts_come_when_they_come(browser: Any, results: Path) -> None:
    with Opened(browser, results) as opened:
        there = "title => report.layers.find(one => one.title === title).layer.getSource().getFeatures().length"
        opened.show(0)
        assert opened.page.evaluate(there, "Sorties") == 0
        assert opened.page.evaluate(there, "Contacts") == 0
        last = opened.page.evaluate("report.times.length") - 1
        opened.show(last)
        assert opened.page.evaluate(there, "Sorties") == 1
        assert opened.page.evaluate(there, "Contacts") == 2  # the fix and its region


def test_a_keyboard_is_enough(browser: Any, results: Path) -> None:
    """The map takes the focus; Enter tells what is at its middle, arrow keys move it."""
    with Opened(browser, results) as opened:
        page = opened.page
        page.locator("#map").focus()
        page.keyboard.press("Enter")
        here = page.locator("#readout").inner_text()
        assert re.match(r"\d\d-\d\d\.\d[NS] \d{3}-\d\d\.\d[EW]", here)
        page.keyboard.press("ArrowUp")
        page.wait_for_timeout(700)
        assert page.locator("#readout").inner_text() != here


def test_files_can_be_saved_from_it(browser: Any, results: Path) -> None:
    with Opened(browser, results) as opened:
        for name in ("contours.geojson", "sorties.csv"):
            with opened.page.expect_download() as saved:
                opened.page.get_by_role("button", name=f"Save {name}").click()
            assert Path(saved.value.path()).read_bytes() == (results / name).read_bytes()
        assert (
            opened.page.get_by_role("link", name="forecast.nc").get_attribute("href")
            == "forecast.nc"
        )


def test_on_a_phone_and_in_the_dark(browser: Any, results: Path) -> None:
    with Opened(
        browser, results, viewport={"width": 360, "height": 740}, color_scheme="dark"
    ) as opened:
        assert opened.page.evaluate("document.documentElement.scrollWidth") <= 360
        assert (
            opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
            == "rgb(20, 25, 31)"
        )
        opened.page.locator("#theme").click()  # light, whatever the system says
        assert (
            opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
            == "rgb(255, 255, 255)"
        )


@pytest.mark.parametrize("colours", ["light", "dark"])
def test_accessibility(browser: Any, results: Path, colours: str) -> None:
    """By axe-core's rules (WCAG 2.1 A and AA among them)."""
    from axe_playwright_python.sync_playwright import Axe

    with Opened(browser, results, color_scheme=colours, bypass_csp=True) as opened:
        opened.page.evaluate(
            "document.querySelectorAll('details').forEach(one => { one.open = true; })"
        )
        found = Axe().run(opened.page)
        assert [
            (v["id"], [n["html"] for n in v["nodes"]][:2]) for v in found.response["violations"]
        ] == []


def test_one_file_shows_headline_and_pictures_and_what_a_planner_reads_first(
    browser: Any, results: Path, tmp_path: Path
) -> None:
    """The page alone, as it comes by mail."""
    alone = tmp_path / "mailed"
    alone.mkdir()
    (alone / flow.REPORT).write_bytes((results / flow.REPORT).read_bytes())
    names = sorted(path.name for path in results.glob("*.png"))
    with Opened(browser, alone) as opened:
        words = opened.page.locator("#headline").inner_text()
        assert re.match(r"At 16\d{4}ZNOV15 it is most likely near 17-\d\d\.\dS 17\d-", words)
        assert "with a probability of" in words
        images = opened.page.locator("#pictures img")
        assert images.count() == len(names) > 3
        for k, name in enumerate(names):
            images.nth(k).scroll_into_view_if_needed()
            opened.page.wait_for_function(
                "k => document.querySelectorAll('#pictures img')[k].naturalWidth > 300", arg=k
            )
            assert images.nth(k).get_attribute("alt") == name
        unfolded = opened.page.locator("details[open] > summary").all_inner_texts()
        assert unfolded == ["By time", "Sorties, contacts and sensors"]
        assert not opened.complaints
