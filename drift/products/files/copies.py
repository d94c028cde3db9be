"""Forked copies of this process: they have all it has in memory, at no cost, and no lock of Python's
to share. On systems other than Linux libraries do not survive a fork, or there is none.

A copy computes on arrays and draws. It never touches the device: the threads of its owner are not
in it.
"""

import contextlib
import ctypes
import multiprocessing
import os
import signal
import sys
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from multiprocessing.connection import Connection
from typing import Any, NoReturn, TypeVar

T = TypeVar("T")
R = TypeVar("R")

PATIENCE = 60.0  # [s] without an answer after which a copy is given up
DIE_WITH_PARENT = 1  # option of prctl: signal to a process whose parent dies


def possible() -> bool:
    """Return whether this process can have copies."""
    return sys.platform == "linux"


def follow_owner(owner: int) -> bool:
    """Make this process, a new copy, live no longer than its owner; return whether that is alive.

    Signals from the keyboard are for the owner, which ends its copies.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    _library().prctl(DIE_WITH_PARENT, signal.SIGKILL)
    return os.getppid() == owner


@cache
def _library() -> ctypes.CDLL:
    return ctypes.CDLL(None)


@contextlib.contextmanager
def forking() -> Iterator[None]:
    """Fork without Python's warning about threads: a copy uses none of their locks."""
    _library()  # before the fork: a copy may find the lock of the loader taken
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


def map_in_order(function: Callable[[T], R], items: Iterable[T], copies: int) -> Iterator[R]:
    """Yield the results of a function in the order of its items, computed by copies of this process.

    What a copy does not answer is computed here, so that results do not depend on copies. This
    process makes the next items meanwhile.

    Args:
        function: takes an item; it reads nothing that changes after the first.
        items: can be pickled, and so can the results. One for each copy is held at a time.
        copies: their number; with less than 2 all is computed here.
    """
    asked: deque[_Copy] = deque()  # those that have an item, in the order of their items
    started: list[_Copy] = []
    try:
        with contextlib.suppress(OSError), forking():  # the system allows no more processes
            for _ in range(copies if copies > 1 and possible() else 0):
                started.append(_Copy(function))
        idle = list(started)
        for item in items:
            if not started:
                yield function(item)
                continue
            done = []
            if not idle:
                idle.append(asked.popleft())
                done.append(idle[0].result())
            copy = idle.pop()
            copy.ask(item)
            asked.append(copy)
            yield from done
        for copy in asked:
            yield copy.result()
    finally:
        for copy in started:
            copy.end()


class _Copy:
    """A copy that computes a function of one item at a time.

    It is forked without `multiprocessing`, whose copies close standard input first: they would wait
    for ever where a thread of the owner reads it.
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function, self._item = function, None
        self._ready = False  # whether it has said that it takes items
        owner = os.getpid()
        self._here, there = multiprocessing.Pipe()
        with contextlib.closing(there):
            try:
                with forking():
                    self._process = os.fork()
            except OSError:
                self._here.close()
                raise
            if self._process == 0:
                self._here.close()
                _answer(there, function, owner)

    def ask(self, item: Any) -> None:
        """Give it an item; its result must be taken before the next."""
        self._item = item
        with contextlib.suppress(OSError, EOFError):  # it has died, which `result` sees
            if not self._ready:
                self._ready = self._here.poll(PATIENCE) and self._here.recv()
            if self._ready:  # what no copy reads would wait in the pipe for ever
                self._here.send(item)
            else:
                self.end()

    def result(self) -> Any:
        """Return the result of its item, computed here if it gives none within PATIENCE."""
        item, self._item = self._item, None
        with contextlib.suppress(OSError, EOFError):
            if self._here.poll(PATIENCE):
                return self._here.recv()
        self.end()
        return self._function(item)

    def end(self) -> None:
        """Kill it, unless it has been killed; it gives no result then."""
        self._here.close()
        process, self._process = self._process, 0
        if process:
            with contextlib.suppress(OSError):
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)


def _answer(there: Connection, function: Callable[[Any], Any], owner: int) -> NoReturn:
    """Answer the items that come, in a copy; where one fails, end: the owner computes it."""
    try:
        with contextlib.suppress(Exception):
            if follow_owner(owner):
                there.send(True)
                while True:
                    there.send(function(there.recv()))
    finally:
        os._exit(0)
