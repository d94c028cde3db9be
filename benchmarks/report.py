"""report.html of every shipped case: its size, seconds to write it, to its first picture in
Chromium, and frames a second.

    python benchmarks/report.py [CASE ...]

Needs Chromium and the extra `browser`; cases whose forcing is not there are left out.
"""

import argparse
import shutil
import tempfile
import time
from pathlib import Path
from unittest import mock

import smallest

import drift
from drift.case import file as case_file
from drift.pipeline import flow
from drift.products.maps import page as maps_page
from geo.errors import UserError

PLAY = """async () => {
    for (let k = 0; k < report.times.length; k++) await report.show(k);
    const begun = performance.now(), rounds = Math.max(1, Math.round(40 / report.times.length));
    for (let round = 0; round < rounds; round++) for (let k = 0; k < report.times.length; k++) await report.show(k);
    return 1000 * rounds * report.times.length / (performance.now() - begun);
}"""


def written(name: str, folder: Path) -> float:
    """Run a case, and return the seconds that its report took, the leaves of all topics included."""
    begun = []

    def noted(draw: object) -> object:
        def timed(path: Path) -> None:
            begun.append(time.perf_counter())
            draw(path)
            begun.append(time.perf_counter())

        return timed

    with mock.patch.object(maps_page, "warn_on_failure", noted):
        drift.run(drift.load(name), folder)
    return begun[-1] - begun[-2]  # it is made last


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", default=[name for name, _ in case_file.shipped()])
    cases = smallest.parse(parser, cases=[str(smallest.CASE)]).cases
    chromium = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if chromium is None:
        smallest.lack("no Chromium")
    smallest.need("playwright")
    from playwright.sync_api import sync_playwright

    print(
        f"{'case':<20}{'outputs':>8}{'MB':>7}{'write, s':>10}{'open, s':>9}{'frames/s':>10}{'requests':>10}{'complaints':>12}"
    )
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as place:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for given in cases:
            name = Path(given).stem
            folder = Path(place, name)
            try:
                took = written(given, folder)
            except UserError as error:
                print(f"{name:<20}  {str(error)[:90]}")
                continue
            path, asked, said = folder / flow.REPORT, [], []
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            page.on("request", lambda request, asked=asked: asked.append(request.url))
            page.on("pageerror", lambda error, said=said: said.append(str(error)))
            begun = time.perf_counter()
            page.goto(path.as_uri())
            page.wait_for_selector("html[data-ready=yes]", timeout=60_000)
            opened = time.perf_counter() - begun
            frames = page.evaluate(PLAY)
            outputs = page.evaluate("report.times.length")
            size = path.stat().st_size / 1e6
            print(
                f"{name:<20}{outputs:>8}{size:>7.2f}{took:>10.2f}{opened:>9.2f}{frames:>10.1f}{len(asked) - 1:>10}{len(said):>12}"
            )
            page.close()


if __name__ == "__main__":
    main()
