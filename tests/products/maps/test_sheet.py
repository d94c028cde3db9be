"""The words that every picture has: where they stand, that they keep apart, and that the density
scale's numbers are those of the shading.
"""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import PowerNorm
from matplotlib.lines import Line2D
from PIL import Image

from drift.products.maps import sheet
from drift.products.maps.chart import RED
from drift.products.maps.imprint import Imprint
from drift.products.maps.sheet import Badge, Row, Sheet

SHEET = Sheet(
    9.0, 5.0, 100, left=0.07, title=sheet.heading(0.93, 14), lines=(Row(0.86, 11), Row(0.8, 9, right=0.25)),
    caution=Badge(0.96, 0.93, 9, "right"), rough=Badge(0.073, 0.7), footer=sheet.small(0.03, 7),
)  # fmt: skip
LONG = "Raft adrift off a coast that has a rather long name, reported by a ship " * 2
CAUTION = "NO ERROR of wind in this forecast"


@pytest.mark.parametrize("caution", ["", CAUTION])
def test_words_stand_where_the_sheet_says_and_keep_apart(tmp_path: Path, caution: str) -> None:
    """Boxes of the texts as Matplotlib draws them: none covers another or leaves the page, but
    where there is no room left to cut.
    """
    on = sheet.begin_page(SHEET)
    imprint = Imprint(LONG, "casp-drift " * 30, {"case": "Bjørnøya"}, caution)
    sheet.write_head(on, imprint, "first line", "a second line that is longer than it may be")
    sheet.draw_rough_banner(on, "ONLY 3 of 5,000 particles are effective")
    sheet.write_line(on, sheet.warning(0.6, 9), "1.2 % of the probability is not on the map")
    sheet.finish_page(on, tmp_path / "a.png", imprint, "another title")
    texts = {text.get_text(): text for text in on.figure.texts}
    assert len(texts) == 6 + bool(caution)
    title = next(text for words, text in texts.items() if words.startswith("Raft adrift"))
    assert title.get_text().endswith(" …")
    # all but the banners
    assert [text.get_position()[0] for text in texts.values()].count(0.07) == 5
    assert texts["1.2 % of the probability is not on the map"].get_color() == RED
    renderer = on.canvas.get_renderer()  # type: ignore[no-untyped-call]
    boxes = [text.get_window_extent(renderer) for text in texts.values()]
    assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])
    second = next(text for words, text in texts.items() if words.startswith("a second"))
    assert second.get_window_extent(renderer).x1 <= 0.25 * 900
    if caution:
        assert all(box.x1 <= on.figure.bbox.width for box in boxes)
        assert texts[CAUTION].get_window_extent(renderer).x1 == pytest.approx(
            0.96 * 900, abs=2
        )  # hinting: a pixel at each end
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (900, 500)
        assert (image.text["Title"], image.text["case"]) == ("another title", "Bjørnøya")  # type: ignore[attr-defined]


@pytest.mark.parametrize("row", [SHEET.title, SHEET.footer, Row(0.5, 9, right=0.6)])
@pytest.mark.parametrize("many", range(2, 40, 3))
@pytest.mark.parametrize("caution", ["", CAUTION])
def test_a_text_uses_its_room_before_it_is_cut(row: Row, many: int, caution: str) -> None:
    """Whole in its size if it has room, else smaller, else cut where less than a word has room."""
    on = sheet.begin_page(SHEET)
    sheet.write_head(on, Imprint("", caution=caution), "", "")
    right = 900 * row.right
    if caution and row is SHEET.title:
        banner = on.figure.texts[0].get_window_extent()
        assert banner.x1 == pytest.approx(0.96 * 900, abs=2)
        right = banner.x0
    text = " ".join(["lifeboat"] * many)
    sheet.write_line(on, row, text)
    line = on.figure.texts[-1]
    box, size = line.get_window_extent(), line.get_fontsize()
    assert box.x1 <= right
    on.figure.texts[-1].set_text(text)
    line.set_fontsize(row.size)
    whole = line.get_window_extent()
    if whole.x1 < right - 20:
        assert (size, box.width) == (row.size, whole.width)
    else:
        assert size < row.size or box.x1 > right - 25
        assert size >= min(row.size, 5.5)
        assert box.x1 > right - 25 - 9 * size
    assert size >= 0.65 * row.size


@pytest.mark.parametrize(
    ("box", "axis"), [((0.1, 0.1, 0.5, 0.03), "x"), ((0.8, 0.1, 0.03, 0.6), "y")]
)
@pytest.mark.parametrize(
    ("top", "unit", "area"), [(37.0, "nmi²", 1.0), (0.0007, "10,000 nmi²", 1e4)]
)
def test_the_numbers_of_a_density_scale_are_those_of_its_colours(
    box: tuple[float, float, float, float], axis: str, top: float, unit: str, area: float
) -> None:
    """A number v per area stands where the shading's value is v / area [% per nmi2]; the scale ends
    within its axes.
    """
    on = sheet.begin_page(SHEET)
    ax = on.figure.add_axes((0.1, 0.3, 0.3, 0.3))
    mesh = ax.pcolormesh(np.linspace(0, top, 12).reshape(3, 4), norm=PowerNorm(0.5, 0, top))
    bar, told = sheet.density_bar(on.figure, box, mesh)
    assert told == unit
    ticks = bar.get_xticks() if axis == "x" else bar.get_yticks()
    words = bar.get_xticklabels() if axis == "x" else bar.get_yticklabels()
    assert [float(word.get_text().replace(",", "")) for word in words] == pytest.approx(
        ticks * area, rel=1e-12
    )
    assert ticks[0] == 0
    assert 2 < len(ticks) < 8
    assert ticks[-1] <= top * (1 + 1e-9)


def test_a_legend_has_no_frame() -> None:
    on = sheet.begin_page(SHEET)
    legend = sheet.legend(
        on.figure,
        [(Line2D([], []), "one"), (Line2D([], []), "other")],
        loc="upper left",
        fontsize=8,
    )
    assert [text.get_text() for text in legend.get_texts()] == ["one", "other"]
    assert not legend.get_frame_on()
