"""A page to draw on, and its file: figures without pyplot, that leave no state behind; provenance,
no date.
"""

import textwrap
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drift.products.maps.chart import RED


def figure(width: float, height: float) -> tuple[Figure, FigureCanvasAgg]:
    """Return a white page [inches] and its canvas."""
    figure = Figure((width, height), facecolor="white")
    return figure, FigureCanvasAgg(figure)


def literal() -> AbstractContextManager[None]:
    """Return a context in which texts are drawn as they are: a "$" in a name is no formula."""
    return matplotlib.rc_context({"text.parse_math": False})


def kept(draw: Callable[[Path], None]) -> Callable[[Path], None]:
    """Return a drawing that, where it fails, costs only its own picture and no other file of a long
    run.
    """

    def attempt(path: Path) -> None:
        try:
            with literal():
                draw(path)
        except (ArithmeticError, LookupError, StopIteration, TypeError, ValueError) as error:
            path.unlink(missing_ok=True)
            warnings.warn(
                f"{path.name} could not be drawn ({error}); all other files are complete",
                stacklevel=2,
            )

    return attempt


def save(
    canvas: FigureCanvasAgg, path: Path, title: str, attributes: Mapping[str, str] | None, dpi: int
) -> None:
    """Write the picture with its provenance as text chunks, and no date.

    So the same forecast gives the same bytes.
    """
    texts = {"Title": title, "Software": "casp-drift", **(attributes or {})}
    canvas.figure.savefig(path, format="png", dpi=dpi, metadata=texts)


def fit(text: str, characters: float) -> str:
    """Return a text cut to a number of letters."""
    return textwrap.shorten(text, int(characters), placeholder=" …")


def names(texts: Sequence[str], characters: float) -> list[str]:
    """Return names that stand beside each other cut to a number of letters, so that those that
    differ still do.

    Names of several parts, "transit, north, 8 kn", that begin alike leave out the parts that they
    share where one of them is too long. Where cut names would still be alike, they keep their ends.
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
        same = 0
        if len(own) > 1 and max(map(len, own)) > many:
            while all(len(one) > same + 1 and one[same] == parts[0][same] for one in parts):
                same += 1
        short |= {
            text: "… " * (same > 0) + ", ".join(one[same:])
            for text, one in zip(own, parts, strict=True)
        }
    found = {text: fit(own, many) for text, own in short.items()}
    times = Counter(found.values())
    found = {
        text: own if times[own] == 1 else f"…{short[text][1 - many :]}"
        for text, own in found.items()
    }
    return [found[text] for text in texts]


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
        bbox={"facecolor": RED, "edgecolor": "none", "boxstyle": "square,pad=0.35"},
    )
