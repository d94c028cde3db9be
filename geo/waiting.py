"""Interruptible waits for a server, a library or another thread.

A signal's exception can be lost in a destructor, and other threads never receive it. So each wait
checks every quarter of a second whether to continue.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

POLL = 0.25  # [s] longest time between two checks

_of_thread = threading.local()


class WaitInterrupted(BaseException):
    """The wait was interrupted because its result is no longer needed."""


def set_wait_check(check: Callable[[], None]) -> None:
    """Make the waits of this thread call `check`, which raises an exception to end them."""
    _of_thread.check = check


def check_wait() -> None:
    """Raise if this thread must end its wait.

    That is so if its check raises, or if the program's main thread has ended.
    """
    check: Callable[[], None] | None = getattr(_of_thread, "check", None)
    if check is not None:
        check()
    if not threading.main_thread().is_alive():
        raise WaitInterrupted


@contextmanager
def hold_lock(lock: threading.Lock) -> Iterator[None]:
    """Hold a lock of `threading`; the wait for it can be interrupted like any other."""
    while not lock.acquire(timeout=POLL):
        check_wait()
    try:
        yield
    finally:
        lock.release()
