"""A sheet: what every picture has on its page, and where. A map adds its own layers to it.

Places are shares of the page from its lower left corner; sizes of letters are typographic points. A
text longer than the number of letters that there is room for is cut.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple

from drift.products.maps import labels, page
from drift.products.maps.chart import GREY, INK, RED
from drift.products.maps.imprint import Imprint


@dataclass(frozen=True)
class Row:
    """A line of text that begins at the left margin."""

    y: float
    size: float
    letters: float | None = None
    weight: str = "normal"
    colour: str = INK
    va: str = "baseline"


@dataclass(frozen=True)
class Badge:
    """A banner; side: the end of it, left or right, that is at the place."""

    x: float
    y: float
    size: float = 10
    side: str = "left"


@dataclass(frozen=True)
class Sheet:
    """A page, and where on it the words stand that every picture has."""

    width: float  # [in]
    height: float  # [in]
    dpi: int
    left: float  # margin
    title: Row
    lines: tuple[Row, ...]  # under the title
    footer: Row
    caution: Badge | None = None  # warns of what a reader must not believe; None: never shown
    rough: Badge | None = None  # warns that few count for the picture; None: never shown
    # letters of a title that has a caution right of it; None: as many as without
    beside: float | None = None


@dataclass(frozen=True)
class Page:
    """A sheet that is being drawn on."""

    sheet: Sheet
    figure: Figure
    canvas: FigureCanvasAgg


def begin(sheet: Sheet) -> Page:
    """Return an empty page."""
    return Page(sheet, *page.figure(sheet.width, sheet.height))


def say(on: Page, row: Row, text: str) -> None:
    """Write a line."""
    words = text if row.letters is None else page.fit(text, row.letters)
    style: dict[str, Any] = {
        "fontsize": row.size,
        "weight": row.weight,
        "color": row.colour,
        "va": row.va,
    }
    on.figure.text(on.sheet.left, row.y, words, **style)


def warning(y: float, size: float, letters: float | None = None, va: str = "baseline") -> Row:
    """Return a line in the red of warnings."""
    return Row(y, size, letters, "bold", RED, va)


def heading(y: float, size: float, letters: float | None = None) -> Row:
    """Return a bold line."""
    return Row(y, size, letters, "bold")


def small(y: float, size: float, letters: float | None = None) -> Row:
    """Return a line in the grey of what is said besides, such as a footer."""
    return Row(y, size, letters, colour=GREY)


def head(on: Page, imprint: Imprint, *lines: str) -> None:
    """Write the title, the lines under it, and the caution on its banner."""
    sheet, title = on.sheet, on.sheet.title
    if imprint.caution and sheet.beside is not None:
        title = Row(title.y, title.size, sheet.beside, title.weight, title.colour, title.va)
    say(on, title, imprint.title)
    for row, text in zip(sheet.lines, lines, strict=True):
        say(on, row, text)
    if imprint.caution and sheet.caution is not None:
        _banner(on, sheet.caution, imprint.caution)


def rough(on: Page, text: str) -> None:
    """Draw a banner which says that few particles or worlds count for a picture."""
    assert on.sheet.rough is not None
    _banner(on, on.sheet.rough, text)


def _banner(on: Page, badge: Badge, text: str) -> None:
    page.banner(on.figure, badge.x, badge.y, badge.side, badge.size, text)


def foot(on: Page, imprint: Imprint) -> None:
    """Write the line at the foot."""
    if imprint.footer:
        say(on, on.sheet.footer, imprint.footer)


def end(on: Page, path: Path, imprint: Imprint, title: str = "") -> None:
    """Write the line at the foot, and the picture into its file.

    title: of the file, where it differs from that of the imprint.
    """
    foot(on, imprint)
    page.save(on.canvas, path, title or imprint.title, imprint.attributes, dpi=on.sheet.dpi)


def legend(figure: Figure, rows: Sequence[tuple[Any, str]], **style: Any) -> Any:
    """Write what symbols mean, without a frame; those of a list stand side by side, those of a
    tuple on each other.
    """
    abreast = {
        tuple(symbol): HandlerTuple(ndivide=None) for symbol, _ in rows if isinstance(symbol, list)
    }
    symbols: list[Any] = [
        tuple(symbol) if isinstance(symbol, list) else symbol for symbol, _ in rows
    ]
    texts = [text for _, text in rows]
    return figure.legend(
        symbols, texts, handler_map=abreast, frameon=False, labelcolor=INK, **style
    )


def density_bar(
    figure: Figure, box: tuple[float, float, float, float], mesh: Any
) -> tuple[Axes, str]:
    """Draw the colour scale of a probability density [% per nmi2]; return its axes and their unit.

    The scale has round numbers. box: left, bottom, width, height of the page; the scale runs along
    its longer side.
    """
    along = box[2] * figure.get_figwidth() > box[3] * figure.get_figheight()
    bar = figure.add_axes(box)
    figure.colorbar(mesh, cax=bar, orientation="horizontal" if along else "vertical", extend="max")
    per, unit = labels.scale(mesh.norm.vmax)
    ticks = labels.ticks(mesh.norm.vmax * per)
    (bar.set_xticks if along else bar.set_yticks)(
        ticks / per, labels=[labels.plain(tick) for tick in ticks]
    )
    bar.minorticks_off()
    return bar, unit
