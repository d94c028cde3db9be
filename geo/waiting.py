"""Leaving while one waits for a server, a library or another thread: what a thread then asks every quarter of a second.

A signal's exception can be lost where a destructor runs, and other threads never see it. So a wait asks.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

POLL = 0.25  # [s] the longest that a wait goes without asking

_of_thread = threading.local()


class Left(BaseException):
    """The wait was given up because nobody waits for its result any more."""


def ask(check: Callable[[], None]) -> None:
    """Have the waits of this thread call `check`, which raises to end them."""
    _of_thread.check = check


def heed() -> None:
    """Raise if this thread is to leave its wait: its own check says so, or the program's main thread has ended."""
    check: Callable[[], None] | None = getattr(_of_thread, "check", None)
    if check is not None:
        check()
    if not threading.main_thread().is_alive():
        raise Left


@contextmanager
def turn(lock: Any) -> Iterator[None]:
    """Hold a lock of `threading`, after a wait that heeds as others do."""
    while not lock.acquire(timeout=POLL):
        heed()
    try:
        yield
    finally:
        lock.release()
