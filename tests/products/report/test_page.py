"""report.html as text: what it carries, read by Python's parser of HTML, and compared with what it
was given.
"""

import base64
import hashlib
import json
import zlib
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from drift.products.maps.imprint import Imprint, Setting
from drift.products.maps.marks import Mark
from drift.products.report import leaves, page

NASTY = "</title></script><img src=x onerror=alert(1)>"


class Read(HTMLParser):
    """The elements of a page: tags, and the text of its title, of its data and of its scripts."""

    def __init__(self, path: Path) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.policy = ""
        self._within = ""
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        self.tags.append(tag)
        self._within = str(named.get("id") or tag)
        self.texts.setdefault(self._within, []).append("")
        if named.get("http-equiv") == "Content-Security-Policy":
            self.policy = str(named["content"])

    def handle_endtag(self, tag: str) -> None:
        self._within = ""

    def handle_data(self, data: str) -> None:
        if self._within:
            self.texts[self._within][-1] += data

    @property
    def content(self) -> dict[str, Any]:
        """What the page's script is given."""
        return dict(json.loads(self.texts["data"][0]))


def unpacked(text: str) -> bytes:
    return zlib.decompress(base64.b64decode(text))


def written(folder: Path, on: Setting, items: Sequence[leaves.Leaf] = (), **files: str) -> Read:
    """Write a page beside some files (their names with _ for the dot), and read it."""
    told = {"run_id": "abc-s1", "versions": {}, "date_created": "2026-06-01T20:00:00Z"}
    (folder / "summary.json").write_text(json.dumps(told), encoding="utf-8")
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text, encoding="utf-8")
    page.write(folder / "report.html", items, on, [f"first {NASTY}"])
    return Read(folder / "report.html")


def frame(west: float, south: float, east: float, north: float) -> list[Mark]:
    """Return starting positions in two corners of a box, which the map then shows."""
    return [Mark(west, south, "one"), Mark(east, north, "two")]


def test_words_of_a_case_are_text(tmp_path: Path) -> None:
    """They neither end the title or the script that holds them nor become elements."""
    on = Setting(Imprint(f"Raft {NASTY} &amp; crew"), marks=frame(12.0, 55.0, 13.0, 55.5))
    read = written(tmp_path, on)
    assert read.texts["title"][0] == f"Raft {NASTY} &amp; crew"
    assert read.content["title"] == f"Raft {NASTY} &amp; crew"
    assert read.content["warnings"] == [f"first {NASTY}"]
    assert "img" not in read.tags


def test_the_policy_allows_the_scripts_of_the_page_alone(tmp_path: Path) -> None:
    read = written(tmp_path, Setting(Imprint("Raft"), marks=frame(12.0, 55.0, 13.0, 55.5)))
    rules = dict(rule.strip().split(" ", 1) for rule in read.policy.split(";"))
    digests = [hashlib.sha256(text.encode()).digest() for text in read.texts["script"]]
    allowed = [f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests]
    assert rules["script-src"].split() == allowed
    assert rules["default-src"] == "'none'"


def test_a_large_file_is_a_link_unless_a_layer_needs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "LARGEST", 400)
    random = np.random.default_rng(6)
    large = {
        name: "lon,lat\n" + "".join(f"{x:.6f},{x:.6f}\n" for x in random.uniform(0, 9, 200))
        for name in ("needed_csv", "graded_csv", "other_csv")
    }
    items = [
        leaves.points_leaf("Points", "needed.csv", "particles"),
        leaves.shapes_leaf("Coast", "coast.geojson", "coast", graded=("graded.csv", "lon", "lat")),
    ]
    on = Setting(Imprint("Raft"), marks=frame(1.0, 55.0, 2.0, 55.5))
    read = written(
        tmp_path, on, items, **large, coast_geojson='{"features": []}', small_csv="lon,lat\n"
    )
    files = read.content["files"]
    assert set(files) == {
        "coast.geojson",
        "graded.csv",
        "needed.csv",
        "small.csv",
        "summary.json",
    }
    for name, held in files.items():
        assert unpacked(held["data"]) == (tmp_path / name).read_bytes()
    other = {"name": "other.csv", "bytes": len(large["other_csv"])}
    assert read.content["beside"] == [other]


@pytest.mark.parametrize(
    ("box", "kind"),
    [
        ((12.0, 55.0, 13.0, 55.5), "mercator"),
        ((12.0, 73.0, 13.0, 74.9), "mercator"),
        ((12.0, 73.0, 13.0, 75.1), "azimuthal"),
        ((12.0, -75.1, 13.0, -73.0), "azimuthal"),
    ],
)
def test_near_a_pole_the_map_is_not_mercators(
    tmp_path: Path, box: tuple[float, float, float, float], kind: str
) -> None:
    read = written(tmp_path, Setting(Imprint("Raft"), marks=frame(*box)))
    assert read.content["projection"]["kind"] == kind


@pytest.mark.parametrize("west", [179.5, -180.5])
def test_land_on_both_sides_of_180_lies_around_the_map(tmp_path: Path, west: float) -> None:
    """An island with a lake, cut by 180 degrees, and a far one; the map is a degree wide, and land
    shows to half a degree beyond. It is rounded to 1e-4 degrees, or a 6000th of the map.
    """
    here, there = shapely.box(179.6, -17.4, 180, -17.0), shapely.box(-180, -17.4, -179.7, -17.0)
    lake = shapely.box(179.7, -17.3, 179.8, -17.2)
    far = shapely.box(-179.2, -17.1, -178.0, -16.8)
    hidden = shapely.box(0.0, -17.4, 1.0, -17.0)
    land = [here - lake, there, far, hidden]
    corners = frame(west, -17.5, west + 1, -16.5)
    read = written(tmp_path, Setting(Imprint("Raft"), lambda box: land, marks=corners))
    extent = read.content["projection"]["extent"]
    middle = (extent[0] + extent[2]) / 2
    assert (middle - 180) % 360 == pytest.approx(0, abs=1e-9)
    shown = [
        [np.cumsum(np.reshape(ring, (-1, 2)), axis=0) * 1e-4 + (180, 0) for ring in rings]
        for rings in json.loads(unpacked(read.content["land"]))
    ]
    drawn = shapely.union_all([shapely.Polygon(rings[0], rings[1:]) for rings in shown])
    whole = shapely.union_all([shapely.box(179.6, -17.4, 180.3, -17.0) - lake,
                               shapely.box(180.8, -17.1, 181.0, -16.8)])  # fmt: skip
    assert shapely.hausdorff_distance(drawn, whole) < 3e-4
    assert drawn.area == pytest.approx(whole.area, abs=3e-4 * whole.length)
