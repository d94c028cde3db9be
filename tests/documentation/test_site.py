"""The site builds without a warning, its links lead somewhere, and its pages ask nobody for
anything.
"""

import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from places import ROOT

pytestmark = [pytest.mark.documentation, pytest.mark.timeout(1800)]

ASKED = {
    ("script", "src"),
    ("img", "src"),
    ("link", "href"),
    ("iframe", "src"),
    ("source", "src"),
    ("video", "src"),
}
# links that no browser fetches
QUIET = {"canonical", "search", "next", "prev", "index", "genindex", "alternate"}


class Page(HTMLParser):
    """The addresses and anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.asked: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.anchors |= {value for key in ("id", "name") if (value := given.get(key))}
        if tag == "a" and given.get("href"):
            self.links.append(str(given["href"]))
        for key in ("src", "href"):
            if (
                (tag, key) in ASKED
                and given.get(key)
                and not set(str(given.get("rel")).split()) & QUIET
            ):
                self.asked.append(str(given[key]))


@pytest.fixture(scope="module")
def site() -> Path:
    """Build the site into build/site, warnings taken as errors."""
    out = ROOT / "build" / "site"
    shutil.rmtree(out, ignore_errors=True)
    words = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        "html",
        "docs",
        str(out),
    ]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=1500)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    """The pages, but for the reports of runs, which have a test of their own in tests/report."""
    found = [path for path in site.rglob("*.html") if path.parent.name != "reports"]
    return {path: Page(path.read_text(encoding="utf-8")) for path in found}


def test_links_lead_somewhere(site: Path, pages: dict[Path, Page], capsys: Any) -> None:
    """To a file of the site, and to an anchor that the page has."""
    broken, inside, outside = [], 0, set()
    for path, page in pages.items():
        for link in [*page.links, *page.asked]:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                outside.add(link)
                continue
            inside += 1
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_file():
                broken.append(f"{path.relative_to(site)}: {link}")
            elif (
                parts.fragment
                and target in pages
                and unquote(parts.fragment) not in pages[target].anchors
            ):
                broken.append(f"{path.relative_to(site)}: no anchor {link}")
    with capsys.disabled():
        print(f"\n{len(pages)} pages, {inside} links inside, {len(outside)} addresses outside")
    assert not broken


def test_outside_addresses_are_well_formed(pages: dict[Path, Page]) -> None:
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            assert parts.scheme in ("", "http", "https", "mailto"), (path, link)
            assert not parts.scheme or parts.scheme == "mailto" or "." in parts.netloc, (path, link)


def test_pages_ask_nobody(pages: dict[Path, Page], site: Path) -> None:
    """No script, style, font or picture comes from elsewhere."""
    for path, page in pages.items():
        assert not [link for link in page.asked if urlsplit(link).netloc], path
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert "@import" not in text, style
        assert "url(http" not in text.replace('"', "").replace("'", ""), style


def test_reports_of_the_gallery_are_there(site: Path) -> None:
    assert len(list((site / "reports").glob("*.html"))) >= 7


def test_tutorials_were_run(site: Path, capsys: Any) -> None:
    """When the site was built: their pictures are those of their runs."""
    for page in (ROOT / "docs" / "tutorials").glob("*.md"):
        count = int(
            (ROOT / "docs" / "generated" / "tutorials" / page.stem / "examples.txt").read_text(
                encoding="utf-8"
            )
        )
        with capsys.disabled():
            print(f"\n{page.name}: {count} examples run")
        assert count >= 5


def one_page(page: str, out: Path) -> subprocess.CompletedProcess[str]:
    """Build one page as CONTRIBUTING.md says."""
    words = [sys.executable, "-m", "sphinx", "-W", "-D", f"only={page}", "docs", str(out)]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=300)


def test_one_page_is_built_without_a_run(tmp_path: Path) -> None:
    done = one_page("howto/model", tmp_path / "page")
    assert done.returncode == 0, done.stderr
    assert "iceberg" in (tmp_path / "page" / "howto" / "model.html").read_text(encoding="utf-8")
    assert "ran " not in done.stdout
    assert [path.name for path in (tmp_path / "page" / "howto").glob("*.html")] == ["model.html"]
    assert 'there is no page docs/howto/modle.md; write for example "howto/model"' in (
        one_page("howto/modle", tmp_path / "none").stderr
    )
