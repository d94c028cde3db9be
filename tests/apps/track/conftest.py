"""What the tests of drift track share: one cloud of other random numbers instead of nine."""

import pytest

from drift.tracking.tracker import holding


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have one cloud of other random numbers in place of nine, where nothing is asked of them: they
    are most of the time.
    """
    monkeypatch.setattr(holding, "OTHERS", 1)
