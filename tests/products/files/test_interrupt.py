"""Signals that end a run:

Ctrl-C, a request to end, and a terminal that goes, unless the run is to outlive it.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import pytest

from drift.products.files import interrupt

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")


@pytest.fixture
def hangup() -> Iterator[None]:
    before = signal.getsignal(signal.SIGHUP)
    yield
    signal.signal(signal.SIGHUP, before)


def hung_up(during: contextlib.AbstractContextManager[None]) -> None:
    """Have the terminal go in a run, while something else goes on."""
    with interrupt.ending_cleanly():
        with during:
            os.kill(os.getpid(), signal.SIGHUP)
        interrupt.raise_if_interrupted()


@pytest.mark.usefixtures("hangup")
@pytest.mark.parametrize("during", [contextlib.nullcontext, interrupt.signals_deferred])
def test_a_terminal_that_goes_unwinds_the_run(
    during: Callable[[], contextlib.AbstractContextManager[None]],
) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    with pytest.raises(interrupt.Terminated) as ended:
        hung_up(during())
    assert ended.value.number == signal.SIGHUP


@pytest.mark.usefixtures("hangup")
def test_a_run_that_is_to_outlive_its_terminal_does() -> None:
    """As `nohup drift run` starts it."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with interrupt.ending_cleanly():
        os.kill(os.getpid(), signal.SIGHUP)
        with interrupt.signals_deferred(), interrupt.exit_on_signal():
            os.kill(os.getpid(), signal.SIGHUP)
        interrupt.raise_if_interrupted()
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_children_leave_ctrl_c_to_this_process() -> None:
    """Also those that a thread of the context starts later; this process is as it was."""
    words = "import signal; print(*sorted(signal.pthread_sigmask(signal.SIG_BLOCK, [])))"
    go, found = threading.Event(), list[str]()

    def start() -> None:
        go.wait(60)
        found.append(
            subprocess.run([sys.executable, "-c", words], capture_output=True, text=True).stdout
        )

    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    later = threading.Thread(target=start)
    with interrupt.blocked_in_children():
        later.start()
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before
    go.set()
    later.join()
    blocked = sorted({*before, signal.SIGINT, signal.SIGHUP})
    assert found == [f"{' '.join(str(int(number)) for number in blocked)}\n"]
