"""What the tests of pictures of searches share: a search, and the texts and figures that are saved."""

import pytest
import searches
from matplotlib.text import Text

from drift.products.maps import page


@pytest.fixture(scope="module")
def search():
    return searches.search()


@pytest.fixture
def words(monkeypatch):
    """Collect every text that is on a figure when it would be saved; it is laid out, and no pixel
    is drawn.
    """
    found = []

    def listen(canvas, *args, **kwargs):
        found.extend(text.get_text() for text in canvas.figure.findobj(Text) if text.get_text())
        canvas.figure.draw_without_rendering()

    monkeypatch.setattr(page, "save", listen)
    return found


@pytest.fixture
def figures(monkeypatch):
    """Collect figures as they are saved."""
    found = []
    save = page.save
    monkeypatch.setattr(
        page, "save", lambda canvas, *a, **k: (found.append(canvas.figure), save(canvas, *a, **k))
    )
    return found
