"""Draw the pictures of a run in parallel: by this process, and by copies of it where there can be
any (drift.products.files.copies).

Each process takes the next picture that none has begun, and a fork reports each one that it has
drawn. Pictures that no fork reported are drawn by this process at the end, so the files do not
depend on whether forks succeed.
"""

import contextlib
import gc
import json
import os
import select
import signal
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from drift.products.files import copies

MOST = 4  # processes that draw; each needs some 100 MB
TURN = 2  # [bytes] of a picture's number
TURNS = 2000  # pictures that are shared among processes; their numbers must fit into the pipe

Draw = Callable[[Path], None]
Tell = Callable[[float], None]  # takes the share of pictures that is done


@contextlib.contextmanager
def draw_in_parallel(
    pictures: Mapping[str, Draw], place: Path, processes: int
) -> Iterator[Callable[[Tell], None]]:
    """Start to draw pictures, by name, into a folder, with forks of this process.

    Args:
        pictures: drawing functions by file name.
        place: folder of the pictures.
        processes: number of processes that may draw, this one included.

    Returns:
        A context manager that yields a function: it takes part in drawing until all are drawn.
    """
    forks: dict[int, int] = {}  # process id by the pipe of its reports
    queue, queue_end = os.pipe()
    os.write(queue_end, b"".join(k.to_bytes(TURN, "big") for k in range(min(len(pictures), TURNS))))
    os.close(queue_end)
    try:
        if copies.possible():
            with contextlib.suppress(OSError):  # the system allows no more processes
                for _ in range(min(processes, MOST, len(pictures)) - 1):
                    _start_copy(pictures, place, queue, forks)

        def finish(tell: Tell) -> None:
            remaining = dict(pictures)

            def done(name: str) -> None:
                del remaining[name]
                tell(1 - len(remaining) / len(pictures))

            for name in _take_pictures(pictures, queue):
                pictures[name](place / name)
                done(name)
            for reports in list(forks):
                for name, messages in _drawn_by_copy(reports):
                    for message in messages:
                        warnings.warn(message, stacklevel=2)
                    done(name)
                _end_copy(reports, forks.pop(reports))
            for name in list(remaining):
                pictures[name](place / name)
                done(name)

        yield finish
    finally:
        for reports, process in forks.items():
            _end_copy(reports, process)
        os.close(queue)


def _take_pictures(pictures: Mapping[str, Draw], queue: int) -> Iterator[str]:
    """Yield the names of pictures that no process has begun, each to one process only."""
    names = list(pictures)
    while turn := os.read(queue, TURN):
        yield names[int.from_bytes(turn, "big")]


def _start_copy(
    pictures: Mapping[str, Draw], place: Path, queue: int, forks: dict[int, int]
) -> None:
    """Fork a copy that draws, and add it to `forks`; raise OSError if the system refuses.

    Matplotlib opens its fonts again after a fork.
    """
    owner = os.getpid()
    reports, report_end = os.pipe()
    try:
        with copies.forking():
            process = os.fork()
    except OSError:
        os.close(reports)
        os.close(report_end)
        raise
    if process:
        os.close(report_end)
        forks[reports] = process
        return
    try:
        gc.freeze()  # a search for cycles would go through all results, and copy their memory
        for name in _take_pictures(pictures, queue) if copies.follow_owner(owner) else ():
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("default")
                pictures[name](place / name)
            os.write(
                report_end,
                json.dumps([name, [str(one.message) for one in caught]]).encode() + b"\n",
            )
    finally:
        os._exit(0)


def _drawn_by_copy(reports: int) -> Iterator[tuple[str, list[str]]]:
    """Yield the names of pictures that a copy reports, each with its warnings, until it ends."""
    waiting, rest = select.poll(), b""
    waiting.register(reports)
    while waiting.poll(1000 * copies.PATIENCE) and (piece := os.read(reports, 2**16)):
        *lines, rest = (rest + piece).split(b"\n")
        yield from map(json.loads, lines)


def _end_copy(reports: int, process: int) -> None:
    """Kill a copy."""
    os.close(reports)
    with contextlib.suppress(OSError):
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
