"""Leaving while one waits: what a thread asks at least every quarter of a second while it waits for a server.

A signal's exception can be lost where a destructor runs, and other threads never see it. So a wait asks.
"""

import threading
from collections.abc import Callable

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
