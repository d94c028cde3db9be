"""What the tests of forecasts share: the texts on figures that are saved."""

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text


@pytest.fixture
def words(monkeypatch):
    """Collect every text that is on a figure when it is saved."""
    found = []
    save = Figure.savefig

    def listen(self, *args, **kwargs):
        found.extend(text.get_text() for text in self.findobj(Text) if text.get_text())
        return save(self, *args, **kwargs)

    monkeypatch.setattr(Figure, "savefig", listen)
    return found
