"""What the tests of pictures of searches share: a search, and the texts and figures that are saved."""

import pytest
import searches
from matplotlib.figure import Figure
from matplotlib.text import Text


@pytest.fixture(scope="module")
def search():
    return searches.search()


@pytest.fixture
def words(monkeypatch):
    """Collect every text that is on a figure when it would be saved; it is laid out, and no pixel
    is drawn.
    """
    found = []

    def listen(self, *args, **kwargs):
        found.extend(text.get_text() for text in self.findobj(Text) if text.get_text())
        self.draw_without_rendering()

    monkeypatch.setattr(Figure, "savefig", listen)
    return found


@pytest.fixture
def figures(monkeypatch):
    """Collect figures as they are saved."""
    found = []
    save = Figure.savefig
    monkeypatch.setattr(
        Figure,
        "savefig",
        lambda self, *args, **kwargs: (found.append(self), save(self, *args, **kwargs))[1],
    )
    return found
