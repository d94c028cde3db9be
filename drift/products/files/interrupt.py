"""Ctrl-C, requests to end and closing terminals: exceptions that unwind a run, so that no
half-written file stays.
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

INTERRUPTED = "drift: interrupted; no half file is left"
TERMINATED = "drift: asked to end; no half file is left"


ENDS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class Terminated(BaseException):
    """A request to end (SIGTERM), or a closed terminal (SIGHUP): unwinds as Ctrl-C does.

    So nothing half-written stays. number: of the signal.
    """

    def __init__(self, number: int = signal.SIGTERM) -> None:
        super().__init__(number)
        self.number = int(number)


# signals to end that have come: the exception is lost where a destructor is running
_asked: list[int] = []


@contextlib.contextmanager
def ending_cleanly() -> Iterator[None]:
    """Turn Ctrl-C and a request to end into exceptions that unwind the run."""
    _asked.clear()

    def end(number: int, frame: object) -> None:
        _asked.append(number)
        heed()

    def unraisable(lost: Any) -> None:
        if not isinstance(lost.exc_value, KeyboardInterrupt | Terminated):
            before(lost)

    before, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        with contextlib.ExitStack() as stack:
            for number in ENDS:
                stack.enter_context(_on(number, end))
            yield
    finally:
        sys.unraisablehook = before


def heed() -> None:
    """Leave if that was asked for."""
    if _asked:
        raise KeyboardInterrupt if _asked[0] == signal.SIGINT else Terminated(_asked[0])


@contextlib.contextmanager
def _on(number: signal.Signals, handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle a signal for a while; only a process's main thread can.

    One that is ignored (nohup) stays so.
    """
    if threading.current_thread() is not threading.main_thread() or _ignored(number):
        yield
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before if before is not None else signal.SIG_DFL)


def _ignored(number: int) -> bool:
    """Whether this process was started to outlive its terminal."""
    return number != signal.SIGINT and signal.getsignal(number) is signal.SIG_IGN


@contextlib.contextmanager
def leaving_at_once() -> Iterator[None]:
    """Leave at the first Ctrl-C: libraries swallow KeyboardInterrupt while they are imported.

    No file is open then.
    """

    def leave(number: int, frame: object) -> None:
        asked = number != signal.SIGINT
        with contextlib.suppress(OSError):  # the terminal may have gone
            os.write(2, f"{TERMINATED if asked else INTERRUPTED}\n".encode())
        os._exit(128 + number)

    with contextlib.ExitStack() as stack:
        for number in ENDS:
            stack.enter_context(_on(number, leave))
        yield


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Put off Ctrl-C and a request to end until the block is done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: waiting.append(number))
        for number in ENDS
        if not _ignored(number)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        if waiting:
            signal.raise_signal(waiting[0])
