"""What the tests of forecasts share: the texts on figures that are saved."""

import pytest
from matplotlib.text import Text

from drift.products.maps import page


@pytest.fixture
def words(monkeypatch):
    """Collect every text that is on a figure when it is saved."""
    found = []
    save = page.save

    def listen(canvas, *args, **kwargs):
        found.extend(text.get_text() for text in canvas.figure.findobj(Text) if text.get_text())
        save(canvas, *args, **kwargs)

    monkeypatch.setattr(page, "save", listen)
    return found
