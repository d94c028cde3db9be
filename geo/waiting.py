"""How a wait for a server, a library or another thread can be given up.

It asks every quarter of a second whether to go on.

A signal's exception can be lost where a destructor runs, and other threads never see it. So each
wait asks by itself.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

POLL = 0.25  # [s] longest time that a wait goes without asking

_of_thread = threading.local()


class Left(BaseException):
    """The wait was given up because its result is no longer needed."""


def ask(check: Callable[[], None]) -> None:
    """Have the waits of this thread call `check`, which raises to end them."""
    _of_thread.check = check


def heed() -> None:
    """Raise where this thread must give up its wait: its check says so, or the program's main
    thread has ended.
    """
    check: Callable[[], None] | None = getattr(_of_thread, "check", None)
    if check is not None:
        check()
    if not threading.main_thread().is_alive():
        raise Left


@contextmanager
def turn(lock: threading.Lock) -> Iterator[None]:
    """Hold a lock of `threading`; the wait for it can be given up like any other."""
    while not lock.acquire(timeout=POLL):
        heed()
    try:
        yield
    finally:
        lock.release()
