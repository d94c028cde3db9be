"""How the pictures of a run are drawn: by this process, and on Linux by copies of it at the same
time.

A copy (a fork) has all that was computed at no cost. Each process takes the next picture that
nobody has begun, and a copy tells of each that it has drawn. What no copy has told of when none is
at work any more, this process draws itself: whether the system grants copies, and whatever becomes
of them, the files are the same. Elsewhere than on Linux libraries do not outlive a fork, or there
is none.
"""

import contextlib
import ctypes
import json
import os
import select
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

MOST = 4  # processes that draw: each holds some 100 MB
TURN = 2  # [bytes] of a picture's number
TURNS = 2000  # pictures that are shared among processes; a pipe takes them at once
PATIENCE = 60.0  # [s] without a word from a copy after which it is given up
DIE_WITH_PARENT = 1  # of prctl: the signal that a process gets when the one that began it dies

Draw = Callable[[Path], None]
Tell = Callable[[float], None]  # takes the share that is done


@contextlib.contextmanager
def begun(
    pictures: Mapping[str, Draw], place: Path, processes: int
) -> Iterator[Callable[[Tell], None]]:
    """Have copies of this process begin to draw pictures, by name, into a folder.

    Gives a function that takes part until all are drawn. processes: how many may draw, this one
    among them.
    """
    copies: dict[int, int] = {}  # the pipe by which each tells what it has drawn, and its process
    next_one, turns = os.pipe()
    os.write(turns, b"".join(k.to_bytes(TURN, "big") for k in range(min(len(pictures), TURNS))))
    os.close(turns)
    try:
        if sys.platform == "linux":
            with contextlib.suppress(OSError):  # the system grants no more
                for _ in range(min(processes, MOST, len(pictures)) - 1):
                    _copy(pictures, place, next_one, copies)

        def finish(tell: Tell) -> None:
            left = dict(pictures)

            def done(name: str) -> None:
                del left[name]
                tell(1 - len(left) / len(pictures))

            for name in _turns(pictures, next_one):
                pictures[name](place / name)
                done(name)
            for told in list(copies):
                for name, said in _told(told):
                    for words in said:
                        warnings.warn(words, stacklevel=2)
                    done(name)
                _end(told, copies.pop(told))
            for name in list(left):
                pictures[name](place / name)
                done(name)

        yield finish
    finally:
        for told, process in copies.items():
            _end(told, process)
        os.close(next_one)


def _turns(pictures: Mapping[str, Draw], next_one: int) -> Iterator[str]:
    """Give the names of the pictures that no process has begun, each to one process."""
    names = list(pictures)
    while turn := os.read(next_one, TURN):
        yield names[int.from_bytes(turn, "big")]


def _copy(pictures: Mapping[str, Draw], place: Path, next_one: int, copies: dict[int, int]) -> None:
    """Have a copy of this process draw, and add it to the copies; raise OSError where the system
    refuses.
    """
    library, owner = ctypes.CDLL(None), os.getpid()
    told, tell = os.pipe()
    try:
        process = _fork()
    except OSError:
        os.close(told)
        os.close(tell)
        raise
    if process:
        os.close(tell)
        copies[told] = process
        return
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # that is for the owner, who ends its copies
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        if hasattr(signal, "SIGHUP"):
            signal.signal(signal.SIGHUP, signal.SIG_IGN)  # likewise
        library.prctl(DIE_WITH_PARENT, signal.SIGKILL)
        for name in _turns(pictures, next_one) if os.getppid() == owner else ():
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("default")
                pictures[name](place / name)
            os.write(tell, json.dumps([name, [str(one.message) for one in said]]).encode() + b"\n")
    finally:
        os._exit(0)


def _fork() -> int:
    """Fork; other threads may hold locks, as Python says, but a copy draws, and uses none of
    theirs.

    Matplotlib opens its fonts again after a fork.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def _told(told: int) -> Iterator[tuple[str, list[str]]]:
    """Give the names of the pictures that a copy tells that it has drawn, each with what was warned
    of, until it ends.
    """
    waiting, rest = select.poll(), b""
    waiting.register(told)
    while waiting.poll(1000 * PATIENCE) and (piece := os.read(told, 2**16)):
        *lines, rest = (rest + piece).split(b"\n")
        yield from map(json.loads, lines)


def _end(told: int, process: int) -> None:
    """End a copy, whatever it is doing."""
    os.close(told)
    with contextlib.suppress(OSError):
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
