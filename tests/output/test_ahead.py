"""What is imported while particles move disturbs nothing that is done meanwhile."""

import ast
import sys
import threading
import time

import pytest

from drift.output import ahead


def test_no_two_threads_parse_at_once(tmp_path, monkeypatch):
    """CPython 3.11 counts the depth of all threads together: a kernel that was parsed during an import failed."""
    inside, most, lock = 0, 0, threading.Lock()
    parse = ast.parse
    monkeypatch.setattr(ast, "parse", parse)  # put back whatever happens

    def counted(*args, **kwargs):
        nonlocal inside, most
        with lock:
            inside += 1
            most = max(most, inside)
        time.sleep(0.01)
        with lock:
            inside -= 1
        return parse(*args, **kwargs)

    monkeypatch.setattr(ahead, "_parse", counted)
    (tmp_path / "parses_at_import.py").write_text("import ast\nfor _ in range(20):\n    ast.parse('1 + 1')\n")
    monkeypatch.syspath_prepend(tmp_path)
    ahead.begin("parses_at_import")
    for _ in range(20):
        ast.parse("2 + 2")
    ahead.done()
    assert "parses_at_import" in sys.modules
    assert most == 1
    assert ast.parse is counted


@pytest.mark.parametrize("module", ["there_is_no_such_module"])
def test_what_cannot_be_imported_is_left_to_others(module):
    before = ast.parse
    ahead.begin(module)
    ahead.done()
    assert ast.parse is before
