"""Ctrl-C and requests to end: exceptions that unwind a run, so that nothing half-written stays."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

INTERRUPTED = "drift: interrupted; no half file is left"
TERMINATED = "drift: asked to end; no half file is left"


class Terminated(BaseException):
    """A request to end (SIGTERM): unwinds as Ctrl-C does, so that nothing half-written stays."""


_asked: list[int] = []  # signals to end that have come: the exception is lost where a destructor is running


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
        with _on(signal.SIGTERM, end), _on(signal.SIGINT, end):
            yield
    finally:
        sys.unraisablehook = before


def heed() -> None:
    """Leave if that was asked for."""
    if _asked:
        raise Terminated if _asked[0] == signal.SIGTERM else KeyboardInterrupt


@contextlib.contextmanager
def _on(number: signal.Signals, handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle a signal for a while; only a process's main thread can."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before if before is not None else signal.SIG_DFL)


@contextlib.contextmanager
def leaving_at_once() -> Iterator[None]:
    """Leave at the first Ctrl-C: libraries swallow KeyboardInterrupt while they are imported.

    No file is open then.
    """

    def leave(number: int, frame: object) -> None:
        asked = number == signal.SIGTERM
        os.write(2, f"{TERMINATED if asked else INTERRUPTED}\n".encode())
        os._exit(128 + number)

    with _on(signal.SIGINT, leave), _on(signal.SIGTERM, leave):
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
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        if waiting:
            signal.raise_signal(waiting[0])
