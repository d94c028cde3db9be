"""The picture of an allocation: which cells are filled and labelled, read off what is drawn."""

from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from PIL import Image

from drift.planning.arrays import map as processing_map
from drift.planning.arrays import processing, records
from drift.products.maps.imprint import Imprint

START = np.datetime64("2026-06-01T00:00")


def table(slots: int, many: int, beams: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.random((slots, many, beams)) < 0.3) * rng.random((slots, many, beams))


def test_cells_that_are_filled_are_those_that_are_processed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hearing = records.hearing(table(5, 60, 9), np.ones(60), np.repeat([0, 1], [4, 5]), 2)
    found = processing.allocate(hearing)
    names = records.names(hearing, START, 3600.0)
    bars: list[tuple[float, float]] = []
    texts: list[tuple[float, float, str]] = []
    barh, text = Axes.barh, Axes.text

    def seen(ax: Axes, y, width, height, left, **style):
        assert to_rgba(style["facecolor"]) == to_rgba(processing_map.FILL)
        bars.extend(zip(np.asarray(left), np.asarray(y), strict=True))
        return barh(ax, y, width, height, left, **style)

    def said(ax: Axes, x, y, words, **style):
        texts.append((x, y, words))
        return text(ax, x, y, words, **style)

    monkeypatch.setattr(Axes, "barh", seen)
    monkeypatch.setattr(Axes, "text", said)
    processing_map.plot_processing(
        found, hearing, names, tmp_path / "a.png", Imprint("Nine beams", "a foot")
    )
    heights = sorted({y for _, y in bars}, reverse=True)  # the first beam on top
    used = sorted({beam for beams in found.chosen for beam in beams})
    edges = names.edges.astype("datetime64[s]").astype(float)
    drawn = {(edges.tolist().index(x), used[heights.index(y)]) for x, y in bars}
    assert drawn == {(slot, beam) for slot, beams in enumerate(found.chosen) for beam in beams}
    labels = {
        (
            int(np.searchsorted(edges, x)) - 1,
            used[int(np.argmin([abs(y - h) for h in heights]))],
        ): words
        for x, y, words in texts
        if any(abs(y - h) < 0.02 for h in heights) and words[0].isdigit()
    }
    assert set(labels) == drawn
    for (slot, beam), words in labels.items():
        share = 100 * found.gain[slot, beam] / found.weight
        assert abs(float(words) - share) <= (0.05 if share >= 9.95 else 0.005)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("slots", "beams"),
    [
        (12, 80),
        (1, 1),
        *(pytest.param(*one, marks=pytest.mark.thorough) for one in ((300, 3), (2, 260))),
    ],
)
def test_it_is_drawn_at_any_size_and_twice_the_same(tmp_path: Path, slots: int, beams: int) -> None:
    hearing = records.hearing(
        table(slots, 40, beams), np.ones(40), np.arange(beams) * 4 // beams, min(6, beams)
    )
    found = processing.allocate(hearing)
    names = records.names(hearing, START, 6 * 3600.0)
    for name in ("a.png", "b.png"):
        with matplotlib.rc_context({"text.parse_math": False}):
            processing_map.plot_processing(
                found,
                hearing,
                names,
                tmp_path / name,
                Imprint("A $ title", "foot", {}, "SYNTHETIC"),
            )
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.width == 1680
        assert image.height < 2400
    if beams > processing_map.MOST:
        shown = processing_map.shown(found, hearing)
        assert set(shown) == {beam for beams in found.chosen for beam in beams}
