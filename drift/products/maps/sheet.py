"""The layout of a picture's page: title, lines, footer and banners, which every picture has.

Positions are fractions of the page from its lower left corner; font sizes are points. A text longer
than its room is written smaller; one that would be too small to read is cut.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.transforms import Bbox

from drift.products.maps import labels, page
from drift.products.maps.chart import GREY, INK, RED
from drift.products.maps.imprint import Imprint

RIGHT = 0.985  # right end of a text, as a share of the page's width
GAP = 0.012  # between a text and a banner, likewise
SMALLEST, LEAST = 0.65, 5.5  # of a text that is written smaller: share of its size, and size


@dataclass(frozen=True)
class Row:
    """A line of text at the left margin; right: where its room ends."""

    y: float
    size: float
    weight: str = "normal"
    colour: str = INK
    va: str = "baseline"
    right: float = RIGHT


@dataclass(frozen=True)
class Badge:
    """A banner; side: which end of it, left or right, is at x."""

    x: float
    y: float
    size: float = 10
    side: str = "left"


@dataclass(frozen=True)
class Sheet:
    """The size of a page, and the positions of the text that every picture has."""

    width: float  # [in]
    height: float  # [in]
    dpi: int
    left: float  # margin
    title: Row
    lines: tuple[Row, ...]  # under the title
    footer: Row
    caution: Badge | None = None  # banner with the limits of a result; None: not shown
    rough: Badge | None = None  # banner on few effective particles; None: not shown


@dataclass(frozen=True)
class Page:
    """A page that is being drawn, with its layout."""

    sheet: Sheet
    figure: Figure
    canvas: FigureCanvasAgg
    banners: list[Bbox] = field(default_factory=list)  # boxes [px] of those drawn


def begin_page(sheet: Sheet) -> Page:
    """Return an empty page with a layout."""
    return Page(sheet, *page.figure(sheet.width, sheet.height))


def write_line(on: Page, row: Row, text: str) -> None:
    """Write a line of text at the left margin, in the room up to its end or to a banner."""
    style: dict[str, Any] = {
        "fontsize": row.size,
        "weight": row.weight,
        "color": row.colour,
        "va": row.va,
    }
    line = on.figure.text(on.sheet.left, row.y, text, **style)
    box, wide = line.get_window_extent(), on.figure.bbox.width
    beside = [
        banner.x0 - GAP * wide
        for banner in on.banners
        if banner.x0 > box.x0 and banner.y0 < box.y1 and banner.y1 > box.y0
    ]
    room = min([row.right * wide, *beside]) - box.x0

    def excess() -> float:
        return float(line.get_window_extent().width / room)

    size, smallest = row.size, max(SMALLEST * row.size, min(LEAST, row.size))
    # a text of half the size may be a little wider than half: letters fit whole pixels
    while size > smallest and (over := excess()) > 1:
        size = max(0.99 * size / over, smallest)
        line.set_fontsize(size)
    kept = len(text)
    while kept > 1 and (over := excess()) > 1:
        kept = min(int(kept / over), kept - 1)
        whole_words = text[:kept].rpartition(" ")[0]
        line.set_text(f"{(whole_words or text[:kept]).rstrip()} …")


def warning(y: float, size: float, va: str = "baseline") -> Row:
    """Return the style of a warning line: bold and red."""
    return Row(y, size, "bold", RED, va)


def heading(y: float, size: float) -> Row:
    """Return the style of a bold line."""
    return Row(y, size, "bold")


def small(y: float, size: float) -> Row:
    """Return the style of secondary text, such as a footer: grey."""
    return Row(y, size, colour=GREY)


def write_head(on: Page, imprint: Imprint, *lines: str) -> None:
    """Write the title, the lines under it, and the caution as a banner."""
    sheet = on.sheet
    if imprint.caution and sheet.caution is not None:
        _banner(on, sheet.caution, imprint.caution)
    write_line(on, sheet.title, imprint.title)
    for row, text in zip(sheet.lines, lines, strict=True):
        write_line(on, row, text)


def draw_rough_banner(on: Page, text: str) -> None:
    """Draw a banner about few effective particles or worlds."""
    assert on.sheet.rough is not None
    _banner(on, on.sheet.rough, text)


def _banner(on: Page, badge: Badge, text: str) -> None:
    box = page.banner(on.figure, badge.x, badge.y, badge.side, badge.size, text)
    on.banners.append(box)


def write_footer(on: Page, imprint: Imprint) -> None:
    """Write the footer."""
    if imprint.footer:
        write_line(on, on.sheet.footer, imprint.footer)


def finish_page(on: Page, path: Path, imprint: Imprint, title: str = "") -> None:
    """Write the footer, and save the picture.

    title: title in the file's metadata, if it differs from that of the imprint.
    """
    write_footer(on, imprint)
    page.save(on.canvas, path, title or imprint.title, imprint.attributes, dpi=on.sheet.dpi)


def legend(figure: Figure, rows: Sequence[tuple[Any, str]], **style: Any) -> Any:
    """Draw a legend without a frame.

    Args:
        figure: the figure.
        rows: symbol and text of each row. Symbols in a list are drawn side by side, those in a
            tuple on top of each other.
        style: further arguments of Matplotlib's legend.

    Returns:
        The legend.
    """
    side_by_side = {
        tuple(symbol): HandlerTuple(ndivide=None) for symbol, _ in rows if isinstance(symbol, list)
    }
    symbols: list[Any] = [
        tuple(symbol) if isinstance(symbol, list) else symbol for symbol, _ in rows
    ]
    texts = [text for _, text in rows]
    return figure.legend(
        symbols, texts, handler_map=side_by_side, frameon=False, labelcolor=INK, **style
    )


def density_bar(
    figure: Figure, box: tuple[float, float, float, float], mesh: Any
) -> tuple[Axes, str]:
    """Draw the colour scale of a probability density [% per nmi2], with round numbers.

    Args:
        figure: the figure.
        box: left, bottom, width, height [page fraction]; the scale runs along the longer side.
        mesh: the shading that it explains.

    Returns:
        The axes of the scale, and the name of the unit area.
    """
    horizontal = box[2] * figure.get_figwidth() > box[3] * figure.get_figheight()
    bar = figure.add_axes(box)
    figure.colorbar(
        mesh, cax=bar, orientation="horizontal" if horizontal else "vertical", extend="max"
    )
    unit_area, unit = labels.density_unit(mesh.norm.vmax)
    ticks = labels.ticks(mesh.norm.vmax * unit_area)
    (bar.set_xticks if horizontal else bar.set_yticks)(
        ticks / unit_area, labels=[labels.plain(tick) for tick in ticks]
    )
    bar.minorticks_off()
    return bar, unit
