"""A report opened in Chromium: what it shows, asks for and complains of."""

from pathlib import Path
from typing import Any

import cartopy.crs as ccrs

import drift
from drift.pipeline import flow
from geo import sphere

GLOBE = ccrs.Globe(semimajor_axis=sphere.RADIUS, semiminor_axis=sphere.RADIUS, ellipse=None)


def ran(folder: Path, text: str) -> Path:
    """Return the folder of the results of a case."""
    (folder / "case.toml").write_text(text, encoding="utf-8")
    drift.run(drift.load(folder / "case.toml"), folder / "results")
    return folder / "results"


class Opened:
    """A page that has drawn itself, what it asked for, and what it complained of."""

    def __init__(self, browser: Any, folder: Path, **options: Any) -> None:
        self.context = browser.new_context(
            **{"viewport": {"width": 1200, "height": 900}, **options}
        )
        self.page, self.asked, self.complaints = self.context.new_page(), [], []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("console", self._heard)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto((folder / flow.REPORT).as_uri())
        self.page.wait_for_selector("html[data-ready=yes]", timeout=30_000)

    def _heard(self, message: Any) -> None:
        # advice on how OpenLayers looks for shapes under the pointer
        if "willReadFrequently" not in message.text:
            self.complaints.append(message.text)

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.context.close()

    def show(self, index: int) -> None:
        self.page.evaluate("k => report.show(k)", index)

    def read(self, lon: float, lat: float, crs: Any) -> str:
        """Return what the page tells with the pointer over a position [deg], which another library
        projects.
        """
        x, y = crs.transform_point(lon, lat, ccrs.Geodetic(globe=GLOBE))
        px, py = self.page.evaluate("at => report.chart.getPixelFromCoordinate(at)", [x, y])
        box = self.page.locator("#map").bounding_box()
        self.page.mouse.move(box["x"] + px, box["y"] + py)
        return str(self.page.locator("#readout").inner_text())


def middle(opened: Opened) -> dict[str, float]:
    return dict(
        opened.page.evaluate("JSON.parse(document.getElementById('data').textContent).projection")
    )
