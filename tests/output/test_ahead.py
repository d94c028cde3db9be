"""What is imported ahead is there once it is waited for; what cannot be imported troubles nobody before it is wanted."""

import sys
from pathlib import Path

import pytest

from drift.output import ahead


@pytest.fixture
def slow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a module that takes a while to import."""
    (tmp_path / "slow_to_import.py").write_text("import time\ntime.sleep(0.3)\nready = True\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "slow_to_import", raising=False)
    return "slow_to_import"


def test_it_is_waited_for(slow: str) -> None:
    ahead.done()
    ahead.begin(slow)
    ahead.begin("another begin is none")
    ahead.done()
    assert sys.modules[slow].ready
    ahead.done()


def test_what_cannot_be_imported(slow: str) -> None:
    ahead.done()
    ahead.begin("there_is_no_such_module", slow)
    ahead.done()
    assert slow not in sys.modules
