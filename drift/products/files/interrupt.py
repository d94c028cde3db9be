"""Ctrl-C, termination requests and closed terminals, as exceptions that unwind a run cleanly."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

INTERRUPTED = "drift: interrupted; no incomplete file is left"
TERMINATED = "drift: terminated on request; no incomplete file is left"


ENDS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class Terminated(BaseException):
    """A termination request (SIGTERM) or a closed terminal (SIGHUP); it unwinds a run like Ctrl-C.

    number: that of the signal.
    """

    def __init__(self, number: int = signal.SIGTERM) -> None:
        super().__init__(number)
        self.number = int(number)


# signals received: an exception raised while a destructor runs is lost
_pending: list[int] = []


@contextlib.contextmanager
def ending_cleanly() -> Iterator[None]:
    """Turn Ctrl-C and termination requests into exceptions that unwind the run."""
    _pending.clear()

    def end(number: int, frame: object) -> None:
        _pending.append(number)
        raise_if_interrupted()

    def unraisable(lost: Any) -> None:
        if not isinstance(lost.exc_value, KeyboardInterrupt | Terminated):
            previous(lost)

    previous, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        with contextlib.ExitStack() as stack:
            for number in ENDS:
                stack.enter_context(_handling(number, end))
            yield
    finally:
        sys.unraisablehook = previous


def raise_if_interrupted() -> None:
    """Raise the exception of a pending signal, if there is one."""
    if _pending:
        raise KeyboardInterrupt if _pending[0] == signal.SIGINT else Terminated(_pending[0])


@contextlib.contextmanager
def _handling(number: signal.Signals, handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle a signal within the context; only the main thread of a process can.

    A signal that is ignored (nohup) stays ignored.
    """
    if threading.current_thread() is not threading.main_thread() or _ignored(number):
        yield
        return
    previous = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, previous if previous is not None else signal.SIG_DFL)


def _ignored(number: int) -> bool:
    """Return True if this process was started to outlive its terminal."""
    return number != signal.SIGINT and signal.getsignal(number) is signal.SIG_IGN


@contextlib.contextmanager
def exit_on_signal() -> Iterator[None]:
    """Exit at once on a signal, as libraries swallow KeyboardInterrupt while they are imported.

    Use it only while no file is open.
    """

    def leave(number: int, frame: object) -> None:
        terminated = number != signal.SIGINT
        with contextlib.suppress(OSError):  # the terminal may be closed
            os.write(2, f"{TERMINATED if terminated else INTERRUPTED}\n".encode())
        os._exit(128 + number)

    with contextlib.ExitStack() as stack:
        for number in ENDS:
            stack.enter_context(_handling(number, leave))
        yield


@contextlib.contextmanager
def blocked_in_children() -> Iterator[None]:
    """Block Ctrl-C and hang-ups in processes and threads that are started within the context.

    Threads pass this on to the processes that they start later. Earlier threads of this process
    still take the signals: see `signals_deferred`. Windows has no such mask.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker  # imported late: few commands start processes

    resource_tracker.ensure_running()  # to start it within the context would unblock Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def signals_deferred() -> Iterator[None]:
    """Defer Ctrl-C and termination requests until the block is done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    previous = {
        number: signal.signal(number, lambda number, _: waiting.append(number))
        for number in ENDS
        if not _ignored(number)
    }
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        if waiting:
            signal.raise_signal(waiting[0])
