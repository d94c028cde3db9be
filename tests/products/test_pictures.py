"""Every text of every picture of the shipped cases lies within the picture, and on no other text."""

import itertools
import json
from pathlib import Path
from typing import Any

import pytest
from matplotlib.text import Annotation, Text
from places import ROOT

from drift.apps.cli import commands as cli
from drift.case import file as case_file
from drift.products.maps import page

pytestmark = pytest.mark.thorough
PAINTS = False  # where each text lies is known once a picture is laid out
NAMES = [name for name, _ in case_file.shipped()]
FEW = {"particles": "3000", "spill.worlds": "300", "spill.per_world": "60"}
SLACK = 2.0  # [px] by which the boxes of two lines of text may meet: boxes have room for descenders


def boxes(figure: Any) -> list[tuple[str, list[float]]]:
    """Return the texts of a figure that are shown, with (left, bottom, right, top) [px].

    Not those at an angle, whose boxes are larger than they are, nor those with a leader, whose
    boxes hold it.
    """
    found = []
    for text in figure.findobj(Text):
        led = isinstance(text, Annotation) and text.arrow_patch is not None
        hidden = not text.get_visible() or not (text.axes is None or text.axes.get_visible())
        if led or hidden or text.get_rotation() % 180 or not text.get_text().strip():
            continue
        found.append((text.get_text(), list(text.get_window_extent().extents)))
    return found


def faults(texts: list[tuple[str, list[float]]], wide: float, high: float) -> list[str]:
    """Return what is cut off by the edge, and which texts lie on each other."""
    cut = [
        f"cut off: {text!r}"
        for text, (left, bottom, right, top) in texts
        if min(left, bottom) < -1 or right > wide + 1 or top > high + 1
    ]
    for (one, a), (other, b) in itertools.combinations(texts, 2):
        width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
        if width > SLACK and height > SLACK:
            cut.append(f"{one!r} on {other!r}: {width:.0f} by {height:.0f} px")
    return cut


@pytest.fixture
def looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the faults of each picture that is saved, in this process or a child of it."""
    found = tmp_path / "faults"
    found.mkdir()
    save = page.save

    def look(canvas: Any, path: Path, title: str, attributes: Any, dpi: int) -> None:
        figure = canvas.figure
        figure.set_dpi(dpi)
        figure.draw_without_rendering()
        wrong = faults(boxes(figure), figure.bbox.width, figure.bbox.height)
        (found / f"{Path(path).name}.json").write_text(json.dumps(wrong), encoding="utf-8")
        save(canvas, path, title, attributes, dpi)

    monkeypatch.setattr(page, "save", look)
    return found


def wrong_in(folder: Path) -> dict[str, list[str]]:
    """Return the pictures that have faults; at least one picture was looked at."""
    found = {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")}
    assert found
    return {name: wrong for name, wrong in found.items() if wrong}


@pytest.mark.parametrize("name", NAMES)
def test_texts_of_a_run_are_whole(
    name: str,
    looked_at: Path,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if "DRIFT_DATA" in (ROOT / "cases" / f"{name}.toml").read_text():
        monkeypatch.setenv("DRIFT_DATA", str(request.getfixturevalue("data")))
    spilled = bool(case_file.load(name).spill)
    fewer = [f"{key}={value}" for key, value in FEW.items() if key.startswith("spill") == spilled]
    words = [word for change in fewer for word in ("--set", change)]
    # 1: so few particles miss what a case expects, which other tests ask for
    assert cli.main(["run", name, *words, "--out", str(tmp_path / "out")]) in (0, 1)
    assert wrong_in(looked_at) == {}


def test_texts_of_a_plan_are_whole(looked_at: Path, tmp_path: Path) -> None:
    words = ["plan", "overdue_boat", "--set", "particles=3000", "--out", str(tmp_path / "out")]
    assert cli.main(words) == 0
    assert wrong_in(looked_at) == {}


def test_a_text_beyond_the_edge_and_one_on_another_are_faults() -> None:
    texts = [("a", [5.0, 5.0, 30.0, 15.0]), ("b", [25.0, 8.0, 60.0, 18.0]), ("c", [90, 5, 112, 9])]
    assert faults(texts, 110.0, 50.0) == ["cut off: 'c'", "'a' on 'b': 5 by 7 px"]
    assert faults(texts, 120.0, 50.0) == ["'a' on 'b': 5 by 7 px"]
