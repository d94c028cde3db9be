"""A page to draw on, and its file: figures without pyplot, that leave no state behind; provenance, no date."""

import textwrap
from collections.abc import Mapping
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drift.forecast import layers


def figure(width: float, height: float) -> tuple[Figure, FigureCanvasAgg]:
    """Return a white page [inches] and its canvas."""
    figure = Figure((width, height), facecolor="white")
    return figure, FigureCanvasAgg(figure)


def save(canvas: FigureCanvasAgg, path: Path, title: str, attributes: Mapping[str, str] | None, dpi: int) -> None:
    """Write the picture with its provenance as text chunks, and no date: the same forecast gives the same bytes."""
    texts = {"Title": title, "Software": "casp-drift", **(attributes or {})}
    canvas.figure.savefig(path, format="png", dpi=dpi, metadata=texts)


def fit(text: str, characters: float) -> str:
    """Return a text cut to a number of letters."""
    return textwrap.shorten(text, int(characters), placeholder=" …")


def banner(figure: Figure, x: float, y: float, side: str, size: float, text: str) -> None:
    """Say what a picture must not be believed of, in white on red."""
    figure.text(
        x,
        y,
        text,
        fontsize=size,
        weight="bold",
        color="white",
        ha=side,
        bbox={"facecolor": layers.LAST_KNOWN, "edgecolor": "none", "boxstyle": "square,pad=0.35"},
    )
