"""Digests of input files: they say what exactly went into a run, whatever the files were called.

A thread of their own makes them while the run goes on, once for each file in a process as long as
it does not change.
"""

import hashlib
import os
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from pathlib import Path

from geo.files import fence

CHUNK = 2**22  # [bytes]

Key = tuple[tuple[str, int, int], ...]  # path, size and time of change of each file

_digests: dict[Key, "Future[str]"] = {}
_guard = threading.Lock()


def start(paths: Iterable[str]) -> None:
    """Begin to digest files, and folders such as Zarr stores, and return at once."""
    new: list[tuple[str, Future[str]]] = []
    with _guard:
        for path in paths:
            key = _key(path)
            if key is not None and key not in _digests:
                _digests[key] = Future()
                new.append((path, _digests[key]))
    if new:  # a daemon, so that the end of the process does not wait for it
        threading.Thread(target=_fulfil, args=(new,), name="digest", daemon=True).start()


def digest_of(path: str) -> str:
    """Return "sha256:..." of the bytes of a file or a folder of files.

    Raises OSError where it cannot be read.
    """
    start([path])
    key = _key(path)
    if key is None:
        raise FileNotFoundError(path)
    return _digests[key].result()


def size(path: str) -> int:
    """Return how many bytes a file or a folder of files holds."""
    return sum(os.path.getsize(file) for file in _files(path))


def _key(path: str) -> Key | None:
    """Return what identifies the present state of a file or folder; None where it cannot be read."""
    try:
        stats = [(file, os.stat(file)) for file in _files(path)]
    except (OSError, ValueError):
        return None
    return tuple(
        (os.path.abspath(file), status.st_size, status.st_mtime_ns) for file, status in stats
    )


def _fulfil(promised: list[tuple[str, "Future[str]"]]) -> None:
    """Digest each path and hand its digest, or the error that it met, to its future."""
    for path, answer in promised:
        try:
            answer.set_result(_digest(path))
        except BaseException as error:
            answer.set_exception(error)


def _files(path: str) -> Iterator[str]:
    """Give the path itself where it is a file, and all files below it where it is a folder."""
    if not os.path.isdir(path):
        yield path
        return
    yield from sorted(str(file) for file in Path(path).rglob("*") if file.is_file())


def _digest(path: str) -> str:
    fence.check_store(path)
    total = hashlib.sha256()
    for file in _files(path):
        if file != path:
            total.update(f"{os.path.relpath(file, path)}\n{os.path.getsize(file)}\n".encode())
        with open(file, "rb") as stream:
            while chunk := stream.read(CHUNK):
                total.update(chunk)
    return f"sha256:{total.hexdigest()}"
