"""Figures and their PNG files: no pyplot state, provenance as metadata, and no date."""

import textwrap
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from drift.products.maps.chart import RED

# of a picture or the report: these must not cost the other files of a long run
FAILURES = (ArithmeticError, LookupError, StopIteration, TypeError, ValueError)
COMPRESSION = 2  # of a PNG: the default, 6, takes twice the time and saves a tenth of the size


def figure(width: float, height: float) -> tuple[Figure, FigureCanvasAgg]:
    """Return a white figure of a size [inches], and its canvas."""
    figure = Figure((width, height), facecolor="white")
    return figure, FigureCanvasAgg(figure)


def literal_text() -> AbstractContextManager[None]:
    """Return a context in which texts are drawn literally: a "$" in a name starts no formula."""
    return matplotlib.rc_context({"text.parse_math": False})


def warn_on_failure(draw: Callable[[Path], None]) -> Callable[[Path], None]:
    """Return a drawing function that turns an error into a warning.

    A failed picture must not cost the other files of a long run.
    """

    def attempt(path: Path) -> None:
        try:
            with literal_text():
                draw(path)
        except FAILURES as error:
            path.unlink(missing_ok=True)
            warnings.warn(
                f"{path.name} could not be drawn ({error}); all other files are complete",
                stacklevel=2,
            )

    return attempt


def save(
    canvas: FigureCanvasAgg, path: Path, title: str, attributes: Mapping[str, str] | None, dpi: int
) -> None:
    """Write the picture with its provenance as text chunks, and without a date.

    The same forecast therefore gives the same bytes.
    """
    texts = PngInfo()
    for name, text in {"Title": title, "Software": "casp-drift", **(attributes or {})}.items():
        texts.add_text(name, text)
    canvas.figure.set_dpi(dpi)
    pixels, size = canvas.print_to_buffer()  # type: ignore[no-untyped-call]
    opaque = Image.frombuffer("RGBA", size, pixels).convert("RGB")
    opaque.save(path, "png", dpi=(dpi, dpi), pnginfo=texts, compress_level=COMPRESSION)


def fit(text: str, characters: float) -> str:
    """Return a text shortened to a number of characters."""
    return textwrap.shorten(text, int(characters), placeholder=" …")


def shorten_names(texts: Sequence[str], characters: float) -> list[str]:
    """Return names shortened to a number of characters, such that different names stay different.

    Names of several parts ("transit, north, 8 kn") with equal first parts drop these if one of the
    names is too long. Shortened names that would be equal keep their ends instead.
    """
    many = int(characters)
    if all(len(text) <= many for text in texts):
        return list(texts)
    families: dict[str, list[str]] = {}
    for text in dict.fromkeys(texts):
        families.setdefault(text.split(", ")[0], []).append(text)
    short: dict[str, str] = {}
    for own in families.values():
        parts = [text.split(", ") for text in own]
        shared = 0
        if len(own) > 1 and max(map(len, own)) > many:
            while all(len(one) > shared + 1 and one[shared] == parts[0][shared] for one in parts):
                shared += 1
        short |= {
            text: "… " * (shared > 0) + ", ".join(one[shared:])
            for text, one in zip(own, parts, strict=True)
        }
    found = {text: fit(own, many) for text, own in short.items()}
    times = Counter(found.values())
    found = {
        text: own if times[own] == 1 else f"…{short[text][1 - many :]}"
        for text, own in found.items()
    }
    return [found[text] for text in texts]


def banner(figure: Figure, x: float, y: float, side: str, size: float, text: str) -> Bbox:
    """Draw a caution in white on red at x, y [page fraction], aligned at `side`; return its box."""
    pad = 0.35
    words = figure.text(
        x,
        y,
        text,
        fontsize=size,
        weight="bold",
        color="white",
        ha=side,
        bbox={"facecolor": RED, "edgecolor": "none", "boxstyle": f"square,pad={pad}"},
    )
    return words.get_window_extent().padded(pad * size / 72 * figure.dpi)
