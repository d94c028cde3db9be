"""Progress in a script: nothing where nobody looks, a bar on a terminal that is gone when the work
is done.
"""

import io
import sys

import pytest

import drift


class Terminal(io.StringIO):
    """A standard error that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_script_is_told_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    with drift.progress() as report:
        report("drift", 0.5)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("quiet", [False, True])
def test_a_terminal_shows_a_bar_unless_it_is_to_be_quiet(
    monkeypatch: pytest.MonkeyPatch, quiet: bool
) -> None:
    case = drift.load("overdue_boat")
    monkeypatch.setenv("TERM", "xterm")
    for of in (case, None):
        monkeypatch.setattr(sys, "stderr", Terminal())
        with drift.progress(of, quiet=quiet) as report:
            report("drift", 0.5)
        assert ("drift" in sys.stderr.getvalue()) is not quiet
