"""What the tests of downloads share: short waits, and a home folder of the test."""

from pathlib import Path

import pytest

from drift.apps.fetch import parts


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Wait little between attempts; ask for netrc and settings in a folder of the test."""
    monkeypatch.setattr(parts, "PAUSE", 0.02)
    monkeypatch.setenv("HOME", str(tmp_path))
